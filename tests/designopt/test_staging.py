"""Results that are replaced by processes killed on the way: the old one or the new one is there."""

import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from designopt import UserError, staging
from designopt.result_folders import result_folder
from designopt.staging import recover, staging_folder
from tests.designopt import killed

ROOT = Path(__file__).parents[2]


def start(out: Path, *how: str) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, killed.__file__, str(out), *how],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def leftovers(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != "out")


@pytest.mark.parametrize("way", ["exchange", "rename"])
def test_killed_at_every_step_there_is_a_whole_result(tmp_path, way):
    """By exchange one is there at once; by renaming twice, after the next run at the latest."""
    with start(tmp_path / "out", way) as process:
        told, errors = process.communicate()
    assert process.returncode == 0, errors.decode()
    steps, missing = map(int, told.split())
    assert steps > 50
    assert missing == 0 if way == "exchange" else missing > 0


def kill_at_random_moments(tmp_path: Path, count: int) -> None:
    out, generator = tmp_path / "out", random.Random(0)
    killed.write(out, 0)
    for _ in range(count):
        before = (out / "results.json").read_text()
        with start(out) as process:
            while (out / "results.json").read_text() == before:  # until it is at work
                assert process.poll() is None
                time.sleep(0.001)
            time.sleep(generator.uniform(0, 0.05))
            process.kill()
        number = killed.number_of(out)
        killed.write(out, number + 1)
        assert leftovers(tmp_path) == []


def test_killed_at_random_moments_there_is_a_whole_result(tmp_path):
    kill_at_random_moments(tmp_path, 5)


@pytest.mark.slow
def test_killed_at_50_random_moments_there_is_a_whole_result(tmp_path):
    kill_at_random_moments(tmp_path, 50)


def keep(folder: Path, place: Path) -> None:
    raise AssertionError(f"nothing was replaced, and {folder} is to be discarded for {place}")


def test_a_folder_at_which_a_process_is_at_work_stays(tmp_path):
    with staging_folder(tmp_path / "out", keep) as mine:
        (mine.folder / "half").touch()
        recover(tmp_path / "other", keep)
        with staging_folder(tmp_path / "other", keep) as other:
            assert other.folder != mine.folder
        with pytest.raises(staging.BusyError):
            recover(tmp_path / "out", keep)
        assert (mine.folder / "half").exists()
    assert list(tmp_path.iterdir()) == []


def test_two_runs_for_one_place_are_refused_at_once(tmp_path):
    with (
        staging_folder(tmp_path / "out", keep),
        pytest.raises(UserError, match="another run is writing its result there"),
    ):
        killed.write(tmp_path / "out", 1)
    killed.write(tmp_path / "out", 1)


def test_what_only_looks_like_a_staging_folder_is_never_touched(tmp_path):
    with staging_folder(tmp_path / "out", keep) as own:
        name = own.folder.parent.name
    names = [
        ".partial-thesis",
        ".partial-abcdefg1",
        f"{name[:-1]}{'a' if name[-1] != 'a' else 'b'}",
    ]
    for each in names:
        (tmp_path / each / "new").mkdir(parents=True)
        (tmp_path / each / "lock").touch()
        (tmp_path / each / "new" / "mine.txt").touch()
    (tmp_path / ".partial-empty123").mkdir()
    (tmp_path / name).symlink_to(tmp_path / names[0])
    recover(tmp_path / "out", keep)
    expected = sorted([*names, ".partial-empty123", name])
    assert sorted(path.name for path in tmp_path.iterdir()) == expected
    for each in names:
        assert (tmp_path / each / "new" / "mine.txt").exists()


def test_after_a_kill_between_two_renames_the_result_is_there_and_not_overwritten(
    tmp_path, monkeypatch
):
    out = tmp_path / "out"
    killed.write(out, 0)
    monkeypatch.setattr(staging, "_exchange", killed.refuse_exchange)
    monkeypatch.setattr(staging.Staging, "close", lambda *_: None)  # as when it is killed
    with monkeypatch.context() as patch:
        patch.setattr(staging.Staging, "_rename_twice", lambda self: out.rename(self._path / "old"))
        killed.write(out, 1)
    assert not out.exists()
    (held,) = (entry for entry in tmp_path.iterdir())
    locks = [int(one) for one in os.listdir("/proc/self/fd") if _points_to(one, held / "lock")]
    for lock in locks:
        os.close(lock)
    with pytest.raises(UserError, match="exists already"), result_folder(out, force=False):
        pass
    assert killed.number_of(out) == 1
    assert leftovers(tmp_path) == []


def _points_to(number: str, path: Path) -> bool:
    try:
        return os.readlink(f"/proc/self/fd/{number}") == str(path)
    except OSError:
        return False


def test_an_exchange_that_fails_leaves_what_was(tmp_path, monkeypatch):
    def fail(*_: Path) -> None:
        raise PermissionError(1, "not permitted")

    killed.write(tmp_path / "out", 0)
    monkeypatch.setattr(staging, "_exchange", fail)
    with pytest.raises(Exception, match="not permitted"):
        killed.write(tmp_path / "out", 1)
    assert killed.number_of(tmp_path / "out") == 0
    assert leftovers(tmp_path) == []


def test_an_interrupt_between_two_renames_puts_the_old_one_back(tmp_path, monkeypatch):
    killed.write(tmp_path / "out", 0)
    monkeypatch.setattr(staging, "_exchange", killed.refuse_exchange)
    rename, calls = Path.rename, []

    def interrupted_rename(self, target):
        calls.append(target)
        if len(calls) == 2:  # the earlier result is out of the way, the new one not yet in place
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", interrupted_rename)
    with pytest.raises(KeyboardInterrupt):
        killed.write(tmp_path / "out", 1)
    assert killed.number_of(tmp_path / "out") == 0
    assert leftovers(tmp_path) == []
