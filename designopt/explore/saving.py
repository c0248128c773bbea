"""Files saved from the page: numbered, whole, never over another file."""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from designopt.errors import UserError
from designopt.io.files import printable, replaced_when_complete
from designopt.io.spec import SpecFile


def save_specs(specs: Sequence[SpecFile], folder: Path, fails: Sequence[str] = ()) -> list[Path]:
    """Write files, all with the same first free number, and return their paths.

    The folder and those above it are made as needed.

    Args:
        specs: the files.
        folder: where.
        fails: the requirements that the design fails. If any, file names end in ``-failing``, and
            texts begin with a comment that lists them.

    Raises:
        UserError: they cannot be written; none is then.
    """
    paths = _numbered(folder, [spec.name for spec in specs], "-failing" if fails else "")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"--out {folder}: cannot be made ({error.strerror}); name another"
        ) from error
    comment = "# This design fails what it is asked for:\n" + "".join(
        f"# {printable(one)}\n" for one in fails
    )
    with ExitStack() as stack:
        for spec, path in zip(specs, paths, strict=True):
            if fails and isinstance(spec.content, str):
                spec = replace(spec, content=f"{comment}\n{spec.content}")
            stack.enter_context(replaced_when_complete(path)).write_bytes(spec.data)
    return paths


def _numbered(folder: Path, names: Sequence[str], mark: str) -> list[Path]:
    """Paths ``folder/stem-N.ending`` of file names, with the first N that is free for all."""
    parts = [Path(name) for name in names]
    tried = (
        [folder / f"{part.stem}-{number}{mark}{part.suffix}" for part in parts]
        for number in itertools.count(1)
    )
    return next(paths for paths in tried if not any(map(os.path.lexists, paths)))
