"""Light in the chamber against quadrature, mirrors in closed form, and the path tracer."""

from __future__ import annotations

import importlib.util
import math

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import dblquad

from optics.chamber import Endoscope, compute_wall_radii
from optics.chamber.rings import Rings
from optics.rendering import ChamberEffects, ChamberRenderer
from optics.rendering.chamber_light import (
    COAT,
    BentWall,
    compute_wall_light,
    exchange_of_discs,
    reflectance,
    slopes_of_pixels,
)
from optics.rendering.chamber_renderer import COLORS
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.spec import ChamberImagesSpec
from studies.oracles.chamber_light import Frame, rays, trace, wall
from tests.optics.chambers import chamber as finger

needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="needs the extra 'judge'"
)

RINGS = Rings.of(finger())
WALLS = np.array([*RINGS.region, 3])
CAMERA = Endoscope(np.pi / 3, -0.1, np.array([0.05, -0.03]), 0.2, columns=160, rows=120)


def test_the_exchange_of_discs_is_that_of_their_points():
    first, second, apart = 2.0, 3.0, 4.0

    def sent(radius: float, turn: float) -> float:
        """From a point of the first disc, at a radius of its own, in rings of the second."""
        inner = radius**2 + first_radius**2 - 2 * radius * first_radius * math.cos(turn)
        return radius * apart**2 / (math.pi * (inner + apart**2) ** 2)

    total = 0.0
    nodes, weights = np.polynomial.legendre.leggauss(12)
    for node, weight in zip(nodes, weights, strict=True):
        first_radius = first * (node + 1) / 2
        share = 2 * dblquad(sent, 0, math.pi, 0, second)[0]
        total += weight * first / 2 * 2 * math.pi * first_radius * share
    found = exchange_of_discs(*(np.full((1, 1), one) for one in (first, second, apart)))
    assert found[0, 0] == pytest.approx(total, rel=1e-6)


def test_light_in_a_closed_chamber_that_reflects_all_is_kept():
    """What the lamp sends is what walls, of which one part is black, and the plate take up."""
    colors = np.ones((61, 3))
    colors[30:40] = 0.0
    light = compute_wall_light(RINGS, colors)
    depth = np.append(0.0, np.asarray(RINGS.arc) + float(RINGS.pinhole_offset))
    radius = np.append(np.asarray(RINGS.radius)[0], np.asarray(RINGS.radius))
    sides = np.hypot(np.diff(depth), np.diff(radius))
    areas = np.pi * (radius[1:] + radius[:-1]) * sides
    areas = np.append(areas, np.pi * radius[-1] ** 2)
    taken = np.sum((areas * (1 - colors[:, 0])) * light.total[:, 0])
    # A lamp of even brightness sends π times what it sends straight ahead; the plate takes a part.
    assert 0 < taken < math.pi * light.lamp
    assert taken > 0.2 * math.pi * light.lamp


def test_the_lamp_alone_falls_by_square_and_cosines():
    light = compute_wall_light(RINGS, np.zeros((61, 3)))
    assert not light.mutual.any()
    depth = np.asarray(RINGS.arc) + float(RINGS.pinhole_offset)
    middle, radius = (depth[49] + depth[50]) / 2, np.asarray(RINGS.radius)[49:51].mean()
    ray = np.array([radius, middle])
    along = np.array([np.diff(np.asarray(RINGS.radius)[49:51])[0], depth[50] - depth[49]])
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    away = np.linalg.norm(ray)
    wanted = light.lamp * (ray[1] / away) * (-ray @ normal / away) / away**2
    assert light.direct[50] == pytest.approx(wanted, rel=1e-12)


def test_reflectance_is_that_of_refracted_angles():
    angle = np.deg2rad([10.0, 50.0, 85.0])
    inside = np.arcsin(np.sin(angle) / COAT)
    across = np.sin(angle - inside) / np.sin(angle + inside)
    along = np.tan(angle - inside) / np.tan(angle + inside)
    np.testing.assert_allclose(reflectance(np.cos(angle)), (across**2 + along**2) / 2)


def test_slopes_are_imaged_where_they_come_from():
    y, x = np.mgrid[:120:7, :160:7]
    found = np.asarray(CAMERA.image(jnp.asarray(slopes_of_pixels(CAMERA, 7))))
    np.testing.assert_allclose(found, np.stack([x, y], axis=-1), atol=1e-4)


