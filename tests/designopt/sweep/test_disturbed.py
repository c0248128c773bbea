"""Sweeps that are disturbed: workers, schedulers and commands that end on the way."""

import math
import signal
import subprocess
import sys
import threading
import time
from importlib.metadata import PackageNotFoundError
from typing import Any

import pytest

from designopt import UserError, cli
from designopt.sweep import cluster as cluster_module
from designopt.sweep.cluster import run_on_cluster
from designopt.sweep.evaluating import Task
from tests.designopt.sweep.clusters import kill_a_worker, two_workers

SWEEP = ["sweep", "swept", "--vary", "x=1:2:6", "--set", "wait=0.25", "-q"]


def tasks(count, *settings):
    return [Task("swept", ((f"x={i}", *settings),), 1, 0, "float64", {}) for i in range(1, count)]


@pytest.fixture(scope="module")
def cluster(plugin):
    with two_workers() as started:
        yield started


def run(out, *how):
    """The sweep that all tests here have, into a folder; the bytes of its table."""
    assert cli.run([*SWEEP, "--out", str(out), *how]) == 0
    return (out / "result" / "tables" / "points.csv").read_bytes()


@pytest.fixture(scope="module")
def undisturbed(plugin, tmp_path_factory):
    return run(tmp_path_factory.mktemp("sweep") / "undisturbed", "--workers", "1")


def kept(folder):
    return {path.name: path.read_bytes() for path in folder.glob("points/0*.json")}


def test_a_cluster_that_loses_a_worker_finds_the_same(installed, undisturbed, cluster, capsys):
    address, out = cluster.scheduler_address, installed / "far"

    def kill_after_a_point():
        while not kept(out):
            time.sleep(0.02)
        kill_a_worker(address)

    killer = threading.Thread(target=kill_after_a_point)
    killer.start()
    assert run(out, "--scheduler", address) == undisturbed
    killer.join()
    assert capsys.readouterr().err == ""


def test_an_interrupted_sweep_goes_on_and_finds_the_same(installed, undisturbed):
    out = installed / "stopped"
    command = [sys.executable, "-m", "designopt", *SWEEP, "--out", out.name, "--workers", "2"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while not kept(out):
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.stderr is not None
        said = process.stderr.read()
    before = kept(out)
    assert process.returncode == 130
    assert said == (
        f"interrupted; {len(before)} of 6 points are kept in stopped; the same command goes on\n"
    )
    assert 1 <= len(before) < 6
    assert not (out / "result").exists()
    assert run(out, "--workers", "1") == undisturbed
    assert before.items() <= kept(out).items()  # none of them was computed again


def nowhere(package):
    raise PackageNotFoundError(f"no {package}")


def test_what_workers_cannot_do_is_told(installed, cluster, monkeypatch):
    address = cluster.scheduler_address
    with pytest.raises(UserError, match=r"the sweep was begun with 0\.0"):
        next(run_on_cluster([Task("swept", (("x=1",),), 1, 0, "float64", {"jax": "0.0"})], address))
    with monkeypatch.context() as patch:
        patch.setattr(cluster_module, "version", nowhere)
        with pytest.raises(UserError, match=r"cannot run points \(PackageNotFoundError"):
            next(run_on_cluster(tasks(2), address))
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)
    answers: dict[int, Any] = dict(run_on_cluster(tasks(4, "fatal=2"), address))
    assert answers[1] is None
    for index, x in ((0, 1), (2, 3)):
        assert answers[index][0].metrics[0].value == 2 * math.sin(x) / x


@pytest.fixture
def scheduler():
    """A scheduler without workers: its process and its address."""
    code = (
        "import asyncio\nfrom distributed import Scheduler\n"
        "async def run():\n"
        "    how = dict(host='127.0.0.1', port=0, dashboard=False, dashboard_address=':0')\n"
        "    async with Scheduler(**how) as scheduler:\n"
        "        print(scheduler.address, flush=True)\n"
        "        await scheduler.finished()\n"
        "asyncio.run(run())\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        yield process, process.stdout.readline().strip()
        process.kill()


def test_a_scheduler_that_is_lost_is_one_line(scheduler, caplog):
    process, address = scheduler
    lose = threading.Timer(1.0, process.kill)
    lose.start()
    with pytest.raises(UserError, match=f"--scheduler {address}: the scheduler was lost"):
        next(run_on_cluster(tasks(3), address))
    lose.join()
    assert "no workers; waiting" in caplog.text
