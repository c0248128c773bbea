"""Poses in one array: the quickest call for few of them, as a control loop makes it.

A call of a compiled program takes longer over each array that it returns than over hundreds of
poses, and as long again over a linkage that it is given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from designopt.numerics import as_float
from designopt.programs import known_options
from designopt.vectors import Vector
from kinematics.model.linkage import Linkage
from kinematics.solve.evaluation import State
from kinematics.solve.poses import is_pose, map_states
from kinematics.solve.solver import Solver

MARGIN, OK = 0, 1
"""Rows that every linkage has."""

Names = tuple[tuple[tuple[str, int], ...], tuple[tuple[str, int], ...], tuple[tuple[int, int], ...]]
"""First rows of joints, bodies and slides; see `PackedPoses`."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PackedPoses:
    """Poses in one array, and its rows by name.

    Rows of an array of NumPy's are views: ``jax.device_get`` of all of this copies nothing.

    Attributes:
        array: a row for each number of a pose: the margin, mm; whether it is one, 1 or 0; then what
            the names below have.
        joints: first of the two rows of each joint, x and y, mm.
        bodies: the same of each body's direction, the cosine and sine of its angle.
        slides: row of each slider's place along its line, mm, by its number.
    """

    array: Float[Array | np.ndarray, "rows poses"]
    joints: tuple[tuple[str, int], ...] = field(metadata={"static": True})
    bodies: tuple[tuple[str, int], ...] = field(metadata={"static": True})
    slides: tuple[tuple[int, int], ...] = field(metadata={"static": True})

    @property
    def margin(self) -> Float[Array | np.ndarray, " poses"]:
        """As `solve_poses` has it, mm."""
        return self.array[MARGIN]

    @property
    def ok(self) -> Float[Array | np.ndarray, " poses"]:
        """1 where the linkage can be assembled, else 0."""
        return self.array[OK]

    def position(self, joint: str) -> Float[Array | np.ndarray, "2 poses"]:
        """Places of a joint, mm."""
        row = dict(self.joints)[joint]
        return self.array[row : row + 2]

    def direction(self, body: str) -> Float[Array | np.ndarray, "2 poses"]:
        """Cosine and sine of a body's angle."""
        row = dict(self.bodies)[body]
        return self.array[row : row + 2]

    def slide(self, slider: int) -> Float[Array | np.ndarray, " poses"]:
        """Places of a slider along its line, mm."""
        return self.array[dict(self.slides)[slider]]


def pack_poses(
    linkage: Linkage,
    inputs: Float[Array | np.ndarray, "poses inputs"],
    *,
    of: Iterable[str] | None = None,
) -> PackedPoses:
    """What `solve_poses` returns of poses, in one array; differentiable in the same way.

    Args:
        linkage: the linkage.
        inputs: values of the inputs, rad or mm.
        of: joints and bodies that have rows; by default all, and the slides, which else have none.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> def height(linkage):
        ...     return pack_poses(linkage, jnp.array([[0.7]])).position("B")[1, 0]
        >>> slope = jax.grad(height)(linkage)
        >>> round(float(slope.links["crank"].length), 4)
        -0.8418
    """
    inputs = as_float(inputs)
    targets = None if of is None else frozenset(of)
    solver = Solver.of(linkage, inputs.dtype, targets)
    names: list[Names] = []

    def rows(state: State, finite: Bool[Array, ""]) -> list[Float[Array, ""]]:
        found, (margin, ok) = solver.pose(state), is_pose(state, finite)
        numbers = [margin * solver.size, ok.astype(inputs.dtype)]

        def added(*parts: Array) -> int:
            numbers.extend(parts)
            return len(numbers) - len(parts)

        def rows_of(parts: dict[str, Vector]) -> tuple[tuple[str, int], ...]:
            asked = parts if targets is None else [name for name in parts if name in targets]
            return tuple((name, added(parts[name].x, parts[name].y)) for name in asked)

        joints, bodies = rows_of(found.joints), rows_of(found.bodies)
        slides = found.slides if targets is None else {}
        numbered = tuple((number, added(slide)) for number, slide in slides.items())
        names.append((joints, bodies, numbered))
        return numbers

    return PackedPoses(jnp.stack(map_states(solver, inputs, rows)), *names[-1])


def compile_poses(
    linkage: Linkage, *, of: Iterable[str] | None = None
) -> Callable[[Float[Array | np.ndarray, "poses inputs"]], PackedPoses]:
    r"""`pack_poses` of one linkage, compiled with its dimensions as constants.

    Args:
        linkage: the linkage; it is computed in the float type of its arrays.
        of: as in `pack_poses`; what is not asked for takes no time.

    Returns:
        A function of inputs, of that float type, shape (poses, inputs). Each number of poses is
        compiled once. It can be differentiated with respect to the inputs; for dimensions take
        `pack_poses`.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> inputs = jnp.deg2rad(jnp.array([[40.0], [90.0]]))
        >>> poses = jax.device_get(compile_poses(linkage)(inputs))
        >>> print(poses.ok, poses.position("B").round(2), sep="\n")
        [1. 1.]
        [[143.19 113.54]
         [ 67.34  78.85]]
    """
    targets = None if of is None else tuple(of)

    def solve(inputs: Float[Array, "poses inputs"]) -> PackedPoses:
        return pack_poses(linkage, inputs, of=targets)

    return jax.jit(solve, compiler_options=known_options())
