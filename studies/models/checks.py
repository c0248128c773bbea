"""Requirements as lines: what is asked for, what is achieved, and the price of asking for it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from designopt.study.records import Records

ROUNDING = 1e-9
"""What a requirement may miss by rounding, in its unit."""


@dataclass(frozen=True)
class Check:
    """One requirement, as required and as achieved.

    Attributes:
        name: what is required.
        required: the limit.
        achieved: the worst value over all postures.
        unit: of both.
        at_least: whether the limit is a least value (else a greatest one).
    """

    name: str
    required: float
    achieved: float
    unit: str = "mm"
    at_least: bool = True

    @property
    def slack(self) -> float:
        """How far inside the limit, in its unit; negative where it is not met."""
        inside = self.achieved - self.required
        return inside if self.at_least else -inside

    @property
    def met(self) -> bool:
        """Whether it is met, but for rounding."""
        return self.slack >= -ROUNDING


def requirement_rows(checks: Iterable[Check], prices: Mapping[str, tuple[float, str]]) -> Records:
    """Every requirement with what was achieved, how far it is inside, and its price.

    Args:
        checks: the requirements.
        prices: by name, and per what; 0 for those that are not among them.
    """
    rows = Records()
    for one in checks:
        price, per = prices.get(one.name, (0.0, ""))
        rows.add(
            requirement=one.name,
            limit="at least" if one.at_least else "at most",
            required=one.required,
            achieved=one.achieved,
            margin=one.slack,
            unit=one.unit,
            price=price,
            per=per,
            met="yes" if one.met else "no",
        )
    return rows
