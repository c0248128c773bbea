"""A trained estimator after a journey through a file, and files that are none."""

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
    found = estimator.predict(many)
    single = np.concatenate([estimator.predict(image[None]) for image in IMAGES[:7]])
    # Rounding in float32 may depend on the number of images.
    np.testing.assert_allclose(found[:7], single, atol=1e-4)
    np.testing.assert_allclose(found[BLOCK:], single, atol=1e-4)


def test_images_of_float64_are_those_of_float32(estimator):
    found = estimator.predict(IMAGES.astype(np.float64))
    np.testing.assert_array_equal(found, estimator.predict(IMAGES))


def test_no_images_give_no_markers(estimator):
    assert estimator.predict(IMAGES[:0]).shape == (0, 3, 2)


def test_images_of_another_size_are_refused(estimator):
    with pytest.raises(UserError, match=r"shape \(number, 12, 16\), not \(2, 16, 12\); make"):
        estimator.predict(np.zeros((2, 16, 12), np.float32))


@pytest.mark.parametrize("place", [3, 200, -40, -1])
def test_a_damaged_file_is_refused(file, place):
    content = bytearray(file.read_bytes())
    content[place] ^= 1
    file.write_bytes(content)
    with pytest.raises(
        UserError, match=r"finger\.posture: damaged, or no posture estimator; train"
    ):
        PostureEstimator.load(file)


@pytest.mark.parametrize("content", [b"", b"nothing", b"\x93NUMPY" * 50])
def test_another_file_is_refused(file, content):
    file.write_bytes(content)
    with pytest.raises(UserError, match="damaged, or no posture estimator"):
        PostureEstimator.load(file)


def test_a_truncated_file_is_refused(file):
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(UserError, match="damaged, or no posture estimator"):
        PostureEstimator.load(file)


def other_format(header: dict) -> None:
    header["format"] = "posture estimator 0"


def without_scale(header: dict) -> None:
    del header["label_scale"]


def other_network(header: dict) -> None:
    header["record"]["settings"]["channels"] = [2, 3, 4, 5]


def unknown_setting(header: dict) -> None:
    header["record"]["settings"]["momentum"] = 0.9


def many_channels(header: dict) -> None:
    header["record"]["settings"]["channels"] = [10**6] * 4


def many_layers(header: dict) -> None:
    header["record"]["settings"]["channels"] = [1] * 10**4


def broken_channels(header: dict) -> None:
    header["record"]["settings"]["channels"] = [2.0, 3, 4, 3]


def enormous_images(header: dict) -> None:
    header["record"]["image_size"] = [10**9, 10**9]


def no_image_size(header: dict) -> None:
    header["record"]["image_size"] = [16]


def enormous_scale(header: dict) -> None:
    header["label_scale"] = 10**400


def word_for_a_scale(header: dict) -> None:
    header["image_mean"] = "grey"


def written(file: Path, header: dict, weights: bytes) -> None:
    content = json.dumps(header).encode() + b"\n" + weights
    file.write_bytes(content + hashlib.sha256(content).digest())


def parts_of(file: Path) -> tuple[dict, bytes]:
    line, weights = file.read_bytes()[:-32].split(b"\n", 1)
    return json.loads(line), weights


@pytest.mark.parametrize(
    "change",
    [
        other_format,
        without_scale,
        other_network,
        unknown_setting,
        many_channels,
        many_layers,
        broken_channels,
        enormous_images,
        no_image_size,
        enormous_scale,
        word_for_a_scale,
    ],
)
def test_a_file_of_another_version_is_refused(file, change):
    header, weights = parts_of(file)
    change(header)
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
    for claim, other in ((b"(3, 3, 1, 2)", b"(9**9, 9**9)"), (b"(3, 3, 1, 2)", b"(3, 3, 2, 1)"),
                         (b"(3, 3, 1, 2)", b"(10**12,)   "[:12]), (b"'<f4'", b"'|O8'"),
                         (b"'<f4'", b"'<f2'"), (b"\x93NUMPY\x01", b"\x93NUMPY\x02")):  # fmt: skip
        assert weights.count(claim) >= 1
        written(file, header, weights.replace(claim, other, 1))
        with pytest.raises(UserError, match="written by another version"):
            PostureEstimator.load(file)
    for other in (weights[:-4], weights + bytes(4)):
        written(file, header, other)
        with pytest.raises(UserError, match="written by another version"):
            PostureEstimator.load(file)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -1e4])
@pytest.mark.parametrize("place", [128, -156, -4])  # first and last weight, last bias
def test_weights_that_no_training_gives_are_refused(file, place, value):
    header, weights = parts_of(file)
    changed = bytearray(weights)
    start = place % len(changed)
    changed[start : start + 4] = np.float32(value).tobytes()
    written(file, header, bytes(changed))
    with pytest.raises(UserError, match=r"weights or scales are not finite, or far beyond any"):
        PostureEstimator.load(file)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("image_mean", float("nan")),
        ("image_mean", -1.0),
        ("image_mean", 1e6),
        ("image_deviation", 0.0),
        ("image_deviation", float("inf")),
        ("label_scale", 0.0),
        ("label_scale", -2.0),
        ("label_scale", 1e9),
        ("label_mean", [[0, 0], [0, float("nan")], [0, 0]]),
        ("label_mean", [[0, 0], [0, 1e9], [0, 0]]),
    ],
)
def test_scales_that_no_training_gives_are_refused(file, name, value):
    header, weights = parts_of(file)
    header[name] = value
    written(file, header, weights)
    with pytest.raises(UserError, match=r"weights or scales are not finite, or far beyond any"):
        PostureEstimator.load(file)


def test_a_deeply_nested_header_is_refused(file):
    content = b"[" * 200_000 + b"\n"
    file.write_bytes(content + hashlib.sha256(content).digest())
    with pytest.raises(UserError, match="written by another version"):
        PostureEstimator.load(file)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(UserError, match=r"none: cannot be read: No such file .*; choose another"):
        PostureEstimator.load(tmp_path / "none")


def test_a_folder_that_is_not_there(estimator, tmp_path):
    with pytest.raises(UserError, match="cannot be written"):
        estimator.save(tmp_path / "nowhere" / "finger.posture")
