"""Results that are replaced by processes killed on the way: the old one or the new one is there."""

import errno
import fcntl
import os
import random
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from designopt import UserError
from designopt.io import staging
from designopt.io.files import replaced_when_complete
from designopt.io.staging import recover, staging_folder
from designopt.study.result_folders import result_folder, write_document
from tests.commands import python
from tests.designopt import killed

VARIABLES = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}


def leftovers(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != "out")


@pytest.mark.parametrize("way", ["exchange", "rename"])
def test_killed_at_every_step_there_is_a_whole_result(tmp_path, way):
    """By exchange one is there at once; by renaming twice, after the next run at the latest."""
    done = python(killed.__file__, tmp_path / "out", way, env=VARIABLES)
    assert done.returncode == 0, done.stderr
    steps, missing = map(int, done.stdout.split())
    assert steps > 50
    assert missing == 0 if way == "exchange" else missing > 0


@pytest.mark.parametrize("count", [5, pytest.param(50, marks=pytest.mark.nightly)])
def test_killed_at_random_moments_there_is_a_whole_result(tmp_path, count):
    out, generator = tmp_path / "out", random.Random(0)
    killed.write(out, 0)
    for _ in range(count):
        before = (out / "results.json").read_text()
        with subprocess.Popen([sys.executable, killed.__file__, out], env=VARIABLES) as process:
            while (out / "results.json").read_text() == before:  # until it is at work
                assert process.poll() is None
                time.sleep(0.001)
            time.sleep(generator.uniform(0, 0.05))
            process.kill()
        number = killed.number_of(out)
        killed.write(out, number + 1)
        assert leftovers(tmp_path) == []


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


def test_after_a_kill_between_two_renames_the_earlier_result_is_put_back(tmp_path, monkeypatch):
    """What a process was about to do is read after it is gone, and not before."""
    out, flock = tmp_path / "out", fcntl.flock
    killed.write(out, 0)
    dying = staging.Staging(out)
    write_document(dying.folder, {"study": "killed", "spec": {}, "metrics": {}})

    def die_first(lock: int, how: int) -> None:
        os.write(dying._lock, staging.BEGUN)
        out.rename(dying._path / "old")
        os.close(dying._lock)
        flock(lock, how)

    monkeypatch.setattr(fcntl, "flock", die_first)
    with pytest.raises(UserError, match="exists already"), result_folder(out, force=False):
        pass
    assert killed.number_of(out) == 0
    assert leftovers(tmp_path) == []


def test_what_another_user_has_left_is_never_touched(tmp_path, monkeypatch):
    left = staging.Staging(tmp_path / "out")
    os.close(left._lock)
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: os.getuid() + 1)
        recover(tmp_path / "out", keep)
    assert left.folder.exists()
    recover(tmp_path / "out", keep)
    assert list(tmp_path.iterdir()) == []


def fail(*_: Path) -> None:
    raise PermissionError(1, "not permitted")


def test_a_result_that_cannot_be_moved_stays(tmp_path, monkeypatch):
    killed.write(tmp_path / "out", 0)
    monkeypatch.setattr(staging, "_exchange", fail)
    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(UserError, match="not permitted"):
        killed.write(tmp_path / "out", 1)
    assert killed.number_of(tmp_path / "out") == 0
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize(("calls", "number"), [(1, 0), (2, 1)])
def test_an_interrupt_while_a_folder_is_renamed_loses_none(tmp_path, monkeypatch, calls, number):
    """A signal that comes during a system call is raised as an interrupt just after it."""
    killed.write(tmp_path / "out", 0)
    monkeypatch.setattr(staging, "_exchange", killed.refuse_exchange)
    rename, left = Path.rename, calls

    def interrupted_rename(self: Path, target: Path) -> None:
        nonlocal left
        rename(self, target)
        left -= 1
        if left == 0:
            raise KeyboardInterrupt

    monkeypatch.setattr(Path, "rename", interrupted_rename)
    with pytest.raises(KeyboardInterrupt):
        killed.write(tmp_path / "out", 1)
    assert killed.number_of(tmp_path / "out") == number
    assert leftovers(tmp_path) == []


def test_a_file_system_that_cannot_sync_folders_is_no_fault(tmp_path, monkeypatch):
    fsync = os.fsync

    def refuse_folders(number: int) -> None:
        if stat.S_ISDIR(os.fstat(number).st_mode):
            raise OSError(errno.EINVAL, "not here")
        fsync(number)

    monkeypatch.setattr(os, "fsync", refuse_folders)
    killed.write(tmp_path / "out", 0)
    assert killed.number_of(tmp_path / "out") == 0
    with replaced_when_complete(tmp_path / "file") as partial:
        partial.write_text("whole")
    assert (tmp_path / "file").read_text() == "whole"
