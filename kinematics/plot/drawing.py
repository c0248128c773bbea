"""Drawings of a linkage as in a textbook of mechanisms: one pose, or a whole motion."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from designopt.plot.figures import PALETTE
from designopt.plot.typesetting import drawn_name
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD, Structure
from kinematics.plot import symbols
from kinematics.plot.label_layout import FONT, label_offsets, sampled
from kinematics.plot.scene import Place, Points, Scene, Travel
from kinematics.plot.symbols import GRAY, INK
from kinematics.solve.solver import Pose

GHOSTS, CURVES, FIXED, BODIES, PINS, LABELS = 1.0, 1.5, 2.0, 3.0, 6.0, 8.0
"""Order of drawing; bodies lie over each other in the order of the file."""

ROOM = 0.07
"""Room around a drawing, as a part of its larger side."""


def body_colors(structure: Structure) -> dict[str, str]:
    """The colour of each body: of the moving ones in the order of the file; fixed ones grey."""
    moving = zip((part.name for part in structure.moving), itertools.cycle(PALETTE), strict=False)
    return {part.name: GRAY for part in structure.bodies if part.fixed} | dict(moving)


def draw_pose(
    axes: Axes,
    linkage: Linkage,
    pose: Pose,
    *,
    faint: bool = False,
    labels: bool | Mapping[str, tuple[float, float]] = True,
    travel: Travel | None = None,
    clear_of: Sequence[Points] = (),
) -> None:
    """Draw one pose: ground, bars, polygons, blocks, slots, springs and pins.

    Args:
        axes: where to draw, in mm at equal scales.
        linkage: the linkage.
        pose: where everything is, unbatched; draw none whose solution is not ok.
        faint: only thin lines for the moving bodies, as for a pose beside another.
        labels: whether joints are named beside them; or where, in points from each joint.
        travel: least and greatest slide of sliders, mm, between which their lines are drawn; by
            default only around the pose's own.
        clear_of: further lines that labels keep clear of, mm.
    """
    scene = Scene.of(linkage, pose, travel)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    widen(axes, np.vstack([*scene.joints.values(), *scene.ends]))
    if faint:
        draw_faint(axes, scene)
        return
    offsets = offsets_of(axes, [scene], clear_of) if labels is True else labels or {}
    draw_scene(axes, scene, offsets)


def draw_scene(axes: Axes, scene: Scene, labels: Mapping[str, tuple[float, float]]) -> None:
    """Draw a scene and nothing else of the axes; their limits stay as they are.

    Args:
        axes: where to draw.
        scene: the pose.
        labels: where the names of joints stand, in points from each; those left out have none.
    """
    draw_fixed(axes, scene)
    _draw_bodies(axes, scene)
    _draw_joints(axes, scene)
    _draw_labels(axes, scene, labels)


def widen(axes: Axes, places: Points) -> None:
    """Make room for places, mm, beside all that is drawn, and for the signs around them."""
    axes.update_datalim(places)
    (left, low), (right, high) = axes.dataLim.get_points()
    room = ROOM * max(right - left, high - low, 1e-9)
    axes.set(xlim=(left - room, right + room), ylim=(low - room, high + room))


def offsets_of(
    axes: Axes, scenes: Sequence[Scene], clear_of: Sequence[Points] = ()
) -> dict[str, tuple[float, float]]:
    """Where labels stand in all of several poses, in points from their joints.

    In several poses they turn with `Scene.angles`. The axes' limits have to be (nearly) final.
    """
    scale = _points_per_mm(axes)
    drawn = [_clutter(scene, scale, clear_of) for scene in scenes]
    places = [scene.joints for scene in scenes]
    angles = [scene.angles for scene in scenes] if len(scenes) > 1 else None
    return label_offsets(places, drawn, scale, angles)


def _clutter(scene: Scene, scale: float, further: Sequence[Points]) -> Points:
    """Points, in points on paper, that stand for everything drawn."""
    parts = [sampled(line, scale) for line in (*scene.lines(), *further)]
    parts += [place * scale + outline for place, outline in _signs(scene)]
    for along, ends in zip(scene.directions, scene.ends, strict=True):
        side = symbols.STRIP / 2 * np.array([-along[1], along[0]])
        parts += [sampled(ends, scale) + side, sampled(ends, scale) - side]
    return np.vstack(parts)


def _points_per_mm(axes: Axes) -> float:
    figure: Any = axes.figure
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    across, up = axes.bbox.width / abs(right - left), axes.bbox.height / abs(high - low)
    return 72 / figure.dpi * float(min(across, up))


def _pivots(scene: Scene) -> list[str]:
    """Fixed joints that something turns about."""
    return [joint for joint in scene.structure.fixed_joints if scene.members(joint)]


def _signs(scene: Scene) -> list[tuple[Place, Points]]:
    """Joints, and the outline in points of the sign that is drawn there."""
    result = [
        (scene.joints[joint], np.vstack([symbols.GROUND, (0, -14), (-10, -14)]))
        for joint in _pivots(scene)
    ]
    corners = np.array([(x, y) for x in (-10.0, 0.0, 10.0) for y in (-7.0, 7.0)])
    for part, along in zip(scene.structure.sliders, scene.directions, strict=True):
        sides = np.array([along, (-along[1], along[0])])
        result.append((scene.joints[part.joint], corners @ sides))
    circle = np.stack([np.cos(angles := np.arange(0, 2 * np.pi, 0.3)), np.sin(angles)], axis=-1)
    result += [(place, 12 * circle) for place, _ in _springs(scene)]
    return result


def _springs(scene: Scene) -> list[tuple[Place, tuple[Place, Place]]]:
    """Place and legs of each spring: at the bodies' common joint, else between their nearest."""
    found = []
    for names in scene.structure.springs:
        first, second = (
            np.array([scene.joints[joint] for joint in scene.structure.body(name).joints])
            for name in names
        )
        gaps = np.sum((first[:, None] - second[None]) ** 2, axis=-1)
        i, j = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
        place = (first[i] + second[j]) / 2
        found.append((place, (_away(first, place), _away(second, place))))
    return found


