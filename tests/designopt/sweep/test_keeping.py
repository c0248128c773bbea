"""The folder of a sweep: what goes on, what is refused, and what is never lost."""

import json

import pytest

from designopt import UserError
from designopt.io import staging
from designopt.study.results import Metric
from designopt.sweep.outcomes import failed, found
from designopt.sweep.store import Folder, only_one
from tests.designopt.killed import number_of, write

ASKED = [{"x": float(index)} for index in range(20)]
DEFINITION = {"study": "swept", "seed": 0, "versions": {"jax": "1", "numpy": "2"}}


def test_finished_points_are_there_for_the_same_sweep(tmp_path):
    folder = Folder(tmp_path, DEFINITION, force=False)
    assert folder.outcomes(ASKED) == {}
    outcomes = {0: found([Metric("a", 0.1, "", "")], 1.0, "cpu"), 12: failed("no", final=False)}
    for index, outcome in outcomes.items():
        folder.keep(index, ASKED[index], outcome)
    again = Folder(folder.path, DEFINITION, force=False)
    assert again.outcomes(ASKED) == outcomes
    document = json.loads((folder.path / "points" / "000012.json").read_text())
    assert (document["settings"], document["failure"]) == ({"x": 12.0}, "no")


def test_another_sweep_is_refused_and_replaced_by_force_alone(tmp_path):
    Folder(tmp_path, DEFINITION, force=False).keep(3, ASKED[3], failed("no", final=True))
    with pytest.raises(UserError, match=r"it holds another sweep \(other seed\); name another"):
        Folder(tmp_path, DEFINITION | {"seed": 1}, force=False)
    other = DEFINITION | {"versions": {"jax": "1", "numpy": "3"}}
    with pytest.raises(UserError, match=r"were made with numpy 2, and this is 3: .* --force"):
        Folder(tmp_path, other, force=False)
    assert len(Folder(tmp_path, DEFINITION, force=False).outcomes(ASKED)) == 1
    assert Folder(tmp_path, other, force=True).outcomes(ASKED) == {}
    assert Folder(tmp_path, other, force=False).outcomes(ASKED) == {}


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
    (tmp_path / ".sweep.json.abcdefgh").mkdir()
    Folder(tmp_path, DEFINITION, force=False).keep(3, ASKED[3], failed("no", final=True))
    (tmp_path / staging._name(".partial-abcdefgh")).mkdir()  # killed before it was locked
    for name in (".sweep.json.abcdefgh", "points/.000003.json.abcdefgh"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name.split("/")[-1][1:-9]).touch()
    assert len(Folder(tmp_path, DEFINITION, force=False).outcomes(ASKED)) == 1
    names = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*"))
    assert names == ["points", "points/000003.json", "sweep.json"]


def test_what_is_no_sweep_is_never_touched(tmp_path):
    thesis = tmp_path / "thesis.txt"
    thesis.write_text("mine")
    for force in (False, True):
        with pytest.raises(UserError, match="it holds no sweep; name a new folder"):
            Folder(tmp_path, DEFINITION, force=force)
    thesis.unlink()
    Folder(tmp_path, DEFINITION, force=False).keep(3, ASKED[3], failed("no", final=True))
    thesis.write_text("mine")
    with pytest.raises(UserError, match=r"thesis\.txt is not of the earlier sweep"):
        Folder(tmp_path, DEFINITION, force=True)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["points", "sweep.json", "thesis.txt"]
    with pytest.raises(UserError, match=r"thesis\.txt: cannot be written"):
        Folder(thesis, DEFINITION, force=False)


def kept_at(tmp_path, *indices):
    folder = Folder(tmp_path, DEFINITION, force=False)
    for index in indices:
        folder.keep(index, ASKED[index], found([Metric("a", index, "", "")], 1.0, "cpu"))
    return folder, [tmp_path / "points" / f"{index:06d}.json" for index in indices]


def altered(text):
    return text.replace('"value": 5', '"value": 6')


