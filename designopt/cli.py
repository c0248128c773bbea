"""The ``designopt`` command: plug-in commands under one roof, faults in one line."""

from __future__ import annotations

import inspect
import io
import os
import sys
from collections.abc import Callable
from importlib.metadata import entry_points, version
from typing import Annotated, cast

import typer

from designopt.compilation_cache import NoCache
from designopt.errors import Interrupted, UserError
from designopt.interrupts import leave

COMMAND_GROUP = "designopt.commands"

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it (128 + SIGINT)."""

# Typer may carry its own copy of click; this reaches the base of its usage faults in either case.
_UsageError = cast("type[typer.BadParameter]", typer.BadParameter.__base__)


def main() -> None:
    """Run the command line; the console script's entry point."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek letters is no fault
    try:
        code = run(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    leave(code)


def run(arguments: list[str]) -> int:
    """Run one command.

    Returns:
        0 when all went well, 1 when a target was missed, 2 for a fault in what was asked for,
        which is printed as one line, 130 when interrupted.
    """
    try:
        code = typer.main.get_command(_app())(
            arguments or ["--help"], prog_name="designopt", standalone_mode=False
        )
    except UserError as error:
        return _fault(str(error))
    except _UsageError as error:
        return _fault(f"{error.format_message()} ('designopt --help' shows how to call it)")
    except Interrupted as end:
        print(f"interrupted; {end}", file=sys.stderr)
        return INTERRUPTED
    except KeyboardInterrupt:  # before Typer was there to catch it
        code = INTERRUPTED
    if code == INTERRUPTED:  # Typer, which turns an interrupt into this code, says nothing
        print("interrupted; nothing was written", file=sys.stderr)
    return code or 0


def _app() -> typer.Typer:
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
            print(f"warning: command '{point.name}' cannot be loaded: {error}", file=sys.stderr)
            continue
        app.command(point.name, help=_help(command))(command)
    return app


def _help(command: Callable[..., object]) -> str:
    """A command's docstring, whose example keeps its lines."""
    # A line with \b alone keeps Click from filling the paragraph after it.
    return inspect.cleandoc(command.__doc__ or "").replace("Example:\n", "\b\nExample:\n")


def _show_version(wanted: bool) -> bool:
    if wanted:
        print(f"designopt {version('designopt')}")
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


def _fault(message: str) -> int:
    print("error: " + " ".join(message.split()), file=sys.stderr)
    return 2
