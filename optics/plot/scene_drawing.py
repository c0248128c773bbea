"""A scene drawn in the section: camera, mirrors and pads in one pose, and the rays that see."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon, Wedge
from matplotlib.path import Path
from matplotlib.patheffects import Stroke, withTickedStroke
from matplotlib.transforms import Affine2D, ScaledTranslation, Transform

from designopt.plot.figures import PALETTE
from designopt.plot.typesetting import drawn_name
from designopt.solution import Solution
from optics.plot.label_layout import Label, draw_labels
from optics.plot.layer_section import LayerSection
from optics.plot.section import Angles, Point, Points, Section, rays_to
from optics.scene.scene import Layout, Scene
from optics.visibility.intervals import union
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, path_name

INK, GRAY, PAPER = "#222222", "#9A9A9A", "white"
SEEN, HIDDEN = "#56B4E9", "#E69F00"
"""Colours of what is seen of a pad and of what is not; no ray has one of them."""
RAYS, DASHES = PALETTE[:4], ("-", (0, (6, 2)), (0, (6, 1.5, 1.2, 1.5)), (0, (2, 1)))
"""Colours and lines of the paths, in turn; they recur together after sixteen paths."""

STRIPES = (0, (0.32, 0.24))
BAR, FACE = 5.0, 1.3
"""Widths of a pad and of its sensing side, in points."""
TICK = 4.0
"""Distance of the ticks on a mirror's back, and about their reach, in points."""
REACH = 22.0
"""Length of the limits of the field of view, in points."""
LARGE, SMALLEST = 200.0, 0.85
"""Width of a drawing, in points, from which on signs have their full size; least part of it."""
TINTS = ("#E3EEF0", "#EFEADF", "#E9E4F0", "#E5EFE2")
"""Of layers in turn, the outermost first."""
CLEAR_END, DARK_END = 0.6, 1.8
"""Widths of the ends of layers that let light pass, and of all others, in points."""
EDGE = "#8FA3A8"
"""Colour of what layers have in common, and of their clear ends."""
SHEETS, FIELD, BACKS, LIGHT, FRONTS, SIGNS = 0.5, 1.0, 2.0, 3.0, 4.0, 5.0
"""Order of drawing."""

ROOM = 0.1
"""Room around a drawing, as a part of its larger side."""


def draw_scene(
    axes: Axes,
    scene: Scene,
    angles: Angles,
    views: Solution[Pieces],
    *,
    rays: int = 4,
    labels: bool = True,
) -> None:
    """Draw a scene in one pose: camera, mirrors, pads and what is seen of them, blockers, hinges.

    `scene_legend` explains the signs. The axes' limits grow to hold the drawing; give
    axes whose place in the figure is settled, so that labels find room.

    Args:
        axes: where to draw, in mm at equal scales.
        scene: the scene.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        views: what is seen in this pose, unbatched, from any engine.
        rays: how many rays are drawn to every piece that a path sees, those to its ends included.
        labels: whether mirrors and pads are named.
    """
    section = Section.of(scene, angles)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    widen(axes, section.places())
    title, far = pose_name(scene, angles), section.far_camera()
    if far and not axes.viewLim.contains(*section.camera):
        title += f" (camera {far:,.0f} mm away)"
    axes.set(xlabel="x (mm)", ylabel="y (mm)", title=drawn_name(title))
    found = scene_signs(axes, scene, angles, views, section, rays=rays)
    for artist in found.artists:
        axes.add_artist(artist)
    if labels:
        draw_labels(axes, names_of(scene, section), found.clutter, found.size)


@dataclass(frozen=True)
class Signs:
    """All that is drawn of a scene in a pose, but its names.

    Attributes:
        artists: none of them takes part in choosing the axes' limits; not yet in the axes.
        clutter: lines that names keep clear of, mm.
        size: of the signs; 1 in a large drawing.
    """

    artists: list[Artist]
    clutter: list[Points]
    size: float


