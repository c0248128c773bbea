"""Errors of a finger from frames, and the least deviation of joint angles that they leave.

A straight toy has a closed posterior, and all unknowns of a bent one an information matrix.
"""

import numpy as np
import pytest
from scipy.linalg import block_diag

from designopt.solution import Solution
from perception.proprioception import (
    Calibration,
    FingerErrors,
    Observation,
    calibrate,
    compute_information_bound,
    find_pose,
    stack_observations,
)
from perception.proprioception.corners import LOOSE
from tests.perception.proprioception.toy import (
    ERRORS,
    JOINTS,
    LIMITS,
    LOSING,
    LOST,
    LOW,
    MADE,
    MODEL,
    NOISE,
    POSE,
    VIEWS,
    ZERO,
    corners_of,
    differences,
    frame,
    model_of,
    off_by,
    pixels_of,
    straight,
    uneven,
    whitened,
)

FRAMES = 6
LABELS = 0.01
MIDDLE = sum(LIMITS) / 2
"""Where the search for an angle begins that nothing is known of, rad."""

SPREAD_OUT = np.stack([np.linspace(0.0, 1.1, FRAMES), np.linspace(0.9, -0.1, FRAMES)], axis=-1)
NOTHING = (0, 1, 2, 3)
SMALL = 0.1
"""Deviations that are a part of the stated are not softened: by less than a thousandth."""


def parts_of_straight() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(0)
    shape = (len(VIEWS), 4, 2)
    by_angle = generator.normal(0, 20, (*shape, JOINTS))
    # A view is moved by its own joint.
    by_angle[[0, 1], ..., 1] = by_angle[2, ..., 0] = by_angle[3] = 0
    by_error = generator.normal(0, 0.5, (*shape, ERRORS))
    return generator.uniform(100, 500, shape), by_error, by_angle


STRAIGHT = parts_of_straight()
EVERY = np.arange(FRAMES * JOINTS).reshape(FRAMES, JOINTS)
LABELLINGS = {
    "labelled": (EVERY < 0, LABELS, ()),
    "unlabelled": (EVERY < 0, None, ()),
    "unlabelled and without a guess": (EVERY % 5 == 0, None, ()),
    "half labelled": (EVERY % 3 > 0, LABELS, ()),
    "one joint labelled": (EVERY % 2 > 0, LABELS, ()),
    "one joint never seen": (EVERY < 0, LABELS, LOW),
}
"""Labels that are left out, the deviation of the others, and views that no frame shows."""


def seen_straight(without: tuple[int, ...], constant: float) -> tuple[Observation, np.ndarray]:
    """Corners of a straight finger, and their derivatives by errors and all frames' angles.

    What they are off by in all frames alike is larger from frame to frame, as if nearer.
    """
    generator = np.random.default_rng(1)
    middle, by_error, by_angle = STRAIGHT
    corners = middle + by_error @ MADE + np.einsum("vcdj,fj->fvcd", by_angle, SPREAD_OUT)
    corners = corners + generator.normal(0, SMALL * NOISE, corners.shape)
    whitening = np.broadcast_to(np.eye(2) / NOISE, (*corners.shape, 2)).copy()
    whitening[2, 0] = whitening[4, 2] = whitening[:, list(without)] = 0
    slopes = np.zeros((*corners.shape, ERRORS + SPREAD_OUT.size))
    slopes[..., :ERRORS] = by_error
    for number, columns in enumerate(ERRORS + EVERY):
        slopes[number][..., columns] = by_angle
    nearer = (1 + 0.2 * np.arange(FRAMES))[:, None, None, None, None]
    alike = constant * nearer * np.broadcast_to([[0.8, 0.6], [0.6, 1.0]], whitening.shape)
    return Observation(corners, whitening, alike), slopes


