"""Files with random damage end in frames and lines: never in an exception, and all counted."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.sources import Frame, LostFrame, open_source
from tests.perception.sources.clips import damaged, write_clip
from tests.perception.sources.served import picture

COUNT = 25

ENDINGS = (".jpg", ".png", ".webp", ".bmp", ".tif")

CLIPS = ((".avi", "MJPG"), (".avi", "mp4v"), (".mp4", "mp4v"), (".mov", "MJPG"), (".mkv", "mp4v"))
"""Containers that name a number of pictures, and one that only has a duration."""

HEAD = 8192
"""Bytes at the beginning of a Matroska file in which its first picture may vanish unseen."""


def check_pictures(folder: Path, count: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    whole = {
        ending: cv2.imencode(ending, picture(7, (320, 240)))[1].tobytes() for ending in ENDINGS
    }
    for number in range(count):
        ending = ENDINGS[number % len(ENDINGS)]
        (folder / f"{number}{ending}").write_bytes(damaged(whole[ending], generator))
    with open_source(str(folder)) as source:
        found = list(source)
    numbers = [item.number for item in found if isinstance(item, Frame | LostFrame)]
    assert numbers == list(range(count))
    assert len(found) == count
    assert not any("crash" in str(item) for item in found)
    assert sum(isinstance(item, LostFrame) for item in found) > count / 4


def check_clips(folder: Path, count: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    clips = [
        (ending, write_clip(folder / f"whole{number}{ending}", COUNT, code))
        for number, (ending, code) in enumerate(CLIPS)
    ]
    opened = 0
    for number in range(count):
        ending, data = clips[number % len(clips)]
        path = folder / f"damaged{ending}"
        path.write_bytes(damaged(data, generator, HEAD if ending == ".mkv" else 0))
        with open_source(str(path)) as source:
            found = list(source)
        total = 0
        for item in found:
            assert isinstance(item, Frame | LostFrame)
            assert item.number == total, (seed, number)
            total += 1 if isinstance(item, Frame) else item.count
        assert "crash" not in str(found[-1]), (seed, number)
        if len(found) == 1 and "cannot be opened" in str(found[0]):
            continue
        opened += 1
        assert total >= COUNT, (seed, number, ending)
    assert opened > count / 2


def test_damaged_files_are_counted(tmp_path: Path) -> None:
    """20 pictures and 20 clips."""
    for check in (check_pictures, check_clips):
        folder = tmp_path / check.__name__
        folder.mkdir()
        check(folder, 20, 1)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(5))
def test_many_damaged_files_are_counted(seed: int, tmp_path: Path) -> None:
    """500 pictures and 500 clips in all."""
    for check in (check_pictures, check_clips):
        folder = tmp_path / check.__name__
        folder.mkdir()
        check(folder, 100, 100 + seed)
