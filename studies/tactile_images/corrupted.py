"""Frames that are no proper images of a finger: each has a defined answer, and none is a crash."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import cv2
import numpy as np

from designopt import Records, UserError
from optics.rendering import Effects
from perception.paper_route import PaperRoute
from perception.proprioception import GapEstimator, find_pose, observe, split_estimates
from studies.models.sensor.estimators import fit_joint_edges, gap_table
from studies.models.sensor.finger_sensor import FingerSensor
from studies.tactile_images import TactileImagesSpec
from studies.tactile_images.figures import touch

Image = Any
Corruption = Callable[[Image, np.random.Generator], Image]
"""From a copy of a good image, which it may change, to a corrupted one."""


def _blobs(image: Image, generator: np.random.Generator) -> Image:
    """Bright broad blobs that are no pads."""
    coarse = generator.uniform(0, 255, (6, 8, 3)).astype(np.float32)
    broad = cv2.resize(coarse, image.shape[1::-1], interpolation=cv2.INTER_CUBIC)
    return broad.clip(0, 255).astype(np.uint8)


def _cover_half(image: Image, generator: np.random.Generator) -> Image:
    row, column = np.array(image.shape[:2]) // 2
    halves = (np.s_[:row], np.s_[row:], np.s_[:, :column], np.s_[:, column:])
    image[halves[generator.integers(4)]] = generator.integers(0, 256)
    return image


def _patch(image: Image, generator: np.random.Generator) -> Image:
    for _ in range(12):
        top, left = generator.integers(0, image.shape[:2])
        high, wide = generator.integers(8, len(image) // 3, 2)
        image[top : top + high, left : left + wide] = generator.integers(0, 256, 3)
    return image


def _salt(image: Image, generator: np.random.Generator) -> Image:
    image[generator.random(image.shape[:2]) < 0.2] = 255
    return image


def _cross_out(image: Image, generator: np.random.Generator) -> Image:
    for _ in range(20):
        start, end = generator.integers(0, image.shape[1::-1], (2, 2)).tolist()
        cv2.line(image, start, end, generator.integers(0, 256, 3).tolist(), 5)
    return image


def _shift(image: Image, generator: np.random.Generator) -> Image:
    return np.roll(image, generator.integers(0, image.shape[:2]).tolist(), (0, 1))


def _resize(image: Image, generator: np.random.Generator) -> Image:
    rows, columns = generator.integers(0, 2 * np.array(image.shape[:2]))
    return np.zeros((rows, columns + (columns == image.shape[1]), 3), np.uint8) + 90


def _retype(image: Image, generator: np.random.Generator) -> Image:
    kinds: list[Image] = [
        *(None, "image", image.astype(float), image.astype(np.uint16), image[..., :2]),
        *(image[..., :1], image[None], np.zeros((0, 0, 3), np.uint8), image.tolist()[:2]),
    ]
    return kinds[generator.integers(len(kinds))]


CORRUPTIONS: dict[str, tuple[str, Corruption]] = {
    "black": ("undefined", lambda image, _: np.zeros_like(image)),
    "white": ("undefined", lambda image, _: np.full_like(image, 255)),
    "noise": ("undefined", lambda image, random: random.integers(0, 256, image.shape, np.uint8)),
    "bright blobs": ("undefined", _blobs),
    "wrong size": ("refused", _resize),
    "wrong type": ("refused", _retype),
    "one channel": ("any", lambda image, _: np.ascontiguousarray(image[..., 0])),
    "half covered": ("any", _cover_half),
    "patches": ("any", _patch),
    "salt": ("any", _salt),
    "lines": ("any", _cross_out),
    "shifted": ("any", _shift),
    "inverted": ("any", lambda image, _: 255 - image),
}
"""Every corruption, and the answer defined for it: undefined where nothing of a finger is left, so
that no view may be called complete and no angle be given; refused, in one line, as no image; or any
answer that is one, where something may be left."""

ANSWERS = ("exceptions", "refused", "with_complete_views", "with_angles")

BASES = 4
"""Good images, from one end of the grid of poses to the other, that are corrupted."""

DEVIATIONS = {"label_deviation": 0.01, "edge_deviation": 0.001}
"""With which edges are calibrated, rad: they must answer, not be good."""


def analyze_corrupted(spec: TactileImagesSpec, angles: np.ndarray, seed: int) -> Records:
    """Corrupt good images, every kind in turn, and do everything that is done with frames.

    Args:
        spec: the finger, and the number and height of the images.
        angles: joint angles from which those of the good images are chosen, rad.
        seed: of the corruptions.

    Returns:
        For each, whether something was raised, or it was refused; whether it has a complete view,
        and a joint angle: by all corners, by an edge, by the gap.
    """
    finger = FingerSensor.of(spec, spec.corrupted_rows)
    renderer = finger.renderer(Effects.graded(spec.severity), None, seed)
    angles = angles[np.linspace(0, len(angles) - 1, BASES).round().astype(int)]
    shots = list(finger.film(renderer, angles, lambda frame: touch(finger, frame)))
    found, gaps = [sighting for _, sighting, _ in shots], []
    edges = fit_joint_edges(finger.model, found, angles, **DEVIATIONS)
    for pad in finger.catalog.lengths:
        # A pad that is not seen twice has no gap.
        with suppress(ValueError):
            table = gap_table(finger.scene, finger.catalog, pad)
            deviation = DEVIATIONS["edge_deviation"]
            gaps.append(GapEstimator(table, 0.0, 1.0, np.zeros((2, 2)), deviation))

    def analyze(frame: Image) -> tuple[bool, bool]:
        sighting = finger.detect(frame)
        seen = observe(sighting, finger.model.views)
        estimates = split_estimates(find_pose(finger.model, seen, sighting.angles))
        estimates += [edge.estimate(sighting) for edge in edges]
        estimates += [gap.estimate(gap.table.measured(sighting)) for gap in gaps]
        for view in sighting.complete():
            finger.unwarp(frame, view)
        if frame.ndim == 3:
            PaperRoute().corners(frame)
        return bool(sighting.complete()), any(one.defined for one in estimates)

    trials = Records()
    for number in range(spec.corrupted):
        turn, kind = divmod(number, len(CORRUPTIONS))
        name, (expected, corrupt) = list(CORRUPTIONS.items())[kind]
        image, _, _ = shots[turn % len(shots)]
        frame = corrupt(image.pixels.copy(), np.random.default_rng([seed, 5, number]))
        row = dict.fromkeys(ANSWERS, False)
        try:
            row["with_complete_views"], row["with_angles"] = analyze(frame)
        except UserError:
            row["refused"] = True
        except Exception:  # any other exception is what is counted here
            row["exceptions"] = True
        trials.add(kind=name, expected=expected, **row)
    return trials


def is_wrong(trials: Records) -> np.ndarray:
    """Of each corrupted frame, whether its answer is not the one defined for it."""
    answered = trials["with_complete_views"] | trials["with_angles"]
    made = (trials["expected"] == "undefined") & answered
    return trials["exceptions"] | made | (trials["refused"] != (trials["expected"] == "refused"))
