"""The finger's equilibrium in plain numbers, with pins placed by intersecting circles.

`solve` takes which stops and contacts hold from the state to be judged, solves their equations in
`DIGITS` digits, and checks that this choice was right: no force pulls, and nothing that was left
out overlaps. `minimize` is SciPy's SLSQP on the energy, which needs no such choice. `balance`
gives the forces by the equilibrium of every link (R. L. Norton, *Design of Machinery*, ch. 11),
without energy and without ratios. Places are complex numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mpmath
import numpy as np
import scipy.optimize

DIGITS = 36

LINKS = {"intermediate": "ABG", "distal": "BC", "plate": "CDH"}
LINKS |= {"rod": "DE", "crank": "EF", "bar": "GH"}
"""Moving links and their pins; A and F are on the proximal phalanx as well."""

CARRIER = {"A": "intermediate", "B": "distal", "C": "plate", "D": "rod", "E": "crank", "F": "crank"}
CARRIER |= {"G": "bar", "H": "plate"}
"""The link on which a pin's unknown force acts; on its other link it acts reversed."""


@dataclass(frozen=True)
class Setting:
    """A problem in plain numbers; lengths in mm, angles in rad, stiffnesses in N mm/rad.

    Attributes:
        pins: C, D, E, F, G, H in the straight finger.
        lengths: intermediate and distal phalanx.
        depth: of the pads below the axes.
        starts: how far from PIP and from DIP axis the pads beside it begin.
        rim: how far before the tip the distal pad ends.
        limits: upper stops of PIP and DIP.
        spring, servo: stiffnesses of the spring at the plate and of the motor.
        preload: how far the spring is wound in the straight finger.
        command: the motor's angle.
        circle: centre and radius.
    """

    pins: Mapping[str, complex]
    lengths: tuple[float, float]
    depth: float
    starts: tuple[float, float]
    rim: float
    limits: tuple[float, float]
    spring: float
    servo: float
    preload: float
    command: float
    circle: tuple[complex, float] | None


class Exact(NamedTuple):
    """An equilibrium in many digits.

    Attributes:
        joints: PIP and DIP.
        motor: T_a.
        forces: on the intermediate and on the distal pad, N; 0 where open.
        right: whether the choice of what holds was right.
    """

    joints: tuple[Any, Any]
    motor: Any
    forces: tuple[Any, Any]
    right: bool


def pin_places(setting: Setting, pip: Any, dip: Any, ctx: Any = mpmath.mp) -> dict[str, Any]:
    """Every pin in a posture, mm, in the proximal phalanx's frame.

    Args:
        setting: the finger.
        pip: flexion, rad.
        dip: flexion, rad.
        ctx: arithmetic: `mpmath.mp`, or `mpmath.fp` for double precision.
    """
    was = {name: ctx.mpc(place) for name, place in setting.pins.items()}
    middle, knuckle = setting.lengths[0], ctx.expj(-pip)
    at = {"A": ctx.mpc(0), "B": middle * knuckle, "F": was["F"], "G": was["G"] * knuckle}
    at["C"] = at["B"] + (was["C"] - middle) * knuckle * ctx.expj(-dip)
    at["H"] = _meet(at["G"], at["C"], was["G"], was["C"], was["H"], ctx)
    # D is rigid in the plate C-D-H.
    turn = (at["H"] - at["C"]) / (was["H"] - was["C"])
    at["D"] = at["C"] + turn * (was["D"] - was["C"])
    at["E"] = _meet(at["F"], at["D"], was["F"], was["D"], was["E"], ctx)
    return at


def crank(setting: Setting, pip: Any, dip: Any, ctx: Any = mpmath.mp) -> Any:
    """φ in rad."""
    at, was = pin_places(setting, pip, dip, ctx), setting.pins
    return -ctx.arg((at["E"] - at["F"]) / (ctx.mpc(was["E"]) - was["F"]))


def winding(setting: Setting, dip: Any, ctx: Any = mpmath.mp) -> Any:
    """Δγ in rad."""
    at, was = pin_places(setting, ctx.mpf(0), dip, ctx), setting.pins
    return ctx.arg((at["D"] - at["C"]) / (ctx.mpc(was["D"]) - was["C"]) * ctx.expj(dip))


