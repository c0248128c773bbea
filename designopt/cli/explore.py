"""The command ``designopt explore``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from designopt.cli.studies import ConfigFiles
from designopt.compilation_cache import NoCache, keep_programs
from designopt.errors import UserError
from designopt.interrupts import deferred, interruptible

if TYPE_CHECKING:
    from designopt.explore.bench import Bench

PORT = 8988


def explore(
    named: Annotated[
        str,
        typer.Argument(
            metavar="STUDY|FILE",
            help="A study, a linkage or scene file, or a folder that 'designopt run' wrote.",
        ),
    ],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change a study's setting; repeatable."),
    ] = None,
    config: ConfigFiles = None,
    web: Annotated[
        bool, typer.Option("--web", help="A page for a browser on this machine, not a window.")
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, help="Of the page; 0 takes any free one.", show_default=str(PORT)
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where pictures and specs are saved.")
    ] = Path("."),
    no_cache: NoCache = False,
) -> None:
    """Turn a design's joints and dimensions and watch what they do.

    Example:
      designopt explore four-bar.toml --web
    """
    if port is not None and not web:
        raise UserError(f"--port {port}: only a page has a port; add --web")
    with suppress(KeyboardInterrupt), interruptible():
        design = _designed(named, settings or [], config or [])
        _open(named, design, port=PORT if port is None else port, web=web, out=out)


def _open(
    named: str,
    design: AbstractContextManager[tuple[Bench, str]],
    *,
    port: int,
    web: bool,
    out: Path,
) -> None:
    from designopt.designs import check_design
    from designopt.io.files import check_new_folder

    check_new_folder(out, force=True)
    check_design(named)
    _load()
    from designopt.plot.figures import style

    # The place first: a design may take minutes to compute.
    if web:
        from designopt.explore.server import listen, serve

        with style(), listen(port) as listener, design as (bench, name):
            serve(bench, name, out, listener)
        return
    from designopt.explore.desktop import desktop_figure, show_window
    from designopt.explore.window import Window

    with style():
        figure = desktop_figure()
        with design as (bench, name):
            window = Window(bench, figure, name, out)
            show_window(figure, bench.title)
            del window  # until here: widgets live as long as someone holds them


def _load() -> None:
    """Load what is compiled: an interrupt in the middle of that may crash Python."""
    with deferred() as is_interrupted:
        keep_programs()
        import cv2  # noqa: F401
        import jax  # noqa: F401
        import matplotlib.figure  # noqa: F401
    if is_interrupted():
        raise KeyboardInterrupt


@contextmanager
def _designed(named: str, settings: list[str], configs: list[Path]) -> Iterator[tuple[Bench, str]]:
    """A design with its knobs, and its name; loaded on entering."""
    import jax

    from designopt.designs import load_design

    with jax.enable_x64(True):
        design = load_design(named, settings, configs)
        yield design.explorer(), design.name
