"""Result folders: what is in them, and that they are complete or absent."""

import contextlib
import csv
import json
import signal

import jax.numpy as jnp
import pytest

from designopt import Results, Study, UserError
from designopt.study.runner import run
from tests.designopt.plugin import SQUARE, SquareSpec


def run_square(out, *, study=SQUARE, force=False, dtype="float64", **spec):
    settings = SquareSpec.model_validate({"side": 3.0} | spec)
    return run(study, settings, seed=5, dtype=dtype, out=out, force=force)


def test_a_run_writes_everything(tmp_path):
    run_square(tmp_path / "new" / "out")
    out = tmp_path / "new" / "out"
    document = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert document["study"] == "square"
    assert document["spec"] == {"side": 3.0, "inner": {"length": 2.0}, "label": "", "asked": 9.0}
    assert (document["seed"], document["dtype"]) == (5, "float64")
    assert document["device"].startswith("cpu")
    assert {"python", "designopt", "jax", "optimistix"} <= set(document["versions"])
    assert document["metrics"]["area_mm2"] == {
        "value": 9.0,
        "unit": "mm²",
        "reference": 9.0,
        "target": "9",
        "met": True,
        "description": "area",
    }
    assert document["metrics"]["nothing"]["value"] is None  # JSON has no NaN
    assert document["tables"] == ["tables/sides.csv"]
    assert (document["precision"], document["stability"], document["left_out"]) == ([], [], [])
    with (out / "tables" / "sides.csv").open(newline="", encoding="utf-8") as file:
        assert list(csv.reader(file)) == [["side_mm", "note"], ["3.0", "a,b"], ["", ""]]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "A &lt;square&gt; &amp; its area." in page
    assert [path.name for path in tmp_path.iterdir()] == ["new"]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("n1/n2/" + 300 * "x", "--out"),
        ("loop/x", "--out"),
        ("file/x", r"--out .*file/x: cannot be written \(File exists: .*file\)"),
        ("new/../there", "exists already; name another folder"),
    ],
)
def test_odd_paths_are_one_line_and_leave_nothing(tmp_path, path, words):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "file").touch()
    (tmp_path / "there").mkdir()
    with pytest.raises(UserError, match=words):
        run_square(tmp_path / path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "loop", "there"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_was_swallowed_still_counts(tmp_path, number):
    def swallow(spec, context):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(number)
        return Results([], [])

    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt):
        run_square(tmp_path / "out", study=Study("swallow", "", SquareSpec, swallow))
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(number) is before


def test_a_link_to_a_result_stays_a_link(tmp_path):
    run_square(tmp_path / "real")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with pytest.raises(UserError, match="exists already"):
        run_square(tmp_path / "link")
    run_square(tmp_path / "link", side=4.0, force=True)
    assert (tmp_path / "link").is_symlink()
    document = json.loads((tmp_path / "real" / "results.json").read_text(encoding="utf-8"))
    assert document["spec"]["side"] == 4.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "real"]


@pytest.mark.parametrize("label", ["break", "interrupt"])
def test_a_failed_run_leaves_nothing_and_keeps_what_was(tmp_path, label):
    with pytest.raises((RuntimeError, KeyboardInterrupt)):
        run_square(tmp_path / "new" / "out", label=label)
    assert list(tmp_path.iterdir()) == []
    run_square(tmp_path / "out")
    with pytest.raises((RuntimeError, KeyboardInterrupt)):
        run_square(tmp_path / "out", label=label, force=True)
    assert json.loads((tmp_path / "out" / "results.json").read_text())["spec"]["label"] == ""
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_no_file_of_a_run_overwrites_another(tmp_path):
    with pytest.raises(ValueError, match=r"two tables of one name .*: sides"):
        run_square(tmp_path / "out", label="twice")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_a_users_fault_too(tmp_path, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("designopt.study.runner.write_results", full)
    with pytest.raises(UserError, match="No space left on device"):
        run_square(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_the_float_type_is_jaxs_default_while_the_study_runs(tmp_path, dtype):
    seen = []

    def look(spec, context):
        seen.append((context.dtype, jnp.zeros(()).dtype.name))
        return Results([], [])

    before = jnp.zeros(()).dtype
    run_square(tmp_path / "out", study=Study("look", "", SquareSpec, look), dtype=dtype)
    assert seen == [(dtype, dtype)]
    assert jnp.zeros(()).dtype == before