def scene_signs(
    axes: Axes,
    scene: Scene,
    angles: Angles,
    views: Solution[Pieces],
    section: Section,
    *,
    rays: int = 4,
) -> Signs:
    """What `draw_scene` draws into axes, but for names.

    Args:
        axes: as in `draw_scene`.
        scene: as in `draw_scene`.
        angles: as in `draw_scene`.
        views: as in `draw_scene`.
        section: the scene in this pose.
        rays: as in `draw_scene`.
    """
    layout = scene.layout
    size = _size(axes)
    artists = [*_camera(axes, scene, section, size), *_surfaces(scene, section, size)]
    # The camera's and the hinges' signs are as wide as a few points around them.
    clutter = [*section.lines, section.hinges, section.camera[None]]
    clutter += [line for stack in section.stacks if stack for line in _filled(axes, stack)]
    words = words_of(scene, views)
    for path, pad, lines in rays_to(scene, angles, section, views.value, rays):
        gid = f"ray:{path_name(layout, words[path])}:{layout.pads[pad].name}"
        look = path_style(path)
        for line in lines:
            artists.append(_sign(Line2D(*line.T, linewidth=0.8, alpha=0.65, **look), LIGHT, gid))
        clutter += lines
    for part, stack in zip(layout.pads, section.stacks, strict=True):
        artists += [] if stack is None else _layers(part.name, stack, size)
    artists += _pads(axes, scene, section, views, size)
    for frame, hinge in zip(layout.frames, section.hinges, strict=True):
        artists += [_sign(part, SIGNS, f"hinge:{frame.name}") for part in _hinge(hinge, size)]
    return Signs(artists, clutter, size)


def pose_name(scene: Scene, angles: Angles) -> str:
    """A pose in words, such as ``PIP 30°, DIP 20°``; the scene's name if it has no joints."""
    named = zip(scene.angle_names, np.degrees(np.asarray(angles)), strict=True)
    parts = [f"{joint_name(name)} {value:.4g}°" for name, value in named]
    return ", ".join(parts) or scene.layout.name


def joint_name(name: str) -> str:
    """A joint angle's name as it is printed: abbreviations such as PIP in capitals."""
    return name.upper() if len(name) <= 3 else name


def widen(axes: Axes, places: Points) -> None:
    """Make room for places, mm, beside all that is drawn, and for the signs around them."""
    axes.update_datalim(places)
    (left, low), (right, high) = axes.dataLim.get_points()
    room = ROOM * max(right - left, high - low, 1e-9)
    axes.set(xlim=(left - room, right + room), ylim=(low - room, high + room))


def words_of(scene: Scene, views: Solution[Pieces]) -> list[tuple[int, ...]]:
    """The mirrors along every path, in the order of the views' paths."""
    return paths_of(scene.layout, views.value.spans.shape[-2])


def scene_legend(scene: Scene, views: Solution[Pieces]) -> tuple[list[Any], list[str]]:
    """Handles and texts of the signs that occur, and of the paths that see anything.

    Args:
        scene: the scene.
        views: of one pose, or of all poses that share the legend.
    """
    layout, words = scene.layout, words_of(scene, views)
    hidden = np.min(np.asarray(views.value.coverage()), initial=1.0) <= 1 - 1e-9
    none = np.zeros((1, 2))
    reflecting = {part.side for part in layout.mirrors}
    entries: list[tuple[str, Any]] = []
    if layout.pads:
        entries.append(("pad, seen", Line2D([], [], color=SEEN, linewidth=BAR)))
        if hidden:
            stripes = Line2D([], [], color=HIDDEN, linewidth=BAR, linestyle=STRIPES)
            entries.append(("pad, hidden", stripes))
        entries.append(("sensing side of a pad", Line2D([], [], color=INK, linewidth=FACE)))
    entries += _layer_legend(layout)
    if reflecting - {0}:
        entries.append(("mirror, ticks on its back", _mirror(none, 1)))
    if 0 in reflecting:
        entries.append(("two-sided mirror", _mirror(none, 0)))
    if any(part.side == 0 for part in layout.blockers + layout.module + layout.sheet_ends):
        entries.append(("blocker", _blocker(none, 0)))
    if any(part.side for part in layout.blockers):
        entries.append(("one-sided blocker", _blocker(none, 1)))
    if layout.frames:
        entries.append(("hinge", tuple(_hinge(none[0]))))
    view = views.value
    for path in np.unique(np.asarray(view.path)[np.asarray(view.present)]).tolist():
        line = Line2D([], [], linewidth=1.3, **path_style(path))
        entries.append((drawn_name(path_name(layout, words[path])), line))
    return [handle for _, handle in entries], [text for text, _ in entries]


def path_style(path: int) -> dict[str, Any]:
    """Colour and line of a path's rays, by its index."""
    turns, color = divmod(path, len(RAYS))
    return {"color": RAYS[color], "linestyle": DASHES[(color + turns) % len(DASHES)]}


def seen_pieces(views: Solution[Pieces], pad: int) -> list[tuple[float, float]]:
    """The parts of a pad that are seen by any path, as pad coordinates in order.

    Args:
        views: of one pose.
        pad: index of the pad.
    """
    view = views.value
    there = np.asarray(view.present)[pad]
    starts, ends = np.asarray(view.start)[pad][there], np.asarray(view.end)[pad][there]
    return union(zip(starts.tolist(), ends.tolist(), strict=True))


