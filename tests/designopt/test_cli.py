"""The command line as a person meets it: help, faults in one line, exit codes."""

import errno
import json
import os
import re
import signal
import sys
import tempfile
from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import NoReturn

import pytest

from designopt import cli
from designopt.cli import app, studies
from designopt.errors import Interrupted
from designopt.study import study as study_module
from designopt.study.results import Metric, Target
from tests.commands import check_command_refused, finished, python, refused_cases
from tests.designopt.plugin import points
from tests.designopt.tables import cases

STEP = r"Squaring: \d\.\d s\n"
"""What a command writes to standard error that is no terminal, of the study `square`."""

HEAVY = ("cv2", "equinox", "jax", "matplotlib", "mpmath", "numpy", "optimistix", "scipy")


@pytest.fixture
def square(monkeypatch, tmp_path):
    monkeypatch.setattr(
        study_module, "entry_points", lambda group: points("square", "string", "absent")
    )
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_help_loads_nothing_heavy():
    probe = (
        "import sys; from designopt import cli; code = cli.run(['--help']); "
        f"loaded = [name for name in {HEAVY} if name in sys.modules]; "
        "sys.exit(f'loaded {loaded}' if loaded else code)"
    )
    done = python("-c", probe)
    assert done.returncode == 0, done.stderr
    assert {"list", "run"} <= set(done.stdout.split())


def test_what_does_not_exist_is_told_before_jax_is_loaded(tmp_path):
    (tmp_path / "there").mkdir()
    lines = cases("before_jax")
    (tmp_path / "file").touch()
    probe = (
        "import sys; from designopt import cli; "
        "[print(cli.run(line.split()), 'jax' in sys.modules) for line in sys.argv[1:]]"
    )
    done = python("-c", probe, *lines, cwd=tmp_path)
    assert done.stdout.splitlines() == ["2 False"] * len(lines)
    assert done.stderr.count("error: ") == done.stderr.count("\n") == len(lines)


@pytest.mark.parametrize(("line", "words"), cases("listed"))
def test_what_is_listed(square, capsys, line, words):
    assert cli.run(line.split()) == 0
    shown = capsys.readouterr().out
    assert all(word in shown for word in words)


def test_run_summarises_and_succeeds(square, capsys):
    assert cli.run(["run", "square", "--set", "side=3", "--seed", "7"]) == 0
    shown = capsys.readouterr()
    assert shown.out == (
        " 1. A <square> & its area.\n1 of 1 targets are met.\nreport: out/square/report.html\n"
    )
    assert re.fullmatch(STEP, shown.err)
    assert json.loads((square / "out/square/results.json").read_text())["seed"] == 7


def test_a_missed_target_is_exit_code_1_with_its_results_kept(square, capsys):
    assert cli.run(["run", "square", "--set", "side=4", "--out", "o"]) == 1
    missed = r"targets missed: area: 16 mm², asked for 9 mm²\n"
    assert re.fullmatch(STEP + missed, capsys.readouterr().err)
    assert (square / "o/report.html").is_file()


def test_a_missed_target_that_refers_to_an_earlier_number_names_it():
    asked = Target("<=", 1.0)
    metrics = [
        Metric("median_mm", 0.5, "mm", "median error", None, asked),
        Metric("p95_mm", 2.0, "mm", "95th percentile of the same", None, asked),
        Metric("share", float("nan"), "", "share", None, asked),
    ]
    assert [*studies._missed_in_words(metrics)] == [
        "95th percentile of the same (median error): 2 mm, asked for ≤ 1 mm",
        "share: not found, asked for ≤ 1",
    ]


@pytest.mark.parametrize(("line", "words"), refused_cases("run"))
def test_faults_are_one_line_and_exit_code_2(square, capsys, line, words):
    (square / "there").mkdir()
    (square / "there" / "mine").touch()
    (square / "file").touch()
    check_command_refused(capsys, line, words)
    assert sorted(path.name for path in square.rglob("*")) == ["file", "mine", "there"]


def test_an_interrupted_run_says_so(square, capsys):
    assert cli.run(["run", "square", "--set", "side=1", "--set", "label=interrupt"]) == 130
    interrupted = r"interrupted; no file is half-written\n"
    assert re.fullmatch(STEP + interrupted, capsys.readouterr().err)
    assert list(square.rglob("*.json")) == []


def test_a_broken_command_does_not_hurt_the_others(monkeypatch, capsys):
    good = EntryPoint("list", "designopt.cli.studies:list_studies", app.COMMAND_GROUP)
    bad = EntryPoint("bad", "no_such_package:command", app.COMMAND_GROUP)
    monkeypatch.setattr(app, "entry_points", lambda group: [good, bad])
    assert cli.run(["--help"]) == 0
    shown = capsys.readouterr()
    assert "warning: command 'bad' cannot be loaded" in shown.err
    assert "list" in shown.out


