"""A scene that a person turns: what is seen of its pads, by which path, and how sharply."""

from __future__ import annotations

import cmath
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.explore.explorer import (
    Chart,
    Explorer,
    ExplorerState,
    Handle,
    Numbers,
    Readout,
    Series,
    View,
    inside_ranges,
    number_text,
)
from designopt.export.drawing import Drawing, Label, Layer, Place, Polyline
from designopt.optimize.parametric import Parameter, Values
from designopt.programs import Program
from optics.export.scene_drawing import CAMERA, draw_scene, draw_views, trace_outlines
from optics.parametric.scene import SceneParameters, scene_at
from optics.parametric.scene_measures import Sight, see, see_pieces, sharpness_of
from optics.plot.section import Angles, Section, Traced, place_parts
from optics.scene.designed import DesignedScene
from optics.scene.scene import WORLD, Layout, Scene
from optics.visibility.coverage import find_coverage
from optics.visibility.intervals import union
from optics.visibility.remarks import ROUNDING, remarks_on
from optics.visibility.scene_trace import SceneTrace, Views
from optics.visibility.sharpness import Sharpness
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, name_paths

SECTION, COVERAGE = "section", "coverage"
"""Names of the panels."""

SEEN, HIDDEN = "seen", "hidden"
"""Layers of what is seen of the pads and of what is not."""

AXIS, ENDS = "camera axis", " mirror, "
"""The handle of the camera's direction; what parts a mirror's name from its end, in a handle's."""

COLORS = {SEEN: "#2B7BBA", HIDDEN: "#C26A00"}

PLACES = 61
"""Places over a parameter's range at which coverage is computed."""


class Picture(NamedTuple):
    """What is drawn of a scene in one pose.

    Attributes:
        parts: by `place_parts`.
        sight: by `see_pieces`, if it is computed.
        traced: by `trace_outlines`.
    """

    parts: tuple[Array | np.ndarray, ...]
    sight: Sight | None = None
    traced: Traced | None = None


@Program
def picture_of(scene: Scene, angles: Float[Array, " joints"]) -> Picture:
    """What is drawn of a scene at joint angles in rad; one program, because a move waits for it."""
    sight = see_pieces(scene, angles)
    traced = trace_outlines(scene, angles, sight.found.value)
    return Picture(place_parts(scene, angles), sight, traced)


@dataclasses.dataclass(frozen=True)
class Seen:
    """What is seen in one pose, how sharply, and what is not.

    Attributes:
        sight: the pieces, unbatched.
        sharpness: of what is seen; its first axis is that of this one pose.
        missed_by: angle (rad) by which each hidden pad is missed; NaN of pads that are seen, and
            where rays do not tell.
        remarks: of every pad that is not all seen, with the worst one first: what is missing, and
            why.
    """

    sight: Sight
    sharpness: Sharpness
    missed_by: Float[np.ndarray, " pads"]
    remarks: tuple[tuple[str, str], ...]

    @property
    def px_per_mm(self) -> Float[np.ndarray, "pads 3"]:
        """Least, median and greatest resolution of what is seen; 0 where nothing is."""
        return self.sharpness.px_per_mm[0]


def look_at(scene: Scene, angles: Angles, picture: Picture) -> Seen:
    """How sharply what is seen of a scene is seen, and why not more is.

    Where a pad is hidden, what is seen is computed anew by `see`.

    Args:
        scene: the scene, with pads.
        angles: joint angles, rad.
        picture: of it there, by `picture_of`.
    """
    sight = picture.sight
    assert sight is not None  # of a picture that is no sketch
    if not scene.layout.curved:
        if np.all(sight.coverage > 0):
            see.expect(scene, angles)
        else:  # `see` also computes by what a pad is missed
            sight = see(scene, angles)
    coverage, redundancy, missed = map(np.asarray, sight[1:])
    several = jax.tree.map(lambda leaf: leaf[None], sight.found)
    bounces = scene.layout.bounces
    angles = np.asarray(angles)
    sharpness = sharpness_of(scene, angles[None], several.value)
    trace = SceneTrace(
        scene,
        bounces,
        name_paths(scene.layout, bounces),
        paths_of(scene.layout, bounces),
        np.degrees(angles)[None],
        Views(
            several,
            jax.tree.leaves(several.result)[0],
            coverage[None],
            redundancy[None],
            sharpness,
            None,
        ),
        None,
        np.zeros((0, 3)),
        None,
    )
    lines = remarks_on(trace)
    pairs = [(what, why.strip()) for what, why in pairwise(lines) if why.startswith(" ")]
    order = np.argsort(coverage[coverage < 1 - ROUNDING], kind="stable")
    hidden = (coverage == 0) & (len(scene.layout.curved) == 0)
    missed = np.where(hidden, missed, np.nan)
    return Seen(sight, sharpness, missed, tuple(pairs[index] for index in order))


