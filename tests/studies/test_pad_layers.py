"""Layers on the pads of a finger, its lens as sold: against polygons, files, rays, differences."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from jax.flatten_util import ravel_pytree
from shapely.affinity import rotate

from designopt import UserError
from designopt.study.settings import spec_with
from optics import find_coverage, find_views, parse_scene
from optics.scene.catalogue import camera_catalogue
from optics.scene.writer import scene_tables
from optics.visibility.sharpness import find_sharpness
from studies.models import Finger
from studies.models.body import BodySpec
from studies.models.finger_file import (
    bare_finger,
    finger_tables,
    format_finger,
    packaged_finger,
    parse_finger,
    write_finger,
)
from studies.models.finger_parts import PHALANGES
from studies.models.mirror_design.clearances import dorsal_room
from studies.models.mirror_design.placement import reference_layout
from studies.models.mirror_design.postures import find_worst_postures, lost_strips
from studies.models.mirror_design.spec import CameraSpec, MirrorSpec, PadsSpec
from studies.models.pad_layers import PadLayers
from studies.oracles import layers as oracle
from studies.oracles.clearances import pad_pieces
from studies.oracles.layered_scenes import posed_tables, read
from tests.helpers import assert_same
from tests.studies.fingers import BARE, LENS, bare_body

MODULE = {
    "lens_diameter": 6.0, "lens_length": 3.0, "pupil_depth": -0.2, "board": [8.0, 8.0],
    "board_thickness": 1.0, "connector_length": 0.5,
}  # fmt: skip


def finger(
    thickness=(1.0, 1.0), index=(1.49, 1.41), ends: Any = "black", reach=1.0, camera=None, **body
):
    """The reference layout with layers, of a body whose pads keep apart."""
    made = reference_layout(Finger.of(bare_body(**{"pad_clearance": 0.5} | body)), camera or LENS)
    shares = np.full((len(thickness), 2), reach)
    return replace(
        made, layers=PadLayers(np.array(thickness), np.array(index), shares, shares, ends=ends)
    )


def outlines(made):
    """Polygons of the layers of every pad in the straight finger, read from its scene's tables."""
    for pad in scene_tables(made.scene())["pads"]:
        start, end = np.array(pad["from"]), np.array(pad["to"])
        along, level, parts = (end - start) / np.linalg.norm(end - start), 0.0, []
        up = np.array([-along[1], along[0]])
        for layer in reversed(pad["layers"]):
            t, lower, upper = layer["thickness"], [], []
            for corner, out, over, bevel in zip(
                (start, end), (-1, 1), layer["overhang"], layer["bevel_deg"], strict=True
            ):
                place = corner + out * over * along + level * up
                lower.append(place)
                upper.append(place + t * up - out * t * math.tan(math.radians(bevel)) * along)
            parts.append(shapely.Polygon([*lower, *upper[::-1]]))
            level += t
        yield shapely.union_all(parts)


@pytest.mark.parametrize(
    ("thickness", "ranges"),
    [((2.0,), [90, 90]), ((3.0, 2.0), [90, 70]), ((3.0,), [60, 100]), ((2.0, 1.5), [100, 45])],
)
def test_neighbours_layers_come_as_near_as_is_allowed_and_no_nearer(thickness, ranges):
    """Polygons of the exported file, turned by shapely about the axes; 3 + 2 mm end above these."""
    index = [1.49] * len(thickness)
    made = finger(thickness, index, range_deg=ranges, protrusion=0.3, axis_height=3.6)
    proximal, middle, distal = outlines(made)
    for part, axis, sign, end in (
        (proximal, (0.0, 0.0), 1, ranges[0]),
        (distal, (23.0, 0.0), -1, ranges[1]),
    ):
        apart = [
            rotate(part, sign * degrees, origin=axis).distance(middle)
            for degrees in np.linspace(0, end, 41)
        ]
        assert min(apart) == pytest.approx(0.5, abs=1e-9)


def test_the_oracle_reads_the_same_layers(tmp_path):
    """Those of the scene and of `studies.oracles.clearances`, with all kinds of ends."""
    made = finger((1.5, 1.0), range_deg=[88, 79], protrusion=0.3, pad_clearance=0.4, rim=2.0)
    shares = np.random.default_rng(5).uniform(0, 1, (2, 2, 2))
    assert made.layers is not None
    layers = replace(made.layers, reach=shares[0], outer_reach=shares[1])
    write_finger(replace(made, layers=layers), tmp_path / "finger.toml")
    tables = tomllib.loads((tmp_path / "finger.toml").read_text())
    pieces = pad_pieces(tables["body"], tables["pads"])
    for phalanx, outline in zip(PHALANGES, outlines(replace(made, layers=layers)), strict=True):
        along = 23.0 if phalanx == "distal" else 0.0
        own = [
            shapely.MultiPoint([(at.real + along, at.imag) for at in piece]).convex_hull
            for piece in pieces[phalanx]
        ]
        assert outline.symmetric_difference(shapely.union_all(own)).area < 1e-9


