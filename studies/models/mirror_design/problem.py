"""The problem: see everything in every posture despite all errors, with little mirror."""

from __future__ import annotations

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from designopt.numerics import as_float
from designopt.optimize import Problem, Requirement, Terms
from optics.scene.scene import Scene
from optics.visibility.coverage import find_views
from studies.models.body import BodySpec
from studies.models.mirror_design.arrangement import (
    Arrangement,
    bounds,
    camera_body,
    finger_scene,
    scale,
    scene_of,
)
from studies.models.mirror_design.errors import Errors, spread_evenly, with_errors
from studies.models.mirror_design.seeing import least_resolution, missing, pad_lengths, together
from studies.models.mirror_design.spec import MirrorSpec

PLAIN = 46
"""Least number of postures in which the finger without errors is looked at, over its range."""

RESERVE = 1.08
"""Resolution is asked for with so much to spare, for the search looks at every second degree: where
one view hands over to the other it dips within a degree or two, by 4 % between these."""

CLEARANCE_SCALE = 10.0
"""A clearance that is missing by so much, mm, counts as 1."""

GOLDEN = (math.sqrt(5) - 1) / 2


class Task(eqx.Module):
    """All that the problem is made of, as arrays: one compiled program serves all tasks of a size.

    It is made of looks: one look is at one finger, with errors or without, in a few postures.

    Attributes:
        finger: the scene that arrangements are put into.
        errors: of the finger of every look; none in the first ones.
        angles: joint angles of every look's postures, rad.
        floor: least resolution, px/mm.
        mirror_weight: price of 10 mm of mirror, in % of a pad that is not seen.
        width: of the camera's body, mm.
        clearance: of the mirrors from it, mm.
        plain: number of looks without errors; those that follow are at one copy each.
    """

    finger: Scene
    errors: Errors
    angles: Float[Array, "looks poses"]
    floor: Float[Array, ""] = eqx.field(converter=as_float)
    mirror_weight: Float[Array, ""] = eqx.field(converter=as_float)
    width: Float[Array, ""] = eqx.field(converter=as_float)
    clearance: Float[Array, ""] = eqx.field(converter=as_float)
    plain: int = eqx.field(static=True)

    @classmethod
    def of(cls, body: BodySpec, spec: MirrorSpec, seed: int, growth: float = 1.0) -> Task:
        """The task of a body.

        Args:
            body: the finger's body.
            spec: camera, room, tolerances and how to search.
            seed: of the copies' errors.
            growth: of the copies' errors, beyond `SearchSpec.spread`.
        """
        search = spec.search
        plain = math.ceil(PLAIN / search.poses)
        even = np.linspace(0.0, body.range_deg, plain * search.poses).reshape(plain, -1)
        own = copies_angles_deg(body.range_deg, search.copies, search.poses)
        errors = spread_evenly(spec.tolerances, search.copies, seed) * search.spread * growth
        none = np.zeros((plain, errors.shape[1]))
        return cls(
            finger=finger_scene(body, spec),
            errors=Errors.of(jnp.asarray(np.concatenate([none, errors]))),
            angles=jnp.asarray(np.deg2rad(np.concatenate([even, own]))),
            floor=spec.floor,
            mirror_weight=spec.search.mirror_weight,
            width=spec.camera.width,
            clearance=spec.room.clearance,
            plain=plain,
        )

    @property
    def copies(self) -> int:
        """How many copies with errors are looked at."""
        return len(self.angles) - self.plain

    def first(self, copies: int) -> Task:
        """The same with the first copies only."""
        looks = self.plain + copies
        kept = jax.tree.map(lambda leaf: leaf[:looks], (self.errors, self.angles))
        return eqx.tree_at(lambda task: (task.errors, task.angles), self, kept)