def test_walls_are_met_where_the_solid_is():
    """Points of the oracle's solid on a ring's plane are met there, with its normal."""
    bend, direction = math.radians(50), 2.0
    lengths = float(finger().length_ab), float(finger().length_bc), float(finger().length_cd)
    radii = tuple(compute_wall_radii(finger()).tolist())
    solid = Frame(lengths, radii, float(RINGS.pinhole_offset), bend=bend, direction=direction)
    turn, arc = np.linspace(0, 2 * np.pi, 8, endpoint=False), np.asarray(RINGS.arc)[12]
    place = wall(solid, np.full(8, arc), turn)
    bent = BentWall(RINGS, bend, direction)
    met = bent.meet(place[:, :2] / place[:, 2:], np.full(8, 12))
    flat = np.concatenate([place[:, :2] @ bent.turn, place[:, 2:]], axis=-1)
    np.testing.assert_allclose(met.place, flat, atol=1e-5)
    step = 1e-4
    onward = wall(solid, np.full(8, arc - step), turn) - wall(solid, np.full(8, arc + step), turn)
    around = wall(solid, np.full(8, arc), turn + step) - wall(solid, np.full(8, arc), turn - step)
    normal = np.cross(onward, around)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.concatenate([normal[:, :2] @ bent.turn, normal[:, 2:]], axis=-1)
    np.testing.assert_allclose(np.abs(np.sum(normal * met.normal, axis=-1)), 1, atol=1e-4)
    assert np.all(np.sum((bent.center[12] - met.place) * met.normal, axis=-1) > 0)  # into it


@pytest.mark.parametrize("ring", [15, 30, 45, 55])
def test_a_mirror_image_is_where_the_ray_comes_from_by_reflection(ring: int):
    """In the straight finger, in a plane through its axis: lines and their reflections."""
    depth = np.asarray(RINGS.arc) + float(RINGS.pinhole_offset)
    radius = np.asarray(RINGS.radius)
    bent = BentWall(RINGS, 0.0, 0.0)
    met = bent.meet(np.array([[radius[ring] / depth[ring], 0.0]]), np.array([ring]))
    ray = met.place / np.linalg.norm(met.place)
    onward = ray + 2 * met.cosine[:, None] * met.normal
    [hit] = bent.follow(met.place, onward, np.array([ring]))
    # The wall's angle to the axis turns the ray by twice as much, away from the wall.
    slope = math.atan((radius[ring + 1] - radius[ring]) / (depth[ring + 1] - depth[ring]))
    angle = 2 * slope - math.atan(radius[ring] / depth[ring])
    rest = depth[ring + 1 :]
    beside = radius[ring] + math.tan(angle) * (rest - depth[ring])
    outside = np.flatnonzero(np.abs(beside) > radius[ring + 1 :])
    assert hit == (ring + 1 + outside[0] if len(outside) else len(radius))


def test_the_top_of_a_glossy_finger_shows_the_lamp_and_that_of_a_matt_one_is_dark():
    own = SoftFinger.of(ChamberImagesSpec())
    straight = own.postures(np.zeros(1), np.zeros(1))

    def shown(gloss: float) -> np.ndarray:
        effects = ChamberEffects(lamp=1.0, gloss=gloss, gain=0.4)
        [image] = ChamberRenderer(own.chamber, own.endoscope, effects).render(straight)
        return image.pixels.max(axis=-1).astype(float)

    matt, glossy = shown(0.0), shown(1.0)
    yellow = np.s_[240, 370:390]
    assert matt[240, 320] < 0.6 * matt[yellow].mean()
    assert glossy[240, 320] > glossy[yellow].mean()


@needs_mitsuba
@pytest.mark.slow
def test_every_ring_is_as_bright_as_the_path_tracer_has_it():
    own = SoftFinger.of(ChamberImagesSpec())
    rings = Rings.of(own.chamber)
    chamber = own.chamber
    lengths = float(chamber.length_ab), float(chamber.length_bc), float(chamber.length_cd)
    radii = tuple(compute_wall_radii(own.chamber).tolist())
    frame = Frame(lengths, radii, float(rings.pinhole_offset), columns=160, rows=120, samples=256)
    light = trace(frame)
    vectors = rays(frame, *np.meshgrid(np.arange(160.0), np.arange(120.0)))
    slope = np.hypot(vectors[..., 0], vectors[..., 1]) / vectors[..., 2]
    depth = np.asarray(rings.arc) + float(rings.pinhole_offset)
    ends = (np.asarray(rings.radius) / depth)[::-1]
    colors = COLORS[np.array([*rings.region, 3])]
    wanted = colors * compute_wall_light(rings, colors).total
    ratios = []
    for first, last in ((12, 15), (22, 26), (30, 36), (42, 48), (52, 57)):
        # Pixels of a few rings of one wall, away from its ends.
        wall_number = len(ends) - np.searchsorted(ends, slope)
        chosen = (wall_number >= first) & (wall_number <= last)
        brightest = colors[first].argmax()
        ratios.append(
            light[chosen][:, brightest].mean() / wanted[wall_number[chosen], brightest].mean()
        )
    np.testing.assert_allclose(ratios, np.mean(ratios), rtol=0.02)  # noise of 256 samples
