"""Places of the XDG Base Directory Specification, for which only absolute paths are valid."""

from pathlib import Path

import pytest

from designopt.user_folders import user_folder


@pytest.mark.parametrize(
    ("named", "place"),
    [
        (None, "home/.usual/designopt"),
        ("", "home/.usual/designopt"),
        ("relative", "home/.usual/designopt"),
        ("{}/mine", "mine/designopt"),
    ],
)
def test_the_place_is_the_one_named_if_that_is_a_whole_path(monkeypatch, tmp_path, named, place):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_ANY_HOME", raising=False)
    if named is not None:
        monkeypatch.setenv("XDG_ANY_HOME", named.format(tmp_path))
    assert user_folder("XDG_ANY_HOME", ".usual") == tmp_path / place


def test_a_person_without_a_home_is_a_fault_unless_the_place_is_named(monkeypatch, tmp_path):
    def fail() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", fail)
    monkeypatch.setenv("XDG_ANY_HOME", str(tmp_path))
    assert user_folder("XDG_ANY_HOME", ".usual") == tmp_path / "designopt"
    monkeypatch.delenv("XDG_ANY_HOME")
    with pytest.raises(RuntimeError):
        user_folder("XDG_ANY_HOME", ".usual")
