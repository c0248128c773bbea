"""The commands ``designopt list`` and ``designopt run``."""

from __future__ import annotations

import math
import shutil
import sys
import textwrap
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from designopt.cli.completion import complete_setting, complete_study, complete_toml
from designopt.cli.verbosity import is_quiet, is_verbose
from designopt.compilation_cache import NoCache, keep_programs
from designopt.errors import UserError

if TYPE_CHECKING:
    from rich.table import Table

    from designopt.study.results import Metric, Results
    from designopt.study.study import Study


class Dtype(StrEnum):
    """Float types a study can run in."""

    float64 = "float64"
    float32 = "float32"


StudyName = Annotated[
    str,
    typer.Argument(
        metavar="STUDY", help="Its name; see 'designopt list'.", autocompletion=complete_study
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a setting; may be repeated.",
        autocompletion=complete_setting,
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of every random draw.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result.")]

MOST_FINDINGS = 8
"""Findings that are printed; the most important ones come first, and the report has all."""

ConfigFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Settings of the study, as 'designopt new STUDY' writes them, or the results.json of "
        "an earlier run; --set lies over them.",
        autocompletion=complete_toml,
    ),
]
"""An option of commands that take a study; see `read_config`, which takes one file."""


def list_studies(
    study: Annotated[
        str | None,
        typer.Argument(
            metavar="[STUDY]", help="Show this study's settings.", autocompletion=complete_study
        ),
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
    study: StudyName,
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


def print_report_path(folder: Path) -> None:
    """Print where the report of a result is; ``--quiet`` leaves the path alone."""
    print(f"{'' if is_quiet() else 'report: '}{folder / 'report.html'}")


def summarize(results: Results, folder: Path) -> int:
    """Print what a run found and where it is, and return the exit code."""
    if not is_quiet():
        for number, finding in enumerate(results.findings[:MOST_FINDINGS], 1):
            _print_wrapped(finding, f"{number:2}. ")
        if (others := len(results.findings) - MOST_FINDINGS) > 0:
            print(f"    {others} more in the report.")
        if is_verbose():
            _print_metrics(results)
        if results.waived:
            _print_wrapped(f"Targets of the default settings do not apply: {results.waived}.")
        elif met := sum(metric.met is True for metric in results.metrics):
            print(f"{met} of {met + len(results.unmet)} targets are met.")
    print_report_path(folder)
    if not results.unmet:
        return 0
    print(f"targets missed: {'; '.join(_missed_in_words(results.metrics))}", file=sys.stderr)
    return 1


def _missed_in_words(metrics: Sequence[Metric]) -> Iterator[str]:
    """Missed targets, such as ``least coverage of any pad: 0.93, asked for 1``.

    A description may refer to an earlier one as "the same", which then stands beside it.
    """
    meant = ""
    for metric in metrics:
        words = metric.description
        if "the same" in words:
            words += f" ({meant})"
        else:
            meant = words
        if metric.met is False:
            value = f"{metric.value:.4g}" if math.isfinite(metric.value) else "not found"
            unit = f" {metric.unit}" if metric.unit else ""
            yield f"{words}: {value}{unit}, asked for {metric.target}{unit}"


def _print_metrics(results: Results) -> None:
    from rich import box
    from rich.table import Table

    table = Table("metric", "value", "unit", "target", "", box=box.SIMPLE_HEAD)
    for metric in results.metrics:
        verdict = {True: "met", False: "missed", None: ""}[metric.met]
        value = f"{metric.value:.6g}" if math.isfinite(metric.value) else "none"
        table.add_row(metric.description, value, metric.unit, str(metric.target or ""), verdict)
    _print(table)


def _print_wrapped(text: str, first: str = "") -> None:
    """Print a paragraph as wide as the terminal, its further lines below its beginning."""
    width = shutil.get_terminal_size().columns
    print(textwrap.fill(text, width, initial_indent=first, subsequent_indent=" " * len(first)))


def _print(table: Table, least: int = 0) -> None:
    """Print a table as wide as the terminal, but at least so many columns."""
    from rich.console import Console

    console = Console(markup=False, highlight=False)
    console.width = max(console.width, least)
    # Rich itself ends the process with exit code 1 where a pipe is closed.
    with console.capture() as text:
        console.print(table)
    sys.stdout.write(text.get())
