"""Golden values: what the toolkit gives today, so that moving its rooms changes nothing.

They are no proof that a value is right (other tests compare with oracles); they show that it is the
same. ``python -m tests.golden record PART ...`` writes them to ``tests/data/golden`` and
``python -m tests.golden check PART ...`` compares, with the parts

``interface``
    help of every command, settings of every study, formats of the files people write, and every
    public name with its signature;
``solutions``
    what ``designopt solve`` and ``designopt trace`` write for the galleries;
``reduced``
    metrics and tables of every study with few cases, in less than five minutes;
``defaults``
    the same with default settings, which takes about an hour.

With ``--study NAME`` only that study's are compared or recorded, of the last two parts. With
``--runs DIR`` the results in ``DIR/STUDY`` are read, and only what is missing there is run. Of
run times only the presence and the unit are compared, and random draws of Python's and JAX's
generators belong to the versions of ``constraints.txt``. A public name that is left behind or
renamed on purpose is recorded anew, in the commit that explains it.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import importlib
import inspect
import io
import json
import math
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from designopt import cli
from designopt.compilation_cache import forget_programs_if_many
from tests.helpers import DATA, load_toml

ROOT = Path(__file__).parent.parent
FOLDER = DATA / "golden"

REDUCED: dict[str, list[str]] = load_toml("quick_runs.toml")
"""Settings of short runs."""
for judged in (
    "physical-check", "physical-check-lenses", "physical-check-contacts", "image-check",
    "finger-verdicts",
):  # fmt: skip
    del REDUCED[judged]  # needs the extra 'judge', and its numbers are float32's rounding

WHOLE_TABLES = {
    "table1": ("table1", "deviations", "identification"),
    "finger-mirrors": ("arrangements", "degrees", "verdicts"),
    "finger": ("dimensions", "pins", "requirements"),
}
"""Tables kept in full: Table I, the intervals behind the plots of mirrors, the finger's numbers."""

PUBLIC = sorted(
    ".".join(path.relative_to(ROOT).parent.parts)
    for package in ("designopt", "kinematics", "optics", "perception", "studies")
    for path in (ROOT / package).rglob("__init__.pyi")
)

TIMES = re.compile(
    r"seconds|speedup|throughput|_per_second|compile|_m?s$|_ns$|_us$"
    r"|over_(evolution|mechanism|pylinkage|numpy|optiland|rayoptics|exact|value|brentq|closed)"
)
"""Names of metrics and columns that hold a run time, or a ratio of two."""
TIME_UNITS = ("s", "ms", "µs", "μs", "ns", "1/s", "frames/s")

