"""The designed finger, and frames of it, for all files of a process."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics.rendering import Effects, Renderer
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.spec import FingerImagesSpec
from tests.perception.rendered import POSES, Frame, analysed

ROWS = 540


@pytest.fixture(scope="session")
def finger() -> FingerSensor:
    return FingerSensor.of(FingerImagesSpec(), ROWS)


@pytest.fixture(scope="session")
def perfect(finger: FingerSensor) -> Renderer:
    """The finger as designed, in perfect light."""
    return finger.renderer(Effects(), None, seed=0)


@pytest.fixture(scope="session")
def designed_frames(finger: FingerSensor) -> list[Frame]:
    """Frames of the finger as designed, in the light of a good one."""
    return frames_of(finger, finger.renderer(Effects.graded(1.0), None, seed=1))


@pytest.fixture(scope="session")
def made_frames(finger: FingerSensor) -> list[Frame]:
    """The same of a finger that was made with errors, its lens as designed."""
    errors, _ = finger.made(0, 1)
    errors = eqx.tree_at(lambda e: e.distortion, errors, None, is_leaf=lambda leaf: leaf is None)
    # Of the types that no errors have: it is compiled once.
    errors = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)), errors)
    return frames_of(finger, finger.renderer(Effects.graded(1.0), errors, seed=2))


def frames_of(finger: FingerSensor, renderer: Renderer) -> list[Frame]:
    images = [renderer.render(pose, frame=number) for number, pose in enumerate(POSES)]
    return [analysed(finger, image) for image in images]
