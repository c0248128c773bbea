"""The command ``designopt new``."""

from __future__ import annotations

import os
import shlex
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from designopt.cli.completion import complete_setting, complete_template
from designopt.cli.verbosity import is_quiet
from designopt.errors import UserError

if TYPE_CHECKING:
    from designopt.file_template import FileTemplate


def new(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            help="A study, or another name of --list.",
            autocompletion=complete_template,
        ),
    ] = None,
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="FILE", help="Where to; - is standard output.", show_default="NAME.toml"
        ),
    ] = None,
    listing: Annotated[
        bool, typer.Option("--list", help="List all names, and what takes the files.")
    ] = False,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="One of its settings; may be given often.",
            autocompletion=complete_setting,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Write a commented file to begin with: a study's settings, a linkage, a scene, a board.

    Example:
      designopt new finger my-finger.toml
    """
    from designopt.file_template import installed_templates, load_template
    from designopt.io.files import check_targets, printable, replaced_when_complete

    if listing:
        if name is not None:
            raise UserError(f"--list: it writes no file; leave it or '{name}' out")
        _print_names(list(installed_templates()))
        return
    if name is None:
        raise UserError("NAME: what is the file to be? 'designopt new --list' shows the names")
    template = load_template(name)
    given = template.given(settings or [])
    if file == "-":
        sys.stdout.write(template.content(*given))
        return
    target = f"{name}.toml" if file is None else file
    stem, _ = os.path.splitext(target)
    beside = {ending: f"{stem}{ending}" for ending in template.prints}
    check_targets(
        {"FILE": target} | {f"its {ending}": path for ending, path in beside.items()}, force=force
    )
    with ExitStack() as all_or_none:

        def write(path: str, data: bytes) -> None:
            all_or_none.enter_context(replaced_when_complete(Path(path))).write_bytes(data)

        write(target, template.content(*given).encode())
        for ending, path in beside.items():
            write(path, template.prints[ending](*given))
    for path in (target, *beside.values()):
        print(printable(path))
    if not is_quiet():
        print(f"next: {template.command} {printable(shlex.quote(target))}")


def _print_names(found: list[tuple[str, FileTemplate | UserError]]) -> None:
    width = max((len(name) for name, _ in found), default=0)
    for name, template in found:
        if isinstance(template, UserError):
            print(f"{name:{width}}  ({template})")
        else:
            print(f"{name:{width}}  {template.purpose} ({template.command} FILE)")
