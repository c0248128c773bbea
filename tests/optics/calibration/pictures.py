"""Boards before a lens, imaged by the judge's formulas, which share nothing with the library's."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from optics.calibration import Sightings
from studies.oracles.judge.wide_lens import WideLens

LENS = WideLens(
    (1280, 960), 350.0, (644.2, 470.9), ((1.0, "equisolid"),), (0.6, 0.03), np.radians(85)
)
# 2 sin(θ/2) as a series; its next term is 1e-7 px at 85°.
TRUTH = np.array(
    [LENS.focal, *LENS.middle, -1 / 24, 1 / 1920, -1 / 322560, 1 / 92897280, *LENS.pupil]
)
COLUMN, ROW = np.meshgrid(np.arange(9.0), np.arange(7.0))
POINTS = 5.0 * np.stack([COLUMN.ravel() - 4, ROW.ravel() - 3], axis=-1)
NOISE = 0.05


def boards(seed, count, distances=(18.0, 45.0)):
    """Rotations and translations of boards that roughly face the camera."""
    generator = np.random.default_rng(seed)
    turns, shifts = [], []
    for _ in range(count):
        angle, azimuth = generator.uniform(0, 1.1), generator.uniform(0, 2 * np.pi)
        facing = Rotation.from_rotvec(angle * np.array([-np.sin(azimuth), np.cos(azimuth), 0]))
        tilt = Rotation.from_rotvec(generator.uniform(-0.7, 0.7, 3) * [1, 1, 3])
        turns.append((facing * tilt).as_matrix())
        shifts.append(facing.as_matrix()[:, 2] * generator.uniform(*distances))
    return np.array(turns), np.array(shifts)


def sightings(turns, shifts, seed, *, lens=LENS, noise=NOISE, wrong=0.0):
    """What is seen of boards, with noise, and some corners off by pixels."""
    generator = np.random.default_rng(seed)
    points = POINTS @ np.swapaxes(turns[..., :2], 1, 2) + shifts[:, None]
    places = lens.project(points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
    seen = np.isfinite(places[..., 0])
    places += generator.normal(0, noise, places.shape)
    off = generator.random(seen.shape) < wrong
    places[off] += generator.choice([-1, 1], (off.sum(), 2)) * generator.uniform(
        2, 20, (off.sum(), 2)
    )
    return Sightings(
        jnp.broadcast_to(jnp.asarray(POINTS), places.shape),
        jnp.asarray(places),
        jnp.asarray(np.where(seen, 1.0, np.inf)),
    ), off & seen
