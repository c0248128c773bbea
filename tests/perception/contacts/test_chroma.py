"""Colors of every pixel, and of half of them: noise, edges, and what libjpeg and FFmpeg store."""

import cv2
import numpy as np
import pytest

from designopt import UserError
from perception.contacts import has_fine_colors


def scene(noise: float) -> np.ndarray:
    """Slanted colored stripes."""
    generator = np.random.default_rng(0)
    rows, columns = np.mgrid[:240, :320]
    waves = [np.sin(columns / a + rows / b) for a, b in ((17, 40), (23, -31), (9, 60))]
    image = 110 + 50 * np.sign(np.stack(waves, axis=-1))
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + generator.normal(0, noise, image.shape)
    return np.rint(np.clip(image, 0, 255)).astype(np.uint8)


def stored(image: np.ndarray, quality: int, sampling: int) -> np.ndarray:
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    _, file = cv2.imencode(".jpg", image[..., ::-1], options)
    found = cv2.imdecode(file, cv2.IMREAD_COLOR)
    assert found is not None
    return np.ascontiguousarray(found[..., ::-1])


@pytest.mark.parametrize("shift", [0, 1])
@pytest.mark.parametrize("dimmed", [1.0, 0.15])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_images_of_three_colors_a_pixel_are_fine(noise, dimmed, shift):
    image = (dimmed * scene(noise)).astype(np.uint8)
    assert has_fine_colors(np.ascontiguousarray(image[:, shift:]))


@pytest.mark.parametrize("code", [cv2.COLOR_BayerRGGB2RGB, cv2.COLOR_BayerRGGB2RGB_EA])
def test_images_of_one_color_a_pixel_are_fine(code):
    image = scene(2.0)
    bayer = image[..., 1].copy()
    bayer[::2, ::2], bayer[1::2, 1::2] = image[::2, ::2, 0], image[1::2, 1::2, 2]
    assert has_fine_colors(cv2.cvtColor(bayer, code))


@pytest.mark.parametrize("shift", [0, 1])
@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize("quality", [75, 90, 98])
@pytest.mark.parametrize(
    "sampling", [cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422]
)
def test_compressed_images_are_not(sampling, quality, noise, shift):
    image = stored(scene(noise), quality, sampling)
    assert not has_fine_colors(np.ascontiguousarray(image[:, shift:]))


def test_pictures_of_a_video_are_not(tmp_path):
    path = str(tmp_path / "video.mp4")
    writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"mp4v"), 10, (320, 240))
    for _ in range(3):
        writer.write(scene(2.0)[..., ::-1])
    writer.release()
    _, found = cv2.VideoCapture(path).read()
    assert not has_fine_colors(np.ascontiguousarray(found[..., ::-1]))


def test_where_no_color_changes_none_is_missing():
    assert has_fine_colors(np.full((8, 8, 3), 90, np.uint8))
    assert has_fine_colors(np.zeros((2, 3, 3), np.uint8))
    assert has_fine_colors(scene(0.0)[:8, :6])


@pytest.mark.parametrize("image", [np.zeros((8, 8), np.uint8), np.zeros((8, 8, 3)), "no image"])
def test_what_is_no_image_of_colors_is_refused(image):
    with pytest.raises(UserError, match="the image"):
        has_fine_colors(image)
