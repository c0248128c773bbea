"""What a bench computes of a linkage: one pose, a sweep of one input, and where it locks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.numerics import bisect
from designopt.solution import Solution
from kinematics.explore.dimensions import Dimensions
from kinematics.model.linkage import Linkage
from kinematics.model.topology import InputPart, Structure
from kinematics.plot.drawing import Scene, Travel
from kinematics.plot.symbols import Points
from kinematics.solve.plan import make_plan
from kinematics.solve.poses import solve_poses
from kinematics.solve.transmission import solve_transmission

SAMPLES, FEW_SAMPLES = 121, 41
"""Of a sweep: every 3° of a full turn; fewer where every pose has to be followed."""

EDGES = 6
"""The most limits that are located in one sweep."""

HALVINGS = 30
"""Of the distance between two samples, to find a limit between them."""


def _pins(structure: Structure) -> tuple[str, ...]:
    """Pins with a transmission angle, in the order in which they are solved."""
    groups = make_plan(structure).groups
    return tuple(dict.fromkeys(group.pin for group in groups if group.pin is not None))


class _Found(eqx.Module):
    """Of many poses; the first is the one asked for, the others are a sweep.

    Arrays are JAX's inside of the program and NumPy's outside.
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


@partial(jax.jit, static_argnames="dimensions")
def _solve(
    linkage: Linkage,
    distances: Float[Array, " distances"],
    inputs: Float[Array, "poses inputs"],
    dimensions: Dimensions,
) -> _Found:
    shaped = dimensions.linkage(linkage, distances)
    structure = linkage.structure
    poses = solve_poses(shaped, inputs)
    pins = _pins(structure)
    # What has no such pin is not solved a second time for it.
    angles = solve_transmission(shaped, inputs).angles if pins else {}
    count = inputs.shape[:1]

    def table(columns: list[Array]) -> Array:
        return jnp.stack(columns, axis=1) if columns else jnp.zeros((*count, 0))

    turns = [
        jnp.broadcast_to(poses.value.bodies[part.name].angle(), count) for part in structure.bodies
    ]
    return _Found(
        poses.ok,
        poses.margin,
        poses.residual,
        poses.result,
        table(
            [
                jnp.broadcast_to(poses.value.joints[n].stacked(), (*count, 2))
                for n in structure.joints
            ]
        ),
        table(turns),
        table([poses.value.slides[index] for index in range(len(structure.sliders))]),
        table([angles[pin] for pin in pins]),
        jnp.asarray([line.angle for line in shaped.lines]),
        shaped.size(),
    )


@partial(jax.jit, static_argnames="dimensions")
def _halve(
    linkage: Linkage,
    distances: Float[Array, " distances"],
    inside: Float[Array, "edges inputs"],
    outside: Float[Array, "edges inputs"],
    dimensions: Dimensions,
) -> Float[Array, "edges inputs"]:
    """Between poses and what are none: the last inputs that give a pose."""
    shaped = dimensions.linkage(linkage, distances)

    def good(inputs: Float[Array, "edges inputs"]) -> Array:
        return solve_poses(shaped, inputs).ok[:, None]

    return bisect(good, inside, outside, HALVINGS)[0]


@partial(jax.jit, static_argnames="dimensions")
def _shaped(
    linkage: Linkage, distances: Float[Array, " distances"], dimensions: Dimensions
) -> Linkage:
    return dimensions.linkage(linkage, distances)


@dataclass(frozen=True)
class Edge:
    """An end of what an input can do.

    Attributes:
        value: of the input, rad or mm.
        sign: +1 where poses end along the sweep, −1 where they begin.
    """

    value: float
    sign: int


