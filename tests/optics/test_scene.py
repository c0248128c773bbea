"""Scenes placed in a pose against complex numbers; neither unit nor origin matters."""

import cmath

import jax
import numpy as np
import pytest

from optics.scene.scene import place
from tests.optics.scenes import (
    Case,
    answers,
    case_of,
    item,
    pairs,
    posed_cases,
    random_cases,
    scene_of,
)

ROUNDING = 1e-14
"""Of a few rotations, relative to the size of the scene."""

FAR_AWAY = 100_000_000.0
GRAIN = 2.0**-20
"""Multiples of this can be moved `FAR_AWAY` without rounding."""

UNITS = 2.0**-498, 2.0**498
"""About 1e-150 and its reciprocal: a scene can be scaled by a power of two without rounding."""

LENGTHS = ("ends", "position", "hinges")
"""Fields of a case that are measured in mm."""


@jax.jit
def placed(cases: Case) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Ends of all surfaces, position of the camera and its axis, of a batch."""

    def one(case: Case) -> tuple[jax.Array, jax.Array, jax.Array]:
        found = place(scene_of(case), case.angles)
        ends = [found.absolute(end).stacked() for end in (found.starts, found.ends)]
        return (
            jax.numpy.stack(ends, 1),
            found.absolute(found.camera).stacked(),
            found.axis.stacked(),
        )

    return jax.vmap(one)(cases)


def test_surfaces_and_camera_go_where_complex_numbers_turn_them():
    cases = random_cases(1, 20)
    ends, position, axis = placed(cases)
    for i, case in enumerate(posed_cases(cases)):
        np.testing.assert_allclose(ends[i], pairs(case.ends), atol=ROUNDING)
        np.testing.assert_allclose(position[i], pairs(case.position), atol=ROUNDING)
        ahead = cmath.rect(1, case.direction)
        np.testing.assert_allclose(axis[i], [ahead.real, ahead.imag], atol=ROUNDING)


def test_poses_are_given_by_name():
    scene = scene_of(item(random_cases(0, 1), 0))
    assert scene.angle_names == ("bend", "curl")
    np.testing.assert_array_equal(scene.pose(), [0, 0])
    np.testing.assert_array_equal(scene.pose({"curl": 0.5}), [0, 0.5])
    with pytest.raises(KeyError, match="no joint angle is named twist"):
        scene.pose({"bend": 0.1, "twist": 0.2})


def test_a_scene_without_extent_is_placed_all_the_same():
    case = case_of((3.0, 4.0))
    ends, position, _ = placed(jax.tree.map(lambda leaf: leaf[None], case))
    np.testing.assert_array_equal(ends, np.broadcast_to([3.0, 4.0], ends.shape))
    np.testing.assert_array_equal(position, [[3, 4]])


def changed(cases: Case, function) -> Case:
    """Cases with their lengths changed."""
    return cases._replace(**{name: function(getattr(cases, name)) for name in LENGTHS})


def rounded(cases: Case) -> Case:
    return changed(cases, lambda lengths: GRAIN * np.round(lengths / GRAIN))


def test_far_away_everything_looks_the_same():
    here = rounded(random_cases(2, 100))
    there = changed(here, lambda lengths: lengths + FAR_AWAY)
    found, wanted = answers(there), answers(here)
    assert (wanted.numbers["coverage"] > 0).any()
    for name, number in wanted.numbers.items():
        np.testing.assert_array_equal(found.numbers[name], number, err_msg=name)
    np.testing.assert_array_equal(found.ok, wanted.ok)


@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_of_length_does_not_matter(unit):
    cases = random_cases(3, 96)
    found, wanted = answers(changed(cases, lambda lengths: unit * lengths)), answers(cases)
    assert (wanted.numbers["coverage"] > 0).any()
    scales = {"distance": unit, "px_per_mm": 1 / unit}
    for name, number in wanted.numbers.items():
        scaled = scales.get(name, 1.0) * number
        np.testing.assert_array_equal(found.numbers[name], scaled, err_msg=name)
