"""Run a plan for one pose: array code without a branch, in units of the linkage's size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.vectors import Vector, rotation
from kinematics.model.linkage import Linkage
from kinematics.model.loops import Loop
from kinematics.model.topology import WORLD, Incidence
from kinematics.solve.dyads import solve_rpr, solve_rrp, solve_rrr, solve_two_slides
from kinematics.solve.steps import Group, Placement, Plan, Turn

Scalar = Float[Array, ""]


class Drive(eqx.Module):
    """What drives a pose.

    Attributes:
        values: values of the inputs, rad or units of the linkage's size.
        turns: their cosines and sines, for the inputs that are angles.
        home: values of the sketch.
    """

    values: Float[Array, "*batch inputs"]
    turns: Vector
    home: Float[Array, " inputs"]

    @classmethod
    def at(cls, values: Float[Array, "*batch inputs"], home: Float[Array, " inputs"]) -> Drive:
        """The drive for these values of the inputs, sketched at ``home``."""
        return cls(values, rotation(values), home)

    @property
    def back(self) -> Float[Array, "*batch inputs"]:
        """+1 or −1, the direction in which each goes back to the sketch; 0 if it is there."""
        # At a change point the pose has a limit from each side; of these the one on the way from
        # the sketch is meant, and a sign has no derivative.
        return jax.lax.stop_gradient(jnp.sign(self.home - self.values))


@dataclass
class State:
    """What is known of a pose so far; filled in the order of the plan.

    Attributes:
        linkage: its dimensions, `Linkage.scaled`.
        plan: the plan that is being run.
        drive: the inputs.
        rotations: direction of bodies whose angle is known.
        places: joints whose place is known.
        slides: sliders whose place is known.
        margins: margins of solved groups.
        swings: how placed joints move when the inputs go back to the sketch, as far as the inputs
            move them directly; it decides where two pins coincide.
        gaps: what is missing in the loops of iterated groups.
        solved: rotations found by groups that are solved in the frame of a body.
    """

    linkage: Linkage
    plan: Plan
    drive: Drive
    rotations: dict[str, Vector] = field(default_factory=dict)
    places: dict[str, Vector] = field(default_factory=dict)
    slides: dict[int, Scalar] = field(default_factory=dict)
    margins: dict[int, tuple[Scalar, ...]] = field(default_factory=dict)
    swings: dict[str, Vector] = field(default_factory=dict)
    gaps: dict[int, list[Vector]] = field(default_factory=dict)
    solved: dict[tuple[int, int], Vector] = field(default_factory=dict)

    def set_angle(self, root: str, direction: Vector) -> None:
        """Record a root's rotation, and with it that of every body that turns with it."""
        for body, orientation in self.plan.orientations.items():
            if orientation.root == root:
                self.rotations[body] = direction.turned(self.relative(body))

    def relative(self, body: str, after: int = 0) -> Vector:
        """The rotation of a body relative to its root, or by its turns from ``after`` on."""
        result = self.identity
        for turn in self.plan.orientations[body].turns[after:]:
            result = result.turned(self._turn(turn))
        return result

    def unknown(self, group: Group, body: str) -> tuple[str | None, Vector]:
        """Which of a group's angles turns a body, and its rotation by what is known besides."""
        orientation = self.plan.orientations[body]
        if group.base is None:
            if body in self.rotations:
                return None, self.rotations[body]
            return orientation.root, self.relative(body)
        for number, turn in enumerate(orientation.turns):
            if turn.solved is not None and turn.solved[0] == group.index:
                return group.angles[turn.solved[1]], self.relative(body, number + 1)
        return None, self.relative(body)

    @property
    def identity(self) -> Vector:
        """The rotation by 0."""
        one = jnp.ones_like(self.linkage.anchors[0, 0])
        return Vector(one, jnp.zeros_like(one))

    @property
    def zero(self) -> Vector:
        """The zero vector."""
        zero = jnp.zeros_like(self.linkage.anchors[0, 0])
        return Vector(zero, zero)

    def _turn(self, turn: Turn) -> Vector:
        if turn.input is not None:
            turns = self.drive.turns
            result = Vector(turns.x[turn.input], turns.y[turn.input])
        elif turn.solved is not None:
            result = self.solved[turn.solved]
        else:
            assert turn.slider is not None
            angle = self.linkage.lines[turn.slider].turn
            assert angle is not None
            result = rotation(angle)
        if turn.relative_to is not None:
            result = result.turned(self.linkage.fixed_direction(turn.relative_to))
        return result if turn.sign > 0 else result.conjugate()

    def direction(self, slider: int) -> Vector:
        """Direction of a slider's line in the frame of its body."""
        return rotation(self.linkage.lines[slider].angle)

    def at(self, incidence: Incidence) -> Vector:
        """Place of a joint in the frame of a body; of one whose slide is open, the line's point."""
        if incidence.slider is None:
            return self.linkage.place(incidence.body, incidence.joint)
        point = self.linkage.line_point(incidence.slider)
        if incidence.slider not in self.slides:
            return point
        return point + self.direction(incidence.slider).scaled(self.slides[incidence.slider])

    def carried(self, incidence: Incidence, reference: Incidence) -> Vector:
        """Place that a body of known pose gives to a joint, from another joint's place."""
        step = self.at(incidence) - self.at(reference)
        return self.places[reference.joint] + step.turned(self.rotations[incidence.body])