RTOL, ATOL = 1e-6, 1e-9
SMALL = 1e-5
"""A recorded number below it is rounding or a residual: it may grow tenfold, no more."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("action", choices=("record", "check"))
    parser.add_argument("parts", nargs="+", choices=PARTS)
    parser.add_argument("--runs", type=Path, help="folder of results, one per study")
    parser.add_argument("--study", action="append", help="only this one; again for others")
    options = parser.parse_args(arguments)
    os.environ |= {"COLUMNS": "100", "LINES": "50"}
    differences = 0
    for part in options.parts:
        with contextlib.ExitStack() as stack:
            runs = options.runs or Path(stack.enter_context(tempfile.TemporaryDirectory()))
            studies = options.study or list(REDUCED)
            found = json.loads(json.dumps(PARTS[part](runs, studies)))
        path = FOLDER / f"{part}.json"
        if options.action == "record":
            if options.study:
                found = json.loads(path.read_text(encoding="utf-8")) | found
            text = json.dumps(found, indent=1, ensure_ascii=False, sort_keys=True) + "\n"
            path.write_text(text, encoding="utf-8")
            continue
        wanted = json.loads(path.read_text(encoding="utf-8"))
        if options.study:
            wanted = {study: wanted[study] for study in options.study}
        for line in compare(wanted, found):
            differences += 1
            print(f"{part}: {line}")
    print(f"{differences} differences" if options.action == "check" else "recorded")
    return int(differences > 0)


# What is recorded -------------------------------------------------------------------------------


def interface(*_: Any) -> dict[str, Any]:
    commands = sorted(point.name for point in entry_points(group="designopt.commands"))
    return {
        "help": {name: command(name, "--help") for name in commands},
        "settings": {
            point.name: fields_of(point.load().spec)
            for point in entry_points(group="designopt.studies")
        },
        "files": {name: fields_of(resolve_name(where)) for name, where in FILES.items()},
        "names": {name: signatures_of(name) for name in PUBLIC},
    }


FILES = {
    "linkage": "kinematics.io.sketch:Sketch",
    "scene": "optics.scene.file:SceneFile",
    "chamber": "optics.chamber.file:ChamberFile",
}
"""The model that a file of each kind is read with."""


def fields_of(model: Any) -> dict[str, str]:
    """Every key of a file or a spec with its type, default and bounds."""
    found = {}
    for key, schema in schemas(model).items():
        kept = {name: value for name, value in schema.items() if name not in NOT_KEPT}
        found[key] = json.dumps(kept, sort_keys=True)
    return found


def schemas(model: Any) -> dict[str, dict[str, Any]]:
    """The JSON schema of every key, nested keys joined by dots."""
    schema = model.model_json_schema(by_alias=True)
    return dict(_schemas(schema, schema.get("$defs", {}), ""))


def _schemas(
    part: dict[str, Any], parts: dict[str, Any], at: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    if "$ref" in part:
        part = {**parts[part["$ref"].rsplit("/", 1)[1]], **part}
    for within in (part.get("items"), part.get("additionalProperties")):
        if isinstance(within, dict) and "$ref" in within:
            yield from _schemas(within, parts, f"{at}[]")
            return
    if "properties" not in part:
        yield at, part
    for key, field in part.get("properties", {}).items():
        yield from _schemas(field, parts, f"{at}.{key}".lstrip("."))


NOT_KEPT = ("title", "description", "scales", "free")
"""Of a field: what is written about it, and whether targets depend on it."""


def signatures_of(package: str) -> dict[str, str]:
    module = importlib.import_module(package)
    found = {}
    for name in sorted(module.__all__):
        public = getattr(module, name)
        try:
            # A function that is a default stands there with where it lies in this run's memory.
            found[name] = re.sub(" at 0x[0-9a-f]+", "", str(inspect.signature(public)))
        except (TypeError, ValueError):  # a constant, or an alias of a type
            members = sorted(map(str, public)) if isinstance(public, frozenset) else public
            found[name] = str(members)
    return found


def solutions(*_: Any) -> dict[str, Any]:
    found = {}
    for name, path, words in (*solves(), *traces()):
        text = command(name, str(path), *words)
        key = " ".join((name, path.name, *words))
        found[key] = table_of(text) if name == "solve" else json.loads(text, parse_float=rounded)
    return found


def solves() -> Iterator[tuple[str, Path, tuple[str, ...]]]:
    sweeps = {
        "double-butterfly": ("crank=115:150:3",),
        "finger": ("pip=-90:0:3", "dip=-80:0:3"),
        "finger-crank": ("theta=150:170:3", "gamma=-20:0:2"),
        "five-bar": ("left=90:120:3", "right=60:80:2"),
        "stephenson": ("crank=40:200:3",),
    }
    for path in gallery("linkages"):
        asked = sweeps.get(path.stem, ("crank=20:100:3",))
        first = asked[0].split("=")[0]
        further = tuple(word for sweep in asked[1:] for word in ("--sweep", sweep))
        yield "solve", path, ("--sweep", asked[0], *further)
        yield "solve", path, ("--sweep", f"{first}=-170:170:5", *further, "--rate", f"{first}=2")


def traces() -> Iterator[tuple[str, Path, tuple[str, ...]]]:
    for path in gallery("scenes"):
        yield "trace", path, ("--ray", "10,5,-60", "--ray", "0,1,200")
        if path.stem == "finger":
            yield "trace", path, ("--sweep", "pip=0:90:4", "--pose", "dip=30")
            yield "trace", path, ("--sweep", "dip=0:90:4", "--pose", "pip=20")
            yield "trace", path, ("--sweep", "pip=0:90:4", "--sweep", "dip=0:90:4")
        else:
            yield "trace", path, ("--bounces", "1")


def gallery(kind: str) -> list[Path]:
    return sorted((ROOT / "studies").glob(f"gallery/{kind}/*.toml"))


def table_of(text: str) -> dict[str, list[float | str]]:
    head, *rows = csv.reader(io.StringIO(text))
    return {name: [number(row[i]) for row in rows] for i, name in enumerate(head)}


def number(cell: str) -> float | str:
    try:
        return rounded(cell)
    except ValueError:
        return cell


def rounded(number: str) -> float:
    return float(f"{float(number):.12g}")


def reduced(runs: Path, studies: list[str]) -> dict[str, Any]:
    return {study: outcome(study, REDUCED[study], runs) for study in studies}


def defaults(runs: Path, studies: list[str]) -> dict[str, Any]:
    return {study: outcome(study, (), runs) for study in studies}


def outcome(study: str, settings: Sequence[str], runs: Path) -> dict[str, Any]:
    """Metrics, heads of the tables, and some tables in full, of a study's result."""
    folder = runs / study
    if not folder.exists():
        forget_programs_if_many()  # all studies together would fill what a process may map
        sets = [word for setting in settings for word in ("--set", setting)]
        command("run", study, *sets, "--out", str(folder))
    document = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    metrics = {
        name: {
            "unit": metric["unit"],
            "target": str(metric["target"]),
            "value": "a run time" if is_time(name, metric["unit"]) else metric["value"],
        }
        for name, metric in document["metrics"].items()
    }
    tables = {
        Path(name).stem: table_of((folder / name).read_text(encoding="utf-8"))
        for name in document["tables"]
    }
    whole = WHOLE_TABLES.get(study, ())
    return {
        "metrics": metrics,
        "keys": sorted(document),
        "specs": document["specs"],
        "figures": sorted(document["figures"]),
        "heads": {name: list(table) for name, table in tables.items()},
        "tables": {name: table for name, table in tables.items() if name in whole},
    }