@pytest.mark.parametrize("change", [lambda _: "{", lambda _: "[]", lambda _: "{}", altered])
def test_a_damaged_or_altered_point_is_evaluated_anew_with_a_message(tmp_path, caplog, change):
    folder, (own, _) = kept_at(tmp_path, 5, 6)
    own.write_text(change(own.read_text()))
    assert list(folder.outcomes(ASKED)) == [6]
    words = "points/000005.json: not a point of this sweep as it was written"
    assert words in caplog.text


def test_points_whose_files_were_swapped_are_evaluated_anew(tmp_path, caplog):
    folder, (one, other) = kept_at(tmp_path, 5, 6)
    texts = one.read_text(), other.read_text()
    other.write_text(texts[0])
    one.write_text(texts[1])
    assert folder.outcomes(ASKED) == {}
    assert "points/000005.json and 1 more: not a point" in caplog.text


def test_points_of_other_settings_are_evaluated_anew(tmp_path):
    folder, _ = kept_at(tmp_path, 5, 6)
    assert list(folder.outcomes([*ASKED[:6], {"x": 6.5}])) == [5]
    assert list(folder.outcomes(ASKED[:6])) == [5]


@pytest.mark.parametrize("name", ["points/mine.txt", "points/000007.json", "points/5.json"])
def test_force_removes_no_file_among_the_points_that_no_sweep_wrote(tmp_path, name):
    kept_at(tmp_path, 5, 6)
    (tmp_path / name).write_text("mine")
    with pytest.raises(UserError, match=f"{name} is not of the earlier sweep"):
        Folder(tmp_path, DEFINITION, force=True)
    assert len(list((tmp_path / "points").iterdir())) == 3
    (tmp_path / name).unlink()
    Folder(tmp_path, DEFINITION, force=True)
    assert list((tmp_path / "points").iterdir()) == []


def test_a_file_among_the_results_stops_a_sweep_before_it_begins(tmp_path):
    kept_at(tmp_path, 5, 6)
    write(tmp_path / "result", 1)
    (tmp_path / "result" / "figures" / "mine.toml").touch()
    for force in (False, True):
        with pytest.raises(UserError, match=r"result: figures/mine\.toml is not of the earlier"):
            Folder(tmp_path, DEFINITION, force=force)
    (tmp_path / "result" / "figures" / "mine.toml").unlink()
    assert len(Folder(tmp_path, DEFINITION, force=False).outcomes(ASKED)) == 2
    Folder(tmp_path, DEFINITION, force=True)
    assert number_of(tmp_path / "result") == 1  # until a new one takes its place
    assert list((tmp_path / "points").iterdir()) == []


def test_what_no_sweep_wrote_is_set_aside_for_the_point(tmp_path):
    folder, (own, other) = kept_at(tmp_path, 5, 6)
    own.write_text("mine")
    assert list(folder.outcomes(ASKED)) == [6]
    folder.keep(5, ASKED[5], failed("no", final=True))
    assert (tmp_path / "points" / "000005.json.other-1").read_text() == "mine"
    assert sorted(folder.outcomes(ASKED)) == [5, 6]
    assert other.exists()


def test_force_does_not_follow_a_link_nor_replace_an_altered_definition(tmp_path):
    (tmp_path / "sweep").mkdir()
    folder, _ = kept_at(tmp_path / "sweep", 5, 6)
    (folder.path / "points").rename(tmp_path / "elsewhere")
    (folder.path / "points").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UserError, match="points is not of the earlier sweep"):
        Folder(folder.path, DEFINITION, force=True)
    assert len(list((tmp_path / "elsewhere").iterdir())) == 2
    (folder.path / "points").unlink()
    definition = folder.path / "sweep.json"
    definition.write_text(definition.read_text().replace('"seed": 0', '"seed": 9'))
    with pytest.raises(UserError, match=r"sweep\.json is not of the earlier sweep"):
        Folder(folder.path, DEFINITION, force=True)


def test_points_of_an_older_version_are_its_own_and_are_evaluated_anew(tmp_path):
    folder, (own, _) = kept_at(tmp_path, 5, 6)
    document = json.loads(own.read_text())
    del document["checksum"]
    own.write_text(json.dumps(document))
    assert list(folder.outcomes(ASKED)) == [6]
    Folder(tmp_path, DEFINITION, force=True)
    assert list((tmp_path / "points").iterdir()) == []
