"""Trainings on a toy chamber, against who always answers the mean and against each other."""

import dataclasses

import jax
import numpy as np
import pytest

from designopt.errors import UserError
from perception.posture import (
    EQUAL_WEIGHTS,
    PostureEstimator,
    Training,
    compute_marker_errors,
    compute_mean_predictor_error,
    train,
)
from tests.perception.posture.toy import samples

SIZE = (32, 24)
QUICK = Training(epochs=30, batch=32, channels=(4, 8, 8, 16))
IMAGES, MARKERS = samples(300, SIZE, seed=1)
OTHERS = samples(100, SIZE, seed=2)
MEAN_PREDICTOR = compute_mean_predictor_error(MARKERS, OTHERS[1])


def tip_error(estimator: PostureEstimator) -> float:
    return float(compute_marker_errors(estimator.predict(OTHERS[0]), OTHERS[1])[:, -1].mean())


@pytest.fixture(scope="module")
def trained() -> PostureEstimator:
    return train(IMAGES, MARKERS, QUICK, OTHERS)


def test_errors_by_hand():
    train_markers, markers = np.zeros((2, 2, 3, 2))
    train_markers[1, 2] = (0.0, 8.0)
    markers[0, 2], markers[1, 2] = (3.0, 0.0), (0.0, 4.0)
    assert compute_mean_predictor_error(train_markers, markers) == 2.5  # (3, 4) and (0, 0) off
    errors = compute_marker_errors(np.full((2, 3, 2), [3.0, 4.0]), np.zeros((2, 3, 2)))
    np.testing.assert_array_equal(errors, np.full((2, 3), 5.0))


@pytest.mark.parametrize(
    ("change", "worse"), [({"standardise": False}, 1.2), ({"regularisation": 10.0}, 2.0)]
)
def test_raw_images_and_strong_regularisation_are_worse(trained, change, worse):
    assert tip_error(trained) < MEAN_PREDICTOR / 5
    other = train(IMAGES, MARKERS, dataclasses.replace(QUICK, **change))
    assert np.isfinite(other.record.loss).all()
    assert tip_error(other) > worse * tip_error(trained)


def test_the_record(trained):
    record = trained.record
    assert len(record.loss) == len(record.tip_error) == len(record.seconds) == QUICK.epochs
    assert record.tip_error[-1] == pytest.approx(tip_error(trained), rel=1e-6)
    assert record.loss[-1] < record.loss[0] / 10
    assert record.seconds == tuple(sorted(record.seconds))
    assert record.total_seconds == record.seconds[-1]
    assert (record.samples, record.image_size, record.settings) == (300, SIZE, QUICK)
    assert set(record.versions) == {"python", "jax", "equinox", "optax", "numpy"}


def test_the_loss_is_equation_4_in_mm():
    """A step so small that the network stays as it was: the epoch's loss is that of its answers."""
    still = dataclasses.replace(QUICK, epochs=1, learning_rate=1e-12)
    estimator = train(IMAGES[:256], MARKERS[:256], still)
    squares = compute_marker_errors(estimator.predict(IMAGES[:256]), MARKERS[:256]) ** 2
    expected = (squares @ np.array(QUICK.loss_weights)).mean()
    assert estimator.record.loss[0] == pytest.approx(expected, rel=1e-4)


def test_a_seed_gives_the_same_network_again():
    few = dataclasses.replace(QUICK, epochs=2, loss_weights=EQUAL_WEIGHTS)
    # Fewer samples than a batch.
    one, same, other = (
        train(IMAGES[:20], MARKERS[:20], dataclasses.replace(few, seed=seed)) for seed in (3, 3, 4)
    )
    assert one.record.samples == 20
    leaves = (jax.tree.leaves(each.network) for each in (one, same))
    for a, b in zip(*leaves, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(one.network.weight, other.network.weight)


@pytest.mark.parametrize(
    ("images", "markers", "message"),
    [
        (IMAGES[:9] * np.float32(np.nan), MARKERS[:9], "finite"),
        (IMAGES[:9], MARKERS[:9] * np.inf, "finite"),
        (IMAGES[:9] * np.float32(0), MARKERS[:9], "all the same"),
        (IMAGES[:9], np.full((9, 3, 2), 12.3), "all the same"),
        (np.repeat(IMAGES[:1], 9, axis=0), MARKERS[:9], "all the same"),
        (IMAGES[:0], MARKERS[:0], "no pixels"),
    ],
)
def test_samples_that_teach_nothing_are_refused(images, markers, message):
    with pytest.raises(UserError, match=message):
        train(images, markers, QUICK)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"epochs": 0}, "epochs is at least 1, not 0"),
        ({"batch": 0}, "batch is at least 1, not 0"),
        ({"learning_rate": 0.0}, "learning_rate is positive"),
        ({"learning_rate": float("nan")}, "learning_rate is positive"),
        ({"regularisation": -1.0}, "regularisation is finite and at least 0"),
        ({"loss_weights": (1.0, 0.0, 1.0)}, "3 positive finite numbers"),
        ({"seed": -1}, "seed is at least 0"),
        ({"channels": ()}, "channels are one or more"),
        ({"channels": (4, 0)}, "channels are one or more"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Training(**settings)
