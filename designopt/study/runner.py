"""Runs a study and keeps its results: all of them, or none."""

from __future__ import annotations

import math
import os
import platform
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from designopt.errors import UserError
from designopt.interrupts import interruptible
from designopt.io.csv_text import csv_text
from designopt.io.spec import Spec
from designopt.io.spec_files import FORMAT
from designopt.plot import figures
from designopt.progress import step_display
from designopt.study.page import RunRecord, measurements, render_report, tables_and_figures
from designopt.study.result_folders import cannot_write, result_folder, write_document
from designopt.study.results import Metric, PrecisionRow, Results
from designopt.study.settings import spec_of_tables
from designopt.study.study import Context, Study, load_study

DTYPES = ("float64", "float32")
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


def run_study(
    name: str | Study,
    spec: Spec | Mapping[str, Any] | None = None,
    *,
    out: str | Path | None = None,
    seed: int = 0,
    dtype: str = "float64",
    force: bool = False,
) -> Results:
    """Run a study, as ``designopt run`` does.

    Args:
        name: of an installed study, or a `Study`, such as one that is being written.
        spec: its settings, or those that differ from the defaults, nested as in ``results.json``.
        out: folder to make for the results; by default nothing is written.
        seed: seed of every random draw.
        dtype: ``"float64"`` or ``"float32"``.
        force: whether an earlier result at ``out`` may be replaced.

    Returns:
        What it found; a notebook shows findings, metrics, figures and tables.

    Raises:
        UserError: there is no such study, its settings are at fault, or the folder exists or cannot
            be written.

    Example:
        >>> quick = {"precision": False, "stability": False}
        >>> results = run_study("table1", quick)
        >>> {metric.name: metric.value for metric in results.metrics}["cells_matched_identified"]
        18
    """
    study = load_study(name) if isinstance(name, str) else name
    settings = spec if isinstance(spec, Spec) else spec_of_tables(study.spec, spec or {})
    if dtype not in DTYPES:
        raise UserError(f"dtype {dtype!r}: choose {' or '.join(DTYPES)}")
    if out is not None:
        return run(study, settings, seed=seed, dtype=dtype, out=Path(out), force=force)
    return _found(study, settings, seed, dtype)


def _found(study: Study, spec: Spec, seed: int, dtype: str) -> Results:
    with figures.style(), step_display() as step, jax.enable_x64(dtype == "float64"):
        return study.run(spec, Context(seed, dtype, step, step.count))


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
        results = _found(study, spec, seed, dtype)
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
    tables, drawn = tables_and_figures(results, measured)
    for name, parts in (("tables", tables), ("figures", drawn), ("specs", results.specs)):
        twice = [one for one, of in Counter(part.name for part in parts).items() if of > 1]
        if twice:
            raise ValueError(f"two {name} of one name would overwrite each other: {twice[0]}")
    for name in ("tables", "figures"):
        (folder / name).mkdir()
    for table in tables:
        text = csv_text([table.columns, *table.rows])
        (folder / "tables" / f"{table.name}.csv").write_text(text, encoding="utf-8", newline="")
    for figure in drawn:
        figures.save(figure.drawing, folder / "figures", figure.name)
    if results.specs:
        (folder / "specs").mkdir()
    for spec in results.specs:
        (folder / "specs" / spec.name).write_bytes(spec.data)
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
        "precision": [_without_samples(row) for row in precision.rows] if precision else [],
        "stability": [asdict(row) for row in results.stability],
        "left_out": [asdict(row) for row in results.left_out],
    }
    page = render_report(record, results, measured, folder)
    (folder / "report.html").write_text(page, encoding="utf-8")
    write_document(folder, _strict(document))


def _metric(metric: Metric) -> dict[str, Any]:
    return {
        "value": metric.value,
        "unit": metric.unit,
        "reference": metric.reference,
        "target": None if metric.target is None else str(metric.target),
        "met": metric.met,
        "description": metric.description,
    }


def _without_samples(row: PrecisionRow) -> dict[str, Any]:
    return {name: value for name, value in asdict(row).items() if name != "samples"}


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
