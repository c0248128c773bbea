"""Files saved from the page: numbered, whole, never over another file."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
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
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"--out {folder}: cannot be made ({error.strerror}); name another"
        ) from error
    paths = _reserved(folder, [spec.name for spec in specs], FAILING if fails else "")
    comment = "# This design fails what it is asked for:\n" + "".join(
        f"# {printable(one)}\n" for one in fails
    )
    with _removed_on_failure(paths), ExitStack() as stack:
        for spec, path in zip(specs, paths, strict=True):
            if fails and isinstance(spec.content, str):
                spec = replace(spec, content=f"{comment}\n{spec.content}")
            stack.enter_context(replaced_when_complete(path)).write_bytes(spec.data)
    return paths


def _reserved(folder: Path, names: Sequence[str], mark: str) -> list[Path]:
    """Empty files ``folder/stem-N.ending``, made with the first N that is free for all."""
    while True:
        made: list[Path] = []
        try:
            with _removed_on_failure(made):
                for path in _numbered(folder, names, mark):
                    path.touch(exist_ok=False)
                    made.append(path)
            return made
        except FileExistsError:  # somebody else's, made just now
            continue
        except OSError as error:
            raise UserError(
                f"{error.filename}: cannot be written: {error.strerror}; choose another"
            ) from error


def _numbered(folder: Path, names: Sequence[str], mark: str) -> list[Path]:
    """Paths with the first number that no file has, be it marked as failing or not."""
    parts = [Path(name) for name in names]
    tried = (
        {
            one: [folder / f"{part.stem}-{number}{one}{part.suffix}" for part in parts]
            for one in ("", FAILING)
        }
        for number in itertools.count(1)
    )
    return next(
        paths[mark]
        for paths in tried
        if not any(map(os.path.lexists, itertools.chain(*paths.values())))
    )


@contextmanager
def _removed_on_failure(paths: Sequence[Path]) -> Iterator[None]:
    try:
        yield
    except BaseException:
        for path in paths:
            path.unlink(missing_ok=True)
        raise
