"""What is compiled once is not compiled again, and no file of the cache can do harm."""

import errno
import json
import os
import sys
import tempfile
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import pytest
from jax._src import compilation_cache

from designopt import cli
from designopt.compilation_cache import (
    ABANDONED,
    MAPPINGS,
    OFF,
    PARTIAL,
    VARIABLE,
    Store,
    forget_programs_if_many,
    forget_with_programs,
    keep_programs,
)
from tests.commands import python
from tests.designopt.tables import cases


def files(folder):
    return sorted(path for path in folder.iterdir() if path.is_file())


def test_a_store_keeps_values_for_others(tmp_path):
    Store(tmp_path).put("a", b"one")
    Store(tmp_path).put("b" * 1000, b"")
    Store(tmp_path).put("a", b"two")
    store = Store(tmp_path)
    assert (store.get("a"), store.get("b" * 1000), store.get("c")) == (b"two", b"", None)
    assert len(files(tmp_path)) == 2


HARM = {
    "cut short": lambda content, other: content[:-1],
    "empty": lambda content, other: b"",
    "longer": lambda content, other: content + b"\0",
    "altered": lambda content, other: content[:-1] + b"!",
    "another program's": lambda content, other: b"\x89PNG" * 100,
    "another key's": lambda content, other: other,
}


@pytest.mark.parametrize("harm", HARM)
def test_a_harmed_file_is_no_value_and_is_replaced(tmp_path, harm):
    store = Store(tmp_path)
    store.put("a", b"one")
    store.put("b", b"two")
    first, second = files(tmp_path)
    first.write_bytes(HARM[harm](first.read_bytes(), second.read_bytes()))
    assert None in {store.get("a"), store.get("b")} < {None, b"one", b"two"}
    assert store.get("a") in (None, b"one")
    assert store.get("b") in (None, b"two")
    store.put("a", b"one")
    store.put("b", b"two")
    assert (store.get("a"), store.get("b")) == (b"one", b"two")


def test_a_folder_has_a_bound_and_what_was_used_last_stays(tmp_path):
    limit, size = 64_000, 1000
    store = Store(tmp_path, limit)
    for i in range(200):
        store.put(f"{i}", bytes(size))
        ages = {path: path.stat().st_mtime - 10 for path in files(tmp_path)}
        for path, seconds in ages.items():
            os.utime(path, (seconds, seconds))
        assert store.get("0") == bytes(size)
        assert sum(path.stat().st_size for path in files(tmp_path)) <= limit * 17 / 16
    assert len(files(tmp_path)) > 50
    assert store.get("199") == bytes(size)
    assert store.get("1") is None
    store.put("large", bytes(limit + 1))
    assert store.get("large") is None


def test_what_a_killed_process_left_is_removed_later(tmp_path):
    old, new = (Path(tempfile.mkstemp(PARTIAL, dir=tmp_path)[1]) for _ in range(2))
    seconds = time.time() - 2 * ABANDONED
    os.utime(old, (seconds, seconds))
    Store(tmp_path).put("a", b"one")
    assert new.exists()
    assert not old.exists()


@pytest.mark.parametrize("name", ["thesis.pdf", "film.mkv.partial", 64 * "0"])
def test_files_of_others_in_a_folder_are_never_removed(tmp_path, name):
    """The user names any folder; what is in it may be large, and old."""
    path = tmp_path / name
    path.write_bytes(bytes(100_000))
    os.utime(path, (0, 0))
    store = Store(tmp_path, 64_000)
    for i in range(100):
        store.put(f"{i}", bytes(1000))
    assert path.exists()
    assert len(files(tmp_path)) > 50


def fail(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_programs_are_read_where_nothing_can_be_written(tmp_path, monkeypatch):
    Store(tmp_path).put("a", b"one")
    monkeypatch.setattr(os, "utime", fail)
    assert Store(tmp_path).get("a") == b"one"


def test_an_interrupt_while_a_program_is_kept_is_not_lost(tmp_path, monkeypatch):
    replace = os.replace

    def interrupted_replace(*paths):
        replace(*paths)
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted_replace)
    with pytest.raises(KeyboardInterrupt):
        Store(tmp_path).put("a", b"one")
    assert Store(tmp_path).get("a") == b"one"


