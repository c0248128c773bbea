"""Rays through scenes: closed forms, an independent ray shooter, derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import Hits, Scene, parse_scene, trace_rays
from optics.visibility.tracing import NOTHING
from studies.oracles.rays import Surfaces, cast
from tests.helpers import check_gradients

CAMERA = {"position": [0, 0], "direction_deg": 0, "fov_deg": 90, "pixels": 100}


def scene(**tables: object) -> Scene:
    return parse_scene({"camera": CAMERA, **tables})


def follow(of: Scene, x: float, y: float, degrees: float, bounces: int = 4) -> Hits:
    return trace_rays(
        of, of.pose(), jnp.asarray([x, y], float), jnp.asarray(np.deg2rad(degrees)), bounces=bounces
    )


def test_mirror_pad_and_path_length():
    room = scene(
        mirrors=[{"name": "m", "from": [0, 0], "to": [10, 0], "side": "left"}],
        pads=[{"name": "p", "from": [8, 1], "to": [8, 9]}],
    )
    hits = follow(room, 0, 4, -45)
    np.testing.assert_array_equal(hits.surface[:3], [0, 1, NOTHING])
    np.testing.assert_allclose(hits.place[:2], [[4, 0], [8, 4]], atol=1e-14)
    np.testing.assert_allclose(hits.coordinate[:2], [0.4, 3 / 8], atol=1e-15)
    np.testing.assert_allclose(hits.length[:2], np.sqrt(32) * np.array([1, 2]), rtol=1e-15)
    np.testing.assert_allclose(hits.direction[0], np.array([1, 1]) / np.sqrt(2), atol=1e-15)
    np.testing.assert_array_equal(hits.reflected[:3], [True, False, False])
    np.testing.assert_allclose(hits.sine[:2], np.sqrt(0.5), rtol=1e-15)


def test_backs_stop_rays_and_one_sided_blockers_let_them_pass_from_behind():
    wall = {"name": "b", "from": [5, -1], "to": [5, 1], "side": "left"}  # the left is −x
    behind = {"name": "p", "from": [9, -1], "to": [9, 1], "side": "right"}
    room = scene(blockers=[wall], pads=[behind])
    assert int(follow(room, 0, 0, 0).surface[0]) == 1  # the blocker, from its blocking side
    back = follow(room, 8, 0, 180)
    assert int(back.surface[0]) == NOTHING  # it lets pass
    mirror = scene(mirrors=[{"name": "m", "from": [5, -1], "to": [5, 1], "side": "right"}])
    stopped = follow(mirror, 0, 0, 0)
    assert int(stopped.surface[0]) == 0
    assert not bool(stopped.active[0])
    assert int(stopped.surface[1]) == NOTHING
    pad = follow(scene(pads=[behind]), 0, 0, 0)
    assert int(pad.surface[0]) == 0
    assert not bool(pad.active[0])


def test_ellipse_joins_its_foci():
    # Semi-axes 5 and 4, foci (±3, 0); the right end as an arc: R = b²/a, k = −(c/a)².
    height = 3.0
    x = 5 * np.sqrt(1 - (height / 4) ** 2)
    end = {"name": "e", "from": [x, -height], "to": [x, height], "radius": 16 / 5}
    room = scene(mirrors=[end | {"conic": -9 / 25}])
    for degrees in (-24.0, -3.0, 0.5, 25.0):
        hits = follow(room, -3, 0, degrees, bounces=1)
        assert int(hits.surface[0]) == 0
        place, heading = np.asarray(hits.place[0]), np.asarray(hits.direction[0])
        toward = np.array([3.0, 0.0]) - place
        assert abs(heading[0] * toward[1] - heading[1] * toward[0]) < 1e-13
        assert float(hits.length[0]) + np.hypot(*toward) == pytest.approx(10, rel=1e-14)


def test_whispering_gallery_keeps_its_angle():
    # Inside a half circle every reflection turns by the same angle and the sine stays.
    arc = {"name": "c", "from": [0, -1], "to": [0, 1], "radius": 1.0000001, "conic": 0}
    room = scene(mirrors=[arc])
    hits = follow(room, 0.2, -0.9, 20, bounces=4)
    met = np.asarray(hits.surface) == 0
    assert met.sum() >= 2
    np.testing.assert_allclose(hits.sine[met], hits.sine[0], rtol=1e-6)


def test_derivatives_of_hits_through_straight_and_curved_mirrors():
    room = scene(
        mirrors=[
            {"name": "c", "from": [6, -3], "to": [6, 3], "radius": 9.0},
            {"name": "s", "from": [0, 4], "to": [9, 5], "side": "right"},
        ],
        pads=[{"name": "p", "from": [-4, -4], "to": [-4, 6]}],
    )

    def end(values: list[jax.Array]) -> jax.Array:
        x, y, angle, radius, tilt = values
        moved = eqx.tree_at(
            lambda of: (of.mirrors, of.radii),
            room,
            (room.mirrors.at[1, 1, 1].add(tilt), radius[None]),
        )
        hits = trace_rays(moved, moved.pose(), jnp.stack([x, y]), angle, bounces=2)
        return hits.coordinate[2] + hits.length[2] + hits.place[1, 0]

    design = [jnp.array([value]) for value in (0.5, 0.2, 0.3, 9.0, 0.1)]
    check_gradients(end, design, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize(
    ("dtype", "most_wrong", "tolerance"), [(np.float32, 4, 2e-3), (np.float64, 0, 1e-10)]
)
def test_random_rays_agree_with_plain_numpy(dtype: type, most_wrong: int, tolerance: float):
    generator = np.random.default_rng(5)
    ends = generator.uniform(-1, 1, (6, 2, 2)).astype(dtype).astype(float)
    sides, keys = (1, -1, 0, 1, -1, 0), ("both", "left", "right")
    parts = [
        {"name": str(i), "from": a, "to": b, "side": keys[sides[i]]}
        for i, (a, b) in enumerate(ends.tolist())
    ]
    room = scene(mirrors=parts[:3], pads=parts[3:])
    room = jax.tree.map(lambda leaf: leaf.astype(dtype), room)
    starts = generator.uniform(-1, 1, (2000, 2)).astype(dtype)
    angles = generator.uniform(-3, 3, 2000).astype(dtype)
    hits = trace_rays(
        room, jnp.zeros(0, dtype), jnp.asarray(starts), jnp.asarray(angles), bounces=2
    )
    assert hits.coordinate.dtype == dtype
    surfaces = Surfaces([(a, b) for a, b in (ends @ [1, 1j]).tolist()], sides, 3, [0.0] * 3, {})
    heading = np.cos(angles.astype(float)), np.sin(angles.astype(float))
    wanted, along = cast(surfaces, starts.astype(float) @ [1, 1j], heading, 2)
    surface, active = np.asarray(hits.surface), np.asarray(hits.active)
    coordinate = np.asarray(hits.coordinate)
    wrong = 0
    for ray, met in enumerate(surface.tolist()):
        leg = next((leg for leg, index in enumerate(met) if index >= 3 and active[ray, leg]), None)
        found = 0 if leg is None else surfaces.number(met[:leg], met[leg] - 3)
        if found != wanted[ray]:
            wrong += 1
        elif leg is not None:
            assert coordinate[ray, leg] == pytest.approx(along[ray], abs=tolerance)
    assert wrong <= most_wrong  # rays through corners, in single precision
    assert np.mean(wanted > 0) > 0.1
