"""A file made for the other commands to read."""

from __future__ import annotations

from dataclasses import dataclass


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
