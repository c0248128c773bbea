"""Other distributions, and files, in the place of our packages: named in one line with the cure."""

from __future__ import annotations

import base64
import hashlib
import os
import shutil
from importlib.metadata import distribution
from pathlib import Path

import pytest

from designopt.installation import PACKAGES, find_clashes
from tests.commands import python

ROOT = Path(__file__).parents[2]
CURE = (
    "uninstall it and reinstall designopt: pip uninstall optics-xyz && "
    "pip install --force-reinstall --no-deps designopt"
)


def record(folder: Path, *names: str) -> str:
    """Lines of RECORD for files of a site folder."""
    lines = []
    for name in names:
        digest = hashlib.sha256((folder / name).read_bytes()).digest()
        checksum = base64.urlsafe_b64encode(digest).rstrip(b"=").decode()
        lines.append(f"{name},sha256={checksum},\n")
    return "".join(lines)


def add_distribution(folder: Path, name: str, version: str, *files: str) -> Path:
    """What pip leaves of a wheel with these files, which are there."""
    place = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    place.mkdir()
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    (place / "METADATA").write_text(metadata, encoding="utf-8")
    (place / "RECORD").write_text(record(folder, *files), encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A folder as pip leaves it after installing the wheel, without what the wheel requires."""
    folder = tmp_path_factory.mktemp("wheel")
    for package in PACKAGES:
        unused = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=unused)
    names = [str(path.relative_to(folder)) for path in folder.rglob("*.py")]
    place = add_distribution(folder, "designopt", "0.2.0", *names)
    for name in ("METADATA", "entry_points.txt"):
        text = distribution("designopt").read_text(name)
        assert text is not None
        (place / name).write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def site(wheel, tmp_path):
    """A copy of that folder for a test to spoil."""
    return shutil.copytree(wheel, tmp_path / "site")


def started(*arguments: str, path: list[Path], cwd: Path):
    """``python -m designopt`` with these folders first on the path."""
    variables = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, path))}
    return python("-m", "designopt", *arguments, env=variables, cwd=cwd)


def overwrite(site: Path) -> None:
    """Install optics-xyz 1.2 into a site folder, over ours."""
    (site / "optics" / "__init__.py").write_text("VERSION = 1\n", encoding="utf-8")
    add_distribution(site, "optics-xyz", "1.2", "optics/__init__.py")


def shadow(site: Path) -> Path:
    """Install optics-xyz 1.2 into a folder that comes before the site folder."""
    folder = site.with_name("first")
    (folder / "optics").mkdir(parents=True)
    overwrite(folder)
    return folder


def test_a_whole_installation_has_no_clash(wheel, tmp_path):
    done = started("list", "table1", path=[wheel], cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert clashes(wheel) == []


def clashes(*path: Path) -> list[str]:
    """What is found with these folders first on the path, and no other copy of the packages."""
    variables = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, path))}
    script = (
        "import os, sys; from designopt.installation import find_clashes\n"
        f"ours = {[str(one) for one in path]}\n"
        "other = lambda one: one not in ours and os.path.isdir(one + '/optics')\n"
        "sys.path = [one for one in sys.path if not other(one)]\n"
        "print('\\n'.join(find_clashes()))"
    )
    done = python("-P", "-c", script, env=variables)
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")[:-1] if done.stdout.strip() else []


@pytest.mark.parametrize(
    "arguments", [["render", "finger.toml", "--out", "o"], ["run", "finger-mirrors"]]
)
def test_a_distribution_that_overwrote_a_package_is_named(site, tmp_path, arguments):
    overwrite(site)
    scene = ROOT / "studies/gallery/scenes/finger.toml"
    shutil.copy(scene, tmp_path)
    done = started(*arguments, path=[site], cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "error: another installed distribution, optics-xyz 1.2, has overwritten the package "
        f"'optics' (1 of its files); {CURE}\n"
    )


def test_a_distribution_that_comes_first_is_named(site, tmp_path):
    first = shadow(site)
    done = started("trace", "finger.toml", path=[first, site], cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "error: another installed distribution, optics-xyz 1.2, is imported as 'optics' in place "
        f"of designopt's; {CURE}\n"
    )


def test_the_doctor_works_all_the_same_and_names_it(site, tmp_path):
    done = started("doctor", path=[shadow(site), site], cwd=tmp_path)
    assert (done.returncode, done.stderr) == (1, "")
    wrong = [line for line in done.stdout.splitlines() if line.startswith("WRONG")]
    assert "optics-xyz 1.2, is imported as 'optics'" in wrong[0]
    assert "plug-ins cannot be loaded for that reason" in wrong[1]


def test_what_uninstalling_the_other_one_leaves_is_named(site):
    (site / "optics" / "__init__.py").unlink()
    [line] = clashes(site)
    assert line.startswith("the package 'optics' has lost its files; reinstall designopt: pip ")


def test_an_altered_file_that_nobody_else_lists_is_named(site):
    (site / "kinematics" / "design.py").write_text("", encoding="utf-8")
    [line] = clashes(site)
    assert "(kinematics/design.py is altered or missing, 1 files in all)" in line


def test_a_file_on_the_path_is_named(site, tmp_path):
    (tmp_path / "studies.py").write_text("", encoding="utf-8")
    [line] = clashes(tmp_path, site)
    assert line.startswith(f"'studies' is imported from {tmp_path / 'studies.py'}, which is not")
    done = started("list", "table1", path=[tmp_path, site], cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"error: {line}\n")


@pytest.fixture
def beside(tmp_path):
    """A user's folder with modules of many names."""
    folder = tmp_path / "beside"
    folder.mkdir()
    for name in ("designopt_notes", "optics", "kinematics", "perception", "studies", "numpy"):
        script = "raise SystemExit('a file of the user was imported')\n"
        (folder / f"{name}.py").write_text(script, encoding="utf-8")
    return folder


@pytest.mark.parametrize("arguments", [["list", "table1"], ["new", "four-bar", "-"]])
def test_files_beside_the_user_are_not_imported(beside, arguments):
    done = python("-m", "designopt", *arguments, cwd=beside)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout


@pytest.mark.slow
def test_workers_of_a_sweep_import_nothing_beside_the_user(beside):
    quick = ["--set", "precision=false", "--set", "stability=false", "--workers", "1"]
    command = ["sweep", "table1", "--vary", "clearance=1:2:2", *quick, "--out", "o"]
    done = python("-m", "designopt", *command, cwd=beside)
    assert (done.returncode, done.stdout) == (0, "report: o/result/report.html\n")


def test_processes_that_are_started_import_nothing_beside_the_user(beside):
    script = "import os, sys; sys.argv[1:] = ['--version']; import designopt.cli as cli\n"
    script += "cli.leave = lambda code: None\ncli.main()\n"
    script += "os.execv(sys.executable, [sys.executable, '-c', 'import numpy; print(1)'])"
    done = python("-P", "-c", script, cwd=beside)
    assert done.stdout.endswith("\n1\n"), done.stderr


def test_what_an_interrupted_installation_has_left_has_no_name_and_is_passed_over(
    tmp_path, monkeypatch
):
    importlib_metadata = pytest.importorskip("importlib_metadata")
    (tmp_path / "broken-1.0.dist-info").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    assert find_clashes() == []
    # Once the backport is imported, it finds distributions for the standard library, too.
    monkeypatch.setattr("designopt.installation.distributions", importlib_metadata.distributions)
    assert find_clashes() == []
