"""Checksums of files and of JSON documents, by which they are known to be as they were written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

CHECKSUM = "checksum"


def file_checksum(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def with_checksum(document: Mapping[str, Any]) -> dict[str, Any]:
    """A document with a last entry ``"checksum"``, over all of the others.

    It is the SHA-256 of the other entries as JSON in UTF-8, with sorted keys, without blanks and
    without escapes of characters that need none.

    Raises:
        ValueError: a number is not finite.
    """
    return {**document, CHECKSUM: _checksum(document)}


def checksum_holds(document: Mapping[str, Any], *, required: bool = True) -> bool:
    """Whether a document has the checksum of what it holds.

    Args:
        document: as `with_checksum` made it.
        required: whether one without a checksum, as older versions wrote them, fails.
    """
    if CHECKSUM not in document:
        return not required
    rest = {key: value for key, value in document.items() if key != CHECKSUM}
    try:
        return document[CHECKSUM] == _checksum(rest)
    except ValueError:  # JSON that Python reads may hold NaN
        return False


def _checksum(document: Mapping[str, Any]) -> str:
    text = json.dumps(
        document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
