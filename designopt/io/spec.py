"""Base of what people write down: settings of studies, and design files."""

from __future__ import annotations

import pydantic


class Spec(pydantic.BaseModel):
    """Base of every spec read from a person: unknown keys are faults, numbers are finite."""

    model_config = pydantic.ConfigDict(
        extra="forbid", allow_inf_nan=False, frozen=True, validate_default=True
    )
