"""Videos: every picture that was written comes or is named as lost."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.sources import Frame, Item, Loss, LostFrame, open_source
from tests.perception.sources.clips import CODES, SIZE, write_clip
from tests.perception.sources.served import number_of

COUNT = 40


def items(path: Path) -> list[Item]:
    with open_source(str(path)) as source:
        return list(source)


def check_sum(found: list[Item], count: int = COUNT) -> None:
    """Numbers follow each other without a gap up to the count, and frames show their numbers."""
    number = 0
    for item in found:
        assert isinstance(item, Frame | LostFrame)
        assert item.number == number
        if isinstance(item, Frame):
            assert number_of(item.image) == number
        number += 1 if isinstance(item, Frame) else item.count
    assert number == count


@pytest.mark.parametrize("ending", CODES)
def test_every_picture_in_order(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"clip{ending}"
    write_clip(path, COUNT)
    found = items(path)
    check_sum(found)
    assert all(isinstance(item, Frame) for item in found)
    frame = found[7]
    assert isinstance(frame, Frame)
    assert frame.image.shape == (SIZE[1], SIZE[0], 3)
    assert frame.name == "frame 7"
    assert frame.time == pytest.approx(7 / 25, abs=1e-3)


def test_colors_are_red_green_blue(tmp_path: Path) -> None:
    path = tmp_path / "red.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), 25.0, SIZE)
    writer.write(np.full((SIZE[1], SIZE[0], 3), (10, 60, 200), np.uint8))  # blue, green, red
    writer.release()
    (frame,) = items(path)
    assert isinstance(frame, Frame)
    np.testing.assert_allclose(frame.image.mean(axis=(0, 1)), (200, 60, 10), atol=4)


@pytest.mark.parametrize("ending", [".avi", ".mkv"])
def test_what_is_cut_off_is_counted(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"clip{ending}"
    data = write_clip(path, COUNT)
    path.write_bytes(data[: len(data) // 2])
    found = items(path)
    check_sum(found)
    *_, last = found
    assert isinstance(last, LostFrame)
    assert last.loss is Loss.ABSENT
    assert last.name == f"frames {last.number} to {COUNT - 1}"
    assert 10 < last.count < 30


def test_a_broken_jpeg_in_a_video_is_lost_alone(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    data = bytearray(write_clip(path, COUNT))
    starts = [at for at in range(len(data)) if data[at : at + 4] == b"\xff\xd8\xff\xfe"]
    data[starts[11] + 1000 : starts[12] - 100] = bytes(starts[12] - starts[11] - 1100)
    path.write_bytes(data)
    found = items(path)
    check_sum(found)
    (lost,) = [item for item in found if isinstance(item, LostFrame)]
    assert (lost.number, lost.loss) == (11, Loss.BROKEN)
    assert "damaged" in lost.reason


def test_what_is_predicted_from_a_damaged_picture_is_lost_too(tmp_path: Path) -> None:
    path = tmp_path / "clip.mkv"
    data = bytearray(write_clip(path, COUNT))
    at = len(data) // 2
    data[at : at + 100] = bytes(100)
    path.write_bytes(data)
    found = items(path)
    check_sum(found)
    lost = [item for item in found if isinstance(item, LostFrame)]
    assert "damaged" in lost[0].reason
    assert {item.reason for item in lost[1:]} <= {"it follows a damaged picture"}
    # MPEG-4 is written with a picture of its own every twelfth time.
    assert lost[-1].number % 12 == 11
    assert isinstance(found[-1], Frame)


UNREADABLE = {
    "empty.avi": b"",
    "text.mp4": b"no video at all, but a text\n" * 30,
    "zeros.mkv": bytes(5000),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_is_no_video_is_one_line(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(UNREADABLE[name])
    (lost,) = items(tmp_path / name)
    assert isinstance(lost, LostFrame)
    assert lost.reason.startswith("it cannot be opened as a video: ")
    assert "\n" not in str(lost)
    assert capfd.readouterr() == ("", "")


def test_an_mp4_without_its_end_cannot_be_opened(tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(write_clip(path, COUNT)[:-2000])
    (lost,) = items(path)
    assert "moov atom not found" in str(lost)


def test_a_playlist_with_the_name_of_a_video_opens_no_address(tmp_path: Path) -> None:
    path = tmp_path / "list.ts"
    path.write_text("#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/clip.ts\n#EXT-X-ENDLIST\n")
    (lost,) = items(path)
    assert isinstance(lost, LostFrame)


def test_a_source_closed_in_the_middle_leaves_no_process(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    write_clip(path, COUNT)
    with open_source(str(path)) as source:
        iterator = iter(source)
        next(iterator)
        assert source._decoder is not None
        process = source._decoder._process
    assert process.poll() is not None
    assert len(list(iterator)) == 0
    check_sum(list(source))