def _sign(artist: Artist, z: float, gid: str) -> Artist:
    """An artist with its place in the order of drawing and its name."""
    artist.set(zorder=z, gid=gid)
    return artist


def _size(axes: Axes) -> float:
    """Size of the signs in axes as large as these."""
    figure: Any = axes.figure
    return min(max(axes.bbox.width / figure.dpi * 72 / LARGE, SMALLEST), 1.0)


def _camera(axes: Axes, scene: Scene, section: Section, size: float) -> Iterator[Artist]:
    """A small camera, and a fan of its field of view, both sized in points."""
    figure: Any = axes.figure
    to_display: Any = axes.transData
    shift = ScaledTranslation(float(section.camera[0]), float(section.camera[1]), to_display)
    at: Transform = (
        Affine2D().rotate(section.axis).scale(size / 72) + figure.dpi_scale_trans + shift
    )
    half = math.degrees(float(scene.camera.field_of_view)) / 2
    fan = Wedge((0, 0), REACH, -half, half, facecolor="0.94", transform=at)
    fan.set(edgecolor="0.45", linewidth=0.8, linestyle=(0, (2, 1.5)))
    yield _sign(fan, FIELD, "field of view")
    outline = [(0.0, 4.0), (-3.5, 1.8), (-3.5, 4.2), (-11.5, 4.2)]
    corners = [*outline, *((x, -y) for x, y in reversed(outline)), outline[0]]
    body = PathPatch(Path(corners, closed=True), fc=INK, ec=PAPER, lw=0.6, transform=at)
    yield _sign(body, SIGNS, "camera")


def _surfaces(scene: Scene, section: Section, size: float) -> Iterator[Artist]:
    layout = scene.layout
    for index, part in enumerate(layout.surfaces):
        kind = layout.kind(index)
        if kind == "mirror":
            mirror = _mirror(section.lines[index], part.side, size)
            yield _sign(mirror, FRONTS, f"mirror:{part.name}")
        elif kind == "blocker":
            blocker = _blocker(section.lines[index], part.side, size)
            yield _sign(blocker, BACKS, f"blocker:{part.name}")


def _mirror(line: Points, side: int, size: float = 1.0) -> Line2D:
    """A mirror: ticks on the back of one side, a double line for two."""
    artist = Line2D(*line.T, color=INK, linewidth=1.5 * size)
    if side:
        ticks = withTickedStroke(
            spacing=TICK * size, angle=-135.0 * side, length=1.0, linewidth=0.7
        )
        artist.set_path_effects([ticks])
    else:
        edges = Stroke(linewidth=3.4 * size, foreground=INK)
        artist.set_path_effects([edges, Stroke(linewidth=1.4 * size, foreground=PAPER)])
    return artist


def _blocker(line: Points, side: int, size: float = 1.0) -> Line2D:
    """A blocker: a grey line, broken if it lets rays pass from one side."""
    dashes = (0, (2, 0.8)) if side else "-"
    return Line2D(*line.T, color=GRAY, linewidth=2.2 * size, linestyle=dashes)


def _hinge(place: Point, size: float = 1.0) -> list[Line2D]:
    """A pivot: a circle with a point in it."""
    ring, point = (
        Line2D(place[:1], place[1:], marker="o", color=INK, linestyle="none") for _ in range(2)
    )
    ring.set(markersize=7 * size, markerfacecolor=PAPER, markeredgewidth=1.1 * size)
    point.set(markersize=2 * size)
    return [ring, point]


def _pads(
    axes: Axes,
    scene: Scene,
    section: Section,
    views: Solution[Pieces],
    size: float,
) -> Iterator[Artist]:
    """Pads as bars behind their sensing sides, striped where they are hidden."""
    layout, bar, face = scene.layout, BAR * size, FACE * size
    for index, part in enumerate(layout.pads):
        line = section.pad(scene, index)
        inner = _shifted(axes, line, -(bar + face) / 2 * part.side)
        seen = seen_pieces(views, index)
        ends = [0.0, *(end for piece in seen for end in piece), 1.0]
        hidden = [pair for pair in zip(ends[::2], ends[1::2], strict=True) if pair[1] > pair[0]]
        for pair in hidden:
            artist = _part(line, pair, inner, color=HIDDEN, linewidth=bar, linestyle=STRIPES)
            yield _sign(artist, BACKS, f"hidden:{part.name}")
        for pair in seen:
            artist = _part(line, pair, inner, color=SEEN, linewidth=bar)
            yield _sign(artist, BACKS, f"seen:{part.name}")
        for offset in (0.0,) if part.side else (-bar / 2, bar / 2):
            outer = _shifted(axes, line, offset)
            artist = _part(line, (0.0, 1.0), outer, color=INK, linewidth=face)
            yield _sign(artist, FRONTS, f"sensing:{part.name}")