@pytest.mark.parametrize(
    ("labelling", "constant"), [("labelled", 0.0), *((labelling, 0.5) for labelling in LABELLINGS)]
)
def test_of_a_straight_finger_the_posterior_is_the_closed_one(labelling, constant):
    hidden, deviation, without = LABELLINGS[labelling]
    noise = SMALL * LABELS * np.random.default_rng(2).standard_normal(SPREAD_OUT.shape)
    labels = np.where(hidden, np.nan, SPREAD_OUT + noise)
    seen, slopes = seen_straight(without, constant)
    found = calibrate(model_of(straight(*STRAIGHT)), seen, labels, deviation)

    spread = np.full(labels.shape, LOOSE)
    if deviation is not None:
        spread[~hidden] = deviation
    prior = np.concatenate([np.ones(ERRORS), spread.ravel() ** -2, np.ones(STRAIGHT[0].size)])
    zero = np.zeros(STRAIGHT[0].size)
    mean = np.concatenate([np.zeros(ERRORS), np.where(hidden, MIDDLE, labels).ravel(), zero])
    # What a column or row is off by in every frame is one more unknown for each.
    alike = np.array([block_diag(*frame.reshape(-1, 2, 2)) for frame in np.asarray(seen.common)])
    there = np.any(np.asarray(seen.whitening) != 0, axis=-1) / NOISE
    slopes = np.concatenate([slopes, alike.reshape(*there.shape, zero.size)], axis=-1)
    weighted = (slopes * there[..., None]).reshape(-1, prior.size)
    data = ((np.asarray(seen.corners) - STRAIGHT[0]) * there).ravel()
    covariance = np.linalg.inv(weighted.T @ weighted + np.diag(prior))
    expected = covariance @ (weighted.T @ data + prior * mean)

    assert found.ok
    scale = np.sqrt(np.diag(covariance))
    # What softening is left moves an answer by less than a hundredth of its deviation.
    errors = found.value.errors
    answer = np.concatenate([errors.mean, found.value.angles.ravel(), np.ravel(errors.offsets)])
    np.testing.assert_allclose((answer - expected) / scale, 0, atol=0.01)
    # The straight frames scatter less than stated, so that nothing is scaled.
    assert float(errors.scale) == 1
    causes = np.r_[:ERRORS, ERRORS + EVERY.size : prior.size]
    own, units = covariance[np.ix_(causes, causes)], np.outer(scale[causes], scale[causes])
    np.testing.assert_allclose(errors.covariance / units, own / units, atol=0.005)


def covariance_of(calibration: Calibration) -> np.ndarray:
    """That of the finger's errors, without the offsets of corners."""
    return np.asarray(calibration.errors.covariance)[:ERRORS, :ERRORS]


def watched(
    errors: np.ndarray,
    generator: np.random.Generator | None = None,
    without: tuple[tuple[int, ...], ...] = ((),) * FRAMES,
    **options,
) -> Observation:
    """The same poses of a bent finger, each without some views."""
    frames = zip(SPREAD_OUT, without, strict=True)
    return stack_observations(
        [frame(errors, pose, generator=generator, without=lost, **options) for pose, lost in frames]
    )


def calibrated(
    seen: Observation, labels: np.ndarray = SPREAD_OUT, deviation: float | None = None
) -> Solution[Calibration]:
    """Of a bent finger."""
    return calibrate(MODEL, seen, labels, deviation)


@pytest.mark.parametrize("off", [0.0, 0.2])
def test_exact_unlabelled_frames_give_all_but_the_zero_of_a_joint(off):
    found = calibrated(watched(MADE), SPREAD_OUT + off)
    assert found.ok
    # What is known before draws the mean of a posterior to zero by its covariance's share; the
    # corners' bend within a deviation adds a little.
    drawn = MADE - covariance_of(found.value) @ MADE
    np.testing.assert_allclose(found.value.errors.mean, drawn, atol=1e-3)
    deviation = np.sqrt(np.diag(covariance_of(found.value)))
    assert np.delete(deviation, ZERO).max() < 0.2
    # An angle of all frames and the zero of their joint are one and the same: it stays unknown.
    assert deviation[ZERO] == pytest.approx(1, abs=1e-3)
    turned = SPREAD_OUT + np.array([0.02 * MADE[ZERO], 0])
    np.testing.assert_allclose(found.value.angles, turned, atol=1e-3)


@pytest.mark.parametrize("hidden", [[], [2, 3, 8]])
def test_exact_labelled_frames_give_the_errors_and_the_angles_without_a_label(hidden):
    labels = SPREAD_OUT.copy()
    labels.flat[hidden] = np.nan
    found = calibrated(watched(MADE, stated=NOISE / 100), labels, LABELS / 100)
    assert found.ok
    # The prior draws them to zero by a part of what is left to be known, 1e-4 of it.
    np.testing.assert_allclose(found.value.errors.mean, MADE, atol=1e-3)
    np.testing.assert_allclose(found.value.angles, SPREAD_OUT, atol=1e-4 if hidden else 1e-5)
    assert np.diag(covariance_of(found.value)).max() < 1e-3


@pytest.mark.parametrize("deviation", [None, LABELS])
def test_what_nothing_is_seen_of_stays_as_it_was(deviation):
    labels = SPREAD_OUT.copy()
    labels[0] = np.nan
    found = calibrated(watched(MADE, without=(NOTHING,) * FRAMES), labels, deviation)
    assert found.ok
    assert found.value.scatter == 0
    np.testing.assert_allclose(found.value.errors.mean, 0, atol=1e-12)
    np.testing.assert_allclose(covariance_of(found.value), np.eye(ERRORS), atol=1e-12)
    expected = np.nan_to_num(labels, nan=MIDDLE)
    np.testing.assert_allclose(found.value.angles, expected, atol=1e-12)


