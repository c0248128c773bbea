"""A design that a person turns: what the page of ``designopt explore`` shows, and what it asks."""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from designopt.export.drawing import Drawing, Place
from designopt.optimize.parametric import Parameter, ParametricDesign, Values


@dataclass(frozen=True)
class Readout:
    """One number shown beside the picture.

    Attributes:
        name: what it is, in words; unique among an explorer's readouts.
        value: the number; ``None`` where there is none.
        unit: of the value; empty for a pure number.
    """

    name: str
    value: float | None
    unit: str = ""


def number_text(value: float | None) -> str:
    """A readout's value to six significant digits; a dash where there is none."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.6g}"


class Handle(NamedTuple):
    """A place in a drawing that a person can drag.

    Attributes:
        name: unique among an explorer's handles; what it moves, such as "pin F".
        place: in the drawing, mm.
        parameters: names of those that dragging changes: joints and dimensions. If one of them is
            locked, the handle cannot be dragged.
    """

    name: str
    place: Place
    parameters: tuple[str, ...]


@dataclass(frozen=True)
class View:
    """A drawing to scale.

    Attributes:
        name: its heading, unique among the panels.
        drawing: in the pose that is shown, by the exporters' shapes.
        handles: what of it can be dragged.
        notes: numbers of a part by its name (a layer's or a circle's), which hovering shows.
    """

    name: str
    drawing: Drawing
    handles: Sequence[Handle] = ()
    notes: Mapping[str, str] = field(default_factory=dict)


class Series(NamedTuple):
    """A curve in a chart; NaN interrupts it."""

    name: str
    x: Sequence[float]
    y: Sequence[float]


@dataclass(frozen=True)
class Chart:
    """Curves over one axis.

    Attributes:
        name: its heading, unique among the panels.
        x_label: with the unit in brackets.
        y_label: likewise.
        series: the curves.
        at: where the design stands now, on the x axis; ``None`` where it is nowhere.
        y_range: lowest and highest value shown; by default what the curves need.
    """

    name: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    at: float | None = None
    y_range: tuple[float, float] | None = None


@dataclass(frozen=True)
class Numbers:
    """What is shown beside the views of one set of values.

    Attributes:
        readouts: the same names in the same order every time.
        charts: the same names in the same order every time.
        message: what is the matter, in one sentence with its cure; empty where all is well.
        notes: further ones of a view, by its name.
    """

    readouts: Sequence[Readout]
    charts: Sequence[Chart] = ()
    message: str = ""
    notes: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


class ExplorerState(NamedTuple):
    """What is shown of one set of values.

    Attributes:
        views: the same names in the same order every time.
        numbers: computes the rest once the views are shown, in the same thread; other values may
            have been shown meanwhile, and it may never be called.
    """

    views: Sequence[View]
    numbers: Callable[[], Numbers]


def inside_ranges(parameters: Sequence[Parameter], values: Values) -> dict[str, float]:
    """Values of these parameters, each moved into its range; others are left out."""
    return {
        one.name: min(max(values[one.name], one.low), one.high)
        for one in parameters
        if one.name in values
    }


class Explorer(abc.ABC):
    """A design with joints to turn and dimensions to change.

    An explorer is called in one thread, its design's methods in a second one too, both with JAX in
    float64. ``Values`` hold a number for every joint and every dimension.

    Attributes:
        design: its parameters are the dimensions; what it measures can be optimised.
        joints: what a pose is turned by; their values are those of the first pose.
        presets: named values of some joints or dimensions, such as ``{"straight": {"pip": 0}}``.
    """

    design: ParametricDesign
    joints: tuple[Parameter, ...]
    presets: Mapping[str, Values] = {}

    @abc.abstractmethod
    def sketch(self) -> Sequence[View]:
        """The views of the design as it is in its file, in its first pose: nothing is compiled."""

    @abc.abstractmethod
    def show(self, values: Values) -> ExplorerState:
        """What these values give. Never raises for values inside their ranges."""

    @abc.abstractmethod
    def drag(self, values: Values, handle: str, place: Place) -> dict[str, float]:
        """The values with which a handle is at a place, or as near as their ranges let it.

        Args:
            values: as shown.
            handle: its name.
            place: in the coordinates of its view, mm.
        """

    def values(self) -> dict[str, float]:
        """Those that are shown first."""
        return {joint.name: joint.value for joint in self.joints} | self.design.values()
