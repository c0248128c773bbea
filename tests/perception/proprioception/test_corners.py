"""Joint angles of a toy finger by all corners: exact ones, brute force, and repeats."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, kstest

from designopt.fitting import ROBUST
from designopt.solution import Solution
from perception.proprioception import (
    FingerErrors,
    JointAngleResult,
    JointAngles,
    Observation,
    find_pose,
    split_estimates,
)
from tests.perception.proprioception.toy import (
    ERRORS,
    FOCAL,
    LIMITS,
    LOSING,
    LOST,
    MADE,
    MODEL,
    NOISE,
    POSE,
    corners_of,
    differences,
    frame,
    hinged,
    model_of,
    off_by,
    pixels_of,
    uneven,
    whitened,
)

NONE = np.zeros(ERRORS)
MIDDLE = np.array([320.0, 240.0])
EXACT = 1e-6
"""Angles that are as good as unknown draw an answer to the guess by far less, rad."""


def solved(
    seen: Observation,
    guess: np.ndarray,
    errors: np.ndarray = NONE,
    spread: np.ndarray | None = None,
) -> Solution[JointAngles]:
    """The joint angles of a finger whose errors are known but for a spread."""
    covariance = np.zeros((ERRORS, ERRORS)) if spread is None else spread
    return find_pose(MODEL, seen, guess, FingerErrors.of(MODEL, errors, covariance))


def angles_of(found: Solution[JointAngles]) -> np.ndarray:
    return np.asarray(found.value.angles)


def deviations_of(found: Solution[JointAngles]) -> np.ndarray:
    return np.asarray(found.value.deviations)


def codes_of(found: Solution[JointAngles]) -> list[str]:
    """Names of the results of both joints."""
    names = ("successful", "not_seen", "unsolved", "contradicted", "out_of_range")
    by_message = {JointAngleResult[getattr(JointAngleResult, name)]: name for name in names}
    return [by_message[message] for message in found.messages()]


def correlated(seed: int, **options) -> Observation:
    """Corners with noise, weighted by matrices that are full and different."""
    generator = np.random.default_rng(seed)
    seen = frame(MADE, POSE, generator=generator, **options)
    return uneven(seen, generator.uniform(0.5, 2, (len(MODEL.views), 4, 1, 1)))


def minimum(seen: Observation, guess: np.ndarray, *, robust: bool) -> np.ndarray:
    """Angles of least squares or of least pseudo-Huber loss, by weights that are put right."""
    angles = guess

    def left(pose: np.ndarray) -> np.ndarray:
        return whitened(corners_of(NONE, pose), seen)

    for _ in range(60):
        now, slopes = left(angles), differences(left, angles)
        weights = 1 / np.hypot(1, now / ROBUST) if robust else np.ones(now.size)
        step = np.linalg.solve(slopes.T @ (weights[:, None] * slopes), slopes.T @ (weights * now))
        angles = angles - step
        if np.abs(step).max() < 1e-10:
            break
    return angles


@settings(max_examples=15)
@given(st.tuples(st.floats(-0.19, 1.19), st.floats(-0.19, 1.19)))
def test_exact_corners_give_back_their_angles(pose):
    found = solved(frame(NONE, np.array(pose)), np.array([0.5, 0.5]))
    np.testing.assert_allclose(angles_of(found), pose, atol=EXACT)
    assert found.ok.all()


def test_the_errors_of_the_finger_are_taken_into_account():
    seen = frame(MADE, POSE)
    # Without a guess the search starts at zero.
    for guess in (np.zeros(2), np.array([np.nan, 0.3]), np.full(2, np.nan)):
        np.testing.assert_allclose(angles_of(solved(seen, guess, MADE)), POSE, atol=EXACT)
    assert np.abs(angles_of(solved(seen, np.zeros(2))) - POSE).min() > 1e-3


def test_another_finger_of_the_same_kind_is_another_model():
    # A longer lens images all in proportion from the middle.
    seen = frame(NONE, POSE)
    larger = seen._replace(corners=MIDDLE + 1.4 * (seen.corners - MIDDLE))
    other = find_pose(model_of(hinged(1.4 * FOCAL)), larger, np.zeros(2))
    np.testing.assert_allclose(angles_of(other), POSE, atol=EXACT)
    assert np.abs(angles_of(solved(larger, np.zeros(2))) - POSE).max() > 0.1


def test_the_answer_has_the_least_pseudo_huber_loss():
    # Seen from errors that are not known, many corners are off by more than the limit.
    seen = correlated(0)
    expected = minimum(seen, POSE, robust=True)
    np.testing.assert_allclose(angles_of(solved(seen, POSE)), expected, atol=EXACT)


@pytest.mark.parametrize(("view", "corner"), [(0, 1), (1, 0), (2, 3)])
def test_an_outlier_moves_the_answer_less_than_least_squares(view, corner):
    joint = MODEL.joints[view]
    assert joint is not None
    seen = frame(NONE, POSE, generator=np.random.default_rng(3))
    clean, plain = angles_of(solved(seen, POSE)), minimum(seen, POSE, robust=False)
    # The corner is off in the direction in which its joint moves it.
    slope = differences(lambda pose: corners_of(NONE, pose)[view, corner], POSE)[:, joint]
    way, moved = slope / np.linalg.norm(slope), []
    # Two pixels are seven deviations. What is further off counts less.
    for pixels, least in ((2.0, 1.4), (10.0, 5.0), (30.0, 15.0)):
        wrong = off_by(seen, (view, corner), pixels * way)
        found = angles_of(solved(wrong, POSE))
        np.testing.assert_allclose(found, minimum(wrong, POSE, robust=True), atol=EXACT)
        moved.append(abs(found - clean)[joint])
        assert abs(minimum(wrong, POSE, robust=False) - plain)[joint] > least * moved[-1]
        # The other joint has other views.
        assert found[1 - joint] == pytest.approx(clean[1 - joint], abs=EXACT)
    # At last it pulls no more, however far it is.
    assert moved[-1] < 1.1 * moved[-2]


def test_the_deviation_is_the_scatter_of_noisy_frames_of_unknown_fingers():
    root = 0.12 * (np.eye(ERRORS) + 0.5 * np.ones((ERRORS, ERRORS)))
    generator, off = np.random.default_rng(4), []
    for errors in generator.standard_normal((300, ERRORS)) @ root.T:
        pose = generator.uniform(0, 1, 2)
        seen = frame(errors, pose, generator=generator)
        found = solved(seen, pose + generator.normal(0, 0.1, 2), NONE, root @ root.T)
        off.append((angles_of(found) - pose) / deviations_of(found))
    # 300 draws know a deviation to 4 % (1 σ); the softened loss gives some 3 % too much.
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(off), axis=0)), 0.97, atol=0.12)


@pytest.mark.parametrize(
    ("without", "lost"), [((0, 1), [0]), ((2,), [1]), ((1, 2, 3), [1]), ((0, 1, 2, 3), [0, 1])]
)
def test_a_joint_that_no_view_shows_is_undefined_and_the_other_stays(without, lost):
    found = solved(frame(NONE, POSE, without=without), np.array([0.5, 0.5]))
    expected = ["not_seen" if joint in lost else "successful" for joint in range(2)]
    assert codes_of(found) == expected
    for joint in range(2):
        if joint in lost:
            assert found.margin[joint] == -1
        else:
            assert angles_of(found)[joint] == pytest.approx(POSE[joint], abs=EXACT)
    estimates = split_estimates(found)
    for estimate, message, own in zip(estimates, found.messages(), range(2), strict=True):
        assert estimate.defined == (own not in lost)
        answer = (angles_of(found)[own], deviations_of(found)[own])
        assert not estimate.defined or (estimate.angle, estimate.deviation) == pytest.approx(answer)
        assert estimate.defined or estimate.reason == message != ""


@pytest.mark.parametrize("beyond", [LIMITS[0] - 0.01, LIMITS[1] + 0.01])
def test_an_angle_beyond_the_range_is_undefined_and_the_other_stays(beyond):
    found = solved(frame(NONE, np.array([beyond, 0.4])), np.array([0.5, 0.5]))
    assert codes_of(found) == ["out_of_range", "successful"]
    width = LIMITS[1] - LIMITS[0]
    # The margin is the way to the nearer end of the range, as a part of it.
    np.testing.assert_allclose(found.margin, [-0.01 / width, 0.6 / width], atol=1e-5)
    assert angles_of(found)[1] == pytest.approx(0.4, abs=EXACT)


def test_corners_that_are_no_numbers_give_no_angle():
    found = solved(off_by(frame(NONE, POSE, without=(2,)), (0, 0, 0), np.nan), POSE)
    assert codes_of(found) == ["unsolved", "not_seen"]
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))


def test_a_view_that_is_not_there_need_not_have_corners():
    seen = frame(MADE, POSE, generator=np.random.default_rng(3), without=(LOST,))
    found, same = (find_pose(model, seen, POSE + 0.1) for model in (LOSING, MODEL))
    assert codes_of(found) == ["successful"] * 2
    np.testing.assert_array_equal(angles_of(found), angles_of(same))
    np.testing.assert_array_equal(deviations_of(found), deviations_of(same))


def test_a_model_without_a_derivative_gives_no_angle():
    """Its value is finite, and so is every step that takes the derivative for 0."""

    def predict(errors: jax.Array, angles: jax.Array) -> jax.Array:
        return MODEL.predict(errors, angles) + jnp.sqrt(jnp.abs(errors[0]))

    model = eqx.tree_at(lambda m: m.predict, MODEL, predict)
    found = find_pose(model, frame(NONE, POSE), POSE)
    assert codes_of(found) == ["unsolved"] * 2
    assert found.residual.tolist() == [1, 1]
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))


def test_corners_far_off_slow_the_search_down_and_do_not_end_it():
    """With one corner that counts less, convergence is linear."""
    generator, off = np.random.default_rng(12), 10.0
    for _ in range(60):
        seen = frame(NONE, POSE, generator=generator)
        found = solved(off_by(seen, (0, 1, 1), off), POSE + 0.1)
        # It ends at a minimum, whose misfit is that of an outlier of 30 deviations or more.
        assert codes_of(found) == ["contradicted"] * 2
        assert found.value.misfit.chi_squared > (off / NOISE) ** 2 / 2


ALIKE = np.array([[0.4, 0.1], [0.1, 0.2]])
"""What makes of independent offsets those of corners in all frames alike, px."""


def linearised(
    seen: Observation, errors: np.ndarray, angles: np.ndarray, of: Callable = np.asarray
) -> tuple[np.ndarray, ...]:
    """Deviations of corners, and their slopes by errors, by angles and by every corner's offset."""

    def left(values: np.ndarray) -> np.ndarray:
        own, pose, offsets = np.split(values, [ERRORS, ERRORS + 2])
        return of(whitened(corners_of(own, pose) + pixels_of(offsets, seen), seen))

    at = np.concatenate([errors, angles, np.zeros(seen.corners.size)])
    return left(at), *np.split(differences(left, at), [ERRORS, ERRORS + 2], axis=1)


