"""The shape of a rigid body from its sketch and its exact lengths."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

CONSISTENT = 1e-9
"""Relative deviation up to which a length that others already fix counts as the same."""

MANY_JOINTS = 7
"""Bodies with more joints keep the file's order in the search for one that suits their lengths."""

Pair = tuple[str, str]


class ImpossibleShapeError(ValueError):
    """The lengths of a body cannot all be; the text says which."""


def body_shape(
    sketch: Mapping[str, tuple[float, float]],
    joints: Sequence[str],
    lengths: Mapping[Pair, float],
) -> np.ndarray:
    """Coordinates of a body's joints: the first at the origin, the second along +x.

    Every length given holds exactly; distances that are left open are the sketch's, and so is
    the side on which a joint lies. Joints are placed one after the other by the intersection of
    two circles, in the order that uses the most of the given lengths.

    Args:
        sketch: joint positions, mm.
        joints: the body's joints in order.
        lengths: exact distances between pairs of its joints, mm.

    Returns:
        Array of shape (joints, 2), mm.

    Raises:
        ImpossibleShapeError: two joints coincide in the sketch and in the lengths, or the lengths
            break the triangle inequality or contradict each other.
    """
    given = {frozenset(pair): length for pair, length in lengths.items()}
    order = _order(joints, set(given))
    # A sketch without exact lengths is the shape; nothing needs to be constructed.
    placed = {joint: np.asarray(sketch[joint], float) for joint in joints}
    if given:
        placed = _construct(placed, order, given)
    for pair in itertools.combinations(joints, 2):
        wanted = given.get(frozenset(pair))
        found = math.dist(placed[pair[0]], placed[pair[1]])
        if wanted is not None and abs(found - wanted) > CONSISTENT * max(found, wanted):
            raise ImpossibleShapeError(
                f"{_name(pair)} = {wanted:g} contradicts the other lengths, which make it "
                f"{found:.6g}; leave one of them out"
            )
    if len(joints) == 1:
        return np.zeros((1, 2))
    first, second = (placed[joint] for joint in joints[:2])
    along = second - first
    length = math.hypot(*along)
    if length == 0:
        raise ImpossibleShapeError(
            f"{joints[0]} and {joints[1]} coincide, so the body has no direction; "
            "move one, or name other joints first"
        )
    cosine, sine = along / length
    turn = np.array([[cosine, sine], [-sine, cosine]])
    shape = np.array([turn @ (placed[joint] - first) for joint in joints])
    shape[1] = length, 0.0
    return shape


def _order(joints: Sequence[str], given: set[frozenset[str]]) -> tuple[str, ...]:
    """The order of placing that uses the most given lengths, the file's order if it does."""

    def used(order: Sequence[str]) -> int:
        return sum(
            min(2, sum(frozenset((joint, earlier)) in given for earlier in order[:i]))
            for i, joint in enumerate(order)
        )

    if len(joints) <= 2 or len(joints) > MANY_JOINTS:
        return tuple(joints)
    best = tuple(joints)
    for order in itertools.permutations(joints):
        if used(order) > used(best):
            best = order
        if used(best) == len(given):
            break
    return best


def _construct(
    sketch: Mapping[str, np.ndarray], order: Sequence[str], given: Mapping[frozenset[str], float]
) -> dict[str, np.ndarray]:
    def distance(a: str, b: str) -> float:
        return given.get(frozenset((a, b)), math.dist(sketch[a], sketch[b]))

    placed = {order[0]: sketch[order[0]]}
    if len(order) > 1:
        along = sketch[order[1]] - sketch[order[0]]
        size = math.hypot(*along)
        direction = along / size if size else np.array([1.0, 0.0])
        placed[order[1]] = placed[order[0]] + distance(order[0], order[1]) * direction
    for i, joint in enumerate(order[2:], start=2):
        # Given lengths first, then the sketch's, to the joints placed first.
        bases = sorted(order[:i], key=lambda other: frozenset((joint, other)) not in given)[:2]
        a, b = sorted(bases, key=order.index)
        placed[joint] = _third_corner(
            (a, b, joint),
            placed[a],
            placed[b],
            distance(a, joint),
            distance(b, joint),
            _side(sketch[b] - sketch[a], sketch[joint] - sketch[a]),
        )
    return placed


def _third_corner(
    names: tuple[str, str, str],
    a: np.ndarray,
    b: np.ndarray,
    to_a: float,
    to_b: float,
    side: float,
) -> np.ndarray:
    base = math.dist(a, b)
    if base == 0:
        raise ImpossibleShapeError(f"{names[0]} and {names[1]} coincide; move one of them")
    along = (base * base + to_a * to_a - to_b * to_b) / (2 * base)
    square = to_a * to_a - along * along
    if square < -CONSISTENT * to_a * max(to_a, base):
        ab, ac, bc = (_name(pair) for pair in itertools.combinations(names, 2))
        raise ImpossibleShapeError(
            f"{ab} = {base:g}, {ac} = {to_a:g} and {bc} = {to_b:g} make no triangle"
        )
    # Joints in one line stay in it: rounding would put the third one beside it.
    if abs(side) <= CONSISTENT:
        if square > CONSISTENT * to_a * max(to_a, base):
            raise ImpossibleShapeError(
                f"the sketch has {', '.join(names)} in one line, but their lengths make a "
                f"triangle; move {names[2]} to the side where it belongs"
            )
        square = 0.0
    height = math.copysign(math.sqrt(max(square, 0.0)), side)
    direction = (b - a) / base
    return a + along * direction + height * np.array([-direction[1], direction[0]])


def _side(base: np.ndarray, other: np.ndarray) -> float:
    """The sine of the angle from ``base`` to ``other``."""
    size = math.hypot(*base) * math.hypot(*other)
    return float(base[0] * other[1] - base[1] * other[0]) / size if size else 0.0


def _name(pair: Sequence[str]) -> str:
    return "-".join(pair)
