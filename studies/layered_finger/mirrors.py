"""Other mirrors, and another place of the camera, for a finger whose pads have layers.

The problem of `studies.models.mirror_design` looks at bare pads. This one has the same places that
are free and the same bounds, and asks for the least coverage of every pad over the postures, of a
finger without errors; no resolution is asked for.
"""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.optimize import Evaluation, Minimizer, Problem
from optics import Layout, Scene, find_coverage
from studies.models.finger import Finger
from studies.models.mirror_design.placement import (
    Placement,
    bounds,
    free_part,
    reference_layout,
    scale,
)
from studies.models.mirror_design.seeing import together
from studies.models.mirror_design.spec import FOV_DEG, CameraSpec, MirrorSpec

ANGLES = 31
"""Angles of both joints, bent alike, at which the search looks."""

TEMPERATURES = (0.05, 0.01, 0.002)
"""Of the soft minimum over postures, one after the other, in parts of a pad."""

PART = 0.1
"""Of a pad, that counts as 1."""

CLEARANCE_SCALE = 10.0
"""A clearance that is missing by so much, mm, counts as 1."""

KEPT_FREE = 5.0
"""Camera and mirrors stay so far from the membranes, besides their clearance: no layers are
thicker; mm."""

UPDATES, STEPS = 3, 100

LENS = CameraSpec(fov_deg=FOV_DEG)
"""Of the bare finger."""

STARTS = 2
"""The finger as it is, and the reference layout."""


class Task(NamedTuple):
    """What the search is given.

    Attributes:
        finger: whose camera and mirrors are placed.
        scene: its pads with their layers, and the field of view.
        poses: joint angles, rad.
        temperature: one of `TEMPERATURES`.
    """

    finger: Finger
    scene: Scene
    poses: Float[Array, "poses joints"]
    temperature: Float[Array, ""]


def placed(finger: Finger, scene: Scene) -> Scene:
    """A scene with the camera and the mirrors of a finger where they are in it."""
    own = finger.scene()
    place = {"position": own.camera.position, "direction": own.camera.direction}
    camera = replace(scene.camera, **place)
    return replace(scene, camera=camera, mirrors=own.mirrors, blockers=own.blockers)


def beside_camera(finger: Finger) -> Float[Array, "2"]:
    """Room between the camera's body and the near ends of the proximal and distal mirror, mm.

    Measured along x in the straight finger. Flexion only turns these ends away: a place (x, y)
    with y > 0 of the proximal phalanx goes towards −x, of the distal one towards +x.
    """
    body, (distal, proximal) = finger.camera_corners()[:, 0], finger.mirrors
    near = distal.ends[0, 0] + finger.body.intermediate
    return jnp.stack([jnp.min(body) - proximal.ends[0, 0], near - jnp.max(body)])


def terms(placement: Placement, task: Task) -> Evaluation:
    """Soft minimum over postures of what is hidden, summed over pads; and clearances."""
    finger = eqx.combine(placement, task.finger)
    seen = find_coverage(placed(finger, task.scene), task.poses).value
    hidden = task.temperature * jax.nn.logsumexp((1 - seen) / task.temperature, axis=0)
    room = beside_camera(finger) - MirrorSpec().room.clearance
    inequalities = {"clearance": room / CLEARANCE_SCALE}
    return Evaluation(objective=jnp.sum(hidden) / PART, inequalities=inequalities)


class Redesigner:
    """The search from two starts: the finger as it is, and the reference layout.

    Programs are compiled once for all layers of a kind.
    """

    def __init__(self, finger: Finger) -> None:
        spec = MirrorSpec()
        thinner = replace(finger.body, thickness=finger.body.thickness - KEPT_FREE)
        self._finger, self._limits = finger, bounds(replace(finger, body=thinner), spec)
        both = [free_part(one) for one in (finger, reference_layout(finger, LENS))]
        self._starts: Placement = jax.tree.map(lambda *leaves: jnp.stack(leaves), *both)
        angles = jnp.linspace(0.0, finger.body.flexion, ANGLES)
        self._poses = together(angles)
        self._solvers: dict[Layout, Minimizer] = {}

    def redesigned(self, scene: Scene) -> Scene:
        """The scene with camera and mirrors where most is seen at worst.

        Of both starts the one with the greater sum of the pads' worst coverages.
        """
        starts: Any = self._starts
        for temperature in TEMPERATURES:
            task = Task(self._finger, scene, self._poses, jnp.asarray(temperature))
            optima = self._solver(task).solve(starts, self._problem(task))
            ends = [one.parameters for one in optima.found]
            starts = jax.tree.map(lambda *leaves: jnp.stack(leaves), *ends)
        both = [jax.tree.map(itemgetter(i), starts) for i in range(STARTS)]
        scenes = [placed(eqx.combine(one, self._finger), scene) for one in both]
        worst = [np.min(find_coverage(one, self._poses).value, axis=0).sum() for one in scenes]
        return scenes[int(np.argmax(worst))]

    def _solver(self, task: Task) -> Minimizer:
        layout = task.scene.layout
        if layout not in self._solvers:
            caps: Any = {"tolerance": 1e-6, "updates": UPDATES, "steps": STEPS}
            self._solvers[layout] = Minimizer(self._problem(task), STARTS, **caps)
        return self._solvers[layout]

    def _problem(self, task: Task) -> Problem:
        return Problem(terms, *self._limits, scale(self._finger), data=(task,))
