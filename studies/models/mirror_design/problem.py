"""The problem: see everything in every posture despite all errors, with little mirror."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from designopt.numerics import as_float
from designopt.optimize import Evaluation, Problem, Requirement
from optics.visibility.coverage import find_views
from studies.models.finger import Finger, camera_of
from studies.models.finger_parts import PHALANGES
from studies.models.mirror_design.clearances import dorsal_room, find_clearances
from studies.models.mirror_design.errors import perturb, spread_evenly
from studies.models.mirror_design.placement import Placement, bounds, scale
from studies.models.mirror_design.postures import GOLDEN
from studies.models.mirror_design.seeing import (
    hidden_penalty,
    least_resolution,
    pad_lengths,
)
from studies.models.mirror_design.spec import MirrorSpec

PLAIN = 46
"""Least number of postures in which the finger without errors is looked at, over its range."""

RESERVE = 1.08
"""Resolution is asked for with so much to spare, for the search looks at every second degree: where
one view hands over to the other it dips within a degree or two, by 4 % between these."""

HIDDEN_SCALE = 0.1
"""A part of a pad that is not seen without errors, and counts as 1."""

CLEARANCE_SCALE = 2.0
"""A clearance that is missing by so much, mm, counts as 1. With 10 mm searches left up to 0.09 mm
unmet, more than `CLEARANCE_RESERVE`."""


CLEARANCE_RESERVE = 0.05
"""Clearances are asked for with so much to spare, mm: what the search leaves unmet, and what they
are less between its angles."""


class Task(eqx.Module):
    """All that the problem is made of, as arrays: one compiled program serves all tasks of a size.

    It is made of looks: one look is at one finger, with errors or without, in a few postures.

    Attributes:
        finger: whose camera and mirrors are placed.
        errors: of the finger of every look, in the order of `errors.error_names`; 0 in the first
            ones.
        angles: PIP and DIP in every look's postures, rad: all pairs of each joint's angles are
            looked at sooner or later, by one look or another.
        floor: least resolution, px/mm.
        mirror_weight: price of 10 mm of mirror, in % of a pad that is not seen.
        clearance: of mirrors and mounts from all else, mm.
        plain: number of looks without errors; those that follow are at one copy each.
    """

    finger: Finger
    errors: Float[Array, "looks errors"]
    angles: Float[Array, "looks poses 2"]
    floor: Float[Array, ""] = eqx.field(converter=as_float)
    mirror_weight: Float[Array, ""] = eqx.field(converter=as_float)
    clearance: Float[Array, ""] = eqx.field(converter=as_float)
    plain: int = eqx.field(static=True)

    @classmethod
    def of(cls, finger: Finger, spec: MirrorSpec, seed: int, growth: float = 1.0) -> Task:
        """The task of a finger.

        Args:
            finger: with some layout.
            spec: camera, room, tolerances and how to search.
            seed: of the copies' errors.
            growth: of the copies' errors, beyond `SearchSpec.spread`.
        """
        search, ends = spec.search, np.deg2rad(finger.body.ranges_deg)
        plain = math.ceil(PLAIN / search.poses)
        even = np.linspace(0.0, 1.0, plain * search.poses).reshape(search.poses, plain).T
        own = spread_angles(search.copies, search.poses)
        errors = spread_evenly(spec.tolerances, len(finger.mirrors), search.copies, seed)
        errors = errors * search.spread * growth
        return cls(
            finger=finger,
            errors=jnp.asarray(np.pad(errors, ((plain, 0), (0, 0)))),
            angles=jnp.asarray(ends * np.concatenate([in_pairs(even), in_pairs(own)])),
            floor=spec.floor,
            mirror_weight=spec.search.mirror_weight,
            clearance=spec.room.clearance,
            plain=plain,
        )

    @property
    def copies(self) -> int:
        """How many copies with errors are looked at."""
        return len(self.angles) - self.plain

    def looking_at(self, postures: Float[np.ndarray, "worst 2"], number: int) -> Task:
        """The same with other postures (PIP and DIP, rad) in one of the looks without errors."""
        own = np.resize(postures, self.angles.shape[1:])
        return replace(self, angles=self.angles.at[number].set(own))

    def first(self, copies: int) -> Task:
        """The same with the first copies only."""
        looks = self.plain + copies
        return replace(self, errors=self.errors[:looks], angles=self.angles[:looks])


def spread_angles(copies: int, poses: int) -> Float[np.ndarray, "copies poses"]:
    """Angles of every copy's postures over the range: even, of each copy shifted by another part.

    All copies together look at ``copies · poses`` different angles, so none is missed for long.
    """
    step = 1 / (poses - 1)
    shift = (np.arange(copies) * GOLDEN + 0.5) % 1 - 0.5
    even = np.linspace(0, 1, poses)
    return np.clip(even[None] + step * shift[:, None], 0, 1)


def in_pairs(angles: Float[np.ndarray, "looks poses"]) -> Float[np.ndarray, "looks poses 2"]:
    """Angles of both joints: in each look those of DIP are PIP's, turned by the look's number."""
    looks, poses = angles.shape
    turned = (np.arange(poses) + np.arange(looks)[:, None]) % poses
    return np.stack([angles, np.take_along_axis(angles, turned, axis=1)], axis=-1)


class Look(NamedTuple):
    """What one look shows.

    Attributes:
        missing: part of a pad that is not seen (`hidden_penalty`), mean over postures, summed
            over pads.
        levels: of the inequalities (≥ 0) by name: ``coverage``, which only 0 meets, and
            ``resolution``.
    """

    missing: Float[Array, ""]
    levels: dict[str, Float[Array, "poses pads"]]


def look(placement: Placement, task: Task, number: Int[Array, ""]) -> Look:
    """One look of a task at a placement."""
    scene = perturb(put_in(placement, task.finger), task.errors[number]).scene()
    views = find_views(scene, task.angles[number])
    sharp = least_resolution(views.value, pad_lengths(scene))
    hidden = hidden_penalty(views)
    levels = {"coverage": -hidden / HIDDEN_SCALE, "resolution": sharp / (RESERVE * task.floor) - 1}
    return Look(jnp.mean(jnp.sum(hidden, axis=-1)), levels)


def put_in(placement: Placement, finger: Finger) -> Finger:
    """The finger with a placement, its camera so deep that its body is inside the back's wall."""
    made = eqx.combine(placement, finger)
    camera = camera_of(made)
    deeper = camera.depth + jnp.maximum(-dorsal_room(made), 0.0)
    return replace(made, camera=replace(camera, depth=deeper))