def test_a_view_that_is_not_there_need_not_have_corners():
    without = ((LOST,),) * FRAMES
    seen = watched(MADE, np.random.default_rng(8), without)
    found, same = (calibrate(model, seen, SPREAD_OUT, LABELS) for model in (LOSING, MODEL))
    assert found.ok
    np.testing.assert_array_equal(found.value.errors.mean, same.value.errors.mean)
    np.testing.assert_array_equal(covariance_of(found.value), covariance_of(same.value))
    one = frame(MADE, POSE, without=(LOST,)), POSE
    bound, expected = (
        compute_information_bound(model, MADE, one, (seen, SPREAD_OUT), LABELS)
        for model in (LOSING, MODEL)
    )
    np.testing.assert_array_equal(bound.calibrated, expected.calibrated)


def test_corners_that_are_no_numbers_are_no_calibration():
    found = calibrated(off_by(watched(MADE), (0, 0, 0, 0), np.nan), deviation=LABELS)
    assert not found.ok
    assert np.isfinite(found.value.errors.mean).all()


def test_deviations_of_errors_and_angles_are_the_scatter_of_repeats():
    """Fingers are drawn from what is known of them before."""
    generator, units, zeros, off = np.random.default_rng(6), [], [], []
    for _ in range(40):
        errors = generator.standard_normal(ERRORS)
        labels = SPREAD_OUT + LABELS * generator.standard_normal(SPREAD_OUT.shape)
        found = calibrated(watched(errors, generator), labels, LABELS)
        assert found.ok
        covariance, scale = covariance_of(found.value), float(found.value.errors.scale)
        root = np.linalg.cholesky(np.linalg.inv(covariance))
        units.append(root.T @ (found.value.errors.mean - errors))
        zeros.append(covariance[ZERO, ZERO] / scale**2)
        one = frame(errors, POSE, generator=generator)
        off.append(find_pose(MODEL, one, POSE, found.value.errors).value.angles - POSE)
    # 40 draws give a variance to 22 % (1 σ), and a correlation to 16 %; softening gives up to
    # 8 % too much of a variance.
    squares = np.transpose(units) @ np.array(units) / len(units)
    np.testing.assert_allclose(squares, np.eye(ERRORS), atol=0.5)
    assert np.mean(np.square(units)) == pytest.approx(0.95, abs=0.2)
    # Six labels give it to a fifth of what was known before.
    assert np.mean(zeros) < 0.2
    # 40 draws give a deviation to 11 %. Calibrated first and solved then, not at once, and soft,
    # an answer is a little worse than it could be.
    own, others = (frame(np.zeros(ERRORS), POSE), POSE), (watched(np.zeros(ERRORS)), SPREAD_OUT)
    bound = compute_information_bound(MODEL, np.zeros(ERRORS), own, others, LABELS)
    np.testing.assert_allclose(np.std(off, axis=0) / bound.calibrated, 1.05, atol=0.25)


@pytest.mark.parametrize("times", [0.5, 2.0])
def test_the_scatter_is_how_much_worse_corners_are_than_stated(times):
    generator = np.random.default_rng(7)
    found = [calibrated(watched(MADE, generator, stated=NOISE / times)) for _ in range(10)]
    scatters = np.array([float(one.value.scatter) for one in found])
    # 10 calibrations of 180 degrees of freedom give it to 1.7 % (1 σ).
    assert np.mean(scatters) == pytest.approx(times, rel=0.05)
    # Every column and row but the angles': labels and errors have priors of their own.
    assert float(found[0].value.misfit.degrees_of_freedom) == FRAMES * (8 * len(VIEWS) - JOINTS)
    assert [bool(one.ok) for one in found] == (scatters <= 1.5).tolist()
    if times == 2.0:
        assert "scatter more than 1.5 times" in found[0].messages()[0]


def test_a_scatter_above_1_enlarges_deviations_by_it():
    too_poor, too_good = (
        calibrated(watched(MADE, np.random.default_rng(8), stated=NOISE / times), deviation=LABELS)
        for times in (0.9, 1.3)
    )
    too_poor, too_good = too_poor.value, too_good.value
    scale = float(too_good.scatter)
    assert scale > 1.1
    assert float(too_poor.scatter) < 1
    assert (float(too_poor.errors.scale), float(too_good.errors.scale)) == (1, scale)
    # Corners that are held to be 1.3 times as good, scaled back, are about as good as they are.
    own, other = (np.diag(covariance_of(one)) for one in (too_good, too_poor))
    np.testing.assert_allclose(np.sqrt(own / other), scale / 1.3 / 0.9, rtol=0.25)


@pytest.mark.parametrize("deviation", [0.0, -0.1, np.nan])
def test_labels_without_a_deviation_are_refused(deviation):
    with pytest.raises(ValueError, match="positive deviation"):
        calibrated(watched(MADE), deviation=deviation)


