"""What the rings span in the plane of bending, in complex numbers, and its gradients."""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import solve_dimension_for_ratio
from optics.chamber import Posture, Rings, Spans, find_apertures, find_spans, press_wall
from optics.chamber.rings import FIELD_STOP
from tests.helpers import central_differences
from tests.optics.chambers import chamber as finger
from tests.optics.soft_finger.marched import Press

ROUNDING = 1e-12
GRADIENT = 1e-6  # relative to the largest slope: what central differences can tell
BENDS_DEG = (0.0, 0.01, 10.0, -25.0, 60.0, 90.0, 120.0)
BEYOND_DEG = (170.0, 182.0, 250.0, 400.0, 460.0, 600.0)
"""Rings behind the camera; from 451 degrees the centre of curvature is inside the chamber."""

PRESSES = {
    "none": Press(),
    "inside": Press(70.0, 20.0, 4.0),
    "outside": Press(55.0, 20.0, -4.0),
    "through": Press(75.0, 20.0, 25.0),
}
every_press = pytest.mark.parametrize("press", PRESSES.values(), ids=PRESSES.keys())
rings = Rings.of(finger())


def pressed(press: Press) -> jax.Array:
    values = (jnp.asarray(value) for value in (press.place, press.radius, press.depth))
    return press_wall(rings.arc, *values)


spanned = eqx.filter_jit(jax.vmap(find_spans, in_axes=(None, 0, None)))
through = eqx.filter_jit(find_apertures)


def batch(bends_deg: tuple[float, ...], press: Press) -> Spans:
    return spanned(rings, jnp.asarray(np.deg2rad(bends_deg)), pressed(press))


@every_press
def test_rings_span_what_their_ends_in_the_plane_are_seen_at(press):
    found = batch(BENDS_DEG + BEYOND_DEG, press)
    arcs, radii = np.asarray(rings.arc), np.asarray(rings.radius)
    deep = press.at(arcs)
    high = radii - (deep if press.depth > 0 else 0)
    low = radii - (deep if press.depth < 0 else 0)
    for i, bend_deg in enumerate(BENDS_DEG + BEYOND_DEG):
        # Ahead is real, towards the bend imaginary; the line turns about a centre of curvature.
        turned = np.exp(1j * np.deg2rad(bend_deg) * arcs / 100)
        line = arcs.astype(complex)
        if bend_deg:
            line = 100 / np.deg2rad(bend_deg) * (turned - 1) / 1j
        ends = np.stack([line + 1j * turned * high, line - 1j * turned * low]) + 0.844
        margin = ends.real.min(axis=0)
        scale = 1 + np.abs(np.asarray(found.margin[i]))
        np.testing.assert_allclose(
            found.margin[i], np.minimum(margin, radii), atol=ROUNDING * scale.max() * 100
        )
        ahead = margin > 0
        slopes = ends.imag / np.where(ahead, ends.real, 1)
        # A bend of 0.01 degrees takes four digits of the line as this says it.
        tolerance = 1e-9 if bend_deg == 0.01 else 1e-11
        np.testing.assert_allclose(found.high[i][ahead], slopes[0, ahead], rtol=tolerance)
        np.testing.assert_allclose(found.low[i][ahead], slopes[1, ahead], rtol=tolerance)
        # What is behind the camera hides itself and all that is beyond it.
        upper = np.where(ahead, np.minimum(slopes[0], FIELD_STOP), -FIELD_STOP)
        lower = np.where(ahead, np.maximum(slopes[1], -FIELD_STOP), FIELD_STOP)
        upper, lower = np.minimum.accumulate(upper), np.maximum.accumulate(lower)
        np.testing.assert_allclose(found.seen_high[i], upper, rtol=tolerance)
        np.testing.assert_allclose(found.seen_low[i], lower, rtol=tolerance)
        np.testing.assert_allclose(found.width[i], upper - lower, atol=tolerance)


@every_press
@pytest.mark.parametrize("bend_deg", [0.0, 25.0, 120.0])
def test_spans_are_where_outlines_cross_the_plane_of_bending(bend_deg, press):
    bend = jnp.asarray(np.deg2rad(bend_deg))
    found = through(rings, Posture(bend, jnp.zeros(()), pressed(press)), 32)
    flat = jax.tree.map(lambda leaf: leaf[0], batch((bend_deg,), press))
    seen = np.asarray(found.seen)
    np.testing.assert_array_equal(seen, np.asarray(flat.width) > 0)
    outlines = np.asarray(found.outline)[seen]
    np.testing.assert_allclose(outlines[:, 0, 0], flat.seen_high[seen], atol=ROUNDING)
    np.testing.assert_allclose(outlines[:, 16, 0], flat.seen_low[seen], atol=ROUNDING)
    assert not outlines[:, 0, 1].any()


