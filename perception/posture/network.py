"""The network from a boundary image to three markers, and its loss.

Source: paper A, *Vision-Based Tactile Perception for Soft Robotic Hand*, §III.A: four convolutions
of 3x3 without pooling, ReLU, one fully connected layer. That the convolutions have stride 2, in
place of pooling, and these channels, is a reading.
"""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

MARKERS = 3
SIDE, STRIDE, PADDING = 3, 2, 1
CHANNELS = (8, 16, 32, 32)
"""Of the convolutions: a reading."""


class Convolution(eqx.Module):
    """A 3x3 convolution of stride 2, zeros around the image, as a product of two matrices.

    On the CPU, XLA's own convolution and its derivatives take twenty times as long as patches
    that are copied together and multiplied.

    Attributes:
        weight: by row and column of the patch, channel in, and channel out.
        bias: of the channels out.
    """

    weight: Float[Array, "3 3 channels_in channels_out"]
    bias: Float[Array, " channels_out"]

    def __init__(self, channels_in: int, channels_out: int, generator: np.random.Generator) -> None:
        # Keeps the size of what passes ReLUs: K. He et al., ICCV 2015, eq. 10.
        shape = (SIDE, SIDE, channels_in, channels_out)
        spread = math.sqrt(2 / (SIDE * SIDE * channels_in))
        self.weight = jnp.asarray(spread * generator.standard_normal(shape), jnp.float32)
        self.bias = jnp.zeros(channels_out, jnp.float32)

    def __call__(
        self, image: Float[Array, "rows columns channels_in"]
    ) -> Float[Array, "_rows _columns channels_out"]:
        """Half as many rows and columns, rounded up."""
        rows, columns = halved(image.shape[0]), halved(image.shape[1])
        around = jnp.pad(image, ((PADDING, PADDING), (PADDING, PADDING), (0, 0)))
        shifted = [
            around[
                row : row + STRIDE * rows - 1 : STRIDE, col : col + STRIDE * columns - 1 : STRIDE
            ]
            for row in range(SIDE)
            for col in range(SIDE)
        ]
        patches = jnp.concatenate(shifted, axis=-1).reshape(rows * columns, -1)
        out = patches @ self.weight.reshape(patches.shape[1], -1) + self.bias[None, :]
        return out.reshape(rows, columns, -1)


class PostureNetwork(eqx.Module):
    """Three markers from one boundary image.

    Attributes:
        convolutions: each followed by a ReLU.
        weight: of the fully connected layer, by value of the last convolution and coordinate.
        bias: of the coordinates.
    """

    convolutions: tuple[Convolution, ...]
    weight: Float[Array, "features coordinates"]
    bias: Float[Array, " coordinates"]

    def __init__(
        self,
        image_size: tuple[int, int],
        channels: tuple[int, ...],
        generator: np.random.Generator,
    ) -> None:
        """A network with random convolutions that answers zero, float32.

        Args:
            image_size: columns and rows.
            channels: that every convolution gives.
            generator: of the random weights; NumPy's, for JAX would compile for every layer.
        """
        columns, rows = image_size
        layers, before = [], 1
        for after in channels:
            layers.append(Convolution(before, after, generator))
            columns, rows, before = halved(columns), halved(rows), after
        self.convolutions = tuple(layers)
        # From zero, its first answer is the mean of the labels: a third of the error less.
        self.weight = jnp.zeros((rows * columns * before, 2 * MARKERS), jnp.float32)
        self.bias = jnp.zeros(2 * MARKERS, jnp.float32)

    def __call__(self, image: Float[Array, "1 rows columns"]) -> Float[Array, "3 2"]:
        """Markers (x, y) as the training standardised them, from a standardised image."""
        values = jnp.moveaxis(image, 0, -1)
        for convolution in self.convolutions:
            values = jax.nn.relu(convolution(values))
        return (values.reshape(-1) @ self.weight + self.bias).reshape(MARKERS, 2)

    def squared_weights(self) -> Float[Array, ""]:
        """Sum of all weights' squares, biases left out: what L2 regularisation keeps small."""
        total = jnp.sum(self.weight**2)
        for convolution in self.convolutions:
            total = total + jnp.sum(convolution.weight**2)
        return total


def weight_shapes(image_size: tuple[int, int], channels: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Shapes of a network's arrays in the order of its leaves, which are made for none of them."""
    columns, rows = image_size
    shapes: list[tuple[int, ...]] = []
    for before, after in zip((1, *channels), channels, strict=False):
        shapes += [(SIDE, SIDE, before, after), (after,)]
        columns, rows = halved(columns), halved(rows)
    return [*shapes, (rows * columns * channels[-1], 2 * MARKERS), (2 * MARKERS,)]


def halved(length: int) -> int:
    """What a convolution leaves of rows or columns: half, rounded up."""
    return (length + 2 * PADDING - SIDE) // STRIDE + 1


def compute_weighted_loss(
    predicted: Float[Array, "images 3 2"],
    markers: Float[Array, "images 3 2"],
    loss_weights: Float[Array, "3"],
) -> Float[Array, ""]:
    """Paper A, Eq. 4: the mean over images of Σᵢ βᵢ ((xᵢ − x̂ᵢ)² + (yᵢ − ŷᵢ)²), mm² if these are mm.

    Args:
        predicted: the network's markers.
        markers: the true ones.
        loss_weights: βᵢ.

    Example:
        >>> float(
        ...     compute_weighted_loss(
        ...         jnp.zeros((1, 3, 2)), jnp.ones((1, 3, 2)), jnp.array([0.5, 1.0, 1.5])
        ...     )
        ... )
        6.0
    """
    squares = jnp.sum((predicted - markers) ** 2, axis=-1)
    return jnp.mean(squares @ loss_weights)
