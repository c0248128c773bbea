"""Networks trained on drawn chambers: against who always answers the mean, and in a file."""

import dataclasses
import hashlib
import json
import tracemalloc
from pathlib import Path

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
    make_boundary_image,
    shrink,
    train,
)
from perception.posture.estimator import BLOCK
from tests.perception.chamber.drawn import HALF
from tests.refusals import REMOVED, changed

SIZE = (32, 24)
QUICK = Training(epochs=30, batch=32, channels=(4, 8, 8, 16))


def samples(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Shrunk boundary images, and markers that move like the walls: far ones more."""
    moves = np.random.default_rng(seed).uniform(-28, 28, (count, 1, 2))
    labels = [HALF.moved(*move[0]).labels() for move in moves]
    images = [shrink(make_boundary_image(one), SIZE) for one in labels]
    return np.stack(images), moves * np.array([[1 / 3], [2 / 3], [1]])


IMAGES, MARKERS = samples(288, seed=1)
OTHERS = samples(100, seed=2)
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
    assert (record.samples, record.image_size, record.settings) == (288, SIZE, QUICK)
    assert set(record.versions) == {"python", "jax", "equinox", "optax", "numpy"}


def test_the_loss_is_equation_4_in_mm():
    """A step so small that the network stays as it was: the epoch's loss is that of its answers."""
    still = dataclasses.replace(QUICK, epochs=1, learning_rate=1e-12)
    estimator = train(IMAGES, MARKERS, still)
    squares = compute_marker_errors(estimator.predict(IMAGES), MARKERS) ** 2
    expected = (squares @ np.array(QUICK.loss_weights)).mean()
    assert estimator.record.loss[0] == pytest.approx(expected, rel=1e-4)


def test_a_seed_gives_the_same_network_again():
    few = dataclasses.replace(QUICK, epochs=1, loss_weights=EQUAL_WEIGHTS)
    # Fewer samples than a batch.
    one, same, other = (
        train(IMAGES[:20], MARKERS[:20], dataclasses.replace(few, seed=seed)) for seed in (3, 3, 4)
    )
    assert one.record.samples == 20
    leaves = (jax.tree.leaves(each.network) for each in (one, same))
    for a, b in zip(*leaves, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(one.network.weight, other.network.weight)
    # Adam's first step goes by the rate, which has not fallen yet.
    assert np.abs(one.network.weight).max() == pytest.approx(few.learning_rate, rel=1e-3)


def test_of_two_steps_the_second_goes_by_half_of_the_rate_if_it_decays():
    start, steady, decayed = (
        np.asarray(train(IMAGES[:20], MARKERS[:20], settings).network.weight)
        for settings in (
            dataclasses.replace(QUICK, epochs=1),
            dataclasses.replace(QUICK, epochs=2, decay=False),
            dataclasses.replace(QUICK, epochs=2),
        )
    )
    assert np.abs(steady - start).max() > QUICK.learning_rate / 10
    # Weights of 0.003 are stored in single precision, to 2e-10.
    np.testing.assert_allclose(decayed - start, (steady - start) / 2, atol=1e-9)


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


@pytest.fixture
def file(trained, tmp_path) -> Path:
    path = tmp_path / "finger.posture"
    trained.save(path)
    return path


def test_a_file_predicts_the_same_to_the_last_bit(trained, file):
    loaded = PostureEstimator.load(file)
    np.testing.assert_array_equal(loaded.predict(IMAGES), trained.predict(IMAGES))
    assert loaded.record == trained.record
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_blocks_of_images_as_one_by_one(trained):
    found = trained.predict(np.concatenate([IMAGES[:BLOCK], IMAGES[:7]]).astype(np.float64))
    single = np.concatenate([trained.predict(image[None]) for image in IMAGES[:7]])
    # Rounding in float32 may depend on the number of images.
    np.testing.assert_allclose(found[:7], single, atol=1e-4)
    np.testing.assert_allclose(found[BLOCK:], single, atol=1e-4)
    assert trained.predict(IMAGES[:0]).shape == (0, 3, 2)
    with pytest.raises(UserError, match=r"shape \(number, 24, 32\), not \(2, 32, 24\); make"):
        trained.predict(np.zeros((2, 32, 24), np.float32))


def check_refused(file: Path, content: bytes, words: str) -> None:
    file.write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(UserError, match=rf"finger\.posture: {words}"):
            PostureEstimator.load(file)
        # Nothing is made for what only the header claims.
        assert tracemalloc.get_traced_memory()[1] < 10 * len(content) + 1e7
    finally:
        tracemalloc.stop()


def damaged(content: bytes, place: int) -> bytes:
    return content[: place % len(content)] + bytes([content[place] ^ 1]) + content[place:][1:]


def test_a_damaged_or_another_file_is_refused(file):
    content = file.read_bytes()
    others = [damaged(content, place) for place in (3, 200, -40, -1)]
    for other in (*others, content[:-100], b"", b"\x93NUMPY" * 50):
        check_refused(file, other, "damaged, or no posture estimator; train")


def signed(content: bytes) -> bytes:
    return content + hashlib.sha256(content).digest()


def parts_of(file: Path) -> tuple[dict, bytes]:
    line, weights = file.read_bytes()[:-32].split(b"\n", 1)
    return json.loads(line), weights


def made_of(header: dict, weights: bytes) -> bytes:
    return signed(json.dumps(header).encode() + b"\n" + weights)


VERSION = "written by another version"


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("format", "posture estimator 0"),
        ("label_scale", REMOVED),
        ("label_scale", 10**400),
        ("image_mean", "grey"),
        ("record/image_size", [10**9, 10**9]),
        ("record/image_size", [32]),
        ("record/settings/momentum", 0.9),
        ("record/settings/channels", [4, 8, 8, 17]),
        ("record/settings/channels", [10**6] * 4),
        ("record/settings/channels", [1] * 10**3),
        ("record/settings/channels", [4.0, 8, 8, 16]),
    ],
)
def test_a_file_of_another_version_is_refused(file, key, value):
    header, weights = parts_of(file)
    check_refused(file, made_of(changed(header, {key: value}), weights), VERSION)


