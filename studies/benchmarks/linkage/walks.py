"""Pose after pose in Python: SciPy's fsolve, `mechanism` and pylinkage on the same sweeps.

A `Walk` is handed a case, its sizes, crank angles in equal steps and a tolerance, and is then ready
to solve them. The extra ``peers`` brings `mechanism` and pylinkage.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.optimize

from studies.benchmarks.linkage import cases
from studies.oracles.linkages import Case, Sizes

Walker = tuple[Callable[[], Any], Callable[[Any], np.ndarray]]
"""What solves a sweep; and its answer as an array of shape (poses, joints, 2), mm."""

Walk = Callable[[Case, Sizes, np.ndarray, float], Walker]


def fsolve_walk(case: Case, sizes: Sizes, angles: np.ndarray, tolerance: float) -> Walker:
    """SciPy's fsolve for each pose, from the solution of the pose before: without a toolkit."""
    home = cases.start_of(case, sizes)

    def residual(unknowns: np.ndarray, angle: float) -> list[float]:
        return cases.gaps(math, case, sizes, angle, unknowns.tolist())[1]

    def call() -> list[list[tuple[float, float]]]:
        unknowns: Any = np.array(home)
        found = []
        with warnings.catch_warnings():
            # Asked for no more than rounding leaves, it warns and is as close as it gets.
            warnings.simplefilter("ignore", RuntimeWarning)
            for angle in angles.tolist():
                unknowns = scipy.optimize.fsolve(residual, unknowns, args=angle, xtol=tolerance)
                joints, _ = cases.gaps(math, case, sizes, angle, unknowns.tolist())
                found.append([joints[name] for name in case.joints])
        return found

    return call, np.array


def gradient_by_differences(
    walk: Walk, case: Case, angles: np.ndarray, tolerance: float
) -> np.ndarray:
    """Derivative of the last joint's mean square by central differences, for each of the sizes.

    The step, the cube root of rounding times the number's size, balances truncation and rounding.
    """
    rounding = np.finfo(float).eps ** (1 / 3)

    def mean_square(sizes: Sizes) -> float:
        call, read = walk(case, sizes, angles, tolerance)
        last = read(call())[:, -1]
        return float(np.mean(np.sum(last * last, axis=-1)))

    def step(number: float) -> float:
        return rounding * max(1.0, abs(number))

    return cases.central_differences(mean_square, cases.numbers_of(case), step)


def mechanism_walk(case: Case, sizes: Sizes, angles: np.ndarray, _: float) -> Walker:
    """`mechanism`: the user writes the vector loops, the tool calls fsolve for each pose."""
    from mechanism import Joint, Mechanism, Vector  # pyright: ignore[reportMissingImports]

    joints = {name: Joint(name) for name in (*sizes.pins, *case.joints, "P")}
    vectors, loops, turned = [], [], cases.crank_base(math, case, sizes)

    def link(start: str, end: str, **given: float) -> Any:
        vectors.append(Vector(joints=(joints[start], joints[end]), **given))
        return vectors[-1]

    def fixed(end: str, x: float, y: float) -> Any:
        x, y = x - sizes.pins["O2"][0], y - sizes.pins["O2"][1]
        return link("O2", end, r=math.hypot(x, y), theta=math.atan2(y, x))

    crank = link("O2", "A", r=sizes.lengths["crank"])
    for dyad in case.dyads:
        rod, side, turn = link(dyad.start, dyad.joint, r=sizes.lengths[dyad.link]), None, 0.0
        if dyad.arm:
            base = fixed(dyad.end, *sizes.pins[dyad.end])
            arm = link(dyad.end, dyad.joint, r=sizes.lengths[dyad.arm])
        else:  # a point of the line is a joint as well
            base = fixed("P", *sizes.line[:2])
            arm = link("P", dyad.joint, theta=sizes.line[2])
        if dyad.carries:
            along, across = sizes.carried[dyad.arm]
            side = link(dyad.end, dyad.carries, r=math.hypot(along, across))
            turn = math.atan2(across, along)
        loops.append((rod, base, arm, side, turn))

    def equations(unknowns: np.ndarray, angle: float) -> np.ndarray:
        # The way from the origin to the joint that the next dyad starts from.
        way, gaps = crank(angle + turned), []
        pairs = unknowns.reshape(-1, 2)
        for (rod, base, arm, side, turn), (first, second) in zip(loops, pairs, strict=True):
            gaps.append(way + rod(first) - base() - arm(second))
            if side is not None:
                way = base() + side(second + turn)
        return np.concatenate(gaps)

    guess = (np.array(cases.start_of(case, sizes)),)
    solver = Mechanism(
        vectors=vectors, origin=joints["O2"], loops=equations, pos=angles, guess=guess
    )

    def read(_: Any) -> np.ndarray:
        moving = [joints[name] for name in case.joints]
        found = np.array([(joint.x_positions, joint.y_positions) for joint in moving])
        return found.transpose(2, 0, 1) + np.array(sizes.pins["O2"])

    return solver.iterate, read


def pylinkage_walk(fast: bool, case: Case, sizes: Sizes, angles: np.ndarray, _: float) -> Walker:
    """pylinkage: components in Python, a generator; or ``step_fast``, a loop numba compiled.

    It advances its crank by a constant step before each pose, and takes of two assemblies that
    which is nearer to the pose before.
    """
    from pylinkage.actuators import Crank  # pyright: ignore[reportMissingImports]
    from pylinkage.components import Ground  # pyright: ignore[reportMissingImports]
    from pylinkage.dyads import FixedDyad, RRPDyad, RRRDyad  # pyright: ignore[reportMissingImports]
    from pylinkage.simulation import Linkage as Simulated  # pyright: ignore[reportMissingImports]

    step = float(angles[1] - angles[0]) if len(angles) > 1 else 0.0
    start = float(angles[0]) + cases.crank_base(math, case, sizes) - step
    parts: dict[str, Any] = {name: Ground(x, y, name=name) for name, (x, y) in sizes.pins.items()}
    parts["A"] = Crank(
        parts["O2"], sizes.lengths["crank"], angular_velocity=step, initial_angle=start
    )
    outputs = dict(parts, A=parts["A"].output)
    for dyad in case.dyads:
        length = sizes.lengths[dyad.link]
        if dyad.arm:
            reach = sizes.lengths[dyad.arm]
            new = RRRDyad(outputs[dyad.start], outputs[dyad.end], length, reach)
        else:
            x, y, angle = sizes.line
            parts["P"] = Ground(x, y, name="P")
            parts["Q"] = Ground(x + math.cos(angle), y + math.sin(angle), name="Q")
            new = RRPDyad(outputs[dyad.start], parts["P"], parts["Q"], length)
        parts[dyad.joint] = outputs[dyad.joint] = new
        if dyad.carries:
            along, across = sizes.carried[dyad.arm]
            polar = math.hypot(along, across), math.atan2(across, along)
            parts[dyad.carries] = outputs[dyad.carries] = FixedDyad(outputs[dyad.end], new, *polar)
    placed, names = {dyad.joint for dyad in case.dyads}, list(parts)
    sketch, columns = cases.sketch_of(case), [names.index(name) for name in case.joints]
    home = [sketch[name] if name in placed else part.position for name, part in parts.items()]
    solver = Simulated(list(parts.values()))
    if fast:
        solver.compile()

    def call() -> Any:
        solver.set_coords(home)
        return solver.step_fast(len(angles)) if fast else list(solver.step(len(angles)))

    return call, lambda found: np.array(found)[:, columns]
