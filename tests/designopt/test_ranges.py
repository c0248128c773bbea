"""Values on the command line: grids in their order, and what is said of faulty ones."""

import itertools
import re

import numpy as np
import pytest

from designopt import UserError
from designopt.io.ranges import ends_of, grid_of, single_values, split_name, values_of
from tests.commands import refused_cases

ANGLES = {"pip": True, "dip": True, "slide": False}


def test_the_last_name_changes_fastest_in_the_order_of_the_names():
    texts = ["slide=-1", "dip=5:6:2", "pip=0:90:3"]
    wanted = list(itertools.product([0, 45, 90], [5, 6], [-1]))
    np.testing.assert_array_equal(grid_of(texts, "--sweep", ANGLES, "input"), wanted)


def test_what_is_not_swept_has_its_default():
    defaults = {"pip": -10.0, "dip": 20.0}
    grid = grid_of(["dip=1:2:2", "slide=0"], "--sweep", ANGLES, "joint angle", defaults)
    np.testing.assert_array_equal(grid, [[-10, 1, 0], [-10, 2, 0]])


def test_a_grid_may_have_more_axes_than_an_array():
    many = {f"joint{i}": True for i in range(100)}
    texts = [f"{name}=0:1:2" if name in ("joint3", "joint70") else f"{name}=5" for name in many]
    grid = grid_of(texts, "--sweep", many, "joint angle")
    assert grid.shape == (4, 100)
    assert grid[:, [3, 70]].tolist() == [[0, 0], [0, 1], [1, 0], [1, 1]]
    with pytest.raises(UserError, match=r"a grid of 1e400 poses is too large"):
        grid_of([f"{name}=0:1:10000" for name in many], "--sweep", many, "joint angle")


def test_without_names_there_is_one_pose():
    assert grid_of([], "--sweep", {}, "joint angle").shape == (1, 0)


@pytest.mark.parametrize(("texts", "words"), refused_cases("grid_of"))
def test_faulty_sweeps_are_told(texts, words):
    with pytest.raises(UserError, match=re.escape(words)) as raised:
        grid_of(texts, "--joint", ANGLES, "joint angle")
    assert str(raised.value).startswith("--joint")


def test_single_values():
    assert single_values([], "--rate", ANGLES, "input") == {}
    given = single_values(["dip=-2", "slide=1e-3"], "--rate", ANGLES, "input")
    assert given == {"dip": -2.0, "slide": 0.001}


@pytest.mark.parametrize(("texts", "words"), refused_cases("single_values"))
def test_faulty_single_values_are_told(texts, words):
    with pytest.raises(UserError, match=re.escape(words)):
        single_values(texts, "--rate", ANGLES, "input")


def test_parts_of_a_text():
    assert split_name("crank=1=2", "--set", "X=Y") == ("crank", "1=2")
    assert values_of("0:1:3", "--vary", "KEY").tolist() == [0.0, 0.5, 1.0]
    assert values_of("3,1", "--vary", "KEY").tolist() == [3.0, 1.0]
    assert values_of("3", "--vary", "KEY").tolist() == [3.0]
    assert ends_of("-1:2.5", "--sobol", "KEY") == (-1.0, 2.5)


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (lambda: grid_of(["pip=1"], "--sweep", {}, "joint angle"), "'pip'; there are: none$"),
        (lambda: split_name("=1", "--vary =1", "KEY=X"), "--vary =1: write it as KEY=X$"),
        (lambda: values_of("1:2", "--vary", "KEY"), "KEY=START:STOP:COUNT or KEY=VALUE,VALUE,…$"),
        (lambda: values_of("1,", "--vary", "KEY"), "'' is not a finite number"),
        (lambda: ends_of("1", "--sobol", "KEY"), "--sobol: write it as KEY=LOW:HIGH$"),
        (lambda: ends_of("1:1", "--sobol", "KEY"), "LOW must be smaller than HIGH"),
    ],
)
def test_faulty_parts_are_told(read, words):
    with pytest.raises(UserError, match=words):
        read()