def cost_and_clearance(
    placement: Placement, task: Task
) -> tuple[Float[Array, ""], Float[Array, " clearances"]]:
    """Mirror-length penalty and clearance constraints (≥ 0); neither needs ray tracing.

    The latter are in the order of `clearance_names`.
    """
    lengths = [mirror.length for mirror in placement.mirrors]
    cost = task.mirror_weight * jnp.sum(jnp.asarray(lengths)) / 10
    made = put_in(placement, task.finger)
    room = jnp.asarray([*find_clearances(made).values()])
    return cost, (room - task.clearance - CLEARANCE_RESERVE) / CLEARANCE_SCALE


def clearance_names(finger: Finger) -> list[str]:
    """What is kept clear of what, in words."""
    return [*jax.eval_shape(find_clearances, finger)]


def terms_of(placement: Placement, task: Task) -> Evaluation:
    """Objective and inequalities (≥ 0) of a placement, all of order one; differentiable.

    The objective is, in % of a pad: what the copies do not see, what is not seen without errors,
    and the price of the mirrors. ``coverage`` and ``resolution`` have the shape (poses, pads) over
    the looks without errors, ``clearance`` that of `clearance_names`.
    """
    # One look after the other: all postures together would leave the cache.
    looks = jax.lax.map(lambda number: look(placement, task, number), jnp.arange(len(task.angles)))
    cost, clearance = cost_and_clearance(placement, task)
    hidden = jnp.mean(looks.missing[: task.plain]) + jnp.mean(looks.missing[task.plain :])
    own = {
        name: level[: task.plain].reshape(-1, level.shape[-1])
        for name, level in looks.levels.items()
    }
    return Evaluation(objective=100 * hidden + cost, inequalities=own | {"clearance": clearance})


def problem_of(spec: MirrorSpec, task: Task) -> Problem:
    """The problem in the form that all solvers take."""
    least, greatest = bounds(task.finger, spec)
    degrees = np.rad2deg(task.angles[: task.plain]).reshape(-1, 2)

    def of_pad(what: str, at: tuple[int, ...]) -> str:
        pip, dip = degrees[at[0]]
        return f"{what} of the {PHALANGES[at[1]]} pad at PIP {pip:g}°, DIP {dip:g}°"

    names = clearance_names(task.finger)

    def clearance(at: tuple[int, ...]) -> str:
        return f"clearance: {names[at[0]]}"

    requirements = {
        "coverage": Requirement(partial(of_pad, "coverage"), "%", 100 * HIDDEN_SCALE),
        "resolution": Requirement(partial(of_pad, "resolution"), "px/mm", RESERVE * spec.floor),
        "clearance": Requirement(clearance, "mm", CLEARANCE_SCALE),
    }
    return Problem(terms_of, least, greatest, scale(task.finger), requirements, data=(task,))
