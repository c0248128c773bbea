"""When a worker forgets what JAX has compiled."""

from __future__ import annotations

import functools

import jax
from jax import monitoring

COMPILING = "/jax/core/compile/"
"""How JAX's events begin that are parts of compiling."""

MOST = 10.0
"""Times as long as for the first task: so much compiling for later ones is kept."""


class Compiled:
    """What JAX has compiled for the points of a process, and forgets from time to time.

    A study that compiles its settings into its programs leaves tens of megabytes per point behind;
    one whose points share their programs must keep them. So they are forgotten when compiling for
    later tasks has taken `MOST` times as long as for the first one, which is what it costs to
    begin again: a tenth at most.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self._first: float | None = None
        self._later = 0.0
        monitoring.register_event_duration_secs_listener(self._listen)

    def task_is_done(self) -> None:
        """Tell that what was compiled since the last call was for one task."""
        if self._first is None:
            self._first = self._now
        else:
            self._later += self._now
            if self._later > MOST * self._first:
                jax.clear_caches()
                self._first, self._later = None, 0.0
        self._now = 0.0

    def _listen(self, event: str, duration_secs: float, **_: object) -> None:
        if event.startswith(COMPILING):
            self._now += duration_secs


@functools.cache
def compiled() -> Compiled:
    """That of this process."""
    return Compiled()
