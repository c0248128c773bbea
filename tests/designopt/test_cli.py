"""The command line as a person meets it: help, faults in one line, exit codes."""

import json
import os
import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

from designopt import cli
from designopt import study as study_module
from designopt.errors import Interrupted
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
        (["run", "square", "--set", "side"], ["--set side", "write --set key=value"]),
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
    assert capsys.readouterr().err == "interrupted; nothing was written\n"
    assert list(square.rglob("*.json")) == []


def test_an_interrupted_command_that_keeps_something_says_what(monkeypatch, capsys):
    def sweep() -> None:
        raise Interrupted("3 of 4 points are kept in out")

    point = EntryPoint("sweep", "absent:sweep", cli.COMMAND_GROUP)
    monkeypatch.setattr(EntryPoint, "load", lambda self: sweep)
    monkeypatch.setattr(cli, "entry_points", lambda group: [point])
    assert cli.run(["sweep"]) == 130
    assert capsys.readouterr().err == "interrupted; 3 of 4 points are kept in out\n"


def test_a_broken_command_does_not_hurt_the_others(monkeypatch, capsys):
    good = EntryPoint("list", "designopt.commands:list_studies", cli.COMMAND_GROUP)
    bad = EntryPoint("bad", "no_such_package:command", cli.COMMAND_GROUP)
    monkeypatch.setattr(cli, "entry_points", lambda group: [good, bad])
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


@pytest.mark.parametrize("command", ["PYTHONIOENCODING=ascii {} list table1", "{} list | true"])
def test_poor_terminals_and_closed_pipes_are_no_faults(command):
    line = command.format(f"'{sys.executable}' -m designopt")
    done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
