"""Other people's tools on the same sweeps: `mechanism` and pylinkage, where they are installed."""

from __future__ import annotations

import importlib.util
import math
from typing import Any

import numpy as np

from kinematics import Linkage
from studies.benchmarks.linkage.cases import Case, crank_base, sketch_of, start_of
from studies.benchmarks.linkage.sequential import Walker, numbers_of


def installed(package: str) -> bool:
    """Whether a package can be imported; the extra ``peers`` brings both."""
    return importlib.util.find_spec(package) is not None


def mechanism_walk(case: Case, linkage: Linkage, angles: np.ndarray) -> Walker:
    """`mechanism`: the user writes the vector loops, the tool calls fsolve for each pose."""
    from mechanism import Joint, Mechanism, Vector  # pyright: ignore[reportMissingImports]

    sizes = numbers_of(linkage)
    joints = {name: Joint(name) for name in (*sizes.pins, *case.joints)}
    crank = Vector(joints=(joints["O2"], joints["A"]), r=sizes.lengths["crank"])
    vectors, loops = [crank], []
    path = [
        (crank, "input", crank_base(math, case, sizes))
    ]  # from the origin to the joint that the next dyad starts from
    for number, dyad in enumerate(case.dyads):
        ends = joints[dyad.start], joints[dyad.joint]
        link = Vector(joints=ends, r=sizes.lengths[dyad.link])
        if dyad.end is None or dyad.arm is None:
            # Through the foot of the line's perpendicular, which is a joint as well.
            x, y, angle = sizes.lines[0]
            joints["P"] = Joint("P")
            base = _between(joints["O2"], joints["P"], sizes.pins["O2"], (x, y))
            arm = Vector(joints=(joints["P"], ends[1]), theta=angle)
        else:
            pins = sizes.pins["O2"], sizes.pins[dyad.end]
            base = _between(joints["O2"], joints[dyad.end], *pins)
            arm = Vector(joints=(joints[dyad.end], ends[1]), r=sizes.lengths[dyad.arm])
        vectors += [link, base, arm]
        loops.append((tuple(path), link, base, arm, number))
        if dyad.carries is not None and dyad.arm is not None:
            along, across = sizes.carried[dyad.arm]
            side = Vector(
                joints=(joints[str(dyad.end)], joints[dyad.carries]), r=math.hypot(along, across)
            )
            vectors.append(side)
            path = [(base, "constant", 0.0), (side, number, math.atan2(across, along))]

    def equations(unknowns: np.ndarray, angle: float) -> np.ndarray:
        left = np.zeros((len(loops), 2))
        for row, (way, link, base, arm, number) in enumerate(loops):
            for vector, kind, turn in way:
                if kind == "input":
                    left[row] += vector(angle + turn)
                elif kind == "constant":
                    left[row] += vector()
                else:
                    left[row] += vector(unknowns[2 * kind + 1] + turn)
            left[row] += link(unknowns[2 * number]) - base() - arm(unknowns[2 * number + 1])
        return left.flatten()

    home = np.array(start_of(case, sizes))
    solver = Mechanism(
        vectors=vectors, origin=joints["O2"], loops=equations, pos=angles, guess=(home,)
    )

    def read(_: Any) -> np.ndarray:
        moving = [joints[name] for name in case.joints]
        places = np.array([(joint.x_positions, joint.y_positions) for joint in moving])
        return places.transpose(2, 0, 1) + np.array(sizes.pins["O2"])

    return Walker(solver.iterate, read)


def _between(tail: Any, head: Any, start: tuple, end: tuple) -> Any:
    """A vector of constant length and angle between two joints of `mechanism`."""
    from mechanism import Vector  # pyright: ignore[reportMissingImports]

    x, y = end[0] - start[0], end[1] - start[1]
    return Vector(joints=(tail, head), r=math.hypot(x, y), theta=math.atan2(y, x))


def pylinkage_walk(case: Case, linkage: Linkage, angles: np.ndarray) -> Walker:
    """The ordinary path of pylinkage: components in Python, a generator, pose after pose."""
    solver, start, columns = _pylinkage(case, linkage, angles)

    def call() -> list:
        solver.set_coords(start)
        return list(solver.step(len(angles)))

    return Walker(call, lambda found: np.array(found)[:, columns])


def pylinkage_fast_walk(case: Case, linkage: Linkage, angles: np.ndarray) -> Walker:
    """The fastest path of pylinkage, ``step_fast``: the sweep in a loop that numba compiled."""
    solver, start, columns = _pylinkage(case, linkage, angles)
    solver.compile()

    def call() -> np.ndarray:
        solver.set_coords(start)
        return solver.step_fast(len(angles))

    return Walker(call, lambda found: found[:, columns])


def _pylinkage(
    case: Case, linkage: Linkage, angles: np.ndarray
) -> tuple[Any, list[tuple[float, float]], list[int]]:
    """The linkage as pylinkage has it, where it starts, and the columns of the moving joints.

    It advances its crank by a constant step before each pose, and takes of two assemblies that
    which is nearer to the pose before.
    """
    from pylinkage.actuators import Crank  # pyright: ignore[reportMissingImports]
    from pylinkage.components import Ground  # pyright: ignore[reportMissingImports]
    from pylinkage.dyads import FixedDyad, RRPDyad, RRRDyad  # pyright: ignore[reportMissingImports]
    from pylinkage.simulation import Linkage as Simulated  # pyright: ignore[reportMissingImports]

    sizes = numbers_of(linkage)
    step = float(angles[1] - angles[0]) if len(angles) > 1 else 0.0
    parts: dict[str, Any] = {name: Ground(x, y, name=name) for name, (x, y) in sizes.pins.items()}
    parts["A"] = Crank(
        parts["O2"],
        sizes.lengths["crank"],
        angular_velocity=step,
        initial_angle=float(angles[0]) + crank_base(math, case, sizes) - step,
    )
    outputs = dict(parts, A=parts["A"].output)
    for dyad in case.dyads:
        length = sizes.lengths[dyad.link]
        if dyad.end is None or dyad.arm is None:
            x, y, angle = sizes.lines[0]
            parts["P"] = Ground(x, y, name="P")
            parts["Q"] = Ground(x + math.cos(angle), y + math.sin(angle), name="Q")
            new = RRPDyad(outputs[dyad.start], parts["P"], parts["Q"], length)
        else:
            reach = sizes.lengths[dyad.arm]
            new = RRRDyad(outputs[dyad.start], outputs[dyad.end], length, reach)
        parts[dyad.joint] = outputs[dyad.joint] = new
        if dyad.carries is not None and dyad.arm is not None:
            along, across = sizes.carried[dyad.arm]
            rigid = FixedDyad(
                outputs[str(dyad.end)], new, math.hypot(along, across), math.atan2(across, along)
            )
            parts[dyad.carries] = outputs[dyad.carries] = rigid
    solver = Simulated(list(parts.values()))
    placed = {dyad.joint for dyad in case.dyads}
    start = [
        sketch_of(case)[name] if name in placed else part.position for name, part in parts.items()
    ]
    names = list(parts)
    return solver, start, [names.index(name) for name in case.joints]