def test_gaps_are_those_of_the_formula():
    """Clearance of neighbours 2 (g cos r/2 − (h + p) sin r/2), by complex numbers."""
    made = finger(range_deg=[80, 95], protrusion=0.4).body
    for gap, degrees in zip(made.gaps, (80, 95), strict=True):
        own = complex(-float(gap), -4.4)
        turned = own * np.exp(1j * math.radians(degrees))
        assert abs(turned - complex(float(gap), -4.4)) == pytest.approx(0.5, abs=1e-12)
    plain = bare_body()
    assert [float(gap) for gap in plain.gaps] == [4.0, 4.0]
    assert float(plain.membrane) == 71.0
    assert float(packaged_finger().body.membrane) == pytest.approx(71 - 4 / math.sqrt(2), abs=1e-9)
    assert BodySpec().pad_clearance == 1.0


def test_a_pad_needs_room():
    with pytest.raises(ValueError, match=r"intermediate \(23 mm\) leaves no room for a pad"):
        BodySpec(pad_clearance=14.0)
    with pytest.raises(ValueError, match="write one number, or a pair"):
        BodySpec.model_validate({"range_deg": [90, 80, 70]})


SOLD = CameraSpec(model="ov5647-160", f_number=2.35, focus=20.0)


@pytest.mark.parametrize("camera", [LENS, SOLD, CameraSpec()])
@pytest.mark.parametrize("ends", ["black", "clear"])
def test_a_file_has_all_of_it(camera, ends):
    made = finger(ends=ends, camera=camera, range_deg=[90, 75], protrusion=0.2)
    made = eqx.tree_at(lambda one: one.layers.reach, made, jnp.array([[0.2, 0.7], [0.0, 1.0]]))
    text = format_finger(made)
    again = parse_finger(tomllib.loads(text), "copy")
    for one, other in zip(jax.tree.leaves(made), jax.tree.leaves(again), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-14)
    assert again.layers is not None
    assert again.layers.ends == ends
    assert format_finger(again) == text
    tables = json.loads(json.dumps(scene_tables(made.scene())))
    assert_same(parse_scene(tables, "finger"), made.scene(), rtol=1e-12)


def test_a_module_is_a_part_of_the_scene():
    tables = finger_tables(finger())
    tables["camera"] |= {"module": MODULE, "depth": 5.5}
    made = parse_finger(tables, "finger")
    scene = made.scene()
    assert len(scene.layout.module) == 6
    assert "camera body" not in [part.name for part in scene.layout.blockers]
    assert_same(parse_scene(json.loads(json.dumps(scene_tables(scene))), "finger"), scene)
    # Barrel and board behind the pupil, x ahead along the axis, which looks down and back by 6.3°.
    corners = [complex(-0.2, y) for y in (-3, 3)]
    corners += [complex(x, y) for x in (-3.2, -4.7) for y in (-4, 4)]
    turn = np.exp(1j * math.radians(-90 - 6.3))
    places = complex(15.75, 21.0 - 5.5) + turn * np.array(corners)
    assert float(dorsal_room(made)) == pytest.approx(21.0 - places.imag.max(), abs=1e-12)
    barrel, board = np.asarray(made.camera_boxes()) @ np.array([1, 1j])
    # Of the barrel the end that is hidden in the board, too.
    np.testing.assert_allclose(sorted(board, key=np.angle), sorted(places[2:], key=np.angle))
    np.testing.assert_allclose(sorted(barrel[:4], key=np.imag)[:2], sorted(places[:2], key=np.imag))
    # Nearer to the back it would stand out of it, and a scene's reader refuses that.
    out = eqx.tree_at(lambda one: one.camera.depth, made, jnp.asarray(4.5))
    assert float(dorsal_room(out)) < 0
    with pytest.raises(UserError, match="'intermediate shell' would reach into it"):
        parse_scene(json.loads(json.dumps(scene_tables(out.scene()))), "finger")


