"""Files and settings with random changes: a finite answer, or one line with the cure."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic_core import PydanticUndefined, to_json

from designopt import UserError
from designopt.cli import run
from designopt.io.spec_files import validated
from designopt.study.settings import fields, spec_with
from designopt.study.study import installed_studies, load_study
from optics.chamber.file import format_chamber
from tests.helpers import nightly
from tests.mutations import UNKNOWN, mutate, mutated, toml
from tests.optics.chambers import PAPER


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, and what it printed."""

    code: int
    out: str
    err: str


def ended(*arguments: str) -> Ended:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run([*arguments])
    return Ended(code, out.getvalue(), err.getvalue())


def fault_of(how: Ended, unknown: bool, check: Callable[[str], str]) -> str:
    """What is wrong with how a command took a file; empty if nothing is.

    Args:
        how: it ended.
        unknown: whether the file has a key that must be refused.
        check: what is wrong with an output, likewise.
    """
    if how.code not in (0, 1, 2) or "Traceback" in how.err:
        return f"exit code {how.code}: {how.err}"
    if how.code == 2:
        one_line = how.err.startswith("error: ") and how.err[:-1].isprintable() and not how.out
        return "" if one_line and how.err.endswith("\n") else f"not one line: {how!r}"
    return "an unknown key was accepted" if unknown else check(how.out)


def fault_of_table(out: str) -> str:
    """Poses that are ok have finite numbers alone."""
    rows = list(csv.DictReader(io.StringIO(out)))
    sound = [row for row in rows if row["ok"] != "0"]
    bad = [row for row in sound if not all(math.isfinite(float(one)) for one in row.values())]
    return f"ok, and not finite: {bad[0]}" if bad else "" if rows else "an empty table"


def fault_of_document(out: str) -> str:
    """JSON has no numbers that are not finite, whatever Python reads and writes."""
    odd: list[str] = []
    json.loads(out, parse_constant=odd.append)
    return f"not finite: {odd}" if odd else ""


def gallery(folder: str, names: Sequence[str]) -> list[str]:
    place = files("studies") / folder
    return [(place / f"{name}.toml").read_text(encoding="utf-8") for name in names]


def solve(path: Path, document: dict[str, Any]) -> Ended:
    sweeps = [f"--sweep={one['name']}=20:60:3" for one in document["inputs"]]
    return ended("solve", str(path), *sweeps)


def trace(path: Path, document: dict[str, Any], *options: str) -> Ended:
    angles = [frame["angle"] for frame in document.get("frames", {}).values()]
    return ended("trace", str(path), *options, *[f"--sweep={one}=20:60:2" for one in angles])


def export(path: Path, _: dict[str, Any]) -> Ended:
    how = ended("export", str(path), "--to=json", "--to=svg", f"--out={path.parent}", "--force")
    if how.code != 0:
        return how
    return Ended(how.code, path.with_suffix(".json").read_text(encoding="utf-8"), how.err)


@dataclass(frozen=True)
class Kind:
    """Files of one kind.

    Attributes:
        take: has a command take a file; the document is that of the file before its changes.
        check: what is wrong with the command's output.
        texts: of the files.
    """

    take: Callable[[Path, dict[str, Any]], Ended]
    check: Callable[[str], str]
    texts: list[str]


LINKAGES = ("four-bar", "slider-crank", "quick-return", "scotch-yoke", "five-bar")
MORE_LINKAGES = ("finger", "finger-crank", "peaucellier", "stephenson", "watt", "jansen")
SCENES = ("finger", "half-height-mirror")
MORE_SCENES = ("circle", "corner-reflector", "ellipse", "folded-pad", "kaleidoscope-60",
               "kaleidoscope-90", "layered-pad", "parabola", "periscope")  # fmt: skip
KINDS = {
    "linkage": Kind(solve, fault_of_table, gallery("gallery/linkages", LINKAGES)),
    "scene": Kind(lambda path, before: trace(path, before, "--bounces=1"), fault_of_document,
                  gallery("gallery/scenes", SCENES)),
    "chamber": Kind(export, fault_of_document, [format_chamber("soft", PAPER)]),
}  # fmt: skip
"""Files that compile quickly, and all others."""
ALL_KINDS = KINDS | {
    "linkage": Kind(solve, fault_of_table, gallery("gallery/linkages", LINKAGES + MORE_LINKAGES)),
    "scene": Kind(trace, fault_of_document, gallery("gallery/scenes", SCENES + MORE_SCENES)),
}


def faults(known: Kind, numbers: range, folder: Path) -> list[str]:
    """What is wrong with how changed files of a kind are taken."""
    found = []
    for number in numbers:
        text = known.texts[number % len(known.texts)]
        changed = mutated(text, np.random.default_rng([22, number]))
        path = folder / f"{number}.toml"
        path.write_bytes(changed.content)
        how = known.take(path, tomllib.loads(text))
        if fault := fault_of(how, changed.unknown, known.check):
            found.append(f"{number} ({'; '.join(changed.changes)}): {fault}")
    return found