@dataclass
class Terms:
    """A loop taken apart: 0 = known + Σ (rotation of root) vector + Σ slide · direction.

    Attributes:
        known: what is known of it.
        vectors: for each root of unknown angle the vector in its frame.
        directions: for each unknown slide its direction and the root in whose frame it is
            given; none where the direction is known.
    """

    known: Vector
    vectors: dict[str, Vector]
    directions: dict[int, tuple[Vector, str | None]]


def loop_terms(state: State, group: Group, loop: Loop) -> Terms:
    """A loop's vectors, sorted by what is unknown in them."""
    zero = known = state.zero
    if loop.start is not None and loop.end is not None:
        # A loop from one placed joint to another: the rest of the chain between them is known
        # already and is left out, with its rounding.
        known = state.places[loop.start] - state.places[loop.end]
    vectors: dict[str, Vector] = {}
    directions: dict[int, tuple[Vector, str | None]] = {}
    for leg in loop.legs:
        root, turn = state.unknown(group, leg.body)
        step = (state.at(leg.end) - state.at(leg.start)).turned(turn)
        if root is None:
            known = known + step
        else:
            vectors[root] = vectors.get(root, zero) + step
        for incidence, sign in ((leg.end, 1), (leg.start, -1)):
            slider = incidence.slider
            if slider is not None and slider not in state.slides:
                along = state.direction(slider).turned(turn)
                directions[slider] = (along if sign > 0 else -along, root)
    return Terms(known, vectors, directions)


def evaluate(
    linkage: Linkage,
    plan: Plan,
    drive: Drive,
    signs: Float[Array, " groups"],
    unknowns: Mapping[int, tuple[Float[Array, "..."], tuple[Scalar, ...]]],
) -> State:
    """Run the plan for one pose.

    Args:
        linkage: its dimensions, `Linkage.scaled`.
        plan: what to solve.
        drive: the inputs.
        signs: assembly of each group.
        unknowns: for each iterated group its angles and slides, found elsewhere, and its margins.
    """
    state = State(linkage, plan, drive)
    for index, part in enumerate(linkage.structure.inputs):
        if part.slider is not None:
            state.slides[part.slider] = drive.values[index]
    state.set_angle(WORLD, state.identity)
    for joint in linkage.structure.fixed_joints:
        state.places[joint] = linkage.anchor(joint)
        state.swings[joint] = state.zero
    for step in plan.steps:
        if not isinstance(step, Group):
            state.places[step.at.joint] = state.carried(step.at, step.reference)
            state.swings[step.at.joint] = _swing(state, step)
        elif step.kind == "iterated":
            _take(state, step, *unknowns[step.index])
        else:
            _solve(state, step, signs[step.index])
    return state


def _swing(state: State, step: Placement) -> Vector:
    """How a joint moves with its body, when that is turned by inputs on their way back."""
    base = state.swings[step.reference.joint]
    rate = state.zero.x
    for turn in state.plan.orientations[step.at.body].turns:
        if turn.input is not None:
            rate = rate + turn.sign * state.drive.back[turn.input]
    arm = state.places[step.at.joint] - state.places[step.reference.joint]
    return base + arm.perpendicular().scaled(rate)


