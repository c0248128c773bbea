"""How much a command writes to standard error: the logger ``designopt`` and its handler."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from designopt.errors import one_line

LOGGER = logging.getLogger("designopt")
PROGRESS = logging.getLogger("designopt.progress")

NOTE = 25
"""Level of what a command adds to its result, which is shown unless ``--quiet`` is given."""


class _Handler(logging.StreamHandler[Any]):
    """Writes to what standard error is at the time: a progress display replaces it."""

    def __init__(self) -> None:
        logging.Handler.__init__(self)

    @property
    def stream(self) -> Any:  # type: ignore[override]
        return sys.stderr

    def format(self, record: logging.LogRecord) -> str:
        text = super().format(record)
        indent = " " * (len(text) - len(text.lstrip(" ")))  # of what belongs to the line before
        prefix = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else indent
        return prefix + one_line(text)


@contextmanager
def logging_to_terminal() -> Iterator[None]:
    """Have the loggers of designopt write to standard error; loggers are as before on leaving."""
    before = LOGGER.level, PROGRESS.level
    handler = _Handler()
    LOGGER.addHandler(handler)
    set_verbosity()
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)
        LOGGER.setLevel(before[0])
        PROGRESS.setLevel(before[1])


def set_verbosity(verbose: int = 0, *, quiet: bool = False) -> None:
    """Set what is shown.

    Args:
        verbose: 0, warnings and, where standard error is no terminal, steps; 1, everything of level
            INFO; 2, what is compiled, too.
        quiet: nothing but errors, and the place of the result.
    """
    level = logging.ERROR if quiet else (NOTE, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    LOGGER.setLevel(level)
    is_piped = not sys.stderr.isatty()
    # A display on a terminal shows steps as they are done; a file needs lines.
    PROGRESS.setLevel(min(level, logging.INFO) if is_piped and not quiet else logging.NOTSET)


def is_quiet() -> bool:
    """Whether ``--quiet`` leaves nothing but errors and the place of the result."""
    return not LOGGER.isEnabledFor(logging.WARNING)


def is_verbose() -> bool:
    """Whether ``--verbose`` asks for more than the usual."""
    return LOGGER.isEnabledFor(logging.INFO)
