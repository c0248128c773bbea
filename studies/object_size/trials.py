"""Grasps with all that is off in them, their pictures, and the diameters estimated from these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int

from designopt.errors import UserError
from designopt.study.records import Records
from optics.chamber import Posture, press_wall
from optics.rendering import ChamberImage
from perception import posture
from perception.posture import PostureEstimate, PostureEstimator
from studies.models.soft_finger.finger import DOWN, SoftFinger, looked_at
from studies.models.soft_finger.grasp import Hand, bend_around, diameter_of, touched
from studies.models.soft_finger.samples import MARKERS, marker_places
from studies.object_size import ObjectSizeSpec

bends_around = jax.jit(jax.vmap(bend_around))
diameters_of = jax.jit(jax.vmap(diameter_of))
all_touched = jax.jit(jax.vmap(touched))

ROUNDS = 100
"""So often a bottle is put into the hand anew before the settings are refused."""


@dataclass(frozen=True)
class Reader:
    """All that an estimate takes but the picture.

    Attributes:
        estimator: estimates the finger's posture.
        hand: with every bottle in its one place.
        largest_residual: root mean square distance of markers from the arc that fits them best,
            mm. A network answers to postures that it was never shown too, with markers that lie
            on no arc.
    """

    estimator: PostureEstimator
    hand: Hand
    largest_residual: float

    def hands(self, count: int) -> Hand:
        """The hand so many times."""
        return jax.tree.map(lambda value: jnp.full(count, value), self.hand)


def estimate(postures: Sequence[PostureEstimate], reader: Reader) -> Records:
    """Diameters from postures, and from nothing else.

    Returns:
        A row for each: ``seen``, whether the picture shows a chamber with the markers of a finger;
        ``estimated_bend_deg`` and ``residual_mm`` of the arc that fits them best, NaN where not
        seen; ``known``, whether there is an answer: they lie on an arc, and its bend is one of a
        finger that holds something; ``estimate_mm``, the bottle's diameter, else NaN.
    """
    length = float(reader.hand.length)
    first, second, third, last = (part * length for part in MARKERS)
    fit = posture.fit_bend(stack_markers(postures), (first, second, third, last), length)
    found = diameters_of(reader.hands(len(postures)), jnp.asarray(fit.bend))
    known = fit.known & (fit.residual <= reader.largest_residual) & np.asarray(found.ok)
    return Records(
        {
            "seen": fit.known,
            "estimated_bend_deg": np.where(fit.known, np.rad2deg(fit.bend), np.nan),
            "residual_mm": np.where(fit.known, fit.residual, np.nan),
            "known": known,
            "estimate_mm": np.where(known, found.value, np.nan),
        }
    )


def stack_markers(postures: Sequence[PostureEstimate]) -> Float[np.ndarray, "pictures 3 2"]:
    """Places of the markers, mm; NaN where the picture shows no chamber."""
    nothing = np.full((3, 2), np.nan)
    return np.stack([nothing if one.markers is None else one.markers for one in postures])


@dataclass(frozen=True)
class Grasps:
    """Bottles in the hand, each touched by the finger.

    Attributes:
        diameters: mm.
        hands: as they are in each grasp: the bottle off its place, the wall pressed in.
        depths: to which the wall is pressed in, mm.
        bends: of the finger, in radians.
        arcs: where along the finger it touches, mm.
        postures: of the finger.
        redrawn: how often the bottle lay so that the finger missed it, and was put in anew.
    """

    diameters: Float[np.ndarray, " grasps"]
    hands: Hand
    depths: Float[np.ndarray, " grasps"]
    bends: Float[np.ndarray, " grasps"]
    arcs: Float[np.ndarray, " grasps"]
    postures: Posture
    redrawn: Int[np.ndarray, " grasps"]


def designed_hand(spec: ObjectSizeSpec, length: float) -> Hand:
    """The hand with a bottle in its place that presses the wall as deep as in the mean."""
    depth = (spec.squeeze_least + spec.squeeze_most) / 2
    values = (spec.palm, spec.gap, spec.finger_radius - depth, length)
    return Hand(*(jnp.asarray(value, jnp.float64) for value in values))


def sample_grasps(
    spec: ObjectSizeSpec,
    finger: SoftFinger,
    diameters: Float[np.ndarray, " grasps"],
    generator: np.random.Generator,
) -> Grasps:
    """Grasps of these bottles, each off by what is random.

    Raises:
        UserError: the finger misses a bottle however often that is put into the hand.
    """
    count = len(diameters)
    sizes = jnp.asarray(diameters)
    hands, depths = _placed(spec, finger, count, generator)
    scatter = np.deg2rad(spec.direction_scatter_deg) * generator.standard_normal(count)
    solved = bends_around(hands, sizes)
    redrawn = np.zeros(count, int)
    for _ in range(ROUNDS):
        held = np.asarray(solved.ok)
        if held.all():
            break
        redrawn += ~held
        others, deeper = _placed(spec, finger, count, generator)
        hands = jax.tree.map(lambda old, new, held=held: jnp.where(held, old, new), hands, others)
        depths = np.where(held, depths, deeper)
        solved = bends_around(hands, sizes)
    missed = np.flatnonzero(~np.asarray(solved.ok))
    if len(missed):
        raise UserError(
            f"--set place={spec.place:g}: the finger misses a bottle of "
            f"{diameters[missed[0]]:.1f} mm however it is put into the hand; choose bottles nearer "
            "to the middle of what the hand holds, or a smaller place"
        )
    touch = all_touched(hands, solved.value)
    pressed = jax.vmap(press_wall, in_axes=(None, 0, 0, 0))(
        jnp.asarray(finger.arc), touch.arc, touch.relative_radius, jnp.asarray(depths)
    )
    bends = np.asarray(solved.value)
    postures = finger.postures(bends, DOWN + scatter, np.asarray(pressed))
    return Grasps(diameters, hands, depths, bends, np.asarray(touch.arc), postures, redrawn)


def _placed(
    spec: ObjectSizeSpec, finger: SoftFinger, count: int, generator: np.random.Generator
) -> tuple[Hand, Float[np.ndarray, " grasps"]]:
    """Bottles somewhere near their place, and how deep each presses the wall in, mm."""
    off = spec.place * generator.standard_normal((2, count))
    depths = generator.uniform(spec.squeeze_least, spec.squeeze_most, count)
    length = np.full(count, finger.length)
    values = (spec.palm + off[0], spec.gap + off[1], spec.finger_radius - depths, length)
    return Hand(*(jnp.asarray(value) for value in values)), depths


def measure(reader: Reader, finger: SoftFinger, grasps: Grasps, seed: int, first: int) -> Records:
    """Diameters of grasped bottles from pictures of the finger, numbered from ``first`` on.

    Args:
        reader: takes every bottle to be in its place.
        finger: its chamber and camera.
        grasps: what is in the hand.
        seed: of the pictures: the lamp, and shake and noise of each.
        first: number of the first picture.

    Returns:
        A row for each grasp, with the columns of `estimate`, those of `compare` and
        ``tip_error_mm`` of the fingertip's marker, NaN where the chamber is not seen.
    """

    def look(_: int, image: ChamberImage) -> PostureEstimate:
        return posture.find_posture(image.pixels, reader.estimator)

    seen = looked_at(finger.renderer(seed), grasps.postures, look, first)
    rows, places = estimate(seen, reader), marker_places(grasps.bends, finger.length)
    tips = posture.compute_marker_errors(stack_markers(seen), places)[:, -1]
    return compare(rows | {"tip_error_mm": np.where(rows["seen"], tips, np.nan)}, grasps, reader)


def compare(rows: Records, grasps: Grasps, reader: Reader) -> Records:
    """Estimates beside the grasps they are of.

    Returns:
        Also ``diameter_mm``, ``bend_deg``, ``bend_error_deg``, ``contact_mm`` (where along the
        finger the bottle touches it) and ``redrawn``; and errors, NaN where there is no answer:
        ``error_mm`` of the estimate; ``grasp_error_mm`` of the diameter from the true bend with the
        bottle in its place: what is off is the grasp; ``image_error_mm`` of that from the estimated
        bend with the bottle where it is: what is off is the bend.
    """
    by_bend = all_touched(reader.hands(len(rows)), jnp.asarray(grasps.bends)).diameter
    by_place = diameters_of(grasps.hands, jnp.deg2rad(rows["estimated_bend_deg"])).value
    bends = np.rad2deg(grasps.bends)

    def off(diameters: ArrayLike) -> np.ndarray:
        return np.where(rows["known"], np.asarray(diameters) - grasps.diameters, np.nan)

    return rows | {
        "diameter_mm": grasps.diameters,
        "bend_deg": bends,
        "bend_error_deg": rows["estimated_bend_deg"] - bends,
        "contact_mm": grasps.arcs,
        "redrawn": grasps.redrawn,
        "error_mm": off(rows["estimate_mm"]),
        "grasp_error_mm": off(by_bend),
        "image_error_mm": off(by_place),
    }
