"""The finger as a pytree: the same as its files, and differentiable from thickness to pixels."""

from __future__ import annotations

import contextlib
import functools
import io
import math
import runpy
import tomllib
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from designopt import UserError
from kinematics import parse_linkage, solve_poses, solve_transmission
from optics import find_coverage, parse_scene
from studies.models import Finger
from studies.models.finger import pins_of
from studies.models.spec_files import finger_files
from tests.helpers import assert_same
from tests.studies.fingers import seeing_finger

EXAMPLE = Path(__file__).parents[2] / "examples" / "finger_gradient.py"

STRUCTURAL_ZEROS = {
    "least transmission angle": ("pins", "body.intermediate"),
    "coverage of the distal pad": ("body", "camera.along", "camera.depth", "mirrors[0].ends"),
    "px/mm where it begins": ("body", "camera", "mirrors[0].ends"),
    "row of its corner": ("body", "camera"),
}
"""By figure, what it depends on at all; its slopes with respect to all else are 0."""

ELSEWHERE = (
    *("body.proximal", "body.distal", "body.rim"),
    *("camera.width", "camera.grazing", "camera.back"),
)
ALSO_ZERO = {
    "coverage of the distal pad": ("body.proximal", "camera.back"),
    "px/mm where it begins": (*ELSEWHERE, "camera.tilt"),
    "row of its corner": ELSEWHERE,
}
"""What of that they do not depend on: a pad begins at its joint, wherever it ends, …"""


@functools.cache
def example() -> dict:
    """What the example has made when it is through, and what it has printed."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        return runpy.run_path(str(EXAMPLE), run_name="__main__") | {"printed": printed.getvalue()}


BODIES = [{}, {"thickness": 22.0, "axis_height": 5.0, "distal": 30.0, "range_deg": 80.0}]


@pytest.mark.parametrize("body", BODIES)
def test_its_linkage_and_its_scene_are_those_of_its_files(body):
    """Their readers assemble a sketch and trace a scene, of a finger as of anything else."""
    finger = seeing_finger(**body)
    files = {file.name: tomllib.loads(str(file.content)) for file in finger_files(finger)}
    assert_same(finger.linkage(), parse_linkage(files["linkage.toml"]))
    assert_same(finger.linkage("crank"), parse_linkage(files["linkage-crank.toml"]))
    tables = files["scene.toml"]
    assert_same(finger.scene(), parse_scene(tables))
    height, low = body.get("thickness", 25.0), body.get("axis_height", 4.0)
    gap = {90.0: low, 80.0: low * math.tan(math.radians(40.0))}[body.get("range_deg", 90.0)]
    tip = 23.0 + body.get("distal", 32.0)
    assert files["linkage.toml"]["joints"]["T"] == [tip, 0.0]
    pads = {pad["name"]: [pad["from"], pad["to"]] for pad in tables["pads"]}
    expected = {
        "proximal": [[-33.5, -low], [-gap, -low]],
        "intermediate": [[gap, -low], [23.0 - gap, -low]],
        "distal": [[23.0 + gap, -low], [tip - 1.5, -low]],
    }
    for name, ends in expected.items():
        np.testing.assert_allclose(pads[name], ends, rtol=0, atol=1e-14)
    blockers = {part["name"]: [part["from"], part["to"]] for part in tables["blockers"]}
    assert blockers["tip"] == [[tip, -low], [tip, height - low]]
    assert blockers["intermediate shell"] == [[0.0, height - low], [23.0, height - low]]


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


def test_the_example_runs():
    assert "coverage of the distal pad: 0.5475" in example()["printed"]
    assert example()["printed"].count(".body.thickness") == 4


def test_pads_of_the_example_are_seen_in_part():
    @jax.jit
    def shown(finger: Finger) -> tuple[jax.Array, jax.Array]:
        pose = jnp.stack([example()["PIP"], example()["DIP"]])
        return find_coverage(finger.scene(), pose).value, solve_poses(finger.linkage(), -pose).ok

    coverage, closed = map(np.asarray, shown(example()["FINGER"]))
    assert np.all((coverage > 0.2) & (coverage < 0.9))
    assert closed


def test_slopes_are_central_differences():
    """A step of 1e-5 errs by 1e-10 of a third derivative and by rounding's 1e-11 of the value."""
    point, build = ravel_pytree(example()["FINGER"])
    sizes = 1e-5 * np.maximum(1.0, np.abs(point))
    points = np.asarray(point) + np.concatenate([np.diag(sizes), -np.diag(sizes)])
    ends = jax.jit(jax.vmap(lambda flat: example()["figures"](build(flat))))(jnp.asarray(points))
    for name, value in example()["values"].items():
        high, low = np.split(np.asarray(ends[name]), 2)
        found, wanted = ravel_pytree(example()["slopes"][name])[0], (high - low) / (2 * sizes)
        scale = np.maximum(np.maximum(1.0, np.abs(wanted)), abs(float(value)) / 100)
        np.testing.assert_array_less(np.abs(found - wanted), 1e-6 * scale, name)


