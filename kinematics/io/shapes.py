"""The shape of a rigid body from its sketch and its exact lengths."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

CONSISTENT = 1e-9
"""Relative deviation up to which a length that others already fix counts as the same."""

Pair = tuple[str, str]
Places = dict[str, np.ndarray]


class ImpossibleShapeError(ValueError):
    """The lengths of a body contradict each other; the text names them, and the cure."""


def body_shape(
    sketch: Mapping[str, tuple[float, float]],
    joints: Sequence[str],
    lengths: Mapping[Pair, float],
) -> np.ndarray:
    """Coordinates of a body's joints: the first at the origin, the second along +x.

    Returns:
        Array of shape (joints, 2), mm.

    Raises:
        ImpossibleShapeError: as `body_steps`, or the first two joints coincide.
    """
    if len(joints) == 1:
        return np.zeros((1, 2))
    steps = list(body_steps(sketch, joints, lengths).values())
    length = math.hypot(*steps[1])
    if length <= CONSISTENT * max(math.hypot(*step) for step in steps):
        raise ImpossibleShapeError(
            f"{joints[0]} and {joints[1]} coincide, so the body has no direction; "
            "move one, or name other joints first"
        )
    cosine, sine = steps[1] / length
    turn = np.array([[cosine, sine], [-sine, cosine]])
    shape = np.array([turn @ step for step in steps])
    exact = {frozenset(pair): wanted for pair, wanted in lengths.items()}
    shape[0], shape[1] = 0.0, (exact.get(frozenset(joints[:2]), length), 0.0)
    return shape


def body_steps(
    sketch: Mapping[str, tuple[float, float]],
    joints: Sequence[str],
    lengths: Mapping[Pair, float],
) -> Places:
    """Vectors from a body's first joint to each of its joints, the body turned as sketched.

    Every length given holds exactly; distances that are left open are the sketch's, and so is
    the side on which a joint lies. Joints are placed one after the other by the intersection of
    two circles, in an order that uses the most of the given lengths. Joints that are sketched in
    one line stay in it, and joints that are sketched in one place stay together.

    Args:
        sketch: joint positions, mm.
        joints: the body's joints in order.
        lengths: exact distances between pairs of its joints, mm.

    Raises:
        ImpossibleShapeError: joints with a length between them coincide in the sketch, or the
            lengths break the triangle inequality or contradict each other.
    """
    origin = np.array(sketch[joints[0]], float)
    drawn = {joint: np.array(sketch[joint], float) - origin for joint in joints}
    given = {frozenset(pair): float(length) for pair, length in lengths.items()}
    if not given:  # the sketch is the shape
        return drawn
    for pair in itertools.combinations(joints, 2):
        if frozenset(pair) in given and math.dist(drawn[pair[0]], drawn[pair[1]]) == 0:
            raise ImpossibleShapeError(
                f"{_name(pair)} = {given[frozenset(pair)]:.6g}, but {pair[0]} and {pair[1]} "
                "coincide in the sketch, so it has no direction; move one"
            )
    placed = _construct(drawn, _order(joints, set(given)), given)
    broken = _broken(placed, joints, given)
    if broken is not None:
        relaxed = _relaxed(placed, given)
        if _broken(relaxed, joints, given) is None:
            return _as_drawn(relaxed, drawn)
        raise ImpossibleShapeError(
            f"{_name(broken)} = {given[frozenset(broken)]:.6g} contradicts the other lengths, "
            f"which make it {_distance(placed, broken):.6g}; leave one of them out"
        )
    return _as_drawn(placed, drawn)


def _broken(
    placed: Places, joints: Sequence[str], given: Mapping[frozenset[str], float]
) -> Pair | None:
    """The pair whose length deviates most from what is given; none if all of them hold."""
    pairs = [pair for pair in itertools.combinations(joints, 2) if frozenset(pair) in given]

    def deviation(pair: Pair) -> float:
        wanted, found = given[frozenset(pair)], _distance(placed, pair)
        return abs(found - wanted) / max(found, wanted)

    worst = max(pairs, key=deviation)
    return worst if deviation(worst) > CONSISTENT else None


def _relaxed(placed: Places, given: Mapping[frozenset[str], float]) -> Places:
    """The shape nearby in which given lengths hold that no sequence of triangles can use."""
    names, scale = list(placed), max(given.values())
    pairs = [tuple(names.index(joint) for joint in pair) for pair in given]
    wanted = np.array(list(given.values())) / scale
    first, second = np.array(pairs).T

    def deviations(vector: np.ndarray) -> np.ndarray:
        places = vector.reshape(-1, 2)
        return np.hypot(*(places[first] - places[second]).T) - wanted

    start = np.array(list(placed.values())).ravel() / scale
    import scipy.optimize  # half a second, and most shapes follow without

    found = scipy.optimize.least_squares(deviations, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return dict(zip(names, scale * found.x.reshape(-1, 2), strict=True))


def _as_drawn(placed: Places, drawn: Places) -> Places:
    """The shape relative to its first joint, turned as the sketch is."""
    first, *others = drawn
    turn = 1.0 + 0.0j
    for joint in others:
        was, now = (complex(*(places[joint] - places[first])) for places in (drawn, placed))
        if was and now:
            turn = was / now
            turn /= abs(turn)
            break
    steps = {joint: turn * complex(*(placed[joint] - placed[first])) for joint in drawn}
    return {joint: np.array([step.real, step.imag]) for joint, step in steps.items()}


def _order(joints: Sequence[str], given: set[frozenset[str]]) -> list[str]:
    """An order of placing that uses the most given lengths; the file's order if that does."""

    def used(order: Sequence[str]) -> int:
        return sum(
            min(2, sum(frozenset((joint, earlier)) in given for earlier in order[:i]))
            for i, joint in enumerate(order)
        )

    def grown(start: Pair) -> list[str]:
        # Next is always the joint that most lengths tie to those placed already.
        order, rest = list(start), [joint for joint in joints if joint not in start]
        while rest:
            order.append(max(rest, key=lambda j: sum(frozenset((j, o)) in given for o in order)))
            rest.remove(order[-1])
        return order

    candidates = [list(joints)]
    if used(candidates[0]) < len(given):
        candidates += [grown(pair) for pair in itertools.permutations(joints, 2)]
    return max(candidates, key=used)


