"""What is seen at worst over all pairs of joint angles, between the degrees too.

Every pair of whole degrees is looked at, and rows of finer steps, in which a view that is missing
for less than a degree is found. From the worst postures of each pad smaller and smaller grids lead
on: where one view hands over to another what is seen has kinks, on which no slope leads anywhere.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from designopt.batching import map_blocks
from designopt.programs import QuickJit
from optics import Pieces, Scene, describe_end, find_coverage, find_focus, find_views, name_paths
from optics.visibility.intervals import union
from optics.visibility.sharpness import find_sharpness
from studies.models.finger import Finger
from studies.models.finger_parts import PHALANGES
from studies.models.mirror_design.seeing import least_resolution, least_spare, pad_lengths

BLOCK = 256
"""Postures of one call."""

FINE = 5
"""Steps to a degree in the finer rows."""

ROWS = 4
"""Angles of the other joint for which there is a finer row."""

KEPT, APART_DEG = 4, 3.0
"""Postures of each pad from which smaller grids lead on, and how far they are apart."""

AROUND = np.linspace(-1.0, 1.0, 5)
"""Of a smaller grid, along both joints."""

ROUNDS = 10
"""Smaller grids, each half as wide: 1° / 2¹⁰ is 4″."""

ROUNDING = 1e-9
"""A smaller part of a pad that is not seen is rounding."""

GOLDEN = (math.sqrt(5) - 1) / 2

HALVINGS = 12
"""Of the transmission that is looked for: to 2e-4."""


class Worst(NamedTuple):
    """The worst of something over postures, and where.

    Attributes:
        value: the worst.
        pad: whose.
        pip_deg: flexion there.
        dip_deg: likewise.
    """

    value: float
    pad: str
    pip_deg: float
    dip_deg: float

    @property
    def place(self) -> str:
        """Where, in words."""
        return f"{self.pad} pad at PIP {self.pip_deg:.4g}°, DIP {self.dip_deg:.4g}°"


class WorstPostures(NamedTuple):
    """The worst over all pairs of joint angles.

    Attributes:
        coverage: least part of each pad that is seen.
        px_per_mm: least resolution of each pad, each place in its best view.
        blur_px: largest blur spot of each pad over all that is seen of it, pixels; empty without a
            lens.
        transmission: part of the light that the layers let through at worst, of rays that are
            needed to see what is seen; ``None`` where pads are bare.
        spare_deg: least angle between what is needed and the limits of the field of view
            (`seeing.least_spare`), on the grid of postures: towards the root, and towards the tip.
    """

    coverage: tuple[Worst, ...]
    px_per_mm: tuple[Worst, ...]
    blur_px: tuple[Worst, ...]
    transmission: float | None
    spare_deg: tuple[Worst, Worst]

    @property
    def postures(self) -> Float[np.ndarray, "worst 2"]:
        """PIP and DIP where some of a pad is hidden, and where it is least sharp, rad."""
        hidden = [one for one in self.coverage if one.value < 1 - ROUNDING]
        both = [(one.pip_deg, one.dip_deg) for one in (*hidden, *self.px_per_mm)]
        return np.deg2rad(both)

    @property
    def least_coverage(self) -> float:
        """Of any pad; 1 but for rounding is 1."""
        least = min(worst.value for worst in self.coverage)
        return 1.0 if least >= 1 - ROUNDING else least

    @property
    def least_px_per_mm(self) -> float:
        """Of any pad."""
        return min(worst.value for worst in self.px_per_mm)

    @property
    def largest_blur_px(self) -> float | None:
        """Of any pad; none without a lens."""
        return max((worst.value for worst in self.blur_px), default=None)


Numbers = Float[np.ndarray, "poses pads 5"]
"""Coverage, least resolution (px/mm), negative largest blur (pixels), and degrees to spare at both
limits of the field of view: the worst is least."""


def find_worst_postures(finger: Finger) -> WorstPostures:
    """The worst that a finger's camera shows, over all pairs of joint angles."""
    scene, ends = finger.scene(), np.array(finger.body.ranges_deg)
    degrees = np.concatenate([_square(ends), *_fine_rows(ends)])
    numbers = _look(scene, degrees)
    kinds = 3 if scene.camera.lens is not None else 2
    starts = _lowest(degrees, numbers[..., :kinds])
    at, best = degrees[starts], np.take_along_axis(numbers[..., :kinds], starts, axis=0)
    step = 1.0
    for _ in range(ROUNDS):
        at, best = _closer(scene, at, best, step, ends)
        step /= 2
    first = np.argmin(best, axis=0)
    value = np.take_along_axis(best, first[None], axis=0)[0]
    where = np.take_along_axis(at, first[None, ..., None], axis=0)[0]
    # The search interpolates resolution behind layers, and takes blur at the ends of views: here
    # every place is looked up, the nearest one among them.
    columns = np.arange(len(PHALANGES))
    for kind in range(1, kinds):
        own = look_up(scene, at[..., kind, :].reshape(-1, 2))[kind]
        own = own.reshape(len(at), len(PHALANGES), len(PHALANGES))[:, columns, columns]
        least = np.argmin(own, axis=0)
        value[:, kind], where[:, kind] = own[least, columns], at[least, columns, kind]

    def worst(kind: int, sign: int = 1) -> tuple[Worst, ...]:
        rows = zip(sign * value[:, kind], PHALANGES, where[:, kind], strict=True)
        return tuple(Worst(float(one), pad, *map(float, place)) for one, pad, place in rows)

    def spare(side: int) -> Worst:
        """Of the postures of the grid: the smaller ones do not look for it."""
        angles = numbers[..., 3 + side]
        pose, pad = np.unravel_index(np.argmin(angles), angles.shape)
        return Worst(float(angles[pose, pad]), PHALANGES[pad], *map(float, degrees[pose]))

    blur = worst(2, -1) if kinds == 3 else ()
    transmission = _least_transmission(scene, degrees)
    return WorstPostures(worst(0), worst(1), blur, transmission, (spare(0), spare(1)))


