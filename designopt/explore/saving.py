"""Files saved from the page: numbered, whole, never over another file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from designopt.errors import UserError
from designopt.io.files import printable, replaced_when_complete
from designopt.io.spec import SpecFile

FAILING = "-failing"


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
    names, mark = [Path(spec.name) for spec in specs], FAILING if fails else ""
    comment = "# This design fails what it is asked for:\n" + "".join(
        f"# {printable(one)}\n" for one in fails
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths = _reserved(folder, names, mark)
    except OSError as error:
        raise UserError(
            f"{error.filename}: cannot be written: {error.strerror}; name another --out"
        ) from error
    with _removed_on_failure(paths), ExitStack() as stack:
        for spec, path in zip(specs, paths, strict=True):
            if fails and isinstance(spec.content, str):
                spec = replace(spec, content=f"{comment}\n{spec.content}")
            stack.enter_context(replaced_when_complete(path)).write_bytes(spec.data)
    return paths


def _reserved(folder: Path, names: Sequence[Path], mark: str) -> list[Path]:
    """Empty files ``folder/stem-N.ending``, with the first N that is free, marked or not."""
    number = 0
    while True:
        number += 1
        paths, others = (
            [folder / f"{name.stem}-{number}{one}{name.suffix}" for name in names]
            for one in (mark, "" if mark else FAILING)
        )
        if any(map(os.path.lexists, paths + others)):
            continue
        made: list[Path] = []
        with suppress(FileExistsError), _removed_on_failure(made):  # another's, made just now
            for path in paths:
                path.touch(exist_ok=False)
                made.append(path)
            return made


@contextmanager
def _removed_on_failure(paths: Sequence[Path]) -> Iterator[None]:
    try:
        yield
    except BaseException:
        for path in paths:
            path.unlink(missing_ok=True)
        raise
