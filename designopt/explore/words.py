"""How numbers of a bench are written, in the window and on the page alike."""

from __future__ import annotations

import math


def number_text(value: float | None) -> str:
    """A reading to six significant digits; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.6g}"
