"""A scene in one pose as plain numbers in mm, and its rays as lines, for drawings."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.programs import Program
from designopt.vectors import Vector
from optics.plot.layer_section import LayerSection, stacks_of
from optics.scene.scene import Layout, Scene, place
from optics.visibility.tracing import NOTHING, Tracer, trace_rays
from optics.visibility.views import Pieces

Point = Float[np.ndarray, "2"]
Points = Float[np.ndarray, "_ 2"]
Angles = Float[Array | np.ndarray, " joints"]
Traced = tuple[Array | np.ndarray, Array | np.ndarray]
"""What rays to every piece of every pad meet, and where; see `trace_pieces`."""

ARC = 61
"""Points that stand for a curved mirror."""

FAR = 8.0
"""A camera is far away from so many times the larger side of all else on."""

INSIDE = 1e-6
"""How far inside of a piece its outermost rays pass, as a part of it: a ray that just touches what
bounds the piece may go either way by rounding."""


@dataclass(frozen=True)
class Section:
    """A scene in one pose.

    Attributes:
        camera: position of the camera, mm.
        axis: direction of its optical axis, rad.
        lines: of every surface, in the order of ``Layout.surfaces``, its two ends, or points along
            its arc, mm.
        hinges: where the frames' hinges are, mm.
        stacks: the layers of every pad that has any, or none at all.
        designed: ends of every surface in the reference pose, mm.
    """

    camera: Point
    axis: float
    lines: tuple[Points, ...]
    hinges: Points
    stacks: tuple[LayerSection | None, ...] = ()
    designed: Float[np.ndarray, "surfaces 2 2"] | None = None

    @classmethod
    def of(cls, scene: Scene, angles: Angles) -> Section:
        """The section of a scene at joint angles in rad."""
        return cls.made_of(scene, place_parts(scene, angles))

    @classmethod
    def made_of(cls, scene: Scene, parts: tuple[Array | np.ndarray, ...]) -> Section:
        """The section of a scene from what `place_parts` computes of it."""
        camera, axis, ends, arcs, hinges, designed = (np.asarray(part, float) for part in parts)
        lines = list(ends)
        for surface, arc in zip(scene.layout.curved, arcs, strict=True):
            lines[surface] = arc
        stacks = stacks_of(scene, lines)
        return cls(camera, float(axis), tuple(lines), hinges, stacks, designed)

    def pad(self, scene: Scene, pad: int) -> Points:
        """Ends of a pad, by its index: of its membrane, where layers lie on it."""
        stack = self.stacks[pad]
        return self.lines[len(scene.layout.mirrors) + pad] if stack is None else stack.membrane

    def places(self) -> Points:
        """All that has to be in a picture, mm; a camera that is far away has not."""
        rest = np.vstack([*self.lines, self.hinges])
        return rest if self.far_camera() else np.vstack([rest, self.camera[None]])

    def far_camera(self) -> float | None:
        """How far the camera is from all else, mm, if next to that all else would vanish."""
        rest = np.vstack([*self.lines, self.hinges])
        if not len(rest):
            return None
        low, high = rest.min(axis=0), rest.max(axis=0)
        gap = math.hypot(*np.maximum(np.maximum(low - self.camera, self.camera - high), 0))
        return gap if gap > FAR * max(high - low) > 0 else None


@Program
def place_parts(scene: Scene, angles: Float[Array, " joints"]) -> tuple[Array, ...]:
    """Camera, its axis (rad), ends of surfaces, points of arcs, hinges, ends as designed, mm."""
    placed, parts = place(scene, angles), jnp.linspace(0, 1, ARC, dtype=scene.mirrors.dtype)

    def absolute(part: Vector) -> Array:
        return placed.absolute(part).stacked()

    ends = jnp.stack([absolute(placed.starts), absolute(placed.ends)], axis=1)
    arcs = Tracer.of(scene, placed).arcs
    bent = jnp.zeros((0, ARC, 2), parts.dtype)
    if arcs is not None:
        bent = absolute(jax.vmap(lambda arc: jax.vmap(arc.place)(parts))(arcs))
    camera = absolute(placed.camera)
    hinges = absolute(placed.hinges)
    return camera, placed.axis.angle(), ends, bent, hinges, scene.surface_ends


def rays_to(
    scene: Scene, angles: Angles, section: Section, view: Pieces, count: int
) -> list[tuple[int, int, list[Points]]]:
    """Rays to every piece of every pad, traced from the camera.

    Args:
        scene: the scene.
        angles: joint angles, rad.
        section: the scene in this pose.
        view: what is seen in this pose, unbatched.
        count: how many rays to each piece, evenly spread in the image, the outermost at its ends.

    Returns:
        For every piece the index of its path, that of its pad, and the rays' corners, mm: the
        camera, where mirrors reflect them, where they pass surfaces of layers, and where they end.
    """
    return through_pieces(scene, section, view, trace_pieces(scene, angles, view, count=count))


def through_pieces(
    scene: Scene, section: Section, view: Pieces, traced: Traced
) -> list[tuple[int, int, list[Points]]]:
    """As `rays_to`, from what `trace_pieces` computes."""
    surfaces, places = traced
    paths, rays = np.asarray(view.path), []
    # Lists: a few numbers each, for which arrays take longer.
    for pad, piece in np.argwhere(np.asarray(view.present)).tolist():
        lines, stack = [], section.stacks[pad]
        for met, (camera, *corners) in zip(
            surfaces[pad, piece].tolist(), places[pad, piece].tolist(), strict=True
        ):
            known = [surface != NOTHING for surface in met]
            line = [camera, *itertools.compress(corners, known)]
            entered = stack and _entered(scene.layout, pad, [*itertools.compress(met, known)])
            if stack and entered:
                line += stack.through(line[-2:], *entered)
            lines.append(np.array(line))
        rays.append((int(paths[pad, piece]), pad, lines))
    return rays


def _entered(layout: Layout, pad: int, surfaces: Sequence[int]) -> tuple[int, int | None] | None:
    """The layer that a ray enters, and at which end if not from above; none where it stops."""
    last = surfaces[-1] if surfaces else NOTHING
    if last == len(layout.mirrors) + pad:
        return 0, None
    body = last - len(layout.surfaces) + len(layout.bodies)
    if body < 0 or layout.bodies[body].kind != "clear" or layout.bodies[body].pad != pad:
        return None
    return layout.bodies[body].layer, layout.bodies[body].end


@partial(Program, static_argnames=["count"])
def trace_pieces(scene: Scene, angles: Float[Array, " joints"], view: Pieces, count: int) -> Traced:
    """What rays to every piece meet, and the camera and where, mm; see `rays_to`."""
    placed = place(scene, angles)
    first, last = view.pixels[..., :1], view.pixels[..., 1:]
    spread = np.clip(np.linspace(0, 1, count), INSIDE, 1 - INSIDE)
    spread = jnp.asarray(spread, first.dtype)[None, None]
    angles_seen = scene.camera.angle(first + spread * (last - first))
    directions = placed.axis.angle() + angles_seen
    shift = scene.camera.pupil_at(angles_seen) / placed.size
    pupil = placed.camera + placed.axis.scaled(shift)
    positions = placed.absolute(pupil).stacked()
    hits = trace_rays(scene, angles, positions, directions, bounces=view.spans.shape[-2])
    return hits.surface, jnp.concatenate([positions[..., None, :], hits.place], axis=-2)
