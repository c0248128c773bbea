"""A trained estimator after a journey through a file, and files that are none."""

import functools
import hashlib
import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from designopt.errors import UserError
from perception.posture import PostureEstimator, Training, train
from perception.posture.estimator import BLOCK
from tests.perception.posture.toy import samples

SIZE = (16, 12)
IMAGES, MARKERS = samples(64, SIZE, seed=1)


@pytest.fixture(scope="module")
def estimator() -> PostureEstimator:
    settings = Training(epochs=2, batch=32, channels=(2, 3, 4, 3))
    return train(IMAGES, MARKERS, settings, (IMAGES[:5], MARKERS[:5]))


@pytest.fixture
def file(estimator, tmp_path) -> Path:
    path = tmp_path / "finger.posture"
    estimator.save(path)
    return path


def test_a_file_predicts_the_same_to_the_last_bit(estimator, file):
    loaded = PostureEstimator.load(file)
    np.testing.assert_array_equal(loaded.predict(IMAGES), estimator.predict(IMAGES))
    assert loaded.record == estimator.record
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_blocks_of_images_as_one_by_one(estimator):
    many = np.concatenate([IMAGES] * (BLOCK // 64 + 1))[: BLOCK + 7]
    found = estimator.predict(many.astype(np.float64))
    single = np.concatenate([estimator.predict(image[None]) for image in IMAGES[:7]])
    # Rounding in float32 may depend on the number of images.
    np.testing.assert_allclose(found[:7], single, atol=1e-4)
    np.testing.assert_allclose(found[BLOCK:], single, atol=1e-4)
    assert estimator.predict(IMAGES[:0]).shape == (0, 3, 2)
    with pytest.raises(UserError, match=r"shape \(number, 12, 16\), not \(2, 16, 12\); make"):
        estimator.predict(np.zeros((2, 16, 12), np.float32))


def damaged(content: bytes, place: int) -> bytes:
    return content[: place % len(content)] + bytes([content[place] ^ 1]) + content[place:][1:]


@pytest.mark.parametrize(
    "change",
    [
        *(lambda content, place=place: damaged(content, place) for place in (3, 200, -40, -1)),
        lambda content: content[:-100],
        lambda content: b"",
        lambda content: b"\x93NUMPY" * 50,
    ],
)
def test_a_damaged_or_another_file_is_refused(file, change):
    file.write_bytes(change(file.read_bytes()))
    message = r"finger\.posture: damaged, or no posture estimator; train"
    with pytest.raises(UserError, match=message):
        PostureEstimator.load(file)


OTHERS = {
    "format": "posture estimator 0",
    "label_scale": None,
    "record.settings.channels": [2, 3, 4, 5],
    "record.settings.momentum": 0.9,
    "record.settings.channels huge": [10**6] * 4,
    "record.settings.channels many": [1] * 10**4,
    "record.settings.channels broken": [2.0, 3, 4, 3],
    "record.image_size": [10**9, 10**9],
    "record.image_size short": [16],
    "label_scale enormous": 10**400,
    "image_mean": "grey",
}
"""Values of a header by their keys, with what is wrong with them; ``None`` leaves a key out."""


def written(file: Path, header: dict, weights: bytes) -> None:
    content = json.dumps(header).encode() + b"\n" + weights
    file.write_bytes(content + hashlib.sha256(content).digest())


def parts_of(file: Path) -> tuple[dict, bytes]:
    line, weights = file.read_bytes()[:-32].split(b"\n", 1)
    return json.loads(line), weights


@pytest.mark.parametrize("key", OTHERS)
def test_a_file_of_another_version_is_refused(file, key):
    header, weights = parts_of(file)
    *path, last = key.split(" ")[0].split(".")
    table = functools.reduce(dict.__getitem__, path, header)
    table[last] = OTHERS[key]
    if OTHERS[key] is None:
        del table[last]
    written(file, header, weights)
    tracemalloc.start()
    try:
        with pytest.raises(UserError, match=r"finger\.posture: written by another version"):
            PostureEstimator.load(file)
        # Nothing is made for what only the header claims.
        assert tracemalloc.get_traced_memory()[1] < 10 * file.stat().st_size + 1e7
    finally:
        tracemalloc.stop()


def test_weights_that_claim_another_shape_or_type_are_refused(file):
    header, weights = parts_of(file)
    claims = [(b"(3, 3, 1, 2)", other) for other in (b"(9**9, 9**9)", b"(3, 3, 2, 1)")]
    claims += [(b"'<f4'", b"'|O8'"), (b"'<f4'", b"'<f2'"), (b"\x93NUMPY\x01", b"\x93NUMPY\x02")]
    changed = [weights.replace(claim, other, 1) for claim, other in claims]
    for other in (*changed, weights[:-4], weights + bytes(4)):
        assert other != weights
        written(file, header, other)
        with pytest.raises(UserError, match="written by another version"):
            PostureEstimator.load(file)
    content = b"[" * 200_000 + b"\n"  # a deeply nested header
    file.write_bytes(content + hashlib.sha256(content).digest())
    with pytest.raises(UserError, match="written by another version"):
        PostureEstimator.load(file)


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
            changed = weights[:start] + np.float32(value).tobytes() + weights[start + 4 :]
            others.append((header, changed))
    for other in others:
        written(file, *other)
        with pytest.raises(UserError, match=r"weights or scales are not finite, or far beyond any"):
            PostureEstimator.load(file)


def test_places_that_are_not_there(estimator, tmp_path):
    with pytest.raises(UserError, match=r"none: cannot be read: No such file .*; choose another"):
        PostureEstimator.load(tmp_path / "none")
    with pytest.raises(UserError, match="cannot be written"):
        estimator.save(tmp_path / "nowhere" / "finger.posture")
