"""Files that a result did not write are never lost, and what it wrote is all that is replaced."""

import hashlib
import json

import pytest

from designopt import UserError
from designopt.io import staging
from designopt.study.result_folders import (
    check_replaceable,
    own_files,
    result_folder,
    write_document,
)
from tests.designopt.killed import number_of, write


@pytest.fixture
def out(tmp_path):
    write(tmp_path / "out", 1)
    return tmp_path / "out"


def test_the_manifest_lists_every_other_file(out):
    document = json.loads((out / "results.json").read_text())
    files = [path for path in out.rglob("*") if path.is_file() and path.name != "results.json"]
    expected = [
        {
            "path": path.relative_to(out).as_posix(),
            "bytes": len(path.read_bytes()),
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        }
        for path in sorted(files)
    ]
    assert document["manifest"] == expected
    assert list(document)[-2:] == ["manifest", "checksum"]


@pytest.mark.parametrize(
    "foreign", ["mine.toml", "specs/mine.toml", "figures/mine.toml", "tables/a/b/c.txt", ".hidden"]
)
def test_a_file_of_somebody_else_stays_and_nothing_is_removed(out, foreign):
    path = out / foreign
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("mine")
    named = foreign if foreign.count("/") < 2 else "tables/a"
    if foreign.startswith("specs"):
        named = "specs/mine.toml"
    with pytest.raises(UserError, match=f"{named} is not of the earlier result, .*; move it away"):
        write(out, 2)
    assert path.read_text() == "mine"
    path.unlink()
    if named == "tables/a":  # an empty folder of somebody else stays, too
        with pytest.raises(UserError, match=r"tables/a is not of the earlier result"):
            write(out, 2)
    for parent in list(path.parents)[: max(foreign.count("/") - 1, 0)]:
        parent.rmdir()
    assert number_of(out) == 1
    write(out, 2)
    assert number_of(out) == 2


@pytest.mark.parametrize("name", ["tables/a.csv", "figures/odd.svg", "results.json"])
@pytest.mark.parametrize("how", ["longer", "as long", "a link"])
def test_an_altered_file_stays(out, name, how):
    path = out / name
    text = path.read_text()
    if how == "a link":
        path.rename(out.parent / "elsewhere")
        path.symlink_to(out.parent / "elsewhere")
    else:
        path.write_text(text + " " if how == "longer" else text.replace("1", "3"))
    if (name, how) == ("results.json", "longer"):
        # Blanks between the parts of a document are no part of it.
        write(out, 2)
        return
    with pytest.raises(UserError, match=f"{name} was changed since the earlier result was written"):
        write(out, 2)
    assert (out / "figures" / "odd.svg").exists()


def test_a_result_need_not_be_a_studys(tmp_path):
    out = tmp_path / "out"
    for number in range(2):
        with result_folder(out, force=True) as folder:
            (folder / f"{number}.png").touch()
            write_document(folder, {"command": "render"})
        assert {path.name for path in out.iterdir()} == {f"{number}.png", "results.json"}
    (out / "mine.png").touch()
    with pytest.raises(UserError, match=r"mine\.png is not of the earlier result"):
        check_replaceable(out)


def test_a_file_that_is_gone_is_no_obstacle(out):
    (out / "figures" / "odd.svg").unlink()
    write(out, 2)
    assert number_of(out) == 2


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"study": 1, "spec": 1}', 9999 * "["])
def test_what_is_no_result_is_not_replaced(out, text):
    (out / "results.json").write_text(text)
    with pytest.raises(UserError, match="it does not hold an earlier result"):
        check_replaceable(out)


def test_a_result_of_an_older_version_is_what_it_names(out):
    document = json.loads((out / "results.json").read_text())
    for key in ("manifest", "checksum"):
        del document[key]
    document |= {"tables": ["tables/a.csv"], "figures": ["figures/a.svg", "figures/odd.svg"]}
    (out / "results.json").write_text(json.dumps(document))
    (out / "report.html").write_text("a report")
    assert {path.as_posix() for path in own_files(out)} == {
        "tables/a.csv",
        "figures/a.svg",
        "figures/odd.svg",
        "report.html",
        "results.json",
    }
    (out / "tables" / "mine.csv").touch()
    with pytest.raises(UserError, match=r"tables/mine\.csv is not of the earlier result"):
        write(out, 2)
    (out / "tables" / "mine.csv").unlink()
    write(out, 2)
    assert number_of(out) == 2


def test_a_file_put_there_at_the_last_moment_is_set_aside(tmp_path, out, monkeypatch, caplog):
    exchange = staging._exchange

    def late(new, place):
        (place / "specs").mkdir()
        (place / "specs" / "mine.toml").write_text("mine")
        exchange(new, place)

    monkeypatch.setattr(staging, "_exchange", late)
    write(out, 2)
    assert number_of(out) == 2
    assert (tmp_path / "out-replaced-1" / "specs" / "mine.toml").read_text() == "mine"
    assert f"what is left of it is in {tmp_path / 'out-replaced-1'}" in caplog.text


def test_a_result_made_meanwhile_is_replaced_by_force_alone(tmp_path):
    def write_while_another_one_appears(out, force):
        write(tmp_path / "other" / "out", 1)
        with result_folder(out, force=force) as folder:
            (tmp_path / "other" / "out").rename(out)
            write_document(folder, {"study": "", "spec": {}, "metrics": {}})

    with pytest.raises(UserError, match="made by somebody else meanwhile"):
        write_while_another_one_appears(tmp_path / "a", False)
    assert number_of(tmp_path / "a") == 1
    write_while_another_one_appears(tmp_path / "b", True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "other"]
