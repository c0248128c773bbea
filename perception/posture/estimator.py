"""A trained network with all it takes to use it, in memory and in a file."""

from __future__ import annotations

import hashlib
import io
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32

from designopt.errors import UserError
from designopt.io.files import replaced_when_complete
from perception.images import checked_floats
from perception.posture.network import MARKERS, PostureNetwork, weight_shapes
from perception.posture.settings import Training, TrainingRecord

FORMAT = "posture estimator 1"
DIGEST = hashlib.sha256().digest_size

NOT_AS_SAVED = ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError
"""What a file raises whose digest is right and whose content is another."""

SCALES = ("image_mean", "image_deviation", "label_scale")

NPY_HEADER = 64
"""Bytes that NumPy's format has before every array, at least."""

LARGEST_WEIGHT = 1e3
"""Weights start at about 1, and a step of Adam moves one by about the learning rate: in a training
of the default settings by some 10 in all, in one that goes wrong by far more."""

WHITE = 255.0
"""Of boundary images: their mean and deviation are no larger."""

FARTHEST = 1e4
"""Markers of a finger are no farther off, mm."""

BLOCK = 256
"""Images predicted at a time: bounds the memory, and one program serves any greater number."""


@dataclass(frozen=True)
class PostureEstimator:
    """Markers from boundary images.

    Attributes:
        network: from a standardised image to standardised markers.
        image_mean: of the training images' pixels, or 0.
        image_deviation: their standard deviation, or 1.
        label_mean: of the training labels, mm.
        label_scale: root mean square of what they are off it, mm; one for all coordinates, so that
            the loss of standardised labels is that of Eq. 4 over its square.
        record: of the training.
    """

    network: PostureNetwork
    image_mean: float
    image_deviation: float
    label_mean: Float[np.ndarray, "3 2"]
    label_scale: float
    record: TrainingRecord

    def predict(
        self, images: Float[np.ndarray, "images rows columns"]
    ) -> Float[np.ndarray, "images 3 2"]:
        """Markers (x, y) relative to the one nearest the camera, mm.

        The first call for a number of images compiles; all above ``BLOCK`` are alike.

        Raises:
            UserError: the images are not of the size of the training's, or not finite floats.
        """
        columns, rows = self.record.image_size
        images = checked_floats(
            images,
            ("number", rows, columns),
            what="a stack of boundary images",
            cure="make them as the training's, with make_boundary_image and shrink",
        )
        inputs = standardised(images, self.image_mean, self.image_deviation)
        return self.label_mean + self.label_scale * answered(self.network, inputs)

    def save(self, path: Path) -> None:
        """Everything in one file, which is complete or not there.

        A line of JSON, the weights (``eqx.tree_serialise_leaves``), and the SHA-256 of both.

        Raises:
            UserError: it cannot be written.
        """
        header = {
            "format": FORMAT,
            "image_mean": self.image_mean,
            "image_deviation": self.image_deviation,
            "label_mean": self.label_mean.tolist(),
            "label_scale": self.label_scale,
            "record": asdict(self.record),
        }
        body = io.BytesIO()
        body.write(json.dumps(header).encode() + b"\n")
        eqx.tree_serialise_leaves(body, self.network)
        content = body.getvalue()
        with replaced_when_complete(path) as partial:
            partial.write_bytes(content + hashlib.sha256(content).digest())

    @classmethod
    def load(cls, path: Path) -> PostureEstimator:
        """What `save` wrote; it predicts the same to the last bit.

        Raises:
            UserError: it cannot be read, is damaged or something else, or holds numbers that no
                training gives.
        """
        try:
            content = path.read_bytes()
        except OSError as error:
            raise UserError(f"{path}: cannot be read: {error.strerror}; choose another") from error
        content, digest = content[:-DIGEST], content[-DIGEST:]
        if hashlib.sha256(content).digest() != digest:
            raise UserError(f"{path}: damaged, or no posture estimator; train and save it anew")
        try:
            body = io.BytesIO(content)
            header = json.loads(body.readline())
            if header.pop("format") != FORMAT:
                raise ValueError("another format")
            header |= {name: float(header[name]) for name in SCALES}
            header["label_mean"] = np.asarray(header["label_mean"], np.float64)
            header["record"] = record = _record(header["record"])
            size, channels = record.image_size, record.settings.channels
            weights = _weights(body, weight_shapes(size, channels))
            if header["label_mean"].shape != (MARKERS, 2) or body.read():
                raise ValueError("not what was saved")
            # Only its structure counts.
            like = PostureNetwork(size, channels, np.random.default_rng())
            network = jax.tree.unflatten(jax.tree.structure(like), map(jnp.asarray, weights))
            loaded = cls(network, **header)
        except NOT_AS_SAVED as error:
            raise UserError(
                f"{path}: written by another version of this program; train and save it anew"
            ) from error
        if not _is_sane(loaded, weights):
            raise UserError(
                f"{path}: its weights or scales are not finite, or far beyond any that a training "
                "gives; train with a lower learning rate, and save it anew"
            )
        return loaded


