"""Medians against NumPy's."""

import numpy as np
import pytest

from perception.medians import Medians, median


@pytest.mark.parametrize("count", [1, 4, 7])
def test_the_median_is_that_of_numpy(count):
    values = np.random.default_rng(2).integers(0, 255, (5, 3, count), np.uint8)
    np.testing.assert_array_equal(median(values), np.median(values, axis=-1))


@pytest.mark.parametrize("shape", [(6, 9), (4, 5, 8)])
def test_medians_are_those_of_the_values_that_are_there(shape):
    generator = np.random.default_rng(3)
    values = generator.standard_normal(shape)
    there = generator.random(shape) < np.linspace(0, 1, shape[-2])[:, None]
    there[..., 1, :] = np.arange(shape[-1]) == 2
    expected = [
        np.median(one[own]) if own.any() else 0.0
        for one, own in zip(
            values.reshape(-1, shape[-1]), there.reshape(-1, shape[-1]), strict=True
        )
    ]
    medians = Medians(there)
    np.testing.assert_array_equal(medians.of(values).ravel(), expected)
    np.testing.assert_array_equal(medians.none, ~there.any(axis=-1))
