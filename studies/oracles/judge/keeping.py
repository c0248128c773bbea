"""Arrays that take long to be computed, kept in files."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np


def kept_arrays(
    folder: Path, key: bytes, make: Callable[[], Mapping[str, Any]]
) -> Mapping[str, np.ndarray]:
    """Arrays by name, as they were computed before for a key, or computed now and kept.

    Args:
        folder: of the files, one for each key.
        key: all that the arrays follow from.
        make: what computes them.
    """
    path = folder / f"{hashlib.sha256(key).hexdigest()}.npz"
    # There may be none, or not what was written: that fails in many ways (zlib, zipfile, NumPy).
    with suppress(Exception), path.open("rb") as file, np.load(file) as kept:
        return dict(kept)
    made: dict[str, Any] = {name: np.asarray(array) for name, array in make().items()}
    with tempfile.NamedTemporaryFile(dir=folder, suffix=".npz", delete=False) as file:
        np.savez_compressed(file, **made)
    os.replace(file.name, path)
    return made
