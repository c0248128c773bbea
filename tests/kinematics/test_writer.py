"""Linkages written and read again."""

from __future__ import annotations

import tomllib

import equinox as eqx
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from designopt import UserError
from kinematics import format_linkage, parse_linkage, read_linkage, write_linkage
from tests.helpers import assert_same
from tests.kinematics.gallery import (
    FOUR_BAR,
    NAMES,
    each_linkage,
    gallery,
    pin_in_two_slots,
    tables_of,
)

ITERATED = {"double-butterfly", "stephenson"}
"""Compile for ten and for thirty seconds."""


def assert_read_back(linkage, again):
    """But an angle of π may come back as −π."""
    angles = again.reference.angles
    turns = np.round((linkage.reference.angles - angles) / (2 * np.pi))
    turned = eqx.tree_at(lambda one: one.reference.angles, again, angles + 2 * np.pi * turns)
    assert_same(linkage, turned, rtol=1e-10, atol=1e-9)


@each_linkage(quick=sorted({*NAMES} - ITERATED))
def test_the_gallery_is_read_back(name, tmp_path):
    linkage = gallery(name)
    write_linkage(linkage, tmp_path / "again.toml")
    assert_read_back(linkage, read_linkage(tmp_path / "again.toml"))


places = st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))


@st.composite
def sketches(draw) -> dict:
    """A crank and dyads on joints of what is there already; some sliders, springs and places.

    Every link is at least 5 mm long, and no dyad nearly stretched: such ones choose no assembly.
    """
    joints: dict[str, tuple[float, float]] = {"O": (0.0, 0.0), "Q": (60.0, 0.0), "A": (10.0, 25.0)}
    bodies: dict[str, dict] = {
        "ground": {"joints": ["O", "Q"], "fixed": True},
        "crank": {"joints": ["O", "A"]},
    }
    sliders, moving = [], ["A"]
    for number in range(draw(st.integers(1, 3))):
        pin, other = f"B{number}", draw(st.sampled_from(["O", "Q"]))
        driven = draw(st.sampled_from(moving))
        joints[pin] = draw(places)
        first, second = (np.subtract(joints[pin], joints[end]) for end in (driven, other))
        lengths = np.hypot(*first), np.hypot(*second)
        assume(min(lengths) > 5)
        bodies[f"link{number}"] = {"joints": [driven, pin]}
        if draw(st.booleans()):
            x, y = joints[pin]
            assume(abs(first[0]) > 0.2 * lengths[0])  # not square to its line
            line = [[x - 40.0, y], [x + 40.0, y]]
            sliders.append({"joint": pin, "on": "ground", "line": line})
        else:
            assume(abs(first[0] * second[1] - first[1] * second[0]) > 0.2 * np.prod(lengths))
            bodies[f"rocker{number}"] = {"joints": [other, pin]}
        moving.append(pin)
    tables = {
        "linkage": {"name": draw(st.sampled_from(["drawn", "Zeichnung 1", "α–β"]))},
        "joints": {name: list(place) for name, place in joints.items()},
        "bodies": bodies,
        "inputs": [{"name": "crank", "body": "crank", "relative_to": "ground"}],
    }
    if sliders:
        tables["sliders"] = sliders
    if draw(st.booleans()):
        stiffness, preload = draw(st.floats(0.1, 1e3)), draw(st.floats(-1.5, 1.5))
        between = ["crank", "link0"]
        spring = {"between": between, "stiffness": stiffness, "preload": preload}
        tables["springs"] = [spring]
    return tables


@settings(max_examples=10)
@given(sketches())
def test_what_is_written_is_read_back(drawn):
    linkage = parse_linkage(drawn, "drawn")
    text = format_linkage(linkage)
    assert_read_back(linkage, parse_linkage(tomllib.loads(text), "again"))


@pytest.mark.parametrize("line", ["arm", "ground", "world"])
def test_a_joint_on_two_lines_is_driven_along_the_same_one(line):
    tables = pin_in_two_slots(20.0)
    tables["inputs"] = [{"name": "push", "slider": "P", "relative_to": line}]
    linkage = parse_linkage(tables, "slots")
    assert_read_back(linkage, parse_linkage(tomllib.loads(format_linkage(linkage)), "again"))


@pytest.mark.parametrize("pin", ["A", "B"])
def test_joints_of_a_body_in_one_place_stay_together(pin):
    joints = {"O2": [0, 0], "A": [30, 26], "B": [143, 67], "O4": [100, 0]}
    bodies = FOUR_BAR | {"coupler": "A B M"}
    linkage = parse_linkage(tables_of(joints | {"M": joints[pin]}, "O2 O4", bodies), "twin")
    for _ in range(2):  # what is read back has them in one place to rounding only
        again = parse_linkage(tomllib.loads(format_linkage(linkage)), "again")
        assert_read_back(linkage, again)
        linkage = again


def test_a_linkage_that_cannot_be_assembled_is_not_written(tmp_path):
    linkage = gallery("four-bar")
    short = eqx.tree_at(lambda one: one.links["coupler"].length, linkage, 1.0)
    with pytest.raises(UserError, match=r"^four-bar: it cannot be written: "):
        write_linkage(short, tmp_path / "short.toml")
    assert not (tmp_path / "short.toml").exists()
