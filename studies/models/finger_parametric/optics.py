"""What is measured and required of a finger's camera, mirrors and pads."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.interpreter import interpret
from optics import find_focus, find_views
from studies.models.finger import Finger
from studies.models.finger_parametric.asking import Arrays, Asked, asking, measure_name
from studies.models.finger_parts import PHALANGES
from studies.models.mirror_design.clearances import clearance_checks, dorsal_room, find_clearances
from studies.models.mirror_design.errors import perturb, spread_evenly
from studies.models.mirror_design.postures import ROUNDING, look_up
from studies.models.mirror_design.problem import CLEARANCE_SCALE, HIDDEN_SCALE, clearance_names
from studies.models.mirror_design.requirements import COVERAGE, MEMBRANE, SHARPNESS
from studies.models.mirror_design.seeing import hidden_penalty, least_resolution, pad_lengths
from studies.models.mirror_design.spec import MirrorSpec
from studies.models.mirror_design.yields import postures

POSES = 12
"""Postures with both joints bent alike in which a design is evaluated, and as many in which one is
straight where the other is bent; it is judged at every degree."""

SPREAD, SEED = 1.0, 0
"""Size of the errors of assembly with which it is evaluated once more in each of these postures,
over the stated ones, and what they are drawn from. Coverage cannot be more than all: what is seen
with errors, another one in every posture, is seen between the postures as well."""

BLUR, WALL = "blur", "camera inside the wall of the back"

KNOWN = {SHARPNESS: "px_per_mm"}
"""Names of measures that people write, by the labels of their requirements."""


def own_mirrors(finger: Finger) -> MirrorSpec:
    """The demands of the settings on a finger of which only its file is known.

    With the blur that its camera accepts, and no longer membranes than it has: nothing that an
    optimization is free to change makes these longer.
    """
    spec = MirrorSpec()
    camera = finger.camera
    if camera is not None:
        given: dict[str, Any] = {"width": float(camera.width), "depth": float(camera.back)}
        if camera.max_blur is not None:
            given["max_blur_px"] = float(camera.max_blur)
        spec = spec.model_copy(update={"camera": spec.camera.model_copy(update=given)})
    membrane = float(interpret(lambda body: body.membrane, finger.body))
    least = min(spec.least_membrane, membrane)
    return spec.model_copy(update={"least_membrane": least})


class OpticsAspect:
    """Coverage, resolution, blur and clearances of a finger's optics over all its postures.

    The yield takes a minute and has no slope: it is not among them; but all must be seen with some
    errors of assembly, too.

    Attributes:
        asked: all measures.
        gaps: the clearances of mirrors and camera.
    """

    concerned: tuple[str, ...] = ("camera.", "mirrors.", "body.")

    def __init__(self, finger: Finger, spec: MirrorSpec) -> None:
        """Measures and requirements of the optics.

        Args:
            finger: with a camera.
            spec: what is asked for.
        """
        self._spec = spec
        even = np.linspace(0.0, 1.0, POSES)
        pairs = np.concatenate([np.stack([even, even]), np.stack([even, even[::-1]])], axis=1).T
        errors = spread_evenly(spec.tolerances, len(finger.mirrors), len(pairs), SEED)
        self._errors = np.concatenate([np.zeros_like(errors), SPREAD * errors])
        self._degrees = np.tile(pairs * finger.body.ranges_deg, (2, 1))
        self._focused = finger.camera is not None and finger.camera.lens is not None
        self._clearances = clearance_names(finger)
        self.gaps = dict.fromkeys((measure_name(one, KNOWN) for one in self._clearances), 0.0)
        self.asked = [*self._seen(), *self._room()]

    def _where(self, index: tuple[int, ...]) -> str:
        posture, *pads = index
        pip, dip = self._degrees[posture]
        pad = "".join(f" of the {PHALANGES[one]} pad" for one in pads)
        errors = ", with errors of assembly" if np.any(self._errors[posture]) else ""
        return f"{pad} at PIP {pip:.3g}°, DIP {dip:.3g}°{errors}".strip()

    def _seen(self) -> Iterable[Asked]:
        spec = self._spec

        def ask(
            label: str,
            limit: float | None,
            unit: str,
            scale: float,
            worst: Literal["least", "greatest"] = "least",
        ) -> Asked:
            limits = -math.inf, 1.0 if scale == HIDDEN_SCALE else math.inf
            return asking(
                label,
                limit,
                unit,
                worst,
                scale=scale,
                known=KNOWN,
                where=self._where,
                limits=limits,
            )

        yield ask(COVERAGE, 1.0, "", HIDDEN_SCALE)
        for pad in PHALANGES:
            yield ask(f"{COVERAGE}.{pad}", None, "", HIDDEN_SCALE)
        yield ask(SHARPNESS, spec.floor, "px/mm", spec.floor)
        if self._focused:
            most = spec.camera.max_blur_px
            yield ask(BLUR, most, "px", most, "greatest")

    def _room(self) -> Iterable[Asked]:
        clearance = self._spec.room.clearance
        limits = dict.fromkeys(self._clearances, clearance)
        limits |= {WALL: 0.0, MEMBRANE: self._spec.least_membrane}
        for label, limit in limits.items():
            yield asking(label, limit, scale=CLEARANCE_SCALE, known=KNOWN)

    def evaluate(self, finger: Finger, of: frozenset[str]) -> Arrays:
        """Measures in some postures, by the functions of the search."""
        found: Arrays = {WALL: dorsal_room(finger), MEMBRANE: finger.body.membrane}
        named = {asked.measure.name: asked.label for asked in self.asked}
        wanted = {named[name] for name in of if name in named}
        if wanted & {*self._clearances}:
            found |= find_clearances(finger)
        if wanted - {*self._clearances, WALL, MEMBRANE}:
            seen = partial(self._look, finger, BLUR in wanted)
            poses = jnp.deg2rad(jnp.asarray(self._degrees))
            found |= jax.vmap(seen)(jnp.asarray(self._errors), poses)
            found |= {f"{COVERAGE}.{pad}": found[COVERAGE][:, i] for i, pad in enumerate(PHALANGES)}
        return {measure_name(label, KNOWN): values for label, values in found.items()}

    def _look(
        self,
        finger: Finger,
        blurred: bool,
        errors: Float[Array, " errors"],
        pose: Float[Array, "2"],
    ) -> Arrays:
        """What one finger with errors of assembly shows in one posture."""
        scene = perturb(finger, errors).scene()
        views = find_views(scene, pose)
        found = {COVERAGE: 1 - hidden_penalty(views)}
        found[SHARPNESS] = least_resolution(views.value, pad_lengths(scene))
        if blurred:
            found[BLUR] = jnp.max(find_focus(scene, views.value).blur, axis=(-2, -1))
        return found

    def judge(self, finger: Finger) -> dict[str, float]:
        """Every measure, at every degree of both joints.

        Both joints bent alike, then each degree of PIP with another one of DIP, as for fingers with
        errors; clearances at all pairs of degrees. A place on a pad is looked up in its best view.
        """
        coverage, *rest = look_up(finger.scene(), postures(finger))
        coverage = np.where(coverage >= 1 - ROUNDING, 1.0, coverage)
        checks = clearance_checks(finger, self._spec.room.clearance)
        found = {check.name: check.achieved for check in checks}
        found |= {COVERAGE: float(np.min(coverage)), MEMBRANE: float(finger.body.membrane)}
        found |= {
            f"{COVERAGE}.{pad}": float(np.min(coverage[:, i])) for i, pad in enumerate(PHALANGES)
        }
        found[SHARPNESS] = float(np.min(rest[0]))
        if self._focused:
            found[BLUR] = float(-np.min(rest[1]))
        return {measure_name(label, KNOWN): value for label, value in found.items()}
