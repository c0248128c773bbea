"""The linkages of the study and their loop equations, as a person would write them down.

All three are a crank that drives one dyad after the other. The equations are written once, for
whatever computes cosines: `math` for one pose in Python, `jax.numpy` for a batch.
"""

from __future__ import annotations

import functools
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kinematics import Linkage, read_linkage

GALLERY = Path(__file__).parents[2] / "gallery" / "linkages"

Point = tuple[Any, Any]


@dataclass(frozen=True)
class Dyad:
    """A link from a joint that is known, and what holds its other end.

    Its two unknowns are the link's angle and the arm's angle, or the link's angle and the slide.

    Attributes:
        joint: what it places.
        start: the known joint that the link starts from.
        link: body from ``start`` to ``joint``.
        side: +1 if ``joint`` lies to the left of the way from ``start`` to ``end``, −1 to the
            right; on a line, +1 if it lies on the far side along the line.
        end: fixed joint that the arm turns about; none where ``joint`` slides on the line.
        arm: body from ``end`` to ``joint``.
        carries: further joint of the arm.
    """

    joint: str
    start: str
    link: str
    side: int
    end: str | None = None
    arm: str | None = None
    carries: str | None = None


@dataclass(frozen=True)
class Case:
    """A linkage of the gallery that a crank drives from ``O2`` to ``A``.

    Attributes:
        name: in figures and tables.
        file: in ``studies/gallery/linkages``.
        joints: its moving joints, which every contender has to place; the last is the one whose
            path the gradient is of.
        dyads: in the order in which they are solved.
        sweep_deg: crank angles from which and to which it is driven; the last pose of a sweep is
            one step short of the end.
        base: fixed joint from whose direction, seen from ``O2``, the crank's angle is counted;
            none where it is counted from +x.
    """

    name: str
    file: str
    joints: tuple[str, ...]
    dyads: tuple[Dyad, ...]
    sweep_deg: tuple[float, float] = (0.0, 360.0)
    base: str | None = None

    def angles(self, poses: int) -> np.ndarray:
        """Crank angles of a sweep in equal steps, rad."""
        start, end = np.deg2rad(self.sweep_deg)
        return start + (end - start) * np.arange(poses) / poses


CASES = (
    Case(
        "four-bar",
        "four-bar.toml",
        ("A", "B"),
        (Dyad("B", "A", "coupler", 1, "O4", "rocker"),),
        base="O4",
    ),
    Case("slider-crank", "slider-crank.toml", ("A", "C"), (Dyad("C", "A", "rod", 1),)),
    Case(
        "six-bar",
        "watt.toml",
        ("A", "B", "C", "D"),
        (
            Dyad("B", "A", "coupler", 1, "O4", "rocker", "C"),
            Dyad("D", "C", "link", 1, "O6", "output"),
        ),
        (-30.0, 120.0),  # it locks at -64 and at 161 degrees
    ),
)


class Sizes(NamedTuple):
    """Every dimension of a linkage as plain numbers or scalars.

    Attributes:
        pins: positions of the fixed joints, mm.
        lengths: distance of each moving body's first two joints, mm.
        carried: the third joint of a body, in the frame of its first two, mm.
        lines: a point of each line that a joint slides on, mm, and the line's angle, rad.
    """

    pins: dict[str, Point]
    lengths: dict[str, Any]
    carried: dict[str, Point]
    lines: tuple[tuple[Any, Any, Any], ...]


@functools.cache
def drawn(case: Case) -> Linkage:
    """The linkage of a case with its leaves as NumPy arrays in double precision."""
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, read_linkage(GALLERY / case.file))


