"""Boundary images against a loop over pixels, and small ones against averages of blocks."""

import numpy as np
import pytest

from designopt.errors import UserError
from perception.posture import make_boundary_image, shrink


def brute_force(labels: np.ndarray) -> np.ndarray:
    rows, columns = labels.shape
    edges = np.zeros((rows, columns), np.uint8)
    for row in range(rows):
        for column in range(columns):
            for r, c in ((row, column + 1), (row + 1, column)):
                if r < rows and c < columns and labels[r, c] != labels[row, column]:
                    edges[row, column] = 255
    return edges


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (13, 17), (24, 32)])
def test_as_pixel_by_pixel(shape):
    labels = np.random.default_rng(0).integers(0, 3, shape, np.uint8)
    np.testing.assert_array_equal(make_boundary_image(labels), brute_force(labels))


def test_shrunk_averages_blocks_of_thicker_lines():
    boundary = np.zeros((12, 20), np.uint8)
    boundary[:, 9] = 255
    thick = np.zeros(boundary.shape)
    thick[:, 8:11] = 255
    blocks = thick.reshape(3, 4, 5, 4).mean(axis=(1, 3))
    small = shrink(boundary, (5, 3))
    assert small.dtype == np.float32
    np.testing.assert_allclose(small, blocks, rtol=1e-6)


@pytest.mark.parametrize("size", [(0, 3), (21, 3), (5, 13)])
def test_a_size_that_is_not_smaller_is_refused(size):
    with pytest.raises(UserError, match=f"20x12 px cannot be shrunk to {size[0]}x{size[1]}"):
        shrink(np.zeros((12, 20), np.uint8), size)