def look_up(
    scene: Scene, degrees: Float[np.ndarray, "poses 2"]
) -> Float[np.ndarray, "kinds poses pads"]:
    """Coverage of pads, least resolution over all their places, negative largest blur.

    Args:
        scene: of a finger.
        degrees: flexion of PIP and DIP.

    Returns:
        Parts, px/mm and, of a camera with a lens, pixels.
    """
    poses = np.deg2rad(degrees)
    views = find_views(scene, jnp.asarray(poses)).value
    sharp = find_sharpness(scene, poses, views, bounces=scene.layout.bounces)
    found = [np.asarray(views.coverage()), sharp.px_per_mm[..., 0]]
    if scene.camera.lens is not None:
        distance, apparent = jnp.asarray(sharp.distance), jnp.asarray(sharp.apparent)
        views = replace(views, distance=distance, apparent=apparent)
        found.append(-np.max(find_focus(scene, views).blur, axis=(-2, -1)))
    return np.stack(found)


def _lowest(
    degrees: Float[np.ndarray, "poses 2"], numbers: Float[np.ndarray, "poses pads kinds"]
) -> Int[np.ndarray, "kept pads kinds"]:
    """Indices of the worst postures that are not near each other."""
    pads, kinds = numbers.shape[1:]
    found = np.zeros((KEPT, pads, kinds), int)
    for pad, kind in np.ndindex(pads, kinds):
        left = numbers[:, pad, kind].copy()
        for kept in range(KEPT):
            index = int(np.argmin(left))
            found[kept, pad, kind] = index
            near = np.max(np.abs(degrees - degrees[index]), axis=1) < APART_DEG
            left[near] = np.inf
    return found


def _square(ends: Float[np.ndarray, "2"]) -> Float[np.ndarray, "poses 2"]:
    """All pairs of whole degrees, the ends of both ranges among them."""
    pip, dip = (whole_degrees(end) for end in ends)
    return np.stack(np.meshgrid(pip, dip, indexing="ij"), axis=-1).reshape(-1, 2)


def whole_degrees(range_deg: float) -> Float[np.ndarray, " poses"]:
    """Every whole degree from straight to the end of the range, the end included."""
    whole = np.arange(np.floor(range_deg) + 1.0)
    return whole if whole[-1] == range_deg else np.append(whole, range_deg)


def crossed(angles: Float[np.ndarray, " poses"]) -> Float[np.ndarray, " poses"]:
    """The same angles in another order, in which each is far from its place, up and down alike."""
    count = len(angles)
    steps = (step for step in range(round(count * GOLDEN), count) if math.gcd(step, count) == 1)
    return angles[np.arange(count) * next(steps, 1) % count]


def _fine_rows(ends: Float[np.ndarray, "2"]) -> list[Float[np.ndarray, "poses 2"]]:
    rows = []
    for joint, end in enumerate(ends):
        fine = np.linspace(0.0, end, int(np.ceil(FINE * end)) + 1)
        other = np.linspace(0.0, ends[1 - joint], ROWS)
        both = np.stack(np.meshgrid(fine, other, indexing="ij"), axis=-1).reshape(-1, 2)
        rows.append(both[:, ::-1] if joint else both)
    return rows


