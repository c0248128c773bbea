"""The commands ``designopt list`` and ``designopt run``."""

from __future__ import annotations

import math
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from designopt.compilation_cache import NoCache, keep_programs
from designopt.errors import UserError

if TYPE_CHECKING:
    from rich.table import Table

    from designopt.study.results import Results
    from designopt.study.study import Study


class Dtype(StrEnum):
    """Float types a study can run in."""

    float64 = "float64"
    float32 = "float32"


Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a setting; may be repeated."),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of every random draw.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result.")]

ConfigFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Settings of the study, as 'designopt new STUDY' writes them, or the results.json of "
        "an earlier run; --set lies over them.",
    ),
]
"""An option of commands that take a study; see `read_config`, which takes one file."""


def list_studies(
    study: Annotated[
        str | None, typer.Argument(metavar="[STUDY]", help="Show this study's settings.")
    ] = None,
) -> None:
    """List the studies, or the settings of one.

    Example:
      designopt list table1
    """
    from designopt.study.study import installed_studies, load_study

    if study is not None:
        _print_settings(load_study(study))
        return
    from designopt.study.settings import fields

    for name, entry in installed_studies():
        if isinstance(entry, UserError):
            print(f"{name}  ({entry})")
            continue
        print(f"{name}  {entry.purpose}")
        print(f"  needs: {', '.join(entry.needs) or 'nothing beyond the package'}")
        print(f"  settings: {', '.join(key for key, _, _ in fields(entry.spec))}")


def run_study(
    study: Annotated[str, typer.Argument(metavar="STUDY", help="Its name; see 'designopt list'.")],
    settings: Settings = None,
    config: ConfigFiles = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Result folder.", show_default="out/STUDY")
    ] = None,
    seed: Seed = 0,
    dtype: Annotated[Dtype, typer.Option(help="Float type to compute in.")] = Dtype.float64,
    force: Force = False,
    no_cache: NoCache = False,
) -> int:
    """Run a study into a folder of results.

    Example:
      designopt run table1 --set precision=false --set stability=false --out quick
    """
    from designopt.io.files import check_new_folder
    from designopt.study.settings import spec_with
    from designopt.study.settings_file import read_config
    from designopt.study.study import load_study

    chosen = load_study(study)
    given = read_config(config or [], chosen)
    spec = spec_with(chosen.spec, settings or [], study=study, config=given)
    folder = out if out is not None else Path("out") / study
    check_new_folder(folder, force=force)
    # Only now, when all that was asked for is in order, are JAX and the rest worth loading.
    keep_programs()
    from designopt.study.runner import run

    results = run(chosen, spec, seed=seed, dtype=dtype.value, out=folder, force=force)
    return summarize(results, folder)


def _print_settings(study: Study) -> None:
    from pydantic_core import PydanticUndefined
    from rich import box
    from rich.table import Table

    from designopt.study.settings import fields

    rows = [
        (key, "must be given" if default is PydanticUndefined else str(default), meaning)
        for key, default, meaning in fields(study.spec)
    ]
    print(f"{study.name}: {study.purpose}")
    table = Table(box=box.SIMPLE_HEAD)
    # A key is copied into a command, so that it stands whole in one line.
    longest = max((len(key) for key, _, _ in rows), default=0)
    table.add_column("key", no_wrap=True, min_width=longest)
    table.add_column("default", max_width=20, overflow="fold")
    table.add_column("meaning", min_width=18, overflow="fold")
    for row in rows:
        table.add_row(*row)
    _print(table, least=longest + 46)


def summarize(results: Results, folder: Path) -> int:
    """Print what a run found and where it is, and return the exit code."""
    from rich import box
    from rich.table import Table

    table = Table("metric", "value", "unit", "target", "", box=box.SIMPLE_HEAD)
    for metric in results.metrics:
        verdict = {True: "met", False: "MISSED", None: ""}[metric.met]
        value = f"{metric.value:.6g}" if math.isfinite(metric.value) else "none"
        table.add_row(metric.name, value, metric.unit, str(metric.target or ""), verdict)
    _print(table)
    if results.waived:
        print(f"targets of the default settings do not apply: {results.waived}")
    print(f"report: {folder / 'report.html'}")
    if not results.unmet:
        return 0
    names = ", ".join(metric.name for metric in results.unmet)
    print(f"targets missed: {names}", file=sys.stderr)
    return 1


def _print(table: Table, least: int = 0) -> None:
    """Print a table as wide as the terminal, but at least so many columns."""
    from rich.console import Console

    console = Console(markup=False, highlight=False)
    console.width = max(console.width, least)
    # Rich itself ends the process with exit code 1 where a pipe is closed.
    with console.capture() as text:
        console.print(table)
    sys.stdout.write(text.get())
