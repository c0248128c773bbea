"""``designopt doctor``: what it finds wrong, each by its line, and the cure."""

import importlib.metadata

import pytest

from designopt import cli
from designopt.cli import doctor
from tests.commands import python

METADATA = {
    "Requires-Python": ">=3.11",
    "Requires-Dist": [
        "numpy>=1.0",
        "no-such-package>=2.0",
        "pydantic>=99.0",
        "no-extra>=1; extra == 'toys'",
    ],
}


def lines_of(check):
    return [(line.is_well, line.text) for line in check()]


def test_an_installation_that_is_well(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("DESIGNOPT_CACHE", str(tmp_path / "programs"))
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cli.run(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == "All is well."
    assert {line[:6].strip() for line in lines[:-1]} <= {"ok", "note"}
    for words in ("Python 3.", "computes in float64", "OpenCV ", "plug-ins can be loaded"):
        assert sum(words in line for line in lines) == 1
    assert "note  no shell completion; designopt --install-completion" in lines


def test_something_wrong_is_exit_code_1(capsys, monkeypatch):
    monkeypatch.setattr(doctor, "CHECKS", (lambda: iter([doctor.Check(False, "a\nb")]),))
    assert cli.run(["doctor"]) == 1
    assert capsys.readouterr().out == "WRONG a b\n1 of 1 checks found something wrong.\n"


def test_versions_below_their_bounds(monkeypatch):
    monkeypatch.setattr(doctor, "requires", lambda name: METADATA["Requires-Dist"])
    found = importlib.metadata.version("pydantic")
    lines = lines_of(doctor.check_requirements)
    assert (False, "no-such-package is not installed; pip install 'no-such-package>=2.0'") in lines
    wanted = f"pydantic {found} is installed; pip install 'pydantic>=99.0'"
    assert (False, wanted) in lines
    assert sum(is_well is False for is_well, _ in lines) == 2


def test_an_extra_that_is_missing_is_for_the_user_to_decide(monkeypatch):
    monkeypatch.setattr(doctor, "requires", lambda name: METADATA["Requires-Dist"][:1])
    monkeypatch.setattr(doctor, "metadata", lambda name: Metadata())
    assert (True, "1 required packages, none older than it must be") in lines_of(
        doctor.check_requirements
    )
    monkeypatch.setattr(doctor, "requires", lambda name: METADATA["Requires-Dist"][3:])
    missing = "extra 'toys': without no-extra; pip install 'designopt[toys]'"
    assert (None, missing) in lines_of(doctor.check_requirements)


class Metadata:
    """Of a distribution with an extra."""

    def get_all(self, name):
        assert name == "Provides-Extra"
        return ["toys"]


def test_an_old_python(monkeypatch):
    monkeypatch.setattr(doctor.platform, "python_version", lambda: "3.10.1")
    [(is_well, text)] = lines_of(doctor.check_python)
    assert (is_well, text[:39]) == (False, "Python 3.10.1; designopt needs >=3.11: ")


def test_a_second_opencv(monkeypatch):
    owners = {"cv2": ["opencv-python", doctor.OPENCV]}
    monkeypatch.setattr(doctor, "packages_distributions", lambda: owners)
    [(is_well, text)] = lines_of(doctor.check_opencv)
    assert not is_well
    assert "pip uninstall opencv-python && pip install" in text


def test_a_device_that_computes_something_else(monkeypatch):
    monkeypatch.setattr(doctor.math, "sin", lambda x: 0.0)
    [(is_well, text)] = lines_of(doctor.check_jax)
    assert not is_well
    assert "does not compute in float64 (sin 1 is off by 0.84" in text


@pytest.mark.parametrize(
    ("value", "is_well", "words"),
    [
        ("off", None, "compiled programs are not kept: DESIGNOPT_CACHE=off"),
        ("file/x", False, "Not a directory; change its permissions, or name another folder by"),
        ("new", True, "compiled programs are kept in "),
    ],
)
def test_the_folder_of_compiled_programs(monkeypatch, tmp_path, value, is_well, words):
    (tmp_path / "file").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DESIGNOPT_CACHE", value)
    [(found, text)] = lines_of(doctor.check_cache)
    assert found is is_well
    assert words in text


def test_a_plug_in_that_cannot_be_loaded(monkeypatch):
    point = importlib.metadata.EntryPoint("odd", "no_such_package:STUDY", "designopt.studies")
    monkeypatch.setattr(doctor, "entry_points", lambda group: [point])
    lines = lines_of(doctor.check_plug_ins)
    assert [is_well for is_well, _ in lines] == len(doctor.PLUG_INS) * [False]
    assert "'odd' (no_such_package:STUDY) cannot be loaded" in lines[0][1]


def test_completion_that_is_installed(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    done = python("-m", "designopt", "--install-completion", "fish", env=FISH | {"HOME": tmp_path})
    assert done.returncode == 0, done.stderr
    [(is_well, text)] = lines_of(doctor.check_completion)
    assert is_well
    assert str(tmp_path) in text


FISH = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
"""Has the shell named, and not found by the processes around this one."""