class SceneExplorer(Explorer):
    """A scene of pads, with joint angles, camera and mirrors to turn."""

    def __init__(
        self, design: DesignedScene, *, over: Mapping[str, tuple[float, float]] | None = None
    ) -> None:
        """Nothing is compiled yet.

        Args:
            design: the scene.
            over: ranges of joint angles, degrees; see `SceneParameters`.

        Raises:
            UserError: as `SceneParameters`.
        """
        self.design = self._parameters = SceneParameters(design, over=over)
        self.joints = self._parameters.joints
        if self.joints:
            self.presets = {
                "straight": {joint.name: joint.value for joint in self.joints},
                "bent": {joint.name: joint.high for joint in self.joints},
            }
        self._scene = design.scene
        self._turnable = (*self.joints, *self.design.parameters)
        self._before = self.values()
        self._swept, self._curve_of = self._turnable[0], ()
        self._curve = np.full((PLACES, len(design.scene.layout.pads)), np.nan)
        self._views = self.sketch()
        charts = self._chart(self._before, self._swept, seen=False)
        self._numbers = lambda: Numbers(seen_readouts(design.scene.layout, None), charts)

    def sketch(self) -> Sequence[View]:
        """The section as it is in the file."""
        picture = Picture(place_parts(self._scene, self._angles(self.values())))
        return [scene_view(SECTION, self.design.title, self._scene, picture, _part_parameters)]

    def show(self, values: Values) -> ExplorerState:
        """Light by path, pads by what is seen of them, coverage over what was turned last.

        Where the values describe no scene, the picture stays that of the last ones that do.
        """
        scene, layout = self._parameters.scene(values), self._scene.layout
        try:
            self._parameters.tables_of(scene)
        except UserError as error:
            nothing = {"readouts": seen_readouts(layout, None), "message": str(error)}
            last = self._numbers
            return ExplorerState(self._views, lambda: dataclasses.replace(last(), **nothing))
        self._notice(values)
        angles, swept = self._angles(values), self._swept
        picture = picture_of(scene, angles)
        self._views = [scene_view(SECTION, self.design.title, scene, picture, _part_parameters)]

        @functools.cache
        def numbers() -> Numbers:
            seen, message = look_at(scene, angles, picture), ""
            if seen.remarks:
                (what, why), *others = seen.remarks
                message = "; ".join([what, why, *(more for more, _ in others)])
            notes = {SECTION: pad_notes(scene, seen)}
            charts = self._chart(values, swept)
            return Numbers(seen_readouts(layout, seen), charts, message, notes)

        self._numbers = numbers
        return ExplorerState(self._views, numbers)

    def drag(self, values: Values, handle: str, place: Place) -> dict[str, float]:
        """As `Explorer.drag`; a handle that is none of the scene's changes nothing."""
        scene, angles = self._parameters.scene(values), self._angles(values)
        section, names = Section.of(scene, angles), _part_parameters(handle)
        if handle == AXIS:
            away = complex(*place) - complex(*section.camera.tolist())
            turn = section.axis - float(scene.camera.direction)
            now = values[names[0]]
            turned = math.degrees(cmath.phase(away)) - math.degrees(turn) if away else now
            moved = {names[0]: now + math.remainder(turned - now, 360.0)}
        else:
            at = unbent(scene, section, angles, handle, complex(*place))
            moved = dict(zip(names, (at.real, at.imag), strict=True))
        return {**values, **inside_ranges(self.design.parameters, moved)}

    def _angles(self, values: Values) -> Float[np.ndarray, " joints"]:
        return np.radians(np.array([values[joint.name] for joint in self.joints], float))

    def _notice(self, values: Values) -> None:
        """Which value was moved last, if it was one alone."""
        moved = [one for one in self._turnable if values[one.name] != self._before[one.name]]
        if len(moved) == 1:
            self._swept = moved[0]
        self._before = {one.name: values[one.name] for one in self._turnable}

    def _chart(self, values: Values, swept: Parameter, *, seen: bool = True) -> list[Chart]:
        """Coverage over the range of what was moved last; it changes with all others only."""
        layout = self._scene.layout
        if layout.curved:
            return []
        rest = (swept.name, *(values[one.name] for one in self._turnable if one is not swept))
        if seen and rest != self._curve_of:
            curve = _coverage.when_compiled(self._scene, *self._states(values, swept))
            self._curve = np.full((PLACES, len(layout.pads)), np.nan)
            if curve is not None:
                self._curve, self._curve_of = 100 * curve, rest
        series = []
        if seen:
            columns = zip(layout.pads, self._curve.T.tolist(), strict=True)
            places = np.linspace(swept.low, swept.high, PLACES).tolist()
            series = [Series(part.name, places, column) for part, column in columns]
        label = f"{swept.label or swept.name} ({swept.unit})"
        return [Chart(COVERAGE, label, "coverage (%)", series, values[swept.name], (0.0, 100.0))]

    def _states(self, values: Values, swept: Parameter) -> tuple[np.ndarray, np.ndarray]:
        """Parameters, and joint angles (rad), over the range of one of them."""
        places = np.linspace(swept.low, swept.high, PLACES).tolist()
        states = [{**values, swept.name: place} for place in places]
        numbers = [[state[one.name] for one in self.design.parameters] for state in states]
        return np.array(numbers), np.stack([self._angles(state) for state in states])