@pytest.mark.parametrize("failing", ["tempfile.mkstemp", "os.replace", "os.scandir"])
def test_a_full_disk_or_a_folder_that_is_gone_stops_nothing(tmp_path, monkeypatch, failing):
    store = Store(tmp_path)
    Store(tmp_path).put("a", b"one")
    with monkeypatch.context() as patched:
        patched.setattr(failing, fail)
        store.put("b", b"two")
    store.put("c", b"three")  # a full disk is not tried again and again
    assert (store.get("a"), store.get("b"), store.get("c")) == (b"one", None, None)
    assert len(files(tmp_path)) == 1


def test_many_use_a_folder_at_once(tmp_path):
    values = {f"{i}": bytes([i]) * 5000 for i in range(20)}

    def work(number):
        store = Store(tmp_path, 64_000)
        for _ in range(5):
            for key, value in values.items():
                assert store.get(key) in (None, value), number
                store.put(key, value)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(8)))
    assert not [path for path in files(tmp_path) if path.suffix == PARTIAL]


def test_programs_for_other_numbers_of_threads_are_others(tmp_path, monkeypatch):
    store = Store(tmp_path)
    monkeypatch.setenv("NPROC", "2")
    store.put("a", b"two threads")
    monkeypatch.setenv("NPROC", "1")
    assert store.get("a") is None


PROGRAM = """
import json
from designopt.compilation_cache import keep_programs

keep_programs()
import jax
import jax.numpy as jnp

events = []
jax.monitoring.register_event_listener(lambda event, **_: events.append(event))

programs = jax.jit(lambda x: 2 * x), jax.jit(lambda x: 3 * x)
answers = [program(jnp.arange(3.0)).tolist() for program in programs]
print(json.dumps([answers, sum(event.endswith("/cache_hits") for event in events)]))
"""
ANSWERS = [[0.0, 2.0, 4.0], [0.0, 3.0, 6.0]]


def hits(home, **variables):
    """How many programs were not compiled."""
    ours = (VARIABLE, "XDG_CACHE_HOME", "JAX_COMPILATION_CACHE_DIR")
    bare = {name: value for name, value in os.environ.items() if name not in ours}
    done = python("-c", PROGRAM, env=bare | {"HOME": str(home)} | variables, cwd=home)
    assert (done.returncode, done.stderr) == (0, "")
    answers, count = json.loads(done.stdout)
    assert answers == ANSWERS
    return count


def test_programs_are_kept_between_processes(tmp_path):
    folder = tmp_path / "a" / "b"
    assert hits(tmp_path, **{VARIABLE: "a/b"}) == 0
    assert folder.stat().st_mode & 0o777 == 0o700
    kept = files(folder)
    assert hits(tmp_path, **{VARIABLE: str(folder)}) == len(kept) >= 2
    assert files(folder) == kept
    for path in kept:
        path.rename(path.with_suffix(".x"))
    for path, other in zip(kept, kept[1:] + kept[:1], strict=True):  # each in another's place
        path.with_suffix(".x").rename(other)
    assert hits(tmp_path, **{VARIABLE: str(folder)}) == 0