def _construct(
    drawn: Places, order: Sequence[str], given: Mapping[frozenset[str], float]
) -> Places:
    placed = {order[0]: drawn[order[0]]}
    for i, joint in enumerate(order[1:], start=1):
        # Given lengths first, then the sketch's, to the joints placed first.
        tied = [other for other in order[:i] if frozenset((joint, other)) in given]
        bases = [*tied, *(other for other in order[:i] if other not in tied)]
        twin = next((o for o in bases if not np.any(drawn[o] - drawn[joint])), None)
        second = next((o for o in bases if np.any(placed[o] - placed[bases[0]])), None)
        if twin is not None and not tied:
            placed[joint] = placed[twin]
        elif second is None:
            step = drawn[joint] - drawn[bases[0]]
            length = given.get(frozenset((joint, bases[0])), math.hypot(*step))
            placed[joint] = placed[bases[0]] + length * step / math.hypot(*step)
        else:
            a, b = sorted((bases[0], second), key=order.index)
            placed[joint] = _third_corner((a, b, joint), bases[0], placed, drawn, given)
    return placed


def _third_corner(
    names: tuple[str, str, str],
    base: str,
    placed: Places,
    drawn: Places,
    given: Mapping[frozenset[str], float],
) -> np.ndarray:
    """The third joint of a triangle; ``base`` is the end that its length is surest from."""
    a, b, joint = names
    to_a, to_b = (
        given.get(frozenset((end, joint)), _distance(drawn, (end, joint))) for end in (a, b)
    )
    step = placed[b] - placed[a]
    apart = math.hypot(*step)
    direction = step / apart
    side = _sine(drawn[b] - drawn[a], drawn[joint] - drawn[a])
    in_line = abs(side) <= CONSISTENT
    if in_line and not all(frozenset((end, joint)) in given for end in (a, b)):
        ahead = float((drawn[joint] - drawn[base]) @ (drawn[b] - drawn[a]))
        return placed[base] + math.copysign(to_a if base == a else to_b, ahead) * direction
    along = (apart * apart + to_a * to_a - to_b * to_b) / (2 * apart)
    square = to_a * to_a - along * along
    tolerance = CONSISTENT * to_a * max(to_a, apart)
    if square < -tolerance:
        sides = [
            f"{_name(pair)} = {length:.6g}{'' if frozenset(pair) in given else ' (as sketched)'}"
            for pair, length in zip(
                itertools.combinations(names, 2), (apart, to_a, to_b), strict=True
            )
        ]
        raise ImpossibleShapeError(
            f"{sides[0]}, {sides[1]} and {sides[2]} make no triangle; change one of them"
        )
    if in_line:  # rounding would put the joint beside the line
        if square > tolerance:
            raise ImpossibleShapeError(
                f"the sketch has {', '.join(names)} in one line, but their lengths make a "
                f"triangle; move {joint} to the side where it belongs"
            )
        square = 0.0
    height = math.copysign(math.sqrt(max(square, 0.0)), side)
    return placed[a] + along * direction + height * np.array([-direction[1], direction[0]])


def _sine(base: np.ndarray, other: np.ndarray) -> float:
    """The sine of the angle from ``base`` to ``other``."""
    size = math.hypot(*base) * math.hypot(*other)
    return float(base[0] * other[1] - base[1] * other[0]) / size if size else 0.0


def _distance(places: Mapping[str, np.ndarray], pair: Pair) -> float:
    return math.dist(places[pair[0]], places[pair[1]])


def _name(pair: Sequence[str]) -> str:
    return "-".join(pair)