def scene_view(
    name: str,
    title: str,
    scene: Scene,
    picture: Picture,
    parameters: Callable[[str], tuple[str, ...]],
) -> View:
    """A scene in a pose; camera, its axis and the ends of mirrors can be dragged.

    Args:
        name: of the view.
        title: of the drawing.
        scene: the scene.
        picture: the scene in the pose.
        parameters: names of those that dragging a handle of this name changes.
    """
    section = Section.made_of(scene, picture.parts)
    drawing = draw_scene(scene, section, title=title)
    lines = {line.name: line.places for line in drawing.polylines}
    camera, toward = lines["optical axis"]
    places = {CAMERA: camera, AXIS: toward}
    for part in scene.layout.mirrors:
        line = lines[f"{part.name} mirror"]
        places |= {f"{part.name}{ENDS}from": line[0], f"{part.name}{ENDS}to": line[-1]}
    handles = [Handle(handle, place, parameters(handle)) for handle, place in places.items()]
    notes = _part_notes(scene, drawing)
    if picture.sight is not None:
        drawing = _with_light(drawing, scene, section, picture.sight, picture.traced)
    return View(name, drawing, handles, notes)


def _part_parameters(handle: str) -> tuple[str, ...]:
    """Those of a scene that dragging a handle changes."""
    if handle == AXIS:
        return ("camera.direction",)
    name, _, end = handle.rpartition(ENDS)
    stem = f"mirrors.{name}.{end}" if name else f"{handle}.position"
    return f"{stem}.x", f"{stem}.y"


def seen_readouts(layout: Layout, seen: Seen | None) -> list[Readout]:
    """Coverage, resolution and by what it is missed of every pad; dashes if nothing is known."""
    found = []
    for index, part in enumerate(layout.pads):
        numbers: list[float | None] = [None] * 5
        if seen is not None:
            spread = [value or None for value in seen.px_per_mm[index].tolist()]
            missed = math.degrees(seen.missed_by[index])
            covered = 100 * float(seen.sight.coverage[index])
            numbers = [covered, *spread, None if math.isnan(missed) else missed]
        words = [f"{word} resolution" for word in ("least", "median", "greatest")]
        words = ["coverage", *words, "missed by"]
        units = ("%", "px/mm", "px/mm", "px/mm", "°")
        for word, number, unit in zip(words, numbers, units, strict=True):
            found.append(Readout(f"{part.name}: {word}", number, unit))
    return found


@Program
def _coverage(
    scene: Scene, numbers: Float[Array, "states parameters"], angles: Float[Array, "states joints"]
) -> Float[Array, "states pads"]:
    def one(state: tuple[Float[Array, " parameters"], Float[Array, " joints"]]) -> Array:
        return find_coverage(scene_at(scene, state[0]), state[1]).value

    # One state after the other: all together would leave the cache.
    return jax.lax.map(one, (numbers, angles))


def unbent(
    scene: Scene,
    section: Section,
    angles: Angles,
    handle: str,
    place: complex,
) -> complex:
    """Where a place that moves with the camera or mirror of a handle is in the reference pose.

    Args:
        scene: the scene.
        section: the scene in a pose.
        angles: joint angles there, rad.
        handle: see `scene_view`.
        place: in that pose, mm.
    """
    layout = scene.layout
    hosts = {part.name: part.frame for part in layout.mirrors}
    at = frame = hosts.get(handle.rpartition(ENDS)[0], layout.camera_frame)
    if frame == WORLD:
        return place
    frames, turn = layout.frames, 0.0
    while at != WORLD:
        turn += frames[at].sign * float(angles[frames[at].angle])
        at = frames[at].parent
    now = complex(*section.hinges[frame].tolist())
    return complex(*np.asarray(scene.hinges)[frame].tolist()) + (place - now) * cmath.exp(
        -1j * turn
    )


