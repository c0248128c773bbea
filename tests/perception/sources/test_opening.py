"""What a person types: which source it is, and one line with the cure if it is none."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from designopt.errors import UserError
from perception.sources import open_source
from perception.sources.opening import _device
from perception.sources.pictures import PictureFiles
from perception.sources.videos import VideoFile

WRONG = {
    "": "source: there is no such file; name a picture",
    "nothing.png": "nothing.png: there is no such file; name a picture",
    "text.txt": "text.txt: is neither a picture (.png, ",
    "ftp://127.0.0.1/a.png": "ftp is no scheme of a camera; use one of http, https, rtsp, rtsps",
    "empty": "empty: there is no picture in the folder, of 0 files; a picture ends in .png, ",
    "pipe.png": "pipe.png: that is no ordinary file; name a picture",
    300 * "long": "cannot be read: ",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_name_is_one_line_with_the_cure(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.txt").write_text("text")
    (tmp_path / "empty").mkdir()
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(UserError) as caught:
        open_source(text)
    assert WRONG[text] in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_by_their_endings(tmp_path: Path) -> None:
    """A file may be called as a camera is, if it is named with its folder."""
    cv2.imwrite(str(tmp_path / "one.PNG"), np.zeros((4, 4, 3), np.uint8))
    (tmp_path / "clip.MP4").write_bytes(b"x")
    folder, picture, video = (
        open_source(str(path)) for path in (tmp_path, tmp_path / "one.PNG", tmp_path / "clip.MP4")
    )
    assert isinstance(folder, PictureFiles)
    assert folder.ignored == 1
    assert isinstance(picture, PictureFiles)
    assert isinstance(video, VideoFile)


def test_names_of_devices(tmp_path: Path) -> None:
    numbers = {"0": 0, "12": 12, "camera:3": 3, "/dev/video7": 7}
    assert {text: _device(text) for text in numbers} == numbers
    others = ("", "one", "-1", "camera:", "1.png", "./0", "/dev/null", "12345", "٣")
    assert {_device(text) for text in others} == {None}