def _closer(
    scene: Scene,
    at: Float[np.ndarray, "kept pads kinds 2"],
    best: Float[np.ndarray, "kept pads kinds"],
    step: float,
    ends: Float[np.ndarray, "2"],
) -> tuple[Float[np.ndarray, "kept pads kinds 2"], Float[np.ndarray, "kept pads kinds"]]:
    """The worst places of grids around others, and what is seen there."""
    offsets = step * np.stack(np.meshgrid(AROUND, AROUND, indexing="ij"), axis=-1).reshape(-1, 2)
    around = np.clip(at[..., None, :] + offsets, 0.0, ends)
    numbers = _look(scene, around.reshape(-1, 2))
    numbers = numbers.reshape(*around.shape[:-1], *numbers.shape[1:])
    pads, kinds = np.arange(at.shape[1])[:, None, None], np.arange(at.shape[2])[:, None]
    own = numbers[:, pads, kinds, np.arange(len(offsets)), pads, kinds]
    index = np.argmin(own, axis=-1)[..., None]
    least = np.take_along_axis(own, index, axis=-1)[..., 0]
    place = np.take_along_axis(around, index[..., None], axis=-2)[..., 0, :]
    better = least < best
    return np.where(better[..., None], place, at), np.where(better, least, best)


def _look(scene: Scene, degrees: Float[np.ndarray, "poses 2"]) -> Numbers:
    return map_blocks(partial(_numbers, scene), BLOCK, np.deg2rad(degrees))


@QuickJit
def _numbers(scene: Scene, poses: Float[Array, "poses 2"]) -> Float[Array, "poses pads 5"]:
    views, lengths = find_views(scene, poses).value, pad_lengths(scene)
    sharp = least_resolution(views, lengths)
    spare = jnp.rad2deg(least_spare(views, scene.camera, lengths))
    blur = jnp.zeros_like(sharp)
    if scene.camera.lens is not None:
        blur = jnp.max(find_focus(scene, views).blur, axis=(-2, -1))
    return jnp.stack([views.coverage(), sharp, -blur, *spare], axis=-1)


def _least_transmission(scene: Scene, degrees: Float[np.ndarray, "poses 2"]) -> float | None:
    """The largest least transmission that hides nothing, over postures."""
    if scene.layers is None:
        return None
    poses = np.deg2rad(degrees[:: max(len(degrees) // 1000, 1)])

    def seen(least: float) -> np.ndarray:
        return map_blocks(partial(_seen, scene, jnp.asarray(least)), BLOCK, poses)

    low, high = 0.0, 1.0
    everything = seen(low)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        hidden = np.any(seen(middle) < everything - ROUNDING)
        low, high = (low, middle) if hidden else (middle, high)
    return low


@QuickJit
def _seen(
    scene: Scene, least: Float[Array, ""], poses: Float[Array, "poses 2"]
) -> Float[Array, "poses pads"]:
    layers = scene.layers
    assert layers is not None  # for bare pads nothing is asked
    bright = replace(layers, transmission=jnp.full(len(PHALANGES), least))
    return find_coverage(replace(scene, layers=bright), poses).value


def lost_strips(finger: Finger, worst: Worst) -> list[str]:
    """What of a pad is not seen in a posture, and what bounds it, in words."""
    scene, pad = finger.scene(), PHALANGES.index(worst.pad)
    pose = jnp.deg2rad(jnp.array([worst.pip_deg, worst.dip_deg]))
    pieces: Pieces = jax.tree.map(np.asarray, find_views(scene, pose).value)
    length, paths = float(pad_lengths(scene)[pad]), name_paths(scene.layout)
    there = np.flatnonzero(pieces.present[pad])
    starts, ends = pieces.start[pad, there], pieces.end[pad, there]
    seen = union(zip(starts.tolist(), ends.tolist(), strict=True))
    edges = [0.0, *(edge for both in seen for edge in both), 1.0]
    words = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if end - start <= ROUNDING:
            continue
        bounds = []
        for at, places, labels in (
            (start, ends, pieces.end_label),
            (end, starts, pieces.start_label),
        ):
            if at in (0.0, 1.0) or not len(there):
                continue
            piece = int(there[np.argmin(np.abs(places - at))])
            view, label = paths[int(pieces.path[pad, piece])], int(labels[pad, piece])
            bounds.append(f"the {view} view ends at {describe_end(scene.layout, label)}")
        strip = f"{worst.place}: {(end - start) * length:.2f} mm from {start * length:.2f} mm on"
        words.append(f"{strip}; {', '.join(bounds) or 'no view shows any of it'}")
    return words
