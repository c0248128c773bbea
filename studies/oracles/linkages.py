"""Linkages written out a second time, for numbers of any precision.

Nothing here passes through the library: pins are intersections of two circles, or of a circle and
a line, and derivatives come from the constraints they satisfy. The same lines run on arrays of
mpmath numbers, in the digits of ``mpmath.workdps``, and on NumPy's extended floats. A plane vector
is an array of shape (2,) or (2, cases).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath
import numpy as np

HARD = 1e-6
"""Margin, in units of the size, below which cases are judged in mpmath numbers."""

FAR = 1e3
"""Coordinates, in units of the size, beyond which they are too: their differences cost digits."""

SUMMED = 400
"""Poses of a sweep up to which its mean is summed; a longer one's is integrated."""

digits: Any = np.frompyfunc(lambda value: mpmath.mpf(float(value)), 1, 1)
"""From floats to mpmath numbers, exactly."""


def extended(values: Any) -> np.ndarray:
    """NumPy's long double: 64 bits of mantissa on x86, for the many cases that are not hard."""
    return np.asarray(values).astype(np.longdouble)


def _for_all_types(name: str) -> Callable[[Any], Any]:
    of_digits = np.frompyfunc(getattr(mpmath, name), 1, 1)
    return lambda x: (of_digits if np.asarray(x).dtype == object else getattr(np, name))(x)


sqrt, cos, sin = map(_for_all_types, ("sqrt", "cos", "sin"))


def direction(angle: Any) -> np.ndarray:
    """The vector of length 1 at an angle from +x."""
    return np.stack([cos(angle), sin(angle)])


def left(vector: np.ndarray) -> np.ndarray:
    """A vector turned by a right angle."""
    return np.stack([-vector[1], vector[0]])


def dot(first: np.ndarray, second: np.ndarray) -> Any:
    """The scalar product."""
    return first[0] * second[0] + first[1] * second[1]


def meet_circles(way: np.ndarray, link: Any, arm: Any, side: Any) -> tuple[np.ndarray, Any]:
    """Where a link and an arm meet; the nearest place to it where they do not reach.

    Args:
        way: from the link's start to the arm's.
        link: its length.
        arm: its length.
        side: +1 if they meet to the left of the way, −1 to the right.

    Returns:
        The link's vector, and the product of the way's length and the height above it.
    """
    distance = sqrt(dot(way, way))
    # Where both start in one place there is no direction, and no case is judged by its value.
    apart = distance + (distance == 0)
    along = (link - arm) * (link + arm) / (2 * apart) + distance / 2
    # Heron's formula for the height of the triangle.
    fourth = (link + arm + distance) * (link + arm - distance)
    fourth = fourth * (distance - link + arm) * (distance + link - arm)
    height = side * sqrt(np.maximum(fourth, 0 * fourth)) / (2 * apart)
    return (along * way + height * left(way)) / apart, distance * height


def meet_line(start: np.ndarray, line: np.ndarray, link: Any, side: Any) -> tuple[np.ndarray, Any]:
    """Where a link ends on a line; the nearest place to it where it does not reach.

    Args:
        start: of the link, from a point of the line.
        line: its direction, of length 1.
        link: its length.
        side: +1 if the link ends ahead of its start along the line, −1 behind it.

    Returns:
        The link's vector, and its part along the line.
    """
    across = dot(left(line), start)
    square = (link - across) * (link + across)
    reach = side * sqrt(np.maximum(square, 0 * square))
    return reach * line - across * left(line), reach


class Exact(NamedTuple):
    """A batch of cases.

    Attributes:
        value: the last pin, shape (cases, 2), mm; the nearest there is where it does not exist.
        gradient: its derivatives, shape (cases, 2, inputs).
        margin: signed distance to lock-up, shape (cases,), mm.
        size: the largest dimension, shape (cases,), mm.
    """

    value: np.ndarray
    gradient: np.ndarray
    margin: np.ndarray
    size: np.ndarray


