"""A finger out of place, against the same by complex numbers; names of errors; derivatives."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from optics.scene.camera import Equidistant, KannalaBrandt, Pinhole
from optics.scene.fabrication import Fabrication, name_fabrication_errors, perturb, scale_errors
from optics.scene.scene import Scene
from tests.helpers import check_gradients
from tests.optics.extruded import finger

ROUNDING = 1e-13
"""Of a few operations on lengths of some 50 mm, relative."""

SLOPES = 1e-8
"""What central differences leave, of a function and a design of order one."""

BODY, TIP = 0, 5
"""Blockers: the camera's body, and one at the other end of the finger."""

MIRRORS, PADS = 2, 3

LENS = KannalaBrandt(jnp.array([0.05, -0.012, 0.004, -0.0007]))


def flawed(**errors: Any) -> Fabrication:
    """Errors by their names, and no others."""
    return dataclasses.replace(Fabrication.none(finger().layout), **errors)


def with_lens(projection: Any) -> Scene:
    return eqx.tree_at(lambda scene: scene.camera.projection, finger(), projection)


def numbers(places: Any) -> np.ndarray:
    """Places as complex numbers."""
    return np.asarray(places) @ [1, 1j]


def tilted(ends: np.ndarray, angle: Any) -> np.ndarray:
    """Segments, complex and along the first axis, turned about their middles."""
    middle = ends.mean(axis=1, keepdims=True)
    return middle + (ends - middle) * np.exp(1j * np.reshape(angle, (-1, 1)))


def along(ends: np.ndarray) -> np.ndarray:
    """Unit vectors from first to second ends."""
    step = ends[:, 1:] - ends[:, :1]
    return step / np.abs(step)


def parts(scene: Scene) -> dict[str, Any]:
    """What may be out of place."""
    return {
        "position": numbers(scene.camera.position),
        "direction": scene.camera.direction,
        "mirrors": numbers(scene.mirrors),
        "pads": numbers(scene.pads),
        "blockers": numbers(scene.blockers),
    }


def check(made: Scene, **changed: Any) -> None:
    """A scene differs from the finger in what is named, and in nothing else."""
    found, wanted = parts(made), parts(finger()) | changed
    for name in wanted:
        np.testing.assert_allclose(found[name], wanted[name], rtol=ROUNDING, err_msg=name)
    kept = "field_of_view", "pixels"
    assert all(getattr(made.camera, name) == getattr(finger().camera, name) for name in kept)
    for name in ("radii", "conics", "grazing", "hinges"):
        np.testing.assert_array_equal(getattr(made, name), getattr(finger(), name))
    assert made.layout == finger().layout


@pytest.mark.parametrize("carried", [(), (BODY,)])
def test_without_errors_a_finger_is_made_as_designed(carried):
    made = perturb(finger(), Fabrication.none(finger().layout), carried=carried)
    check(made)
    assert jax.tree.structure(made) == jax.tree.structure(finger())


@pytest.mark.parametrize("held", [[], [BODY, TIP]])
def test_errors_move_parts_as_complex_numbers_do(held):
    """Camera and what it carries about the pinhole, others about their middles and to the left."""
    rng = np.random.default_rng(0)
    mirror_tilt, mirror_offset = rng.uniform(-0.3, 0.3, (2, MIRRORS))
    pad_tilt, pad_offset, pad_shift = rng.uniform(-0.3, 0.3, (3, PADS))
    numbers = [0.3, -0.2], 2.0, 0.04, mirror_tilt, mirror_offset, pad_tilt, pad_offset, pad_shift
    errors = Fabrication(*map(jnp.asarray, numbers))
    designed, move = parts(finger()), 0.3 - 0.2j
    mirrors = tilted(designed["mirrors"], mirror_tilt)
    pads, blockers = tilted(designed["pads"], pad_tilt), designed["blockers"].copy()
    pinhole = designed["position"]
    blockers[held] = pinhole + move + (blockers[held] - pinhole) * np.exp(0.04j)
    check(
        perturb(finger(), errors, carried=held),
        position=pinhole + move,
        direction=designed["direction"] + 0.04,
        mirrors=mirrors + 1j * mirror_offset[:, None] * along(mirrors),
        pads=pads + (pad_shift + 1j * pad_offset)[:, None] * along(pads),
        blockers=blockers,
    )