def energy(setting: Setting, pip: Any, dip: Any, ctx: Any = mpmath.mp) -> Any:
    """What the springs at plate and motor hold, N mm."""
    wound = winding(setting, dip, ctx) + setting.preload
    lag = setting.command - crank(setting, pip, dip, ctx)
    return (setting.spring * wound**2 + setting.servo * lag**2) / 2


def gaps(setting: Setting, pip: Any, dip: Any, ctx: Any = mpmath.mp) -> tuple[Any, Any]:
    """Gaps of the circle to both pads, mm."""
    assert setting.circle is not None
    (middle, tip), (center, radius) = setting.lengths, setting.circle
    first, second = setting.starts
    found = []
    for axis, turn, start, length in (
        (ctx.mpc(0), pip, first, middle - first - second),
        (middle * ctx.expj(-pip), pip + dip, second, tip - setting.rim - second),
    ):
        place = (center - axis) * ctx.expj(turn)
        along, below = place.real - start, -setting.depth - place.imag
        beyond = along - min(max(along, ctx.mpf(0)), ctx.mpf(length))
        found.append((below if beyond == 0 else ctx.hypot(beyond, below)) - radius)
    return found[0], found[1]


def minimize(setting: Setting, guess: np.ndarray) -> np.ndarray:
    """Joints of least energy by SciPy's SLSQP (D. Kraft 1988) in double precision, rad."""
    size = setting.spring + setting.servo
    found = scipy.optimize.minimize(
        lambda joints: energy(setting, *joints.tolist(), ctx=mpmath.fp) / size,
        guess,
        method="SLSQP",
        jac="3-point",
        bounds=[(0.0, limit) for limit in setting.limits],
        constraints={
            "type": "ineq",
            "fun": lambda joints: np.array(gaps(setting, *joints.tolist(), ctx=mpmath.fp)),
        },
        options={"ftol": 1e-15, "maxiter": 200},
    )
    return found.x