@dataclass(frozen=True)
class InputSweep:
    """One pose of one design, and a sweep of one input through it.

    Attributes:
        structure: of the linkage.
        inputs: of the pose, rad or mm.
        column: which input was swept.
        samples: its values, rad or mm.
        edges: where it locks among them, in their order.
        joints: places in the sweep, mm; NaN where there is no pose.
        margin: in the sweep, mm.
        angles: transmission angles by pin in the sweep, rad; NaN where there is no pose.
        sign: with which inputs are shown.
    """

    structure: Structure
    inputs: Float[np.ndarray, " inputs"]
    column: int
    samples: Float[np.ndarray, " samples"]
    edges: tuple[Edge, ...]
    joints: Mapping[str, Points]
    margin: Float[np.ndarray, " samples"]
    angles: Mapping[str, Float[np.ndarray, " samples"]]
    sign: float
    _found: _Found

    @property
    def swept(self) -> InputPart:
        """The input that was swept."""
        return self.structure.inputs[self.column]

    @property
    def turns(self) -> bool:
        """Whether it is an angle."""
        return self.swept.slider is None

    def across(self) -> Float[np.ndarray, " samples"]:
        """Its values in the sweep as they are shown, degrees or mm."""
        return self.sign * (np.degrees(self.samples) if self.turns else self.samples) + 0.0

    def shown(self, value: float) -> float:
        """A value of it as it is shown, in degrees or mm."""
        return self.sign * (math.degrees(value) if self.turns else value) + 0.0  # no −0

    def told(self, value: float) -> str:
        """A value of it in words."""
        shown = self.shown(value)
        return f"{shown:.2f}°" if self.turns else f"{shown:.3f} mm"

    def gaps(self) -> list[tuple[float, float]]:
        """From where to where in the sweep there is no pose."""
        first, last = (float(end) for end in self.samples[[0, -1]])
        starts = [edge.value for edge in self.edges if edge.sign > 0]
        ends = [edge.value for edge in self.edges if edge.sign < 0]
        if not self.sweep_ok[0]:
            starts = [first, *starts]
        if len(ends) < len(starts):
            ends = [*ends, last]
        return list(zip(starts, ends, strict=False))

    @property
    def ok(self) -> bool:
        """Whether there is such a pose."""
        return bool(self._found.ok[0])

    @property
    def sweep_ok(self) -> np.ndarray:
        """Which samples give a pose."""
        return np.asarray(self._found.ok[1:])

    @property
    def here(self) -> float:
        """The pose's value of the input that was swept."""
        return float(self.inputs[self.column])

    @property
    def margin_here(self) -> float:
        """The pose's margin, mm; negative where there is none."""
        return float(self._found.margin[0])

    @property
    def closure_here(self) -> float:
        """Largest gap in the pose's loops, mm."""
        return float(self._found.residual[0] * self._found.size)

    def angles_here(self) -> dict[str, float]:
        """The pose's transmission angles, rad, by pin."""
        return dict(zip(self.angles, self._found.angles[0].tolist(), strict=True))

    def message(self) -> str:
        """Why there is no pose; empty if there is one."""
        first = jax.tree.map(lambda code: jnp.asarray(code)[:1], self._found.result)
        margin = jnp.asarray(self._found.margin[:1])
        return Solution(None, margin, margin, first).messages()[0]

    def scene(self) -> Scene:
        """The pose, drawn: sliders' lines over the travel of the sweep."""
        names = [part.name for part in self.structure.bodies]
        good = self._found.slides[self._found.ok]
        travel: Travel = {
            index: (float(column.min()), float(column.max()))
            for index, column in enumerate(good.T)
            if column.size
        }
        return Scene.at(
            self.structure,
            float(self._found.size),
            dict(zip(self.structure.joints, self._found.joints[0], strict=True)),
            dict(zip(names, self._found.turns[0].tolist(), strict=True)),
            list(zip(self._found.lines.tolist(), self._found.slides[0].tolist(), strict=True)),
            travel,
        )

    def places(self) -> Points:
        """Every joint's place in every pose, mm."""
        return self._found.joints[self._found.ok].reshape(-1, 2)


