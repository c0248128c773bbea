"""Training a network on boundary images whose markers are known.

Source: paper A, *Vision-Based Tactile Perception for Soft Robotic Hand*, §III.A; the optimiser is
Adam (D. P. Kingma and J. Ba, *Adam: A Method for Stochastic Optimization*, ICLR 2015).

Readings: images and labels are standardised. From raw images errors are several times as large,
and a network that starts otherwise than from zero may settle on the mean of the labels, whatever
it is shown: `marker_errors.compute_mean_predictor_error` is what to compare with.
"""

from __future__ import annotations

import platform
import time
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Float32, Int32

from designopt.errors import UserError
from perception.images import checked_floats
from perception.posture.estimator import PostureEstimator, answered, standardised
from perception.posture.marker_errors import compute_marker_errors
from perception.posture.network import MARKERS, PostureNetwork, compute_weighted_loss
from perception.posture.settings import Training, TrainingRecord

Samples = tuple[Float[np.ndarray, "others rows columns"], Float[np.ndarray, "others 3 2"]]
"""Images and their markers, mm."""

ADAM = optax.scale_by_adam()


class Rates(NamedTuple):
    """Settings as arrays: trainings that differ in them run one program."""

    learning_rate: Float32[Array, ""]
    decay: Float32[Array, ""]
    regularisation: Float32[Array, ""]
    loss_weights: Float32[Array, "3"]
    steps: Int32[Array, ""]


class State(NamedTuple):
    """What a step changes.

    Attributes:
        network: with its weights so far.
        optimizer: Adam's means of slopes and of their squares.
        done: number of steps.
    """

    network: PostureNetwork
    optimizer: optax.OptState
    done: Int32[Array, ""]


def train(
    images: Float[np.ndarray, "images rows columns"],
    markers: Float[np.ndarray, "images 3 2"],
    settings: Training,
    validation: Samples | None = None,
) -> PostureEstimator:
    """A network trained on samples, in float32 whatever JAX's float type is.

    Every epoch sees the samples in another order; those that do not fill a batch are left out of
    it. The same seed gives the same network on the same machine.

    Args:
        images: boundary images, 0 to 255.
        markers: (x, y) relative to the marker nearest the camera, the nearest first, mm.
        settings: of the training.
        validation: other samples, whose mean tip error is recorded after every epoch.

    Raises:
        UserError: images or markers are no finite floats, not as many of one as of the other, or
            all the same.

    Example:
        >>> generator = np.random.default_rng(0)
        >>> images, markers = generator.random((8, 12, 16)), generator.random((8, 3, 2))
        >>> estimator = train(images.astype(np.float32), markers, Training(epochs=1, batch=4))
        >>> estimator.predict(images.astype(np.float32)).shape
        (8, 3, 2)
    """
    began = time.perf_counter()
    _check(images, markers)
    if validation is not None:
        _check_shapes(*validation, size=images.shape[1:])
    mean, deviation = 0.0, 1.0
    if settings.standardise:
        mean, deviation = float(images.mean(dtype=np.float64)), float(images.std(dtype=np.float64))
    label_mean = markers.mean(axis=0, dtype=np.float64)
    scale = float(np.sqrt(np.mean((markers - label_mean) ** 2)))
    inputs = jnp.asarray(standardised(images, mean, deviation))
    targets = jnp.asarray(((markers - label_mean) / scale).astype(np.float32))

    count, (rows, columns) = len(images), images.shape[1:]
    batch = min(settings.batch, count)
    steps = count // batch
    rates = Rates(
        learning_rate=jnp.asarray(settings.learning_rate, jnp.float32),
        decay=jnp.asarray(settings.decay, jnp.float32),
        regularisation=jnp.asarray(settings.regularisation, jnp.float32),
        loss_weights=jnp.asarray(settings.loss_weights, jnp.float32),
        steps=jnp.asarray(settings.epochs * steps, jnp.int32),
    )
    generator = np.random.default_rng(settings.seed)
    network = PostureNetwork((columns, rows), settings.channels, generator)
    state = _first(network)
    losses, tip_errors, seconds = [], [], []

    for _ in range(settings.epochs):
        order = generator.permutation(count)[: steps * batch].astype(np.int32)
        batches = jnp.asarray(order.reshape(steps, batch))
        state, loss = _epoch(state, inputs, targets, batches, rates)
        losses.append(float(loss) * scale**2)
        if validation is not None:
            others = standardised(validation[0], mean, deviation)
            predicted = label_mean + scale * answered(state.network, others)
            errors = compute_marker_errors(predicted, validation[1])
            tip_errors.append(float(errors[:, -1].mean()))
        seconds.append(time.perf_counter() - began)
    record = TrainingRecord(
        loss=tuple(losses),
        tip_error=tuple(tip_errors),
        seconds=tuple(seconds),
        samples=count,
        image_size=(columns, rows),
        settings=settings,
        versions=_versions(),
    )
    return PostureEstimator(state.network, mean, deviation, label_mean, scale, record)


