"""Run times of two methods set against each other, one sample of each in every round."""

from __future__ import annotations

import math
import statistics
import time
from typing import NamedTuple

import jax

from designopt.study.precision import MIN_SAMPLE_SECONDS, Contender


class Ratio(NamedTuple):
    """A run time over another one, each measured in turn with the other.

    Attributes:
        value: median over the rounds.
        low: least.
        high: largest.
    """

    value: float
    low: float
    high: float


def in_turn(first: Contender, second: Contender, rounds: int) -> Ratio:
    """Run time of ``second`` over that of ``first``, one sample of each in every round.

    What slows the machine down for a while slows both, so the ratio is steadier than that of two
    medians.
    """
    calls = [_calls(contender) for contender in (first, second)]
    ratios = []
    for _ in range(rounds):
        seconds = [
            _seconds(contender, count)
            for contender, count in zip((first, second), calls, strict=True)
        ]
        ratios.append(second.scale * seconds[1] / (first.scale * seconds[0]))
    return Ratio(statistics.median(ratios), min(ratios), max(ratios))


def _calls(contender: Contender) -> int:
    return max(1, math.ceil(MIN_SAMPLE_SECONDS / max(_seconds(contender, 1), 1e-9)))


def _seconds(contender: Contender, calls: int) -> float:
    start = time.perf_counter()
    for _ in range(calls):
        jax.block_until_ready(contender.call())
    return (time.perf_counter() - start) / calls