class SweepEvaluator:
    """Surveys of a linkage, by programs that are compiled once."""

    def __init__(self, linkage: Linkage, dimensions: Dimensions, sign: float = 1.0) -> None:
        self.linkage, self.dimensions, self.sign = linkage, dimensions, sign
        groups = make_plan(linkage.structure).groups
        self.pins = _pins(linkage.structure)
        self.iterated = any(group.kind == "iterated" for group in groups)
        self.samples = FEW_SAMPLES if self.iterated else SAMPLES
        # Whether a pose that cannot be reached says by its margin where its only input locks.
        self._tells = self.iterated and len(linkage.input_names) == 1

    def shaped(self, distances: np.ndarray) -> Linkage:
        """The linkage with these distances, mm."""
        return _shaped(self.linkage, distances, self.dimensions)

    def warm_up(self, distances: np.ndarray, inputs: np.ndarray) -> None:
        """Compile what only a sweep with a limit runs, so that the first one is as fast."""
        if not self._tells:
            ends = np.tile(inputs, (EDGES, 1))
            _halve(self.linkage, distances, ends, ends, self.dimensions)

    def judged(
        self, distances: np.ndarray, inputs: Float[np.ndarray, "poses inputs"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which of many inputs give poses; margins, mm; transmission angles, rad, by pin.

        Up to as many as a sweep has, nothing more is compiled for it.
        """
        count = len(inputs)
        spare = max(1 + self.samples - count, 0)
        found = self._solved(distances, np.pad(inputs, ((0, spare), (0, 0)), mode="edge"))
        return found.ok[:count], found.margin[:count], found.angles[:count]

    def _solved(self, distances: np.ndarray, inputs: np.ndarray) -> _Found:
        return jax.tree.map(np.asarray, _solve(self.linkage, distances, inputs, self.dimensions))

    def survey(
        self,
        distances: np.ndarray,
        inputs: np.ndarray,
        column: int,
        span: tuple[float, float],
    ) -> InputSweep:
        """A pose, and a sweep of an input with the others held.

        Args:
            distances: all distances, mm; they make all triangles.
            inputs: of the pose, rad or mm.
            column: which input to sweep.
            span: from where to where, rad or mm.
        """
        samples = np.linspace(*span, self.samples)
        batch = np.tile(inputs, (len(samples) + 1, 1))
        batch[1:, column] = samples
        found = self._solved(distances, batch)
        good = found.ok[1:]
        angles = np.where(good[:, None], found.angles[1:], np.nan)
        joints = np.where(good[:, None, None], found.joints[1:], np.nan)
        structure = self.linkage.structure
        return InputSweep(
            structure,
            inputs,
            column,
            samples,
            self._edges(distances, found, batch[1:], column),
            {joint: joints[:, n] for n, joint in enumerate(structure.joints)},
            np.where(good, found.margin[1:], np.nan),
            dict(zip(self.pins, angles.T, strict=True)),
            self.sign,
            found,
        )

    def _edges(
        self, distances: np.ndarray, found: _Found, batch: np.ndarray, column: int
    ) -> tuple[Edge, ...]:
        good = found.ok[1:]
        changes = np.flatnonzero(good[1:] != good[:-1])[:EDGES]
        if not changes.size:
            return ()
        values = self._followed_edges(found, batch, good, changes)
        if values is None:
            values = self._halved_edges(distances, batch, good, changes)[:, column]
        return tuple(
            Edge(float(value), 1 if good[at] else -1)
            for value, at in zip(values, changes, strict=True)
        )

    def _followed_edges(
        self, found: _Found, batch: np.ndarray, good: np.ndarray, changes: np.ndarray
    ) -> np.ndarray | None:
        """Where following one input from the sketch turned; none where that does not tell.

        The margin of a pose that locks before it is reached says which part of the way is left.
        """
        if not self._tells:
            return None
        bad = np.where(good[changes], changes + 1, changes)
        inside = np.where(good[changes], changes, changes + 1)
        home = float(self.linkage.reference.inputs[0])
        way = batch[bad, 0] - home
        if self.linkage.structure.inputs[0].slider is None:
            way = np.remainder(way + np.pi, 2 * np.pi) - np.pi
        left = -found.margin[1:][bad] / float(found.size)
        values = batch[bad, 0] - way * left
        between = (values - batch[inside, 0]) * (values - batch[bad, 0]) <= 0
        return values if np.all(between) else None

    def _halved_edges(
        self, distances: np.ndarray, batch: np.ndarray, good: np.ndarray, changes: np.ndarray
    ) -> np.ndarray:
        # The last one is repeated, so that one program serves any number.
        left = np.pad(changes, (0, EDGES - changes.size), mode="edge")
        inside, outside = np.where(good[left], [left, left + 1], [left + 1, left])
        ends = batch[inside], batch[outside]
        located = _halve(self.linkage, distances, *ends, self.dimensions)
        return np.asarray(located)[: changes.size]
