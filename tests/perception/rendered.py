"""Frames of the designed finger and of a made one, with what was found in them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from optics.rendering import TactileImage, TrueView
from perception.matching import Sighting
from studies.models.sensor.finger_sensor import FingerSensor

POSES = np.deg2rad([[5, 5], [15, 70], [30, 30], [50, 45], [60, 60], [75, 20], [70, 85]])
"""Joint angles in which all views are seen well at one time or another, rad."""


class Frame(NamedTuple):
    """A frame, and what was found in it."""

    image: TactileImage
    sighting: Sighting


def analysed(finger: FingerSensor, image: TactileImage) -> Frame:
    return Frame(image, finger.detect(image.pixels))


def findable(finger: FingerSensor, image: TactileImage) -> list[TrueView]:
    """Views that are asked for, and whole and off the border."""
    whole = (view for view in image.views if view.complete and not view.at_border)
    return [view for view in whole if (view.pad, view.path) in finger.model.views]


def covered(pixels: np.ndarray, view: TrueView, margin: int = 12) -> np.ndarray:
    """An image in which something black hides a view."""
    hidden = pixels.copy()
    low, high = view.corners.min(axis=0) - margin, view.corners.max(axis=0) + margin
    cv2.rectangle(hidden, low.astype(int).tolist(), high.astype(int).tolist(), (0, 0, 0), -1)
    return hidden


def signed_area(corners: np.ndarray) -> float:
    """By the shoelace formula: its sign is the sense in which the corners go around."""
    x, y = corners.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)
