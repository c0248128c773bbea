"""Networks trained in different ways on the same samples, and their errors on unseen images."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from designopt.errors import UserError
from perception.posture import (
    EQUAL_WEIGHTS,
    PostureEstimator,
    Training,
    compute_marker_errors,
    compute_mean_predictor_error,
    train,
)
from studies.bending_posture.spec import BendingPostureSpec
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.samples import Samples, Size, random_postures, samples

MEAN = "mean of the labels"
"""What every network is compared with."""

PAPER_REGULARISATION = 0.01

REGULARISATIONS = (1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)
"""Weights of L2 regularisation that are compared, for standardised labels."""

OURS, EQUAL, KEPT, L2_MM, L2_STANDARDISED, L2_LENGTHS, RAW = (
    "weighted",
    "equal weights",
    "rate kept",
    "L2 0.01, labels in mm",
    "L2 0.01, labels standardised",
    "L2 0.01, labels in finger lengths",
    "raw images",
)
"""Names of ways to train; the first is the one that the study stands for."""

READINGS = {"mm": L2_MM, "standardised": L2_STANDARDISED, "finger lengths": L2_LENGTHS}
"""Ways with the paper's regularisation, by the unit in which its loss may be."""


@dataclass(frozen=True)
class Data:
    """Samples to train on, with the labels that an outer camera gives, and others to judge on.

    Attributes:
        train: the samples.
        labels: their markers with noise, mm.
        unseen: other samples.
        unusable: frames that showed no chamber, which are in neither.
    """

    train: Samples
    labels: Float[np.ndarray, "samples 3 2"]
    unseen: Samples
    unusable: int

    @property
    def mean_error(self) -> float:
        """Tip error of always answering the mean of the labels, mm."""
        return compute_mean_predictor_error(self.labels, self.unseen.markers)


@dataclass(frozen=True)
class Trained:
    """One network.

    Attributes:
        way: name of how it was trained.
        estimator: it.
        predicted: markers of the unseen images, mm.
        errors: distances of these from the true ones, mm.
    """

    way: str
    estimator: PostureEstimator
    predicted: Float[np.ndarray, "unseen 3 2"]
    errors: Float[np.ndarray, "unseen 3"]

    @property
    def tip_error(self) -> float:
        """Mean error of the marker farthest from the camera, mm."""
        return float(self.errors[:, -1].mean())


def counted(count: int) -> str:
    """A number of samples in words."""
    return f"{count} samples"


def size_of(width: int) -> Size:
    """Columns and rows of a small image of the camera's shape."""
    return width, round(width * 0.75)


def data_of(
    spec: BendingPostureSpec, finger: SoftFinger, count: int, widths: list[int], seed: int
) -> Data:
    """Random postures of a finger; the same bends, directions and objects for every finger.

    Frames that show no chamber have no posture to be read, and are left out.

    Raises:
        UserError: hardly any frame shows a chamber.
    """
    generator = np.random.default_rng([seed, 5])
    total = count + spec.unseen
    bends = np.deg2rad(generator.uniform(0, spec.largest_bend_deg, total))
    postures = random_postures(finger, bends, generator)
    sizes = tuple(size_of(width) for width in dict.fromkeys(widths))
    made = samples(finger, postures, sizes, seed=seed)
    noise = spec.label_noise * generator.standard_normal((count, 3, 2))
    seen, unseen = made.part(slice(None, count)), made.part(slice(count, None))
    if np.count_nonzero(seen.usable) < 2 or not unseen.usable.any():
        raise UserError(
            f"η = {spec.eta:g}: hardly any picture of this chamber can be used; choose another "
            "eta (or etas), or a lower severity"
        )
    labels = (seen.markers + noise)[seen.usable]
    return Data(_usable(seen), labels, _usable(unseen), int(np.count_nonzero(~made.usable)))


def _usable(some: Samples) -> Samples:
    which = some.usable
    images = {size: stack[which] for size, stack in some.images.items()}
    return Samples(some.bends[which], images, some.usable[which], some.markers[which])


def label_scale(data: Data) -> float:
    """Root mean square of what labels are off their mean, mm, by which they are standardised."""
    return float(np.sqrt(np.mean((data.labels - data.labels.mean(axis=0)) ** 2)))


def regularisations(data: Data, length: float) -> dict[str, float]:
    """What the paper's 0.01 is for standardised labels, by the unit in which its loss may be.

    Eq. 4 goes with the square of that unit, and the paper does not say which one it has: a loss in
    finger lengths is that of standardised labels times (scale / length)², so that 0.01 beside it
    weighs as much as 0.01 (length / scale)² does here.
    """
    scale = label_scale(data)
    return {
        "mm": PAPER_REGULARISATION / scale**2,
        "standardised": PAPER_REGULARISATION,
        "finger lengths": PAPER_REGULARISATION * (length / scale) ** 2,
    }


def ours(spec: BendingPostureSpec) -> Training:
    """How the study trains."""
    return Training(epochs=spec.epochs)


def ways(spec: BendingPostureSpec, data: Data, length: float) -> dict[str, Training]:
    """Ways of training, by name."""
    own = ours(spec)
    paper = regularisations(data, length)
    return {
        OURS: own,
        EQUAL: replace(own, loss_weights=EQUAL_WEIGHTS),
        KEPT: replace(own, decay=False),
        **{way: replace(own, regularisation=paper[unit]) for unit, way in READINGS.items()},
        RAW: replace(own, standardise=False),
    }


def trained(way: str, settings: Training, data: Data, size: Size, *, watch: bool) -> Trained:
    """A network trained on all of the data, judged on the unseen images.

    Args:
        way: its name.
        settings: of the training.
        data: samples.
        size: of the images.
        watch: whether the unseen images' errors are recorded epoch by epoch, which takes time.
    """
    unseen = data.unseen.images[size]
    estimator = train(
        data.train.images[size],
        data.labels,
        settings,
        (unseen, data.unseen.markers) if watch else None,
    )
    predicted = estimator.predict(unseen)
    return Trained(way, estimator, predicted, compute_marker_errors(predicted, data.unseen.markers))


def fewer(data: Data, count: int) -> Data:
    """The first samples only."""
    return replace(data, train=data.train.part(slice(None, count)), labels=data.labels[:count])
