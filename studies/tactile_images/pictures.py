"""What the figures show: frames, and pads unwarped with and without something pressed in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optics.rendering import Effects, Imprint, TactileImage
from perception.detection import detect_views
from perception.differences import References
from perception.matching import Sighting, View
from perception.unwarping import select_view, unwarp
from studies.models.sensor.finger_sensor import FingerSensor
from studies.tactile_images.frames import IMPRINTS, touched
from studies.tactile_images.spec import TactileImagesSpec

POSES_DEG = ((10.0, 35.0), (45.0, 50.0), (57.0, 20.0), (85.0, 80.0))
"""PIP and DIP of the frames that are shown; of a range of 90°."""


TOUCHED_DEG = (65.0, 70.0)
"""The same of the frames in which things are pressed into pads."""


@dataclass(frozen=True)
class Touch:
    """Pads with something pressed in: unwarped pictures and differences, by pad."""

    kind: str
    pictures: dict[str, np.ndarray]
    differences: dict[str, np.ndarray]


@dataclass(frozen=True)
class Shown:
    """Frames for the figures.

    Attributes:
        frames: images and what was found in them.
        touches: what is pressed in, one after the other.
        untouched: pictures of the pads without anything, by pad.
    """

    frames: list[tuple[TactileImage, Sighting]]
    touches: list[Touch]
    untouched: dict[str, np.ndarray]


def shown(finger: FingerSensor, spec: TactileImagesSpec, seed: int) -> Shown:
    """Render what the figures show, on the first made finger."""
    errors, _ = finger.made(seed, 0)
    renderer = finger.renderer(Effects.graded(spec.severity), errors, seed)
    scale = spec.range_deg / 90
    frames = []
    for number, pose in enumerate(POSES_DEG):
        pressed = touched(finger, number)
        image = renderer.render(_pose(finger, scale, pose), pressed, frame=number)
        frames.append((image, detect_views(image.pixels, finger.lens, finger.catalog)))
    pose = _pose(finger, scale, TOUCHED_DEG)
    references = References()
    untouched = {}
    bare = renderer.render(pose, frame=1000)
    for view, picture in _pictures(finger, bare).items():
        references.keep(view, picture)
        untouched[view.pad] = picture
    touches = []
    for number, kind in enumerate(IMPRINTS):
        imprints = {pad: [Imprint(kind, length / 2)]
                    for pad, length in finger.catalog.lengths.items()}  # fmt: skip
        image = renderer.render(pose, imprints, frame=1001 + number)
        pictures = _pictures(finger, image)
        changes = {view.pad: references.compare(view, p) for view, p in pictures.items()}
        touches.append(
            Touch(
                kind,
                {view.pad: picture for view, picture in pictures.items()},
                {pad: change for pad, change in changes.items() if change is not None},
            )
        )
    return Shown(frames, touches, untouched)


def _pose(finger: FingerSensor, scale: float, degrees: tuple[float, ...]) -> np.ndarray:
    """A pose of as many joints as the finger has, rad."""
    return np.deg2rad(scale * np.resize(degrees, len(finger.model.names)))


def _pictures(finger: FingerSensor, image: TactileImage) -> dict[View, np.ndarray]:
    """Every pad unwarped in its best view."""
    sighting = detect_views(image.pixels, finger.lens, finger.catalog)
    made = {}
    for pad, length in finger.catalog.lengths.items():
        own = [view for view in sighting.views if view.pad == pad]
        view = select_view(own, finger.lens, length, finger.width)
        if view is not None:
            made[view] = unwarp(image.pixels, view, finger.lens, length, finger.width)
    return made
