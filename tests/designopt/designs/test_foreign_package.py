"""A study and a kind of design offered by a package outside the project, from its wheel."""

import base64
import hashlib
import json
import os
import subprocess
import sys
import zipfile

import pytest

MODULE = """
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from designopt import Metric, Results, Spec, Study
from designopt.design_kind import Design, DesignKind
from designopt.explore.bench import Bench, Knob, Reading, Shown
from designopt.export.json import Quantity
from designopt.export.drawing import Drawing, Layer, Polyline
from designopt.io.files import read_toml


@dataclass(frozen=True)
class Crate:
    name: str
    side: float


class CrateBench(Bench):
    aim = ""

    def __init__(self, crate):
        self.title = crate.name
        self.knobs = (Knob("side", crate.side, 1.0, 9.0, "mm", "dimension"),)

    def draw(self, area):
        self.axes = area.subplots()

    def show(self, values):
        (line,) = self.axes.plot([0, values["side"]], [0, 0])
        return Shown([Reading("area", values["side"] ** 2, "mm²")], [line])

    def specs(self, values):
        return []

    def optimise(self, values):
        return iter(())


def read(path):
    table = read_toml(path, "crate")["crate"]
    return Crate(path.stem, table["side"])


def drawing(crate):
    corners = [(0, 0), (crate.side, 0), (crate.side, crate.side), (0, crate.side)]
    return Drawing(crate.name, [Layer("walls", "body")], [Polyline("walls", corners, closed=True)])


KIND = DesignKind(
    "crate", "crate", read, CrateBench, drawing, lambda c: [Quantity("side", c.side, "mm")]
)


class CrateSpec(Spec):
    side: float = Field(default=2.0, description="of the crate (mm)")


def run(spec, context):
    return Results(["A crate."], [Metric("area_mm2", spec.side**2, "mm²", "area")])


STUDY = Study(
    "crate-area", "The area of a crate", CrateSpec, run,
    design=lambda spec, folder: Design(KIND, Crate("crate-area", spec.side)),
)
"""

FILES = {
    "crates.py": MODULE,
    "crates-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: crates\nVersion: 1.0\n",
    "crates-1.0.dist-info/WHEEL": (
        "Wheel-Version: 1.0\nGenerator: by hand\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    ),
    "crates-1.0.dist-info/entry_points.txt": (
        "[designopt.studies]\ncrate-area = crates:STUDY\n\n"
        "[designopt.designs]\ncrate = crates:KIND\n"
    ),
}

SHOWN = """
import matplotlib.figure
from designopt.designs import load_design
bench = load_design("box.toml").explorer()
bench.draw(matplotlib.figure.Figure().subfigures(1, 1))
print(bench.title, [(one.name, one.value) for one in bench.show({"side": 4.0}).readings])
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Where the package's wheel is installed, and a file of its kind."""
    folder = tmp_path_factory.mktemp("foreign")
    wheel = folder / "crates-1.0-py3-none-any.whl"
    record = "".join(
        f"{name},sha256={_digest(text)},{len(text.encode())}\n" for name, text in FILES.items()
    )
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in (FILES | {"crates-1.0.dist-info/RECORD": record}).items():
            archive.writestr(name, text)
    installed = folder / "installed"
    subprocess.run(
        [
            *(sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index"),
            *("--disable-pip-version-check", "--target", str(installed), str(wheel)),
        ],
        check=True,
    )
    work = folder / "work"
    work.mkdir()
    (work / "box.toml").write_text("[crate]\nside = 3.0\n")
    paths = os.pathsep.join(filter(None, [str(installed), os.environ.get("PYTHONPATH")]))
    return work, {**os.environ, "PYTHONPATH": paths}


def _digest(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode()


def ran(environment, *words: str) -> str:
    folder, variables = environment
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_its_study_is_listed_and_runs(environment):
    assert "The area of a crate" in ran(environment, "-m", "designopt", "list")
    ran(environment, "-m", "designopt", "run", "crate-area", "--set", "side=5", "--out", "result")
    document = json.loads((environment[0] / "result" / "results.json").read_text("utf-8"))
    assert document["metrics"]["area_mm2"]["value"] == 25.0


@pytest.mark.parametrize("named", ["box.toml", "crate-area"])
def test_its_design_is_drawn_and_written(environment, named):
    words = ("--to", "svg", "--to", "json", "--out", "drawn")
    ran(environment, "-m", "designopt", "export", named, *words)
    stem = named.removesuffix(".toml")
    numbers = json.loads((environment[0] / "drawn" / f"{stem}.json").read_text("utf-8"))
    assert numbers["quantities"]["side"]["value"] == (3.0 if stem == "box" else 2.0)
    assert "<svg" in (environment[0] / "drawn" / f"{stem}.svg").read_text("utf-8")


def test_its_explorer_shows_it(environment):
    assert ran(environment, "-c", SHOWN) == "box [('area', 16.0)]\n"
