"""What a person asks of an optimisation, in the texts of the command line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from designopt.errors import UserError
from designopt.optimize.design_search import DesignSearch
from designopt.optimize.parametric import MeasureBound, ParametricDesign, free_parameters


@dataclass(frozen=True)
class Asked:
    """What is improved, by what, and what is kept.

    Attributes:
        objective: name of a measure; the design's first one if empty.
        free: names of parameters, or beginnings of names.
        bounds: other bounds than the design's, by these names; ``None`` where it has its own.
        keep: requirements beyond the design's own.
    """

    objective: str
    free: tuple[str, ...]
    bounds: Mapping[str, tuple[float | None, float | None]]
    keep: tuple[MeasureBound, ...]

    @classmethod
    def of(
        cls,
        maximise: str | None = None,
        minimise: str | None = None,
        free: Sequence[str] = (),
        keep: Sequence[str] = (),
    ) -> Asked:
        """What texts such as ``--free coupler=30:50`` ask for.

        Args:
            maximise: name of a measure whose least value counts.
            minimise: name of one whose greatest value counts; not both.
            free: ``NAME`` or ``NAME=low:high``, either end of which may be left out.
            keep: requirements; see `MeasureBound.parse`.

        Raises:
            UserError: a text is of another form, or both measures are given.
        """
        if maximise and minimise:
            raise UserError(
                f"--minimise {minimise}: one measure is improved, and others are kept; leave it or "
                "--maximise out"
            )
        names, bounds = [], {}
        for text in free:
            # Names may hold a sign of equality themselves, and a range has a colon.
            name, equals, ends = text.rpartition("=")
            if not equals or (":" not in ends and name.count("=")):
                name, equals, ends = text, "", ""
            names.append(name.strip())
            if equals:
                bounds[name.strip()] = parse_range(f"--free {text}", ends)
        bounded = tuple(MeasureBound.parse(text) for text in keep)
        return cls(maximise or minimise or "", tuple(names), bounds, bounded)

    def search(self, design: ParametricDesign, maximise: bool | None = None) -> DesignSearch:
        """The search of a design for it; nothing is compiled yet.

        Args:
            design: the design.
            maximise: whether the measure is to be maximised; ``None`` if that is left to it.

        Raises:
            UserError: the design has no such measure or parameter, the measure cannot be improved
                that way, or a requirement can be met by nothing.
        """
        objective = self.objective or design.measures[0].name
        found = DesignSearch(
            design, objective, free_parameters(design, self.free, self.bounds), self.keep
        )
        if maximise is not None and maximise != (found.objective.worst == "least"):
            given, right = ("maximise", "minimise") if maximise else ("minimise", "maximise")
            raise UserError(
                f"--{given} {objective}: of {found.objective.description} the "
                f"{found.objective.worst} value counts, over all postures; write --{right}"
            )
        return found


def parse_range(place: str, text: str) -> tuple[float | None, float | None]:
    """The ends of ``low:high``; ``None`` for one that is left out.

    Args:
        place: where it was written, for messages.
        text: the range.

    Raises:
        UserError: it is of another form.
    """
    try:
        low, high = (float(end) if end.strip() else None for end in text.split(":"))
        if any(end is not None and not math.isfinite(end) for end in (low, high)):
            raise ValueError
    except ValueError:
        raise UserError(f"{place}: write low:high, such as 30:50, or NAME alone") from None
    return low, high


def parse_over(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ends of joints or inputs from texts such as ``crank=0:360``.

    Raises:
        UserError: a text is of another form.
    """
    found = {}
    for text in texts:
        name, _, ends = text.partition("=")
        low, high = parse_range(f"--over {text}", ends)
        if low is None or high is None or not low < high:
            raise UserError(f"--over {text}: write NAME=low:high, low < high")
        found[name.strip()] = low, high
    return found
