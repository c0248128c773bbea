"""Names of files are drawn and written as they stand there, whatever they would mean elsewhere."""

import csv
import html
import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.mathtext import MathTextParser

from designopt.cli import run
from designopt.plot.figures import style
from kinematics import design as linkages
from optics import design as scenes

LINKAGE = r"""
[linkage]
name = '$\frac{$ a_b^c <b>&%'
[joints]
'$\frac{$' = [0, 0]
'a_b^c' = [30, 26]
'$x$' = [143, 67]
'_<b>&%' = [100, 0]
[bodies.'%&<i>']
joints = ['$\frac{$', '_<b>&%']
fixed = true
[bodies.'+$y$']
joints = ['$\frac{$', 'a_b^c']
[bodies.'_$z_{$']
joints = ['a_b^c', '$x$']
[bodies.'@r']
joints = ['_<b>&%', '$x$']
[[inputs]]
name = '-$t$'
body = '+$y$'
relative_to = '%&<i>'
"""

SCENE = r"""
[scene]
name = '$\frac{$ a_b^c <b>&%'
[camera]
position = [15.75, 16.99]
direction_deg = -96.3
fov_deg = 160
pixels = 1080
projection = 'equidistant'
[[mirrors]]
name = '$\frac{$'
from = [23.24, 19.04]
to = [53.81, 0.34]
side = 'right'
body = 'd$i$'
[[pads]]
name = '_$x$<b>'
from = [4, -4]
to = [19, -4]
side = 'left'
[[pads]]
name = 'a_b^c$\frac{$'
from = [27, -4]
to = [53.5, -4]
side = 'left'
body = 'd$i$'
[[blockers]]
name = '&%$\frac{$'
body = 'lid'
from = [11.8, 17.9]
to = [19.7, 17.0]
[frames.'d$i$']
hinge = [23, 0]
angle = '$a_{$'
positive = 'clockwise'
[frames.lid]
hinge = [0, 0]
angle = '%^b$'
positive = 'clockwise'
"""


@pytest.fixture(autouse=True)
def _in_a_folder_of_files_without_formulas(tmp_path, monkeypatch):
    def parse(_, text, *__, **___):
        raise AssertionError(f"set as a formula: {text}")

    monkeypatch.setattr(MathTextParser, "parse", parse)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bar.toml").write_text(LINKAGE)
    (tmp_path / "scene.toml").write_text(SCENE)


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
        head = next(csv.reader(file))
    assert [name for name in head if name.startswith("'")] == [
        "'-$t$",
        "'+$y$.angle_deg",
        "'@r.angle_deg",
    ]


def test_a_map_of_two_angles(tmp_path):
    sweeps = ["--sweep", "$a_{$=0:40:3", "--sweep", "%^b$=0:40:3"]
    assert run(["trace", "scene.toml", *sweeps, "--json", "t.json", "--chart", "c.svg"]) == 0
    texts = drawn(tmp_path / "c.svg")
    assert {"$a_{$ (°)", "%^b$ (°)"} <= texts
    assert any(text.startswith(r"a_b^c$\frac{$: ") for text in texts)


def test_trace(tmp_path):
    command = ["trace", "scene.toml", "--sweep", "$a_{$=0:40:3", "--json", "t.json"]
    assert run([*command, "--figure", "t.svg", "--chart", "c.svg"]) == 0
    assert {r"mirror:$\frac{$", "$a_{$ 20°, %^b$ 0°"} <= drawn(tmp_path / "t.svg")
    assert {"_$x$<b>", r"a_b^c$\frac{$", "$a_{$ (°)"} <= drawn(tmp_path / "c.svg")


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
    assert name in {
        part.text for part in ElementTree.parse(svg).iter() if part.tag.endswith("}text")
    }


@pytest.mark.parametrize(
    ("kind", "file"), [(linkages.LINKAGE, "bar.toml"), (scenes.SCENE, "scene.toml")]
)
def test_explore(kind, file, tmp_path):
    bench = kind.explorer(kind.read(tmp_path / file))
    figure = Figure(figsize=(12, 6))
    canvas = FigureCanvasAgg(figure)
    area: Any = figure.subfigures(1, 1)
    with style():
        bench.draw(area)
        shown = bench.show({knob.name: knob.value for knob in bench.knobs})
        for artist in shown.artists:
            artist.set_animated(False)
        canvas.draw()
