"""OpenBLAS on one thread, for run times that can be compared."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

MAPS = Path("/proc/self/maps")
PREFIXES = ("scipy_openblas", "openblas")
SUFFIXES = ("64_", "")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """OpenBLAS of NumPy and SciPy on one thread while the context lasts, where the system shows it.

    On one core (`designopt.study.benchmark.one_core`) its other threads spin in the way of the one
    that works: a solve of SciPy's L-BFGS-B in two unknowns then takes 0.2 s instead of 0.5 ms.
    """
    lines = MAPS.read_text().splitlines() if MAPS.exists() else []
    with ExitStack() as stack:
        for path in {line.split()[-1] for line in lines if "openblas" in line}:
            library = ctypes.CDLL(path)
            for name in (f"{a}_{{}}_num_threads{b}" for a in PREFIXES for b in SUFFIXES):
                if hasattr(library, name.format("set")):
                    change = getattr(library, name.format("set"))
                    stack.callback(change, getattr(library, name.format("get"))())
                    change(1)
        yield
