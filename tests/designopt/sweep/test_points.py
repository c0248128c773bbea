"""Which points are swept, in which order, and what is said of faulty ranges."""

import collections
import itertools
import re
from typing import Annotated

import numpy as np
import pytest
from pydantic import Field
from scipy.stats import qmc

from designopt import UserError
from designopt.io.spec import Spec
from designopt.study.study import load_study
from designopt.sweep.points import grid_points, sobol_points
from tests.commands import refused_cases
from tests.designopt.sweep.plugin import SweptSpec


def test_a_grid_has_all_combinations_the_last_key_changing_fastest():
    points = grid_points(SweptSpec, ["x=0:1:3", "wait=7,5"])
    assert points.keys == ("x", "wait")
    assert points.labels == ("x (mm)", "wait (s)")
    assert points.rows == tuple(itertools.product((0.0, 0.5, 1.0), (7.0, 5.0)))
    assert points.grid == ((0.0, 0.5, 1.0), (7.0, 5.0))
    assert points.assignments(1) == ("x=0.0", "wait=5.0")
    assert points.definition == {"grid": {"x": [0.0, 0.5, 1.0], "wait": [7.0, 5.0]}}


def test_whole_values_of_an_integer_setting_are_integers():
    points = grid_points(SweptSpec, ["count=1:2:3"])
    assert points.rows == ((1,), (1.5,), (2,))  # the one in between is a fault of its point
    assert points.assignments(2) == ("count=2",)
    assert grid_points(SweptSpec, ["fatal=1:3:3"]).rows == ((1.0,), (2.0,), (3.0,))


class Inner(Spec):
    whole: Annotated[int, Field(ge=1)] | None = None


class Outer(Spec):
    real: float = 1  # written without a point
    inner: Inner = Inner()


def test_what_a_setting_is_says_its_type_and_not_its_default():
    assert repr(grid_points(Outer, ["real=1,2"]).rows) == "((1.0,), (2.0,))"
    assert repr(grid_points(Outer, ["inner.whole=1,2"]).rows) == "((1,), (2,))"


def test_sobol_points_of_an_integer_setting_have_every_value_as_often():
    sobol = sobol_points(SweptSpec, 64, ["count=1:8"], seed=0)
    drawn = collections.Counter(row[0] for row in sobol.rows)
    assert drawn == dict.fromkeys(range(1, 9), 8)
    assert {type(value) for value in drawn} == {int}


def test_sobol_points_are_scipys_between_the_bounds():
    points = sobol_points(SweptSpec, 6, ["x=-1:1", "wait=2:6"], seed=3)
    unit = qmc.Sobol(2, rng=np.random.default_rng(3)).random_base2(3)[:6]
    np.testing.assert_allclose(points.rows, qmc.scale(unit, [-1, 2], [1, 6]), rtol=1e-15)
    assert points.grid is None
    assert points.rows == sobol_points(SweptSpec, 6, ["x=-1:1", "wait=2:6"], seed=3).rows
    assert points.rows != sobol_points(SweptSpec, 6, ["x=-1:1", "wait=2:6"], seed=4).rows


@pytest.mark.parametrize(("texts", "words"), refused_cases("grid_points"))
def test_faulty_grids_are_told(texts, words):
    with pytest.raises(UserError, match=re.escape(words)):
        grid_points(SweptSpec, texts)


@pytest.mark.parametrize(("given", "words"), refused_cases("sobol_points"))
def test_faulty_bounds_are_told(given, words):
    with pytest.raises(UserError, match=re.escape(words)):
        sobol_points(SweptSpec, given[0], given[1:], seed=0)


def test_an_angle_has_the_sign_of_degrees():
    spec = load_study("table1").spec
    points = grid_points(spec, ["chamber.wall_angle_bc_deg=1:2:2"])
    assert points.labels == ("chamber.wall_angle_bc_deg (°)",)
