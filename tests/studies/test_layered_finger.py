"""The study ``layered-finger``: its closed forms, its scenes, and the study itself."""

import dataclasses
import math
from contextlib import nullcontext

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from designopt import UserError
from designopt.study.study import Context
from optics import Fabrication, Imaging, find_coverage, find_views, parse_scene
from studies.layered_finger import LayeredFingerSpec
from studies.layered_finger import run as study
from studies.layered_finger.cases import (
    CASES,
    PROJECTIONS,
    SENSOR,
    Case,
    plain_tables,
    sold_camera,
)
from studies.layered_finger.mirrors import Redesigner, Task, placed, terms
from studies.layered_finger.strips import layers_of, lost_strips, upper_edge
from studies.models.finger_file import bare_finger
from studies.models.mirror_design.placement import free_part
from studies.models.mirror_design.seeing import together
from studies.models.sensor.spec import WIDTH
from studies.oracles import layers as oracle
from studies.oracles.layered_scenes import posed_tables, read
from studies.oracles.scenes import rounded
from studies.oracles.shadows import image, shadow, shadow_width
from tests.studies.quick import quick_run

FINGER = bare_finger()
ROUNDING = 1e-9
"""A few hundred roundings of what the oracle divides angles into, in parts of a pad or mm."""

POSES_DEG = [(0.0, 0.0), (37.0, 61.0), (90.0, 90.0)]

FIELDS = {
    "equidistant": lambda part: 160 * part,
    "equisolid": lambda part: 4 * math.degrees(math.asin(part * math.sin(math.radians(40)))),
    "stereographic": lambda part: 4 * math.degrees(math.atan(part * math.tan(math.radians(40)))),
    "orthographic": lambda part: 2 * math.degrees(math.asin(part * math.sin(math.radians(80)))),
}
"""Fields of view on a part of the diagonal of which the field is 160°."""

PUBLISHED = {"equidistant": 128.0, "equisolid": 124.0, "stereographic": 135.5}
"""Along the long side."""


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_lens_as_sold_has_on_each_side_the_field_of_its_projection(projection):
    for axis, part in (("long", 0.8), ("short", 0.6)):
        camera = sold_camera(projection, axis).camera
        field = math.degrees(float(camera.field_of_view))
        assert field == pytest.approx(FIELDS[projection](part), abs=1e-9)
        if axis == "long" and projection in PUBLISHED:
            assert field == pytest.approx(PUBLISHED[projection], abs=0.5)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_what_a_lens_as_sold_shows_of_bare_and_layered_pads_is_what_rays_show(projection):
    """Of the whole camera, not only of its field in today's scene."""
    for name in ("none", "3 mm"):
        scene = CASES[name].scene(FINGER)
        tables = plain_tables(scene)
        sold = {"format": SENSOR | {"section_axis": "long"}, "fov_axis": "diagonal"}
        sold |= {"fov_deg": 160.0, "projection": projection}
        kept = {key: tables["camera"][key] for key in ("position", "direction_deg")}
        whole = parse_scene(tables | {"camera": kept | sold})
        field = sold_camera(projection, "long").camera.field_of_view
        assert float(whole.camera.field_of_view) == float(field)
        narrowed = eqx.tree_at(lambda one: one.camera.field_of_view, scene, field)
        poses = jnp.deg2rad(jnp.asarray(POSES_DEG))
        seen = np.asarray(find_coverage(narrowed, poses).value)
        for (pip, dip), exact in zip(POSES_DEG, seen, strict=True):
            narrow = tables | {"camera": tables["camera"] | {"fov_deg": FIELDS[projection](0.8)}}
            plain = read(posed_tables(narrow, {"pip": pip, "dip": dip}))
            by_rays = oracle.coverage(plain, oracle.runs(plain, 1000))
            np.testing.assert_allclose(exact, by_rays, atol=ROUNDING)