@eqx.filter_jit
def _first(network: Any) -> State:
    return State(network, ADAM.init(network), jnp.zeros((), jnp.int32))


@eqx.filter_jit
def _epoch(
    state: State,
    inputs: Float32[Array, "images rows columns"],
    targets: Float32[Array, "images 3 2"],
    order: Int32[Array, "steps batch"],
    rates: Rates,
) -> tuple[State, Float32[Array, ""]]:
    """All steps of an epoch, and the mean of their losses before regularisation."""

    def step(state: State, chosen: Int32[Array, " batch"]) -> tuple[State, Array]:
        (_, fit), slopes = eqx.filter_value_and_grad(objective, has_aux=True)(
            state.network, inputs[chosen], targets[chosen], rates
        )
        done = state.done.astype(jnp.float32) / rates.steps.astype(jnp.float32)
        rate = rates.learning_rate * (1 - rates.decay * (1 - jnp.cos(jnp.pi * done)) / 2)
        # Optax raises a float to the number of steps, which strict promotion forbids.
        with jax.numpy_dtype_promotion("standard"):
            directions, optimizer = ADAM.update(slopes, state.optimizer)
        network = jax.tree.map(lambda w, d: w - rate * d, state.network, directions)
        return State(network, optimizer, state.done + 1), fit

    state, fits = jax.lax.scan(step, state, order)
    return state, jnp.mean(fits)


def objective(
    network: PostureNetwork,
    images: Float[Array, "batch rows columns"],
    markers: Float[Array, "batch 3 2"],
    rates: Rates,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """What is made small: Eq. 4 of standardised markers with L2 regularisation; and without."""
    fit = compute_weighted_loss(jax.vmap(network)(images[:, None]), markers, rates.loss_weights)
    return fit + rates.regularisation * network.squared_weights(), fit


def _check(images: np.ndarray, markers: np.ndarray) -> None:
    _check_shapes(images, markers, size=("rows", "columns"))
    if not (np.ptp(images, axis=0).any() and np.ptp(markers, axis=0).any()):
        raise UserError("samples that are all the same teach nothing; give several postures")


def _check_shapes(images: np.ndarray, markers: np.ndarray, size: tuple[int | str, ...]) -> None:
    what, cure = "a stack of boundary images", "make them with make_boundary_image and shrink"
    images = checked_floats(images, ("samples", *size), what=what, cure=cure)
    if not images.size:
        raise UserError(f"{what} of the shape {images.shape} has no pixels; {cure}")
    cure = "give the places of three markers, in mm, with every image"
    checked_floats(markers, (len(images), MARKERS, 2), what="an array of markers", cure=cure)


def _versions() -> dict[str, str]:
    packages = {"jax": jax, "equinox": eqx, "optax": optax, "numpy": np}
    return {"python": platform.python_version()} | {
        name: package.__version__ for name, package in packages.items()
    }