def test_the_covariance_is_the_inverse_of_the_information():
    seen, spread = correlated(13, alike=ALIKE), 0.2 * np.eye(ERRORS) + 0.1
    found = solved(seen, POSE, MADE, spread)

    def soft(left: np.ndarray) -> np.ndarray:
        return left * np.sqrt(2 / (1 + np.hypot(1, left / ROBUST)))

    left, by_error, by_angle, by_offset = linearised(seen, MADE, angles_of(found))
    total = by_error @ spread @ by_error.T + by_offset @ by_offset.T
    root = np.linalg.cholesky(np.eye(left.size) + total)
    left, slopes = np.linalg.solve(root, left), np.linalg.solve(root, by_angle)
    slopes *= (soft(left + 1e-6) - soft(left - 1e-6))[:, None] / 2e-6
    # That the angles may be anywhere within 10 rad is next to no information.
    expected = np.linalg.inv(slopes.T @ slopes)
    times = 1.0
    for misfit in (found.value.own_misfit, found.value.misfit):
        usual = chi2.isf(0.05, misfit.degrees_of_freedom)
        excess = (misfit.chi_squared - usual) / misfit.degrees_of_freedom
        times = np.maximum(times, np.sqrt(1 + np.maximum(excess, 0)))
    expected *= np.outer(times, times)
    np.testing.assert_allclose(found.value.covariance, expected, rtol=1e-4)
    np.testing.assert_allclose(deviations_of(found), np.sqrt(np.diag(expected)), rtol=1e-4)