def brute_force(
    one: Observation, frames: Observation, label_deviation: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Both bounds by all unknowns at once: errors, corners' offsets, angles of all frames."""
    poses = np.concatenate([POSE[None], SPREAD_OUT])
    parts = zip(*(np.concatenate([[a], b]) for a, b in zip(one, frames, strict=True)), strict=True)
    observed = [Observation(*part) for part in parts]
    spread = LOOSE if label_deviation is None else label_deviation
    drawn = ERRORS + one.corners.size
    prior = [np.ones(drawn), np.full(JOINTS, LOOSE**-2.0), np.full(SPREAD_OUT.size, spread**-2.0)]
    information = np.diag(np.concatenate(prior))
    for number, (seen, pose) in enumerate(zip(observed, poses, strict=True)):

        def left(values: np.ndarray, seen: Observation = seen) -> np.ndarray:
            errors, offsets, angles = np.split(values, [ERRORS, drawn])
            return whitened(corners_of(errors, angles) + pixels_of(offsets, seen), seen)

        at = np.concatenate([MADE, np.zeros(drawn - ERRORS), pose])
        slopes = differences(left, at)
        own = drawn + JOINTS * number + np.arange(JOINTS)
        place = np.concatenate([np.arange(drawn), own])
        information[np.ix_(place, place)] += slopes.T @ slopes
    asked = drawn + np.arange(JOINTS)
    known = np.linalg.inv(information[np.ix_(asked, asked)])
    total = np.linalg.inv(information)[np.ix_(asked, asked)]
    return np.sqrt(np.diag(known)), np.sqrt(np.diag(total))


CASES = {
    "all seen": ((), ((),) * FRAMES),
    "few views": ((1, 3), ((0,), (1, 2), (3,), (), (), ())),
    "a joint not seen": ((2,), (NOTHING, (0, 1), (), (), (), ())),
    "frames in the dark": ((), (NOTHING,) * FRAMES),
}
"""Views that are not seen in the frame, and in the calibration frames."""


@pytest.mark.parametrize("constant", [0.0, 0.3])
@pytest.mark.parametrize("label_deviation", [LABELS, None])
@pytest.mark.parametrize("case", CASES)
def test_the_bound_is_that_of_all_unknowns_at_once(case, label_deviation, constant):
    lost, others = CASES[case]
    alike = constant * np.array([[1.0, 0.4], [0.4, 0.7]])
    one = uneven(frame(MADE, POSE, without=lost, alike=2 * alike))
    frames = uneven(watched(MADE, without=others, alike=alike))
    own, labelled = (one, POSE), (frames, SPREAD_OUT)
    bound = compute_information_bound(MODEL, MADE, own, labelled, label_deviation)
    known, calibrated = brute_force(one, frames, label_deviation)
    # Differences are good to 1e-9; an inverse whose parts cancel is less good.
    np.testing.assert_allclose(bound.finger_known, known, rtol=1e-6)
    np.testing.assert_allclose(bound.calibrated, calibrated, rtol=1e-5)
    assert (bound.finger_known <= bound.calibrated * (1 + 1e-12)).all()


def test_with_the_finger_known_exact_corners_reach_it():
    one = frame(MADE, POSE)
    bound = compute_information_bound(MODEL, MADE, (one, POSE), (watched(MADE), SPREAD_OUT), LABELS)
    known = FingerErrors.of(MODEL, MADE, np.zeros((ERRORS, ERRORS)))
    found = find_pose(MODEL, one, POSE, known)
    np.testing.assert_allclose(found.value.deviations, bound.finger_known, rtol=1e-6)


def test_what_was_known_before_counts_as_the_frames_did_that_it_came_from():
    """Two halves of the frames, one after the other, are all of them at once."""
    generator = np.random.default_rng(5)
    frames = [frame(MADE, angles, generator=generator, alike=0.2) for angles in SPREAD_OUT]
    labels = SPREAD_OUT + generator.normal(0, LABELS, SPREAD_OUT.shape)
    whole = calibrate(MODEL, stack_observations(frames), labels, LABELS).value
    half = FRAMES // 2
    first = calibrate(MODEL, stack_observations(frames[:half]), labels[:half], LABELS).value
    found, scale = first.errors, first.errors.scale
    before = FingerErrors(found.mean, found.offsets, found.covariance / scale**2, scale)
    given = stack_observations(frames[half:]), labels[half:], LABELS
    second = calibrate(MODEL, *given, before).value
    deviations = np.sqrt(np.diag(whole.errors.covariance))[:ERRORS]
    off = np.asarray(second.errors.mean - whole.errors.mean) / deviations
    assert np.abs(off).max() < 0.05
    alone = calibrate(MODEL, *given).value
    assert np.abs(np.asarray(alone.errors.mean - whole.errors.mean) / deviations).max() > 0.3