def _with_light(
    drawing: Drawing, scene: Scene, section: Section, sight: Sight, traced: Traced | None
) -> Drawing:
    """A scene's drawing over the light that is seen, its pads parted into seen and hidden."""
    light, outlines = draw_views(scene, section, sight.found.value, traced)
    pads = [line for line in drawing.polylines if line.layer == "pads"]
    pieces, labels = [], []
    for index, line in enumerate(pads):
        shown = _seen_pieces(sight.found.value, index)
        ends = [0.0, *(end for piece in shown for end in piece), 1.0]
        dark = [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if b > a]
        for layer, parts in ((SEEN, shown), (HIDDEN, dark)):
            for part in parts:
                pieces.append(Polyline(layer, _along(line.places, part), name=line.name))
        covered = 100 * float(sight.coverage[index])
        layer = SEEN if covered else HIDDEN
        text = f"{line.name}, {covered:.3g} % seen" if covered else f"{line.name}, not seen"
        labels.append(Label(layer, _along(line.places, (0.5, 0.5))[0], text))
    for layer in light:
        # Paths do not differ by color alone: each is named in the middle of what it shows last.
        places = [line.places for line in outlines if line.layer == layer.name][-1]
        x, y = (sum(axis) / len(places) for axis in zip(*places, strict=True))
        labels.append(Label(layer.name, (x, y), layer.name))
    others = [layer for layer in drawing.layers if layer.name != "pads"]
    parted = [Layer(name, "pad", color=color) for name, color in COLORS.items()]
    return drawing._replace(
        layers=[*light, *others, *parted],
        polylines=[
            *outlines,
            *(line for line in drawing.polylines if line.layer != "pads"),
            *pieces,
        ],
        labels=[*(label for label in drawing.labels if label.layer != "pads"), *labels],
    )


def _seen_pieces(view: Pieces, pad: int) -> list[tuple[float, float]]:
    """The parts of a pad that are seen by any path, as pad coordinates in order."""
    there = view.present[pad]
    return union(zip(view.start[pad][there].tolist(), view.end[pad][there].tolist(), strict=True))


def _along(line: Sequence[Place], part: tuple[float, float]) -> list[Place]:
    """Places on a straight line at parts of its length."""
    (x, y), (end_x, end_y) = line[0], line[-1]
    return [(x + at * (end_x - x), y + at * (end_y - y)) for at in part]


def _part_notes(scene: Scene, drawing: Drawing) -> dict[str, str]:
    """Numbers of all parts but what is seen, by the names of their lines."""
    notes = {
        line.name: f"{math.dist(line.places[0], line.places[-1]):.4g} mm"
        for line in drawing.polylines
        if line.layer in ("mirrors", "pads", "blockers")
    }
    layout, camera = scene.layout, scene.camera
    for index, radius in zip(layout.curved, np.asarray(scene.radii).tolist(), strict=True):
        name = f"{layout.mirrors[index].name} mirror"
        notes[name] += f" from end to end, radius {radius:.4g} mm"
    x, y = np.asarray(camera.position).tolist()
    direction, field = (math.degrees(float(a)) for a in (camera.direction, camera.field_of_view))
    notes[CAMERA] = (
        f"at ({x:.4g}, {y:.4g}) mm, direction {direction:.4g}°, field of view {field:.4g}°"
    )
    return notes


def pad_notes(scene: Scene, seen: Seen) -> dict[str, str]:
    """How much and how sharply every pad is seen, in all and by each path."""
    layout, view = scene.layout, seen.sight.found.value
    names, notes = name_paths(layout, view.spans.shape[-2]), {}
    for index, part in enumerate(layout.pads):
        pad = f"{part.name} pad"
        notes[pad] = f"{100 * float(seen.sight.coverage[index]):.4g} % seen"
        if seen.px_per_mm[index, 2] > 0:
            notes[pad] += f", {_resolution(seen.px_per_mm[index])}"
        for piece in np.flatnonzero(
            view.present[index, : seen.sharpness.by_path.shape[2]]
        ).tolist():
            path = int(view.path[index, piece])
            share = 100 * float(np.sum((view.end - view.start)[index][view.path[index] == path]))
            sharp = _resolution(seen.sharpness.by_path[0, index, piece])
            notes[f"{pad}, {names[path]}"] = f"{share:.4g} % of the pad, {sharp}"
    return notes


def _resolution(spread: Float[np.ndarray, "3"]) -> str:
    least, _, greatest = map(number_text, spread.tolist())
    return f"{least} to {greatest} px/mm"