@pytest.mark.parametrize("both_ways", [0.0, 0.05])
def test_the_misfit_is_that_of_generalised_least_squares(both_ways):
    """χ² with the inverse of the whole covariance, less what a step of the angles takes away.

    A calibration leaves the finger's errors correlated with what corners are off by.
    """
    seen, spread = correlated(14, without=(3,), alike=ALIKE), 0.2 * np.eye(ERRORS) + 0.1
    known = FingerErrors.of(MODEL, NONE, spread)
    both = np.asarray(known.covariance) + both_ways
    found = find_pose(MODEL, seen, POSE, eqx.tree_at(lambda k: k.covariance, known, both))
    kept = np.repeat(np.any(np.asarray(seen.whitening) != 0, axis=(-1, -2)), 2)
    left, by_error, by_angle, by_offset = linearised(seen, NONE, angles_of(found))
    by_cause = np.concatenate([by_error, by_offset], axis=1)
    covariance = np.eye(left.size) + by_cause @ both @ by_cause.T
    left, by_angle = left[kept], by_angle[kept]
    weight = np.linalg.inv(covariance[np.ix_(kept, kept)])
    step = np.linalg.solve(by_angle.T @ weight @ by_angle, by_angle.T @ weight @ left)
    left = left - by_angle @ step
    misfit = found.value.misfit
    assert float(misfit.chi_squared) == pytest.approx(left @ weight @ left, rel=1e-5)
    # Three views of four corners, two of whose joints are free.
    assert float(misfit.degrees_of_freedom) == 22
    assert float(misfit.tail) == pytest.approx(chi2.sf(left @ weight @ left, 22), rel=1e-4)
    assert float(misfit.rms) == pytest.approx(np.sqrt(left @ weight @ left / 22), rel=1e-5)


