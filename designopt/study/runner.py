"""Runs a study and keeps its results: all of them, or none."""

from __future__ import annotations

import math
import os
import platform
import time
from collections import Counter
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from designopt.interrupts import interruptible
from designopt.io.csv_text import csv_text
from designopt.io.spec import Spec
from designopt.io.spec_files import FORMAT
from designopt.plot import figures
from designopt.progress import step_display
from designopt.study.report import RunRecord, measurements, render_report
from designopt.study.result_folders import cannot_write, result_folder, write_document
from designopt.study.results import Metric, Results, Table
from designopt.study.study import Context, Study

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
            raise cannot_write(out, error) from error
        check()
    return results


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
    document = {
        "format": FORMAT,
        **record._asdict(),
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
    page = render_report(record, results, measured, folder)
    (folder / "report.html").write_text(page, encoding="utf-8")
    write_document(folder, _strict(document))


def _write_table(table: Table, path: Path) -> None:
    path.write_text(csv_text([table.columns, *table.rows]), encoding="utf-8", newline="")


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
