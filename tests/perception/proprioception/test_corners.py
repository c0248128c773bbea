"""Joint angles of a toy finger by all corners: exact ones, brute force, and repeats."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.proprioception import Estimate, Observation, find_pose
from perception.proprioception.corners import ROBUST, deviations, softened
from tests.perception.proprioception.toy import (
    ERRORS,
    FOCAL,
    LIMITS,
    MODEL,
    corners_of,
    differences,
    frame,
    hinged,
    model_of,
    whitened,
)

NONE = np.zeros(ERRORS)
MADE = np.array([0.8, -1.1, 0.6, -0.5])
POSE = np.array([0.7, 0.4])
EXACT = 1e-6
"""Angles that are as good as unknown draw an answer to the guess by far less, rad."""

poses = st.tuples(st.floats(-0.19, 1.19), st.floats(-0.19, 1.19))


def solved(*given) -> list[Estimate]:
    return find_pose(MODEL, *given).estimates


def angles_of(estimates: list[Estimate]) -> np.ndarray:
    return np.array([estimate.angle for estimate in estimates])


def deviations_of(estimates: list[Estimate]) -> np.ndarray:
    return np.array([estimate.deviation for estimate in estimates])


def correlated(seed: int, **options) -> Observation:
    """Corners with noise, weighted by matrices that are full and different."""
    generator = np.random.default_rng(seed)
    seen = frame(MADE, POSE, generator=generator, **options)
    turn = np.array([[1.0, 0.4], [-0.3, 0.8]])
    scales = generator.uniform(0.5, 2, (len(MODEL.views), 4, 1, 1))
    return Observation(seen.corners, np.asarray(seen.whitening) @ turn * scales)


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


@given(poses)
def test_exact_corners_give_back_their_angles(pose):
    estimates = solved(frame(NONE, np.array(pose)), np.array([0.5, 0.5]))
    np.testing.assert_allclose(angles_of(estimates), pose, atol=EXACT)
    assert [estimate.reason for estimate in estimates] == ["all corners"] * 2


def test_the_errors_of_the_finger_are_taken_into_account():
    seen = frame(MADE, POSE)
    known = solved(seen, np.zeros(2), MADE)
    np.testing.assert_allclose(angles_of(known), POSE, atol=EXACT)
    ignored = solved(seen, np.zeros(2))
    assert np.abs(angles_of(ignored) - POSE).min() > 1e-3


def test_another_finger_of_the_same_kind_is_another_model():
    # A longer lens images all in proportion from the middle.
    middle = np.array([320.0, 240.0])
    seen = frame(NONE, POSE)
    larger = Observation(middle + 1.4 * (seen.corners - middle), seen.whitening)
    other = find_pose(model_of(hinged(1.4 * FOCAL)), larger, np.zeros(2)).estimates
    np.testing.assert_allclose(angles_of(other), POSE, atol=EXACT)
    assert np.abs(angles_of(solved(larger, np.zeros(2))) - POSE).max() > 0.1


def test_without_a_guess_it_starts_at_zero():
    seen = frame(NONE, POSE)
    for guess in (np.array([np.nan, 0.3]), np.full(2, np.nan)):
        np.testing.assert_allclose(angles_of(solved(seen, guess)), POSE, atol=EXACT)


def test_deviations_are_those_of_every_corner_after_the_other():
    seen = correlated(0, without=(3,))
    found = jax.jit(lambda e, a: deviations(MODEL, e, a, seen))(NONE, POSE)
    expected = whitened(corners_of(NONE, POSE), seen)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)
    assert not np.any(found[-8:])


def test_slopes_of_deviations_are_those_of_differences():
    seen = correlated(1)
    slopes = jax.jit(jax.jacfwd(lambda e, a: deviations(MODEL, e, a, seen), (0, 1)))
    by_errors, by_angles = slopes(jnp.asarray(MADE), jnp.asarray(POSE))
    expected = differences(lambda e: whitened(corners_of(e, POSE), seen), MADE)
    np.testing.assert_allclose(by_errors, expected, atol=1e-6)
    expected = differences(lambda a: whitened(corners_of(MADE, a), seen), POSE)
    # Slopes are up to 500: step and rounding leave some 1e-9 of that.
    np.testing.assert_allclose(by_angles, expected, atol=1e-6)


def test_softened_deviations_are_those_of_the_pseudo_huber_loss():
    size = np.geomspace(0.01, 1e4, 50)
    left = np.concatenate([-size, size])
    found = np.asarray(softened(jnp.asarray(left)))
    loss = 2 * ROBUST**2 * (np.hypot(1, left / ROBUST) - 1)
    # The closed loss loses half its digits where deviations are small.
    np.testing.assert_allclose(found**2, loss, rtol=1e-9)
    np.testing.assert_array_equal(np.sign(found), np.sign(left))


def test_small_deviations_stay_and_zero_has_a_slope():
    small = np.array([-1e-9, 0.0, 1e-9])
    np.testing.assert_allclose(softened(jnp.asarray(small)), small, rtol=1e-12)
    np.testing.assert_allclose(jax.jit(jax.jacfwd(softened))(jnp.zeros(3)), np.eye(3))


@pytest.mark.parametrize("seed", range(3))
def test_the_answer_has_the_least_pseudo_huber_loss(seed):
    # Seen from errors that are not known, many corners are off by more than the limit.
    seen = correlated(seed)
    expected = minimum(seen, POSE, robust=True)
    np.testing.assert_allclose(angles_of(solved(seen, POSE)), expected, atol=EXACT)


def with_outlier(seen: Observation, view: int, corner: int, pixels: float) -> Observation:
    """One corner off in the direction in which its joint moves it."""
    joint = MODEL.joints[view]
    slope = differences(lambda pose: corners_of(NONE, pose)[view, corner], POSE)[:, joint]
    corners = np.array(seen.corners)
    corners[view, corner] += pixels * slope / np.linalg.norm(slope)
    return Observation(corners, seen.whitening)


@pytest.mark.parametrize(("view", "corner"), [(0, 1), (1, 0), (2, 3)])
def test_an_outlier_moves_the_answer_less_than_least_squares(view, corner):
    joint = MODEL.joints[view]
    assert joint is not None
    seen = frame(NONE, POSE, generator=np.random.default_rng(3))
    clean, plain = angles_of(solved(seen, POSE)), minimum(seen, POSE, robust=False)
    moved = []
    # Two pixels are seven deviations. What is further off counts less.
    for pixels, least in ((2.0, 1.4), (10.0, 5.0), (30.0, 15.0)):
        wrong = with_outlier(seen, view, corner, pixels)
        found = angles_of(solved(wrong, POSE))
        np.testing.assert_allclose(found, minimum(wrong, POSE, robust=True), atol=EXACT)
        moved.append(abs(found - clean)[joint])
        assert abs(minimum(wrong, POSE, robust=False) - plain)[joint] > least * moved[-1]
        # The other joint has other views.
        assert found[1 - joint] == pytest.approx(clean[1 - joint], abs=EXACT)
    # At last it pulls no more, however far it is.
    assert moved[-1] < 1.1 * moved[-2]


def test_the_deviation_is_that_of_least_squares():
    seen = frame(MADE, POSE)
    slopes = differences(lambda pose: whitened(corners_of(MADE, pose), seen), POSE)
    expected = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    estimates = solved(seen, POSE, MADE)
    np.testing.assert_allclose(deviations_of(estimates), expected, rtol=1e-5)


def test_deviations_of_errors_are_added_as_they_move_the_answer():
    seen = frame(MADE, POSE)
    root = np.array(
        [[0.5, 0, 0, 0], [0.2, 0.6, 0, 0], [-0.3, 0.1, 0.4, 0], [0.1, 0.2, 0.3, 0.3]]
    )  # fmt: skip
    spread = root @ root.T
    # How the answer moves is seen by solving again for another finger.
    guess = POSE + 0.01
    moves = differences(lambda errors: angles_of(solved(seen, guess, errors)), MADE)
    alone = deviations_of(solved(seen, POSE, MADE))
    expected = np.sqrt(alone**2 + np.diag(moves @ spread @ moves.T))
    found = deviations_of(solved(seen, POSE, MADE, spread))
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    assert (found > 1.2 * alone).all()


def repeated(errors: np.ndarray, spread: np.ndarray | None) -> np.ndarray:
    """By how many of its deviations each of many noisy frames is off."""
    generator, off = np.random.default_rng(4), []
    for one in errors:
        pose = generator.uniform(0, 1, 2)
        seen = frame(one, pose, generator=generator)
        estimates = solved(seen, pose + generator.normal(0, 0.1, 2), NONE, spread)
        off.append((angles_of(estimates) - pose) / deviations_of(estimates))
    return np.sqrt(np.mean(np.square(off), axis=0))


def test_the_deviation_is_the_scatter_of_noisy_frames():
    # 300 draws know a deviation to 4 % (1 σ); the softened loss says some 3 % too much.
    np.testing.assert_allclose(repeated(np.zeros((300, ERRORS)), None), 0.97, atol=0.12)


def test_the_deviation_is_the_scatter_over_unknown_fingers():
    root = 0.12 * (np.eye(ERRORS) + 0.5 * np.ones((ERRORS, ERRORS)))
    errors = np.random.default_rng(5).standard_normal((300, ERRORS)) @ root.T
    np.testing.assert_allclose(repeated(errors, root @ root.T), 0.97, atol=0.12)


@pytest.mark.parametrize(("without", "lost"), [((0, 1), "bend"), ((2,), "curl"), ((2, 3), "curl")])
def test_a_joint_that_no_view_tells_is_undefined_and_the_other_stays(without, lost):
    estimates = solved(frame(NONE, POSE, without=without), np.array([0.5, 0.5]))
    for estimate, name, angle in zip(estimates, MODEL.names, POSE, strict=True):
        if name == lost:
            assert not estimate.defined
            assert np.isinf(estimate.deviation)
            assert estimate.reason == f"no complete view tells {name}"
        else:
            assert estimate.angle == pytest.approx(angle, abs=EXACT)


def test_one_view_of_a_joint_is_enough_and_tells_less():
    few = solved(frame(NONE, POSE, without=(1,)), POSE)[0]
    assert few.angle == pytest.approx(POSE[0], abs=EXACT)
    assert few.deviation > solved(frame(NONE, POSE), POSE)[0].deviation


def test_without_any_view_there_is_no_angle():
    estimates = solved(frame(NONE, POSE, without=(0, 1, 2, 3)), POSE)
    assert [e.reason for e in estimates] == [f"no complete view tells {n}" for n in MODEL.names]


@pytest.mark.parametrize("beyond", [LIMITS[0] - 0.01, LIMITS[1] + 0.01])
def test_an_angle_beyond_the_range_is_undefined_and_the_other_stays(beyond):
    estimates = solved(frame(NONE, np.array([beyond, 0.4])), np.array([0.5, 0.5]))
    assert not estimates[0].defined
    assert estimates[0].reason == "the corners would have bend beyond its range"
    assert estimates[1].angle == pytest.approx(0.4, abs=EXACT)


def test_corners_that_no_pose_explains_give_no_angle():
    seen = frame(NONE, POSE, without=(2,))
    corners = np.array(seen.corners)
    corners[0, 0, 0] = np.nan
    estimates = solved(Observation(corners, seen.whitening), POSE)
    assert estimates[0].reason == "no pose fits the corners that tell bend"
    assert estimates[1].reason == "no complete view tells curl"
    assert not any(estimate.defined for estimate in estimates)


@pytest.mark.parametrize("off", [10.0, 30.0])
def test_corners_far_off_slow_the_search_down_and_do_not_end_it(off):
    """With one corner that counts less, convergence is linear."""
    generator = np.random.default_rng(12)
    answers = []
    for _ in range(60):
        seen = frame(NONE, POSE, generator=generator)
        corners = np.asarray(seen.corners).copy()
        corners[0, 1, 1] += off
        answers += solved(Observation(corners, seen.whitening), POSE + 0.1)
    assert all(answer.defined for answer in answers)


def test_the_covariance_is_the_inverse_of_the_information():
    seen, spread = correlated(13), 0.2 * np.eye(ERRORS) + 0.1
    found = find_pose(MODEL, seen, POSE, MADE, spread)
    angles = angles_of(found.estimates)

    def left(values: np.ndarray) -> np.ndarray:
        all_of_it = whitened(corners_of(values[:ERRORS], values[ERRORS:]), seen)
        return all_of_it * np.sqrt(2 / (1 + np.hypot(1, all_of_it / ROBUST)))

    slopes = differences(left, np.concatenate([MADE, angles]))
    by_error, by_angle = slopes[:, :ERRORS], slopes[:, ERRORS:]
    own = np.linalg.inv(by_angle.T @ by_angle)
    moved = own @ by_angle.T @ by_error
    # That the angles may be anywhere within 10 rad tells next to nothing.
    np.testing.assert_allclose(found.covariance, own + moved @ spread @ moved.T, rtol=1e-4)
    deviations_squared = np.square(deviations_of(found.estimates))
    np.testing.assert_allclose(np.diag(found.covariance), deviations_squared)


def test_an_undefined_angle_has_no_covariance():
    found = find_pose(MODEL, frame(NONE, POSE, without=(2,)), POSE)
    assert [estimate.defined for estimate in found.estimates] == [True, False]
    own = found.estimates[0].deviation ** 2
    np.testing.assert_allclose(found.covariance, [[own, 0], [0, np.inf]])
