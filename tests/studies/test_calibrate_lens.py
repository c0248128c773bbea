"""`designopt calibrate lens` on pictures whose lens is known without the code that finds it."""

import shutil

import cv2
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import cli
from optics.calibration import read_lens
from perception.boards import Board
from studies.commands.lens import find_boards
from tests.perception.boards.pictured import CHARUCO, View, before, picture, turned

LENS = View(lens="equisolid", size=(640, 480), pupil=0.6)
PLACES = [(0, 24, 0), (30, 22, 60), (40, 26, 150), (-35, 24, 250), (-45, 28, 20), (50, 24, 300)]
"""Angle off the axis (degrees), distance (mm) and direction of the tilt of each picture."""


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """A folder of pictures, one that is broken, and one without a board."""
    folder = tmp_path_factory.mktemp("board") / "pictures"
    folder.mkdir()
    for number, (off, distance, toward) in enumerate(PLACES):
        view = before(LENS, CHARUCO, off, distance, turned(25, toward, 40 * number))
        cv2.imwrite(str(folder / f"{number}.png"), picture(view, CHARUCO))
    (folder / "broken.png").write_bytes(b"\x89PNG and no more")
    cv2.imwrite(str(folder / "wall.png"), np.full((480, 640), 90, np.uint8))
    (folder / "notes.txt").write_text("six of them")
    return folder


@pytest.fixture(scope="module")
def done(pictures, tmp_path_factory):
    out = tmp_path_factory.mktemp("lens") / "mine.toml"
    assert cli.run(["calibrate", "lens", str(pictures), "--out", str(out)]) == 0
    return out


def test_the_lens_is_that_of_the_pictures(done):
    found = read_lens(done)
    assert found.size == (640, 480)
    assert found.pictures == len(PLACES)
    # A tenth of a pixel at most: corners are off by hundredths.
    np.testing.assert_allclose(found.lens.principal, LENS.middle, atol=0.1)
    angles = np.linspace(0.1, 0.95 * found.widest, 20)
    heights = np.asarray(found.lens.focal * found.lens.projection.height(jnp.asarray(angles)))
    np.testing.assert_allclose(heights, LENS.focal * 2 * np.sin(angles / 2), atol=0.15)
    np.testing.assert_allclose(
        found.lens.shift(jnp.asarray(angles)), LENS.pupil * angles**2, atol=0.05
    )
    assert found.held_out < 0.1
    assert 15 < found.distances[0] <= found.distances[1] < 60


def test_it_writes_a_figure_and_lists_what_it_left_out(pictures, tmp_path, capsys):
    out = tmp_path / "lens.toml"
    words = ["calibrate", "lens", str(pictures), "--out", str(out), "--distance", "25:60"]
    assert cli.run(words) == 0
    captured = capsys.readouterr()
    assert f"pictures: {len(PLACES)} used, 1 without a board, 1 unreadable" in captured.out
    assert "pupil: moving" in captured.out
    assert "broken.png: " in captured.err
    assert "wall.png: no board is found" in captured.err
    assert "the board is not 25 to 60 mm away" in captured.err
    for ending in (".png", ".svg"):
        assert out.with_suffix(ending).stat().st_size > 10_000
    assert cli.run(words) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["nowhere"], "nowhere: there is no such file"),
        (["pictures", "--distance", "60"], "--distance 60: write it as NEAREST:FARTHEST in mm"),
        (["pictures", "--distance", "60:15"], "--distance 60:15: write it as"),
        (["pictures", "--board", "none.toml"], "none.toml: cannot be read"),
        (["pictures", "--out", "no/lens.toml"], "there is no folder no; make it first"),
    ],
)
def test_faults_are_one_line(tmp_path, monkeypatch, capsys, words, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pictures").mkdir()
    cv2.imwrite(str(tmp_path / "pictures/0.png"), np.zeros((60, 80), np.uint8))
    assert cli.run(["calibrate", "lens", *words]) == 2
    captured = capsys.readouterr().err
    assert line in captured
    assert len(captured.splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pictures"]


def test_pictures_of_two_sizes_or_without_a_board_are_refused(pictures, tmp_path, capsys):
    folder = tmp_path / "mixed"
    folder.mkdir()
    shutil.copy(pictures / "0.png", folder)
    small = cv2.resize(np.asarray(cv2.imread(str(pictures / "1.png"))), (320, 240))
    cv2.imwrite(str(folder / "1.png"), small)
    assert cli.run(["calibrate", "lens", str(folder), "--out", str(tmp_path / "a.toml")]) == 2
    assert "1.png: it has 320x240 px and those before it 640x480" in capsys.readouterr().err
    shutil.copy(pictures / "wall.png", folder / "0.png")
    (folder / "1.png").unlink()
    assert cli.run(["calibrate", "lens", str(folder), "--out", str(tmp_path / "a.toml")]) == 2
    assert "no picture shows the board, of 1 that can be read" in capsys.readouterr().err


def test_a_video_gives_pictures_that_differ(pictures, tmp_path):
    video = cv2.VideoWriter(
        str(tmp_path / "board.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (640, 480)
    )
    for number in (0, 0, 0, 1, 1, 2):
        video.write(np.asarray(cv2.imread(str(pictures / f"{number}.png"))))
    video.release()
    found = find_boards(str(tmp_path / "board.avi"), Board())
    assert found.names == ["frame 0", "frame 3", "frame 5"]
    assert found.size == (640, 480)