class Formula(NamedTuple):
    """What is exact of a kind of linkage.

    Attributes:
        inputs: names of a row's entries, the last of them the driven one.
        pin: the last pin, from inputs and sides.
        crank: the fixed joint that the crank turns about.
        link: what leads from the crank to the last pin.
        points: where in a row the x of fixed points are, the first fixed joint first.
        closed_form: whether it works with extended floats; otherwise with mpmath numbers only.
    """

    inputs: tuple[str, ...]
    pin: Callable[[np.ndarray, np.ndarray], Exact]
    crank: str
    link: str
    points: tuple[int, ...]
    closed_form: bool = True

    def gaps(self, inputs: np.ndarray, crank_pin: np.ndarray, last: np.ndarray) -> np.ndarray:
        """How far pins miss the lengths, and the line, that hold them.

        Args:
            inputs: shape (cases, inputs), in extended floats or mpmath numbers.
            crank_pin: the crank's pin, shape (cases, 2), mm.
            last: the last pin, shape (cases, 2), mm.

        Returns:
            The largest gap in units of the largest dimension or coordinate given, shape (cases,).
        """
        of, tip = dict(zip(self.inputs, inputs.T, strict=True)), crank_pin.T

        def fixed(name: str) -> np.ndarray:
            return np.stack([of[f"{name}_x"], of[f"{name}_y"]])

        held = [(tip - fixed(self.crank), "crank"), (last.T - tip, self.link)]
        if "rocker" in of:
            held.append((last.T - fixed("o4"), "rocker"))
        gaps = [sqrt(dot(way, way)) - of[name] for way, name in held]
        if "direction" in of:
            gaps.append(dot(left(direction(of["direction"])), last.T - fixed("point")))
        lengths = [abs(of[name]) for name in self.inputs if name not in ("direction", "angle")]
        largest = np.max(lengths, axis=0)
        return np.max(np.abs(gaps), axis=0) / np.where(largest > 0, largest, 1)


def four_bar(inputs: np.ndarray, sides: np.ndarray) -> Exact:
    """Pin B of a four-bar as the intersection of circles about A and O4.

    Args:
        inputs: shape (cases, 8), in the order of `FOUR_BAR`; mm and radians.
        sides: +1 where B lies to the left of A → O4, −1 to the right, shape (cases,).
    """
    o2, o4, (crank, coupler, rocker, angle) = np.split(inputs.T, (2, 4))
    tip = crank * direction(angle)
    way = o4 - o2 - tip
    u, determinant = meet_circles(way, coupler, rocker, sides)
    v = u - way
    # (B − A)·(dB − dA) = c dc and (B − O4)·(dB − dO4) = b db.
    moved = {"o4_x": v[0], "o4_y": v[1], "rocker": rocker}
    gradient = _gradient(FOUR_BAR, inputs, (u, v), determinant, moved)
    distance, ground = sqrt(dot(way, way)), sqrt(dot(o4 - o2, o4 - o2))
    margin = np.minimum(coupler + rocker - distance, distance - abs(coupler - rocker))
    size = np.max([ground, crank, coupler, rocker], axis=0)
    return Exact((o2 + tip + u).T, gradient, margin, size)


def slider_crank(inputs: np.ndarray, sides: np.ndarray) -> Exact:
    """Pin C of a slider-crank as the intersection of a circle about A and the slider's line.

    Args:
        inputs: shape (cases, 8), in the order of `SLIDER_CRANK`; mm and radians.
        sides: +1 where C lies ahead of A along the line, −1 behind it, shape (cases,).
    """
    o2, (crank, rod), point, (turn, angle) = np.split(inputs.T, (2, 4, 6))
    line, start = direction(turn), o2 + crank * direction(angle) - point
    u, reach = meet_line(start, line, rod, sides)
    slide, normal = dot(line, start) + reach, left(line)
    # (C − A)·(dC − dA) = l dl and n·(dC − dP) = slide dφ, with n normal to the line.
    moved = {"point_x": normal[0], "point_y": normal[1], "direction": slide}
    gradient = _gradient(SLIDER_CRANK, inputs, (u, normal), reach, moved)
    size = np.max([crank, rod, abs(dot(normal, o2 - point))], axis=0)
    return Exact((point + slide * line).T, gradient, rod - abs(dot(normal, start)), size)


