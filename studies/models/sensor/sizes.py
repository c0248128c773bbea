"""Two methods beside each other over images of several sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from designopt.study.results import PrecisionRow


def compare_at_sizes(
    rows: Sequence[PrecisionRow], ours: str, other: str, sentence: str, more_time: float = math.inf
) -> tuple[list[str], bool]:
    """What two methods reach at every image size, and whether one is closer than the other at all.

    Args:
        rows: of all methods; their settings are the sizes.
        ours: the method that should be closer.
        other: the other one.
        sentence: for each size, with ``{size}``, the rows ``{ours}`` and ``{other}``, and the
            milliseconds ``{ours_ms}`` and ``{other_ms}``.
        more_time: ours is to take less than so many times the other's run time.
    """
    evidence, holds = [], True
    for size in dict.fromkeys(row.setting for row in rows):
        own = {row.method: row for row in rows if row.setting == size}
        if ours in own and other in own:
            a, b = own[ours], own[other]
            holds &= a.error < b.error and a.seconds < more_time * b.seconds
            times = {"ours_ms": 1e3 * a.seconds, "other_ms": 1e3 * b.seconds}
            filled = sentence.format(size=size, ours=a, other=b, **times)
            evidence.append(" ".join(filled.split()))
    return evidence, holds and bool(evidence)