def test_a_pose_puts_everything_where_the_other_oracle_has_it():
    tables = plain_tables(FINGER.scene())
    for pip, dip in POSES_DEG:
        posed = posed_tables(tables, {"pip": pip, "dip": dip})
        plain = rounded(FINGER.scene(), np.deg2rad([pip, dip]))
        parts = [*posed["mirrors"], *posed["pads"], *posed["blockers"]]
        ends = [[complex(*part[key]) for key in ("from", "to")] for part in parts]
        np.testing.assert_allclose(ends, plain.surfaces.ends, atol=1e-12)
    assert "frames" in tables


def test_layers_lie_inside_outside_and_beyond_the_membrane_as_they_are_named():
    inside, outside = (CASES[f"3 mm {place}"].scene(FINGER).pads for place in ("inside", "outside"))
    np.testing.assert_allclose(inside, FINGER.pads())
    np.testing.assert_allclose(outside - inside, np.broadcast_to([0, -3], (3, 2, 2)))
    over = plain_tables(CASES["2 mm, overhang"].scene(FINGER))["pads"]
    for pad, today in zip(over, np.asarray(FINGER.pads()) @ [1, 1j], strict=True):
        edges = [upper_edge(pad, end) for end in (0, 1)]
        # The layer is as long as today's pad; the outer pads' far ends stay.
        np.testing.assert_allclose(edges, today + 2j)
    assert over[0]["from"][0] == -33.5
    assert over[0]["to"][0] == -6.0


@pytest.mark.parametrize("name", ["5 mm outside", "2 mm, overhang beyond today's end"])
def test_neighbours_layers_meet_at_the_flexion_that_is_told(name):
    case = CASES[name]
    tables = plain_tables(case.scene(FINGER))

    def gap(pip):
        """From the lower edge of the proximal pad's layer to that of the intermediate one."""
        lower = []
        for pad, end in (("proximal", 1), ("intermediate", 0)):
            posed = posed_tables(tables, {"pip": pip, "dip": 0.0})["pads"]
            [own] = [one for one in posed if one["name"] == pad]
            thickness = sum(layer["thickness"] for layer in own["layers"])
            start, stop = complex(*own["from"]), complex(*own["to"])
            along = (stop - start) / abs(stop - start)
            lower.append(upper_edge(own, end) - 1j * along * thickness)
        return abs(lower[1] - lower[0])

    assert gap(case.meeting_deg(FINGER)) == pytest.approx(0, abs=1e-12)
    assert Case().meeting_deg(FINGER) == pytest.approx(90)


def test_a_shadow_is_where_snells_law_takes_the_ray_in_many_digits():
    layers, source, edge = [(3.0, 1.49), (2.0, 1.41)], -30 + 14j, 0 + 5j
    found = shadow(source, edge, (0j, 40 + 0j), layers)
    with mpmath.workdps(30):
        sine, place = mpmath.sin(mpmath.atan(mpmath.mpf(30) / 9)), mpmath.mpf(0)
        for thickness, index in layers:
            place += thickness * mpmath.tan(mpmath.asin(sine / index))
    assert found.along == pytest.approx(float(place), abs=1e-12)
    assert found.width == pytest.approx(float(place), abs=1e-12)
    assert shadow_width(layers, found.air) == pytest.approx(float(place), abs=1e-12)
    assert math.sin(found.inside) * 1.41 == pytest.approx(math.sin(found.air))
    # Turned about, moved and mirrored it is the same.
    turn, shift = np.exp(0.7j), 3 - 8j
    eye, top, *ends = (complex(shift + turn * place) for place in (source, edge, 0, 40))
    assert shadow(eye, top, ends, layers).along == pytest.approx(found.along)
    eye, top, *ends = (-place.conjugate() for place in (source, edge, 40 + 0j, 0j))
    assert shadow(eye, top, ends, layers).along == pytest.approx(40 - found.along)


def test_an_image_is_as_far_behind_the_mirror():
    place, ends = 2 + 7j, (1 - 1j, 4 + 3j)
    other = image(place, ends)
    for end in ends:
        assert abs(other - end) == pytest.approx(abs(place - end))
    assert image(other, ends) == pytest.approx(place)
    assert abs(other - place) > 1


