"""The linkages of the study, their dimensions and loop equations, and where iterations start from.

The loop equations are those that a person would write down, for whatever computes cosines: `math`
for one pose in Python, `jax.numpy` for a batch. The oracle's poses share no line with them. The two
unknowns of a dyad are its link's angle, and its arm's angle or the slide.
"""

from __future__ import annotations

import cmath
import functools
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kinematics import Linkage, read_linkage
from studies.oracles.linkages import Case, Dyad, Point, Sizes

GALLERY = Path(__file__).parents[2] / "gallery" / "linkages"

ROCKER = Dyad("B", "A", "coupler", 1, "O4", "rocker")
WATT = (ROCKER._replace(carries="C"), Dyad("D", "C", "link", 1, "O6", "output"))
CASES = (
    Case("four-bar", "four-bar.toml", ("A", "B"), (ROCKER,), base="O4"),
    Case("slider-crank", "slider-crank.toml", ("A", "C"), (Dyad("C", "A", "rod", 1),)),
    # It locks at -64 and at 161 degrees.
    Case("six-bar", "watt.toml", ("A", "B", "C", "D"), WATT, (-30.0, 120.0)),
)


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
    pins, links = linkage.structure.fixed_joints, linkage.links.items()
    return Sizes(
        {name: (x, y) for name, (x, y) in zip(pins, linkage.anchors, strict=True)},
        {name: link.length for name, link in links},
        {name: (link.places[0, 0], link.places[0, 1]) for name, link in links if len(link.places)},
        tuple(part for line in linkage.lines for part in (*line.point, line.angle)),
    )


def numbers_of(case: Case, number: Callable[[float], Any] = float) -> Sizes:
    """The dimensions of a case's own linkage as numbers of a kind."""
    return jax.tree.map(lambda size: number(float(size)), sizes_of(drawn(case)))


def size_of(sizes: Sizes) -> Any:
    """The largest of the links' lengths, mm: errors and gaps are in units of it."""
    return functools.reduce(jnp.maximum, sizes.lengths.values())


def dimensions(linkage: Linkage) -> Any:
    """The parts of a linkage with respect to which gradients are taken."""
    return linkage.anchors, linkage.links, linkage.lines


def with_dimensions(linkage: Linkage, parts: Any) -> Linkage:
    """The linkage with other `dimensions`."""
    return eqx.tree_at(dimensions, linkage, parts)


def central_differences(
    function: Callable[[Sizes], Any], sizes: Sizes, step: Callable[[Any], Any]
) -> np.ndarray:
    """Derivatives of a function of sizes with respect to each of their numbers.

    Args:
        function: from sizes to a number.
        sizes: where to take them.
        step: from a number to the step it is moved by.
    """
    numbers, structure = jax.tree.flatten(sizes)

    def at(index: int, change: Any) -> Any:
        moved = [number + change * (i == index) for i, number in enumerate(numbers)]
        return function(structure.unflatten(moved))

    steps = enumerate(map(step, numbers))
    return np.array([(at(i, h) - at(i, -h)) / (2 * h) for i, h in steps], float)


@functools.cache
def sketch_of(case: Case) -> dict[str, tuple[float, float]]:
    """Where the file's sketch has the joints, mm: near one pose, and no closer than drawn."""
    table = tomllib.loads((GALLERY / case.file).read_text(encoding="utf-8"))
    return {name: (float(x), float(y)) for name, (x, y) in table["joints"].items()}


def start_of(case: Case, sizes: Sizes) -> list[Any]:
    """The unknowns in the sketch, two for each dyad: every iteration starts from them."""
    joints = {name: complex(*place) for name, place in sketch_of(case).items()}
    unknowns: list[Any] = []
    for dyad in case.dyads:
        there = joints[dyad.joint]
        unknowns.append(cmath.phase(there - joints[dyad.start]))
        if dyad.arm:
            unknowns.append(cmath.phase(there - joints[dyad.end]))
        else:
            x, y, _ = sizes.line
            unknowns.append(((there.real - x) ** 2 + (there.imag - y) ** 2) ** 0.5)
    return unknowns


def crank_base(ops: Any, case: Case, sizes: Sizes) -> Any:
    """The angle from +x that the crank's angle is counted from."""
    if not case.base:
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
    if dyad.arm:
        x, y = joints[dyad.end]
        cosine, sine, length = ops.cos(second), ops.sin(second), sizes.lengths[dyad.arm]
    else:
        x, y, angle = sizes.line
        cosine, sine, length = ops.cos(angle), ops.sin(angle), second
    if dyad.carries:
        along, across = sizes.carried[dyad.arm]
        at = x + cosine * along - sine * across, y + sine * along + cosine * across
        joints[dyad.carries] = at
    return here[0] - x - length * cosine, here[1] - y - length * sine


def gaps(
    ops: Any, case: Case, sizes: Sizes, angle: Any, unknowns: Any
) -> tuple[dict[str, Point], list[Any]]:
    """All joints and the gaps of all loops, mm, two equations for each pair of unknowns."""
    joints, left = crank_tip(ops, case, sizes, angle), []
    for number, dyad in enumerate(case.dyads):
        left += place(ops, dyad, sizes, joints, *unknowns[2 * number : 2 * number + 2])
    return joints, left
