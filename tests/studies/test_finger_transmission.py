"""Paper B's finger: figures that an independent search of its design reached (design B)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from studies.models.linkage_design.transmission import finger_transmission
from tests.kinematics.gallery import gallery, poses_of

SQUARE = -np.deg2rad(np.linspace(0, 90, 91))
POSTURES = jnp.asarray(np.stack(np.meshgrid(SQUARE, SQUARE, indexing="ij"), axis=-1))

# Least angle over the whole square of postures, in degrees, to be met to 0.1.
LEAST = {"D1": 46.3, "D2": 46.4, "C": 46.3, "H": 51.2, "E": 48.9, "P": 46.4}


@pytest.fixture(scope="module")
def poses():
    """Every posture, which exists."""
    poses = poses_of(gallery("finger"), POSTURES)
    assert bool(jnp.all(poses.ok))
    assert float(jnp.max(poses.residual)) < 1e-12
    return poses.value


def test_least_transmission_angles(poses):
    found = finger_transmission(poses)
    for name, wanted in LEAST.items():
        assert abs(float(np.rad2deg(found[name].min())) - wanted) <= 0.1, name


def test_range_of_the_crank(poses):
    theta = np.rad2deg(poses.angle("crank"))
    assert abs(theta.max() - 130.1) <= 0.1
    assert abs(theta.min() - 40.0) <= 0.1


def turned(pose, outer, inner):
    """The angle of a body to another."""
    return pose.bodies[outer].turned(pose.bodies[inner].conjugate()).angle()


def test_round_trip_from_joints_to_motor_and_back(poses):
    """(PIP, DIP) → (θ, γ) → (PIP, DIP) over the whole square, to 1e-10 degrees."""
    motor = jnp.stack([poses.angle("crank"), turned(poses, "plate", "distal")], axis=-1)
    back = poses_of(gallery("finger-crank"), motor)
    assert bool(jnp.all(back.ok))
    pip, dip = back.value.angle("intermediate"), turned(back.value, "distal", "intermediate")
    error = np.abs(np.stack([pip, dip], axis=-1) - POSTURES)
    assert np.rad2deg(error.max()) <= 1e-10


def test_dip_depends_on_gamma_alone():
    linkage = gallery("finger-crank")

    def dip(inputs):
        return turned(poses_of(linkage, inputs).value, "distal", "intermediate")

    slopes = jax.jit(jax.grad(dip))(linkage.reference.inputs + np.array([0.0, 0.2]))
    assert abs(float(slopes[0])) < 1e-14
    assert abs(float(slopes[1])) > 0.1


def test_transmission_stays_finite_where_lines_are_parallel():
    slopes = jax.jit(
        jax.jacfwd(lambda inputs: finger_transmission(poses_of(gallery("finger"), inputs).value))
    )(np.array([-0.3, -0.4]))
    assert np.isfinite(list(slopes.values())).all()
