"""The command line as a person meets it: help, faults in one line, exit codes."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import NoReturn

import pytest

from designopt import cli
from designopt.cli import app
from designopt.errors import Interrupted
from designopt.study import study as study_module
from tests.designopt.plugin import points

HEAVY = ("cv2", "equinox", "jax", "matplotlib", "mpmath", "numpy", "optimistix", "scipy")


@pytest.fixture
def square(monkeypatch, tmp_path):
    monkeypatch.setattr(study_module, "entry_points", lambda group: points("square", "absent"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_help_loads_nothing_heavy():
    probe = (
        "import sys; from designopt import cli; code = cli.run(['--help']); "
        f"loaded = [name for name in {HEAVY} if name in sys.modules]; "
        "sys.exit(f'loaded {loaded}' if loaded else code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for command in ("list", "run"):
        assert command in done.stdout


def test_what_does_not_exist_is_told_before_jax_is_loaded(tmp_path):
    (tmp_path / "there").mkdir()
    lines = (
        "solve no.toml",
        "trace no.toml",
        "explore no.toml",
        "explore there --web",
        "export no.toml --to svg",
        "export linkage-precision --to svg",
        "sweep nosuch --vary x=1:2:3",
        "run finger --out there",
        "run finger --out file/new",
        "run finger --set nosuch=1",
    )
    (tmp_path / "file").touch()
    probe = (
        "import sys; from designopt import cli; "
        "[print(cli.run(line.split()), 'jax' in sys.modules) for line in sys.argv[1:]]"
    )
    done = subprocess.run(
        [sys.executable, "-c", probe, *lines],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.splitlines() == ["2 False"] * len(lines)
    assert done.stderr.count("error: ") == done.stderr.count("\n") == len(lines)


def test_no_arguments_is_help(capsys):
    assert cli.run([]) == 0
    assert "Usage: designopt" in capsys.readouterr().out


def test_version(capsys):
    assert cli.run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("designopt 0.")


def test_list_names_studies_and_needs(square, capsys):
    assert cli.run(["list"]) == 0
    shown = capsys.readouterr().out
    assert "square  The area of a square" in shown
    assert "needs: peers" in shown
    assert "settings: side, inner.length, label, asked" in shown
    assert "'absent' (no_such_package:STUDY) cannot be loaded" in shown


def test_list_shows_the_settings_of_one(square, capsys):
    assert cli.run(["list", "square"]) == 0
    shown = capsys.readouterr().out
    for words in ("inner.length", "2.0", "a length (mm)", "must be given"):
        assert words in shown


def test_run_summarises_and_succeeds(square, capsys):
    assert cli.run(["run", "square", "--set", "side=3", "--seed", "7"]) == 0
    shown = capsys.readouterr()
    assert "area_mm2" in shown.out
    assert "report: out/square/report.html" in shown.out
    assert shown.err == ""  # progress is silent where there is no terminal
    assert json.loads((square / "out/square/results.json").read_text())["seed"] == 7


def test_a_missed_target_is_exit_code_1_with_its_results_kept(square, capsys):
    assert cli.run(["run", "square", "--set", "side=4", "--out", "o"]) == 1
    assert capsys.readouterr().err == "targets missed: area_mm2\n"
    assert (square / "o/report.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "sqare"], ["STUDY", "'sqare'", "did you mean 'square'?"]),
        (["run", "absent"], ["'absent'", "cannot be loaded", "repair or uninstall"]),
        (["list", "sqare"], ["STUDY", "did you mean 'square'?"]),
        (["run"], ["STUDY", "designopt --help"]),
        (["rum"], ["'rum'", "run", "designopt --help"]),
        (["run", "square", "--sed", "1"], ["--sed", "--seed"]),
        (["run", "square", "--set", "side"], ["value is missing", "--set side=VALUE"]),
        (["run", "square"], ["--set side", "missing"]),
        (["run", "square", "--set", "side=1", "--set", "sdie=1"], ["--set sdie", "'side'"]),
        (["run", "square", "--set", "side=x"], ["--set side=x", "valid number"]),
        (["run", "square", "--set", "side=1", "--set", "inner.length=-1"], ["inner.length", "0"]),
        (
            ["run", "square", "--set", "side=1", "--seed", "-1"],
            ["--seed", "greater than or equal to 0"],
        ),
        (["run", "square", "--set", "side=1", "--seed", "x"], ["--seed", "integer"]),
        (["run", "square", "--set", "side=1", "--dtype", "float16"], ["--dtype", "float32"]),
        (["run", "square", "--set", "side=1", "--out", "there"], ["--out there", "--force"]),
        (
            ["run", "square", "--set", "side=1", "--out", "file/x"],
            ["--out file/x", "file is no folder", "name a folder"],
        ),
        (["run", "square", "--set", "side=1", "--out", "there", "--force"], ["an earlier result"]),
    ],
)
def test_faults_are_one_line_and_exit_code_2(square, capsys, arguments, words):
    (square / "there").mkdir()
    (square / "file").write_text("")
    assert cli.run(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1
    for word in words:
        assert word in shown.err
    assert sorted(path.name for path in square.rglob("*")) == ["file", "there"]


def test_an_interrupted_run_says_so(square, capsys):
    assert cli.run(["run", "square", "--set", "side=1", "--set", "label=interrupt"]) == 130
    assert capsys.readouterr().err == "interrupted; no file is half-written\n"
    assert list(square.rglob("*.json")) == []


def test_an_interrupted_command_that_keeps_something_says_what(monkeypatch, capsys):
    def sweep() -> None:
        raise Interrupted("3 of 4 points are kept in out")

    point = EntryPoint("sweep", "absent:sweep", app.COMMAND_GROUP)
    monkeypatch.setattr(EntryPoint, "load", lambda self: sweep)
    monkeypatch.setattr(app, "entry_points", lambda group: [point])
    assert cli.run(["sweep"]) == 130
    assert capsys.readouterr().err == "interrupted; 3 of 4 points are kept in out\n"


def test_a_broken_command_does_not_hurt_the_others(monkeypatch, capsys):
    good = EntryPoint("list", "designopt.cli.studies:list_studies", app.COMMAND_GROUP)
    bad = EntryPoint("bad", "no_such_package:command", app.COMMAND_GROUP)
    monkeypatch.setattr(app, "entry_points", lambda group: [good, bad])
    assert cli.run(["--help"]) == 0
    shown = capsys.readouterr()
    assert "warning: command 'bad' cannot be loaded" in shown.err
    assert "list" in shown.out


def test_the_installed_command_runs():
    done = subprocess.run(
        [sys.executable, "-m", "designopt", "list"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert "table1" in done.stdout


@pytest.mark.parametrize("arguments", [["list"], ["run", "table1"], ["explore", "x.toml"]])
def test_an_unknown_backend_of_matplotlib_is_one_line(tmp_path, arguments):
    done = subprocess.run(
        [sys.executable, "-m", "designopt", *arguments],
        env={**os.environ, "MPLBACKEND": "nosuch"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: MPLBACKEND=nosuch: Matplotlib has no such backend; unset it\n"
    assert not list(tmp_path.iterdir())


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    line = line.format(f"'{sys.executable}' -m designopt")
    line = f"exec 3>/dev/full; {line}"
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", line],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    "command",
    [
        "PYTHONIOENCODING=ascii {} list table1",
        "{} list | true",
        "{} list table1 | true",
        "PYTHONUNBUFFERED=1 {} list table1 | true",
    ],
)
def test_poor_terminals_and_closed_pipes_are_no_faults(command):
    done = shell(command)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("{} --version >&3", "error: output: No space left on device; make room there"),
        ("PYTHONUNBUFFERED=1 {} --version >&3", "error: output: No space left on device; make"),
        ("PYTHONUNBUFFERED=1 {} list table1 >&3", "error: output: No space left on device; make"),
        ("{} --version >&-", "error: standard output is closed; send it"),
        ("{} lisst 2>&3", ""),
        ("{} lisst 2>&-", ""),
    ],
)
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
    longest = max(map(len, done.stdout.splitlines()[1:]))
    assert longest <= 80


class Broken:
    """A command that ends in an exception."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._patch = monkeypatch

    def run(self, error: BaseException) -> int:
        def command() -> None:
            raise error

        return self.load(lambda _: command)

    def load(self, load: Callable[[EntryPoint], Callable[[], None]]) -> int:
        found = [EntryPoint(name, f"absent:{name}", app.COMMAND_GROUP) for name in ("a", "b")]
        self._patch.setattr(EntryPoint, "load", load)
        self._patch.setattr(app, "entry_points", lambda group: found)
        return cli.run(["a"])


@pytest.fixture
def broken(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return Broken(monkeypatch)


@pytest.mark.parametrize("kind", [KeyError, RecursionError, BaseException, OSError])
def test_a_fault_of_the_program_is_one_line_and_a_file(broken, tmp_path, capsys, kind):
    for number in (1, 2):
        assert broken.run(kind(f"key\x1b\n{number}")) == 70
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
    assert broken.run(ZeroDivisionError("by zero")) == 70
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert re.search(r"\(ZeroDivisionError: by zero\); .*: test_cli\.py:\d+ command < ", line)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "error: Cannot allocate memory; ask for fewer poses"),
        (RuntimeError("RESOURCE_EXHAUSTED: Out of memory"), "error: Cannot allocate memory; ask"),
        (OSError(errno.ENOSPC, "", "t.csv"), "error: t.csv: No space left on device; make room"),
        (OSError(errno.EMFILE, ""), "error: output: Too many open files; allow more open files"),
    ],
)
def test_want_of_the_machine_is_exit_code_2(broken, capsys, error, words):
    assert broken.run(error) == 2
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

    assert broken.load(load) == 130
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
    done = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "interrupted; no file is half-written\n")
