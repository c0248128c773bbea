"""Grasps with all that is off in them, their images, and the diameters found from these."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from optics.soft_finger import Posture, pressed_by
from perception.posture import PostureEstimator
from perception.posture.bending import bend_of_markers
from studies.chamber_images.making import DOWN, SoftFinger
from studies.chamber_images.samples import MARKERS, Samples, samples
from studies.object_size.grasp import Hand, bend_around, diameter_of, touched
from studies.object_size.spec import ObjectSizeSpec

bends_around = jax.jit(jax.vmap(bend_around))
all_touched = jax.jit(jax.vmap(touched))
diameters_of = jax.jit(jax.vmap(diameter_of))


@dataclass(frozen=True)
class Grasps:
    """Bottles in the hand.

    Attributes:
        diameters: mm.
        hands: as they are in each grasp: the bottle off its place, the wall pressed in.
        depths: to which the wall is pressed in, mm.
        bends: of the finger, in radians.
        held: whether the finger touches the bottle; if not, the bend means nothing.
        arcs: where along the finger it touches, mm.
        postures: of the finger.
    """

    diameters: Float[np.ndarray, " grasps"]
    hands: Hand
    depths: Float[np.ndarray, " grasps"]
    bends: Float[np.ndarray, " grasps"]
    held: Bool[np.ndarray, " grasps"]
    arcs: Float[np.ndarray, " grasps"]
    postures: Posture


@dataclass(frozen=True)
class Measured:
    """What is said of some grasps; diameters in mm, and 0 where there is none.

    Attributes:
        grasps: what they are.
        images: boundary images as the network takes them.
        markers: true places, mm.
        predicted: places by the network, mm.
        bends: of the finger, from these, in radians.
        residuals: root mean square distance of markers from the arc that fits them best, mm.
        known: whether there is an answer: the chamber is in view, and the bend is one of a finger
            that holds something.
        diameters: from the bends, with every bottle in its place.
        by_true_bend: from the true bends, with every bottle in its place: what is off is the grasp.
        by_true_place: from the bends, with every bottle where it is: what is off is the bend.
    """

    grasps: Grasps
    images: np.ndarray
    markers: Float[np.ndarray, "grasps 3 2"]
    predicted: Float[np.ndarray, "grasps 3 2"]
    bends: Float[np.ndarray, " grasps"]
    residuals: Float[np.ndarray, " grasps"]
    known: Bool[np.ndarray, " grasps"]
    diameters: Float[np.ndarray, " grasps"]
    by_true_bend: Float[np.ndarray, " grasps"]
    by_true_place: Float[np.ndarray, " grasps"]

    def errors(self, diameters: Float[np.ndarray, " grasps"]) -> Float[np.ndarray, " known"]:
        """Of diameters, where there is an answer, mm."""
        return (diameters - self.grasps.diameters)[self.known]

    def told(self, bottles: list[float]) -> Int[np.ndarray, " grasps"]:
        """Number of the bottle whose diameter is nearest; that of bottles if there is no answer."""
        off = np.abs(self.diameters[:, None] - np.asarray(bottles)[None])
        return np.where(self.known, np.argmin(off, axis=1), len(bottles))


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
    """Grasps of these bottles, each off by what is random."""
    count = len(diameters)
    off = spec.place * generator.standard_normal((2, count))
    depths = generator.uniform(spec.squeeze_least, spec.squeeze_most, count)
    scatter = np.deg2rad(spec.direction_scatter_deg) * generator.standard_normal(count)
    hands = Hand(
        jnp.asarray(spec.palm + off[0]),
        jnp.asarray(spec.gap + off[1]),
        jnp.asarray(spec.finger_radius - depths),
        jnp.full(count, finger.length),
    )
    solved = bends_around(hands, jnp.asarray(diameters))
    touch = all_touched(hands, solved.value)
    arc = jnp.asarray(finger.arc)
    pressed = jax.vmap(pressed_by, in_axes=(None, 0, 0, 0))(
        arc, touch.arc, touch.relative_radius, jnp.asarray(depths)
    )
    bends = np.asarray(solved.value)
    postures = finger.postures(bends, DOWN + scatter, np.asarray(pressed))
    return Grasps(
        diameters, hands, depths, bends, np.asarray(solved.ok), np.asarray(touch.arc), postures
    )


def pictured(
    spec: ObjectSizeSpec, finger: SoftFinger, grasps: Grasps, *, seed: int, first: int
) -> Samples:
    """The grasps' boundary images, numbered from ``first`` on."""
    size = (spec.columns, spec.rows)
    return samples(finger, grasps.postures, (size,), seed=seed, first=first)


def found_bends(
    estimator: PostureEstimator, images: np.ndarray, length: float
) -> tuple[Float[np.ndarray, "images 3 2"], Float[np.ndarray, "2 images"]]:
    """Markers on images, mm; and the finger's bends, in radians, with their residuals, mm."""
    predicted = estimator.predict(images)
    first, second, third, last = (part * length for part in MARKERS)
    fit = bend_of_markers(predicted, (first, second, third, last), length)
    return predicted, np.stack([fit.bend, fit.residual])


def measured(
    spec: ObjectSizeSpec,
    finger: SoftFinger,
    estimator: PostureEstimator,
    grasps: Grasps,
    seen: Samples,
) -> Measured:
    """Diameters of grasped bottles from the finger's images."""
    images = seen.images[spec.columns, spec.rows]
    predicted, (bends, residuals) = found_bends(estimator, images, finger.length)
    count = len(bends)
    hand = jax.tree.map(lambda value: jnp.full(count, value), designed(spec, finger.length))
    found = diameters_of(hand, jnp.asarray(bends))
    known = grasps.held & seen.usable & np.asarray(found.ok)

    def where_known(diameters: jax.Array) -> np.ndarray:
        return np.where(known, np.asarray(diameters), 0.0)

    return Measured(
        grasps,
        images,
        seen.markers,
        predicted,
        bends,
        residuals,
        known,
        where_known(found.value),
        where_known(all_touched(hand, jnp.asarray(grasps.bends)).diameter),
        where_known(all_touched(grasps.hands, jnp.asarray(bends)).diameter),
    )