@pytest.mark.parametrize("arguments", [["list"], ["run", "table1"], ["explore", "x.toml"]])
def test_an_unknown_backend_of_matplotlib_is_one_line(tmp_path, arguments):
    variables = os.environ | {"MPLBACKEND": "nosuch"}
    done = python("-m", "designopt", *arguments, env=variables, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: MPLBACKEND=nosuch: Matplotlib has no such backend; unset it\n"
    assert not list(tmp_path.iterdir())


def shell(line, **environment):
    line = "exec 3>/dev/full; " + line.format(f"'{sys.executable}' -m designopt")
    return finished(["bash", "-o", "pipefail", "-c", line], env=os.environ | environment)


@pytest.mark.parametrize("command", cases("harmless_output"))
def test_poor_terminals_and_closed_pipes_are_no_faults(command):
    done = shell(command)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(("command", "words"), cases("faulty_output"))
def test_output_that_cannot_be_written_is_exit_code_2(command, words):
    done = shell(command, PYTHONUNBUFFERED="")
    assert done.returncode == 2
    assert done.stderr.startswith(words)
    assert done.stderr.count("\n") == bool(words)


@pytest.mark.parametrize("width", ["80", "50"])
def test_keys_are_listed_whole(width):
    done = shell("{} list finger | cat", COLUMNS=width)
    cells = {line.split()[0]: line.split() for line in done.stdout.splitlines() if line.split()}
    assert cells["mirrors.tolerances.camera_position"][1] == "0.3"
    assert max(map(len, done.stdout.splitlines()[1:])) <= 80


@pytest.fixture
def broken(monkeypatch, tmp_path):
    """Runs a command that is loaded so."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    def run(load: Callable[[EntryPoint], Callable[[], None]]) -> int:
        found = [EntryPoint(name, f"absent:{name}", app.COMMAND_GROUP) for name in ("a", "b")]
        monkeypatch.setattr(EntryPoint, "load", load)
        monkeypatch.setattr(app, "entry_points", lambda group: found)
        return cli.run(["a"])

    return run


def ending_in(error: BaseException) -> Callable[[EntryPoint], Callable[[], None]]:
    """Loads a command that ends in an exception."""

    def command() -> None:
        raise error

    return lambda _: command


@pytest.mark.parametrize("kind", [KeyError, RecursionError, BaseException, OSError])
def test_a_fault_of_the_program_is_one_line_and_a_file(broken, tmp_path, capsys, kind):
    for number in (1, 2):
        assert broken(ending_in(kind(f"key\x1b\n{number}"))) == 70
        shown = capsys.readouterr()
        assert shown.out == ""
        assert shown.err.count("\n") == 1
        assert "\x1b" not in shown.err
        assert f"error: a fault of designopt's own ({kind.__name__}: " in shown.err
        files = sorted((tmp_path / "state" / "designopt").iterdir())
        assert len(files) == number
        newest = next(path for path in files if str(path) in shown.err)
        text = newest.read_text(encoding="utf-8")
        assert f"Python {sys.version}" in text
        assert "Traceback (most recent call last)" in text
        assert "in command" in text


def test_a_fault_without_a_place_for_a_file_has_its_calls_in_the_line(
    broken, monkeypatch, tmp_path, capsys
):
    (tmp_path / "state").write_text("no folder")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "state" / "tmp"))
    assert broken(ending_in(ZeroDivisionError("by zero"))) == 70
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert re.search(r"\(ZeroDivisionError: by zero\); .*: test_cli\.py:\d+ command < ", line)


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (MemoryError(), 2, "error: Cannot allocate memory; ask for fewer poses"),
        (RuntimeError("RESOURCE_EXHAUSTED: Out of"), 2, "error: Cannot allocate memory; ask"),
        (OSError(errno.ENOSPC, "", "t.csv"), 2, "error: t.csv: No space left on device; make room"),
        (OSError(errno.EMFILE, ""), 2, "error: output: Too many open files; allow more open files"),
        (Interrupted("3 of 4 points are kept"), 130, "interrupted; 3 of 4 points are kept\n"),
    ],
)
def test_want_of_the_machine_and_interrupts_have_codes_of_their_own(
    broken, capsys, error, code, words
):
    assert broken(ending_in(error)) == code
    shown = capsys.readouterr().err
    assert shown.startswith(words)
    assert shown.count("\n") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_loading_turns_into_another_fault_is_one(broken, capsys, number):
    def load(point: EntryPoint) -> NoReturn:
        try:
            signal.raise_signal(number)
        finally:
            raise ImportError(f"{point.name} failed to import")  # as compiled modules do

    assert broken(load) == 130
    assert capsys.readouterr().err == "interrupted; no file is half-written\n"


@pytest.mark.parametrize("module", ["typer", "pydantic", "rich.table", "designopt.cli.studies"])
def test_an_interrupt_while_modules_are_loaded_is_one_line(module):
    probe = (
        "import signal, sys\n"
        "from designopt.cli import main\n"
        "class Finder:\n"
        "    def find_spec(self, name, path, target=None):\n"
        f"        if name == {module!r}:\n"
        "            signal.raise_signal(signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
        "sys.argv = ['designopt', 'list', 'table1']\n"
        "main()\n"
    )
    done = python("-c", probe)
    assert (done.returncode, done.stderr) == (130, "interrupted; no file is half-written\n")