def test_what_is_no_fingers_camera_is_refused():
    tables = finger_tables(packaged_finger())
    with pytest.raises(UserError, match="camera: direction_deg: of a scene's camera"):
        parse_finger(tables | {"camera": tables["camera"] | {"direction_deg": 3.0}}, "file")
    with pytest.raises(UserError, match="no camera of the catalogue is named 'ov5647-161'"):
        parse_finger(tables | {"camera": tables["camera"] | {"model": "ov5647-161"}}, "file")
    with pytest.raises(ValueError, match="did you mean 'ov5647-160'"):
        CameraSpec(model="ov5647-161")
    with pytest.raises(ValueError, match="f_number is of a lens before a sensor"):
        CameraSpec(fov_deg=160, f_number=2.0)
    with pytest.raises(ValueError, match="1 layers have a thickness and 2 an index"):
        PadsSpec(thickness=[2.0])


def test_the_bare_fingers_camera_stands_out_of_the_back():
    """By 0.23 mm, and its wall's 0.7 mm: its corner is 4 mm behind and beside the lens, at 3.8°."""
    tilt, depth = math.radians(3.8071733237735117), 4.028593396503858
    out = 4 * (math.cos(tilt) + math.sin(tilt)) - depth
    assert float(dorsal_room(bare_finger())) == pytest.approx(-out - 0.7, abs=1e-12)
    assert out == pytest.approx(0.228, abs=1e-3)
    assert float(dorsal_room(packaged_finger())) >= -1e-12


@pytest.mark.parametrize("ends", ["black", pytest.param("clear", marks=pytest.mark.slow)])
def test_rays_see_the_same(ends):
    """Snell's law from face to face, of the exported file in a posture; see `studies.oracles`."""
    made = finger((1.5, 1.0), ends=ends, camera=CameraSpec(fov_deg=128), range_deg=[90, 80])
    tables = json.loads(json.dumps(scene_tables(made.scene())))
    for pip, dip in ((62.0, 10.0), (5.0, 57.0)):
        exact = find_coverage(made.scene(), jnp.deg2rad(jnp.array([pip, dip]))).value
        plain = read(posed_tables(tables, {"pip": pip, "dip": dip}))
        rays = oracle.coverage(plain, oracle.runs(plain, 1500))
        np.testing.assert_allclose(exact, rays, atol=1e-9)
        assert np.min(rays) < 0.995


def test_slopes_are_central_differences():
    """Of coverage over layers, ends, body and camera; compiled and batched."""
    made = finger((1.5, 1.0), reach=0.6, range_deg=[88, 79], protrusion=0.1)
    sees = Finger.of(made.body, camera=made.camera, mirrors=made.mirrors, layers=made.layers)
    point, build = ravel_pytree(sees)
    pose = jnp.deg2rad(jnp.array([[61.3, 57.7], [20.1, 12.3]]))
    weights = jnp.array([[1.0, 0.3, 0.7], [0.6, 0.2, 1.1]])

    def value(flat):
        return jnp.sum(weights * find_coverage(build(flat).scene(), pose).value)

    point, steps = np.asarray(point), 1e-6 * np.eye(len(point))
    points = jnp.asarray(np.concatenate([point[None], point + steps, point - steps]))
    values = jax.jit(jax.vmap(value))(points)
    (slope,) = jax.jit(jax.vmap(jax.grad(value)))(points[:1])
    found = (values[1 : len(point) + 1] - values[len(point) + 1 :]) / 2e-6
    np.testing.assert_allclose(slope, found, rtol=1e-5, atol=1e-7)
    assert np.max(np.abs(ravel_pytree(build(slope).layers)[0])) > 0.01


def test_the_worst_is_found_between_the_degrees():
    """Every hundredth of a degree about where the finest rows are worst, by another program."""
    made = bare_finger()
    worst = find_worst_postures(made)
    assert worst.least_coverage == 1.0
    assert worst.transmission is None
    assert worst.largest_blur_px is None
    scene, least = made.scene(), worst.px_per_mm[PHALANGES.index("distal")]
    assert least.value == worst.least_px_per_mm
    dips = np.concatenate([np.arange(0, 90.01, 0.5), least.dip_deg + np.arange(-0.5, 0.5, 0.01)])
    poses = np.deg2rad(np.stack([np.full_like(dips, least.pip_deg), np.clip(dips, 0, 90)], axis=-1))
    views = find_views(scene, jnp.asarray(poses)).value
    sharp = find_sharpness(scene, poses, views, bounces=1).px_per_mm[..., 2, 0]
    assert least.value <= sharp.min() + 1e-9
    assert least.value == pytest.approx(sharp.min(), rel=2e-4)
    # On whole degrees, both joints alike, it is more.
    alike = np.deg2rad(np.repeat(np.arange(91.0)[:, None], 2, axis=1))
    views = find_views(scene, jnp.asarray(alike)).value
    row = find_sharpness(scene, alike, views, bounces=1).px_per_mm[..., 0].min()
    assert row > least.value + 0.02


