"""A design with knobs: what ``designopt explore`` shows, without saying in which window.

Like everything that is drawn, a bench knows Matplotlib's figures and nothing of windows.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from designopt.io.spec import SpecFile

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import SubFigure

Values = Mapping[str, float]
"""A number for every knob, in the knob's unit."""


@dataclass(frozen=True)
class Knob:
    """One number that a person turns.

    Attributes:
        name: unique among a bench's knobs.
        value: where it stands at first.
        low: its least value.
        high: its greatest value.
        unit: of all three: ``"°"``, ``"mm"`` or empty.
        kind: a pose is turned by ``"joint"`` knobs, a design by ``"dimension"`` knobs.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    kind: Literal["joint", "dimension"]


@dataclass(frozen=True)
class Reading:
    """One number shown beside the picture.

    Attributes:
        name: what it is, in words; unique among a bench's readings.
        value: the number; ``None`` where there is none.
        unit: of the value; empty for a pure number.
    """

    name: str
    value: float | None
    unit: str = ""


def number_text(value: float | None) -> str:
    """A reading's value to six significant digits; a dash where there is none."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.6g}"


@dataclass(frozen=True)
class Shown:
    """What was shown of one set of values.

    Attributes:
        readings: the numbers, the same names in the same order every time.
        artists: all that changes with the values, in the order of drawing, but for rulings, which
            lie below the others; everything else in the figure stays as it is. For ticks that
            change with limits, see `designopt.plot.ruling`.
        message: what is the matter, in one sentence with its cure; empty where all is well.
    """

    readings: Sequence[Reading]
    artists: Sequence[Artist]
    message: str = ""


@dataclass(frozen=True)
class Step:
    """One iteration of an optimisation.

    Attributes:
        values: where the knobs stand after it.
        message: what it reached, in one line.
    """

    values: Values
    message: str


class Bench(abc.ABC):
    """A design with its knobs, drawn into a figure.

    Everything is called in one thread, with JAX in float64.
    """

    title: str
    """Of the window."""

    knobs: tuple[Knob, ...]
    """Joint angles first, then dimensions."""

    aim: str
    """What `optimise` improves, in words for its button's hint; empty if it cannot."""

    @abc.abstractmethod
    def draw(self, area: SubFigure) -> None:
        """Make the axes in an area of a figure, once, before anything is shown."""

    @abc.abstractmethod
    def show(self, values: Values) -> Shown:
        """Compute what these values give and draw it into the axes. Never raises."""

    @abc.abstractmethod
    def specs(self, values: Values) -> Sequence[SpecFile]:
        """The files that describe the design as it stands, which the other commands read.

        Raises:
            UserError: it cannot be written as such a file, and why.
        """

    @abc.abstractmethod
    def optimise(self, values: Values) -> Iterator[Step]:
        """Improve the dimensions from here, within the ranges of their knobs.

        Every `next` computes one iteration. The last step's message says what was reached.

        Raises:
            UserError: there is nothing to improve from here, and why.
        """
