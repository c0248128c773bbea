"""Runs a study and keeps its results: all of them, or none."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import platform
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from designopt import figures
from designopt.errors import UserError
from designopt.files import check_new_folder
from designopt.interrupts import interruptible
from designopt.progress import step_display
from designopt.report import RunRecord, measurements, render_report
from designopt.results import Metric, Results, Table
from designopt.study import Context, Spec, Study

RESULT_NAMES = ("figures", "report.html", "results.json", "specs", "tables")
"""What a result folder holds."""

RECORDED_PACKAGES = (
    "designopt",
    "jax",
    "jaxlib",
    "equinox",
    "optimistix",
    "lineax",
    "jaxopt",
    "optax",
    "numpy",
    "scipy",
    "opencv-contrib-python-headless",
    "matplotlib",
)


def run(study: Study, spec: Spec, *, seed: int, dtype: str, out: Path, force: bool) -> Results:
    """Run ``study`` and write its results to the folder ``out``, complete or not at all.

    Args:
        study: which.
        spec: its settings.
        seed: seed of every random draw.
        dtype: ``"float64"`` or ``"float32"``.
        out: folder to make; see `result_folder`.
        force: whether an earlier result may be replaced.

    Raises:
        UserError: the folder exists, or cannot be written.
    """
    with result_folder(out, force=force) as folder, figures.style(), interruptible() as check:
        start = time.perf_counter()
        with step_display() as step, jax.enable_x64(dtype == "float64"):
            results = study.run(spec, Context(seed, dtype, step))
        record = RunRecord(
            study=study.name,
            purpose=study.purpose,
            spec=spec.model_dump(mode="json"),
            seed=seed,
            dtype=dtype,
            device=_device(),
            versions={"python": platform.python_version()}
            | {package: version(package) for package in RECORDED_PACKAGES},
            seconds=time.perf_counter() - start,
        )
        try:
            write_results(record, results, folder)
        except OSError as error:
            raise _cannot_write(out, error) from error
        check()
    return results


@contextmanager
def result_folder(out: Path, *, force: bool) -> Iterator[Path]:
    """A new folder to write into, which becomes ``out`` on leaving and vanishes on an exception.

    Args:
        out: the folder to make; folders above it are made as needed.
        force: replace an earlier result at ``out``, at the very end. Only a folder that holds an
            earlier result and nothing else is ever replaced.

    Raises:
        UserError: ``out`` exists and must not be replaced, or cannot be written.
    """
    made: list[Path] = []
    folder = place = None
    try:
        try:
            place = out.resolve()  # the folder itself, where ``out`` is a link to it
            _refuse_existing(out, place, force=force)
            made = [parent for parent in place.parents if not parent.exists()]
            place.parent.mkdir(parents=True, exist_ok=True)
            folder = Path(tempfile.mkdtemp(prefix=".partial-", dir=place.parent))
        except (OSError, RuntimeError) as error:  # a loop of links is a RuntimeError
            raise _cannot_write(out, error) from error
        yield folder
        try:
            _publish(folder, place, force=force)
        except OSError as error:
            raise _cannot_write(out, error) from error
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        for parent in made:
            with suppress(OSError):  # not empty: the result is in it, or somebody else's file
                parent.rmdir()


def _refuse_existing(out: Path, place: Path, *, force: bool) -> None:
    if not (place.exists() or out.is_symlink()):
        return
    check_new_folder(out, force=force)
    if not _is_result(place):
        raise UserError(
            f"--out {out}: exists and is not an earlier result alone, so --force does not replace "
            "it; name another folder"
        )


def _is_result(place: Path) -> bool:
    try:
        document = json.loads((place / "results.json").read_text(encoding="utf-8"))
        strangers = {path.name for path in place.iterdir()} - set(RESULT_NAMES)
    except (OSError, ValueError):
        return False
    return (
        isinstance(document, dict)
        and {"study", "spec", "metrics"} <= set(document)
        and not strangers
    )


def _publish(folder: Path, place: Path, *, force: bool) -> None:
    folder.chmod(0o755)  # mkdtemp makes it private
    if not place.exists():
        folder.rename(place)
        return
    if not (force and _is_result(place)):
        raise FileExistsError(errno.EEXIST, "made by somebody else meanwhile", str(place))
    replaced = folder.with_name(folder.name + "-replaced")
    place.rename(replaced)
    try:
        folder.rename(place)
    except BaseException:
        replaced.rename(place)
        raise
    shutil.rmtree(replaced, ignore_errors=True)


def _cannot_write(out: Path, error: Exception) -> UserError:
    reason = str(error)
    if isinstance(error, OSError):
        reason = f"{error.strerror}: {error.filename}" if error.filename else str(error.strerror)
    return UserError(f"--out {out}: cannot be written ({reason}); name a folder that can")


def write_results(record: RunRecord, results: Results, folder: Path) -> None:
    """Write ``results.json``, ``tables/``, ``figures/`` and ``report.html`` into ``folder``."""
    measured = measurements(results)
    tables = [*results.tables, *(table for part in measured for table in part.tables)]
    drawn = [*results.figures, *(figure for part in measured for figure in part.figures)]
    for name, parts in (("tables", tables), ("figures", drawn), ("specs", results.specs)):
        twice = [one for one, of in Counter(part.name for part in parts).items() if of > 1]
        if twice:
            raise ValueError(f"two {name} of one name would overwrite each other: {twice[0]}")
    for name in ("tables", "figures"):
        (folder / name).mkdir()
    for table in tables:
        _write_table(table, folder / "tables" / f"{table.name}.csv")
    for figure in drawn:
        figures.save(figure.drawing, folder / "figures", figure.name)
    if results.specs:
        (folder / "specs").mkdir()
    for spec in results.specs:
        content = spec.content.encode() if isinstance(spec.content, str) else spec.content
        (folder / "specs" / spec.name).write_bytes(content)
    precision = results.precision
    document = record._asdict() | {
        "findings": list(results.findings),
        "metrics": {metric.name: _metric(metric) for metric in results.metrics},
        "tables": [f"tables/{table.name}.csv" for table in tables],
        "figures": [
            f"figures/{figure.name}.{ending}" for figure in drawn for ending in ("png", "svg")
        ],
        "specs": [f"specs/{spec.name}" for spec in results.specs],
        "claims": [asdict(claim) for claim in precision.claims] if precision else [],
        "precision": [asdict(row) for row in precision.rows] if precision else [],
        "stability": [asdict(row) for row in results.stability],
        "left_out": [asdict(row) for row in results.left_out],
    }
    text = json.dumps(_strict(document), indent=1, ensure_ascii=False, allow_nan=False)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")
    page = render_report(record, results, measured, folder)
    (folder / "report.html").write_text(page, encoding="utf-8")


def _write_table(table: Table, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table.columns)
        writer.writerows(table.rows)


def _metric(metric: Metric) -> dict[str, Any]:
    return {
        "value": metric.value,
        "unit": metric.unit,
        "reference": metric.reference,
        "target": None if metric.target is None else str(metric.target),
        "met": metric.met,
        "description": metric.description,
    }


def _strict(document: Any) -> Any:
    # JSON has no NaN and no infinity: a number that is not finite becomes null.
    if isinstance(document, dict):
        return {key: _strict(value) for key, value in document.items()}
    if isinstance(document, (list, tuple)):
        return [_strict(value) for value in document]
    return None if isinstance(document, float) and not math.isfinite(document) else document


def _device() -> str:
    device = jax.devices()[0]
    return f"{device.device_kind} ({platform.machine()}, {os.cpu_count()} cores)"
