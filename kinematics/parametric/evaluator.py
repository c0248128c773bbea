"""Poses of a linkage with any distances, by one compiled program: single ones, and sweeps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.programs import Program
from kinematics.model.linkage import Linkage
from kinematics.parametric.dimensions import Dimensions
from kinematics.plot.scene import Scene, Travel
from kinematics.solve.plan import make_plan
from kinematics.solve.poses import PoseResult
from kinematics.solve.transmission import solve_poses_and_angles

SAMPLES, FEW_SAMPLES = 121, 41
"""Of a sweep: every 3° of a full turn; fewer where every pose has to be followed."""

AT_ONCE, FEW_AT_ONCE = 244, 64
"""Poses of one run of the program: a pose, a sweep, and those by which a design is searched."""

MOST_LIMITS = 6
"""The most limits that are located in one sweep."""

REFINEMENTS = 3
"""How often the interval around a limit is divided by the samples of a batch."""


class PoseBatch(NamedTuple):
    """Poses in plain numbers, a row each; JAX's arrays inside of the program, NumPy's outside.

    Attributes:
        ok: whether each is one.
        margin: as of `kinematics.solve_poses`, mm.
        residual: likewise, in sizes of the linkage.
        result: likewise.
        joints: places of the joints, mm.
        turns: angles of the bodies, rad.
        slides: places of the sliders on their lines, mm.
        angles: transmission angles of the pins, rad.
        lines: angles of the sliders' lines in their bodies, rad.
        size: of the linkage, mm.
    """

    ok: Any
    margin: Any
    residual: Any
    result: Any
    joints: Any
    turns: Any
    slides: Any
    angles: Any
    lines: Any
    size: Any

    def rows(self, index: Any) -> PoseBatch:
        """Some of them, by a slice or an array of numbers."""
        return jax.tree.map(lambda leaf: leaf[index], self)

    def message(self) -> str:
        """Why the first one is none; empty if it is one."""
        # An item has a message as an array of one number, and none as a number.
        return PoseResult[jax.tree.map(lambda code: code[0, ...], self.result)]


def together(*batches: PoseBatch) -> PoseBatch:
    """The poses of several batches, one after the other."""
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *batches)


@partial(Program, static_argnames=["dimensions"])
def _solve(
    linkage: Linkage,
    distances: Float[Array, " distances"],
    inputs: Float[Array, "poses inputs"],
    dimensions: Dimensions,
) -> PoseBatch:
    shaped = dimensions.linkage(linkage, distances)
    structure = linkage.structure
    poses, angles = solve_poses_and_angles(shaped, inputs)
    count = inputs.shape[:1]

    def table(columns: list[Array]) -> Array:
        return jnp.stack(columns, axis=1) if columns else jnp.zeros((*count, 0))

    return PoseBatch(
        poses.ok,
        poses.margin,
        poses.residual,
        poses.result,
        table([poses.value.position(name) for name in structure.joints]),
        table([poses.value.angle(part.name) for part in structure.bodies]),
        table([poses.value.slides[index] for index in range(len(structure.sliders))]),
        table([angles[pin] for pin in pins_of(linkage)]),
        table([jnp.broadcast_to(line.angle, count) for line in shaped.lines]),
        jnp.broadcast_to(shaped.size(), count),
    )


def pins_of(linkage: Linkage) -> tuple[str, ...]:
    """Pins with a transmission angle, in the order in which they are solved."""
    groups = make_plan(linkage.structure).groups
    return tuple(dict.fromkeys(group.pin for group in groups if group.pin is not None))


@dataclass(frozen=True)
class Sweep:
    """A pose, and a sweep of one of its inputs with the others held.

    Attributes:
        inputs: of the pose, rad or mm.
        column: which input is swept.
        here: the pose alone.
        values: of that input, ascending: samples, and where it locks among them.
        poses: of these.
        limits: where it locks, ascending, rad or mm.
        at_limits: the last poses before these.
        cases: of further inputs that were asked for.
    """

    inputs: Float[np.ndarray, " inputs"]
    column: int
    here: PoseBatch
    values: Float[np.ndarray, " samples"]
    poses: PoseBatch
    limits: tuple[float, ...]
    at_limits: PoseBatch
    cases: PoseBatch

    @property
    def ok(self) -> bool:
        """Whether there is such a pose."""
        return bool(self.here.ok[0])

    @property
    def travel(self) -> Travel:
        """Least and greatest place of every slider in the sweep, mm."""
        good = self.poses.slides[self.poses.ok]
        columns = enumerate(good.T) if len(good) else ()
        return {index: (float(min(column)), float(max(column))) for index, column in columns}


class PoseEvaluator:
    """Poses of a linkage with any distances; nothing is compiled before the first ones."""

    def __init__(self, linkage: Linkage, dimensions: Dimensions) -> None:
        self.linkage, self.dimensions = linkage, dimensions
        self.structure = linkage.structure
        self.pins = pins_of(linkage)
        self.iterated = any(group.kind == "iterated" for group in make_plan(self.structure).groups)
        self.samples = FEW_SAMPLES if self.iterated else SAMPLES
        self.home = np.asarray(linkage.reference.inputs, float)
        self.turning = [part.slider is None for part in self.structure.inputs]
        self._bodies = [part.name for part in self.structure.bodies]
        self._batch = FEW_AT_ONCE if self.iterated else AT_ONCE

    def solve(
        self, distances: Float[np.ndarray, " distances"], inputs: Float[np.ndarray, "poses inputs"]
    ) -> PoseBatch:
        """Poses with these distances (mm), as many as one asks for, in blocks of one size."""
        found = []
        for start in range(0, len(inputs), self._batch):
            block = inputs[start : start + self._batch]
            spare = self._batch - len(block)
            padded = np.pad(block, ((0, spare), (0, 0)), mode="edge")
            # What is iterated has too many steps for NumPy.
            solve = _solve.run if self.iterated else _solve
            solved = solve(self.linkage, distances, padded, dimensions=self.dimensions)
            found.append(jax.tree.map(np.asarray, solved).rows(slice(len(block))))
        return together(*found)

    def scene(self, poses: PoseBatch, row: int, travel: Travel | None = None) -> Scene:
        """One of several poses, to be drawn."""
        return Scene.at(
            self.structure,
            float(poses.size[row]),
            dict(zip(self.structure.joints, poses.joints[row], strict=True)),
            dict(zip(self._bodies, poses.turns[row].tolist(), strict=True)),
            list(zip(poses.lines[row].tolist(), poses.slides[row].tolist(), strict=True)),
            travel,
        )

    def sweep(
        self,
        distances: Float[np.ndarray, " distances"],
        inputs: Float[np.ndarray, " inputs"],
        column: int,
        span: tuple[float, float],
        cases: Float[np.ndarray, "cases inputs"] | None = None,
    ) -> Sweep:
        """A pose, a sweep of an input, and further poses.

        Args:
            distances: all of them, mm; they make all triangles.
            inputs: of the pose, rad or mm.
            column: which input is swept.
            span: from where to where, rad or mm, ascending.
            cases: inputs of the further poses; none by default.
        """
        values = np.linspace(*span, self.samples)
        rows = np.tile(inputs, (self.samples + 1, 1))
        rows[1:, column] = values
        cases = np.zeros((0, len(inputs))) if cases is None else cases
        found = self.solve(distances, np.vstack([rows, cases]))
        here, along = found.rows(slice(1)), found.rows(slice(1, len(rows)))
        limits = self._limits(distances, rows[1:], along, column)
        inside = np.tile(inputs, (len(limits), 1))
        inside[:, column] = [last for _, last in limits]
        # No batch of nothing: there is a pose to copy.
        at = self.solve(distances, inside) if limits else along.rows(slice(0))
        every = np.concatenate([values, inside[:, column]])
        order = np.argsort(every, kind="stable")
        return Sweep(
            inputs,
            column,
            here,
            every[order],
            together(along, at).rows(order),
            tuple(limit for limit, _ in limits),
            at,
            found.rows(slice(len(rows), None)),
        )

    def range_of(
        self, distances: Float[np.ndarray, " distances"], column: int
    ) -> tuple[float | None, float | None]:
        """Where an input locks below and above the sketch, the others held; none where it turns.

        A slide without a limit has none either.
        """
        home = float(self.home[column])
        far = self.reach(distances, column)
        limits = self.sweep(distances, self.home, column, (home - far, home + far)).limits
        below = [value for value in limits if value <= home]
        above = [value for value in limits if value > home]
        if self.turning[column] and len(limits) > 1:
            # Beyond half a turn its range goes on at the other end of the sweep.
            below = below or [max(above) - 2 * math.pi]
            above = above or [min(below) + 2 * math.pi]
        return max(below, default=None), min(above, default=None)

    def reach(self, distances: Float[np.ndarray, " distances"], column: int) -> float:
        """How far from the sketch an input is looked at: half a turn, or all lengths together."""
        return math.pi if self.turning[column] else float(np.sum(distances))

    def _limits(
        self,
        distances: np.ndarray,
        rows: Float[np.ndarray, "samples inputs"],
        poses: PoseBatch,
        column: int,
    ) -> list[tuple[float, float]]:
        """Where poses begin or end among samples, and the last value that gives one."""
        changes = np.flatnonzero(poses.ok[1:] != poses.ok[:-1])[:MOST_LIMITS]
        if not changes.size:
            return []
        values = rows[:, column]
        first = np.where(poses.ok[changes], changes, changes + 1)
        second = np.where(poses.ok[changes], changes + 1, changes)
        inside, outside = values[first], values[second]
        margins = [poses.margin[first], poses.margin[second]]
        turns = self._turns(values, poses, second, column)
        if turns is not None and np.all((turns - inside) * (turns - outside) <= 0):
            before = turns + 1e-6 * (inside - turns)
            return list(zip(turns.tolist(), before.tolist(), strict=True))
        parts = np.linspace(0.0, 1.0, self._batch // len(changes) + 2)[1:-1, None]
        each = np.arange(len(changes))
        for _ in range(REFINEMENTS):
            inner = inside + parts * (outside - inside)
            tried = np.repeat(rows[:1], inner.size, axis=0)
            tried[:, column] = inner.ravel()
            found = self.solve(distances, tried)
            ends = np.vstack([inside, inner, outside])
            good = np.vstack([np.ones_like(each, bool), found.ok.reshape(inner.shape)])
            margin = np.vstack([margins[0], found.margin.reshape(inner.shape), margins[1]])
            last = np.argmin(np.vstack([good, np.zeros_like(each, bool)]), axis=0) - 1
            inside, outside = ends[last, each], ends[last + 1, each]
            margins = [margin[last, each], margin[last + 1, each]]
        # A margin that changes its sign does so at the limit.
        share = np.clip(margins[0] / np.maximum(margins[0] - margins[1], 1e-300), 0.0, 1.0)
        limits = inside + share * (outside - inside)
        return list(zip(limits.tolist(), inside.tolist(), strict=True))

    def _turns(
        self, values: np.ndarray, poses: PoseBatch, outside: np.ndarray, column: int
    ) -> np.ndarray | None:
        """Where following the only input from the sketch turned; none where that is not known.

        The margin of a pose that locks before it is reached is the part of the way that is left.
        """
        if not self.iterated or len(self.home) > 1:
            return None
        way = values[outside] - self.home[0]
        if self.turning[column]:
            way = np.remainder(way + np.pi, 2 * np.pi) - np.pi
        return values[outside] + way * poses.margin[outside] / poses.size[outside]