def linkage_of(case: Case, dtype: str = "float64") -> Linkage:
    """The linkage of a case with its leaves in a float type, which JAX must have enabled."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), drawn(case))


def sizes_of(linkage: Linkage) -> Sizes:
    """The dimensions of a linkage, whatever its leaves are made of."""
    names = linkage.structure.fixed_joints
    return Sizes(
        {name: (linkage.anchors[i, 0], linkage.anchors[i, 1]) for i, name in enumerate(names)},
        {name: link.length for name, link in linkage.links.items()},
        {
            name: (link.places[0, 0], link.places[0, 1])
            for name, link in linkage.links.items()
            if link.places.shape[0]
        },
        tuple((line.point[0], line.point[1], line.angle) for line in linkage.lines),
    )


def dimensions(linkage: Linkage) -> Any:
    """The parts of a linkage with respect to which gradients are taken."""
    return linkage.anchors, linkage.links, linkage.lines


def with_dimensions(linkage: Linkage, parts: Any) -> Linkage:
    """The linkage with other `dimensions`."""
    return eqx.tree_at(dimensions, linkage, parts)


@functools.cache
def sketch_of(case: Case) -> dict[str, tuple[float, float]]:
    """Where the file's sketch has the joints, mm: near one pose, and no closer than drawn."""
    table = tomllib.loads((GALLERY / case.file).read_text(encoding="utf-8"))
    return {name: (float(x), float(y)) for name, (x, y) in table["joints"].items()}


def start_of(case: Case, sizes: Sizes) -> list[Any]:
    """The unknowns in the sketch, two for each dyad: every iteration starts from them."""
    joints = sketch_of(case)
    unknowns: list[Any] = []
    for dyad in case.dyads:
        here = joints[dyad.joint]
        unknowns.append(_bearing(joints[dyad.start], here))
        if dyad.end is None:
            x, y, _ = sizes.lines[0]
            unknowns.append(((here[0] - x) ** 2 + (here[1] - y) ** 2) ** 0.5)
        else:
            unknowns.append(_bearing(joints[dyad.end], here))
    return unknowns


def _bearing(start: tuple[float, float], end: tuple[float, float]) -> float:
    return math.atan2(end[1] - start[1], end[0] - start[0])


def size_of(linkage: Linkage) -> Any:
    """The largest of the links' lengths, mm: errors and gaps are in units of it."""
    return functools.reduce(jnp.maximum, (link.length for link in linkage.links.values()))


def crank_base(ops: Any, case: Case, sizes: Sizes) -> Any:
    """The angle from +x that the crank's angle is counted from."""
    if case.base is None:
        return 0.0
    (x, y), (end_x, end_y) = sizes.pins["O2"], sizes.pins[case.base]
    return ops.atan2(end_y - y, end_x - x)


def crank_tip(ops: Any, case: Case, sizes: Sizes, angle: Any) -> dict[str, Point]:
    """Places of all fixed joints and of the crank's tip, ``A``."""
    x, y = sizes.pins["O2"]
    angle = angle + crank_base(ops, case, sizes)
    crank = sizes.lengths["crank"]
    return {**sizes.pins, "A": (x + crank * ops.cos(angle), y + crank * ops.sin(angle))}


def place(
    ops: Any, dyad: Dyad, sizes: Sizes, joints: dict[str, Point], first: Any, second: Any
) -> Point:
    """Adds what a dyad places to ``joints``, from its unknowns, and returns the loop's gap, mm.

    The gap is the way from where arm or line has the joint to where the link has it.
    """
    x, y = joints[dyad.start]
    length = sizes.lengths[dyad.link]
    here = x + length * ops.cos(first), y + length * ops.sin(first)
    joints[dyad.joint] = here
    if dyad.end is None or dyad.arm is None:
        x, y, angle = sizes.lines[0]
        cosine, sine, length = ops.cos(angle), ops.sin(angle), second
    else:
        x, y = joints[dyad.end]
        cosine, sine, length = ops.cos(second), ops.sin(second), sizes.lengths[dyad.arm]
        if dyad.carries is not None:
            along, across = sizes.carried[dyad.arm]
            joints[dyad.carries] = (
                x + cosine * along - sine * across,
                y + sine * along + cosine * across,
            )
    return here[0] - x - length * cosine, here[1] - y - length * sine


def gaps(
    ops: Any, case: Case, sizes: Sizes, angle: Any, unknowns: Any
) -> tuple[dict[str, Point], list[Any]]:
    """All joints and the gaps of all loops, mm, two equations for each pair of unknowns."""
    joints = crank_tip(ops, case, sizes, angle)
    left = []
    for number, dyad in enumerate(case.dyads):
        left += place(ops, dyad, sizes, joints, unknowns[2 * number], unknowns[2 * number + 1])
    return joints, left
