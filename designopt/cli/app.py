"""Plug-in commands under one roof."""

from __future__ import annotations

import copy
import inspect
import logging
import os
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated, Any, cast

import typer

from designopt import __version__
from designopt.cli.verbosity import logging_to_terminal, set_verbosity
from designopt.compilation_cache import NoCache
from designopt.errors import UserError, reason_of
from designopt.installation import PACKAGES, find_clashes

COMMAND_GROUP = "designopt.commands"

DOCTOR = "doctor"
"""The command that finds what is wrong with an installation."""

COMPLETION = "_DESIGNOPT_COMPLETE"
"""Of the environment: how a shell asks for completions (Typer's, from the command's name)."""

VERBOSITY = ("-v", "-q")
"""Options that may stand before a command and after it."""

LOG = logging.getLogger(__name__)

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
    with logging_to_terminal():
        app, unloaded = _app(arguments, check)
        _report_unloaded(unloaded, arguments)
        command = typer.main.get_command(app)
        _accept_verbosity_after(command)
        if COMPLETION in os.environ:
            return command.main(arguments, prog_name="designopt")
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


def _app(
    arguments: list[str], check: Callable[[], None]
) -> tuple[typer.Typer, dict[EntryPoint, Exception]]:
    """The command that is called, or else all of them, and why some of them cannot be loaded."""
    unloaded = {}
    app = typer.Typer(help="Design robot fingers that feel with a camera.", rich_markup_mode=None)
    app.callback()(_root)
    points = sorted(entry_points(group=COMMAND_GROUP), key=lambda point: point.name)
    # One that is named first is loaded alone.
    called = [point for point in points if point.name in arguments[:1]]
    for point in called if called and COMPLETION not in os.environ else points:
        try:
            command = point.load()
        except Exception as error:  # a plug-in is anyone's code; the other commands must not suffer
            check()
            unloaded[point] = error
            continue
        if isinstance(command, typer.Typer):
            for part in command.registered_commands:
                part.help = _help(cast("Callable[..., object]", part.callback))
            app.add_typer(command, name=point.name)
        else:
            app.command(point.name, help=_help(command))(command)
    return app, unloaded


def _report_unloaded(unloaded: dict[EntryPoint, Exception], arguments: list[str]) -> None:
    """Warn of commands that cannot be loaded.

    Raises:
        UserError: another distribution has taken the place of a package of ours; ``doctor`` and
            the options without a command work all the same.
    """
    command = next((word for word in arguments if not word.startswith("-")), None)
    if command == DOCTOR:  # which names them itself
        return
    is_ours = any(point.module.split(".")[0] in PACKAGES for point in unloaded)
    if is_ours and command is not None and (clashes := find_clashes()):
        raise UserError("; ".join(clashes))
    for point, error in unloaded.items():
        LOG.warning("command '%s' cannot be loaded: %s", point.name, reason_of(error))


def _accept_verbosity_after(root: Any) -> None:
    """Let every command take ``-v`` and ``-q``, too; its help does not repeat them."""
    options = [copy.copy(one) for one in root.params if set(VERBOSITY) & set(one.opts)]
    for one in options:
        one.hidden = True
    for command in _commands_of(root):
        taken = {name for one in command.params for name in one.opts}
        command.params += [one for one in options if not taken & set(one.opts)]


def _commands_of(group: Any) -> Iterator[Any]:
    """The commands of a group of Typer's, and of the groups in it."""
    for command in group.commands.values():
        if hasattr(command, "commands"):
            yield from _commands_of(command)
        else:
            yield command


def _help(command: Callable[..., object]) -> str:
    """A command's docstring, whose example keeps its lines."""
    # A line with \b alone keeps Click from filling the paragraph after it.
    return inspect.cleandoc(command.__doc__ or "").replace("Example:\n", "\b\nExample:\n")


def _show_version(wanted: bool) -> bool:
    if wanted:
        print(f"designopt {__version__}")
        raise typer.Exit
    return wanted


def _set_verbose(count: int) -> int:
    if count:
        set_verbosity(count)
    return count


def _set_quiet(wanted: bool) -> bool:
    if wanted:
        set_verbosity(quiet=True)
    return wanted


def _root(
    show_version: Annotated[
        bool,
        typer.Option(
            "--version", help="Show the version and exit.", is_eager=True, callback=_show_version
        ),
    ] = False,
    verbose: Annotated[
        int,
        typer.Option(
            "-v",
            "--verbose",
            count=True,
            show_default=False,
            expose_value=False,
            callback=_set_verbose,
            help="Show steps with their seconds; -vv also what is compiled. May stand after the "
            "command, too.",
        ),
    ] = 0,
    quiet: Annotated[
        bool,
        typer.Option(
            "-q",
            "--quiet",
            expose_value=False,
            callback=_set_quiet,
            help="Show nothing but errors and where the result is. May stand after the command, "
            "too.",
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
