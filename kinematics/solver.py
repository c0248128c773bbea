"""What all evaluations of a linkage share: its plan, its units, and the state of one pose."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from kinematics.evaluation import Drive, State, evaluate
from kinematics.following import Followed, close, follow, home_unknowns, solve_iterated, split
from kinematics.linkage import Linkage
from kinematics.plan import Plan, make_plan
from kinematics.structure import WORLD
from kinematics.vectors import Vector


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
        home = _in_units(linkage, jnp.asarray(linkage.home.inputs, dtype), size)
        return cls(linkage, unit, size, plan, signs, home)

    def drive(self, inputs: Float[Array, "*batch inputs"]) -> Drive:
        """The drive for inputs in rad or mm."""
        return Drive.at(_in_units(self.linkage, inputs, self.size))

    def state(self, drive: Drive, towards: Mapping[int, Vector] | None = None) -> State:
        """Everything about one pose; ``towards`` as in `evaluation.evaluate`."""
        unknowns = {}
        if self.plan.iterated:
            unknowns = solve_iterated(
                self.unit, self.plan, drive.values, self.signs, self._start()
            )
        return evaluate(self.unit, self.plan, drive, self.signs, unknowns, towards or {})

    def followed(self, drive: Drive) -> Followed | None:
        """Where the iterated groups are, without derivatives; none if there is no such group."""
        if not self.plan.iterated:
            return None
        return follow(self.unit, self.plan, drive.values, self.signs, self._start())

    def state_near(self, drive: Drive, followed: Followed | None) -> State:
        """As `state`, but from iterated groups that were followed already; without margins."""
        unknowns = {}
        if followed is not None:
            solved = close(self.unit, self.plan, drive.values, self.signs, followed.unknowns)
            unknowns = {group: (part, ()) for group, part in split(self.plan, solved).items()}
        return evaluate(self.unit, self.plan, drive, self.signs, unknowns, {})

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
            {index: slide * size for index, slide in state.slides.items()},
            {
                index: tuple(margin * size for margin in margins)
                for index, margins in state.margins.items()
            },
        )

    def _start(self) -> tuple[Float[Array, " inputs"], Float[Array, " unknowns"]]:
        return self.home, home_unknowns(self.linkage, self.plan, self.size)


def _in_units(
    linkage: Linkage, inputs: Float[Array, "*batch inputs"], size: Float[Array, ""]
) -> Float[Array, "*batch inputs"]:
    """Inputs with slides in units of the linkage's size instead of mm."""
    if all(part.slider is None for part in linkage.structure.inputs):
        return inputs
    one = jnp.ones_like(size)
    units = [one if part.slider is None else size for part in linkage.structure.inputs]
    return inputs / jnp.broadcast_to(jnp.stack(units), inputs.shape)
