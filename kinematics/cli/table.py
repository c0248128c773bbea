"""The table of ``designopt solve``: its columns, and writing it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from designopt.io.csv_text import csv_text, numbers_text
from designopt.io.files import replaced_when_complete
from designopt.solution import Solution
from kinematics.model.linkage import Linkage
from kinematics.solve.rates import Rates
from kinematics.solve.solver import Pose
from kinematics.solve.transmission import Transmission


@dataclass(frozen=True)
class Solved:
    """Some of the poses, with everything that was computed of them.

    Attributes:
        asked: inputs as asked for, in degrees or mm, shape (poses, inputs).
        inputs: the same in radians or mm.
        poses: the poses.
        velocity: first derivatives; none if neither rates nor accelerations were asked for.
        acceleration: second derivatives; none if accelerations were not asked for.
        transmission: their transmission.
    """

    asked: np.ndarray
    inputs: np.ndarray
    poses: Solution[Pose]
    velocity: Rates | None
    acceleration: Rates | None
    transmission: Transmission


def columns_of(linkage: Linkage, solved: Solved) -> dict[str, np.ndarray]:
    """Columns by name, one entry per pose; NaN stands for an empty cell.

    Inputs in degrees or mm, ``ok``, ``margin`` (mm), ``closure`` (mm), positions (mm), angles
    (degrees), rates (mm/s, rad/s and so on), transmission angles (degrees).
    """
    ok = np.asarray(solved.poses.ok)
    columns = {name: solved.asked[:, i] for i, name in enumerate(linkage.input_names)}
    columns["ok"] = ok.astype(int)
    columns["margin"] = np.asarray(solved.poses.margin)
    columns["closure"] = _where(ok, np.asarray(solved.poses.residual * linkage.size()))
    pose = solved.poses.value
    joints = [name for name in linkage.structure.joints if name in pose.joints]
    bodies = [body.name for body in linkage.structure.bodies if body.name in pose.bodies]
    for name in joints:
        columns[f"{name}.x"] = _where(ok, pose.joints[name].x)
        columns[f"{name}.y"] = _where(ok, pose.joints[name].y)
    for name in bodies:
        columns[f"{name}.angle_deg"] = _where(ok, np.rad2deg(pose.angle(name)))
    for rates, letter, turn in (
        (solved.velocity, "v", "omega"),
        (solved.acceleration, "a", "alpha"),
    ):
        if rates is None:
            continue
        for name in joints:
            columns[f"{name}.{letter}x"] = _where(ok, rates.joints[name].x)
            columns[f"{name}.{letter}y"] = _where(ok, rates.joints[name].y)
        for name in bodies:
            columns[f"{name}.{turn}"] = _where(ok, rates.bodies[name])
    for name, angle in solved.transmission.angles.items():
        columns[f"{name}.mu_deg"] = _where(ok, np.rad2deg(angle))
    return columns


def _where(ok: np.ndarray, values: object) -> np.ndarray:
    return np.where(ok, np.broadcast_to(np.asarray(values), ok.shape), np.nan)


def table_text(columns: dict[str, np.ndarray], *, head: bool) -> str:
    """Rows as CSV, by their columns, below the columns' names if there is to be a head."""
    return (csv_text([columns]) if head else "") + numbers_text(list(columns.values()))


@contextmanager
def table_at(target: str) -> Iterator[Callable[[str], object]]:
    """What writes a table's text, to standard output for ``-``; a file appears when it is complete.

    Raises:
        UserError: the file cannot be written.
    """
    if target == "-":
        yield sys.stdout.write
        return
    with (
        replaced_when_complete(Path(target)) as partial,
        partial.open("w", encoding="utf-8", newline="") as stream,
    ):
        yield stream.write
