"""Tables and figures of a sweep, from outcomes that are known."""

import math
from typing import Any

import numpy as np
import pytest

from designopt.study.results import Metric, Target
from designopt.sweep.outcomes import failed, found
from designopt.sweep.points import grid_points, sobol_points
from designopt.sweep.results import metric_figure, metrics_of, results
from tests.designopt.sweep.plugin import SweptSpec


def metric(name, value, target=None):
    return Metric(name, value, "mm", f"{name} in words", target=target)


def swept(points, *areas, target=None):
    """Points with these areas; where there is none, it failed."""
    outcomes = [
        failed("no area", final=True)
        if area is None
        else found([metric("area", area, target), metric("none", float("nan"))], 2.0, "cpu")
        for area in areas
    ]
    return points, outcomes


def drawn(points, outcomes, name="area") -> Any:
    figure = metric_figure(points, name, metrics_of(outcomes)[name])
    assert figure is not None
    return figure.drawing


GRID = grid_points(SweptSpec, ["x=1:2:2", "wait=0,5"])


def test_tables():
    tables = {table.name: table for table in results(*swept(GRID, 4.0, None, -1.0, 4.0)).tables}
    assert tables["points"].columns == ["point", "x", "wait", "area"]
    assert tables["points"].rows == [
        (0, 1.0, 0.0, 4.0),
        (1, 1.0, 5.0, None),
        (2, 2.0, 0.0, -1.0),
        (3, 2.0, 5.0, 4.0),
    ]
    assert tables["failed"].rows == [(1, 1.0, 5.0, "no area")]
    assert tables["extremes"].rows == [("area", "mm", -1.0, 2, 4.0, 0)]
    assert [row[-1] for row in tables["run_times"].rows] == [2.0, 0.0, 2.0, 2.0]


def test_metrics_that_are_run_times_are_in_the_table_of_run_times_alone():
    points = grid_points(SweptSpec, ["x=1,2"])
    timed = [metric("area", 5.0), Metric("search_seconds", 0.25, "s", "of the search")]
    outcomes = [found(timed, 2.0, "cpu"), failed("no", final=True)]
    tables = {table.name: table for table in results(points, outcomes).tables}
    assert tables["points"].columns == ["point", "x", "area"]
    assert [row[0] for row in tables["extremes"].rows] == ["area"]
    assert tables["run_times"].columns == ["point", "x", "seconds", "search_seconds"]
    assert tables["run_times"].rows == [(0, 1.0, 2.0, 0.25), (1, 2.0, 0.0, None)]


def test_metrics_that_do_not_vary_are_one_sentence():
    points = grid_points(SweptSpec, ["x=1,2,3"])

    def outcome(area):
        found_there = [metric("area", area), metric("gap", 0.25), Metric("bounces", 2, "", "")]
        return found([*found_there, metric("none", math.nan)], 2.0, "cpu")

    swept_all = results(points, [outcome(1.0), failed("no", final=True), outcome(2.0)])
    assert swept_all.findings[1] == (
        "The same at every point that has an answer: gap in words, 0.25 mm; bounces, 2; "
        "none in words, none."
    )
    tables = {table.name: table for table in swept_all.tables}
    assert tables["points"].columns == ["point", "x", "area"]
    assert [row[0] for row in tables["extremes"].rows] == ["area"]
    assert [figure.name for figure in swept_all.figures] == ["area"]
    assert len(results(points, [outcome(1.0)] + 2 * [failed("no", final=True)]).figures) == 3


def test_a_sweep_without_failures_has_no_table_of_them():
    found_all = results(*swept(GRID, 1.0, 2.0, 3.0, 4.0))
    assert [table.name for table in found_all.tables] == ["points", "extremes", "run_times"]
    assert [(one.name, one.met) for one in found_all.metrics] == [
        ("points", None),
        ("failed_points", True),
    ]
    assert [figure.name for figure in found_all.figures] == ["area"]  # of nothing there is none
    assert results(*swept(GRID, 1.0, None, 3.0, 4.0)).unmet
    endless = results(*swept(GRID, math.inf, 2.0, 3.0, 4.0))
    assert endless.tables[0].rows[0][3] == math.inf
    assert [figure.name for figure in endless.figures] == ["area"]
    assert not results(*swept(GRID, *4 * [math.inf])).figures


def test_a_grid_of_two_settings_is_a_map_with_its_numbers():
    target = Target(">=", 2.0)
    axes, bar = drawn(*swept(GRID, 4.0, None, -1.0, 3.0, target=target)).axes
    (mesh,) = axes.collections
    cells = np.ma.masked_invalid(mesh.get_array())
    np.testing.assert_array_equal(cells.mask, [[False, True], [False, False]])
    assert cells.compressed().tolist() == [4.0, -1.0, 3.0]
    assert [text.get_text() for text in axes.texts] == ["4", "–", "-1*", "3"]
    assert (axes.get_ylabel(), axes.get_xlabel()) == ("x (mm)", "wait (s)")
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0", "5"]
    assert axes.get_title() == "target ≥ 2 (* missed); grey: no value"
    assert bar.get_ylabel() == "area (mm)"


def test_one_setting_is_a_curve_that_shows_where_points_failed():
    points = grid_points(SweptSpec, ["x=3,1,2"])
    (axes,) = drawn(*swept(points, 30.0, 10.0, None, target=Target("=", 20.0, 1.0))).axes
    curve, missing, asked = axes.lines
    assert curve.get_xdata().tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(curve.get_ydata(), [10.0, np.nan, 30.0])
    assert missing.get_xdata().tolist() == [2.0]
    assert set(asked.get_ydata()) == {20.0}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (mm)", "area (mm)")


@pytest.mark.parametrize("count", [2, 4])
def test_sobol_points_are_a_panel_per_setting(count):
    texts = ["x=0:1", "wait=0:9", "count=1:8", "fatal=0:1"][:count]
    points = sobol_points(SweptSpec, 8, texts, seed=0)
    panels = [one for one in drawn(*swept(points, *map(float, range(8)))).axes if one.lines]
    assert [axes.get_xlabel() for axes in panels] == list(points.labels)
    for axes, column in zip(panels, np.transpose(points.rows), strict=True):
        (dots,) = axes.lines
        assert dots.get_linestyle() == "None"
        assert set(zip(dots.get_xdata(), dots.get_ydata(), strict=True)) == set(
            zip(column, map(float, range(8)), strict=True)
        )


def test_what_points_do_not_share_is_left_out_of_the_figure():
    points = grid_points(SweptSpec, ["x=1,2"])
    column: list[Metric | None] = [
        Metric("area", 1.0, "mm", "of 1", target=Target(">=", 1)),
        Metric("area", 2.0, "mm", "of 2", target=Target(">=", 2)),
    ]
    figure = metric_figure(points, "area", column)
    assert figure is not None
    assert figure.caption == "area"
    assert len(figure.drawing.axes[0].lines) == 1
