"""The range in which a linkage works, and the least transmission angle over it.

A bench reads it and its optimiser improves it: both mean the same.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from designopt.errors import UserError
from kinematics.explore.survey import InputSweep, SweepEvaluator

ALONG_EACH = 10
"""Samples of the range of each of several inputs; an even number has both 0° and 180° in it."""

INSIDE = 0.02
"""How far from a limit the outermost samples of a single input stay, as a part of the range: at the
limit itself no lengths transmit anything."""

WHOLE = 1e-9
"""Rad by which a whole turn may be missed."""


class WorkingRange:
    """Where designs of one linkage work, and how well they transmit there.

    One input is sampled from limit to limit, but for `INSIDE` of the way at each of them; several
    inputs on a grid over all their knobs' ranges, wherever there are poses.
    """

    def __init__(self, surveyor: SweepEvaluator, spans: Sequence[tuple[float, float]]) -> None:
        """Nothing is compiled.

        Args:
            surveyor: of the linkage.
            spans: of the inputs' knobs, rad or mm.
        """
        self._surveyor, self._spans = surveyor, tuple(spans)
        parts = surveyor.linkage.structure.inputs
        self._turns = [part.slider is None for part in parts]
        self.count = surveyor.samples if len(self._spans) == 1 else ALONG_EACH ** len(self._spans)

    def cases(
        self, distances: np.ndarray, inputs: np.ndarray, survey: InputSweep | None = None
    ) -> Float[np.ndarray, "cases inputs"]:
        """Inputs that stand for the range in which a design works, `count` of them.

        Args:
            distances: of the design, mm.
            inputs: of a pose; of several ranges of one input the one around it counts, or the
                first one.
            survey: of the design's only input over its knob's range, if there is one already.

        Raises:
            UserError: it works nowhere.
        """
        if len(self._spans) == 1:
            survey = survey or self._surveyor.survey(distances, inputs, 0, self._spans[0])
            return self._along(survey)[:, None]
        every = np.array(list(itertools.product(*map(self._sampled, range(len(self._spans))))))
        ok, margin, _ = self._surveyor.judged(distances, every)
        good = ok & (margin > 0)
        if not np.any(good):
            raise UserError("no pose of this design assembles: change lengths until one does")
        # As many for every design, so that one program serves them all.
        return np.where(good[:, None], every, every[np.argmax(good)])

    def least(
        self, distances: np.ndarray, inputs: np.ndarray, survey: InputSweep | None = None
    ) -> float | None:
        """The least transmission angle over `cases`, degrees; none where it works nowhere."""
        try:
            cases = self.cases(distances, inputs, survey)
        except UserError:
            return None
        ok, _, angles = self._surveyor.judged(distances, cases)
        table = angles[ok]
        return math.degrees(float(np.min(table))) if table.size else None

    def _along(self, survey: InputSweep) -> Float[np.ndarray, " cases"]:
        low, high = self._spans[0]
        ranges = _ranges(survey, (low, high))
        if not ranges:
            raise UserError(
                f"no {survey.swept.name} in its range gives a pose: change lengths until one does"
            )
        turn = 0.0
        if self._whole(0) and len(ranges) > 1 and survey.sweep_ok[0] and survey.sweep_ok[-1]:
            # What ends a whole turn goes on at its beginning.
            turn = high - low
            ranges = [(ranges[-1][0], ranges[0][1] + turn), *ranges[1:-1]]
        first, last = next(
            (
                pair
                for pair in ranges
                if any(min(pair) <= here <= max(pair) for here in (survey.here, survey.here + turn))
            ),
            ranges[0],
        )
        inset = INSIDE * (last - first)
        # The ends of the knob's range are no limits.
        return np.linspace(
            first if first == low else first + inset,
            last if last == high else last - inset,
            self.count,
        )

    def _whole(self, column: int) -> bool:
        low, high = self._spans[column]
        return self._turns[column] and abs(abs(high - low) - 2 * math.pi) < WHOLE

    def _sampled(self, column: int) -> np.ndarray:
        low, high = self._spans[column]
        return np.linspace(low, high, ALONG_EACH, endpoint=not self._whole(column))


def _ranges(survey: InputSweep, span: tuple[float, float]) -> list[tuple[float, float]]:
    """From where to where in its sweep there are poses."""
    edges = [span[0], *(edge.value for edge in survey.edges), span[1]]
    first = 0 if survey.sweep_ok[0] else 1
    return list(itertools.pairwise(edges))[first::2]
