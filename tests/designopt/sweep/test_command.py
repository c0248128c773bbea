"""``designopt sweep`` as a person meets it: faults, failed points, no scheduler."""

import csv
import json
import math
import re
from importlib.metadata import version

import pytest

from designopt import cli
from designopt.sweep.running import versions_of
from tests.commands import check_command_refused, python, refused_cases

TABLE = "result/tables/points.csv"


def test_failed_points_are_listed_and_stop_nothing(installed, capsys):
    sweep = ["sweep", "batched", "--vary", "x=-1,0,2,1000", "--workers", "1", "--out", "o", "-q"]
    assert cli.run(sweep) == 1
    shown = capsys.readouterr()
    assert shown.out == "o/result/report.html\n"
    told = shown.err.splitlines()
    assert told[0] == "failed: 3 of 4 points"
    assert told[1] == "  x=-1.0: x: a length is not negative; make it larger"
    assert told[2] == "  x=0.0: ZeroDivisionError: float division by zero"
    assert told[3].startswith("  x=1000.0: --set x=1000.0: input should be less than or equal")
    with (installed / "o" / TABLE).open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [bool(row["sine_mm"]) for row in rows] == [False, False, True, False]
    # What failed for its settings stays so; what was broken, and that alone, is tried again.
    before = {path.name: path.stat().st_mtime_ns for path in (installed / "o/points").iterdir()}
    assert cli.run(sweep) == 1
    after = {path.name: path.stat().st_mtime_ns for path in (installed / "o/points").iterdir()}
    assert [name for name in sorted(after) if after[name] != before[name]] == ["000001.json"]


@pytest.mark.parametrize(("line", "words"), refused_cases("sweep"))
def test_faults_are_one_line_and_exit_code_2(installed, capsys, line, words):
    (installed / "there").mkdir()
    (installed / "there" / "mine").touch()
    check_command_refused(capsys, f"sweep {line}", words)
    assert sorted(path.name for path in installed.rglob("*")) == ["mine", "there"]


def test_points_lie_over_the_settings_of_a_file(installed, capsys):
    file = installed / "my.toml"
    file.write_text("x = 50.0\ncount = 3\n")
    sweep = ["sweep", "batched", "--vary", "x=1,2", "--workers", "1", "--out", "o"]
    assert cli.run([*sweep, "--config", "my.toml"]) == 0
    with (installed / "o" / TABLE).open(newline="") as table:
        found = [float(row["sine_mm"]) for row in csv.DictReader(table)]
    assert found == [pytest.approx(3 * math.sin(x) / x) for x in (1, 2)]
    spec = json.loads((installed / "o/result/results.json").read_text(encoding="utf-8"))["spec"]
    assert spec["config"] == {"x": 50.0, "count": 3}
    before = sorted((installed / "o/points").iterdir())
    for text, words in (
        ("count = 4\n", "--out o: it holds another sweep (other config)"),
        ("cuont = 4\n", "no point can be computed: my.toml: cuont: unknown key; did you mean"),
    ):
        file.write_text(text)
        capsys.readouterr()
        assert cli.run([*sweep, "--config", "my.toml"]) == 2
        assert words in capsys.readouterr().err
    assert sorted((installed / "o/points").iterdir()) == before


def test_a_scheduler_that_is_not_there_costs_no_point(installed, capsys, monkeypatch):
    monkeypatch.setattr("designopt.sweep.cluster.PATIENCE", 0.5)
    address = "tcp://127.0.0.1:9"
    sweep = ["sweep", "swept", "--vary", "x=1:2:3"]
    assert cli.run([*sweep, "--scheduler", address]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"error: --scheduler {address}: no scheduler answers there")
    assert told.endswith("0 of 3 points are kept in out/sweep-swept\n")


def test_an_address_that_is_none_leaves_nothing_behind(tmp_path):
    """Nor does what is left of a client when the process ends."""
    probe = (
        "from designopt import cli\n"
        "sweep = ['sweep', 'table1', '--vary', 'clearance=1:2:3', '--scheduler']\n"
        "for address in ('nowhere', 'tcp://127.0.0.1:x', 'tcq://127.0.0.1:1'):\n"
        "    assert cli.run([*sweep, address]) == 2\n"
    )
    done = python("-c", probe, cwd=tmp_path)
    lines = done.stderr.splitlines()
    assert (done.returncode, done.stdout, len(lines)) == (0, "", 3)
    for line in lines:
        assert re.match(r"error: --scheduler \S+: no scheduler answers there \(", line)


def test_a_point_that_ends_every_worker_costs_no_other_of_its_batch(installed, capsys, monkeypatch):
    monkeypatch.setattr("designopt.sweep.workers.MOST_LOSSES", 1)
    sweep = ["sweep", "batched", "--vary", "x=1:17:17", "--set", "fatal=2", "--workers", "1"]
    assert cli.run([*sweep, "--out", "o", "-q"]) == 1  # two points in a batch
    told = capsys.readouterr().err.splitlines()
    assert told[0] == "failed: 1 of 17 points"
    assert told[1].startswith("  x=2.0: its worker was lost again and again")


def test_the_package_that_offers_a_study_is_among_the_versions(installed):
    assert versions_of("swept")["swept"] == "1.0"
    assert versions_of("table1")["designopt"] == version("designopt")