def test_a_mirror_in_anothers_view_is_found():
    """At 128° the worst posture is none in which both joints are bent alike."""
    made = eqx.tree_at(lambda one: one.camera.field_of_view, bare_finger(), jnp.deg2rad(128.0))
    worst = find_worst_postures(made)
    for one in worst.coverage:
        pose = jnp.deg2rad(jnp.array([one.pip_deg, one.dip_deg]))
        own = find_coverage(made.scene(), pose).value[PHALANGES.index(one.pad)]
        assert one.value == pytest.approx(float(own), abs=1e-12)
        lost = lost_strips(made, one)
        assert bool(lost) == (one.value < 1)
    proximal = worst.coverage[0]
    (words,) = lost_strips(made, proximal)
    missing = (1 - proximal.value) * 29.5
    assert f": {missing:.2f} mm from" in words
    assert "the mirror:proximal view ends at limit of the field of view" in words


def test_layers_let_through_what_fresnel_says():
    """At the least transmission that counts nothing is lost, with a little more something is."""
    made = finger((2.0,), (1.49,), camera=CameraSpec(fov_deg=170))
    worst = find_worst_postures(made)
    assert worst.transmission is not None
    assert 0.3 <= worst.transmission < 0.9
    square = jnp.deg2rad(jnp.stack(jnp.meshgrid(*[jnp.arange(0.0, 91.0, 3.0)] * 2), axis=-1))

    def seen(least):
        scene = eqx.tree_at(lambda one: one.layers.transmission, made, jnp.asarray(least)).scene()
        return find_coverage(scene, square).value

    assert bool(jnp.all(seen(worst.transmission) >= seen(0.0) - 1e-6))
    assert bool(jnp.any(seen(worst.transmission + 0.02) < seen(0.0) - 1e-6))


@pytest.mark.parametrize(
    ("given", "lens"),
    [
        ([], ("imx219-200", None, None, 2.0)),
        (["fov_deg=120"], ("", 120.0, 1080, 0.0)),
        (["pixels=700"], ("", 160.0, 700, 0.0)),
        (["fov_deg=120", "pixels=700"], ("", 120.0, 700, 0.0)),
        (["model="], ("", 160.0, 1080, 0.0)),
        (["model=ov5647-160"], ("ov5647-160", None, None, 0.0)),
        (["model=ov5647-160", "f_number=2.35"], ("ov5647-160", None, None, 2.35)),
    ],
)
def test_a_lens_is_one_that_is_sold_or_one_of_a_field_of_view(given, lens):
    texts = [f"camera.{text}" for text in given]
    camera = cast(MirrorSpec, spec_with(MirrorSpec, texts, study="x")).camera
    assert (camera.model, camera.fov_deg, camera.pixels, camera.f_number) == lens
    assert CameraSpec.model_validate(camera.model_dump()) == camera
    assert CameraSpec.model_validate_json(camera.model_dump_json()) == camera
    assert float(camera.optics.pixels) == (
        lens[2] or camera_catalogue()[lens[0]]["format"]["pixels"][0]
    )


def test_two_lenses_are_refused():
    with pytest.raises(UserError, match="fov_deg and model 'ov6948' are two lenses; leave one of"):
        spec_with(MirrorSpec, ["camera.fov_deg=120", "camera.model=ov6948"], study="x")


def test_settings_lead_to_a_layered_finger():
    spec = MirrorSpec.model_validate(
        {"pads": {"thickness": [2.0, 1.0], "index": [1.49, 1.41], "ends": "clear"}}
    )
    layers = spec.pads.layers()
    assert layers is not None
    assert layers.ends == "clear"
    np.testing.assert_array_equal(layers.levels, [[1.0, 3.0], [0.0, 1.0]])
    assert MirrorSpec.model_validate(BARE).pads.layers() is None
    usual = MirrorSpec().pads.layers()
    assert usual is not None
    assert (usual.thickness.tolist(), usual.index.tolist()) == ([1.0, 1.0], [1.49, 1.41])
    assert math.degrees(float(SOLD.optics.field_of_view)) == pytest.approx(128.0)
    assert float(SOLD.optics.pixels) == 2592