@pytest.mark.parametrize(
    ("name", "pad", "degrees", "view", "bound"),
    [
        ("3 mm", 2, (0.0, 30.0), "direct", "upper edge of layer 1 at 'from'"),
        ("3 mm", 0, (90.0, 0.0), "mirror:proximal", "pad 'proximal', layer 1 at 'to': its upper"),
        ("none, 128°", 2, (0.0, 0.0), "direct", "limit of the field of view"),
        ("none, 128°", 0, (60.0, 0.0), "direct", "least grazing angle"),
    ],
)
def test_a_lost_strip_ends_where_a_ray_of_the_oracle_ends(name, pad, degrees, view, bound):
    scene = CASES[name].scene(FINGER)
    pieces = find_views(scene, jnp.deg2rad(jnp.asarray(degrees))).value
    posed = posed_tables(plain_tables(scene), dict(zip(("pip", "dip"), degrees, strict=True)))
    strips = list(lost_strips(scene, posed, pieces, pad))
    [strip] = [one for one in strips if one.view == view and one.bound.startswith(bound)]
    start, end = (complex(*posed["pads"][pad][key]) for key in ("from", "to"))
    length = abs(end - start)
    assert strip.shadow is not None
    assert strip.shadow.along == pytest.approx(length * strip.at, abs=ROUNDING)
    plain = read(posed)
    spans = np.sort([run.at for run in oracle.runs(plain, 1000) if run.pad == pad], axis=1)
    assert np.abs(spans - strip.at).min() < ROUNDING
    lost = 1 - oracle.coverage(plain, oracle.runs(plain, 1000))[pad]
    every = {(one.start, one.end) for one in strips}
    assert sum(b - a for a, b in every) == pytest.approx(lost, abs=ROUNDING)
    if view == "direct" and "layer" in bound:
        assert strip.shadow.width == pytest.approx(length * (strip.end - strip.start))
        layers = layers_of(posed["pads"][pad])
        assert shadow_width(layers, strip.shadow.air) == pytest.approx(strip.shadow.width)


def test_the_search_for_mirrors_follows_true_slopes():
    scene, free = CASES["3 mm"].scene(FINGER), free_part(FINGER)
    poses = together(jnp.deg2rad(jnp.array([10.0, 85.0])))
    task = Task(FINGER, scene, poses, jnp.asarray(0.05))
    value = jax.jit(lambda free: terms(free, task).value)
    slope = jax.grad(lambda free: terms(free, task).value)(free)
    for part in (lambda one: one.camera.along, lambda one: one.mirrors[1].ends):
        number, step = part(free), 1e-6
        way = jnp.ones_like(number)
        ahead, back = (
            value(eqx.tree_at(part, free, number + sign * step * way)) for sign in (1, -1)
        )
        assert float(jnp.sum(part(slope))) == pytest.approx(
            float(ahead - back) / (2 * step), rel=1e-6, abs=1e-8
        )