def test_an_error_of_one_joint_alone_is_found_in_its_own_views():
    """χ² of one view by itself has fewer degrees of freedom for the same misfit."""
    seen = frame(NONE, POSE, generator=np.random.default_rng(19))
    seen = off_by(seen, (2, [0, 2]), 3.6 * NOISE)
    found = solved(seen, POSE)
    assert codes_of(found) == ["successful", "contradicted"]
    own, both = found.value.own_misfit, found.value.misfit
    np.testing.assert_array_equal(own.degrees_of_freedom, [15, 7])
    left, _, slopes, _ = linearised(seen, NONE, angles_of(found))
    left, slopes = left.reshape(4, 8)[2], slopes.reshape(4, 8, 2)[2, :, 1]
    left = left - slopes * (slopes @ left) / (slopes @ slopes)
    assert float(own.chi_squared[1]) == pytest.approx(left @ left, rel=1e-6)
    assert own.tail[1] < 1e-6 < both.tail


def test_frames_of_the_right_finger_are_refused_as_often_as_the_level_is():
    generator, refused, spread = np.random.default_rng(15), 0, 0.3
    known = FingerErrors.of(MODEL, NONE, spread**2 * np.eye(ERRORS))
    tails = []
    for _ in range(400):
        errors = spread * generator.standard_normal(ERRORS)
        seen = frame(errors, POSE, generator=generator)
        found = find_pose(MODEL, seen, POSE, known, significance=0.05)
        refused += codes_of(found) == ["contradicted"] * 2
        tails.append(float(found.value.misfit.tail))
    # 20 of 400 with a deviation of 4.4; tails of a true model are uniform (Kolmogorov's 1 %).
    assert 20 - 13 <= refused <= 20 + 13
    assert kstest(tails, "uniform").statistic < 1.63 / np.sqrt(400)


