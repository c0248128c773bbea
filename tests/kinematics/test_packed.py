"""Poses in one array: against dyads of circles, their complex steps, and `solve_poses`."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kinematics import compile_poses, pack_poses, parse_linkage
from kinematics.solve.poses import BLOCK
from tests.helpers import close
from tests.kinematics.gallery import each_linkage, gallery, gallery_tables, poses_of

FRAME = 100.0
"""Between O2 and O4 of the gallery's four-bar, which lie on the x axis."""


def dyad(crank, coupler, rocker, angle):
    """B of the four-bar by the law of cosines, and its margin; complex numbers are steps."""
    ax, ay = crank * np.cos(angle), crank * np.sin(angle)
    dx, dy = FRAME - ax, -ay
    apart = np.sqrt(dx**2 + dy**2)
    along = (coupler**2 - rocker**2 + apart**2) / (2 * apart)
    height = np.sqrt(coupler**2 - along**2 + 0j)
    x, y = ax + (along * dx - height * dy) / apart, ay + (along * dy + height * dx) / apart
    return x, y, np.minimum(coupler + rocker - apart.real, apart.real - np.abs(coupler - rocker))


def sizes(linkage) -> tuple[float, float, float]:
    links = linkage.links
    return (
        float(links["crank"].length),
        float(links["coupler"].length),
        float(links["rocker"].length),
    )


def test_a_four_bar_is_what_the_law_of_cosines_gives():
    linkage = gallery("four-bar")
    angles = np.linspace(0, 2 * math.pi, 360)
    found = jax.device_get(compile_poses(linkage)(angles[:, None]))
    x, y, margin = dyad(*sizes(linkage), angles)
    close(found.position("B"), [x.real, y.real], 1e-12)
    close(found.margin, margin, 1e-12)
    assert np.all(found.ok == 1)
    close(found.direction("crank"), [np.cos(angles), np.sin(angles)], 1e-15)
    # Rows are views of the one array.
    assert all(np.shares_memory(one, found.array) for one in (found.margin, found.position("B")))


def test_slopes_are_complex_steps_of_the_law_of_cosines():
    linkage = gallery("four-bar")
    angles, step = np.linspace(0.1, 6.0, 9), 1e-30

    def place(linkage, angles):
        return pack_poses(linkage, angles[:, None]).position("B")

    of_sizes, of_angles = jax.jit(jax.jacrev(place, (0, 1)))(linkage, jnp.asarray(angles))
    for number, name in enumerate(("crank", "coupler", "rocker")):
        moved = [size + 1j * step * (i == number) for i, size in enumerate(sizes(linkage))]
        x, y, _ = dyad(moved[0], moved[1], moved[2], angles)
        close(of_sizes.links[name].length, np.imag([x, y]) / step, 1e-12)
    x, y, _ = dyad(*sizes(linkage), angles + 1j * step)
    close(np.einsum("kii->ki", of_angles), np.imag([x, y]) / step, 1e-11)


@each_linkage(["four-bar", "scotch-yoke", "stephenson", "watt"])
def test_every_linkage_of_the_gallery_is_as_solve_poses_has_it(name):
    linkage = gallery(name)
    home = np.asarray(linkage.reference.inputs)
    inputs = home + np.linspace(-0.5, 0.5, 7)[:, None] * np.eye(len(home))[0]
    found, wanted = jax.device_get(compile_poses(linkage)(inputs)), poses_of(linkage, inputs)
    np.testing.assert_array_equal(found.ok == 1, wanted.ok)
    ok = np.asarray(wanted.ok)
    assert ok[3]
    size = float(linkage.size())
    close(found.margin, wanted.margin, 1e-9 * size)
    for joint, at in wanted.value.joints.items():
        wide = [np.broadcast_to(one, ok.shape)[ok] for one in (at.x, at.y)]
        close(found.position(joint)[:, ok], wide, 1e-9 * size)
    for body, turn in wanted.value.bodies.items():
        wide = [np.broadcast_to(one, ok.shape)[ok] for one in (turn.x, turn.y)]
        close(found.direction(body)[:, ok], wide, 1e-9)
    for slider, at in wanted.value.slides.items():
        close(found.slide(slider)[ok], np.broadcast_to(at, ok.shape)[ok], 1e-9 * size)


def test_long_batches_are_cut():
    linkage = gallery("four-bar")
    angles = np.linspace(0, 6, BLOCK + 3)[:, None]
    whole = np.asarray(compile_poses(linkage)(angles).array)
    part = np.asarray(compile_poses(linkage)(angles[-5:]).array)
    close(whole[:, -5:], part, 1e-11)


def test_what_is_no_pose_is_marked_and_finite():
    tables = gallery_tables("four-bar")
    tables["bodies"]["crank"]["lengths"]["O2-A"] = 90.0
    inputs = np.array([[0.0], [1.5], [math.nan], [math.inf]])
    linkage = parse_linkage(tables)
    found = jax.device_get(compile_poses(linkage)(inputs))
    assert found.ok.tolist() == [0, 1, 0, 0]
    assert np.all(np.isfinite(found.array))
    slope = jax.grad(lambda one: jnp.sum(pack_poses(one, inputs).array))(linkage)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(slope))


def test_only_what_is_asked_for_is_packed():
    found = compile_poses(gallery("watt"), of=("A",))(np.array([[0.3]]))
    assert {"A", "D"} & {name for name, _ in found.joints} == {"A"}
    with pytest.raises(KeyError):
        found.position("D")
    # B depends on A, on fixed joints and on directions.
    found = compile_poses(gallery("four-bar"), of=("B",))(np.array([[0.3], [0.4]]))
    assert (found.joints, found.bodies, found.array.shape) == ((("B", 2),), (), (4, 2))
    found = compile_poses(gallery("slider-crank"), of=("C",))(np.array([[0.3]]))
    assert (found.joints, found.slides) == ((("C", 2),), ())
