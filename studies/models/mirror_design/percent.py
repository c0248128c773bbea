"""Parts in percent, for sentences."""

from __future__ import annotations

import math


def percent_at_least(part: float) -> str:
    """A part in percent, rounded down: what is not all is not 100 %."""
    return f"{math.floor(1e4 * part) / 100:g} %"
