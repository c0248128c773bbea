"""Settings of a training, and its record."""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.posture.network import CHANNELS, MARKERS

EQUAL_WEIGHTS = (1.0, 1.0, 1.0)
"""Eq. 4 without weights."""

DISTANCE_WEIGHTS = (0.5, 1.0, 1.5)
"""Proportional to the markers' distance along the chamber, 1 in the mean. Paper A weights markers
that are farther away more, for their errors are larger; that it is in proportion is a reading."""


@dataclass(frozen=True)
class Training:
    """How a network is trained.

    Source: paper A, §III.A: Adam with learning rate 0.003, weighted markers (Eq. 4) and a
    regularisation of 0.01. Readings: that this is L2, and of which loss, so that its default is
    not the paper's number; batches and epochs. The paper mentions no learning rate that
    falls; ours does, which leaves a smaller error.

    Attributes:
        epochs: how often all samples are seen.
        batch: samples of a step; all of them if there are fewer.
        learning_rate: of the first step.
        decay: whether it falls to zero as a cosine (I. Loshchilov and F. Hutter, ICLR 2017); else
            it stays, as in the paper.
        loss_weights: βᵢ of Eq. 4, the marker nearest the camera first.
        regularisation: λ, which times the sum of squared weights is added to the loss of
            standardised labels.
        standardise: whether images are brought to mean 0 and deviation 1; raw 0 to 255 otherwise.
        seed: of the first weights and of the order of the samples.
        channels: of the convolutions.

    Raises:
        ValueError: a number is out of its range.
    """

    epochs: int = 60
    batch: int = 64
    learning_rate: float = 0.003
    decay: bool = True
    loss_weights: tuple[float, float, float] = DISTANCE_WEIGHTS
    regularisation: float = 1e-4
    standardise: bool = True
    seed: int = 0
    channels: tuple[int, ...] = CHANNELS

    def __post_init__(self) -> None:
        for name in ("epochs", "batch"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is at least 1, not {getattr(self, name)}")
        if not 0 < self.learning_rate < math.inf:
            raise ValueError(f"learning_rate is positive and finite, not {self.learning_rate:g}")
        if not 0 <= self.regularisation < math.inf:
            raise ValueError(
                f"regularisation is finite and at least 0, not {self.regularisation:g}"
            )
        weights = self.loss_weights
        if len(weights) != MARKERS or not all(0 < one < math.inf for one in weights):
            raise ValueError(f"loss_weights are {MARKERS} positive finite numbers, not {weights}")
        if self.seed < 0:
            raise ValueError(f"seed is at least 0, not {self.seed}")
        if not self.channels or min(self.channels) < 1:
            raise ValueError(f"channels are one or more numbers from 1 on, not {self.channels}")


@dataclass(frozen=True)
class TrainingRecord:
    """What happened in a training; lists have a value for every epoch.

    Attributes:
        loss: Eq. 4 in the mean over the epoch's batches, without regularisation, mm².
        tip_error: mean tip error on the validation samples after it, mm; empty without these.
        seconds: since the training began, compiling included.
        samples: number of them.
        image_size: columns and rows.
        settings: of the training.
        versions: of Python and of the packages the numbers depend on.
    """

    loss: tuple[float, ...]
    tip_error: tuple[float, ...]
    seconds: tuple[float, ...]
    samples: int
    image_size: tuple[int, int]
    settings: Training
    versions: dict[str, str]

    @property
    def total_seconds(self) -> float:
        """The whole training."""
        return self.seconds[-1]