def _gradient(
    formula: Formula,
    inputs: np.ndarray,
    normals: tuple[np.ndarray, np.ndarray],
    determinant: np.ndarray,
    moved: dict[str, Any],
) -> np.ndarray:
    """Solve u·dB = u·dA + l dl and v·dB = moved for every input; 0 where u and v are parallel.

    Args:
        formula: names the inputs and the link of length l from A to B.
        inputs: shape (cases, inputs).
        normals: u, the link, and v.
        determinant: of u and v.
        moved: by input what it adds to the second equation.
    """
    (u, v), of = normals, dict(zip(formula.inputs, inputs.T, strict=True))
    way = direction(of["angle"])
    follows = {
        f"{formula.crank}_x": u[0],
        f"{formula.crank}_y": u[1],
        formula.link: of[formula.link],
    }
    follows |= {"crank": dot(u, way), "angle": of["crank"] * dot(u, left(way))}
    inverse = (determinant != 0) / (determinant + (determinant == 0))
    columns = []
    for name in formula.inputs:
        p, q = follows.get(name, 0 * inverse), moved.get(name, 0 * inverse)
        columns.append(np.stack([p * v[1] - q * u[1], q * u[0] - p * v[0]], axis=1))
    return np.stack(columns, axis=2) * inverse[:, None, None]


FOUR_BAR = Formula(
    ("o2_x", "o2_y", "o4_x", "o4_y", "crank", "coupler", "rocker", "angle"),
    four_bar,
    "o2",
    "coupler",
    (0, 2),
)
SLIDER_CRANK = Formula(
    ("o2_x", "o2_y", "crank", "rod", "point_x", "point_y", "direction", "angle"),
    slider_crank,
    "o2",
    "rod",
    (0, 4),
)


def gradient_scale(
    formula: Formula, inputs: np.ndarray, own: np.ndarray, sides: np.ndarray, found: Exact
) -> np.ndarray:
    """What inputs changed by their own size would do to each column of a gradient, first order.

    T_i = |g_i| + Σ_j s_j |∂g_i/∂x_j|, the condition-scaled forward error's scale for the gradient
    itself, with s_j the size of input j; second derivatives by differences of first ones.

    Args:
        formula: of the linkage.
        inputs: shape (cases, inputs).
        own: sizes of the inputs, shape (cases, inputs).
        sides: shape (cases,).
        found: the formula's answer for them.

    Returns:
        Shape (cases, inputs), of each column the larger coordinate.
    """
    step = 1e-25 if inputs.dtype == object else 1e-10
    scale = np.max(abs(found.gradient), axis=1)
    for column in range(inputs.shape[1]):
        moved = inputs.copy()
        moved[:, column] = inputs[:, column] + own[:, column] * step
        change = formula.pin(moved, sides).gradient - found.gradient
        scale = scale + np.max(abs(change), axis=1) / step
    return scale


class ScaledErrors(NamedTuple):
    """Condition-scaled errors of a batch of answers, each of shape (cases,).

    Attributes:
        margin: exact, in units of the linkage's size.
        value: of the pin, as one plane vector.
        gradient: of the worst column of its gradient.
        gradient_relative: the same relative to that column.
    """

    margin: np.ndarray
    value: np.ndarray
    gradient: np.ndarray
    gradient_relative: np.ndarray


