"""Values between pixels against SciPy's interpolation."""

import numpy as np
import pytest
import scipy.ndimage

from perception.sampling import sampled


@pytest.mark.parametrize("channels", [(), (2,)])
def test_values_are_those_of_scipy(channels):
    """Beyond the border as well, where they are those on it."""
    generator = np.random.default_rng(0)
    image = generator.uniform(0, 1, (30, 40, *channels)).astype(np.float32)
    places = generator.uniform(-3, 42, (20, 25, 2))
    columns, rows = places[..., 0], places[..., 1]

    def expected(channel: np.ndarray) -> np.ndarray:
        return scipy.ndimage.map_coordinates(channel, [rows, columns], order=1, mode="nearest")

    exact = [expected(image[..., i]) for i in range(2)] if channels else [expected(image)]
    found = sampled(image, places).reshape(20, 25, -1)
    # Places are in single precision.
    np.testing.assert_allclose(found, np.stack(exact, axis=-1), atol=1e-5)
