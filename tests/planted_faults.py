"""Are faults in core functions caught? Each is planted in a copy of the project and tested there.

``python -m tests.planted_faults check`` runs, for every fault of ``data/planted_faults.toml``, the
test that is recorded to catch it, which has to fail. ``record`` runs all relevant tests instead and
writes down which one fails first; needed where code or tests have moved.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from tests.commands import python

ROOT = Path(__file__).parent.parent
FAULTS = ROOT / "tests" / "data" / "planted_faults.toml"
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+::\S.*?)(?: - .*)?$", re.MULTILINE)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("action", choices=("record", "check"))
    parser.add_argument("names", nargs="*", help="beginnings of faults' names; all by default")
    options = parser.parse_args(arguments)
    text = FAULTS.read_text(encoding="utf-8")
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = copied(Path(folder) / "copy")
        for fault in tomllib.loads(text)["fault"]:
            if options.names and not fault["name"].startswith(tuple(options.names)):
                continue
            tests = fault["tests"] if options.action == "record" else [fault["caught_by"]]
            catching = caught_by(copy, fault, tests)
            missed += catching is None
            print(f"{fault['name']}: {catching or 'NOT CAUGHT'}", flush=True)
            if options.action == "record" and catching is not None:
                text = FAULTS.read_text(encoding="utf-8")
                FAULTS.write_text(recorded(text, fault["name"], catching), encoding="utf-8")
    print(f"{missed} not caught")
    return int(missed > 0)


def copied(place: Path) -> Path:
    """Every file of the project that is under version control, in another folder."""
    listed = subprocess.check_output(["git", "ls-files", "-z"], cwd=ROOT, text=True)
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / name)
    return place


def caught_by(copy: Path, fault: dict[str, Any], tests: list[str]) -> str | None:
    """The first test that fails with a fault; none if all pass."""
    file = copy / fault["file"]
    sound = file.read_text(encoding="utf-8")
    if sound.count(fault["old"]) != 1:
        raise SystemExit(f"{fault['name']}: {fault['file']} has its line not exactly once")
    file.write_text(sound.replace(fault["old"], fault["new"]), encoding="utf-8")
    try:
        how = ("-q", "-x", "-n0", "--tb=no", "-rfE", "-o", f"cache_dir={ROOT / '.pytest_cache'}")
        environment = {**os.environ, "PYTHONPATH": str(copy), "COLUMNS": "1000"}
        done = python("-m", "pytest", *how, *tests, cwd=copy, env=environment)
    finally:
        file.write_text(sound, encoding="utf-8")
    if done.returncode == 0:
        return None
    found = FAILED.search(done.stdout)
    if done.returncode != 1 or found is None:
        raise SystemExit(f"{fault['name']}: pytest gives {done.returncode}\n{done.stdout}")
    return found[1]


def recorded(text: str, name: str, test: str) -> str:
    """The file of faults with a test written down as that which catches one of them."""
    head, *entries = text.split("[[fault]]\n")
    for i, entry in enumerate(entries):
        if tomllib.loads(entry)["name"] == name:
            kept = re.sub(r"^caught_by.*", "", entry, flags=re.MULTILINE).rstrip("\n")
            quoted = f"'{test}'" if '"' in test else f'"{test}"'
            entries[i] = f"{kept}\ncaught_by = {quoted}\n\n"
    return "[[fault]]\n".join([head, *entries]).rstrip("\n") + "\n"


if __name__ == "__main__":
    sys.exit(main())
