"""Pictures of the first page, made by the commands and the library from the packaged designs."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import cv2
import jax
import numpy as np

from designopt import cli
from optics.rendering import Effects, Imprint
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.spec import FingerImagesSpec
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.spec import ChamberImagesSpec

POSTURE = "pip=35,dip=45"
"""In which the section and the camera's picture are drawn, degrees."""


def _run(*words: object) -> None:
    given: Sequence[str] = [str(word) for word in words]
    if cli.run(list(given)) != 0:
        raise RuntimeError(f"designopt {' '.join(given)} has failed")


def write_pictures(folder: Path) -> None:
    """Write a linkage, a scene, a finger's drawing and two rendered pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    studies = files("studies")
    with tempfile.TemporaryDirectory() as name:
        room = Path(name)
        _run(
            "solve", studies / "gallery/linkages/four-bar.toml", "--sweep", "crank=0:360:181",
            "--csv", room / "poses.csv", "--figure", folder / "linkage.svg",
        )  # fmt: skip
        _run(
            "trace", studies / "gallery/scenes/finger.toml", "--pose", POSTURE,
            "--json", room / "seen.json", "--figure", folder / "scene.svg",
        )  # fmt: skip
        _run("export", studies / "models/finger.toml", "--to", "svg", "--out", room / "finger")
        shutil.copy(room / "finger/finger.svg", folder / "finger.svg")
    with jax.enable_x64(True):
        finger = FingerSensor.of(FingerImagesSpec(), rows=540)
        camera = finger.renderer(Effects.graded(1.0), errors=None, seed=0)
        pressed = {"distal": [Imprint("studded brick", along=13.0)]}
        views = camera.render(np.deg2rad([60.0, 50.0]), pressed).pixels
        soft = SoftFinger.of(ChamberImagesSpec())
        bend, direction = np.deg2rad([20.0]), np.deg2rad([60.0])
        rings = soft.renderer(seed=0).render(soft.postures(bend, direction))[0].pixels
    for file, pixels in (("views", views), ("rings", rings)):
        cv2.imwrite(str(folder / f"{file}.png"), pixels[..., ::-1])