def is_time(name: str, unit: str) -> bool:
    return unit in TIME_UNITS or TIMES.search(name) is not None


def command(*words: str) -> str:
    """Standard output of a command; a missed target is no failure here."""
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        code = cli.run(list(words))
    if code not in (0, 1):
        raise SystemExit(f"designopt {' '.join(words)}: exit code {code}")
    return shown.getvalue()


# How it is compared -----------------------------------------------------------------------------


def compare(wanted: Any, found: Any, where: str = "") -> Iterator[str]:
    """A line for every difference."""
    if isinstance(wanted, dict) and isinstance(found, dict):
        for key in sorted(wanted.keys() | found.keys()):
            place = f"{where} / {key}" if where else key
            if key not in found:
                yield f"{place}: gone"
            elif key not in wanted:
                yield f"{place}: new"
            else:
                yield from compare(wanted[key], found[key], place)
    elif isinstance(wanted, list) and isinstance(found, list) and len(wanted) == len(found):
        for i, (before, now) in enumerate(zip(wanted, found, strict=True)):
            yield from compare(before, now, f"{where}[{i}]")
    elif not same(wanted, found):
        yield f"{where}: {wanted!r} -> {found!r}"


def same(wanted: Any, found: Any) -> bool:
    if not (isinstance(wanted, float | int) and isinstance(found, float | int)):
        return wanted == found
    if isinstance(wanted, bool) or isinstance(found, bool):
        return wanted is found
    if abs(wanted) < SMALL and isinstance(wanted, float):
        return abs(found) <= max(10 * abs(wanted), ATOL)
    return math.isclose(wanted, found, rel_tol=RTOL, abs_tol=ATOL)


PARTS: dict[str, Callable[..., dict[str, Any]]] = {
    "interface": interface,
    "solutions": solutions,
    "reduced": reduced,
    "defaults": defaults,
}

if __name__ == "__main__":
    sys.exit(main())