def test_a_slope_is_not_zero_but_where_nothing_depends_on_a_dimension():
    for figure, of_figure in example()["slopes"].items():
        scale = np.abs(ravel_pytree(of_figure)[0]).max()
        for path, slope in jax.tree.leaves_with_path(of_figure):
            name = jax.tree_util.keystr(path)[1:]
            depends = name.startswith(STRUCTURAL_ZEROS[figure])
            depends &= name not in ALSO_ZERO.get(figure, ())
            assert (np.abs(slope).max() > 1e-9 * scale) == depends, (figure, name)


def test_slopes_of_a_batch_are_those_of_each():
    finger, figure = example()["FINGER"], "coverage of the distal pad"
    other = eqx.tree_at(lambda one: one.body.thickness, finger, finger.body.thickness + 1)
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), other, finger)
    found = jax.jit(jax.vmap(jax.grad(lambda one: example()["figures"](one)[figure])))(batch)
    for leaf, its in zip(*map(jax.tree.leaves, (found, example()["slopes"][figure])), strict=True):
        np.testing.assert_allclose(leaf[1], its, rtol=1e-9, atol=1e-12)
    assert found.body.thickness[0] != found.body.thickness[1]


def test_slopes_in_single_precision():
    """1e-3 of the largest slope of their kind; forwards, which compiles faster."""
    single = jax.tree.map(lambda leaf: np.asarray(leaf, np.float32), example()["FINGER"])
    with jax.enable_x64(False):
        found = jax.jit(jax.jacfwd(example()["figures"]))(single)
    for name, of_figure in example()["slopes"].items():
        for one, other in zip(*map(jax.tree.leaves, (found[name], of_figure)), strict=True):
            scale = np.abs(ravel_pytree(of_figure)[0]).max()
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

    def least_angle(x: jax.Array) -> tuple[jax.Array, jax.Array]:
        every = angles(x)
        return jnp.min(every), jnp.argmin(every)

    slopes = jax.jit(jax.vmap(jax.value_and_grad(least_angle, has_aux=True)))
    grid = float(before.E[0]) + np.linspace(-6, 6, 200)
    (_, least), slope = slopes(jnp.asarray(grid))
    at = int(np.flatnonzero(least[1:] != least[:-1])[0])
    places, found = grid[[at, at + 1]], slope[at : at + 2]
    ends = np.resize(np.concatenate([places + 1e-5, places - 1e-5]), len(grid))
    high, low = np.asarray(slopes(jnp.asarray(ends))[0][0])[:4].reshape(2, 2)
    np.testing.assert_allclose(found, (high - low) / 2e-5, atol=1e-7)
    assert abs(found[1] - found[0]) > 1e-3