@mpmath.workdps(DIGITS)
def solve(
    setting: Setting,
    near: np.ndarray,
    held: tuple[float | None, float | None],
    closed: tuple[bool, bool],
) -> Exact | None:
    """The equilibrium with a given choice of what holds, from a place near it.

    Args:
        setting: the problem.
        near: joints to start from, rad.
        held: the stop each joint rests on, rad, or ``None``.
        closed: which pads touch.

    Returns:
        The equilibrium, or ``None`` where the choice leaves it undetermined (more than two holds)
        or its equations were not solved.
    """
    free = [i for i in range(2) if held[i] is None]
    shut = [i for i in range(2) if closed[i]]
    if len(shut) > len(free):
        return None
    context: Any = mpmath.mp
    # Forces in the servo's unit and moments in both stiffnesses' sum: all near one.
    servo, unit = mpmath.mpf(setting.servo), mpmath.mpf(setting.spring) + setting.servo
    step, tiny = mpmath.mpf(10) ** (-DIGITS // 3), mpmath.mpf(10) ** (-DIGITS // 4)

    def slopes(function: Callable[..., Any], joints: Sequence[Any]) -> list[Any]:
        pip, dip = joints
        ends = ((pip + step, dip), (pip - step, dip)), ((pip, dip + step), (pip, dip - step))
        return [(function(*a) - function(*b)) / (2 * step) for a, b in ends]

    def state(unknown: Sequence[Any]) -> tuple[list[Any], list[Any], list[Any], tuple[Any, Any]]:
        """Joints, forces of both contacts, and what they leave of moments and gaps."""
        rest = iter(unknown)
        joints = [next(rest) if stop is None else mpmath.mpf(stop) for stop in held]
        forces = [servo * next(rest) if touches else mpmath.mpf(0) for touches in closed]
        moments = slopes(lambda *q: energy(setting, *q), joints)
        for i in shut:
            pushed = slopes(lambda *q, i=i: gaps(setting, *q)[i], joints)
            moments = [a - forces[i] * b for a, b in zip(moments, pushed, strict=True)]
        return joints, forces, moments, gaps(setting, *joints)

    def equations(*unknown: Any) -> list[Any]:
        _, _, moments, gap = state(unknown)
        return [*(moments[i] / unit for i in free), *(gap[i] for i in shut)]

    unknown = [mpmath.mpf(float(near[i])) for i in free] + [mpmath.mpf(0)] * len(shut)
    for _ in range(8):
        left = equations(*unknown)
        if max(map(abs, left), default=0) < mpmath.mpf(10) ** (-DIGITS // 2 - 4):
            break
        try:
            slope = context.jacobian(equations, unknown)
            change = mpmath.lu_solve(slope, mpmath.matrix(left))
        except ZeroDivisionError:
            return None
        unknown = [x - d for x, d in zip(unknown, change, strict=True)]
    else:
        return None
    joints, forces, moments, gap = state(unknown)
    right = all(force >= -tiny * servo for force in forces)
    right &= all(closed[i] or gap[i] >= -tiny for i in range(2))
    for angle, limit, stop, moment in zip(joints, setting.limits, held, moments, strict=True):
        if stop is not None:
            right &= (moment >= -tiny * unit) if stop == 0 else (moment <= tiny * unit)
        right &= -tiny <= angle <= limit + tiny
    motor = servo * (setting.command - crank(setting, *joints))
    return Exact((joints[0], joints[1]), motor, (forces[0], forces[1]), bool(right))


class Push(NamedTuple):
    """A contact: on which link it pushes, where, and the unit vector in which."""

    link: str
    place: complex
    direction: complex


class Balance(NamedTuple):
    """What balances the links.

    Attributes:
        forces: of the pushes, N.
        stops: moments of the stops on PIP and DIP, N mm, positive in flexion; 0 where not held.
        residual: what is left of the balance over the largest force times length in it.
    """

    forces: np.ndarray
    stops: np.ndarray
    residual: float


def balance(
    setting: Setting,
    joints: tuple[float, float],
    pushes: Sequence[Push],
    held: tuple[bool, bool],
    motor: float,
    load: tuple[float, float],
) -> Balance:
    """Contact forces and stop moments that hold all six moving links still.

    Args:
        setting: the finger.
        joints: flexion of PIP and DIP, rad.
        pushes: contacts that are closed.
        held: whether PIP and DIP rest on a stop.
        motor: T_a on the crank in the closing direction (clockwise), N mm.
        load: moments on PIP and DIP, N mm, positive in flexion (clockwise).
    """
    at = pin_places(setting, *joints, mpmath.fp)
    spring = setting.spring * (winding(setting, joints[1], mpmath.fp) + setting.preload)
    row = {name: i for i, name in enumerate(LINKS)}
    first = 2 * len(CARRIER)  # column of the first push
    matrix = np.zeros((len(LINKS), 3, first + len(pushes) + 2))
    for j, (pin, carrier) in enumerate(CARRIER.items()):
        acts = np.array([[1.0, 0.0], [0.0, 1.0], [-at[pin].imag, at[pin].real]])
        for link in (link for link, pins in LINKS.items() if pin in pins):
            matrix[row[link], :, 2 * j : 2 * j + 2] = acts if link == carrier else -acts
    for j, (link, place, way) in enumerate(pushes):
        matrix[row[link], :, first + j] = way.real, way.imag, (place.conjugate() * way).imag
    # A moment in flexion is clockwise: on PIP against the ground, on DIP between two phalanges.
    middle, distal = row["intermediate"], row["distal"]
    if held[0]:
        matrix[middle, 2, -2] = -1.0
    if held[1]:
        matrix[distal, 2, -1], matrix[middle, 2, -1] = -1.0, 1.0
    right = np.zeros((len(LINKS), 3))
    right[middle, 2], right[distal, 2] = load[0] - load[1], load[1] - spring
    right[row["crank"], 2], right[row["plate"], 2] = motor, spring
    # Forces in N, moments over 10 mm: rows of like size.
    scale = np.array([1.0, 1.0, 0.1])
    rows, sides = (matrix * scale[:, None]).reshape(right.size, -1), (right * scale).ravel()
    found = np.linalg.lstsq(rows, sides, rcond=1e-13)[0]
    size = max(np.max(np.abs(found[:first])), np.max(np.abs(sides)), 1e-300)
    left = float(np.max(np.abs(rows @ found - sides)) / size)
    return Balance(found[first:-2], found[-2:], left)


def _meet(first: Any, second: Any, a: Any, b: Any, c: Any, ctx: Any) -> Any:
    """The third corner over two others, with the sides and on the side that a, b, c have."""
    one, two, distance = abs(c - a), abs(c - b), abs(second - first)
    along = (one**2 - two**2 + distance**2) / (2 * distance)
    across = ctx.sqrt(one**2 - along**2)
    left = ((b - a).conjugate() * (c - a)).imag > 0
    return first + (second - first) / distance * (along + (1j if left else -1j) * across)
