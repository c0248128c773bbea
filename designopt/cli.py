"""The ``designopt`` command: plug-in commands under one roof, faults in one line."""

from __future__ import annotations

import sys
from importlib.metadata import entry_points
from typing import Annotated

import typer

from designopt.errors import UserError

COMMAND_GROUP = "designopt.commands"

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it (128 + SIGINT)."""

# Typer may carry its own copy of click; this reaches the base of its usage faults in either case.
_UsageError = typer.BadParameter.__base__ or typer.BadParameter


def main() -> None:
    """Run the command line; the console script's entry point."""
    sys.exit(run(sys.argv[1:]))


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
    except (KeyboardInterrupt, typer.Abort):
        print("interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
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
        app.command(point.name)(command)
    return app


def _root(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", is_eager=True)
    ] = False,
) -> None:
    if version:
        from importlib.metadata import version as installed

        print(f"designopt {installed('designopt')}")
        raise typer.Exit


def _fault(message: str) -> int:
    print("error: " + " ".join(message.split()), file=sys.stderr)
    return 2