def _layers(pad: str, stack: LayerSection, size: float) -> Iterator[Artist]:
    """Layers of a pad, each in a tint of its own, their ends, and the bezel."""
    for number, outline in enumerate(stack.layers):
        sheet = Polygon(outline, closed=True, edgecolor=EDGE, linewidth=CLEAR_END * size)
        sheet.set_facecolor(TINTS[number % len(TINTS)])
        yield _sign(sheet, SHEETS, f"layer {number + 1}:{pad}")
        for end in stack.ends[number]:
            yield _sign(_end(end.line, end.kind == "clear", size), FRONTS, f"end:{pad}")
    for ledge in stack.ledges:
        if not np.allclose(*ledge, rtol=0, atol=1e-9 * math.dist(*stack.membrane)):
            yield _sign(_end(ledge, False, size), FRONTS, f"ledge:{pad}")
    for outline in stack.bezel:
        lip = Polygon(outline, closed=True, facecolor=INK, edgecolor=INK, linewidth=FACE * size)
        lip.set_joinstyle("miter")
        yield _sign(lip, FRONTS, f"bezel:{pad}")


def _end(line: Points, clear: bool, size: float) -> Line2D:
    """An end face of a layer."""
    color, width = (EDGE, CLEAR_END) if clear else (INK, DARK_END)
    return Line2D(*line.T, color=color, linewidth=width * size, solid_capstyle="butt")


def _filled(axes: Axes, stack: LayerSection) -> Iterator[Points]:
    """Lines so close all over layers and bezel that no name finds room between them."""
    figure: Any = axes.figure
    close = BAR * figure.dpi / 72 * float(np.ptp(axes.get_xlim())) / axes.bbox.width  # mm
    yield from stack.outlines()
    for first, second, above_second, above_first in stack.layers:
        count = 1 + int(min(math.dist(first, above_first) / close, 100))
        for part in np.linspace(0, 1, count + 1)[1:-1]:
            ends = [first + part * (above_first - first), second + part * (above_second - second)]
            yield np.array(ends)


def _layer_legend(layout: Layout) -> Iterator[tuple[str, Any]]:
    """What is drawn of layers, if there are any."""
    if not layout.layers:
        return
    yield "layer", Patch(facecolor=TINTS[0], edgecolor=EDGE, linewidth=CLEAR_END)
    none = np.zeros((1, 2))
    kinds = {face.kind == "clear" for face in layout.bodies if face.part == "end"}
    if True in kinds:
        yield "clear end of a layer", _end(none, True, 1.0)
    if False in kinds:
        yield "opaque end of a layer", _end(none, False, 1.0)
    if any(layout.bezels):
        yield "bezel", Patch(facecolor=INK, edgecolor=INK)


def _part(line: Points, pair: tuple[float, float], shift: Transform, **style: Any) -> Line2D:
    """The part of a segment between two coordinates along it."""
    artist = Line2D(*(line[0] + np.array(pair)[:, None] * (line[1] - line[0])).T, **style)
    artist.set(solid_capstyle="butt", dash_capstyle="butt", transform=shift)
    return artist


def _shifted(axes: Axes, line: Points, points: float) -> Transform:
    """From mm to the display, moved to the left of a segment by so many points."""
    step = line[1] - line[0]
    inch = points / 72 / math.hypot(*step)
    figure: Any = axes.figure
    to_display: Any = axes.transData
    return to_display + ScaledTranslation(-inch * step[1], inch * step[0], figure.dpi_scale_trans)


def names_of(scene: Scene, section: Section) -> list[Label]:
    """The names of mirrors and pads, in their order."""
    layout = scene.layout
    pads, mirrors = {part.name for part in layout.pads}, len(layout.mirrors)
    labels = []
    for index, part in enumerate(layout.mirrors + layout.pads):
        is_mirror = layout.kind(index) == "mirror"
        text = f"{part.name} mirror" if is_mirror and part.name in pads else part.name
        depth = TICK if is_mirror else (BAR + FACE) / (1 if part.side else 2)
        line = section.lines[index] if is_mirror else section.pad(scene, index - mirrors)
        third = (len(line) - 1) // 3  # the middle of an arc is almost straight
        labels.append(Label(text, line[[third, -1 - third]], -part.side, depth))
    return labels
