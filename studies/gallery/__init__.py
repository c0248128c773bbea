"""Linkages, scenes, a chamber and requirements of fingers to copy, also by ``designopt new``."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from functools import partial
from importlib.resources import files

from designopt.file_template import FileTemplate

FOLDERS = {
    "linkages": ("linkage", "designopt explore"),
    "scenes": ("scene", "designopt trace"),
    "chambers": ("chamber", "designopt explore"),
    "fingers": ("settings", "designopt run finger --config"),
}
"""What each folder has, and what takes it."""

NAMES = {"linkages/finger": "finger-joints", "scenes/finger": "scene"}
"""Names other than the file's: ``designopt new finger`` writes the settings of the study."""


def _templates() -> Iterator[FileTemplate]:
    for folder, (kind, command) in FOLDERS.items():
        for file in sorted((files(__name__) / folder).iterdir(), key=lambda file: file.name):
            stem, _, ending = file.name.rpartition(".")
            if ending == "toml":
                read = partial(file.read_text, encoding="utf-8")
                name = NAMES.get(f"{folder}/{stem}", stem)
                yield FileTemplate(name, f"{kind}: {_title(read())}", command, read)


def _title(text: str) -> str:
    """The first comment of a file, up to a colon, a semicolon or its end."""
    lines = itertools.takewhile(lambda line: line.startswith("#"), text.splitlines())
    comment = " ".join(line.removeprefix("#").strip() for line in lines)
    return re.split("[:;]", comment)[0].removesuffix(".")


TEMPLATES = tuple(_templates())
