"""What the packages list: each name once, and for each function an example that is run."""

import ast
import importlib
import inspect
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STUBS = [
    stub
    for package in ("designopt", "kinematics", "optics", "perception", "studies")
    for stub in sorted((ROOT / package).rglob("__init__.pyi"))
]
PACKAGES = [".".join(stub.parent.relative_to(ROOT).parts) for stub in STUBS]


def names(package: str) -> list[str]:
    return list(importlib.import_module(package).__all__)


def test_stubs_list_what_they_import():
    for stub in STUBS:
        tree = ast.parse(stub.read_text())
        imported = {
            alias.asname or alias.name
            for node in tree.body
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        listed = [name for node in tree.body if isinstance(node, ast.Assign)
                  for name in ast.literal_eval(node.value)]  # fmt: skip
        assert sorted(imported) == sorted(listed), stub


def test_no_name_is_listed_twice():
    often = Counter(name for package in PACKAGES for name in names(package))
    assert [name for name, count in often.items() if count > 1] == []


@pytest.mark.parametrize("package", PACKAGES)
def test_every_function_has_an_example(package):
    module = importlib.import_module(package)
    functions = {
        name: public
        for name in names(package)
        if inspect.isfunction(inspect.unwrap(public := getattr(module, name)))
    }
    without = [name for name, public in functions.items() if ">>>" not in (public.__doc__ or "")]
    assert without == []
