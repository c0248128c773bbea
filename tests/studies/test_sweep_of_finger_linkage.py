"""A sweep of the linkage's design over T × |EF|: disturbed in every way, and the same table.

`tests/designopt/sweep/test_disturbed.py` has the same of a study that takes no time.
"""

import signal
import subprocess
import sys
import time

import pytest

from tests.designopt.sweep.clusters import kill_a_worker, two_workers

SEARCH = ("starts=4", "among=512", "step_deg=45", "exchanges=0", "finalists=1")
"""A search of a few seconds: what is looked at is the sweep, not the design."""

SWEEP = [
    *(sys.executable, "-m", "designopt", "sweep", "finger-linkage"),
    *("--set", "precision=false", "--set", "front=[]", "--set", "draws=10"),
    *(part for text in SEARCH for part in ("--set", f"search.{text}")),
    *("--vary", "body.thickness=22:26:2", "--vary", "limits.crank_length=18:24:3"),
]
POINTS = 6


def kept(folder):
    return sorted(path.name for path in folder.glob("points/0*.json"))


def wait_for(process, folder, count):
    while len(kept(folder)) < count:
        assert process.poll() is None
        time.sleep(0.1)


def table(folder):
    return (folder / "result" / "tables" / "points.csv").read_bytes()


@pytest.mark.nightly
def test_a_disturbed_sweep_finds_what_an_undisturbed_one_finds(tmp_path):
    stopped, whole = tmp_path / "stopped", tmp_path / "whole"
    with two_workers() as cluster:
        far = [*SWEEP, "--out", str(stopped), "--scheduler", cluster.scheduler_address]
        with subprocess.Popen(far, stderr=subprocess.PIPE, text=True) as process:
            wait_for(process, stopped, 2)
            kill_a_worker(cluster.scheduler_address)
            wait_for(process, stopped, 4)
            process.send_signal(signal.SIGINT)
            assert process.stderr is not None
            said = process.stderr.read()
        count = len(kept(stopped))
        assert process.returncode == 130
        assert said == (
            f"interrupted; {count} of {POINTS} points are kept in {stopped}; "
            "the same command goes on\n"
        )
        assert 4 <= count < POINTS
        assert subprocess.run(far, check=False).returncode == 0
    # By processes of this machine, without a cluster.
    near = [*SWEEP, "--out", str(whole), "--workers", "2"]
    assert subprocess.run(near, check=False).returncode == 0
    assert table(whole) == table(stopped)
    assert len(table(whole).splitlines()) == 1 + POINTS
