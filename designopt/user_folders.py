"""Where designopt keeps files of its own for a user (the XDG Base Directory Specification)."""

from __future__ import annotations

import os
from pathlib import Path


def user_folder(variable: str, usual: str) -> Path:
    """A folder for files of one kind, which may not be there yet.

    Args:
        variable: of the environment, such as ``"XDG_CACHE_HOME"``; used where it is an absolute
            path, as the specification has it.
        usual: the place used otherwise, from the user's home folder.

    Raises:
        RuntimeError: it is in the home folder, and the user has none.
    """
    named = Path(os.environ.get(variable, ""))
    return (named if named.is_absolute() else Path.home() / usual) / "designopt"
