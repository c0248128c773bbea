"""Edge-refined views: against the exact engine, dense fans of rays, and central differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import Scene, find_views, parse_scene, read_scene, trace_rays, trace_views
from tests.helpers import SCENES, load_toml
from tests.refusals import changed

CURVED = load_toml("scenes/curved.toml")

SAME = 1e-12
"""Both engines come within a few units of rounding of the truth."""


def curved(radius: float = -30.0, conic: float = 0.0) -> Scene:
    return parse_scene(changed(CURVED, {"mirrors/0/radius": radius, "mirrors/0/conic": conic}))


@pytest.mark.slow
def test_agrees_with_the_exact_engine_on_the_finger():
    finger = read_scene(SCENES / "finger.toml")
    for pip, dip in ((0.0, 20.0), (47.0, 61.0)):
        angles = jnp.deg2rad(jnp.asarray([pip, dip]))
        exact, traced = find_views(finger, angles), trace_views(finger, angles)
        np.testing.assert_array_equal(exact.ok, traced.ok)
        np.testing.assert_allclose(
            traced.margin, np.where(exact.ok, exact.margin, 0.0), atol=SAME, rtol=0
        )
        for pad in range(3):
            order = [
                np.lexsort((v.value.path[pad], -v.value.present[pad].astype(int)))
                for v in (exact, traced)
            ]
            count = int(exact.value.present[pad].sum())
            assert int(traced.value.present[pad].sum()) == count
            for name in ("path", "start", "end", "pixels", "px_per_mm", "distance", "spans"):
                mine, theirs = (
                    np.asarray(getattr(views.value, name)[pad])[rows[:count]]
                    for views, rows in zip((traced, exact), order, strict=True)
                )
                np.testing.assert_allclose(mine, theirs, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("radius", "conic"), [(-30.0, 0.0), (40.0, 0.0), (25.0, -1.0)])
def test_dense_fan_sees_the_same_in_a_curved_mirror(radius: float, conic: float):
    scene = curved(radius, conic)
    views = trace_views(scene, scene.pose())
    rays = 400_001
    angles = np.pi / 2 + np.deg2rad(60) * (np.linspace(0, 1, rays) - 0.5)
    hits = trace_rays(scene, scene.pose(), jnp.zeros((rays, 2)), jnp.asarray(angles), bounces=1)
    on_pad = (np.asarray(hits.surface[:, 1]) == 1) & np.asarray(hits.active[:, 1])
    seen = np.asarray(hits.coordinate[:, 1])[on_pad]
    assert len(seen) > 1000
    pieces = views.value
    mine = np.asarray(pieces.path[0]) == 1
    inside = np.zeros(len(seen), bool)
    for start, end in zip(pieces.start[0][mine], pieces.end[0][mine], strict=True):
        inside |= (seen >= float(start) - 1e-9) & (seen <= float(end) + 1e-9)
    assert inside.all()
    # And no more than that: what is seen has gaps no wider than neighbouring rays leave.
    edges = np.sort(seen)
    spacing = np.diff(edges)[np.diff(edges) < 1e-3].max()
    cells = np.unique(np.floor(edges / 1e-3))
    assert abs(float(pieces.coverage()[0]) - len(cells) * 1e-3) < 5e-3 + spacing


@pytest.mark.slow
def test_gradients_through_edges_of_curved_views():
    scene = curved()

    def total(values: jax.Array) -> jax.Array:
        moved = eqx.tree_at(
            lambda of: (of.radii, of.conics, of.camera.position, of.blockers, of.mirrors),
            scene,
            (
                values[0:1],
                values[1:2],
                values[2:4],
                scene.blockers.at[0, 0].set(values[4:6]),
                scene.mirrors.at[0, 0].set(values[6:8]),
            ),
        )
        found = trace_views(moved, moved.pose(), rays=256)
        pieces = found.value
        weights = jnp.arange(1.0, pieces.start.shape[1] + 1)
        ends = jnp.sum(pieces.start * weights[None]) + jnp.sum(pieces.end * weights[None] ** 2)
        return ends + pieces.pixels.sum() / 100 + pieces.distance.sum() / 10 + found.margin.sum()

    at = jnp.asarray([-30.0, 0.2, 0.1, -0.2, 6.0, 4.0, -6.0, 20.0])
    both = jax.jit(jax.value_and_grad(total))  # one program: compiling is most of the time
    steps = 1e-5 * np.eye(len(at))
    expected = [float(both(at + step)[0] - both(at - step)[0]) / 2e-5 for step in steps]
    np.testing.assert_allclose(both(at)[1], expected, rtol=1e-6, atol=1e-7)


@pytest.mark.slow
def test_too_many_pieces_are_told():
    """Of a pad with a post before its middle, without a mirror."""
    pad = {"name": "pad", "from": [-5, 10], "to": [5, 10]}
    post = {"name": "post", "from": [-1, 5], "to": [1, 5]}
    scene = parse_scene({"camera": CURVED["camera"], "pads": [pad], "blockers": [post]})
    found = trace_views(scene, scene.pose(), max_pieces=1)
    assert any("max_pieces" in message for message in found.messages())