def copies_angles_deg(
    range_deg: float, copies: int, poses: int
) -> Float[np.ndarray, "copies poses"]:
    """Angles of every copy's postures, degrees: even, and of each copy shifted by another part.

    All copies together look at ``copies · poses`` different angles, so none is missed for long.
    """
    step = range_deg / (poses - 1)
    shift = (np.arange(copies) * GOLDEN + 0.5) % 1 - 0.5
    even = np.linspace(0, range_deg, poses)
    return np.clip(even[None] + step * shift[:, None], 0, range_deg)


class Look(NamedTuple):
    """What one look shows.

    Attributes:
        missing: part of a pad that is not seen (`seeing.missing`), mean over postures, summed over
            pads.
        resolution: level of the inequality (≥ 0).
    """

    missing: Float[Array, ""]
    resolution: Float[Array, "poses pads"]


def look(arrangement: Arrangement, task: Task, number: Int[Array, ""]) -> Look:
    """One look of a task at an arrangement."""
    errors = jax.tree.map(lambda leaf: leaf[number], task.errors)
    scene = scene_of(with_errors(arrangement, errors), task.finger)
    views = find_views(scene, together(task.angles[number]))
    sharp = least_resolution(views.value, pad_lengths(scene))
    hidden = jnp.mean(jnp.sum(missing(views), axis=-1))
    return Look(hidden, sharp / (RESERVE * task.floor) - 1)


def clearances(arrangement: Arrangement, task: Task) -> Float[Array, "2"]:
    """Room between the camera's body and the near ends of the proximal and distal mirror, mm.

    Measured along x in the straight finger. Flexion only turns these ends away: a place (x, y)
    with y > 0 of the proximal phalanx goes towards −x, of the distal one towards +x.
    """
    body = camera_body(arrangement, task.width)
    near = arrangement.distal[0, 0] + task.finger.hinges[1, 0]
    left = jnp.minimum(body[0, 0], body[1, 0]) - arrangement.proximal[0, 0]
    return jnp.stack([left, near - jnp.maximum(body[0, 0], body[1, 0])])


def upkeep(arrangement: Arrangement, task: Task) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """What needs no look: the price of the mirrors, and the level (≥ 0) of the clearances."""
    price = task.mirror_weight * jnp.sum(arrangement.lengths) / 10
    return price, (clearances(arrangement, task) - task.clearance) / CLEARANCE_SCALE


def terms_of(arrangement: Arrangement, task: Task) -> Terms:
    """Objective and inequalities (≥ 0) of an arrangement, all of order one; differentiable.

    The objective is, in % of a pad: what the copies do not see, what is not seen without errors,
    and the price of the mirrors. ``resolution`` has the shape (poses, pads) over the looks without
    errors, ``clearance`` (2,).
    """
    # One look after the other: all postures together would leave the cache.
    looks = jax.lax.map(
        lambda number: look(arrangement, task, number), jnp.arange(len(task.angles))
    )
    price, clearance = upkeep(arrangement, task)
    hidden = jnp.mean(looks.missing[: task.plain]) + jnp.mean(looks.missing[task.plain :])
    sharp = looks.resolution[: task.plain]
    return Terms(
        objective=100 * hidden + price,
        inequalities={
            "resolution": sharp.reshape(-1, sharp.shape[-1]),
            "clearance": clearance,
        },
    )


def problem_of(body: BodySpec, spec: MirrorSpec, task: Task) -> Problem:
    """The problem in the form that all solvers take."""
    least, greatest = bounds(body, spec)
    pads = [pad.name for pad in task.finger.layout.pads]
    degrees = np.rad2deg(task.angles[: task.plain]).ravel()
    mirrors = ("proximal", "distal")
    return Problem(
        terms_of,
        least,
        greatest,
        scale(),
        {
            "resolution": Requirement(
                lambda at: f"resolution of the {pads[at[1]]} pad at {degrees[at[0]]:g}°",
                "px/mm",
                RESERVE * spec.floor,
            ),
            "clearance": Requirement(
                lambda at: f"the {mirrors[at[0]]} mirror beside the camera's body",
                "mm",
                CLEARANCE_SCALE,
            ),
        },
        data=(task,),
    )
