"""The command and the function over real files, against closed forms."""

import json
import math
import shutil

import pytest

from designopt import cli, load_design, optimise
from designopt.errors import UserError
from tests.helpers import GALLERY

FOUR_BAR = GALLERY / "linkages/four-bar.toml"


def least_transmission_deg(crank, coupler, rocker, ground):
    """At both poses in which crank and ground are in line, by the law of cosines."""
    angles = []
    for reach in (ground - crank, ground + crank):
        cosine = (coupler**2 + rocker**2 - reach**2) / (2 * coupler * rocker)
        angle = math.degrees(math.acos(cosine))
        angles.append(min(angle, 180 - angle))
    return min(angles)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shutil.copy(FOUR_BAR, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_four_bar_is_improved_and_its_file_read_again(folder, capsys):
    asked = ["--free", "bodies.coupler.A-B=90:150", "--keep", "margin>=5", "--out", "better"]
    code = cli.run(["optimise", "four-bar.toml", "--maximise", "min_transmission", *asked])
    assert code == 0
    document = json.loads((folder / "better/results.json").read_text())
    best = document["metrics"]["min_transmission"]["value"]
    found = load_design(str(folder / "better/specs/linkage.toml")).parametric().values()
    assert found["bodies.coupler.A-B"] == pytest.approx(90.0, abs=1e-5)
    assert found["bodies.crank.O2-A"] == pytest.approx(40.0, abs=1e-5)
    # On the judge's grid of 0.56° the extremes are hit: they are at 0° and 180°.
    assert best == pytest.approx(least_transmission_deg(40, 90, 80, 100), abs=1e-4)
    assert document["metrics"]["requirements_missed"]["met"]
    held = [line for line in document["findings"] if line.startswith("Held by")]
    slope = least_transmission_deg(40, 90 - 1e-3, 80, 100) - least_transmission_deg(40, 90, 80, 100)
    assert f"{slope / 1e-3:.4g}°" in held[0]
    assert "coupler A–B at its lower bound" in held[0]
    assert {one.name for one in (folder / "better/figures").iterdir()} >= {
        "before.png",
        "after.svg",
    }
    assert "report: better/report.html" in capsys.readouterr().out


def test_requirements_that_conflict_end_before_a_search_with_exit_code_1(folder, capsys):
    asked = ["--free", "bodies.coupler.A-B=100:140", "--keep", "mu.B>=70", "--out", "none"]
    assert cli.run(["optimise", "four-bar.toml", *asked]) == 1
    document = json.loads((folder / "none/results.json").read_text())
    assert any(
        "No design near meets all" in line and "mu.B" in line for line in document["findings"]
    )
    values = load_design(str(folder / "none/specs/linkage.toml")).parametric().values()
    assert values["bodies.coupler.A-B"] == pytest.approx(120.0, abs=1e-6)


def test_parameters_measures_and_requirements_are_listed(folder, capsys):
    assert cli.run(["optimise", "four-bar.toml", "--list"]) == 0
    printed = capsys.readouterr().out
    for words in ("* bodies.coupler.A-B  120 mm", "min_transmission", "--minimise", "margin >="):
        assert words in printed
    assert [path.name for path in folder.iterdir()] == ["four-bar.toml"]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (["--maximise", "mu.C"], "no measure 'mu.C'; did you mean 'mu.B'?"),
        (["--maximise", "size"], "write --minimise"),
        (["--maximise", "mu.B", "--minimise", "size"], "one measure is improved"),
        (["--free", "bodies.crank.O2-B"], "did you mean 'bodies.crank.O2-A'?"),
        (["--free", "bodies.crank.O2-A=60:30"], "low < high"),
        (["--free", "bodies.crank.O2-A=a"], "write low:high"),
        (["--keep", "mu.B>=100"], "at most 90°"),
        (["--keep", "mu.B"], "write a measure, >= or <=, and a number"),
        (["--over", "crank"], "write"),
        (["--over", "rank=0:90"], "no such input"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(asked, words, folder, capsys):
    assert cli.run(["optimise", "four-bar.toml", *asked]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert [path.name for path in folder.iterdir()] == ["four-bar.toml"]


def test_the_function_takes_a_design_and_calls_back():
    seen = []
    found = optimise(
        load_design(str(FOUR_BAR)), minimise="size", free=["bodies"], keep=["mu.B>=40"],
        on_step=seen.append,
    )  # fmt: skip
    # The greatest distance falls until the least ranges and the angle hold it.
    assert found.judged["size"] < found.judged_before["size"] == 120.0
    assert found.judged["mu.B"] >= 40.0 - 1e-4
    lengths = {name.split(".")[1]: value for name, value in found.values.items()}
    least = least_transmission_deg(*(lengths[n] for n in ("crank", "coupler", "rocker", "ground")))
    assert least == pytest.approx(found.judged["mu.B"], abs=1e-3)
    assert seen[-1].result is found


def test_postures_may_be_given():
    part = optimise(FOUR_BAR, free=["bodies.coupler"], over=["crank=60:120"], keep=["margin>=1"])
    whole = optimise(FOUR_BAR, free=["bodies.coupler"])
    assert part.judged["min_transmission"] > whole.judged["min_transmission"]
    with pytest.raises(UserError, match="has no joints"):
        optimise(GALLERY / "chambers/chamber.toml", over=["pip=0:9"])
