"""A study, a kind of design and a template offered by a package outside the project."""

import json

import pytest

from designopt import cli
from designopt.designs import load_design
from designopt.explore.explorer import View
from tests.designopt.explore.whole import show

MODULE = """
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from designopt import Metric, Results, Spec, Study
from designopt.design_kind import Design, DesignKind
from designopt.explore.explorer import Explorer, ExplorerState, Numbers, Readout, View
from designopt.export.json import Quantity
from designopt.export.drawing import Drawing, Layer, Polyline
from designopt.file_template import FileTemplate
from designopt.io.files import read_toml
from designopt.optimize.parametric import Measure, Parameter, ParametricDesign


@dataclass(frozen=True)
class Crate:
    name: str
    side: float


class CrateDesign(ParametricDesign):
    measures = (Measure("area", "mm²", "area"),)
    requirements = ()

    def __init__(self, crate):
        self.title = crate.name
        self.parameters = (Parameter("side", crate.side, 1.0, 9.0),)

    def evaluate(self, values, of):
        return {"area": values[0] ** 2}

    def judge(self, values):
        return {"area": values["side"] ** 2}

    def files(self, values):
        return []


class CrateExplorer(Explorer):
    joints = ()

    def __init__(self, crate):
        self.design = CrateDesign(crate)

    def sketch(self):
        return [View("crate", drawing(Crate(self.design.title, self.values()["side"])))]

    def show(self, values):
        view = View("crate", drawing(Crate(self.design.title, values["side"])))
        return ExplorerState([view], lambda: Numbers([Readout("area", values["side"] ** 2, "mm²")]))

    def drag(self, values, handle, place):
        return dict(values)


def read(path):
    table = read_toml(path, "crate")["crate"]
    return Crate(path.stem, table["side"])


def drawing(crate):
    corners = [(0, 0), (crate.side, 0), (crate.side, crate.side), (0, crate.side)]
    return Drawing(crate.name, [Layer("walls", "body")], [Polyline("walls", corners, closed=True)])


KIND = DesignKind(
    "crate", "crate", read, CrateExplorer, drawing, lambda c: [Quantity("side", c.side, "mm")]
)


class CrateSpec(Spec):
    side: float = Field(default=2.0, description="of the crate (mm)")


def run(spec, context):
    return Results(["A crate."], [Metric("area_mm2", spec.side**2, "mm²", "area")])


STUDY = Study(
    "crate-area", "The area of a crate", CrateSpec, run,
    design=lambda spec, folder: Design(KIND, Crate("crate-area", spec.side)),
)

TEMPLATES = [
    FileTemplate("crate", "crate: a cube", "designopt explore", lambda: "[crate]\\nside = 4.0\\n")
]
"""

FILES = {
    "crates.py": MODULE,
    "crates-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: crates\nVersion: 1.0\n",
    "crates-1.0.dist-info/entry_points.txt": (
        "[designopt.studies]\ncrate-area = crates:STUDY\n\n"
        "[designopt.designs]\ncrate = crates:KIND\n\n"
        "[designopt.templates]\ncrates = crates:TEMPLATES\n"
    ),
}


@pytest.fixture
def work(tmp_path, monkeypatch):
    """A folder with a file of the package's kind; the package is installed."""
    (tmp_path / "installed" / "crates-1.0.dist-info").mkdir(parents=True)
    for name, text in FILES.items():
        (tmp_path / "installed" / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path / "installed")
    (tmp_path / "box.toml").write_text("[crate]\nside = 3.0\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_its_study_is_listed_and_runs(work, capsys):
    assert cli.run(["list"]) == 0
    assert "The area of a crate" in capsys.readouterr().out
    assert cli.run(["run", "crate-area", "--set", "side=5", "--out", "result"]) == 0
    document = json.loads((work / "result" / "results.json").read_text("utf-8"))
    assert document["metrics"]["area_mm2"]["value"] == 25.0


@pytest.mark.parametrize(("named", "side"), [("box.toml", 3.0), ("crate-area", 2.0)])
def test_its_design_is_drawn_and_written(work, named, side):
    assert cli.run(["export", named, *["--to", "svg", "--to", "json", "--out", "drawn"]]) == 0
    stem = named.removesuffix(".toml")
    numbers = json.loads((work / "drawn" / f"{stem}.json").read_text("utf-8"))
    assert numbers["quantities"]["side"]["value"] == side
    assert "<svg" in (work / "drawn" / f"{stem}.svg").read_text("utf-8")


def test_files_to_begin_with_are_written_and_taken(work, capsys):
    assert cli.run(["new", "crate"]) == 0
    assert capsys.readouterr().out == "crate.toml\nnext: designopt explore crate.toml\n"
    assert load_design("crate.toml").model.side == 4.0
    assert cli.run(["new", "crate-area"]) == 0
    settings = work / "crate-area.toml"
    settings.write_text(settings.read_text().replace("side = 2.0", "side = 6.0"))
    command = ["export", "crate-area", "--to", "json", "--config", "crate-area.toml"]
    assert cli.run([*command, "--out", "drawn"]) == 0
    numbers = json.loads((work / "drawn" / "crate-area.json").read_text("utf-8"))
    assert numbers["quantities"]["side"]["value"] == 6.0
    assert load_design("crate-area", ["side=7"], [settings]).model.side == 7.0


def test_its_explorer_shows_it(work):
    explorer = load_design("box.toml").explorer()
    assert explorer.design.title == "box"
    state = show(explorer, {"side": 4.0})
    assert [(one.name, one.value) for one in state.readouts] == [("area", 16.0)]
    [view] = state.panels
    assert isinstance(view, View)
    assert view.drawing.box() == ((0, 0), (4.0, 4.0))
