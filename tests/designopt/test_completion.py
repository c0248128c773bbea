"""Completion as a shell asks for it: commands, studies, settings, files, names; nothing slow."""

import os
import sys

import pytest

from designopt.cli.completion import complete_toml
from tests.commands import finished, python

SLOW = ("cv2", "jax", "matplotlib", "scipy")


def completed(line: str, cwd=None) -> list[str]:
    """What bash is offered for the last word of a line."""
    asked = {
        "COMP_WORDS": line,
        "COMP_CWORD": str(line.count(" ")),
        "_DESIGNOPT_COMPLETE": "complete_bash",
    }
    done = python("-m", "designopt", env=os.environ | asked, cwd=cwd)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("designopt do", ["doctor"]),
        ("designopt -v sol", ["solve"]),
        ("designopt run finger-m", ["finger-mirrors"]),
        ("designopt list table", ["table1"]),
        ("designopt front finger-f", ["finger-front"]),
        ("designopt run table1 --set cl", ["clearance="]),
        ("designopt run table1 --out o --set chamber.offset_a", ["chamber.offset_a="]),
        ("designopt sweep table1 --vary clearance=1,2 --set clear", ["clearance="]),
        ("designopt new finger --set body.prox", ["body.proximal="]),
        ("designopt new four", ["four-bar"]),
        ("designopt new boa", ["board"]),
        ("designopt run table1 --dtype ", ["float64", "float32"]),
        ("designopt export finger --to st", ["step"]),
        ("designopt explore finger-g", ["finger-grasp"]),
        ("designopt explore table1 --set cl", ["clearance="]),
        ("designopt run nosuch --set c", []),
    ],
)
def test_words(line, words):
    assert completed(line) == words


def test_files(tmp_path):
    for name in ("bar.toml", "bar.csv", ".hidden.toml", "bars/one.toml", "bars/two.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert completed("designopt solve ba", tmp_path) == ["bar.toml", "bars/"]
    assert completed("designopt trace bars/", tmp_path) == ["bars/one.toml"]
    assert completed("designopt export ", tmp_path)[-2:] == ["bar.toml", "bars/"]
    assert complete_toml(f"{tmp_path}/.h") == [f"{tmp_path}/.hidden.toml"]
    assert complete_toml(f"{tmp_path}/no/") == []


@pytest.mark.parametrize("line", ["designopt run f", "designopt run finger --set b"])
def test_nothing_slow_is_loaded(line):
    probe = (
        "import os, sys; from designopt.cli import run\n"
        f"os.environ |= {{'COMP_WORDS': {line!r}, 'COMP_CWORD': '{line.count(' ')}', "
        "'_DESIGNOPT_COMPLETE': 'complete_bash'}\n"
        "try:\n    run([])\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {SLOW} if name in sys.modules])"
    )
    assert python("-c", probe).stdout.splitlines()[-1] == "[]"


def test_bash_completes_by_the_script_that_is_shown(tmp_path):
    named = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    script = python("-m", "designopt", "--show-completion", "bash", env=os.environ | named).stdout
    (tmp_path / "complete.sh").write_text(script, encoding="utf-8")
    program = tmp_path / "designopt"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m designopt "$@"\n')
    program.chmod(0o755)
    asked = "COMP_WORDS=(designopt run finger-g); COMP_CWORD=2; _designopt_completion designopt"
    line = f". ./complete.sh; {asked}; echo ${{COMPREPLY[@]}}"
    path = f"{tmp_path}:{os.environ['PATH']}"
    done = finished(["bash", "-c", line], cwd=tmp_path, env=os.environ | {"PATH": path})
    assert done.stdout == "finger-grasp\n", done.stderr