FEW = {"linkage": range(25), "scene": range(9), "chamber": range(30)}
MANY = {"linkage": range(1000, 2000), "scene": range(1000, 1500), "chamber": range(1000, 1500)}


@pytest.mark.parametrize("kind", KINDS)
def test_changed_files_end_in_finite_numbers_or_in_one_line(kind, tmp_path):
    assert not faults(KINDS[kind], FEW[kind], tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_many_changed_files_end_in_finite_numbers_or_in_one_line(kind, tmp_path):
    assert not faults(ALL_KINDS[kind], MANY[kind], tmp_path)


def fault_of_settings(study: str, number: int, folder: Path) -> str:
    """What is wrong with how changed settings of a study are taken."""
    spec, generator = load_study(study).spec, np.random.default_rng([23, number])
    defaults = {
        key: default for key, default, _ in fields(spec) if default is not PydanticUndefined
    }
    document = json.loads(to_json(defaults))
    changes = mutate(document, generator, only_numbers=generator.uniform() < 0.4)
    texts = [f"{key}={value if isinstance(value, str) else toml(value)}"
             for key, value in document.items() if value != defaults.get(key)]  # fmt: skip
    unknown = any(UNKNOWN in change for change in changes)
    try:
        made = spec_with(spec, texts, study=study)
    except UserError:
        how = ended("run", study, *[f"--set={text}" for text in texts], f"--out={folder / study}")
        return "" if how.code == 2 and not fault_of(how, unknown, str) else f"{texts}: {how}"
    except Exception as error:
        return f"{texts}: {error!r}"
    if unknown:
        return f"{texts}: an unknown key was accepted"
    return fault_of_document(json.dumps(made.model_dump(mode="json")))


@pytest.mark.parametrize("numbers", [range(8), *nightly(range(100, 200))], ids=["few", "many"])
@pytest.mark.parametrize("study", [name for name, _ in installed_studies()])
def test_changed_settings_are_finite_or_end_in_one_line(study, numbers, tmp_path):
    assert not [one for number in numbers if (one := fault_of_settings(study, number, tmp_path))]


@pytest.mark.parametrize(
    ("how", "unknown", "words"),
    [
        (Ended(0, "crank,ok,A.x\n0,1,2.0\n1,0,\n", ""), False, ""),
        (Ended(2, "", "error: four-bar.toml: no such key; remove it\n"), True, ""),
        (Ended(0, "crank,ok,A.x\n0,1,nan\n", ""), False, "not finite"),
        (Ended(0, "crank,ok,A.x\n", ""), False, "empty"),
        (Ended(0, "crank,ok,A.x\n0,1,2.0\n", ""), True, "unknown key"),
        (Ended(70, "", "error: a fault of designopt's own\n"), False, "exit code 70"),
        (Ended(2, "", "error: one\ntwo\n"), False, "not one line"),
        (Ended(2, "", "error: \x1b[31m\n"), False, "not one line"),
        (Ended(2, "crank,ok\n", "error: late\n"), False, "not one line"),
    ],
)
def test_faults_are_seen(how, unknown, words):
    found = fault_of(how, unknown, fault_of_table)
    assert words in found
    assert bool(words) == bool(found)


def test_numbers_of_a_document_that_are_not_finite_are_seen():
    assert fault_of_document('{"a": [1, null]}') == ""
    assert "NaN" in fault_of_document('{"a": [1, NaN]}')


def without_unknown(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: without_unknown(part) for key, part in data.items() if key != UNKNOWN}
    return data


def careless(model: Any, data: Any, source: str) -> Any:
    """A reader that lets unknown keys pass."""
    return validated(model, without_unknown(data), source)


def clumsy(model: Any, data: Any, source: str) -> Any:
    """A reader that takes for granted what people may leave out."""
    assert {"length_ab", "offset_a"} <= set(data["chamber"])
    return validated(model, data, source)


@pytest.mark.parametrize(("plant", "words"), [(careless, "was accepted"), (clumsy, "code 70")])
def test_planted_faults_are_found(plant, words, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr("optics.chamber.file.validated", plant)
    found = faults(KINDS["chamber"], range(10), tmp_path)
    assert found
    assert all(words in fault for fault in found)


def test_changes_are_the_same_every_time_and_leave_a_document_readable():
    text = KINDS["linkage"].texts[0]
    one = [mutated(text, np.random.default_rng([1, number])) for number in range(200)]
    assert one == [mutated(text, np.random.default_rng([1, number])) for number in range(200)]
    assert len({changed.content for changed in one}) > 150
    assert any(changed.unknown for changed in one)
    document = tomllib.loads(text)
    again = "".join(f"{key} = {toml(part)}\n" for key, part in document.items())
    assert tomllib.loads(again) == document
