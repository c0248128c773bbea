"""The study itself: from its spec to its results."""

from __future__ import annotations

import statistics
import time

import jax
import jax.numpy as jnp
import numpy as np

from designopt.errors import UserError
from designopt.study.results import Results
from designopt.study.study import Context
from perception.posture import PostureEstimator, Training, train
from studies.models.one_thread import one_thread
from studies.models.soft_finger.finger import DOWN, SoftFinger
from studies.models.soft_finger.samples import boundaries, random_postures, samples
from studies.object_size import drawings, statements, tables
from studies.object_size.estimates import Reader
from studies.object_size.found import Curve, Found, Shown
from studies.object_size.grasp import Hand, bend_around, touched
from studies.object_size.odd import odd_frames, over_bends, say
from studies.object_size.spec import ObjectSizeSpec
from studies.object_size.trials import Grasps, designed, drawn, measured

PLACES = 241
"""Diameters of the curve."""

TIMED = 40
"""Pictures whose way to a diameter is timed."""

TRAINING, BOTTLES, RANDOM, OTHER_LAMP = 5, 6, 7, 8
"""Streams of random numbers."""


def run(spec: ObjectSizeSpec, context: Context) -> Results:
    """Train, grasp, estimate and judge.

    Raises:
        UserError: no such chamber or grasp, or another float type than float64.
    """
    context.require_float64("object-size finds where a finger touches to a millionth of a mm")
    with one_thread():
        found = find(spec, context)
    return Results(
        findings=statements.findings(spec, found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(spec, found),
        figures=drawings.figures(spec, found),
    )


def find(spec: ObjectSizeSpec, context: Context) -> Found:
    """Everything that is measured."""
    seed = context.seed
    with context.step("The finger and its grasps"):
        finger = SoftFinger.of(spec)
        hand = designed(spec, finger.length)
        curve = curve_of(hand, spec)
    with context.step(f"{spec.samples} labelled images"):
        estimator, usable = _trained(spec, finger, seed)
        reader = Reader(estimator, hand, spec.largest_residual)
    # The same seed as in training: the same finger, with the same lamp.
    with context.step(f"{spec.grasps} grasps of each of {len(spec.bottles)} bottles"):
        told = np.repeat(spec.bottles, spec.grasps)
        first = spec.samples
        grasps = drawn(spec, finger, told, np.random.default_rng([seed, BOTTLES, 1]))
        bottles = measured(reader, finger, grasps, seed=seed, first=first)
    with context.step(f"{spec.random_grasps} grasps of bottles of random diameters"):
        first += len(told)
        grasps = _any_size(spec, finger, spec.random_grasps, seed, RANDOM)
        random = measured(reader, finger, grasps, seed=seed, first=first)
    with context.step(f"{spec.other_lamp_grasps} grasps with another lamp"):
        grasps = _any_size(spec, finger, spec.other_lamp_grasps, seed, OTHER_LAMP)
        other_lamp = measured(reader, finger, grasps, seed=seed + 1, first=0)
    with context.step("From 0.01° to 120°, and odd frames"):
        bends = over_bends(finger, reader, spec.stability_images, seed)
        odd = odd_frames(finger, reader, seed)
    with context.step("Pictures and run time"):
        first += spec.random_grasps
        shown = _shown(spec, finger, hand, seed, first)
        seconds = _seconds(finger, reader, seed, first + len(shown))
    return Found(
        hand, curve, estimator.record, usable, bottles, random, other_lamp, bends, odd, shown,
        seconds,
    )  # fmt: skip


def curve_of(hand: Hand, spec: ObjectSizeSpec) -> Curve:
    """Diameter over bend from the least diameter to the largest.

    Raises:
        UserError: the finger does not touch one of them, or one of the bottles.
    """
    least = min(spec.least, *spec.bottles)
    largest = max(spec.largest, *spec.bottles)
    diameters = jnp.linspace(least, largest, PLACES)
    solved = jax.jit(jax.vmap(bend_around, in_axes=(None, 0)))(hand, diameters)
    if not bool(jnp.all(solved.ok)):
        number = int(jnp.argmin(solved.ok))
        message = jax.tree.map(lambda leaf: leaf[number], solved).messages()[0]
        raise UserError(
            f"a bottle of {float(diameters[number]):.1f} mm: {message} Change palm, gap, "
            "finger_radius or the diameters"
        )

    def diameter(bend: jax.Array) -> jax.Array:
        return touched(hand, bend).diameter

    slopes = jax.jit(jax.vmap(jax.grad(diameter)))(solved.value)
    touches = jax.jit(jax.vmap(touched, in_axes=(None, 0)))(hand, solved.value)
    return Curve(
        np.asarray(diameters),
        np.asarray(solved.value),
        np.asarray(touches.arc),
        np.asarray(slopes) * np.pi / 180,
        bool(jnp.all(slopes < 0)),
    )


def _trained(spec: ObjectSizeSpec, finger: SoftFinger, seed: int) -> tuple[PostureEstimator, int]:
    """A network trained on the finger's own images, and the number of these that show anything."""
    generator = np.random.default_rng([seed, TRAINING])
    bends = np.deg2rad(generator.uniform(0, spec.largest_bend_deg, spec.samples))
    size = (spec.columns, spec.rows)
    seen = samples(finger, random_postures(finger, bends, generator), (size,), seed=seed)
    kept = seen.usable
    if np.count_nonzero(kept) < 2:
        raise UserError(f"--set eta={spec.eta:g}: no picture of this chamber can be used")
    settings = Training(epochs=spec.epochs, seed=seed)
    estimator = train(seen.images[size][kept], seen.markers[kept], settings)
    return estimator, int(np.count_nonzero(kept))


def _any_size(
    spec: ObjectSizeSpec, finger: SoftFinger, count: int, seed: int, stream: int
) -> Grasps:
    """Grasps of bottles of random diameters."""
    sizes = np.random.default_rng([seed, stream, 0]).uniform(spec.least, spec.largest, count)
    return drawn(spec, finger, sizes, np.random.default_rng([seed, stream, 1]))


def _shown(
    spec: ObjectSizeSpec, finger: SoftFinger, hand: Hand, seed: int, first: int
) -> list[Shown]:
    """The bottles in their places, pressed as in the mean."""
    bends = [float(bend_around(hand, jnp.asarray(one)).value) for one in spec.bottles]
    touches = [touched(hand, jnp.asarray(bend)) for bend in bends]
    postures = finger.postures(np.array(bends), np.full(len(bends), DOWN))
    images = finger.renderer(seed).render(postures, first)
    size = (spec.columns, spec.rows)
    return [
        Shown(diameter, bend, float(touch.arc), image.pixels, boundaries(image, (size,))[0][0])
        for diameter, bend, touch, image in zip(spec.bottles, bends, touches, images, strict=True)
    ]


def _seconds(finger: SoftFinger, reader: Reader, seed: int, first: int) -> float:
    """Median time from one picture to a diameter, one after the other."""
    bends = np.deg2rad(np.linspace(10, 100, TIMED))
    images = finger.renderer(seed).render(finger.postures(bends, np.full(TIMED, DOWN)), first)
    seconds = []
    for image in images:
        start = time.perf_counter()
        say(image.pixels, reader)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)
