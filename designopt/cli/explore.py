"""The command ``designopt explore``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from designopt.cli.completion import complete_design, complete_setting
from designopt.cli.studies import ConfigFiles
from designopt.compilation_cache import NoCache, keep_programs
from designopt.interrupts import deferred, interruptible

if TYPE_CHECKING:
    from designopt.explore.explorer import Explorer

PORT = 8988


def explore(
    named: Annotated[
        str,
        typer.Argument(
            metavar="STUDY|FILE",
            help="A study, a linkage, scene, chamber or finger file, or a folder that "
            "'designopt run' wrote.",
            autocompletion=complete_design,
        ),
    ],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change a study's setting; repeatable.",
            autocompletion=complete_setting,
        ),
    ] = None,
    config: ConfigFiles = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Of the page; 0 takes any free one.")
    ] = PORT,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where files are saved.")] = Path("."),
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the page's address and open no browser.")
    ] = False,
    no_cache: NoCache = False,
) -> None:
    """Turn a design's joints and dimensions on a page, watch what they do, optimise, save.

    Example:
      designopt explore four-bar.toml
    """
    with suppress(KeyboardInterrupt), interruptible():
        _check(named, out)
        from designopt.explore.server import listen, serve

        # The port first: a design may take minutes to compute.
        with listen(port) as listener, _loaded(named, settings or [], config or []) as explorer:
            serve(explorer, out, listener, browser=not no_browser)


def _check(named: str, out: Path) -> None:
    from designopt.designs import check_design
    from designopt.io.files import check_new_folder

    check_new_folder(out, force=True)
    check_design(named)
    _load()


def _load() -> None:
    """Load what is compiled: an interrupt in the middle of that may crash Python."""
    with deferred() as is_interrupted:
        keep_programs()
        import jax

        # A move runs a few programs of a millisecond: to hand them to another thread and to wait
        # for it takes as long, where a browser needs the cores as well.
        jax.config.update("jax_cpu_enable_async_dispatch", False)
    if is_interrupted():
        raise KeyboardInterrupt


@contextmanager
def _loaded(named: str, settings: list[str], configs: list[Path]) -> Iterator[Explorer]:
    """What turns a design; loaded on entering, with JAX in float64 until left."""
    import jax

    from designopt.designs import load_design

    with jax.enable_x64(True):
        yield load_design(named, settings, configs).explorer()
