"""Groups without a closed form: followed as SciPy would, and never to another assembly."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from kinematics import find_assemblies
from tests.helpers import nightly
from tests.kinematics.gallery import gallery, poses_of


def tracked(name, angles):
    """Poses along a sweep by fsolve on lengths alone, each from the one before."""
    linkage = gallery(name)
    structure = linkage.structure
    home = poses_of(linkage, linkage.reference.inputs[None])
    start = {j: np.asarray(home.value.position(j))[0] for j in structure.joints}
    free = [j for j in structure.joints if j not in structure.fixed_joints]
    pairs = []
    for body in structure.moving:
        for i, one in enumerate(body.joints):
            for other in body.joints[i + 1 :]:
                pairs.append((one, other, np.hypot(*(start[one] - start[other]))))
    crank = structure.body("crank")
    pivot, end = crank.joints
    length = np.hypot(*(start[end] - start[pivot]))
    free.remove(end)
    pairs = [pair for pair in pairs if set(pair[:2]) != {pivot, end}]
    x = np.concatenate([start[j] for j in free])
    rows = []
    for angle in angles:
        place = dict(start)
        place[end] = start[pivot] + length * np.array([np.cos(angle), np.sin(angle)])

        def gaps(x, place=place):
            here = place | {j: x[2 * i : 2 * i + 2] for i, j in enumerate(free)}
            return [np.hypot(*(here[a] - here[b])) - size for a, b, size in pairs]

        x = scipy.optimize.least_squares(gaps, x, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        rows.append(np.concatenate([place[end], x]))
    return [end, *free], np.array(rows)


@pytest.mark.parametrize("name", ["stephenson", *nightly("double-butterfly")])
def test_sweeps_agree_with_small_steps_of_scipy(name):
    linkage, turn = gallery(name), 0.5 if name == "double-butterfly" else 2 * np.pi
    angles = float(linkage.reference.inputs[0]) + np.linspace(0, turn, 61)
    joints, expected = tracked(name, angles)
    poses = poses_of(linkage, angles[::20, None])
    assert bool(jnp.all(poses.ok))
    for i, joint in enumerate(joints):
        np.testing.assert_allclose(
            poses.value.position(joint), expected[::20, 2 * i : 2 * i + 2], atol=1e-7
        )


def test_whole_turns_change_nothing():
    linkage = gallery("stephenson")
    angles = np.array([[2.5], [-1.0], [0.3], [5.0]])
    once = poses_of(linkage, angles)
    for turns in (1, -3, 1000):
        again = poses_of(linkage, angles + 2 * np.pi * turns)
        assert bool(jnp.all(again.ok))
        gap = np.abs(again.value.position("P") - once.value.position("P"))
        assert gap.max() < 1e-9


def test_followed_poses_are_among_the_assemblies_and_stay_the_same_one():
    """The sign of the Jacobian's determinant cannot change on the way: no other assembly's does."""
    linkage, angles = gallery("stephenson"), np.linspace(0.0, 6.0, 4)
    followed = poses_of(linkage, angles[:, None]).value.position("P")
    for angle, own in list(zip(angles, followed, strict=True))[1::2]:
        every = find_assemblies(linkage, jnp.asarray([angle]))
        assert every.complete
        distances = [np.hypot(*(pose.position("P") - own)) for pose in every.poses]
        assert min(distances) < 1e-9
