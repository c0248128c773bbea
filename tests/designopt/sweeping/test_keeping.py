"""The folder of a sweep: what goes on, what is refused, and what is never lost."""

import json

import pytest

from designopt import UserError
from designopt.results import Metric
from designopt.sweeping.keeping import Folder, only_one
from designopt.sweeping.outcomes import failed, found

DEFINITION = {"study": "swept", "seed": 0, "versions": {"jax": "1", "numpy": "2"}}


def test_finished_points_are_there_for_the_same_sweep(tmp_path):
    folder = Folder(tmp_path, DEFINITION, force=False)
    assert folder.outcomes() == {}
    outcomes = {0: found([Metric("a", 0.1, "", "")], 1.0, "cpu"), 12: failed("no", final=False)}
    for index, outcome in outcomes.items():
        folder.keep(index, {"x": 1.5}, outcome)
    again = Folder(folder.path, DEFINITION, force=False)
    assert again.outcomes() == outcomes
    document = json.loads((folder.path / "points" / "000012.json").read_text())
    assert (document["settings"], document["failure"]) == ({"x": 1.5}, "no")


def test_another_sweep_is_refused_and_replaced_by_force_alone(tmp_path):
    Folder(tmp_path, DEFINITION, force=False).keep(3, {}, failed("no", final=True))
    with pytest.raises(UserError, match=r"it holds another sweep \(other seed\); name another"):
        Folder(tmp_path, DEFINITION | {"seed": 1}, force=False)
    other = DEFINITION | {"versions": {"jax": "1", "numpy": "3"}}
    with pytest.raises(UserError, match=r"were made with numpy 2, and this is 3: .* --force"):
        Folder(tmp_path, other, force=False)
    assert len(Folder(tmp_path, DEFINITION, force=False).outcomes()) == 1
    assert Folder(tmp_path, other, force=True).outcomes() == {}
    assert Folder(tmp_path, other, force=False).outcomes() == {}


def test_a_folder_has_one_sweep_at_a_time(tmp_path):
    with only_one(tmp_path / "a" / "b"):
        with (
            pytest.raises(UserError, match="another sweep is at work there"),
            only_one(tmp_path / "a" / "b"),
        ):
            pass
        with only_one(tmp_path / "a"):
            pass
    with only_one(tmp_path / "a" / "b"):
        pass
    (tmp_path / "file").touch()
    with (
        pytest.raises(UserError, match=r"--out .*file: cannot be written"),
        only_one(tmp_path / "file"),
    ):
        pass


def test_what_a_killed_sweep_left_behind_goes(tmp_path):
    (tmp_path / ".sweep.json.abc").mkdir()
    Folder(tmp_path, DEFINITION, force=False).keep(3, {}, failed("no", final=True))
    for name in (".sweep.json.abc", ".partial-abc", "points/.000003.json.abc"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "half").touch()
    assert len(Folder(tmp_path, DEFINITION, force=False).outcomes()) == 1
    names = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*"))
    assert names == ["points", "points/000003.json", "sweep.json"]


def test_what_is_no_sweep_is_never_touched(tmp_path):
    thesis = tmp_path / "thesis.txt"
    thesis.write_text("mine")
    for force in (False, True):
        with pytest.raises(UserError, match="it holds no sweep; name a new folder"):
            Folder(tmp_path, DEFINITION, force=force)
    thesis.unlink()
    Folder(tmp_path, DEFINITION, force=False).keep(3, {}, failed("no", final=True))
    thesis.write_text("mine")
    with pytest.raises(UserError, match=r"more than a sweep \(thesis.txt\)"):
        Folder(tmp_path, DEFINITION, force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "points",
        "sweep.json",
        "thesis.txt",
    ]
    with pytest.raises(UserError, match=r"thesis\.txt: cannot be written"):
        Folder(thesis, DEFINITION, force=False)


@pytest.mark.parametrize("text", ["{", "[]", "{}"])
def test_a_damaged_point_is_named(tmp_path, text):
    folder = Folder(tmp_path, DEFINITION, force=False)
    folder.keep(3, {}, failed("no", final=True))
    (tmp_path / "points" / "000003.json").write_text(text)
    with pytest.raises(UserError, match=r"000003.json: .*; delete it"):
        folder.outcomes()
