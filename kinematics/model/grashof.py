"""Which links of a four-bar turn fully: the class after Grashof, from the four lengths alone."""

from __future__ import annotations

from dataclasses import dataclass

TOUCHING = 1e-12
"""Relative difference of the two sums of lengths up to which a four-bar has a change point."""


@dataclass(frozen=True)
class Grashof:
    """Class of a four-bar.

    Attributes:
        name: "crank-rocker", "rocker-crank", "double-crank", "double-rocker", "non-Grashof" or
            "change-point".
        crank_turns: whether the input link can make full turns.
        rocker_turns: whether the output link can.
        margin: length of the two other links less that of shortest and longest, mm; positive
            where some link turns fully, 0 at a change point.
    """

    name: str
    crank_turns: bool
    rocker_turns: bool
    margin: float


def classify_grashof(crank: float, coupler: float, rocker: float, ground: float) -> Grashof:
    """The class of a four-bar with these lengths, mm.

    Source: F. Grashof, *Theoretische Maschinenlehre*, 1883: a link turns fully if the shortest
    and the longest are together no longer than the two others.

    Raises:
        ValueError: a length is not positive, or one is longer than the three others together.

    Example:
        >>> classify_grashof(40, 120, 80, 100).name
        'crank-rocker'
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    shortest, *middle, longest = sorted(lengths.values())
    if shortest <= 0:
        raise ValueError("the lengths of a four-bar are positive")
    if longest > shortest + sum(middle):
        raise ValueError(
            f"a four-bar cannot close: {longest:g} mm is longer than the others together"
        )
    margin = sum(middle) - shortest - longest
    tolerance = TOUCHING * longest
    if abs(margin) <= tolerance:
        name = "change-point"
    elif margin < 0:
        name = "non-Grashof"
    else:
        at = min(lengths, key=lengths.__getitem__)
        name = {
            "crank": "crank-rocker",
            "rocker": "rocker-crank",
            "ground": "double-crank",
            "coupler": "double-rocker",
        }[at]

    def turns(link: float, other: float) -> bool:
        # The dyad of the two others reaches the link's pin in its farthest and nearest place.
        reaches = coupler + other - (ground + link) >= -tolerance
        return bool(reaches and abs(ground - link) - abs(coupler - other) >= -tolerance)

    return Grashof(name, turns(crank, rocker), turns(rocker, crank), margin)
