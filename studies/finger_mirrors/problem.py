"""The problem: see everything in every posture despite all errors, with little mirror."""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.numerics import as_float
from designopt.optimising import Problem, Requirement, Terms
from optics.scene import Scene
from optics.visibility import find_coverage, find_views
from studies.finger_linkage.body import BodySpec
from studies.finger_mirrors.arrangement import (
    Arrangement,
    bounds,
    camera_body,
    finger_scene,
    scale,
    scene_of,
)
from studies.finger_mirrors.errors import Errors, spread_evenly, with_errors
from studies.finger_mirrors.seeing import least_resolution, missing, pad_lengths, together
from studies.finger_mirrors.spec import MirrorSpec

NOMINAL = 31
"""Postures in which the arrangement without errors is looked at, evenly over the range."""

RESERVE = 1.08
"""Resolution is asked for with so much to spare, for it is asked for at a few places of a pad and
every third degree: with 1.04, six of nine starts fell short of it by up to 3 % between these."""

CLEARANCE_SCALE = 10.0
"""A clearance that is missing by so much, mm, counts as 1."""

GOLDEN = (math.sqrt(5) - 1) / 2


class Task(eqx.Module):
    """All that the problem is made of, as arrays: one compiled program serves all tasks of a size.

    Attributes:
        finger: the scene that arrangements are put into.
        errors: of every copy.
        angles: joint angles of every copy's postures, rad.
        nominal: joint angles without errors, rad.
        floor: least resolution, px/mm.
        mirror_weight: price of 10 mm of mirror, in % of a pad that is not seen.
        width: of the camera's body, mm.
        clearance: of the mirrors from it, mm.
    """

    finger: Scene
    errors: Errors
    angles: Float[Array, "copies poses"]
    nominal: Float[Array, " nominal"]
    floor: Float[Array, ""] = eqx.field(converter=as_float)
    mirror_weight: Float[Array, ""] = eqx.field(converter=as_float)
    width: Float[Array, ""] = eqx.field(converter=as_float)
    clearance: Float[Array, ""] = eqx.field(converter=as_float)

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
        errors = spread_evenly(spec.tolerances, search.copies, seed) * search.spread * growth
        angles = np.deg2rad(copies_angles_deg(body.range_deg, search.copies, search.poses))
        return cls(
            finger=finger_scene(body, spec),
            errors=Errors.of(jnp.asarray(errors)),
            angles=jnp.asarray(angles),
            nominal=jnp.deg2rad(jnp.linspace(0.0, body.range_deg, NOMINAL)),
            floor=spec.floor,
            mirror_weight=spec.search.mirror_weight,
            width=spec.camera.width,
            clearance=spec.room.clearance,
        )


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


def robust_shortfall(arrangement: Arrangement, task: Task) -> Float[Array, ""]:
    """Part of a pad that the copies do not see, mean over copies and poses, summed over pads."""

    def of_copy(copy: tuple[Errors, Float[Array, " poses"]]) -> Float[Array, ""]:
        errors, angles = copy
        scene = scene_of(with_errors(arrangement, errors), task.finger)
        hidden = 1 - find_coverage(scene, together(angles)).value
        return jnp.mean(jnp.sum(hidden, axis=-1))

    # One copy after the other: their poses together would leave the cache.
    return jnp.mean(jax.lax.map(of_copy, (task.errors, task.angles)))


def clearances(arrangement: Arrangement, task: Task) -> Float[Array, "2"]:
    """Room between the camera's body and the near ends of the proximal and distal mirror, mm.

    Measured along x in the straight finger. Flexion only turns these ends away: a place (x, y)
    with y > 0 of the proximal phalanx goes towards −x, of the distal one towards +x.
    """
    body = camera_body(arrangement, task.width)
    near = arrangement.distal[0, 0] + task.finger.hinges[1, 0]
    left = jnp.minimum(body[0, 0], body[1, 0]) - arrangement.proximal[0, 0]
    return jnp.stack([left, near - jnp.maximum(body[0, 0], body[1, 0])])


def terms_of(arrangement: Arrangement, task: Task) -> Terms:
    """Objective and inequalities (≥ 0) of an arrangement, all of order one; differentiable.

    The objective is, in % of a pad: what the copies do not see, what is not seen without errors,
    and the price of the mirrors. ``resolution`` has the shape (poses, pads), ``clearance`` (2,).
    """
    scene = scene_of(arrangement, task.finger)
    views = find_views(scene, together(task.nominal))
    nominal = jnp.mean(jnp.sum(missing(views), axis=-1))
    objective = (
        100 * robust_shortfall(arrangement, task)
        + 100 * nominal
        + task.mirror_weight * jnp.sum(arrangement.lengths) / 10
    )
    sharp = least_resolution(views.value, pad_lengths(scene))
    return Terms(
        objective=objective,
        inequalities={
            "resolution": sharp / (RESERVE * task.floor) - 1,
            "clearance": (clearances(arrangement, task) - task.clearance) / CLEARANCE_SCALE,
        },
    )


def problem_of(body: BodySpec, spec: MirrorSpec, task: Task) -> Problem:
    """The problem in the form that all solvers take."""
    least, greatest = bounds(body, spec)
    pads = [pad.name for pad in task.finger.layout.pads]
    degrees = np.rad2deg(task.nominal)
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
