"""What all evaluations of a linkage share: its plan, its units, and the state of one pose."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.vectors import Vector, rotation
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD
from kinematics.solve.continuation import (
    REACHED,
    Followed,
    home_unknowns,
    loop_gaps,
    newton_correct,
    solve_iterated,
    split,
    track,
)
from kinematics.solve.evaluation import Drive, State, evaluate
from kinematics.solve.plan import make_plan
from kinematics.solve.steps import Plan


class Pose(eqx.Module):
    """Where everything is.

    Attributes:
        joints: position of every joint, mm.
        bodies: direction of every body, a unit vector from its first towards its second joint.
        slides: place of each slider along its line, mm, by its number.
        margins: the margins of each group of the plan, by its number, mm.
    """

    joints: dict[str, Vector]
    bodies: dict[str, Vector]
    slides: dict[int, Float[Array, "*batch"]]
    margins: dict[int, tuple[Float[Array, "*batch"], ...]]

    def position(self, joint: str) -> Float[Array, "*batch 2"]:
        """Position of a joint, mm."""
        return self.joints[joint].stacked()

    def angle(self, body: str) -> Float[Array, "*batch"]:
        """Angle of a body, rad, −π to π."""
        return self.bodies[body].angle()


def each_pose(function: Callable[..., Any], *inputs: Float[Array, "*batch inputs"]) -> Any:
    """What a function of one pose's inputs returns for each of a batch of any shape."""
    batch = inputs[0].shape[:-1]
    found = jax.vmap(function)(*(part.reshape(-1, part.shape[-1]) for part in inputs))
    return jax.tree.map(lambda leaf: leaf.reshape(*batch, *leaf.shape[1:]), found)


class Solver(eqx.Module):
    """A linkage made ready for evaluation, with lengths in units of its size.

    Attributes:
        linkage: as it is, in mm.
        unit: `Linkage.scaled`.
        size: the unit, mm.
        plan: what is solved, and how.
        signs: assembly of each group of the whole plan.
        home: inputs of the assembled sketch, in units.
    """

    linkage: Linkage
    unit: Linkage
    size: Float[Array, ""]
    plan: Plan = eqx.field(static=True)
    signs: Float[Array, " groups"]
    home: Float[Array, " inputs"]

    @classmethod
    def of(
        cls,
        linkage: Linkage,
        dtype: Any,
        targets: Iterable[str] | None = None,
        signs: Float[Array, " groups"] | None = None,
    ) -> Solver:
        """A solver for what ``targets`` name, in the linkage's assembly or in ``signs``."""
        unit, size = linkage.scaled()
        plan = make_plan(linkage.structure, None if targets is None else frozenset(targets))
        if signs is None:
            signs = jnp.asarray(linkage.assembly, dtype)
        home = jax.lax.stop_gradient(_in_units(linkage, linkage.reference.inputs, size))
        return cls(linkage, unit, size, plan, signs, home)

    def drive(self, inputs: Float[Array, "*batch inputs"]) -> Drive:
        """The drive for inputs in rad or mm."""
        return Drive.at(_in_units(self.linkage, inputs, self.size), self.home)

    def state(self, drive: Drive) -> State:
        """Everything about one pose."""
        unknowns = {}
        followed = self.followed(drive)
        if followed is not None:
            unknowns = solve_iterated(self.unit, self.plan, drive.values, self.signs, followed)
        return evaluate(self.unit, self.plan, drive, self.signs, unknowns)

    def followed(self, drive: Drive) -> Followed | None:
        """Where the iterated groups are, without derivatives; none if there is no such group.

        They are followed from the sketch the shorter way round; where that locks, the other way.
        So a pose does not depend on how many turns an input has made, as in closed forms.
        """
        if not self.plan.iterated:
            return None
        begin = self.home, home_unknowns(self.linkage, self.plan, self.size)
        ways = jnp.stack(self._both_ways(drive))
        both = jax.vmap(lambda end: self.followed_from(begin, end))(ways)
        best = jnp.where((both.status[0] != REACHED) & (both.status[1] == REACHED), 1, 0)
        return jax.tree.map(lambda leaf: leaf[best], both)

    def followed_from(
        self,
        begin: tuple[Float[Array, " inputs"], Float[Array, " unknowns"]],
        end: Float[Array, " inputs"],
    ) -> Followed:
        """Where the iterated groups come from known inputs and unknowns, straight to others."""
        return track(self.unit, self.plan, end, self.signs, begin)

    def gaps(self, unknowns: Float[Array, " unknowns"], drive: Drive) -> Float[Array, " gaps"]:
        """What is missing in the loops of the iterated groups, in units."""
        return loop_gaps(self.unit, self.plan, unknowns, drive.values, self.signs)

    def jacobian(
        self, unknowns: Float[Array, " unknowns"], drive: Drive
    ) -> Float[Array, "gaps unknowns"]:
        """The derivatives of `gaps` with respect to the unknowns."""
        return jax.jacfwd(self.gaps)(unknowns, drive)

    def state_near(self, drive: Drive, followed: Followed | None) -> State:
        """As `state`, but from iterated groups that were followed already; without margins."""
        unknowns = {}
        if followed is not None:
            solved = newton_correct(
                self.unit, self.plan, drive.values, self.signs, followed.unknowns
            )
            unknowns = {group: (part, ()) for group, part in split(self.plan, solved).items()}
        return evaluate(self.unit, self.plan, drive, self.signs, unknowns)

    def pose(self, state: State) -> Pose:
        """The pose of a state in mm, in the world."""
        linkage, size = self.linkage, self.size
        bodies = {
            body.name: linkage.fixed_direction(body.name)
            for body in linkage.structure.bodies
            if body.fixed
        }
        bodies |= {name: turn for name, turn in state.rotations.items() if name != WORLD}
        return Pose(
            {name: place.scaled(size) + linkage.origin for name, place in state.places.items()},
            bodies,
            {
                index: slide * size - linkage.slide_shift(index)
                for index, slide in state.slides.items()
            },
            {
                index: tuple(margin * size for margin in margins)
                for index, margins in state.margins.items()
            },
        )

    def _both_ways(self, drive: Drive) -> tuple[Float[Array, " inputs"], Float[Array, " inputs"]]:
        """The inputs, by the shorter and by the longer way round from the sketch."""
        # From unit vectors: a difference of two large angles would lose digits.
        rest = drive.turns.turned(rotation(-self.home)).angle()
        other = rest - 2 * jnp.pi * jnp.where(rest > 0, 1.0, -1.0).astype(rest.dtype)
        angles = jnp.asarray([part.slider is None for part in self.linkage.structure.inputs])
        return (
            jnp.where(angles, self.home + rest, drive.values),
            jnp.where(angles, self.home + other, drive.values),
        )


def _in_units(
    linkage: Linkage, inputs: Float[Array, "*batch inputs"], size: Float[Array, ""]
) -> Float[Array, "*batch inputs"]:
    """Inputs with slides from the lines' feet, in units of the linkage's size, not in mm."""
    parts = linkage.structure.inputs
    if all(part.slider is None for part in parts):
        return inputs
    columns = [
        inputs[..., i]
        if part.slider is None
        else (inputs[..., i] + linkage.slide_shift(part.slider)) / size
        for i, part in enumerate(parts)
    ]
    return jnp.stack(columns, axis=-1)
