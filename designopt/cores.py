"""The cores of the processor that this process may use."""

from __future__ import annotations

import os


def usable_cores() -> int:
    """How many there are: the affinity that the process was given counts, where there is one.

    Example:
        >>> usable_cores() >= 1
        True
    """
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1
