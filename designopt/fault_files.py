"""Tracebacks of faults of the program, in files for whoever mends them."""

from __future__ import annotations

import os
import platform
import shlex
import sys
import tempfile
import time
import traceback
from functools import partial
from importlib.metadata import version
from pathlib import Path

from designopt.user_folders import user_folder

DEEPEST = 40
"""Calls of a traceback in one line, at most; those in the middle are left out."""


def kept_traceback(error: BaseException) -> Path | None:
    """Write a new file with an exception's traceback.

    Returns:
        The file, in the user's folder for such or, if that cannot be written, in the one for
        temporary files; ``None`` where neither can be.
    """
    python = f"designopt {version('designopt')}, Python {sys.version}\n{platform.platform()}"
    calls = "".join(traceback.format_exception(error))
    text = f"{python}\n{shlex.join(sys.argv)}\n\n{calls}"
    for folder in (partial(user_folder, "XDG_STATE_HOME", ".local/state"), tempfile.gettempdir):
        try:
            place = Path(folder())
            place.mkdir(parents=True, exist_ok=True)
            number, name = tempfile.mkstemp(".txt", time.strftime("fault-%Y%m%d-%H%M%S-"), place)
            with os.fdopen(number, "w", encoding="utf-8", errors="backslashreplace") as file:
                file.write(text)
        except (OSError, RuntimeError):  # a person without a home folder is a RuntimeError
            continue
        return Path(name)
    return None


def short_traceback(error: BaseException) -> str:
    """An exception's traceback in one line, from the call that raised it outwards."""
    calls = [
        f"{os.path.basename(call.filename)}:{call.lineno} {call.name}"
        for call in reversed(traceback.extract_tb(error.__traceback__))
    ]
    if len(calls) > DEEPEST:
        calls[DEEPEST // 2 : -DEEPEST // 2] = ["…"]
    return " < ".join(calls)