def _take(
    state: State, group: Group, values: Float[Array, "..."], margins: tuple[Scalar, ...]
) -> None:
    for index, root in enumerate(group.angles):
        state.set_angle(root, rotation(values[index]))
    for index, slider in enumerate(group.sliders, start=len(group.angles)):
        state.slides[slider] = values[index]
    state.margins[group.index] = margins
    state.gaps[group.index] = [loop_terms(state, group, loop).known for loop in group.loops]


def _solve(state: State, group: Group, side: Scalar) -> None:
    loop = group.loops[0]
    terms = loop_terms(state, group, loop)
    e, towards = -terms.known, state.zero
    if loop.start is not None and loop.end is not None:
        towards = state.swings[loop.end] - state.swings[loop.start]
    match group.kind:
        case "RRR":
            first, second = group.angles
            alpha, beta, margins = solve_rrr(
                e, terms.vectors[first], terms.vectors[second], side, towards
            )
            _record(state, group, (alpha, beta))
        case "RRP" | "RPR":
            (root,), (slider,) = group.angles, group.sliders
            along, _ = terms.directions[slider]
            if group.kind == "RRP":
                alpha, slide, margins = solve_rrp(e, terms.vectors[root], along, side)
            else:
                alpha, slide, margins = solve_rpr(e, terms.vectors[root], along, side, towards)
            _record(state, group, (alpha,))
            state.slides[slider] = slide
        case _:
            first, second = group.sliders
            v, w = terms.directions[first][0], terms.directions[second][0]
            s, t, margins = solve_two_slides(e, v, w, side)
            state.slides |= {first: s, second: t}
    state.margins[group.index] = margins


def _record(state: State, group: Group, found: tuple[Vector, ...]) -> None:
    for number, (root, turn) in enumerate(zip(group.angles, found, strict=True)):
        # In the frame of a body whose own angle comes later, the rotation is kept aside: all that
        # hangs on it is then one product, whatever turns that body.
        if group.base is None:
            state.set_angle(root, turn)
        else:
            state.solved[group.index, number] = turn


def group_columns(state: State, group: Group) -> list[list[Vector]]:
    """Derivative of each of a group's loops with respect to each of its unknowns, when solved.

    Returns:
        One list per loop, over the angles and then the sliders of the group.
    """
    rows = []
    for loop in group.loops:
        zero = Vector(*(jnp.zeros_like(state.identity.x),) * 2)
        row = dict.fromkeys((*group.angles, *group.sliders), zero)
        for leg in loop.legs:
            turn = state.rotations[leg.body]
            for root, bodies in zip(group.angles, group.turning, strict=True):
                if leg.body in bodies:
                    step = (state.at(leg.end) - state.at(leg.start)).turned(turn)
                    row[root] = row[root] + step.perpendicular()
            for incidence, sign in ((leg.end, 1), (leg.start, -1)):
                if incidence.slider in row:
                    along = state.direction(incidence.slider).turned(turn)
                    row[incidence.slider] = row[incidence.slider] + (along if sign > 0 else -along)
        rows.append(list(row.values()))
    return rows


def closure(state: State) -> Scalar:
    """Largest gap between the places two bodies give to one joint, or stretch of a body.

    In units of the linkage's size, recomputed from the pose alone, whatever solved it.
    """
    worst = jnp.zeros_like(state.identity.x)
    bases: dict[str, Incidence] = {}
    for incidence in state.linkage.structure.incidences:
        body = incidence.body
        open_slide = incidence.slider is not None and incidence.slider not in state.slides
        if body not in state.rotations or incidence.joint not in state.places or open_slide:
            continue
        if body not in bases:
            bases[body] = incidence
            continue
        step = state.at(incidence) - state.at(bases[body])
        turn = state.rotations[body]
        gap = state.carried(incidence, bases[body]) - state.places[incidence.joint]
        # A rotation that is none (|turn| ≠ 1) is a stretched body: a closed form may close its
        # loop so where the linkage cannot be assembled.
        stretch = jnp.abs(turn.squared() - 1.0) * step.length() / 2
        worst = jnp.maximum(worst, jnp.maximum(gap.length(), stretch))
    return worst