def scaled_errors(
    formula: Formula,
    inputs: np.ndarray,
    sides: np.ndarray,
    answers: tuple[np.ndarray, np.ndarray],
    places: int,
) -> ScaledErrors:
    """Compare pins and their gradients with a formula's; in mpmath numbers where a case is hard.

    Args:
        formula: what is exact; coordinates count from the first fixed joint.
        inputs: shape (cases, inputs), floats.
        sides: shape (cases,).
        answers: pins, shape (cases, 2), and gradients, shape (cases, 2, inputs).
        places: digits of the mpmath numbers.
    """
    hard = np.ones(len(inputs), bool)
    # Where long double is no wider than float64, nothing can be judged in it.
    if formula.closed_form and np.finfo(np.longdouble).eps < 1e-18:
        found = formula.pin(extended(inputs), sides)
        far = np.max(abs(inputs[:, :-1]), axis=1) > FAR * found.size
        hard = far | (abs(_relative_margin(found)) < HARD)
    errors = ScaledErrors(*np.full((4, len(inputs)), np.nan))
    with mpmath.workdps(places):
        for mask, number in ((~hard, extended), (hard, digits)):
            if np.any(mask):
                # What is not finite must not pass for accurate.
                some = [number(np.where(np.isfinite(part), part, 1e30)[mask]) for part in answers]
                part = _scaled_errors(formula, number(inputs[mask]), sides[mask], *some)
                for whole, errors_there in zip(errors, part, strict=True):
                    whole[mask] = errors_there
    return errors


def _scaled_errors(
    formula: Formula,
    x: np.ndarray,
    sides: np.ndarray,
    value: np.ndarray,
    gradient: np.ndarray,
) -> ScaledErrors:
    own = x.copy()
    for at in formula.points:
        own[:, at : at + 2] = x[:, at : at + 2] - x[:, :2]
    own, right = abs(own), formula.pin(x, sides)
    tolerated = gradient_scale(formula, x, own, sides, right)
    slopes = np.max(abs(right.gradient), axis=1)
    swing = np.sum(own * slopes, axis=1)
    value_missed = np.max(abs(value - right.value), axis=1)
    missed = np.max(abs(gradient - right.gradient), axis=1)
    reach = np.max(abs(right.value - x[:, :2]), axis=1) + swing
    # Both scales, times the input so that inputs of 0 need no division.
    both = _ratio(missed * own, reach[:, None] + own * tolerated)
    return ScaledErrors(
        _relative_margin(right),
        _ratio(value_missed, np.max(abs(right.value), axis=1) + swing),
        np.max(np.where(own == 0, _ratio(missed, tolerated), both), axis=1),
        np.max(_ratio(missed, slopes), axis=1),
    )


def _relative_margin(found: Exact) -> np.ndarray:
    """Margins in units of the linkages' sizes, as floats."""
    return (found.margin / (found.size + (found.size == 0))).astype(float)


def _ratio(error: np.ndarray, scale: np.ndarray) -> np.ndarray:
    # What stays zero whatever the inputs do must come out as zero.
    divided = (error / (scale + (scale == 0))).astype(float)
    return np.where((scale == 0) & (error != 0), np.inf, divided)


class Dyad(NamedTuple):
    """A link from a joint that is known, and what holds its other end.

    Attributes:
        joint: what it places.
        start: the known joint that the link starts from.
        link: body from ``start`` to ``joint``.
        side: as that of `meet_circles` or `meet_line`.
        end: fixed joint that the arm turns about; empty where ``joint`` slides on the line.
        arm: body from ``end`` to ``joint``; empty where ``joint`` slides on the line.
        carries: further joint of the arm, or empty.
    """

    joint: str
    start: str
    link: str
    side: int
    end: str = ""
    arm: str = ""
    carries: str = ""


