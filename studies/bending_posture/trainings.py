"""Networks trained in different ways on the same samples, and their errors on unseen images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from designopt.errors import UserError
from perception import posture
from studies.bending_posture import BendingPostureSpec
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.samples import Samples, Size, random_postures, samples

PAPER_REGULARISATION = 0.01

OURS, EQUAL, KEPT, RAW = "weighted", "equal weights", "rate kept", "raw images"
"""Names of ways to train; the first is the one that the study stands for."""

L2_MM, L2_STANDARDISED, L2_LENGTHS = (
    f"L2 0.01, labels {unit}" for unit in ("in mm", "standardised", "in finger lengths")
)
READINGS = {"mm": L2_MM, "standardised": L2_STANDARDISED, "finger lengths": L2_LENGTHS}
"""Ways with the paper's regularisation, by the unit in which its loss may be."""


@dataclass(frozen=True)
class Data:
    """Samples to train on, with the labels that an outer camera gives, and others to test on.

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
        return posture.compute_mean_predictor_error(self.labels, self.unseen.markers)

    @property
    def label_scale(self) -> float:
        """Root mean square of what labels are off their mean, mm, which standardises them."""
        return float(np.sqrt(np.mean((self.labels - self.labels.mean(axis=0)) ** 2)))

    def first(self, count: int) -> Data:
        """With the first samples only."""
        return replace(self, train=self.train.part(slice(count)), labels=self.labels[:count])


@dataclass(frozen=True)
class Trained:
    """One network.

    Attributes:
        estimator: it.
        predicted: markers of the unseen images, mm.
        errors: distances of these from the true ones, mm; the tip's are the last.
    """

    estimator: posture.PostureEstimator
    predicted: Float[np.ndarray, "unseen 3 2"]
    errors: Float[np.ndarray, "unseen 3"]

    @property
    def tip_error(self) -> float:
        """Mean error of the marker farthest from the camera, mm."""
        return float(self.errors[:, -1].mean())


def size_of(width: int) -> Size:
    """Columns and rows of a small image of the camera's shape."""
    return width, round(width * 0.75)


def sample_data(
    spec: BendingPostureSpec, finger: SoftFinger, count: int, widths: Sequence[int], seed: int
) -> Data:
    """Random postures of a finger; the same bends, directions and objects for every finger.

    Frames that show no chamber have no posture to be read, and are left out.

    Raises:
        UserError: too few frames show a chamber.
    """
    generator = np.random.default_rng([seed, 5])
    total = count + spec.unseen
    postures = random_postures(finger, total, spec.largest_bend_deg, generator)
    sizes = tuple(size_of(width) for width in dict.fromkeys(widths))
    every = samples(finger, postures, sizes, seed=seed)
    noise = spec.label_noise * generator.standard_normal((count, 3, 2))
    seen, unseen = every.part(slice(count)), every.part(slice(count, None))
    if np.count_nonzero(seen.usable) < 2 or not unseen.usable.any():
        raise UserError(
            f"η = {spec.eta:g}: hardly any picture of this chamber can be used; choose another "
            "eta (or etas), or a lower severity"
        )
    labels, unusable = (seen.markers + noise)[seen.usable], np.count_nonzero(~every.usable)
    return Data(seen.part(seen.usable), labels, unseen.part(unseen.usable), int(unusable))


def regularisations(data: Data, length: float) -> dict[str, float]:
    """What the paper's 0.01 is for standardised labels, by the unit in which its loss may be.

    Eq. 4 goes with the square of that unit, which the paper does not state: a loss in finger
    lengths is that of standardised labels times (scale / length)², so that 0.01 beside it weighs as
    much as 0.01 (length / scale)² does here.
    """
    units = {"mm": 1.0, "standardised": data.label_scale, "finger lengths": length}
    return {
        unit: PAPER_REGULARISATION * (size / data.label_scale) ** 2 for unit, size in units.items()
    }


def ways(spec: BendingPostureSpec, data: Data, length: float) -> dict[str, posture.Training]:
    """Ways of training, by name."""
    ours, paper = posture.Training(epochs=spec.epochs), regularisations(data, length)
    return {
        OURS: ours,
        EQUAL: replace(ours, loss_weights=posture.EQUAL_WEIGHTS),
        KEPT: replace(ours, decay=False),
        **{way: replace(ours, regularisation=paper[unit]) for unit, way in READINGS.items()},
        RAW: replace(ours, standardise=False),
    }


def train_network(
    settings: posture.Training, data: Data, width: int, *, watch: bool = False
) -> Trained:
    """A network trained on all of the data, tested on the unseen images.

    Args:
        settings: of the training.
        data: samples.
        width: of the images, px.
        watch: whether the unseen images' errors are recorded epoch by epoch, which takes time.
    """
    images, unseen = (part.images[size_of(width)] for part in (data.train, data.unseen))
    watched = (unseen, data.unseen.markers) if watch else None
    estimator = posture.train(images, data.labels, settings, watched)
    predicted = estimator.predict(unseen)
    errors = posture.compute_marker_errors(predicted, data.unseen.markers)
    return Trained(estimator, predicted, errors)