def test_a_finger_s_own_places_give_its_own_scene():
    for name in ("none", "3 mm, clear ends"):
        scene = CASES[name].scene(FINGER)
        both = jax.tree.leaves(placed(FINGER, scene)), jax.tree.leaves(scene)
        for one, other in zip(*both, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.slow
def test_other_mirrors_show_more_at_worst():
    scene = CASES["none, 128°"].scene(FINGER)
    found = Redesigner(FINGER).redesigned(scene)
    poses = together(jnp.deg2rad(jnp.linspace(0.0, 90.0, 46)))
    before, after = (np.min(find_coverage(one, poses).value, axis=0) for one in (scene, found))
    assert after.sum() > before.sum() + 0.1
    tables = posed_tables(plain_tables(found), {"pip": 40.0, "dip": 40.0})
    by_rays = oracle.coverage(read(tables), oracle.runs(read(tables), 1000))
    np.testing.assert_allclose(find_coverage(found, poses).value[20], by_rays, atol=ROUNDING)


def test_the_worst_of_a_finger_with_thicker_layers_is_what_rays_show():
    scene = CASES["3+2 mm"].scene(FINGER)
    errors = dataclasses.replace(
        Fabrication.none(scene.layout),
        thickness=jnp.full((3, 2), 0.1),
        index=jnp.full((3, 2), 0.02),
    )
    count = sum(leaf.size for leaf in jax.tree.leaves(errors))
    poses = jnp.deg2rad(jnp.array(POSES_DEG[:2]))
    draws = jnp.stack([jnp.zeros(count), jnp.ones(count)])
    (nominal, found), _ = study.find_worst(scene, errors, draws, poses, Imaging.of(scene.camera))
    tables = plain_tables(scene)
    for pad in tables["pads"]:
        for layer in pad["layers"]:
            layer["thickness"] += 0.1
            layer["index"] = {color: index + 0.02 for color, index in layer["index"].items()}
    seen = []
    for pip, dip in POSES_DEG[:2]:
        plain = read(posed_tables(tables, {"pip": pip, "dip": dip}))
        seen.append(oracle.coverage(plain, oracle.runs(plain, 1000)))
    np.testing.assert_allclose(found, np.min(seen, axis=0), atol=ROUNDING)
    assert float(nominal[0]) > float(found[0])


def test_a_roll_of_the_camera_turns_pads_towards_the_sides_of_the_image():
    scene, roll = CASES["none"].scene(FINGER), 0.3
    errors = dataclasses.replace(Fabrication.none(scene.layout), roll=roll)
    poses, imaging = jnp.deg2rad(jnp.array(POSES_DEG[:2])), Imaging.of(scene.camera)
    count = sum(leaf.size for leaf in jax.tree.leaves(errors))
    draws = jnp.stack([jnp.zeros(count), jnp.ones(count)])
    _, found = study.find_worst(scene, errors, draws, poses, imaging)
    tables = plain_tables(scene)
    eye = complex(*tables["camera"]["position"])
    axis = np.exp(1j * np.radians(tables["camera"]["direction_deg"]))
    half = np.radians(tables["camera"]["fov_deg"] / 2)
    rows, columns = imaging.shape
    room = np.full((2, 3), np.inf)
    for pip, dip in POSES_DEG[:2]:
        posed = posed_tables(tables, {"pip": pip, "dip": dip})
        plain = read(posed)
        for word, pad in {(run.word, run.pad) for run in oracle.runs(plain, 1000)}:
            for end in ("from", "to"):
                place = complex(*posed["pads"][pad][end])
                for mirror in reversed(word):
                    own = posed["mirrors"][mirror]
                    place = image(place, (complex(*own["from"]), complex(*own["to"])))
                ahead, aside = (place - eye) / axis, WIDTH / 2
                angle = math.atan2(math.hypot(ahead.imag, aside), ahead.real)
                corner = rows / 2 * angle / half * np.exp(1j * math.atan2(ahead.imag, aside))
                # The corner at the other side is its mirror image, a roll of it that of a roll.
                for row, turns in enumerate(([0.0], [roll, -roll])):
                    for turned in corner * np.exp(1j * np.array(turns)):
                        if abs(turned.imag) <= (rows - 1) / 2:
                            least = (columns - 1) / 2 - abs(turned.real)
                            room[row, pad] = min(room[row, pad], least)
    np.testing.assert_allclose(found, room[:, [0, 2]], atol=1e-6)
    assert np.all(found[1] < found[0] - 20)


def test_it_needs_float64():
    with pytest.raises(UserError, match="leave --dtype out"):
        study.run(LayeredFingerSpec(), Context(0, "float32", lambda _: nullcontext()))


@pytest.mark.slow
def test_a_quick_run_explains_and_checks_all_that_is_lost(tmp_path):
    always = {"intermediate_worst", "strips_unexplained", "formula_worst_mm", "oracle_worst"}
    done = quick_run("layered-finger", tmp_path, judged=always)
    measured = done.measured
    assert measured["bare_worst"] == pytest.approx(1)
    assert measured["plate_proximal"] == pytest.approx(0.8341, abs=1e-4)
    assert measured["strips"] > 10
    # From the camera 20.97 mm above the pads: to their far ends on either side.
    root, tip = math.atan2(46.87, 20.97), math.atan2(40.13, 20.97)
    assert measured["straight_deg"] == pytest.approx(math.degrees(root + tip), abs=0.02)
    sheet = done.table("shadows")
    assert [round(value, 1) for value in sheet["shadow_mm"][::3]] == [2.4, 2.6, 2.7, 4.2]