def test_every_error_has_its_name_in_the_order_of_the_entries():
    layout, errors = finger().layout, flawed(distortion=jnp.array(0.0))
    names, entries = name_fabrication_errors(layout, errors), ravel_pytree(errors)[0]
    assert len(names) == len(entries) == len(set(names))
    assert name_fabrication_errors(layout, Fabrication.none(layout)) == names[:-1]
    fields: dict[str, tuple[str, Any]] = {
        "camera along x (mm)": ("camera", 0),
        "camera along y (mm)": ("camera", 1),
        "camera across the section (mm)": ("lateral", ()),
        "camera tilt (rad)": ("tilt", ()),
        "lens k1": ("distortion", ()),
    }
    for kind, known in (("mirror", layout.mirrors), ("pad", layout.pads)):
        for what, unit in (("tilt", "rad"), ("offset", "mm"), ("shift", "mm")):
            for place, part in enumerate(known):
                fields[f"{what} of {kind} {part.name} ({unit})"] = (f"{kind}_{what}", place)
    # Each entry numbered, its number is where its name says.
    numbered = scale_errors(jax.tree.map(np.ones_like, errors), jnp.arange(float(len(names))))
    found = [float(getattr(numbered, fields[name][0])[fields[name][1]]) for name in names]
    assert found == [*range(len(names))]


@pytest.mark.parametrize("distortion", [None, 0.02])
def test_errors_are_so_many_deviations_in_the_order_of_the_entries(distortion):
    rng = np.random.default_rng(3)
    none = dataclasses.replace(Fabrication.none(finger().layout), distortion=distortion)
    start, unravel = ravel_pytree(none)
    deviations, numbers = rng.uniform(0.01, 0.3, (2, len(start)))
    errors = scale_errors(unravel(jnp.asarray(deviations)), jnp.asarray(numbers))
    assert jax.tree.structure(errors) == jax.tree.structure(none)
    np.testing.assert_allclose(ravel_pytree(errors)[0], deviations * numbers, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("lens", "before"),
    [(Equidistant(), [0, 0, 0, 0]), (LENS, LENS.coefficients)],
    ids=["equidistant", "kannala-brandt"],
)
def test_a_distortion_adds_a_cube_to_the_lens_and_keeps_the_field_of_view(lens, before):
    made = perturb(with_lens(lens), flawed(distortion=jnp.array(0.03)))
    check(made)
    angles = np.linspace(-1.3, 1.3, 9)
    heights = made.camera.projection.height(jnp.asarray(angles))
    powers = angles[:, None] ** [1, 3, 5, 7, 9]
    wanted = powers @ [1, *(before + np.array([0.03, 0, 0, 0]))]
    np.testing.assert_allclose(heights, wanted, rtol=ROUNDING, atol=ROUNDING)
    half, pixels = made.camera.field_of_view / 2, float(made.camera.pixels)
    limits = made.camera.pixel(jnp.stack([half, -half]))
    np.testing.assert_allclose(limits, [0, pixels], atol=1000 * ROUNDING)


def test_a_distortion_of_a_pinhole_is_refused():
    for lens in (Equidistant(), LENS, Pinhole()):  # without one it stays as designed
        made = perturb(with_lens(lens), Fabrication.none(finger().layout))
        assert eqx.tree_equal(made.camera.projection, lens)
    with pytest.raises(ValueError, match="equidistant or Kannala-Brandt lens only"):
        perturb(with_lens(Pinhole()), flawed(distortion=jnp.array(0.03)))


def test_numbers_without_a_dtype_become_floats():
    mirrors, pads = np.zeros(MIRRORS, int), np.zeros(PADS, int)
    errors = Fabrication(np.array([0, 1]), 0, 0.5, mirrors, mirrors, pads, pads, pads, 0.25)
    assert all(leaf.dtype == float for leaf in jax.tree.leaves(errors))
    np.testing.assert_array_equal(errors.camera, [0.0, 1.0])
    assert errors.distortion == 0.25


def test_derivatives_of_what_is_made():
    scene = with_lens(LENS)
    start, unravel = ravel_pytree(flawed(distortion=jnp.array(0.0)))
    rng = np.random.default_rng(2)
    shapes = [np.shape(leaf) for leaf in jax.tree.leaves(eqx.filter(scene, eqx.is_array))]
    weights = [rng.uniform(-1, 1, shape) / 50 for shape in shapes]

    def weighed(design: list[jax.Array]) -> jax.Array:
        made = perturb(scene, unravel(jnp.stack(design)), carried=(BODY,))
        leaves = jax.tree.leaves(eqx.filter(made, eqx.is_array))
        return sum(
            (jnp.sum(weight * leaf) for weight, leaf in zip(weights, leaves, strict=True)),
            jnp.zeros(()),
        )

    # None at all, and some.
    designs = np.stack([np.zeros(len(start)), rng.uniform(-0.3, 0.3, len(start))])
    check_gradients(weighed, [*jnp.asarray(designs.T)], atol=SLOPES)