def test_weights_that_claim_another_shape_or_type_are_refused(file):
    header, weights = parts_of(file)
    claims = [(b"(3, 3, 1, 4)", other) for other in (b"(9**9, 9**9)", b"(3, 3, 4, 1)")]
    claims += [(b"'<f4'", b"'|O8'"), (b"'<f4'", b"'<f2'"), (b"\x93NUMPY\x01", b"\x93NUMPY\x02")]
    others = [weights.replace(claim, other, 1) for claim, other in claims]
    assert weights not in others
    for other in (*others, weights[:-4], weights + bytes(4)):
        check_refused(file, made_of(header, other), VERSION)
    check_refused(file, signed(b"[" * 200_000 + b"\n"), VERSION)  # a deeply nested header


NO_SCALES = {
    "image_mean": (np.nan, -1.0, 1e6),
    "image_deviation": (0.0, np.inf),
    "label_scale": (0.0, -2.0, 1e9),
    "label_mean": ([[0, 0], [0, np.nan], [0, 0]], [[0, 0], [0, 1e9], [0, 0]]),
}


def test_weights_and_scales_that_no_training_gives_are_refused(file):
    header, weights = parts_of(file)
    others = [(header | {name: value}, weights) for name in NO_SCALES for value in NO_SCALES[name]]
    for place in (128, -156, -4):  # first and last weight, last bias
        for value in (np.nan, np.inf, -np.inf, 1e30, -1e4):
            start = place % len(weights)
            spoilt = weights[:start] + np.float32(value).tobytes() + weights[start + 4 :]
            others.append((header, spoilt))
    for other in others:
        words = "its weights or scales are not finite, or far beyond any"
        check_refused(file, made_of(*other), words)


def test_places_that_are_not_there(trained, tmp_path):
    with pytest.raises(UserError, match=r"none: cannot be read: No such file .*; choose another"):
        PostureEstimator.load(tmp_path / "none")
    with pytest.raises(UserError, match="cannot be written"):
        trained.save(tmp_path / "nowhere" / "finger.posture")