def test_angles_scatter_as_little_as_the_information_of_all_corners_allows():
    """Of corners that the finger's errors may move, too; those that they move most count least."""
    generator, spread, poses = np.random.default_rng(20), 1.0, []
    known = FingerErrors.of(MODEL, NONE, spread**2 * np.eye(ERRORS))
    for _ in range(400):
        seen = frame(spread * generator.standard_normal(ERRORS), POSE, generator=generator)
        poses.append(find_pose(MODEL, seen, POSE, known).value)
    _, by_error, by_angle, _ = linearised(frame(NONE, POSE), NONE, POSE)
    total = np.eye(len(by_error)) + spread**2 * by_error @ by_error.T
    bound = np.sqrt(np.diag(np.linalg.inv(by_angle.T @ np.linalg.solve(total, by_angle))))
    off = np.array([pose.angles for pose in poses]) - POSE
    predicted = np.mean([pose.covariance.diagonal() for pose in poses], axis=0)
    # Of 400 draws, the pseudo-Huber loss's few per cent, and what is not linear.
    np.testing.assert_allclose(np.sqrt(np.mean(off**2, axis=0)), bound, rtol=0.12)
    np.testing.assert_allclose(np.sqrt(predicted), bound, rtol=0.12)


def test_a_calibration_that_scattered_makes_larger_deviations_and_smaller_misfits():
    seen = frame(NONE, POSE, generator=np.random.default_rng(16))
    known = FingerErrors.of(MODEL, NONE, 0.1 * np.eye(ERRORS))
    scattered = FingerErrors(known.mean, known.offsets, 4 * known.covariance, jnp.asarray(2.0))
    once, twice = (find_pose(MODEL, seen, POSE, one) for one in (known, scattered))
    np.testing.assert_allclose(deviations_of(twice), 2 * deviations_of(once), rtol=1e-9)
    assert float(twice.value.misfit.rms) == pytest.approx(float(once.value.misfit.rms) / 2)


def test_offsets_of_a_calibrated_finger_are_taken_from_its_corners():
    offsets = np.random.default_rng(18).normal(0, 5, (len(MODEL.views), 4, 2))
    seen = frame(NONE, POSE, alike=ALIKE)
    off = off_by(seen, ..., pixels_of(offsets, seen))
    plain = FingerErrors.of(MODEL, NONE)
    known = FingerErrors(plain.mean, jnp.asarray(offsets), plain.covariance, plain.scale)
    np.testing.assert_allclose(angles_of(find_pose(MODEL, off, POSE, known)), POSE, atol=EXACT)
    assert np.abs(angles_of(find_pose(MODEL, off, POSE, plain)) - POSE).max() > 1e-3


def test_without_a_calibration_the_tolerances_of_fabrication_hold():
    seen = frame(MADE, POSE)
    plain = find_pose(MODEL, seen, POSE)
    stated = find_pose(MODEL, seen, POSE, FingerErrors.of(MODEL, NONE, np.eye(ERRORS)))
    assert plain.ok.all()
    np.testing.assert_array_equal(deviations_of(plain), deviations_of(stated))
    # A finger that is held to be as designed is not this one.
    assert codes_of(solved(seen, POSE)) == ["contradicted"] * 2


TURN = np.array([[np.cos(0.14), np.sin(0.14)], [-np.sin(0.14), np.cos(0.14)]])
PICTURES = {
    "mirrored": lambda off: off * np.array([1, -1]),
    "scaled": lambda off: 1.2 * off,
    "shifted": lambda off: off + np.array([40.0, 0]),
    "turned": lambda off: off @ TURN,
}


@pytest.mark.parametrize("wrong", PICTURES)
def test_corners_of_another_picture_contradict_the_model(wrong):
    seen = frame(NONE, POSE, generator=np.random.default_rng(17))
    corners = MIDDLE + PICTURES[wrong](seen.corners - MIDDLE)
    found = find_pose(MODEL, seen._replace(corners=corners), POSE)
    assert set(codes_of(found)) <= {"contradicted", "unsolved"}


@pytest.mark.parametrize("level", [0.0, 1.0, -0.1, np.nan])
def test_a_level_of_significance_lies_between_0_and_1(level):
    with pytest.raises(ValueError, match="between 0 and 1"):
        find_pose(MODEL, frame(NONE, POSE), POSE, significance=level)
