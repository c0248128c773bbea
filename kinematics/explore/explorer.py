"""A linkage to turn and to change: its pose, the curves it traces, margin, transmission angles."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from designopt.explore.explorer import (
    Chart,
    Explorer,
    ExplorerState,
    Numbers,
    Readout,
    Series,
    View,
)
from designopt.export.drawing import Drawing, Layer, Place, Polyline, unused_name
from designopt.optimize.parametric import Parameter, Values
from kinematics.explore.dragging import Dragging
from kinematics.export.drawing import draw_linkage, sketched_scene
from kinematics.io.designed import DesignedLinkage
from kinematics.parametric.evaluator import PoseBatch, Sweep
from kinematics.parametric.linkage_design import LinkageDesign
from kinematics.plot.scene import Scene, traced_joints

SAME = 1e-9
"""Rad or mm by which an input has not moved."""

BEYOND = 0.12
"""How far an input goes beyond where it locks, as a part of its range, so that one runs into it."""

LEAST_TRANSMISSION_DEG = 40.0
"""A common limit of design: R. L. Norton, Design of Machinery, 6th ed., section 4.10."""

RANGE_DEG = (0.0, 90.0)
"""Of transmission angles."""


class LinkageExplorer(Explorer):
    """Inputs and distances of a linkage, as a person turns them."""

    design: LinkageDesign

    def __init__(self, design: DesignedLinkage) -> None:
        """Nothing is compiled before the joints are asked for, or a pose.

        Args:
            design: the linkage.
        """
        self.design = LinkageDesign(design)  # pyright: ignore[reportIncompatibleVariableOverride]
        self._designed = design
        self._poses = self.design.poses
        self._structure = design.linkage.structure
        self._dragging = Dragging(self.design)
        self._swept = 0
        self._last = self._poses.home

    @functools.cached_property
    def joints(self) -> tuple[Parameter, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The inputs, a little beyond where they lock with the others as sketched."""
        return tuple(map(self._joint, range(len(self._poses.home))))

    def _joint(self, column: int) -> Parameter:
        name, home = self._structure.inputs[column].name, float(self._poses.home[column])
        below, above = self._poses.range_of(self.design.designed, column)
        unit = "°" if self._poses.turning[column] else "mm"
        value = self.design.shown(column, home)
        if unit == "°" and below is None and above is None:
            low, high = (0.0, 360.0) if value > SAME else (-180.0, 180.0)
            return Parameter(name, value, low, high, unit)
        far = self._poses.reach(self.design.designed, column)
        ends = home - far if below is None else below, home + far if above is None else above
        low, high = (self.design.shown(column, end) for end in ends)
        spare = BEYOND * (high - low)
        low, high = float(math.floor(low - spare)), float(math.ceil(high + spare))
        return Parameter(name, value, low, high, unit)

    def sketch(self) -> Sequence[View]:
        """See `Explorer`."""
        scene = sketched_scene(self._designed.linkage)
        return [self._view(draw_linkage(scene, title=self.design.title), scene)]

    def show(self, values: Values) -> ExplorerState:
        """See `Explorer`; the input that moved last is the abscissa of the charts."""
        inputs, distances = self._inputs(values), self.design.distances(values)
        moved = np.flatnonzero(np.abs(inputs - self._last) > SAME)
        if moved.size:
            self._swept = int(moved[0])
        self._last = inputs
        broken = self.design.dimensions.broken(distances.tolist())
        if broken:
            faint = _faint(draw_linkage(sketched_scene(self._designed.linkage)))
            view = View("Linkage", faint._replace(title=self.design.title))
            return ExplorerState([view], self._numbers(inputs, None, broken))
        cases = self.design.cases
        sweep = self._poses.sweep(distances, inputs, self._swept, self._span(), cases)
        matter = "" if sweep.ok else self._matter(sweep)
        return ExplorerState([self._pose(sweep)], self._numbers(inputs, sweep, matter))

    def drag(self, values: Values, handle: str, place: Place) -> dict[str, float]:
        """See `Explorer`; all other joints stay where they are, as far as that is possible."""
        joint = self._dragging.joint(handle)
        distances = self.design.distances(values)
        if joint is None or self.design.dimensions.broken(distances.tolist()):
            return dict(values)
        pose = self._poses.solve(distances, self._inputs(values)[None])
        if not pose.ok[0]:
            return dict(values)
        scene = self._poses.scene(pose, 0)
        return {**values, **self._dragging.values(values, self.joints, scene, joint, place)}

    def _inputs(self, values: Values) -> np.ndarray:
        names = enumerate(part.name for part in self._structure.inputs)
        return np.array([self.design.inside(column, values[name]) for column, name in names])

    def _span(self) -> tuple[float, float]:
        joint = self.joints[self._swept]
        return (
            self.design.inside(self._swept, joint.low),
            self.design.inside(self._swept, joint.high),
        )

    # -- the picture ----------------------------------------------------------------------------

    def _pose(self, sweep: Sweep) -> View:
        """The pose over the curves of its joints; faint where it locks, if there is none."""
        poses, row = sweep.here, 0
        if not sweep.ok:
            if not sweep.limits:
                scene = sketched_scene(self._designed.linkage)
                return View("Linkage", self._over_paths(_faint(draw_linkage(scene)), sweep))
            poses, row = sweep.at_limits, _nearest(sweep)
        scene = self._poses.scene(poses, row, sweep.travel)
        drawing = draw_linkage(scene)
        if not sweep.ok:
            return View("Linkage", self._over_paths(_faint(drawing), sweep))
        return self._view(self._over_paths(drawing, sweep), scene, sweep.here)

    def _view(self, drawing: Drawing, scene: Scene, pose: PoseBatch | None = None) -> View:
        joints = {name: (float(x), float(y)) for name, (x, y) in scene.joints.items()}
        return View("Linkage", drawing, self._dragging.handles(joints), self._notes(joints, pose))

    def _notes(self, joints: Mapping[str, Place], pose: PoseBatch | None) -> dict[str, str]:
        notes = {}
        for part in self._structure.bodies:
            first = joints[part.joints[0]]
            told = [
                f"{part.joints[0]}–{joint} {math.dist(first, joints[joint]):.6g} mm"
                for joint in part.joints[1:]
            ]
            if len(part.joints) > 1 and not part.fixed:
                second = joints[part.joints[1]]
                turn = math.degrees(math.atan2(second[1] - first[1], second[0] - first[0]))
                told.append(f"at {turn:.2f}°")
            notes[part.name] = ", ".join(told)
        angles = {} if pose is None else dict(zip(self._poses.pins, pose.angles[0], strict=True))
        for joint, (x, y) in joints.items():
            angle = f", μ {math.degrees(angles[joint]):.2f}°" if joint in angles else ""
            notes[joint] = f"{x:.6g}, {y:.6g} mm{angle}"
        return notes

    def _over_paths(self, drawing: Drawing, sweep: Sweep) -> Drawing:
        """A drawing over the curves that joints trace in a sweep."""
        layer = unused_name("paths", {part.name for part in self._structure.bodies})
        lines = []
        for joint in traced_joints(self._structure):
            path = sweep.poses.joints[:, self._structure.joints.index(joint)]
            for run in _runs(sweep.poses.ok):
                places = [(x, y) for x, y in path[run].tolist()]
                lines.append(Polyline(layer, places, name=f"path of {joint}"))
        return drawing._replace(
            title=self.design.title,
            layers=[Layer(layer, "path"), *drawing.layers],
            polylines=[*lines, *drawing.polylines],
        )

    # -- charts and numbers ---------------------------------------------------------------------

    def _numbers(
        self, inputs: np.ndarray, sweep: Sweep | None, matter: str
    ) -> Callable[[], Numbers]:
        column = self._swept
        return lambda: Numbers(
            self._readouts(inputs, sweep), self._charts(inputs, sweep, column), matter
        )

    def _charts(self, inputs: np.ndarray, sweep: Sweep | None, column: int) -> list[Chart]:
        """Margin and transmission angles over an input, that which moved last."""
        joint = self.joints[column]
        label, at = f"{joint.name} ({joint.unit})", self.design.shown(column, inputs[column])
        margins: list[Series] = []
        angles: list[Series] = []
        top = 0.0
        if sweep is not None:
            across = [self.design.shown(column, value) for value in sweep.values.tolist()]
            good = sweep.poses.ok
            margin = np.where(good, sweep.poses.margin, np.nan)
            top = float(np.max(sweep.poses.margin, initial=0.0, where=good))
            table = np.where(good[:, None], np.degrees(sweep.poses.angles), np.nan)
            margins = [Series("margin", across, margin.tolist()), *self._limits(sweep, top)]
            angles = [
                *(
                    Series(f"μ at {pin}", across, own)
                    for pin, own in zip(self._poses.pins, table.T.tolist(), strict=True)
                ),
                *self._limits(sweep, RANGE_DEG[1]),
            ]
        charts = [Chart("Margin", label, "margin (mm)", margins, at, (0.0, 1.05 * top or 1.0))]
        if self._poses.pins:
            ends = [joint.low, joint.high]
            usual = Series("usual least", ends, [LEAST_TRANSMISSION_DEG] * 2)
            charts.append(
                Chart("Transmission angle", label, "μ (°)", [*angles, usual], at, RANGE_DEG)
            )
        return charts

    def _limits(self, sweep: Sweep, top: float) -> list[Series]:
        """A line across a chart wherever the linkage locks."""
        across = [self.design.shown(sweep.column, limit) for limit in sweep.limits]
        x = [value for one in across for value in (one, one, math.nan)]
        return [Series("locks", x, [0.0, top, math.nan] * len(across))] if across else []

    def _readouts(self, inputs: np.ndarray, sweep: Sweep | None) -> list[Readout]:
        units = ["°" if turns else "mm" for turns in self._poses.turning]
        readouts = [
            Readout(part.name, self.design.shown(column, inputs[column]), units[column])
            for column, part in enumerate(self._structure.inputs)
        ]
        here = None if sweep is None else sweep.here
        readouts.append(Readout("margin", None if here is None else float(here.margin[0]), "mm"))
        good = here if here is not None and here.ok[0] else None
        for number, pin in enumerate(self._poses.pins):
            angle = None if good is None else math.degrees(good.angles[0, number])
            readouts.append(Readout(f"μ at {pin}", angle, "°"))
        if self._poses.pins:
            works = sweep is not None and bool(np.all(sweep.cases.ok))
            least = math.degrees(np.min(sweep.cases.angles)) if sweep and works else None
            readouts.append(Readout("least μ in the working range", least, "°"))
        if self._poses.iterated:
            gap = None if good is None else float(good.residual[0] * good.size[0])
            readouts.append(Readout("closure", gap, "mm"))
        return readouts

    def _matter(self, sweep: Sweep) -> str:
        """Why there is no pose, and where there is one."""
        name, why = self._structure.inputs[sweep.column].name, sweep.here.message()
        if not sweep.limits:
            return f"{why} No {name} in its range gives a pose."
        nearest = self.design.shown_text(sweep.column, sweep.limits[_nearest(sweep)])
        return f"{why} {name} locks at {nearest}."


def _nearest(sweep: Sweep) -> int:
    """Number of the limit that is nearest to the pose asked for."""
    return int(np.argmin(np.abs(np.array(sweep.limits) - sweep.inputs[sweep.column])))


def _faint(drawing: Drawing) -> Drawing:
    """A drawing of what there is not."""
    layers = [layer._replace(kind="construction") for layer in drawing.layers]
    return drawing._replace(layers=layers)


def _runs(ok: np.ndarray) -> list[slice]:
    """Where poses follow each other, two at least."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], ok, [False]]).astype(int)))
    pairs = zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True)
    return [slice(first, last) for first, last in pairs if last - first > 1]
