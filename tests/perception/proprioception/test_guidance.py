"""Labels that are suggested, against one information matrix of all that is not known."""

import numpy as np
import pytest

from perception.proprioception import FingerErrors, stack_observations, suggest_labels
from perception.proprioception.guidance import MOST
from tests.perception.proprioception.toy import (
    ERRORS,
    JOINTS,
    LOW,
    MADE,
    MODEL,
    VIEWS,
    corners_of,
    differences,
    frame,
    pixels_of,
    whitened,
)

LABEL = 0.005
POSES = np.array([[low, high] for low in (0.1, 0.5, 1.0) for high in (0.0, 0.8)])
CAUSES = ERRORS + 8 * len(VIEWS)


@pytest.fixture(scope="module")
def seen():
    frames = [frame(MADE, pose, alike=0.2) for pose in POSES]
    frames[4] = frame(MADE, POSES[4], without=LOW, alike=0.2)
    return stack_observations(frames)


def slopes(seen, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Of a frame's corners, by errors and offsets, and by its angles: central differences."""
    own = type(seen)(*(part[number] for part in seen))

    def by_cause(causes: np.ndarray) -> np.ndarray:
        corners = corners_of(causes[:ERRORS], POSES[number])
        return whitened(corners + pixels_of(causes[ERRORS:], own), own)

    begin = np.append(MADE, np.zeros(CAUSES - ERRORS))
    by_angle = differences(lambda pose: whitened(corners_of(MADE, pose), own), POSES[number])
    return differences(by_cause, begin), by_angle


def brute(seen, covariance: np.ndarray, labelled: list[int]) -> float:
    """The deviation over all poses, each by inverting the information on all unknowns at once."""
    parts = [slopes(seen, number) for number in range(len(POSES))]
    squares = []
    for asked in range(len(POSES)):
        frames = [asked, *labelled]
        whole = np.zeros((CAUSES + JOINTS * len(frames),) * 2)
        whole[:CAUSES, :CAUSES] = np.linalg.inv(covariance)
        for place, number in enumerate(frames):
            by_cause, by_angle = parts[number]
            rows = np.zeros((len(by_cause), len(whole)))
            own = slice(CAUSES + JOINTS * place, CAUSES + JOINTS * (place + 1))
            rows[:, :CAUSES], rows[:, own] = by_cause, by_angle
            whole += rows.T @ rows
            whole[own, own] += np.eye(JOINTS) / (LABEL if place else 10.0) ** 2
        variances = np.diag(np.linalg.inv(whole))[CAUSES : CAUSES + JOINTS]
        squares.extend(variances[np.sqrt(variances) < 0.5])
    return float(np.sqrt(np.mean(squares)))


def test_labels_are_those_that_help_most(seen):
    errors = FingerErrors.of(MODEL, mean=MADE)
    covariance = np.asarray(errors.covariance)
    advice = suggest_labels(MODEL, errors, seen, POSES, LABEL)
    assert advice.before == pytest.approx(brute(seen, covariance, []), rel=1e-4)
    assert 1 <= len(advice.poses) <= MOST
    for count in range(len(advice.poses)):
        before = advice.poses[:count]
        tried = [brute(seen, covariance, [*before, one]) for one in range(len(POSES))]
        assert tried[advice.poses[count]] == pytest.approx(min(tried), rel=1e-3)
        assert advice.after[count] == pytest.approx(min(tried), rel=1e-4)
    assert np.all(np.diff([advice.before, *advice.after]) < 0)


def test_nothing_is_suggested_where_the_finger_is_known(seen):
    known = FingerErrors.of(MODEL, mean=MADE, covariance=1e-12 * np.eye(ERRORS))
    small = known.covariance * 1e-12
    advice = suggest_labels(
        MODEL, FingerErrors(known.mean, known.offsets, small, known.scale), seen, POSES, LABEL
    )
    assert advice.poses == []
    assert advice.before < 0.01
