"""Pictures and specs saved from a window: numbered, whole, never over another file."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.errors import UserError
from designopt.io.files import replaced_when_complete
from designopt.io.spec import SpecFile

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_picture(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write ``NAME-N.png`` and ``NAME-N.svg`` with the first free N, and return their paths.

    The folder and those above it are made as needed.

    Raises:
        UserError: they cannot be written.
    """
    stem = re.sub(r"[^\w.]+", "-", name).strip("-.") or "picture"
    paths = numbered(folder, [f"{stem}.png", f"{stem}.svg"])
    with _all_or_none(paths) as (png, svg):
        figure.savefig(png)
        figure.savefig(svg, metadata={"Date": None})
    return paths


def save_specs(specs: Sequence[SpecFile], folder: Path) -> list[Path]:
    """Write files, all with the same first free number, and return their paths.

    The folder and those above it are made as needed.

    Raises:
        UserError: they cannot be written.
    """
    paths = numbered(folder, [spec.name for spec in specs])
    with _all_or_none(paths) as partials:
        for spec, partial in zip(specs, partials, strict=True):
            partial.write_bytes(spec.data)
    return paths


def numbered(folder: Path, names: Sequence[str]) -> list[Path]:
    """Paths ``folder/stem-N.ending`` of file names, with the first N that is free for all."""
    parts = [Path(name) for name in names]
    tried = (
        [folder / f"{part.stem}-{number}{part.suffix}" for part in parts]
        for number in itertools.count(1)
    )
    return next(paths for paths in tried if not any(map(os.path.lexists, paths)))


@contextmanager
def _all_or_none(paths: Sequence[Path]) -> Iterator[list[Path]]:
    folder = paths[0].parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"--out {folder}: cannot be made ({error.strerror}); name another"
        ) from error
    with ExitStack() as stack:
        yield [stack.enter_context(replaced_when_complete(path)) for path in paths]
