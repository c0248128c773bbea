"""The command ``designopt sweep``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from designopt.cli.completion import complete_setting
from designopt.cli.studies import ConfigFiles, Dtype, StudyName, print_report_path
from designopt.compilation_cache import NoCache, keep_programs
from designopt.cores import usable_cores
from designopt.errors import UserError

MOST_SHOWN = 20
"""Failed points that are listed on the terminal; all of them are in the table."""


def sweep(
    study: StudyName,
    ranges: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=RANGE",
            help="More settings, written as after the one --vary, or the bounds of --sobol.",
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=START:STOP:COUNT",
            help="Values of a setting, both ends included, or KEY=VALUE,VALUE,…; may be repeated: "
            "all combinations, the last setting changing fastest.",
            autocompletion=complete_setting,
        ),
    ] = None,
    sobol: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="So many Sobol points between bounds, best a power of two; such as "
            "--sobol 8 clearance=1:2 blur=0.001:0.01.",
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="A setting of all points; may be repeated.",
            autocompletion=complete_setting,
        ),
    ] = None,
    config: ConfigFiles = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of every random draw and of the Sobol points.")
    ] = 0,
    dtype: Annotated[Dtype, typer.Option(help="Float type to compute in.")] = Dtype.float64,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="The sweep's folder.", show_default="out/sweep-STUDY"),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes on this machine.", show_default="one per core"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT",
            help="Compute on the cluster of this dask scheduler; its workers best have one thread "
            "each, as a process computes one point at a time.",
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace another sweep in the folder.")
    ] = False,
    no_cache: NoCache = False,
) -> int:
    """Run a study over a grid of settings, or over Sobol points.

    Every finished point is kept in DIR at once. The same command given again goes on where it
    stopped, and what it finds is the same to the bit on machines of one kind; points that failed
    for other reasons than their settings are tried once more. Tables, figures and a report are in
    DIR/result. Exit code 0: every point has an answer. 1: the result is written, and some points
    failed. 2: something in the command was wrong, or the cluster failed. 130: interrupted.

    Example:
      designopt sweep table1 --vary clearance=1:2:3 --set precision=false --set stability=false
    """
    # Imported here, so that listing the commands loads neither JAX nor Matplotlib.
    from designopt.interrupts import interruptible
    from designopt.study.settings_file import read_config
    from designopt.study.study import load_study

    chosen = load_study(study)
    given = read_config(config or [], chosen)
    from designopt.sweep.points import Sweep, grid_points, sobol_points

    vary, ranges, shared = vary or [], ranges or [], tuple(settings or ())
    if bool(vary) == (sobol is not None):
        raise UserError("--vary, --sobol: write one of them, to say what is varied")
    if len(vary) > 1 and ranges:
        raise UserError(f"{ranges[0]}: write --vary before it, as before the others")
    if scheduler is not None and workers is not None:
        raise UserError(f"--workers {workers}: a cluster has its own; leave it or --scheduler out")
    if sobol is None:
        points = grid_points(chosen.spec, [*vary, *ranges])
    else:
        points = sobol_points(chosen.spec, sobol, ranges, seed)
    for text in shared:
        if (key := text.partition("=")[0].strip()) in points.keys:
            raise UserError(f"--set {text}: '{key}' is varied; leave one of them out")

    # Code that is loaded may swallow an interrupt.
    with interruptible() as check:
        keep_programs()
        from designopt.sweep.running import run_sweep, versions_of

        check()
    folder = out if out is not None else Path("out") / f"sweep-{study}"
    asked = Sweep(chosen, points, shared, seed, dtype.value, versions_of(study), given)
    cores = workers or usable_cores()
    outcomes = run_sweep(asked, folder, workers=cores, scheduler=scheduler, force=force)
    print_report_path(folder / "result")
    failures = {index: one.failure for index, one in outcomes.items() if one.failure}
    if not failures:
        return 0
    print(f"failed: {len(failures)} of {len(points)} points", file=sys.stderr)
    for index in sorted(failures)[:MOST_SHOWN]:
        print(f"  {', '.join(points.assignments(index))}: {failures[index]}", file=sys.stderr)
    if len(failures) > MOST_SHOWN:
        print(f"  … all in {folder / 'result' / 'tables' / 'failed.csv'}", file=sys.stderr)
    return 1
