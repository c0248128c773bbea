"""``designopt solve`` as a person meets it: the table, what is said, exit codes, no surprises."""

from __future__ import annotations

import contextlib
import csv
import io
import shutil
import tracemalloc
from pathlib import Path

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

from designopt.cli import run
from tests.commands import check_command_refused, refused_cases
from tests.helpers import close
from tests.kinematics.gallery import FOLDER, gallery, poses_of, rates_of


@pytest.fixture(autouse=True)
def _in_a_folder_of_files(tmp_path, monkeypatch):
    for path in FOLDER.glob("*.toml"):
        shutil.copy(path, tmp_path)
    text = (FOLDER / "four-bar.toml").read_text(encoding="utf-8")
    (tmp_path / "rocker.toml").write_text(text.replace("O2-A = 40 }", "O2-A = 90 }"))
    monkeypatch.chdir(tmp_path)


def table_of(text: str) -> dict[str, list[str]]:
    header, *rows = csv.reader(io.StringIO(text))
    assert len(set(header)) == len(header)
    return {name: [row[i] for row in rows] for i, name in enumerate(header)}


def numbers(column: list[str]) -> np.ndarray:
    return np.array([float(cell) for cell in column])


def test_columns_stand_in_the_documented_order_and_are_what_the_library_computes(capsys):
    rates = ["--rate", "crank=2", "--accel", "crank=-3"]
    assert run(["solve", "four-bar.toml", "--sweep", "crank=0:60:4", *rates]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    table = table_of(shown.out)
    linkage, at = gallery("four-bar"), np.radians(numbers(table["crank"]))[:, None]
    pose = poses_of(linkage, at).value
    motion = rates_of(linkage, at, np.array([2.0]), np.array([-3.0]))
    joints, bodies = ("O2", "A", "B", "O4"), ("ground", "crank", "coupler", "rocker")
    angles = {body: np.degrees(pose.angle(body)) for body in bodies[1:]}
    columns = ["crank", "ok", "margin", "closure"]
    for order, of_body, places, turns in (
        ("", "angle_deg", pose.joints, angles),
        ("v", "omega", motion.velocity.joints, motion.velocity.bodies),
        ("a", "alpha", motion.acceleration.joints, motion.acceleration.bodies),
    ):
        columns += [f"{joint}.{order}{axis}" for joint in joints for axis in "xy"]
        columns += [f"{body}.{of_body}" for body in bodies]
        for joint in joints:
            found = [numbers(table[f"{joint}.{order}{axis}"]) for axis in "xy"]
            close(found, [places[joint].x, places[joint].y], 1e-9)
        for body in bodies[1:]:
            close(numbers(table[f"{body}.{of_body}"]), turns[body], 1e-9)
    assert list(table) == [*columns, "B.mu_deg"]
    assert table["ok"] == ["1"] * 4
    assert np.max(numbers(table["closure"])) < 1e-11
    coupler, rocker = numbers(table["coupler.angle_deg"]), numbers(table["rocker.angle_deg"])
    folded = np.abs((rocker - coupler + 90) % 180 - 90)
    np.testing.assert_allclose(numbers(table["B.mu_deg"]), folded, rtol=1e-9)


def test_rows_beyond_lock_up_are_empty_and_say_why(capsys):
    assert run(["solve", "rocker.toml", "--sweep", "crank=0:60:4"]) == 0
    shown = capsys.readouterr()
    table = table_of(shown.out)
    assert numbers(table["crank"]) == pytest.approx([0, 20, 40, 60])
    assert table["ok"] == ["0", "0", "1", "1"]
    for name, column in table.items():
        if name not in ("crank", "ok", "margin"):
            assert column[:2] == ["", ""], name
            assert all(column[2:]), name
    margin = numbers(table["margin"])
    assert np.all(margin[:2] < 0)
    assert np.all(margin[2:] > 0)
    # |O4 A| = |coupler − rocker| = 40
    limit = np.degrees(np.arccos((90**2 + 100**2 - 40**2) / (2 * 90 * 100)))
    for words in ("2 of 4 poses", "ok = 0", "crank locks at", f"{limit:.6f}", "coupler and rocker"):
        assert words in shown.err


def test_no_pose_at_all_is_exit_code_1(tmp_path, capsys):
    command = ["solve", "rocker.toml", "--sweep", "crank=0:10:4", "--csv", "t.csv"]
    assert run([*command, "--figure", "t.png"]) == 1
    told = capsys.readouterr().err.splitlines()
    assert told[0] == "no pose can be assembled; their rows have ok = 0 and empty cells"
    assert told[1].startswith("  4 poses: Two pins are nearer to each other than")
    assert table_of((tmp_path / "t.csv").read_text())["ok"] == ["0"] * 4
    assert told[-1] == "nothing is drawn: no pose to show can be assembled"
    assert not (tmp_path / "t.png").exists()


@pytest.fixture
def drawn(monkeypatch):
    """Inputs and poses of every figure that is asked for; an empty one is drawn instead."""
    calls = []

    def draw(linkage, inputs, poses):
        calls.append((inputs, poses))
        return Figure()

    monkeypatch.setattr("kinematics.cli.drawing.motion_figure", draw)
    return calls


def test_a_table_is_the_same_however_it_is_cut(drawn, monkeypatch, capsys):
    sweeps = ["--sweep", "crank=0:60:10", "--rate", "crank=2"]
    tables, remarks = [], []
    for chunk in (100, 4):
        monkeypatch.setattr("kinematics.cli.solving.CHUNK", chunk)
        assert run(["solve", "rocker.toml", *sweeps, "--figure", f"{chunk}.png"]) == 0
        shown = capsys.readouterr()
        tables.append(table_of(shown.out))
        remarks.append(shown.err)
    assert tables[0].keys() == tables[1].keys()
    for name, column in tables[0].items():
        assert [cell == "" for cell in column] == [cell == "" for cell in tables[1][name]]
        filled = [(a, b) for a, b in zip(column, tables[1][name], strict=True) if a]
        # They are two programs, which round differently.
        np.testing.assert_allclose(*np.array(filled, float).T, rtol=1e-11, atol=1e-11)
    assert remarks[0] == remarks[1]
    (inputs, poses), (cut_inputs, cut_poses) = drawn
    ok = np.asarray(poses.ok)
    np.testing.assert_array_equal(inputs, cut_inputs)
    np.testing.assert_array_equal(ok, cut_poses.ok)
    place, cut_place = (np.asarray(one.value.joints["B"].x)[ok] for one in (poses, cut_poses))
    np.testing.assert_allclose(place, cut_place, rtol=1e-12)


def test_a_long_sweep_is_drawn_in_some_of_its_poses(drawn, monkeypatch, capsys):
    monkeypatch.setattr("kinematics.cli.solving.MOST_DRAWN", 5)
    command = ["solve", "four-bar.toml", "--sweep", "crank=0:20:21"]
    assert run([*command, "--figure", "t.png"]) == 0
    shown = capsys.readouterr()
    assert len(table_of(shown.out)["ok"]) == 21
    assert shown.err == "drawn: 5 of 21 poses, evenly spread\n"
    ((inputs, _),) = drawn
    np.testing.assert_allclose(np.degrees(inputs[:, 0]), [0, 5, 10, 15, 20], atol=1e-12)


def test_memory_does_not_grow_with_a_sweep(monkeypatch):
    """As much is alive after ten parts of a table as after two."""
    alive = []

    @contextlib.contextmanager
    def table(target):
        def write(text):
            if not tracemalloc.is_tracing():
                tracemalloc.start()
            arrays = sum(array.nbytes for array in jax.live_arrays())
            alive.append(arrays + tracemalloc.get_traced_memory()[0])

        yield write

    monkeypatch.setattr("kinematics.cli.solving.CHUNK", 2000)
    monkeypatch.setattr("kinematics.cli.solving.table_at", table)
    try:
        assert run(["solve", "four-bar.toml", "--sweep", "crank=0:360:20000"]) == 0
    finally:
        tracemalloc.stop()
    assert len(alive) == 10
    assert alive[-1] - alive[1] < 8 * 2000 * 4  # half a number of each pose in between


def test_a_table_is_written_whole_and_replaced_only_by_force(tmp_path, capsys):
    before = {path.name for path in tmp_path.iterdir()}
    command = ["solve", "four-bar.toml", "--sweep", "crank=10:20:2", "--of", "A", "--csv", "t.csv"]
    assert run(command) == 0
    first = (tmp_path / "t.csv").read_text()
    assert capsys.readouterr().out == ""
    assert table_of(first)["ok"] == ["1", "1"]
    again = [part.replace("10:20:2", "30") for part in command]
    assert run(again) == 2
    assert "t.csv: exists already" in capsys.readouterr().err
    assert (tmp_path / "t.csv").read_text() == first
    assert run([*again, "--force"]) == 0
    assert len(table_of((tmp_path / "t.csv").read_text())["ok"]) == 1
    assert {path.name for path in tmp_path.iterdir()} == before | {"t.csv"}


def test_only_what_is_asked_for_is_solved(capsys):
    assert run(["solve", "four-bar.toml", "--plan"]) == 0
    assert "RRR in closed form" in capsys.readouterr().out
    assert run(["solve", "stephenson.toml", "--plan"]) == 0
    assert "iteration, followed from the sketch" in capsys.readouterr().out
    sweeps = ["--sweep", "pip=0:-90:2", "--sweep", "dip=0:-90:2"]
    assert run(["solve", "finger.toml", *sweeps, "--of", "T"]) == 0
    table = table_of(capsys.readouterr().out)
    assert numbers(table["pip"]) == pytest.approx([0, 0, -90, -90])
    assert numbers(table["dip"]) == pytest.approx([0, -90, 0, -90])
    assert numbers(table["T.x"]) == pytest.approx([55, 23, 0, -32], abs=1e-12)
    assert numbers(table["T.y"]) == pytest.approx([0, -32, -55, -23], abs=1e-12)
    assert "C.x" not in table


@pytest.mark.parametrize(("line", "words"), refused_cases("solve"))
def test_nonsense_is_one_line_and_exit_code_2(line, words, tmp_path, capsys):
    before = sorted(path.name for path in tmp_path.iterdir())
    check_command_refused(capsys, f"solve {line}", words)
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_table_without_room_is_one_line_and_leaves_nothing(tmp_path, capsys):
    """A limit of a file's size stands for a disk that becomes full."""
    resource = pytest.importorskip("resource")
    command = ["solve", "four-bar.toml", "--sweep", "crank=0:360:2000"]
    assert run(command) == 0  # from here on, nothing compiled is written
    capsys.readouterr()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**14, limits[1]))
    try:
        code = run([*command, "--csv", "t.csv"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    shown = capsys.readouterr()
    assert (code, shown.out) == (2, "")
    assert shown.err == "error: t.csv: cannot be written: File too large; choose another\n"
    assert not [path for path in tmp_path.iterdir() if path.suffix != ".toml"]


def test_a_file_that_is_no_mechanism_is_one_line_and_exit_code_2(capsys):
    text = Path("four-bar.toml").read_text(encoding="utf-8")
    for new, words in (
        ("A = [0, 0]", "bodies.crank: O2-A = 40"),
        ("A = [30, 26", "not TOML"),
        ("[camera]", "a scene and no linkage; designopt trace takes it"),
    ):
        old = "[joints]" if new == "[camera]" else "A = [30, 26]"
        Path("bad.toml").write_text(text.replace(old, new), encoding="utf-8")
        line = "solve bad.toml --sweep crank=0:360:361"
        check_command_refused(capsys, line, ["error: bad.toml: ", words])
