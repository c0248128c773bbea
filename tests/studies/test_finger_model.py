"""The finger as a pytree: the same as its files, and differentiable from thickness to pixels."""

from __future__ import annotations

import functools
import json
import runpy
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError
from kinematics import parse_linkage, solve_poses, solve_transmission
from optics import find_coverage, parse_scene
from optics.scene.writer import scene_tables
from studies.models import Finger
from studies.models.finger import pins_of
from tests.studies.fingers import seeing_finger

EXAMPLE = Path(__file__).parents[2] / "examples" / "finger_gradient.py"

STRUCTURAL_ZEROS = {
    "least transmission angle": ("pins", "body.intermediate"),
    "coverage of the distal pad": ("body", "camera.along", "camera.depth", "mirrors[0]"),
    "px/mm where it begins": ("body", "camera", "mirrors[0]"),
    "row of its corner": ("body", "camera"),
}
"""By figure, what it depends on at all; its slopes with respect to all else are 0."""

ALSO_ZERO = {
    "coverage of the distal pad": ("body.proximal", "body.flexion"),
    "px/mm where it begins": (
        *("body.proximal", "body.distal", "body.flexion", "body.rim"),
        *("camera.tilt", "camera.width", "camera.grazing"),
    ),
    "row of its corner": (
        *("body.proximal", "body.distal", "body.flexion", "body.rim"),
        *("camera.width", "camera.grazing"),
    ),
}
"""What of that they do not depend on: a pad begins at its joint, wherever it ends, …"""


@functools.cache
def example() -> dict:
    return runpy.run_path(str(EXAMPLE))


@functools.cache
def slopes_of_example() -> tuple[dict, dict]:
    figures, finger = example()["figures"], example()["FINGER"]
    return jax.jit(figures)(finger), jax.jit(jax.jacrev(figures))(finger)


def assert_same(found, wanted):
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14, atol=1e-12)


BODIES = [{}, {"thickness": 22.0, "axis_height": 5.0, "distal": 30.0, "range_deg": 80.0}]


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("drive", ["joints", "crank"])
def test_its_linkage_is_that_of_its_file(body, drive):
    """The reader of files assembles a sketch, of a finger as of any linkage."""
    finger = seeing_finger(**body)
    tables = json.loads(json.dumps(finger.linkage_tables(drive)))
    assert tables["joints"]["T"] == [23.0 + body.get("distal", 32.0), 0.0]
    assert_same(finger.linkage(drive), parse_linkage(tables))


@pytest.mark.parametrize("body", BODIES)
def test_its_scene_is_that_of_its_file(body):
    scene = seeing_finger(**body).scene()
    tables = json.loads(json.dumps(scene_tables(scene)))
    assert_same(scene, parse_scene(tables))
    height, gap = body.get("thickness", 25.0), body.get("axis_height", 4.0)
    tip = 23.0 + body.get("distal", 32.0)
    pads = {pad["name"]: [pad["from"], pad["to"]] for pad in tables["pads"]}
    assert pads == {
        "proximal": [[-33.5, -gap], [-gap, -gap]],
        "intermediate": [[gap, -gap], [23.0 - gap, -gap]],
        "distal": [[23.0 + gap, -gap], [tip - 1.5, -gap]],
    }
    blockers = {part["name"]: [part["from"], part["to"]] for part in tables["blockers"]}
    assert blockers["tip"] == [[tip, -gap], [tip, height - gap]]
    assert blockers["intermediate shell"] == [[0.0, height - gap], [23.0, height - gap]]


def test_a_thicker_finger_takes_its_back_along():
    finger = seeing_finger()
    thicker = eqx.tree_at(lambda one: one.body.thickness, finger, finger.body.thickness + 2)
    before, after = finger.scene(), thicker.scene()
    for part in ("mirrors", "blockers"):
        moved = np.asarray(getattr(after, part) - getattr(before, part))
        assert np.all(moved[..., 0] == 0)
        assert set(np.round(moved[..., 1].ravel(), 12)) <= {0.0, 2.0}
    assert np.all(np.asarray(after.mirrors - before.mirrors)[..., 1] > 1.9)
    assert np.all(after.pads == before.pads)


def test_a_finger_without_a_camera_has_no_scene():
    finger = seeing_finger()
    blind = Finger.of(finger.body, finger.pins)
    with pytest.raises(UserError, match=r"^finger: it has no camera; add \[camera\]$"):
        blind.scene()
    assert not blind.linkage("crank").springs


def named(slopes) -> dict[str, np.ndarray]:
    return {
        jax.tree_util.keystr(path)[1:]: np.asarray(leaf)
        for path, leaf in jax.tree.leaves_with_path(slopes)
    }