class Case(NamedTuple):
    """A linkage of the gallery that a crank drives from ``O2`` to ``A``.

    Attributes:
        name: in figures and tables.
        file: in ``studies/gallery/linkages``.
        joints: its moving joints, which every method has to place; the last is the one whose path
            the gradient is of.
        dyads: in the order in which they are solved.
        sweep_deg: crank angles from which and to which it is driven; the last pose of a sweep is
            one step short of the end.
        base: fixed joint from whose direction, seen from ``O2``, the crank's angle is counted;
            empty where it is counted from +x.
    """

    name: str
    file: str
    joints: tuple[str, ...]
    dyads: tuple[Dyad, ...]
    sweep_deg: tuple[float, float] = (0.0, 360.0)
    base: str = ""

    def angles(self, poses: int) -> np.ndarray:
        """Crank angles of a sweep in equal steps, rad."""
        start, end = np.deg2rad(self.sweep_deg)
        return start + (end - start) * np.arange(poses) / poses


Point = tuple[Any, Any]


class Sizes(NamedTuple):
    """Every dimension of a linkage as plain numbers or scalars.

    Attributes:
        pins: positions of the fixed joints, mm.
        lengths: distance of each moving body's first two joints, mm.
        carried: the third joint of a body, in the frame of its first two, mm.
        line: a point of the line that a joint slides on, mm, and its angle, rad; or nothing.
    """

    pins: dict[str, Point]
    lengths: dict[str, Any]
    carried: dict[str, Point]
    line: tuple[Any, ...]


def poses(case: Case, sizes: Sizes, angles: np.ndarray) -> np.ndarray:
    """Places of a case's moving joints, shape (poses, joints, 2), mm.

    Args:
        case: the linkage.
        sizes: its dimensions, mpmath numbers.
        angles: of the crank, rad, mpmath numbers, shape (poses,).
    """
    joints = {name: np.array([[x], [y]]) for name, (x, y) in sizes.pins.items()}
    lengths = sizes.lengths
    if case.base:
        (x,), (y,) = joints[case.base] - joints["O2"]
        angles = angles + mpmath.atan2(y, x)
    joints["A"] = joints["O2"] + lengths["crank"] * direction(angles)
    for dyad in case.dyads:
        start, link = joints[dyad.start], lengths[dyad.link]
        if not dyad.arm:
            x, y, turn = sizes.line
            away, line = start - np.array([[x], [y]]), direction(np.array([turn]))
            joints[dyad.joint] = start + meet_line(away, line, link, dyad.side)[0]
            continue
        end, arm = joints[dyad.end], lengths[dyad.arm]
        joint = start + meet_circles(end - start, link, arm, dyad.side)[0]
        joints[dyad.joint] = joint
        if dyad.carries:
            (along, across), way = sizes.carried[dyad.arm], (joint - end) / arm
            joints[dyad.carries] = end + along * way + across * left(way)
    return np.stack([joints[name].T for name in case.joints], axis=1)


def mean_square(case: Case, count: int, sizes: Sizes) -> Any:
    """Mean of the last joint's squared distance from the origin over ``count`` poses, mm².

    That of a long sweep is the integral over the crank's angle, with the end corrections of Euler
    and Maclaurin, which make it that of equal steps that count the start and not the end.
    """

    def squares(angles: np.ndarray) -> np.ndarray:
        last = poses(case, sizes, angles)[:, -1].T
        return dot(last, last)

    def square(angle: Any) -> Any:
        return squares(np.array([angle]))[0]

    if count <= SUMMED:
        return mpmath.fsum(squares(digits(case.angles(count)))) / count
    start, end = map(mpmath.mpf, np.deg2rad(case.sweep_deg).tolist())
    width = (end - start) / count
    total = mpmath.quad(square, [start, end], method="gauss-legendre", maxdegree=5)
    for order, weight in ((0, -width / 2), (1, width**2 / 12), (3, -(width**4) / 720)):
        total += weight * (mpmath.diff(square, end, order) - mpmath.diff(square, start, order))
    return total / (end - start)
