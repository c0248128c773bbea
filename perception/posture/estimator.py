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
from designopt.files import replaced_when_complete
from perception.images import checked_floats
from perception.posture.network import MARKERS, PostureNetwork
from perception.posture.settings import Training, TrainingRecord

FORMAT = "posture estimator 1"
DIGEST = hashlib.sha256().digest_size

SCALES = ("image_mean", "image_deviation", "label_scale")

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
            cure="make them as the training's, with boundary_image and shrunk",
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
            UserError: it cannot be read, is damaged, or is something else.
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
            header["label_mean"] = np.asarray(header["label_mean"], np.float64)
            header["record"] = record = _record(header["record"])
            # Only its shapes count.
            like = PostureNetwork(
                record.image_size, record.settings.channels, np.random.default_rng()
            )
            network = eqx.tree_deserialise_leaves(body, like)
            scales = [float(header[name]) for name in SCALES]
            if (
                header["label_mean"].shape != (MARKERS, 2)
                or body.read()
                or not all(map(math.isfinite, scales))
            ):
                raise ValueError("not what was saved")
            return cls(network, **header)
        except (AttributeError, KeyError, TypeError, ValueError, RuntimeError) as error:
            raise UserError(
                f"{path}: written by another version of this program; train and save it anew"
            ) from error


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
    return TrainingRecord(**{**tuples(fields), "settings": settings})


@eqx.filter_jit
def _answers(
    network: PostureNetwork, images: Float32[Array, "images rows columns"]
) -> Float32[Array, "images 3 2"]:
    return jax.vmap(network)(images[:, None])
