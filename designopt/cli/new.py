"""The command ``designopt new``."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from designopt.errors import UserError

if TYPE_CHECKING:
    from designopt.file_template import FileTemplate


def new(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="A study, or another name of --list.")
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
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write a commented file to begin with: a study's settings, a linkage, a scene.

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
    if file == "-":
        sys.stdout.write(template.content())
        return
    target = f"{name}.toml" if file is None else file
    check_targets({"FILE": target}, force=force)
    with replaced_when_complete(Path(target)) as partial:
        partial.write_text(template.content(), encoding="utf-8")
    print(printable(target))
    print(f"next: {template.command} {printable(shlex.quote(target))}")


def _print_names(found: list[tuple[str, FileTemplate | UserError]]) -> None:
    width = max((len(name) for name, _ in found), default=0)
    for name, template in found:
        if isinstance(template, UserError):
            print(f"{name:{width}}  ({template})")
        else:
            print(f"{name:{width}}  {template.purpose} ({template.command} FILE)")
