"""What ``designopt solve`` does: read, sweep, solve, write the table, report what was met."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.csv_text import csv_text, numbers_text
from designopt.io.files import check_figure_ending, check_targets, replaced_when_complete
from designopt.io.ranges import grid_of, single_values
from designopt.solution import Solution
from kinematics.io.reading import read_linkage
from kinematics.model.linkage import Linkage
from kinematics.solve.limits import find_limits
from kinematics.solve.plan import describe_plan
from kinematics.solve.poses import solve_poses
from kinematics.solve.rates import Rates, solve_rates
from kinematics.solve.solver import Pose
from kinematics.solve.steps import PlanError
from kinematics.solve.transmission import Transmission, solve_transmission

CHUNK = 16_384
"""Poses that are solved and written at a time, so that memory does not grow with a sweep."""

MOST_DRAWN = 10_000
"""Poses in a drawing; of more, so many are shown, evenly spread."""


@dataclass(frozen=True)
class Request:
    """What was asked for, as it was written on the command line.

    Attributes:
        file: the linkage file.
        sweeps: ``input=start:stop:count`` or ``input=value``, degrees or mm.
        rates: ``input=value``, rad/s or mm/s.
        accelerations: ``input=value``, rad/s² or mm/s².
        of: joints and bodies asked for; all if none.
        csv: where the table goes, ``-`` for standard output.
        figure: where a picture of the motion goes.
        animation: where an animation of the motion goes.
        force: whether existing files are replaced.
    """

    file: Path
    sweeps: tuple[str, ...]
    rates: tuple[str, ...] = ()
    accelerations: tuple[str, ...] = ()
    of: tuple[str, ...] | None = None
    csv: str = "-"
    figure: Path | None = None
    animation: Path | None = None
    force: bool = False


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


def print_plan(file: Path, of: Sequence[str] | None) -> None:
    """Print how a linkage is solved, in words.

    Raises:
        UserError: the file is faulty, or has no joint or body of a name in ``of``.
    """
    with jax.enable_x64(True):
        linkage = read_linkage(file)
    structure = linkage.structure
    try:
        lines = describe_plan(structure, None if of is None else frozenset(of))
    except PlanError as error:
        raise UserError(f"--of: {error}") from error
    inputs = ", ".join(linkage.input_names)
    print(f"{structure.name}: {len(structure.moving)} moving bodies, driven by {inputs}")
    print("\n".join(lines))


def solve_file(request: Request) -> tuple[list[str], bool]:
    """Solve and write what was asked for.

    Returns:
        Remarks for the person who asked, and whether any pose can be assembled.

    Raises:
        UserError: something in the file or in the request is wrong; nothing is written, but for
            rows on standard output.
    """
    named = {
        "--csv": None if request.csv == "-" else request.csv,
        "--figure": request.figure,
        "--animation": request.animation,
    }
    check_targets(named, force=request.force)
    if request.figure is not None:
        check_figure_ending("--figure", request.figure)
    with jax.enable_x64(True):
        linkage = read_linkage(request.file)
        angles = {name: _is_angle(linkage, name) for name in linkage.input_names}
        asked = grid_of(request.sweeps, "--sweep", angles, "input")
        shown = _shown_poses(request, len(asked))
        tally = Tally()
        # The table last: what fails in drawing leaves none behind.
        with table_at(request.csv) as write:
            for solved in _solve(linkage, request, asked):
                write(table_text(columns_of(linkage, solved), head=tally.count == 0))
                tally.add(solved, shown)
            drawn = _draw(linkage, request, tally) if tally.poses else []
        remarks = [*_remarks(linkage, request, asked, tally), *drawn]
        return remarks, tally.first is not None


class Tally:
    """What of all the poses outlives the rows of the table.

    Attributes:
        count: poses so far.
        failures: how many of them failed, by the reason.
        first: inputs of the first one that is ok, rad or mm.
        inputs: of the poses to draw, rad or mm.
        poses: these poses.
    """

    def __init__(self) -> None:
        self.count = 0
        self.failures: Counter[str] = Counter()
        self.first: np.ndarray | None = None
        self.inputs: list[np.ndarray] = []
        self.poses: list[Solution[Pose]] = []

    def add(self, solved: Solved, shown: np.ndarray) -> None:
        """Take in the next poses; ``shown`` are the numbers of those to draw, of all."""
        ok = np.flatnonzero(np.asarray(solved.poses.ok))
        if self.first is None and ok.size:
            self.first = solved.inputs[ok[0]]
        self.failures += solved.poses.failures()
        here = shown[np.searchsorted(shown, self.count) :] - self.count
        here = here[: np.searchsorted(here, len(solved.inputs))]
        if here.size:
            self.inputs.append(solved.inputs[here])
            self.poses.append(jax.tree.map(lambda leaf: np.asarray(leaf)[here], solved.poses))
        self.count += len(solved.inputs)


def _shown_poses(request: Request, count: int) -> np.ndarray:
    """Numbers of the poses that are drawn: none, all of them, or `MOST_DRAWN`."""
    if request.animation is not None:
        # Imported here, as drawing is: Matplotlib takes a second.
        from kinematics.plot.animation import check_animation

        check_animation(request.animation)
    if request.figure is None and request.animation is None:
        return np.zeros(0, int)
    return np.linspace(0, count - 1, min(count, MOST_DRAWN)).astype(int)


def _solve(linkage: Linkage, request: Request, asked: np.ndarray) -> Iterator[Solved]:
    """Solve a grid, `CHUNK` poses at a time."""
    angles = [_is_angle(linkage, name) for name in linkage.input_names]
    rates = _values(linkage, request.rates, "--rate")
    accelerations = _values(linkage, request.accelerations, "--accel")
    if rates is None and accelerations is not None:
        rates = jnp.zeros_like(accelerations)
    for start in range(0, len(asked), CHUNK):
        part = asked[start : start + CHUNK]
        inputs = np.where(angles, np.deg2rad(part), part)
        # All chunks have one size, and with it one program.
        size = len(part)
        missing = min(len(asked), CHUNK) - size
        filled = np.concatenate([inputs, np.repeat(inputs[-1:], missing, axis=0)])
        try:
            found = _compute(linkage, jnp.asarray(filled), rates, accelerations, of=request.of)
        except PlanError as error:
            raise UserError(f"--of: {error}") from error
        if missing:
            found = jax.tree.map(lambda leaf, size=size: leaf[:size], found)
        yield Solved(part, inputs, *found)


@partial(jax.jit, static_argnames="of")
def _compute(
    linkage: Linkage,
    inputs: Float[Array, "poses inputs"],
    rates: Float[Array, " inputs"] | None,
    accelerations: Float[Array, " inputs"] | None,
    *,
    of: tuple[str, ...] | None,
) -> tuple[Solution[Pose], Rates | None, Rates | None, Transmission]:
    velocity = acceleration = None
    if rates is not None:
        motion = solve_rates(linkage, inputs, rates, accelerations, of=of)
        velocity = motion.velocity
        acceleration = None if accelerations is None else motion.acceleration
    poses = solve_poses(linkage, inputs, of=of)
    return poses, velocity, acceleration, solve_transmission(linkage, inputs, of=of)


def _is_angle(linkage: Linkage, name: str) -> bool:
    return linkage.structure.inputs[linkage.input_names.index(name)].slider is None


def _values(linkage: Linkage, texts: Sequence[str], option: str) -> Float[Array, " inputs"] | None:
    if not texts:
        return None
    values = single_values(texts, option, linkage.input_names, "input")
    return jnp.array([values.get(name, 0.0) for name in linkage.input_names])


def _draw(linkage: Linkage, request: Request, tally: Tally) -> list[str]:
    """Draw what was asked for; returns remarks on it."""
    # Imported here: Matplotlib takes a second.
    from designopt.plot.figures import style
    from kinematics.plot.animation import save_animation
    from kinematics.plot.motion_figures import motion_figure

    inputs = np.concatenate(tally.inputs)
    poses = jax.tree.map(lambda *leaves: np.concatenate(leaves), *tally.poses)
    if not np.any(np.asarray(poses.ok)):
        return ["nothing is drawn: no pose to show can be assembled"]
    if request.figure is not None:
        with style():
            figure = motion_figure(linkage, inputs, poses)
            with replaced_when_complete(request.figure) as partial:
                figure.savefig(partial)
    if request.animation is not None:
        save_animation(request.animation, linkage, inputs, poses)
    if len(inputs) == tally.count:
        return []
    return [f"drawn: {len(inputs):,} of {tally.count:,} poses, evenly spread"]


def _remarks(linkage: Linkage, request: Request, asked: np.ndarray, tally: Tally) -> list[str]:
    """How many poses failed and why, and the limits of the inputs that ran into them."""
    failed = tally.failures.total()
    if not failed:
        return []
    some = f"{failed} of {tally.count} poses cannot be assembled"
    first = "no pose can be assembled" if tally.first is None else some
    lines = [f"{first}; their rows have ok = 0 and empty cells"]
    lines += [f"  {count} poses: {message}" for message, count in tally.failures.most_common()]
    # From a pose that exists, so that the other inputs are as they were asked for.
    start = np.array(linkage.reference.inputs) if tally.first is None else tally.first
    for index, name in enumerate(linkage.input_names):
        if np.ptp(asked[:, index]) > 0 or len(asked) == 1:
            lines += _limit_remarks(linkage, name, start, request.of)
    return lines


def _limit_remarks(
    linkage: Linkage, name: str, start: np.ndarray, of: tuple[str, ...] | None
) -> list[str]:
    try:
        limits = find_limits(linkage, name, jnp.asarray(start), of=of)
    except ValueError:  # no pose to start from
        return [f"{name}: no pose to look for its limits from"]
    angle = _is_angle(linkage, name)
    held = "".join(
        f", at {other} = {_shown(value, _is_angle(linkage, other))}"
        for other, value in zip(linkage.input_names, start, strict=True)
        if other != name
    )
    lines = [
        f"{name} locks at {_shown(limit.value, angle)} ({end} limit{held}): "
        f"{' and '.join(limit.bodies)} cannot follow beyond"
        if limit.locks
        else f"{name}: what is beyond {_shown(limit.value, angle)} is not known ({end} end{held}): "
        f"{' and '.join(limit.bodies)} could not be followed"
        for end, limit in (("lower", limits.lower), ("upper", limits.upper))
        if limit is not None
    ]
    lines += [f"{name} has a change point at {_shown(p, angle)}" for p in limits.change_points]
    return lines


def _shown(value: float, angle: bool) -> str:
    return f"{math.degrees(value):.10g}°" if angle else f"{value:.10g} mm"
