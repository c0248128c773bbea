"""The example of a study of one's own: its numbers, and what a notebook shows of them."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from designopt import run_study

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_study.py"


@pytest.fixture(scope="module")
def results():
    return run_study(runpy.run_path(str(EXAMPLE))["STUDY"], {"draws": 50})


def rocker_deg(crank_deg: float) -> float:
    """The rocker's angle of the gallery's four-bar, from where two circles meet."""
    ground, crank, coupler, rocker = 100, 40, 120, 80
    pin = crank * np.exp(1j * np.deg2rad(crank_deg))
    away = ground - pin
    along = (coupler**2 - rocker**2 + abs(away) ** 2) / (2 * abs(away))
    across = np.sqrt(coupler**2 - along**2)
    return float(np.rad2deg(np.angle(pin + (along + 1j * across) * away / abs(away) - ground)))


def test_its_slopes_are_those_of_two_circles_that_meet(results):
    [table] = results.tables
    drawn = np.random.default_rng(0).normal(0, 0.5, 50)
    for angle, way, deviation in table.rows:
        slope = (rocker_deg(angle + 1e-3) - rocker_deg(angle - 1e-3)) / 2e-3
        turned = [rocker_deg(angle + error) for error in drawn]
        wanted = {"slope": abs(slope) * np.std(drawn), "draws": np.std(turned)}[way]
        assert deviation == pytest.approx(wanted, rel=1e-6)


def test_fewer_draws_have_no_targets(results):
    assert results.waived == "draws = 50 is less than 1000"
    assert [metric.met for metric in results.metrics] == [None, None]


def test_a_notebook_shows_findings_metrics_figure_and_table(results):
    shown = results._repr_html_()
    assert results.findings[0] in shown
    assert shown.count("data:image/png;base64,") == 1
    cells = re.findall(r'<td class="number">([\d.]+)</td>', shown)
    assert f"{results.metrics[0].value:.6g}" in cells
    assert shown.count("<tr>") >= len(results.tables[0].rows)