def _weights(body: io.BytesIO, shapes: list[tuple[int, ...]]) -> list[Float32[np.ndarray, "..."]]:
    """Arrays of known shapes from NumPy's format; no memory is taken for any other.

    Raises:
        ValueError: the file has others.
    """
    sizes = [NPY_HEADER + 4 * math.prod(shape) for shape in shapes]
    if sum(sizes) > len(body.getbuffer()) - body.tell():
        raise ValueError("fewer numbers than the record needs")
    found = []
    for shape in shapes:
        if np.lib.format.read_magic(body) != (1, 0):
            raise ValueError("another version of NumPy's format")
        given = np.lib.format.read_array_header_1_0(body)
        if given != (shape, False, np.dtype(np.float32)):
            raise ValueError("another array")
        found.append(np.frombuffer(body.read(4 * math.prod(shape)), np.float32).reshape(shape))
    return found


def _is_sane(estimator: PostureEstimator, weights: list[Float32[np.ndarray, "..."]]) -> bool:
    """Whether all numbers are finite and no larger than a training makes them."""
    return (
        all(bool((np.abs(array) <= LARGEST_WEIGHT).all()) for array in weights)
        and 0 <= estimator.image_mean <= WHITE
        and 0 < estimator.image_deviation <= WHITE
        and bool((np.abs(estimator.label_mean) <= FARTHEST).all())
        and 0 < estimator.label_scale <= FARTHEST
    )


def standardised(
    images: Float[np.ndarray, "images rows columns"], mean: float, deviation: float
) -> Float32[np.ndarray, "images rows columns"]:
    """Images as a network takes them."""
    return (images.astype(np.float32, copy=False) - np.float32(mean)) / np.float32(deviation)


def answered(
    network: PostureNetwork, inputs: Float32[np.ndarray, "images rows columns"]
) -> Float[np.ndarray, "images 3 2"]:
    """A network's answers to standardised images, block by block."""
    found = np.zeros((len(inputs), MARKERS, 2))
    for start in range(0, len(inputs), BLOCK):
        block = inputs[start : start + BLOCK]
        count = len(block)
        if len(inputs) > BLOCK:
            block = np.pad(block, ((0, BLOCK - count), (0, 0), (0, 0)))
        found[start : start + count] = _answers(network, jnp.asarray(block))[:count]
    return found


def _record(fields: dict) -> TrainingRecord:
    """A record from JSON, which has lists for tuples."""

    def tuples(values: dict) -> dict:
        return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}

    settings = Training(**tuples(fields["settings"]))
    record = TrainingRecord(**{**tuples(fields), "settings": settings})
    lengths = (*record.image_size, *settings.channels)
    if len(record.image_size) != 2 or not all(type(one) is int and one > 0 for one in lengths):
        raise ValueError("no sizes of images and layers")
    return record


@eqx.filter_jit
def _answers(
    network: PostureNetwork, images: Float32[Array, "images rows columns"]
) -> Float32[Array, "images 3 2"]:
    return jax.vmap(network)(images[:, None])
