"""Grasps with all that is off in them, their pictures, and the diameters found from these."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from designopt.errors import UserError
from optics.chamber import Posture, press_wall
from perception.posture import find_posture
from studies.models.soft_finger.finger import DOWN, SoftFinger, looked_at
from studies.models.soft_finger.samples import marker_places
from studies.object_size.estimates import Estimates, Reader, diameters_of, estimated
from studies.object_size.grasp import Hand, bend_around, touched
from studies.object_size.spec import ObjectSizeSpec

bends_around = jax.jit(jax.vmap(bend_around))
all_touched = jax.jit(jax.vmap(touched))

ROUNDS = 100
"""So often a bottle is put into the hand anew before the settings are said to be no grasp's."""


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
        redrawn: how many bottles lay so that the finger missed them, and were put in anew.
    """

    diameters: Float[np.ndarray, " grasps"]
    hands: Hand
    depths: Float[np.ndarray, " grasps"]
    bends: Float[np.ndarray, " grasps"]
    arcs: Float[np.ndarray, " grasps"]
    postures: Posture
    redrawn: int


@dataclass(frozen=True)
class Measured:
    """What is said of some grasps.

    Attributes:
        grasps: what they are.
        estimates: what is read from their pictures, with every bottle in its place; nothing else
            says whether there is an answer.
        by_true_bend: diameters from the true bends, with every bottle in its place, mm: what is
            off is the grasp.
        by_true_place: diameters from the bends that were read, with every bottle where it is, mm:
            what is off is the bend. 0 where there is no answer.
    """

    grasps: Grasps
    estimates: Estimates
    by_true_bend: Float[np.ndarray, " grasps"]
    by_true_place: Float[np.ndarray, " grasps"]

    @property
    def diameters(self) -> Float[np.ndarray, " grasps"]:
        """The estimates, mm; 0 where there is none."""
        return self.estimates.diameters

    def errors(self, diameters: Float[np.ndarray, " grasps"]) -> Float[np.ndarray, " known"]:
        """Of diameters, where there is an answer, mm."""
        return (diameters - self.grasps.diameters)[self.estimates.known]

    def told(self, bottles: list[float]) -> Int[np.ndarray, " grasps"]:
        """Number of the bottle whose diameter is nearest; that of bottles if there is no answer."""
        off = np.abs(self.diameters[:, None] - np.asarray(bottles)[None])
        return np.where(self.estimates.known, np.argmin(off, axis=1), len(bottles))

    def marker_truth(self, length: float) -> Float[np.ndarray, "grasps 3 2"]:
        """True places of the markers, mm."""
        return marker_places(self.grasps.bends, length)


def designed(spec: ObjectSizeSpec, length: float) -> Hand:
    """The hand with a bottle in its place that presses the wall as deep as in the mean."""
    depth = (spec.squeeze_least + spec.squeeze_most) / 2
    values = (spec.palm, spec.gap, spec.finger_radius - depth, length)
    return Hand(*(jnp.asarray(value, jnp.float64) for value in values))


def drawn(
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
    redrawn = 0
    for _ in range(ROUNDS):
        held = np.asarray(solved.ok)
        if held.all():
            break
        redrawn += int(np.count_nonzero(~held))
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
    hands = Hand(
        jnp.asarray(spec.palm + off[0]),
        jnp.asarray(spec.gap + off[1]),
        jnp.asarray(spec.finger_radius - depths),
        jnp.full(count, finger.length),
    )
    return hands, depths


def measured(
    reader: Reader,
    finger: SoftFinger,
    grasps: Grasps,
    *,
    seed: int,
    first: int,
) -> Measured:
    """Diameters of grasped bottles from pictures of the finger, numbered from ``first`` on.

    Args:
        reader: takes every bottle to be in its place.
        finger: its chamber and camera.
        grasps: what is in the hand.
        seed: of the pictures: the lamp, and shake and noise of each.
        first: number of the first picture.
    """
    seen = looked_at(
        finger.renderer(seed),
        grasps.postures,
        lambda _, image: find_posture(image.pixels, reader.estimator),
        first,
    )
    estimates = estimated(seen, reader)
    designs = jax.tree.map(lambda value: jnp.full(len(seen), value), reader.hand)
    by_place = diameters_of(grasps.hands, jnp.asarray(estimates.bends)).value
    return Measured(
        grasps,
        estimates,
        np.asarray(all_touched(designs, jnp.asarray(grasps.bends)).diameter),
        np.where(estimates.known, np.asarray(by_place), 0.0),
    )
