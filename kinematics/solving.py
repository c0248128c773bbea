"""What ``designopt solve`` does: read, sweep, solve, write the table, say what was met."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.files import check_figure_ending, check_targets, replaced_when_complete
from designopt.ranges import grid_of, single_values
from designopt.solution import Solution
from kinematics.limits import find_limits
from kinematics.linkage import Linkage
from kinematics.plan import describe
from kinematics.poses import solve_poses
from kinematics.rates import Rates, solve_rates
from kinematics.reading import read_linkage
from kinematics.solver import Pose
from kinematics.steps import PlanError
from kinematics.table import columns_of, write_table
from kinematics.transmission import Transmission, solve_transmission


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
    """Everything that was computed.

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


def print_plan(file: Path, of: Sequence[str] | None) -> None:
    """Print how a linkage is solved, in words.

    Raises:
        UserError: the file is faulty, or has no joint or body of a name in ``of``.
    """
    with jax.enable_x64(True):
        linkage = read_linkage(file)
    structure = linkage.structure
    try:
        lines = describe(structure, None if of is None else frozenset(of))
    except PlanError as error:
        raise UserError(f"--of: {error}") from error
    inputs = ", ".join(linkage.input_names)
    print(f"{structure.name}: {len(structure.moving)} moving bodies, driven by {inputs}")
    print("\n".join(lines))


def solve_file(request: Request) -> list[str]:
    """Solve, write what was asked for, and return what a person should know.

    Raises:
        UserError: something in the file or in the request is wrong; nothing is written.
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
        solved = _solve(linkage, request)
        # The table last: what fails in drawing leaves none behind.
        drawable = bool(np.any(np.asarray(solved.poses.ok)))
        if request.figure is not None and drawable:
            _draw(linkage, solved, request.figure)
        if request.animation is not None and drawable:
            # Imported here, as drawing is: Matplotlib takes a second.
            from kinematics.animation import save_animation

            save_animation(request.animation, linkage, solved.inputs, solved.poses)
        write_table(columns_of(linkage, solved), request.csv)
        return _remarks(linkage, solved, request.of)


def _solve(linkage: Linkage, request: Request) -> Solved:
    angles = {name: _is_angle(linkage, name) for name in linkage.input_names}
    asked = grid_of(request.sweeps, "--sweep", angles, "input")
    inputs = np.where(list(angles.values()), np.deg2rad(asked), asked)
    rates = _values(linkage, request.rates, "--rate")
    accelerations = _values(linkage, request.accelerations, "--accel")
    if rates is None and accelerations is not None:
        rates = jnp.zeros_like(accelerations)
    try:
        found = _compute(linkage, jnp.asarray(inputs), rates, accelerations, of=request.of)
    except PlanError as error:
        raise UserError(f"--of: {error}") from error
    return Solved(asked, inputs, *found)


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


def _draw(linkage: Linkage, solved: Solved, path: Path) -> None:
    from designopt.figures import style
    from kinematics.motion_figures import motion_figure

    with style():
        figure = motion_figure(linkage, solved.inputs, solved.poses)
        with replaced_when_complete(path) as partial:
            figure.savefig(partial)


def _remarks(linkage: Linkage, solved: Solved, of: tuple[str, ...] | None) -> list[str]:
    """How many poses failed and why, and the limits of the inputs that ran into them."""
    failed = np.asarray(~solved.poses.ok)
    if not failed.any():
        return []
    reasons = Counter(message for message in solved.poses.messages() if message)
    lines = [
        f"{int(failed.sum())} of {failed.size} poses cannot be assembled; their rows have ok = 0 "
        "and empty cells"
    ]
    lines += [f"  {count} poses: {message}" for message, count in reasons.most_common()]
    for index, name in enumerate(linkage.input_names):
        if np.ptp(solved.inputs[:, index]) > 0 or len(solved.inputs) == 1:
            lines += _limit_remarks(linkage, name, solved, of)
    return lines


def _limit_remarks(
    linkage: Linkage, name: str, solved: Solved, of: tuple[str, ...] | None
) -> list[str]:
    # From a pose that exists, so that the other inputs are as they were asked for.
    good = np.flatnonzero(np.asarray(solved.poses.ok))
    start = solved.inputs[good[0]] if len(good) else np.array(linkage.home.inputs)
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
