"""Where designopt keeps files of its own for a user (the XDG Base Directory Specification)."""

from __future__ import annotations

import os
from pathlib import Path

from designopt.errors import UserError


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


def cache_folder(named: str, name: str) -> Path:
    """The folder of what a study keeps for its next run, which is made where there is none.

    Args:
        named: by the setting ``cache``; empty for that of the name in the user's cache.
        name: of the study.

    Raises:
        UserError: it cannot be made.
    """
    try:
        folder = Path(named or user_folder("XDG_CACHE_HOME", ".cache") / name)
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError) as error:
        raise UserError(f"--set cache={named}: it cannot be made: {error}") from error
    return folder
