"""Picture files: what is whole comes as another library decodes it, what is not is named."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from perception.sources import Frame, Item, Loss, LostFrame, open_source
from perception.sources.pictures import PICTURES, PictureFiles
from tests.perception.sources.served import jpeg

GENERATOR = np.random.default_rng(5)

SMOOTH = cv2.GaussianBlur(GENERATOR.integers(0, 256, (90, 120, 3), np.uint8), (0, 0), 3)
"""An image in red, green and blue."""

JPEG = jpeg(SMOOTH[..., ::-1].copy())

LARGE = "more than 100 million pixels"

CUT = "it is cut off or damaged"


def items(path: Path, size: tuple[int, int] | None = None) -> list[Item]:
    with open_source(str(path), size=size) as source:
        return list(source)


def only(path: Path) -> Item:
    (item,) = items(path)
    return item


@pytest.mark.parametrize("ending", [one for one in PICTURES if one != ".pgm"])
def test_a_picture_is_what_another_library_decodes(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"one{ending}"
    cv2.imwrite(str(path), SMOOTH[..., ::-1])
    frame = only(path)
    assert isinstance(frame, Frame)
    with Image.open(path) as other:
        np.testing.assert_allclose(frame.image, np.asarray(other), atol=2)
    assert (frame.number, frame.time, frame.name) == (0, None, path.name)


def test_gray_and_16_bits_and_turned_pictures(tmp_path: Path) -> None:
    gray = SMOOTH[..., 0]
    cv2.imwrite(str(tmp_path / "1.pgm"), gray)
    cv2.imwrite(str(tmp_path / "2.png"), gray.astype(np.uint16) << 8 | 77)
    turned = Image.fromarray(SMOOTH)
    exif = turned.getexif()
    exif[0x0112] = 6  # to be turned when shown
    turned.save(tmp_path / "3.png", exif=exif)
    images = [item.image for item in items(tmp_path) if isinstance(item, Frame)]
    np.testing.assert_array_equal(images, [np.dstack([gray] * 3)] * 2 + [SMOOTH])


def test_a_folder_in_the_order_in_which_people_count(tmp_path: Path) -> None:
    names = ["f1.png", "F2.PNG", "f10.jpg", "g.bmp"]
    for name in names:
        cv2.imwrite(str(tmp_path / name), SMOOTH)
    for name in ("notes.txt", ".hidden.png", "f1.png.bak"):
        (tmp_path / name).write_text("text")
    (tmp_path / "folder.png").mkdir()
    with open_source(str(tmp_path)) as source:
        assert isinstance(source, PictureFiles)
        assert source.ignored == 3
        for _ in range(2):  # it can be iterated again
            found = [item for item in source if isinstance(item, Frame | LostFrame)]
            assert [(item.number, item.name) for item in found] == list(enumerate(names))


BROKEN = {
    "empty.png": (b"", "it is empty"),
    "text.png": (b"some text", "it is no picture"),
    "cut.jpg": (JPEG[: len(JPEG) // 2], CUT),
    "cut but ended.jpg": (JPEG[: len(JPEG) // 2] + b"\xff\xd9", "premature end"),
    "gap.jpg": (JPEG[:1500] + JPEG[1900:], "damaged"),
    "zeros.jpg": (JPEG[:1500] + bytes(400) + JPEG[1900:], "damaged"),
    "head.jpg": (JPEG[:20], CUT),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_picture_is_lost_with_its_reason(name: str, tmp_path: Path) -> None:
    data, reason = BROKEN[name]
    (tmp_path / name).write_bytes(data)
    lost = only(tmp_path / name)
    assert isinstance(lost, LostFrame)
    assert (lost.number, lost.loss, lost.count) == (0, Loss.BROKEN, 1)
    assert reason in lost.reason
    assert "\n" not in str(lost)
    assert str(lost).startswith(f"{name}: ")


@pytest.mark.parametrize("ending", [".png", ".bmp", ".tif", ".webp", ".ppm"])
def test_a_picture_that_is_cut_is_lost(ending: str, tmp_path: Path) -> None:
    data = cv2.imencode(ending, SMOOTH)[1].tobytes()
    for name, part in (("half", len(data) // 2), ("most", len(data) - 3)):
        (tmp_path / f"{name}{ending}").write_bytes(data[:part])
    assert [getattr(item, "loss", None) for item in items(tmp_path)] == [Loss.BROKEN] * 2


def test_filling_before_a_jpegs_end_is_no_damage(tmp_path: Path) -> None:
    """Cameras fill up the last of the words that they send."""
    (tmp_path / "filled.jpg").write_bytes(JPEG[:-2] + bytes(6) + JPEG[-2:] + bytes(100))
    frame = only(tmp_path / "filled.jpg")
    assert isinstance(frame, Frame)
    np.testing.assert_array_equal(frame.image, cv2.imdecode(_bytes(JPEG), cv2.IMREAD_COLOR_RGB))


def test_a_changed_byte_of_a_png_is_found(tmp_path: Path) -> None:
    data = bytearray(cv2.imencode(".png", SMOOTH)[1].tobytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "changed.png").write_bytes(data)
    lost = only(tmp_path / "changed.png")
    assert isinstance(lost, LostFrame)
    assert "damaged" in lost.reason


def test_huge_pictures_are_refused_in_little_memory(tmp_path: Path) -> None:
    """30,000 x 30,000 px: a PNG that is whole, and a JPEG that claims it."""
    head = struct.pack(">IIBBBBB", 30_000, 30_000, 8, 0, 0, 0, 0)
    packer = zlib.compressobj(1)
    rows = b"".join([packer.compress(bytes(30_001 * 100)) for _ in range(300)]) + packer.flush()
    chunks = [(b"IHDR", head), (b"IDAT", rows), (b"IEND", b"")]
    png = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
    (tmp_path / "1.png").write_bytes(png)
    place = JPEG.index(b"\xff\xc0") + 5
    (tmp_path / "2.jpg").write_bytes(
        JPEG[:place] + struct.pack(">HH", 30_000, 30_000) + JPEG[place + 4 :]
    )
    (tmp_path / "3.jpg").write_bytes(JPEG)
    with open_source(str(tmp_path)) as source:
        iterator = iter(source)
        lost = [next(iterator), next(iterator)]
        assert source._decoder is not None
        assert _most_memory(source._decoder._process.pid) < 300e6
        assert isinstance(next(iterator), Frame)
    assert all(isinstance(one, LostFrame) and LARGE in one.reason for one in lost)


def test_a_decoder_that_crashes_costs_one_picture(tmp_path: Path) -> None:
    for number in range(3):
        (tmp_path / f"{number}.jpg").write_bytes(JPEG)
    with open_source(str(tmp_path)) as source:
        seen = []
        for item in source:
            seen.append(item)
            if len(seen) == 1:
                assert source._decoder is not None
                source._decoder._process.kill()
    assert [isinstance(item, Frame) for item in seen] == [True, False, True]
    assert str(seen[1]) == "1.jpg: the decoder crashed on it"


def test_another_size_than_required_is_lost(tmp_path: Path) -> None:
    (tmp_path / "1.jpg").write_bytes(JPEG)
    cv2.imwrite(str(tmp_path / "2.png"), SMOOTH[:40])
    right, wrong = items(tmp_path, size=(120, 90))
    assert isinstance(right, Frame)
    assert isinstance(wrong, LostFrame)
    assert wrong.loss is Loss.OTHER_SIZE
    assert str(wrong) == "2.png: it has 120x40 px (columns x rows), not 120x90"


def test_the_decoders_own_noise_is_not_heard(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name, (data, _) in BROKEN.items():
        (tmp_path / name).write_bytes(data)
    assert len(items(tmp_path)) == len(BROKEN)
    assert capfd.readouterr() == ("", "")


def _bytes(data: bytes) -> np.ndarray:
    return np.frombuffer(data, np.uint8)


def _most_memory(process: int) -> float:
    """Bytes that a process has had at most."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
