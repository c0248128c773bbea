"""Files named on the command line: what is refused, and that nothing half-written stays."""

import os
from pathlib import Path

import pytest

from designopt import UserError
from designopt.io.files import check_figure_ending, check_targets, read_toml, replaced_when_complete
from tests.designopt.tables import cases


def test_tables_are_read_whatever_the_editor(tmp_path):
    path = tmp_path / "f.toml"
    path.write_bytes(b'\xef\xbb\xbfname = "\xce\xb8"\r\n')
    assert read_toml(path, "scene") == {"name": "θ"}
    assert read_toml(str(path), "scene") == {"name": "θ"}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read: No such file"),
        (b"name = '\xe9'", "not UTF-8 text"),
        (b"a = 1\na = 2", "not TOML: .*; correct it there"),
        (b"a = " + b"1" * 5000, "too many digits; shorten it"),
        (b"a = " + b"[" * 5000 + b"]" * 5000, "nested too deeply for a scene"),
    ],
)
def test_what_is_no_toml_is_told(tmp_path, content, words):
    path = tmp_path / "f.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError, match=words) as raised:
        read_toml(path, "scene")
    assert str(raised.value).startswith(f"{path}: ")


def test_new_files_in_a_folder_are_fine(tmp_path):
    old = tmp_path / "old.csv"
    old.touch()
    check_targets({"--csv": tmp_path / "t.csv", "--figure": str(tmp_path / "f.png")}, force=False)
    check_targets({"--csv": old, "--figure": None}, force=True)


@pytest.mark.parametrize(("named", "words"), cases("unwritable_targets"))
def test_files_that_could_not_be_written_are_refused(tmp_path, monkeypatch, named, words):
    monkeypatch.chdir(tmp_path)
    Path("old").touch()
    os.mkfifo("pipe")
    with pytest.raises(UserError, match=f"^{words}"):
        check_targets({"--absent": None} | named, force=False)


def test_figures_end_as_their_kind():
    check_figure_ending("--figure", Path("a.SVG"))
    with pytest.raises(UserError, match=r"--figure a\.xyz: a figure ends in \.png, \.svg, \.pdf"):
        check_figure_ending("--figure", Path("a.xyz"))


def test_a_file_is_replaced_when_the_new_one_is_complete(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("old")
    with pytest.raises(KeyError), replaced_when_complete(path) as partial:  # noqa: PT012
        partial.write_text("half")
        raise KeyError
    assert (path.read_text(), list(tmp_path.iterdir())) == ("old", [path])
    with replaced_when_complete(path) as partial:
        partial.write_text("new")
        assert path.read_text() == "old"
    assert (path.read_text(), list(tmp_path.iterdir())) == ("new", [path])


def test_places_that_cannot_be_written_are_told(tmp_path):
    path = tmp_path / "no" / "t.csv"
    with (
        pytest.raises(UserError, match=r"t\.csv: cannot be written: No such file.*; choose"),
        replaced_when_complete(path),
    ):
        pass
    with (
        pytest.raises(UserError, match="cannot be written: no room for it; choose another"),
        replaced_when_complete(tmp_path / "t.csv"),
    ):
        raise OSError("no room for it")  # as libraries raise it, without an errno
