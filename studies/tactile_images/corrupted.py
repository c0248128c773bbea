"""Frames that are no proper images of a finger: each has a defined answer, and none is a crash."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from designopt.errors import UserError
from perception.detection import detect_views
from perception.paper_route import PaperRoute
from perception.proprioception import (
    EdgeEstimator,
    GapEstimator,
    find_pose,
    fit_edges,
    observe,
    split_estimates,
)
from perception.unwarping import unwarp
from studies.models.sensor.estimators import gap_table
from studies.models.sensor.finger_sensor import FingerSensor

Image = Any
Corruption = Callable[[Image, np.random.Generator], Image]


def _noise(image: Image, generator: np.random.Generator) -> Image:
    return generator.integers(0, 256, image.shape, np.uint8)


def _blobs(image: Image, generator: np.random.Generator) -> Image:
    """Bright broad blobs that are no pads."""
    coarse = generator.uniform(0, 255, (6, 8, 3)).astype(np.float32)
    return (
        cv2.resize(coarse, image.shape[1::-1], interpolation=cv2.INTER_CUBIC)
        .clip(0, 255)
        .astype(np.uint8)
    )


def _half_covered(image: Image, generator: np.random.Generator) -> Image:
    covered = image.copy()
    rows, columns = image.shape[:2]
    parts = [np.s_[: rows // 2], np.s_[rows // 2 :], np.s_[:, : columns // 2],
             np.s_[:, columns // 2 :]]  # fmt: skip
    covered[parts[generator.integers(4)]] = generator.integers(0, 256)
    return covered


def _patches(image: Image, generator: np.random.Generator) -> Image:
    patched = image.copy()
    rows, columns = image.shape[:2]
    for _ in range(12):
        top, left = generator.integers(0, rows), generator.integers(0, columns)
        high, wide = generator.integers(8, rows // 3, 2)
        patched[top : top + high, left : left + wide] = generator.integers(0, 256, 3)
    return patched


def _salt(image: Image, generator: np.random.Generator) -> Image:
    salted = image.copy()
    salted[generator.random(image.shape[:2]) < 0.2] = 255
    return salted


def _lines(image: Image, generator: np.random.Generator) -> Image:
    crossed = image.copy()
    rows, columns = image.shape[:2]
    for _ in range(20):
        ends = generator.integers(0, (columns, rows), (2, 2))
        color = generator.integers(0, 256, 3).tolist()
        cv2.line(crossed, ends[0].tolist(), ends[1].tolist(), color, 5)
    return crossed


def _shifted(image: Image, generator: np.random.Generator) -> Image:
    rows, columns = image.shape[:2]
    return np.roll(image, (generator.integers(rows), generator.integers(columns)), (0, 1))


def _wrong_size(image: Image, generator: np.random.Generator) -> Image:
    rows, columns = generator.integers(0, 2 * np.array(image.shape[:2]))
    return np.zeros((rows, columns + (columns == image.shape[1]), 3), np.uint8) + 90


def _wrong_type(image: Image, generator: np.random.Generator) -> Image:
    kinds: list[Image] = [
        None,
        "image",
        image.astype(float),
        image.astype(np.uint16),
        image[..., :2],
        image[..., :1],
        image[None],
        np.zeros((0, 0, 3), np.uint8),
        image.tolist()[:2],
    ]
    return kinds[generator.integers(len(kinds))]


NO_FINGER: dict[str, Corruption] = {
    "black": lambda image, _: np.zeros_like(image),
    "white": lambda image, _: np.full_like(image, 255),
    "noise": _noise,
    "bright blobs": _blobs,
}
"""Nothing of a finger is left in these: no view may be called complete, no angle be given."""

NO_IMAGE: dict[str, Corruption] = {
    "wrong size": _wrong_size,
    "wrong type": _wrong_type,
}
"""These are refused, in one line."""

DAMAGED: dict[str, Corruption] = {
    "one channel": lambda image, _: np.ascontiguousarray(image[..., 0]),
    "half covered": _half_covered,
    "patches": _patches,
    "salt": _salt,
    "lines": _lines,
    "shifted": _shifted,
    "inverted": lambda image, _: 255 - image,
}
"""Something may be left in these: any answer that is one."""


LABEL_DEVIATION, EDGE_DEVIATION = 0.01, 0.001
"""What the ruler of edges is told of its frames, rad: it must answer, not be good."""


@dataclass(frozen=True)
class Trial:
    """One corrupted frame.

    Attributes:
        kind: how it was corrupted.
        refused: whether it was refused as no image.
        crash: what else was raised; empty if nothing.
        complete: views called complete.
        angles: joint angles that were given, by all corners, by the gap or by one edge.
    """

    kind: str
    refused: bool = False
    crash: str = ""
    complete: int = 0
    angles: int = 0

    @property
    def failed(self) -> bool:
        """Whether the answer is not the defined one."""
        false = self.kind in NO_FINGER and bool(self.complete or self.angles)
        return bool(self.crash) or false or self.refused is not (self.kind in NO_IMAGE)


@dataclass(frozen=True)
class Analysis:
    """Everything that is done with a frame of a finger.

    Attributes:
        finger: as designed.
        meters: the gaps, as designed.
        rulers: the edges of every joint.
        paper: the paper's route.
    """

    finger: FingerSensor
    meters: list[GapEstimator]
    rulers: list[EdgeEstimator]
    paper: PaperRoute

    @classmethod
    def of(cls, finger: FingerSensor, images: Sequence[np.ndarray], angles: np.ndarray) -> Analysis:
        """Calibrated by good images at known joint angles, rad."""
        model = finger.model
        sightings = [detect_views(image, finger.lens, finger.catalog) for image in images]
        rulers = [
            fit_edges(
                sightings,
                angles[:, joint],
                [view for view, j in zip(model.views, model.joints, strict=True) if j == joint],
                label_deviation=LABEL_DEVIATION,
                edge_deviation=EDGE_DEVIATION,
            )
            for joint in range(len(model.names))
        ]
        meters = []
        for pad in finger.catalog.lengths:
            # A pad that is not seen twice has no gap.
            with suppress(ValueError):
                table = gap_table(finger.scene, finger.catalog, pad)
                meters.append(GapEstimator(table, 0.0, 1.0, np.zeros((2, 2)), EDGE_DEVIATION))
        return cls(finger, meters, rulers, PaperRoute())

    def of_frame(self, kind: str, frame: Image) -> Trial:
        """All of it for one frame.

        Raises:
            UserError: it is no image.
        """
        finger = self.finger
        sighting = detect_views(frame, finger.lens, finger.catalog)
        seen = observe(sighting, finger.model.views)
        estimates = split_estimates(find_pose(finger.model, seen, sighting.angles))
        estimates += [ruler.estimate(sighting) for ruler in self.rulers]
        estimates += [meter.estimate(meter.table.measured(sighting)) for meter in self.meters]
        for view in sighting.complete():
            unwarp(frame, view, finger.lens, finger.catalog.lengths[view.pad], finger.width)
        if frame.ndim == 3:
            self.paper.corners(frame)
        given = sum(one.defined for one in estimates)
        return Trial(kind, complete=len(sighting.complete()), angles=given)


def tried(analysis: Analysis, images: Sequence[np.ndarray], count: int, seed: int) -> list[Trial]:
    """Corrupted versions of good images, every kind as often as every other one."""
    kinds = NO_FINGER | NO_IMAGE | DAMAGED
    trials = []
    for number in range(count):
        kind = list(kinds)[number % len(kinds)]
        generator = np.random.default_rng([seed, 5, number])
        frame = kinds[kind](images[number // len(kinds) % len(images)], generator)
        try:
            trials.append(analysis.of_frame(kind, frame))
        except UserError:
            trials.append(Trial(kind, refused=True))
        except Exception as error:  # any other exception is what is counted here
            trials.append(Trial(kind, crash=repr(error)))
    return trials