class Finger(NamedTuple):
    """What a study changes; η by the offset at D."""

    bend: jax.Array
    ratio: jax.Array
    offset_b: jax.Array
    wall_angle_bc: jax.Array
    depth: jax.Array


def designed(values: Finger) -> tuple[Rings, jax.Array]:
    chamber = dataclasses.replace(
        finger(), offset_b=values.offset_b, wall_angle_bc=values.wall_angle_bc
    )
    offset = solve_dimension_for_ratio(chamber, "offset_d", values.ratio).value
    made = Rings.of(dataclasses.replace(chamber, offset_d=offset), 6)
    place, radius = jnp.asarray(70.0), jnp.asarray(20.0)
    return made, press_wall(made.arc, place, radius, values.depth)


def seen_of(values: Finger) -> tuple[jax.Array, jax.Array]:
    """A mix of all that spans give, and the widths at B, C and D."""
    made, deep = designed(values)
    found = find_spans(made, values.bend, deep)
    ends = jnp.asarray(made.ends)
    width = found.width[ends]
    mix = width @ jnp.asarray([0.7, -1.3, 1.9]) + 0.4 * found.seen_low[ends[1]]
    return mix + 0.1 * jnp.sum(found.margin) / 100, width


def fingers(bends_deg: tuple[float, ...]) -> Finger:
    values = [
        (np.deg2rad(bend), ratio, 1.8, np.deg2rad(angle), depth)
        for bend in bends_deg
        for ratio, angle, depth in ((0.6, 2.0, 0.0), (0.85, -1.0, 4.0), (0.5, 4.0, -3.0))
    ]
    return Finger(*(jnp.asarray(column) for column in np.transpose(values)))


EXTREME_DEG = (*BEYOND_DEG, -400.0, 180.0, 360.0, 3600.0)
MANY = fingers(BENDS_DEG + EXTREME_DEG)
ORDINARY = 3 * len(BENDS_DEG)
seen_value = jax.jit(seen_of)


@functools.cache
def slopes_and_widths() -> tuple[np.ndarray, np.ndarray]:
    """Of all fingers at once, compiled."""
    slopes, widths = jax.jit(jax.vmap(jax.grad(seen_of, has_aux=True)))(MANY)
    return np.transpose(slopes), np.asarray(widths)


def test_gradients_are_central_differences():
    slopes, widths = slopes_and_widths()
    for i, slope in enumerate(slopes[:ORDINARY]):
        values = jax.tree.map(lambda leaf, i=i: leaf[i], MANY)
        # A press of no depth has a kink: nothing is pressed on either side. Zero is its slope.
        unpressed = float(values.depth) == 0
        wanted = np.array(central_differences(lambda one: seen_value(one)[0], values))
        compared = slice(0, 4 if unpressed else 5)
        np.testing.assert_allclose(
            slope[compared], wanted[compared], atol=GRADIENT * np.abs(wanted).max()
        )
    # Both where tops are seen and where they are hidden.
    assert (widths[:ORDINARY, 2] > 0).any()
    assert (widths[:ORDINARY, 2] < 0).any()


def test_values_and_gradients_are_finite_however_a_finger_is_bent():
    slopes, widths = slopes_and_widths()
    assert np.isfinite(widths).all()
    assert (widths[ORDINARY:, 2] <= 0).all()
    assert np.isfinite(slopes).all()
    deep = jnp.asarray(PRESSES["inside"].at(np.asarray(rings.arc)))
    found = spanned(rings, MANY.bend[ORDINARY:], deep)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    assert (np.asarray(found.margin).min(axis=1) <= 0).sum() > 6


def test_all_slopes_of_all_spans_are_finite():
    def every(bend: jax.Array, which: jax.Array) -> jax.Array:
        found = find_spans(rings, bend, pressed(PRESSES["outside"]))
        return jnp.sum(which * jnp.concatenate(jax.tree.leaves(found)))

    bends = jnp.asarray(np.deg2rad(BENDS_DEG + BEYOND_DEG))
    each = jnp.eye(5 * len(rings.region))
    slopes = jax.jit(jax.vmap(jax.vmap(jax.grad(every), in_axes=(None, 0)), in_axes=(0, None)))
    assert np.isfinite(slopes(bends, each)).all()
