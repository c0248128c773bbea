"""Names of files are drawn and written as they stand there, whatever they would mean elsewhere."""

import csv
import html
import json
import re
import shutil
import xml.etree.ElementTree as ElementTree

import jax
import pytest
from matplotlib.mathtext import MathTextParser

from designopt.cli import run
from designopt.explore.wire import encode_panels
from kinematics import design as linkages
from optics import design as scenes
from tests.designopt.explore.whole import show
from tests.helpers import DATA


@pytest.fixture(autouse=True)
def _in_a_folder_of_files_without_formulas(tmp_path, monkeypatch):
    def parse(_, text, *__, **___):
        raise AssertionError(f"set as a formula: {text}")

    monkeypatch.setattr(MathTextParser, "parse", parse)
    monkeypatch.chdir(tmp_path)
    for name in ("bar.toml", "scene.toml"):
        shutil.copy(DATA / "odd_names" / name, tmp_path)


def drawn(path) -> set[str]:
    """Texts of Matplotlib's SVG, comments beside their glyphs; those with a rim have none."""
    comments = re.findall("<!-- (.*) -->", path.read_text())
    return {html.unescape(text).lstrip("\N{ZERO WIDTH SPACE}") for text in comments}


def test_solve(tmp_path):
    command = ["solve", "bar.toml", "--sweep", "-$t$=40:60:3", "--csv", "t.csv"]
    assert run([*command, "--figure", "t.svg", "--animation", "t.gif"]) == 0
    title, bodies = r"$\frac{$ a_b^c <b>&%", {"+$y$", "_$z_{$", "@r"}
    assert {title, "path of a_b^c, $x$", *bodies} <= drawn(tmp_path / "t.svg")
    with (tmp_path / "t.csv").open(newline="") as file:
        quoted = [name for name in next(csv.reader(file)) if name.startswith("'")]
    assert quoted == ["'-$t$", "'+$y$.angle_deg", "'@r.angle_deg"]


def test_trace_one_angle_and_two(tmp_path):
    command = ["trace", "scene.toml", "--json", "t.json", "--chart", "c.svg", "--force"]
    # Four poses each: they share what is compiled.
    assert run([*command, "--sweep", "$a_{$=0:60:4", "--figure", "t.svg"]) == 0
    assert {r"mirror:$\frac{$", "$a_{$ 20°, %^b$ 0°"} <= drawn(tmp_path / "t.svg")
    assert {"_$x$<b>", r"a_b^c$\frac{$", "$a_{$ (°)"} <= drawn(tmp_path / "c.svg")
    assert run([*command, "--sweep", "$a_{$=0:40:2", "--sweep", "%^b$=0:40:2"]) == 0
    texts = drawn(tmp_path / "c.svg")
    assert {"$a_{$ (°)", "%^b$ (°)"} <= texts
    assert any(text.startswith(r"a_b^c$\frac{$: ") for text in texts)


@pytest.mark.parametrize(
    ("file", "kinds", "name"),
    [
        ("bar.toml", ("svg", "dxf", "json", "mjcf"), "_<b>&%"),
        ("scene.toml", ("svg", "dxf", "json"), "_$x$<b> pad"),
    ],
)
def test_export(file, kinds, name, tmp_path):
    assert run(["export", file, *(f"--to={kind}" for kind in kinds), "--out", "cad"]) == 0
    (svg,) = (tmp_path / "cad").glob("*.svg")
    assert name in {part.text for part in ElementTree.parse(svg).iter()}


@pytest.mark.parametrize(
    ("kind", "file", "name"),
    [(linkages.LINKAGE, "bar.toml", "_<b>&%"), (scenes.SCENE, "scene.toml", "_$x$<b>")],
)
def test_explore(kind, file, name, tmp_path):
    with jax.enable_x64(True):
        explorer = kind.explorer(kind.read(tmp_path / file))
        panels = encode_panels(show(explorer, explorer.values()).panels)
    assert any(name in json.dumps(panel["labels"]) for panel in panels if panel["kind"] == "view")
