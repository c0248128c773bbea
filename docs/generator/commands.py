"""Reference of the command line, from Typer."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from importlib.metadata import entry_points
from typing import Any

import typer

from designopt.cli.app import COMMAND_GROUP
from docs.generator.markup import cell, plain, table

INTRO = """\
# Commands

Every command has `--help`. Exit codes are the same for all: 0, all went well; 1, the output is
complete, but a target in it was missed or no pose can be assembled; 2, something in the command,
its files or on the machine was wrong, and one line names it and the cure; 70, a fault of
designopt's own, one line and a file with what to report; 130, interrupted, and no file is left
half-written.

"""


def commands() -> Iterator[tuple[str, Any, Any]]:
    """Every command: its words, Click's command, and its function."""
    for point in sorted(entry_points(group=COMMAND_GROUP), key=lambda point: point.name):
        loaded = point.load()
        if isinstance(loaded, typer.Typer):
            group: Any = typer.main.get_group(loaded)
            for one in loaded.registered_commands:
                assert one.callback is not None
                name = one.name or one.callback.__name__.replace("_", "-")
                yield f"{point.name} {name}", group.commands[name], one.callback
        else:
            app = typer.Typer(add_completion=False)
            app.command()(loaded)
            yield point.name, typer.main.get_command(app), loaded


def command_section(name: str, command: Any, function: Any) -> str:
    """Usage, purpose, example, arguments and options of a command."""
    text = inspect.cleandoc(function.__doc__ or "")
    purpose, _, example = text.partition("Example:\n")
    context = command.make_context(name, [], resilient_parsing=True)
    usage = " ".join(command.collect_usage_pieces(context))
    lines = f"## `designopt {name}` {{#{name.replace(' ', '-')}}}\n\n{_paragraphs(purpose)}\n"
    lines += f"```sh\ndesignopt {name} {usage}\n```\n\n"
    if example:
        lines += f"Example:\n\n```sh\n{inspect.cleandoc(example)}\n```\n\n"
    records = [one.get_help_record(context) for one in command.params]
    rows = [_row(*record) for record in records if record is not None]
    return lines + table(["Argument or option", "Meaning", "Default and bounds"], rows) + "\n"


def _row(name: str, meaning: str) -> list[str]:
    # Click writes what it knows besides the help, such as "[default: 3; required]", after it.
    text, _, more = meaning.partition("  [")
    return [f"`{name}`", plain(cell(text)), plain(more.removesuffix("]"))]


def _paragraphs(text: str) -> str:
    # A line with \b alone only keeps Click from filling what follows.
    text = re.sub(r"^\\?\x08?$", "", text, flags=re.MULTILINE)
    return plain(text).replace("\\`\\`", "`").replace("\\`", "`")


def commands_page() -> str:
    """The page of all commands."""
    found = list(commands())
    rows = [
        [f"[`{name}`](#{name.replace(' ', '-')})", plain(_first_line(function))]
        for name, _, function in found
    ]
    return (
        INTRO
        + table(["Command", "Purpose"], rows)
        + "\n"
        + "".join(command_section(*one) for one in found)
    )


def _first_line(function: Any) -> str:
    return inspect.cleandoc(function.__doc__ or "").partition("\n\n")[0]
