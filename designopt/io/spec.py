"""What people write down and commands read: the base of their specs, and files of results."""

from __future__ import annotations

from dataclasses import dataclass

import pydantic


class Spec(pydantic.BaseModel):
    """Base of every spec read from a person: unknown keys are faults, numbers are finite."""

    model_config = pydantic.ConfigDict(
        extra="forbid", allow_inf_nan=False, frozen=True, validate_default=True
    )


@dataclass(frozen=True)
class SpecFile:
    """A file that other commands read, written to ``specs/<name>``.

    Attributes:
        name: file name with its ending.
        title: what it is and what reads it, in one line, for the report.
        content: what stands in it: text, or bytes where a program reads it.
    """

    name: str
    title: str
    content: str | bytes

    @property
    def data(self) -> bytes:
        """What is written."""
        return self.content.encode() if isinstance(self.content, str) else self.content
