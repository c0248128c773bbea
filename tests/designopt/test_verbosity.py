"""How much a command writes: -v, -vv and -q, before the command and after it."""

import logging
import re

import pytest

from designopt import cli
from designopt.study import study as study_module
from tests.commands import python
from tests.designopt.plugin import points

RUN = "run square --set side=3 --out o"
DRAWN = ("--sweep", "crank=0:360:4", "--figure", "four-bar.png")


@pytest.fixture
def square(monkeypatch, tmp_path):
    monkeypatch.setattr(study_module, "entry_points", lambda group: points("square"))
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("square")
@pytest.mark.parametrize("line", [f"-q {RUN}", f"{RUN} --quiet"])
def test_quiet_is_the_place_of_the_result_and_nothing_else(capsys, line):
    assert cli.run(line.split()) == 0
    assert capsys.readouterr() == ("o/report.html\n", "")


@pytest.mark.usefixtures("square")
def test_quiet_leaves_errors_and_missed_targets(capsys):
    assert cli.run(["-q", "run", "sqare"]) == 2
    assert capsys.readouterr().err.startswith("error: STUDY: no study is named 'sqare'")
    assert cli.run(["run", "square", "--set", "side=4", "-q"]) == 1
    assert capsys.readouterr().err == "targets missed: area: 16 mm², asked for 9 mm²\n"


@pytest.mark.usefixtures("square")
@pytest.mark.parametrize("line", [f"-v {RUN}", f"{RUN} --verbose"])
def test_verbose_shows_steps_and_all_numbers(capsys, line):
    assert cli.run(line.split()) == 0
    shown = capsys.readouterr()
    assert re.search(r"^Squaring: \d\.\d s$", shown.err, re.MULTILINE)
    assert "Squaring ..." not in shown.err
    [row] = [line for line in shown.out.splitlines() if line.strip().startswith("area")]
    assert row.split() == ["area", "9", "mm²", "9", "met"]


@pytest.mark.usefixtures("square")
def test_twice_verbose_shows_beginnings_too(capsys):
    assert cli.run([*RUN.split(), "-vv"]) == 0
    assert "Squaring ...\nSquaring: " in capsys.readouterr().err


def test_twice_verbose_names_what_is_compiled(tmp_path):
    (tmp_path / "four-bar.toml").write_text(
        python("-m", "designopt", "new", "four-bar", "-").stdout, encoding="utf-8"
    )
    done = python("-m", "designopt", "-vv", "solve", "four-bar.toml", *DRAWN, cwd=tmp_path)
    assert done.returncode == 0
    assert re.search(r"^compiled .*: \d+\.\d\d s$", done.stderr, re.MULTILINE)


@pytest.mark.usefixtures("square")
def test_loggers_are_as_before_when_a_command_has_ended():
    logger = logging.getLogger("designopt")
    before = logger.level, list(logger.handlers)
    assert cli.run(["-q", "list"]) == 0
    assert (logger.level, logger.handlers) == before


def test_importing_configures_no_logging():
    probe = (
        "import logging, designopt, designopt.cli.app, designopt.progress; "
        "loggers = [logging.root, logging.getLogger('designopt')]; "
        "print([one.handlers for one in loggers], [one.level for one in loggers])"
    )
    assert python("-c", probe).stdout == "[[], []] [30, 0]\n"


@pytest.mark.usefixtures("square")
def test_a_warning_of_a_name_with_line_ends_is_one_line(capsys):
    from designopt.cli.verbosity import logging_to_terminal

    with logging_to_terminal():
        logging.getLogger("designopt.test").warning("%s is odd", "a\nb\x1b")
    assert capsys.readouterr().err == "warning: a b\\x1b is odd\n"