def _away(places: Points, place: Place) -> Place:
    """From a place towards a body's farthest joint; down if it has no other."""
    steps = places - place
    farthest = steps[int(np.argmax(np.sum(steps * steps, axis=-1)))]
    return farthest if np.any(farthest) else np.array([0.0, -1.0])


def draw_fixed(axes: Axes, scene: Scene) -> None:
    """Draw what does not move: the ground, tracks and fixed pivots."""
    for part in scene.structure.bodies:
        outlines = scene.outlines(part.name) if part.fixed and len(part.joints) > 1 else []
        if outlines:
            symbols.frame(axes, part.name, outlines[0], FIXED)
    sliders = zip(scene.structure.sliders, scene.ends, strict=True)
    for part, ends in sliders:
        if scene.structure.node(part.on) == WORLD:
            symbols.track(axes, ends, FIXED + 0.1)
    for joint in _pivots(scene):
        symbols.ground(axes, scene.joints[joint], FIXED + 0.2)


def _draw_bodies(axes: Axes, scene: Scene) -> None:
    colors = body_colors(scene.structure)
    moving = scene.structure.moving
    for level, part in enumerate(moving):
        outlines, strips = scene.outlines(part.name), scene.strips(part.name)
        z = BODIES + level / len(moving)
        symbols.body(axes, part.name, outlines, strips, colors[part.name], z)


def _draw_joints(axes: Axes, scene: Scene) -> None:
    colors = body_colors(scene.structure)
    structure = scene.structure
    for part, along in zip(structure.sliders, scene.directions, strict=True):
        size = symbols.BLOCK if structure.node(part.on) == WORLD else symbols.SLOT_BLOCK
        color = GRAY if part.keeps is None else colors[part.keeps]
        place = scene.joints[part.joint]
        symbols.block(axes, place, along, PINS - 1, size=size, color=color)
    for place, legs in _springs(scene):
        symbols.spring(axes, place, legs, PINS - 0.5)
    for joint, place in scene.joints.items():
        kept = [part.keeps for part in structure.sliders if part.joint == joint]
        partners = len(scene.members(joint)) + len(kept) - sum(name is not None for name in kept)
        if partners + (joint in structure.fixed_joints) > 1:
            symbols.pin(axes, joint, place, PINS)
        else:
            color = next((colors[name] for name in scene.members(joint)), GRAY)
            symbols.point(axes, joint, place, PINS, color)


def draw_faint(axes: Axes, scene: Scene) -> None:
    """Draw only thin lines for the moving bodies."""
    colors = body_colors(scene.structure)
    for part in scene.structure.moving:
        light = symbols.tint(colors[part.name], 0.7)
        for line in (*scene.outlines(part.name), *scene.strips(part.name)):
            symbols.stroke(axes, line, light, 1.0, GHOSTS, f"ghost:{part.name}")


def _draw_labels(axes: Axes, scene: Scene, offsets: Mapping[str, tuple[float, float]]) -> None:
    for name, offset in offsets.items():
        place = scene.joints[name]
        text = axes.annotate(
            drawn_name(name),
            (float(place[0]), float(place[1])),
            offset,
            textcoords="offset points",
        )
        text.set(ha="center", va="center_baseline", fontsize=FONT, color=INK, zorder=LABELS)
        text.set_path_effects([withStroke(linewidth=2.0, foreground=symbols.PAPER)])
        text.set_in_layout(False)
