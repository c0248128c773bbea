"""Plans and programs kept between processes: used where they are current, and nowhere else."""

from __future__ import annotations

import os
import pickle
import shutil
from collections import OrderedDict
from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest

from designopt import kept
from designopt.compilation_cache import VARIABLE, Store, current_store
from designopt.interpreter import named_program
from designopt.kept import compute, kept_value, leaves_of
from tests.commands import python
from tests.helpers import GALLERY

THREE = {"angle": np.array([0.1, 0.2]), "more": (np.array(3.0), None)}


def waves(given, times):
    angle, (offset, _) = given["angle"], given["more"]
    return OrderedDict(sine=jnp.sin(times * angle) + offset, cosine=jnp.cos(times * angle))


@pytest.fixture
def store(tmp_path, monkeypatch):
    """Where values are kept in this process."""
    monkeypatch.setattr("designopt.compilation_cache.STORES", [Store(tmp_path)])
    monkeypatch.setattr(kept, "_PROGRAMS", {})
    kept._fingerprint.cache_clear()
    yield tmp_path
    kept._fingerprint.cache_clear()


def counted(results):
    calls = iter(results)
    return partial(next, calls)


def test_a_value_is_worked_out_once(store):
    later = counted([(1, "a"), (2, "b")])
    assert kept_value("key", later) == kept_value("key", later) == (1, "a")
    assert kept_value("another key", later) == (2, "b")


def test_nothing_is_kept_where_no_command_asked_for_it():
    assert current_store() is None  # in tests
    later = counted([1, 2])
    assert (kept_value("key", later), kept_value("key", later)) == (1, 2)


def test_what_cannot_be_pickled_is_worked_out_again(store):
    later = counted([lambda: 1, lambda: 2])
    assert (kept_value("key", later)(), kept_value("key", later)()) == (1, 2)
    assert not list(store.iterdir())


@pytest.mark.parametrize("change", ["code", "version", "option"])
def test_a_change_of_the_code_makes_what_is_kept_old(store, monkeypatch, tmp_path, change):
    folder = tmp_path / "packages"
    (folder / "designopt").mkdir(parents=True)
    source = folder / "designopt" / "one.py"
    source.write_text("one = 1\n")
    monkeypatch.setattr(kept, "__file__", str(folder / "designopt" / "kept.py"))
    later = counted([1, 2])
    assert kept_value("key", later) == 1
    kept._fingerprint.cache_clear()
    assert kept_value("key", later) == 1
    if change == "code":
        source.write_text("one = 10\n")
    elif change == "version":
        monkeypatch.setattr(kept.importlib.metadata, "version", lambda name: "0.0")
    else:
        monkeypatch.setenv("JAX_NUMPY_DTYPE_PROMOTION", "another")
    kept._fingerprint.cache_clear()
    assert kept_value("key", later) == 2


@pytest.mark.usefixtures("store")
def test_a_function_of_arrays_is_what_it_is_in_numpy():
    place = f"{__name__}:waves"
    for factor in (1.0, 2.0):  # the second time with the program of the first, from its file
        kept._PROGRAMS.clear()
        given = {"angle": factor * THREE["angle"], "more": THREE["more"]}
        found = compute(place, given, 2)
        assert list(found) == ["sine", "cosine"]
        np.testing.assert_allclose(found["sine"], np.sin(2 * given["angle"]) + 3.0, rtol=1e-15)
        np.testing.assert_allclose(found["cosine"], np.cos(2 * given["angle"]), rtol=1e-15)
    assert compute(place, THREE, 3)["sine"][0] == pytest.approx(np.sin(0.3) + 3)
    single = {"angle": np.array([0.1], np.float32), "more": (np.array(0, np.float32), None)}
    assert compute(place, single, 2)["sine"].dtype == np.float32


def test_leaves_are_in_the_order_of_jax():
    assert leaves_of({"b": 1, "a": (2, [3, None])}) == [2, 3, 1]


def test_a_program_is_pickled_without_jax(tmp_path):
    names, program = named_program(partial(waves, times=2), THREE)
    path = tmp_path / "program"
    path.write_bytes(pickle.dumps((names, program)))
    code = (
        "import pickle, sys\nimport numpy as np\n"
        f"names, program = pickle.loads(open({str(path)!r}, 'rb').read())\n"
        "found = program(np.array([0.1, 0.2]), np.array(3.0))\n"
        "assert 'jax' not in sys.modules\n"
        "print(dict(zip(names, [one.tolist() for one in found])))\n"
    )
    done = python("-c", code)
    assert done.stderr == ""
    assert done.stdout.startswith(f"{{'sine': [{np.sin(0.2) + 3.0}")


WATCHED = """
import sys
from designopt.cli import run

code = run(sys.argv[1:])
print("jax" in sys.modules, "networkx" in sys.modules, "scipy" in sys.modules, file=sys.stderr)
raise SystemExit(code)
"""


def test_a_second_solve_of_the_same_topology_loads_neither_jax_nor_networkx(tmp_path):
    text = (GALLERY / "linkages/four-bar.toml").read_text()
    (tmp_path / "one.toml").write_text(text)
    longer = text.replace("O2-A = 40 }", "O2-A = 41 }")
    (tmp_path / "two.toml").write_text(longer.replace('name = "four-bar"', 'name = "other"'))
    bare = {name: value for name, value in os.environ.items() if not name.startswith("JAX")}
    env = bare | {VARIABLE: str(tmp_path / "kept")}
    loaded, tables = [], []
    for name, count in (("one", 10), ("two", 20), ("two", 20)):
        command = ["solve", f"{name}.toml", "--sweep", f"crank=0:360:{count}"]
        done = python("-c", WATCHED, *command, cwd=tmp_path, env=env)
        assert done.returncode == 0, done.stderr
        loaded.append(done.stderr.split()[-3:])
        tables.append(done.stdout)
        if len(tables) == 2:
            shutil.rmtree(tmp_path / "kept")
    assert loaded[1] == ["False"] * 3
    assert loaded[0][:2] == loaded[2][:2] == ["True"] * 2
    assert tables[1] == tables[2]  # with the kept program and with a new one
