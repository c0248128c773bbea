"""The command ``designopt optimise``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from designopt.cli.studies import ConfigFiles, Force, Seed, Settings, summarize
from designopt.compilation_cache import NoCache, keep_programs

if TYPE_CHECKING:
    from designopt.optimize.parametric import ParametricDesign


def optimise(
    named: Annotated[
        str,
        typer.Argument(
            metavar="FILE|STUDY",
            help="A linkage, scene, chamber or finger file; a study that designs one; a folder "
            "that 'designopt run' wrote.",
        ),
    ],
    maximise: Annotated[
        str, typer.Option(metavar="MEASURE", help="Make its least value over all postures larger.")
    ] = "",
    minimise: Annotated[
        str, typer.Option(metavar="MEASURE", help="Make its greatest value smaller, instead.")
    ] = "",
    free: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[=LOW:HIGH]",
            help="A parameter that may change, or the beginning of several names; repeatable. By "
            "default those that the design frees.",
        ),
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MEASURE>=VALUE",
            help="A requirement beyond the design's own, such as 'mu.B>=40'; repeatable.",
        ),
    ] = None,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LOW:HIGH",
            help="Ends of a joint or an input between which the design is measured; repeatable.",
        ),
    ] = None,
    starts: Annotated[
        int, typer.Option(min=1, help="Searches: from the design as it is, and from random ones.")
    ] = 1,
    show: Annotated[
        bool, typer.Option("--list", help="List the design's parameters and measures, and end.")
    ] = False,
    settings: Settings = None,
    config: ConfigFiles = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Result folder.")] = Path("out/optimise"),
    seed: Seed = 0,
    force: Force = False,
    no_cache: NoCache = False,
) -> int:
    """Improve a design in one measure, within bounds, with all its requirements kept.

    Example:
      designopt optimise four-bar.toml --maximise min_transmission --free bodies.coupler.A-B=90:150
      --out better
    """
    from designopt.designs import check_design
    from designopt.io.files import check_new_folder
    from designopt.optimising.asked import Asked, parse_over

    # What is wrong in the command itself is refused before JAX is loaded.
    Asked.of(maximise, minimise, free or [], keep or [])
    ranges = parse_over(over or [])
    check_design(named)
    if not show:
        check_new_folder(out, force=force)
    keep_programs()
    if show:
        import jax

        from designopt.designs import load_design

        with jax.enable_x64(True):
            _list(load_design(named, settings or [], config or []).parametric(ranges))
        return 0
    from designopt.optimising.study import STUDY, OptimiseSpec
    from designopt.study.runner import run

    spec = OptimiseSpec(
        design=named,
        settings=settings or [],
        config=config or [],
        maximise=maximise,
        minimise=minimise,
        free=free or [],
        keep=keep or [],
        over=over or [],
        starts=starts,
    )
    return summarize(run(STUDY, spec, seed=seed, dtype="float64", out=out, force=force), out)


def _list(design: ParametricDesign) -> None:
    from designopt.optimize.parametric import amount_text, find_measure, free_parameters

    print(f"{design.title}: parameters (* those that are free by default)")
    free = free_parameters(design)
    for one in design.parameters:
        ends = f"{one.low:.6g} to {amount_text(one.high, one.unit)}"
        mark = "*" if one.name in free else " "
        print(f"  {mark} {one.name}  {amount_text(one.value, one.unit)}  ({ends})")
    print("measures")
    for one in design.measures:
        verb = "maximise" if one.worst == "least" else "minimise"
        unit = f" ({one.unit})" if one.unit else ""
        print(f"    {one.name}  {one.description}{unit}; --{verb}")
    if design.requirements:
        print("requirements of its own")
        for bound in design.requirements:
            unit = find_measure(design, bound.measure).unit
            value = amount_text(bound.value, unit)
            print(f"    {bound.label or bound.measure}: {bound.measure} {bound.relation} {value}")
