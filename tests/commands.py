"""Commands as a person starts them: refusals in one line, and processes of their own."""

from __future__ import annotations

import shlex
import subprocess
import sys
from typing import Any

import pytest

from designopt import cli
from tests.helpers import load_toml


def finished(command: list[str], **how: Any) -> subprocess.CompletedProcess[str]:
    """A process that has ended, with all that it printed."""
    return subprocess.run(command, capture_output=True, text=True, check=False, **how)


def python(*arguments: object, **how: Any) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own, with all that it prints."""
    return finished([sys.executable, *map(str, arguments)], **how)


def refused_cases(table: str) -> list[Any]:
    """Parameters (given, words of the error) of a table of ``tests/data/refused_words.toml``."""
    return [tuple(case) for case in load_toml("refused_words.toml")[table]]


def check_command_refused(capsys: pytest.CaptureFixture[str], line: str, words: list[str]) -> None:
    """A command prints one line with these words, and nothing else, and ends with exit code 2."""
    assert cli.run(shlex.split(line)) == 2
    shown = capsys.readouterr()
    assert (shown.out, shown.err[:7], shown.err.count("\n")) == ("", "error: ", 1)
    for word in words:
        assert word in shown.err