def test_pads_of_the_example_are_seen_in_part():
    finger, poses = example()["FINGER"], jnp.stack([example()["PIP"], example()["DIP"]])
    coverage = np.asarray(jax.jit(lambda one: find_coverage(one.scene(), poses).value)(finger))
    assert np.all((coverage > 0.2) & (coverage < 0.9))
    assert bool(solve_poses(finger.linkage(), -poses).ok)


def test_slopes_are_central_differences():
    """A step of 1e-5 errs by 1e-10 of a third derivative and by rounding's 1e-11 of the value."""
    figures, finger = jax.jit(example()["figures"]), example()["FINGER"]
    values, slopes = slopes_of_example()
    leaves, structure = jax.tree.flatten(finger)
    for number, leaf in enumerate(leaves):
        for index in np.ndindex(leaf.shape):
            step = 1e-5 * max(1.0, abs(float(leaf[index])))
            ends = [
                figures(
                    jax.tree.unflatten(
                        structure,
                        [*leaves[:number], leaf.at[index].add(move), *leaves[number + 1 :]],
                    )
                )
                for move in (step, -step)
            ]
            for name, value in values.items():
                wanted = float(ends[0][name] - ends[1][name]) / (2 * step)
                found = float(jax.tree.leaves(slopes[name])[number][index])
                scale = max(1.0, abs(wanted), abs(float(value)) / 100)
                assert abs(found - wanted) < 1e-6 * scale, (name, number, index)


def test_a_slope_is_not_zero_but_where_nothing_depends_on_a_dimension():
    _, slopes = slopes_of_example()
    for figure, of_figure in slopes.items():
        scale = max(float(np.abs(leaf).max()) for leaf in jax.tree.leaves(of_figure))
        for name, slope in named(of_figure).items():
            depends = name.startswith(STRUCTURAL_ZEROS[figure])
            depends &= name not in ALSO_ZERO.get(figure, ())
            assert (np.abs(slope).max() > 1e-9 * scale) == depends, (figure, name)


def test_slopes_of_a_batch_are_those_of_each():
    figures, finger = example()["figures"], example()["FINGER"]
    other = eqx.tree_at(lambda one: one.body.thickness, finger, finger.body.thickness + 0.1)
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), finger, other)

    def coverage(one: Finger) -> jax.Array:
        return figures(one)["coverage of the distal pad"]

    found = jax.jit(jax.vmap(jax.grad(coverage)))(batch)
    for number, one in enumerate((finger, other)):
        wanted = jax.jit(jax.grad(coverage))(one)
        for leaf, its in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
            np.testing.assert_allclose(leaf[number], its, rtol=1e-9, atol=1e-12)


def test_slopes_in_single_precision():
    """1e-3 of the largest slope of their kind."""
    figures, finger = example()["figures"], example()["FINGER"]
    _, exact = slopes_of_example()
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), finger)
    with jax.enable_x64(False):
        found = jax.jit(jax.jacrev(figures))(single)
    for name, of_figure in exact.items():
        scale = max(float(jnp.abs(leaf).max()) for leaf in jax.tree.leaves(of_figure))
        for one, other in zip(
            jax.tree.leaves(found[name]), jax.tree.leaves(of_figure), strict=True
        ):
            assert one.dtype == jnp.float32
            np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3 * scale)


def test_each_side_of_a_switch_has_its_own_slope():
    """Which pin has the least transmission angle changes with one coordinate of a pin."""
    finger = seeing_finger()
    before, posture = pins_of(finger), -jnp.deg2rad(jnp.array([60.0, 30.0]))

    def angles(x: jax.Array) -> jax.Array:
        pins = eqx.tree_at(lambda one: one.E, before, before.E.at[0].set(x))
        moved = eqx.tree_at(lambda one: one.pins, finger, pins)
        return jnp.stack(list(solve_transmission(moved.linkage(), posture).angles.values()))

    every = jax.jit(jax.vmap(angles))
    slope = jax.jit(jax.grad(lambda x: jnp.min(angles(x))))
    low, high = float(before.E[0]) - 6, float(before.E[0]) + 6
    least = np.argmin(every(jnp.linspace(low, high, 200)), axis=1)
    at = int(np.flatnonzero(least[1:] != least[:-1])[0])
    places = np.linspace(low, high, 200)[[at, at + 1]]
    for place in places:
        ends = [float(jnp.min(angles(jnp.asarray(place + move)))) for move in (1e-5, -1e-5)]
        assert float(slope(jnp.asarray(place))) == pytest.approx(
            (ends[0] - ends[1]) / 2e-5, abs=1e-7
        )
    assert abs(float(slope(jnp.asarray(places[0])) - slope(jnp.asarray(places[1])))) > 1e-3


def test_the_example_runs():
    done = subprocess.run(
        [sys.executable, str(EXAMPLE)], capture_output=True, text=True, check=True
    )
    assert "coverage of the distal pad: 0.5475" in done.stdout
    assert done.stdout.count(".body.thickness") == 4
