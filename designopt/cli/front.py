"""The command ``designopt front``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from designopt.cli.completion import complete_study
from designopt.cli.studies import ConfigFiles, Force, Seed, Settings, run_study
from designopt.compilation_cache import NoCache
from designopt.errors import UserError


def front(
    study: Annotated[
        str,
        typer.Argument(
            metavar="STUDY",
            help="A study that designs something: 'finger'.",
            autocompletion=complete_study,
        ),
    ],
    objectives: Annotated[
        str,
        typer.Option(metavar="A,B", help="What is traded; 'designopt list STUDY-front' has which."),
    ],
    settings: Settings = None,
    config: ConfigFiles = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Result folder.", show_default="out/STUDY-front"),
    ] = None,
    seed: Seed = 0,
    force: Force = False,
    no_cache: NoCache = False,
) -> int:
    """Design along a trade-off: each point is a design with its file.

    Example:
      designopt front finger --objectives transmission,clearance --out trade-off
    """
    from designopt.study.study import Study, installed_studies, load_study

    load_study(study)
    studies = [one for _, one in installed_studies() if isinstance(one, Study)]
    fronts = {one.front_of: one.name for one in studies if one.front_of}
    if study not in fronts:
        raise UserError(
            f"STUDY: '{study}' has no trade-offs to show; these have: {', '.join(sorted(fronts))}"
        )
    names = [name.strip() for name in objectives.split(",")]
    given = [*(settings or []), f"objectives={json.dumps(names)}"]
    return run_study(fronts[study], given, config, out, seed, force=force, no_cache=no_cache)
