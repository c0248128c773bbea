"""The path tracer that judges, for the studies that need it."""

from __future__ import annotations

from typing import Any

from designopt.errors import UserError
from studies.oracles.judge.engine import load_mitsuba


def require_mitsuba(study: str) -> Any:
    """Mitsuba, in its best variant on this machine.

    Args:
        study: that needs it.

    Raises:
        UserError: it is not installed.
    """
    try:
        return load_mitsuba()
    except ModuleNotFoundError as error:
        raise UserError(
            f"{study}: the package mitsuba is missing; install it: pip install 'designopt[judge]'"
        ) from error
