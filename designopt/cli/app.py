"""Plug-in commands under one roof."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Annotated, cast

import typer

from designopt import __version__
from designopt.compilation_cache import NoCache
from designopt.errors import UserError, reason_of

COMMAND_GROUP = "designopt.commands"

# Typer may carry its own copy of click; this reaches the base of its usage faults in either case.
_UsageError = cast("type[typer.BadParameter]", typer.BadParameter.__base__)


def invoke(arguments: list[str], check: Callable[[], None]) -> int:
    """Run one command; without arguments it is ``--help``.

    Args:
        arguments: of the command line.
        check: see `interruptible`; called where a command cannot be loaded.

    Returns:
        What the command returned: its exit code.

    Raises:
        UserError: there is no such command, or it is called otherwise.
    """
    command = typer.main.get_command(_app(check))
    try:
        # By Typer's own way of starting it a closed pipe and an interrupt would be exit codes.
        with command.make_context("designopt", list(arguments) or ["--help"]) as context:
            return command.invoke(context) or 0
    except typer.Exit as end:
        return end.exit_code
    except _UsageError as error:
        raise UserError(
            f"{error.format_message()} ('designopt --help' shows how to call it)"
        ) from error


def _app(check: Callable[[], None]) -> typer.Typer:
    app = typer.Typer(
        help="Design robot fingers that feel with a camera.",
        add_completion=False,
        rich_markup_mode=None,
    )
    app.callback()(_root)
    for point in sorted(entry_points(group=COMMAND_GROUP), key=lambda point: point.name):
        try:
            command = point.load()
        except Exception as error:  # a plug-in is anyone's code; the other commands must not suffer
            check()
            warning = f"command '{point.name}' cannot be loaded: {reason_of(error)}"
            print(f"warning: {warning}", file=sys.stderr)
            continue
        if isinstance(command, typer.Typer):
            for part in command.registered_commands:
                part.help = _help(cast("Callable[..., object]", part.callback))
            app.add_typer(command, name=point.name)
        else:
            app.command(point.name, help=_help(command))(command)
    return app


def _help(command: Callable[..., object]) -> str:
    """A command's docstring, whose example keeps its lines."""
    # A line with \b alone keeps Click from filling the paragraph after it.
    return inspect.cleandoc(command.__doc__ or "").replace("Example:\n", "\b\nExample:\n")


def _show_version(wanted: bool) -> bool:
    if wanted:
        print(f"designopt {__version__}")
        raise typer.Exit
    return wanted


def _root(
    show_version: Annotated[
        bool,
        typer.Option(
            "--version", help="Show the version and exit.", is_eager=True, callback=_show_version
        ),
    ] = False,
    no_cache: NoCache = False,
) -> None:
    if "MPLBACKEND" in os.environ:
        _check_backend()


def _check_backend() -> None:
    """Refuse a backend that Matplotlib would refuse later, when something is to be drawn."""
    try:
        import matplotlib  # noqa: F401
    except ValueError as error:
        backend = os.environ["MPLBACKEND"]
        raise UserError(
            f"MPLBACKEND={backend}: Matplotlib has no such backend; unset it"
        ) from error
