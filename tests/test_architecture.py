"""The house itself: import arrows, public names, documents that keep their word."""

import ast
import importlib
import inspect
import itertools
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from importlib.metadata import entry_points
from pathlib import Path
from typing import Literal, get_origin

import jax.numpy as jnp
import pytest
from jaxtyping import TypeCheckError

from designopt import find_root, safe_quadratic_roots
from optics import Chamber

ROOT = Path(__file__).parent.parent
PACKAGES = ("designopt", "kinematics", "optics", "perception", "studies")
STUBS = {
    ".".join(stub.parent.relative_to(ROOT).parts): stub
    for package in PACKAGES
    for stub in sorted((ROOT / package).rglob("__init__.pyi"))
}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_imports_point_one_way():
    tool = shutil.which("lint-imports", path=str(Path(sys.executable).parent))
    assert tool is not None
    done = subprocess.run(
        [tool, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("package", STUBS)
def test_public_names_are_what_the_stub_imports_with_words_and_examples(package):
    stub, module = ast.parse(STUBS[package].read_text()), importlib.import_module(package)
    imports = [part for part in stub.body if isinstance(part, ast.ImportFrom)]
    imported = [alias.asname or alias.name for part in imports for alias in part.names]
    [listed] = (ast.literal_eval(part.value) for part in stub.body if isinstance(part, ast.Assign))
    assert sorted(imported) == sorted(listed) == sorted(module.__all__)
    for name in listed:
        public = getattr(module, name)
        words = public.__doc__ or ""
        assert words or get_origin(public) is Literal, name  # a Literal cannot carry any
        assert ">>>" in words or not inspect.isfunction(inspect.unwrap(public)), name


def test_no_name_is_public_twice():
    names = Counter(name for one in STUBS for name in importlib.import_module(one).__all__)
    assert [name for name, count in names.items() if count > 1] == []


def test_every_package_is_typed_and_in_the_wheel():
    assert PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == list(PACKAGES)
    for package in PACKAGES:
        assert (ROOT / package / "py.typed").is_file()


def test_every_dependency_has_a_reason():
    reasons = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    wanted = PROJECT["project"]["dependencies"]
    for requirement in itertools.chain(
        wanted, *PROJECT["project"]["optional-dependencies"].values()
    ):
        name = re.split(r"[\[>=]", requirement)[0]
        assert re.search(rf"^\|.*\b{re.escape(name)}\b.*\|", reasons, re.MULTILINE), name


def test_constraints_are_plain_pins_of_every_dependency():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = {}
    for line in lines:
        match = re.fullmatch(r"([A-Za-z0-9._-]+)==([A-Za-z0-9.+!_]+)", line)
        assert match, line
        pins[match[1].lower().replace("_", "-")] = match[2]
    for requirement in PROJECT["project"]["dependencies"]:
        assert re.split(r"[>=]", requirement)[0].lower().replace("_", "-") in pins


def test_annotated_shapes_are_checked_in_this_run():
    with pytest.raises(TypeCheckError):
        safe_quadratic_roots(*(jnp.zeros(3, int),) * 3)
    with pytest.raises(TypeCheckError):
        find_root(lambda y, _: y, jnp.zeros(2))
    with pytest.raises(TypeCheckError):
        inspect.getattr_static(Chamber, "_imaged")(None, jnp.zeros(2), jnp.zeros(2))


def test_every_annotation_can_be_evaluated():
    """A shape that lost its quotes is no annotation, and would go unchecked."""
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for match in re.finditer(r"\b(?:Float|Int|Bool)\[Array, ([^\]]*)\]", path.read_text()):
                assert match[1].startswith('"'), (path, match[0])


def test_every_study_has_a_readme():
    for point in entry_points(group="designopt.studies"):
        readme = ROOT / point.module.replace(".", "/") / "README.md"
        title = readme.read_text(encoding="utf-8").partition("\n")[0].replace("_", "-")
        assert title.startswith(f"# {point.name}"), point.name
