"""The report: one file, complete, and honest about what was missed."""

import base64
import re

import cv2
import numpy as np
import pytest

from designopt import (
    Claim,
    Figure,
    LeftOutRow,
    Metric,
    PrecisionRow,
    PrecisionStudy,
    Results,
    StabilityRow,
    Study,
    Table,
    Target,
)
from designopt.plot.figures import TEXT_WIDTH, new_figure
from designopt.study.runner import run
from tests.designopt.plugin import SquareSpec
from tests.designopt.tables import cases


def everything(spec, context):
    drawing, axes = new_figure()
    drawing.set_figwidth(TEXT_WIDTH / 2)
    axes[0, 0].plot([1, 2], [3, 4])
    rows = [PrecisionRow("m", f"tolerance {i}", "p", 1e-3, 1.0, 0.9, 1.1, 0.2) for i in range(50)]
    return Results(
        findings=["First.", "Second.", "Δl_D < 4 mm by `chamber.offset_a`."],
        metrics=[
            Metric("good", 1.0, "mm", "a good one", 1.1, Target("<=", 2)),
            Metric("bad", 3.0, "mm", "a bad one", None, Target("<=", 2)),
        ],
        tables=[
            Table("t", "A table", ["x_mm", "word"], [(1 / 3, "w"), (None, "v")], {"x_mm": 2}),
            Table(
                "symbols",
                "Of μ_C",
                ["paper_delta_l_d_cm", "k_s", "met"],
                [(1.0, "see `a_b`", True), (float("nan"), "", False)],
            ),
        ],
        figures=[Figure("drawing", "A drawing", "Its caption.", drawing)],
        precision=PrecisionStudy(
            rows, "error of y", "the truth", [Claim("It is fast.", "It is short.", ["1 s"], False)]
        ),
        stability=[StabilityRow("stiff", "float64", 9, 1, 0, 1e-16, 2e-16, 3e-9, 0)],
        left_out=[LeftOutRow("y", "the loop", 3, 9)],
    )


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "out"
    study = Study("all", "Everything at once", SquareSpec, everything)
    run(study, SquareSpec(side=1.0), seed=0, dtype="float64", out=out, force=False)
    for name in ("drawing", "precision", "stability"):
        assert (out / "figures" / f"{name}.png").is_file()
        assert (out / "figures" / f"{name}.svg").is_file()
    for name in ("t", "symbols", "precision", "stability", "left_out"):
        assert (out / "tables" / f"{name}.csv").is_file()
    return (out / "report.html").read_text(encoding="utf-8")


def test_it_needs_no_other_file(page):
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert sources
    assert all(source.startswith(("data:image/svg+xml;base64,", "#")) for source in sources)
    assert "<script" not in page
    assert page.count("<img") == 3


def test_every_link_has_its_place(page):
    for anchor in re.findall(r'href="#([^"]*)"', page):
        assert f'id="{anchor}"' in page


def test_it_says_what_was_found_and_what_was_missed(page):
    text = " ".join(re.sub(r"<[^>]+>", " ", page).split())
    for words in cases("report"):
        assert words in text


def test_names_and_symbols_are_typeset(page):
    """Plain text outside of ``code`` has no backtick and no underscore."""
    assert "<li>Δl<sub>D</sub> &lt; 4 mm by <code>chamber.offset_a</code>.</li>" in page
    assert '<th class="number">paper Δl<sub>D</sub> (cm)</th>' in page
    assert "<td>see <code>a_b</code></td>" in page
    assert all(f">{word}</td>" in page for word in ("yes", "no"))
    assert ">nan<" not in page
    findings = page.partition('<section id="findings">')[2]
    read = re.sub(r"<code>.*?</code>|<[^>]*>", "", findings)
    assert "`" not in read
    assert "_" not in read


def test_figures_have_the_scale_of_the_text(page):
    """A figure that was trimmed to half the width is shown in half of it."""
    assert page.count('style="width: 100.0%"') == 2
    assert 'style="width: 50.0%"' in page


def test_a_long_table_is_folded(page):
    assert "<summary>50 rows in <code>tables/precision.csv</code>: Error against run" in page


def test_long_tables_and_large_pictures_are_cut(tmp_path):
    def run_large(spec, context):
        drawing, [[axes]] = new_figure(height=4.0)
        noise = np.random.default_rng(0).uniform(size=(900, 900))
        axes.imshow(noise, cmap="gray", interpolation="nearest")
        table = Table("long", "Long", ["row"], [(i,) for i in range(2000)])
        figures = [Figure("noise", "Noise", "", drawing)]
        return Results(findings=[], metrics=[], tables=[table], figures=figures)

    study = Study("large", "Large parts", SquareSpec, run_large)
    run(study, SquareSpec(side=1), seed=0, dtype="float64", out=tmp_path / "out", force=False)
    shown = (tmp_path / "out/report.html").read_text(encoding="utf-8")
    assert shown.count("<td") < 300
    assert 'The first 200 of 2000 rows; all are in <a href="tables/long.csv">' in shown
    [data] = re.findall(r'src="data:image/jpeg;base64,([^"]*)"', shown)
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    written = tmp_path / "out/figures/noise.png"
    assert len(data) < written.stat().st_size
    assert np.mean(np.abs(picture.astype(int) - cv2.imread(str(written)))) < 8