@pytest.fixture
def unset(monkeypatch, tmp_path):
    """JAX as it is in a process of its own, but for being loaded."""
    before = getattr(jax.config, "jax_compilation_cache_dir", None)
    jax.config.update("jax_compilation_cache_dir", None)
    for name in (VARIABLE, "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(compilation_cache, "get_file_cache", None)
    monkeypatch.setattr(warnings, "filterwarnings", lambda *_: None)
    seconds = jax.config.values["jax_persistent_cache_min_compile_time_secs"]
    yield
    jax.config.update("jax_compilation_cache_dir", before)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", seconds)


def used():
    keep_programs()
    return getattr(jax.config, "jax_compilation_cache_dir", None)


@pytest.mark.usefixtures("unset")
@pytest.mark.parametrize(("platform", "variables", "place"), cases("cache_folders"))
def test_the_folder_is_the_systems_or_the_users_if_there_is_one(
    monkeypatch, tmp_path, capsys, platform, variables, place
):
    monkeypatch.setattr(sys, "platform", platform)
    for name, value in variables.items():
        monkeypatch.setenv(name, value.format(home=tmp_path))
    assert used() == (str(tmp_path / place) if place else None)
    assert (tmp_path / place).is_dir()
    assert capsys.readouterr() == ("", "")


def test_a_folder_that_the_user_gave_jax_remains(monkeypatch, tmp_path):
    before = getattr(jax.config, "jax_compilation_cache_dir", None)
    assert before is not None
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert used() == before


def open_to_others(place):
    place.mkdir()
    place.chmod(0o777)


@pytest.mark.usefixtures("unset")
@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (Path.touch, "File exists"),
        (lambda place: place.symlink_to(place), "File exists"),
        (open_to_others, "others can write into it"),
    ],
)
def test_a_folder_that_cannot_be_used_is_one_line_where_it_was_named(
    monkeypatch, tmp_path, caplog, harm, words
):
    place = tmp_path / ".cache" / "designopt" / "programs"
    place.parent.mkdir(parents=True)
    harm(place)
    assert used() is None
    assert caplog.messages == []
    monkeypatch.setenv(VARIABLE, str(place))
    assert used() is None
    assert caplog.messages == [f"{VARIABLE}={place}: not used: {words}"]


@pytest.mark.usefixtures("unset")
def test_a_folder_of_somebody_else_is_not_used(monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    assert used() is None


@pytest.mark.parametrize("line", ["--no-cache solve no.toml", "solve no.toml --no-cache"])
def test_an_option_switches_it_off(monkeypatch, capsys, line):
    monkeypatch.setenv(VARIABLE, "somewhere")
    assert cli.run(line.split()) == 2
    assert os.environ[VARIABLE] == OFF  # for the processes of a sweep, too
    assert "no.toml" in capsys.readouterr().err


@pytest.mark.parametrize(("count", "forgotten"), [(39, 0), (41, 1)])
def test_programs_are_forgotten_before_a_process_may_map_no_more(
    tmp_path, monkeypatch, count, forgotten
):
    cleared, others = [], []
    monkeypatch.setattr(jax, "clear_caches", lambda: cleared.append(True))
    monkeypatch.setattr("designopt.compilation_cache._FORGETTING", [])
    forget_with_programs(lambda: others.append(True))
    # Names of files need not be text.
    for name, text in {"MAPPINGS": b"a \xff mapping\n" * count, "MOST_MAPPINGS": b"100\n"}.items():
        (tmp_path / name).write_bytes(text)
        monkeypatch.setattr(f"designopt.compilation_cache.{name}", tmp_path / name)
    forget_programs_if_many()
    assert len(cleared) == len(others) == forgotten


def test_without_a_bound_on_mappings_nothing_is_forgotten(tmp_path, monkeypatch):
    cleared = []
    monkeypatch.setattr(jax, "clear_caches", lambda: cleared.append(True))
    monkeypatch.setattr("designopt.compilation_cache.MOST_MAPPINGS", tmp_path / "none")
    forget_programs_if_many()
    assert not cleared


MAPPING = """
import jax
import jax.numpy as jnp
from designopt import compilation_cache

def count():
    return len(compilation_cache.MAPPINGS.read_text().splitlines())

ahead = []
compilation_cache.forget_with_programs(ahead.clear)

def compile_some(offset):
    for number in range(20):
        some = jax.jit(lambda x: jnp.sin(x) * (number + offset) + jnp.sort(x))
        if number % 2:
            some(jnp.arange(8.0))
        else:
            ahead.append(some.lower(jnp.arange(8.0)).compile())
    return count()

compilation_cache.FULL = 0.0
begin, first = count(), compile_some(0.0)
compilation_cache.forget_programs_if_many()
print(begin, first, compile_some(0.5))
"""


@pytest.mark.skipif(not MAPPINGS.exists(), reason="Linux alone counts mappings")
def test_forgotten_programs_leave_their_mappings_to_others():
    """As the bound is on these, not on what JAX keeps; those compiled ahead among them."""
    done = python("-c", MAPPING)
    assert (done.returncode, done.stderr) == (0, "")
    begin, first, second = map(int, done.stdout.split())
    assert first > begin + 20
    assert second < first + (first - begin) / 2
