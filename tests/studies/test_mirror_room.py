"""Any number of mirrors, what they keep clear of, and the lines on the optics."""

from __future__ import annotations

import math
import tomllib
from contextlib import nullcontext
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from jax.flatten_util import ravel_pytree
from shapely.affinity import rotate, translate

from designopt.study.records import Records
from designopt.study.study import Context
from optics import find_coverage, find_views
from optics.scene.camera_module import CameraModule
from optics.scene.writer import scene_tables
from studies.models.checks import Check, requirement_rows
from studies.models.finger import Finger, camera_of
from studies.models.finger_file import bare_finger, format_finger, packaged_finger, parse_finger
from studies.models.finger_parts import Phalanx
from studies.models.mirror_design import design as designing
from studies.models.mirror_design import problem, requirements, yields
from studies.models.mirror_design.clearances import (
    clearance_checks,
    find_clearances,
    layer_outlines,
    mirror_outlines,
)
from studies.models.mirror_design.design import MirrorDesign, Trial, no_multipliers
from studies.models.mirror_design.errors import error_names, perturb, sample_errors
from studies.models.mirror_design.judging import Verdict, judged, seen_by_rays
from studies.models.mirror_design.placement import bounds, free_part, poor_layout, reference_layout
from studies.models.mirror_design.seeing import least_spare, pad_lengths
from studies.models.mirror_design.spec import CameraSpec, MirrorSpec
from studies.models.mirror_design.yields import groups, share_of
from studies.models.pad_layers import PadLayers
from studies.oracles.clearances import pad_pieces
from tests.studies.fingers import BARE as GIVEN
from tests.studies.fingers import LENS, bare_body

BARE = Finger.of(bare_body())
THREE: list[Phalanx] = ["distal", "proximal", "distal"]
CARRIERS = [[], ["distal"], ["proximal"], THREE]


@pytest.mark.parametrize("phalanges", CARRIERS)
def test_rays_see_the_same_by_any_number_of_mirrors(phalanges):
    scene = reference_layout(BARE, CameraSpec(fov_deg=128), phalanges).scene()
    degrees = np.array([[0.0, 21.0], [75.0, 80.0], [40.0, 10.0]])
    exact = np.asarray(find_coverage(scene, jnp.deg2rad(degrees)).value)
    np.testing.assert_allclose(seen_by_rays(scene, degrees, 20_000), exact, atol=1e-3)
    assert exact.min() < 0.95


def test_several_mirrors_of_a_phalanx_have_names_of_their_own():
    made = reference_layout(BARE, LENS, THREE)
    tables = scene_tables(made.scene())
    assert [one["name"] for one in tables["mirrors"]] == ["distal", "proximal", "distal 2"]
    # They share the one mirror's line, 2 mm apart.
    whole = reference_layout(BARE, LENS).mirrors[0].ends
    first, _, second = (mirror.ends for mirror in made.mirrors)
    np.testing.assert_allclose([first[0], second[1]], whole, atol=1e-12)
    assert float(jnp.linalg.norm(second[0] - first[1])) == pytest.approx(2.0)
    text = format_finger(made)
    assert text.count("mount = 1.0") == 3
    assert format_finger(parse_finger(tomllib.loads(text), "copy")) == text
    # A file without it has the default.
    bare = parse_finger(tomllib.loads(text.replace("mount = 1.0\n", "")), "copy")
    assert [float(mirror.mount) for mirror in bare.mirrors] == [1.0] * 3


@pytest.mark.parametrize("phalanges", CARRIERS)
def test_the_problem_is_as_large_as_its_mirrors(phalanges):
    small = {"phalanges": phalanges, "search": {"copies": 2, "poses": 2}}
    spec = MirrorSpec.model_validate(GIVEN | small)
    poor, count = poor_layout(BARE, spec.camera, spec.phalanges), len(phalanges)
    least, greatest = bounds(poor, spec)
    for low, value, high in zip(
        *map(jax.tree.leaves, (least, free_part(poor), greatest)), strict=True
    ):
        assert bool(jnp.all((low <= value) & (value <= high)))
    assert ravel_pytree(least)[0].size == 3 + 4 * count
    task = problem.Task.of(poor, spec, 0)
    assert task.errors.shape[1] == 3 + 2 * count == len(error_names(["m"] * count))
    parts = [range(3 + 2 * count)[part] for part in groups(count).values()]
    assert sum(map(len, parts)) == 3 + 2 * count
    assert len(no_multipliers(task)["clearance"]) == len(find_clearances(poor))
    moved = perturb(poor, jnp.full(3 + 2 * count, 0.1))
    assert float(camera_of(moved).along - camera_of(poor).along) == pytest.approx(0.1)


def layered(reach=1.0, **body: Any) -> Finger:
    """The reference layout with a second distal mirror; layers, and a camera with a module."""
    given = bare_body(**{"pad_clearance": 0.5, "range_deg": [90, 80]} | body)
    made = reference_layout(Finger.of(given), CameraSpec(fov_deg=150), THREE, 1.3)
    module = CameraModule(5.0, 3.0, 0.3, np.array([8.0, 8.0]), 1.0, 0.5)
    camera = replace(camera_of(made), module=module, depth=camera_of(made).depth + 2)
    made = replace(made, camera=camera)
    shares = np.full((2, 2), reach)
    layers = PadLayers(np.array([1.5, 1.0]), np.array([1.49, 1.41]), shares, shares)
    return replace(made, layers=layers)


def test_layers_are_where_the_file_has_them():
    """The outlines of `studies.oracles.clearances`, which reads the file alone."""
    made = layered(0.7)
    tables = tomllib.loads(format_finger(made))
    axes = {"proximal": 0.0, "intermediate": 0.0, "distal": tables["body"]["intermediate"]}
    pieces = pad_pieces(tables["body"], tables["pads"])
    for (phalanx, layers), found in zip(pieces.items(), layer_outlines(made), strict=True):
        for corners, outline in zip(layers[::-1], np.asarray(found), strict=True):
            wanted = shapely.MultiPoint([(z.real + axes[phalanx], z.imag) for z in corners])
            drawn = shapely.Polygon(outline)
            assert drawn.symmetric_difference(wanted.convex_hull).area < 1e-9
    assert layer_outlines(BARE).shape == (3, 0, 4, 2)


@pytest.mark.parametrize("degrees", [0.0, 35.0])
def test_mirrors_turn_with_their_phalanx(degrees):
    made = layered()
    tables = tomllib.loads(format_finger(made))
    for mirror, file in zip(made.mirrors, tables["mirrors"], strict=True):
        [found] = mirror_outlines(made, mirror, jnp.deg2rad(jnp.asarray([degrees])))
        distal = mirror.phalanx == "distal"
        axis = shapely.Point(0, 0)
        turned = rotate(
            quad(file | {"ends": (file["from"], file["to"])}),
            -degrees if distal else degrees,
            origin=axis,
        )
        moved = translate(turned, float(made.body.intermediate) if distal else 0.0)
        assert shapely.Polygon(np.asarray(found)).symmetric_difference(moved).area < 1e-9


def quad(mirror) -> shapely.Polygon:
    """Mirror and mount in the phalanx, by a flat buffer to the dorsal side."""
    (x1, d1), (x2, d2) = mirror["ends"]
    side = 1 if mirror["phalanx"] == "distal" else -1  # left of the distal mirror's direction
    line = shapely.LineString([(x1, 21 - d1), (x2, 21 - d2)])
    return line.buffer(side * mirror["mount"], single_sided=True)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (-6.0, 3.0), (4.0, 9.0), (0.0, -3.0)])
def test_clearances_are_those_of_polygons(shift):
    """Drawn anew with Shapely from the scene's tables, and turned by it, degree by degree."""
    made = layered()
    out = {"distal": np.array([shift]), "proximal": np.array([shift]) * [-1, 1]}
    moved = [replace(one, ends=one.ends + out[one.phalanx]) for one in made.mirrors]
    made = replace(made, mirrors=tuple(moved))
    found = {name: float(value) for name, value in find_clearances(made, (91, 91)).items()}
    tables = scene_tables(made.scene())
    sold = made.scene().camera
    assert sold.module is not None
    outline = np.asarray(sold.module.outline(sold.position, sold.direction)).tolist()
    module = [shapely.LineString(ends) for ends in outline]
    barrel, board = (shapely.MultiLineString(module[i:j]).convex_hull for i, j in ((0, 2), (2, 6)))
    pad = tables["pads"][1]
    (left, low), (right, _) = pad["from"], pad["to"]
    parts = []
    for layer in reversed(pad["layers"]):
        t, (o1, o2) = layer["thickness"], layer["overhang"]
        b1, b2 = (t * math.tan(math.radians(one)) for one in layer["bevel_deg"])
        corners = [(left - o1, low), (right + o2, low), (right + o2 - b2, low + t)]
        parts.append(shapely.Polygon([*corners, (left - o1 + b1, low + t)]))
        low += t
    layers = shapely.union_all(parts)
    names = ["distal", "proximal", "distal 2"]
    outlines = {}
    for name, mirror in zip(names, made.mirrors, strict=True):
        own = quad(
            {
                "ends": np.asarray(mirror.ends).tolist(),
                "phalanx": mirror.phalanx,
                "mount": float(mirror.mount),
            }
        )
        distal, what = mirror.phalanx == "distal", f"{name} mirror"
        length = 32.0 if distal else 35.0
        x, y = np.array(own.exterior.coords).T
        out = x if distal else -x
        height = np.where(out < 0, np.hypot(x, y), y)
        assert found[f"{what} inside the dorsal face"] == pytest.approx(21 - height.max())
        end = "tip" if distal else "rear end"
        assert found[f"{what} inside the {end}"] == pytest.approx(length - out.max())
        assert found[f"{what} above its pad"] == pytest.approx(y.min() - (-4.0 + 2.5))
        angles = np.linspace(0, 80 if distal else 90, 91)
        shifted = shapely.affinity.translate(own, 23.0 if distal else 0.0)
        axis, sign = ((23.0, 0.0), -1) if distal else ((0.0, 0.0), 1)
        turned = [rotate(shifted, sign * angle, origin=axis) for angle in angles]
        outlines[name] = turned
        for other, part in (("camera", (barrel, board)), ("intermediate pad", (layers,))):
            least = min(one.distance(each) for one in turned for each in part)
            value = found[f"{what} from the {other}"]
            assert max(value, 0.0) == pytest.approx(least, abs=1e-9)
            overlaps = any(one.intersects(each) for one in turned for each in part)
            assert (value <= 1e-9) == overlaps
    same = outlines["distal"][0].distance(outlines["distal 2"][0])
    assert found["distal mirror from the distal 2 mirror"] == pytest.approx(same)
    apart = min(a.distance(b) for a in outlines["distal"][::10] for b in outlines["proximal"][::10])
    value = found["distal mirror from the proximal mirror"]
    assert value <= apart + 1e-9
    assert value == pytest.approx(apart, abs=0.1)


def test_clearances_have_the_slopes_of_differences():
    made = layered()
    ends, build = ravel_pytree([mirror.ends for mirror in made.mirrors])

    @jax.jit
    def values(flat):
        changed = eqx.tree_at(lambda one: [m.ends for m in one.mirrors], made, build(flat))
        return jnp.stack([*find_clearances(changed).values()])

    # Off what is symmetric, where two corners are as near as each other.
    ends = ends + jnp.asarray(np.random.default_rng(0).uniform(0.1, 0.6, ends.shape))
    slopes = jax.jit(jax.jacrev(values))(ends)
    for number in range(ends.size):
        step = jnp.zeros_like(ends).at[number].set(1e-6)
        rise = (values(ends + step) - values(ends - step)) / 2e-6
        np.testing.assert_allclose(slopes[:, number], rise, atol=1e-6)


def test_the_bare_fingers_mounts_stand_too_near_to_the_back():
    """Its proximal mirror's end, 1.63 mm deep, leans back by 20.0°: its mount is 0.69 mm deep."""
    lines = {one.name: one for one in clearance_checks(bare_finger(), 1.0)}
    (x1, d1), (x2, d2) = bare_finger().mirrors[1].ends.tolist()
    lean = math.atan2(d2 - d1, x1 - x2)
    found = lines["proximal mirror inside the dorsal face"]
    assert found.achieved == pytest.approx(d1 - math.cos(lean), abs=1e-9)
    assert not found.met
    assert lines["distal mirror inside the dorsal face"].met
    assert all(one.met for one in clearance_checks(packaged_finger(), 1.0))


@pytest.mark.parametrize("fov", [140.0, 170.0])
def test_by_the_degrees_to_spare_the_field_may_shrink(fov):
    """Narrowed at both limits alike, by a little less and a little more than what is to spare."""
    made = reference_layout(BARE, CameraSpec(fov_deg=fov))
    poses = jnp.deg2rad(jnp.array([[10.0, 60.0], [50.0, 33.0], [85.0, 5.0]]))
    scene = made.scene()
    views = find_views(scene, poses).value
    spare = np.asarray(least_spare(views, scene.camera, pad_lengths(scene)))
    assert spare.min() >= -1e-12

    def coverage(by):
        narrow = jnp.asarray(math.radians(fov) - 2 * by)
        one = eqx.tree_at(lambda one: one.camera.field_of_view, made, narrow)
        return np.asarray(find_coverage(one.scene(), poses).value)

    for number, own in enumerate(spare.min(axis=(0, 2))):
        before = coverage(0.0)[number]
        np.testing.assert_allclose(coverage(own - 1e-4)[number], before, atol=1e-9)
        assert np.max(before - coverage(own + 2e-3)[number]) > 1e-5


def test_every_line_is_a_requirement():
    spec = MirrorSpec.model_validate(GIVEN | {"floor": 2.0, "least_yield": 0.9})
    made = reference_layout(BARE, spec.camera)
    verdict, whole = judged(made), np.ones((10, 4, 3))
    whole[0, 0, 0] = 0.5
    lines = requirements.optical_checks(made, verdict, share_of(whole), spec)
    found = {one.name: one for one in lines}
    assert found["yield"].achieved == 0.9
    assert found["yield"].met
    assert found["membrane"].slack == pytest.approx(71 - 67.45)
    assert found["px/mm"].achieved == verdict.worst_px_per_mm
    assert not {"blur", "transmission"} & set(found)
    assert {"degrees to spare towards the root", "distal mirror from the camera"} <= set(found)


def test_prices_are_slopes_of_the_objective():
    """A multiplier of a scaled inequality, per unit of what is asked."""
    spec = MirrorSpec.model_validate(GIVEN | {"search": {"copies": 2, "poses": 2}})
    poor = poor_layout(BARE, spec.camera)
    task = problem.Task.of(poor, spec, 0)
    held = no_multipliers(task)
    names = problem.clearance_names(poor)
    held["clearance"] = held["clearance"].at[names.index("distal mirror from the camera")].set(3.0)
    held["resolution"] = held["resolution"].at[1, 2].set(0.5)
    trial = Trial(free_part(poor), free_part(poor), 0.0, 0.0, 1, 0.0, held)
    design = MirrorDesign(poor, [trial], [], [task], 0)
    found = requirements.prices(design, spec)
    # One mm less asked raises the scaled level by 1/2 (2 mm count as 1): 3/2 % of a pad.
    assert found["distal mirror from the camera"] == (pytest.approx(1.5), "% of a pad per mm")
    assert found["px/mm"] == (pytest.approx(0.2), "% of a pad per px/mm")
    rows = requirement_rows([Check("px/mm", 2.5, 2.4, "px/mm"), Check("a", 1, 2)], found)
    assert isinstance(rows, Records)
    assert rows["met"].tolist() == ["no", "yes"]
    assert rows["price"].tolist() == [pytest.approx(0.2), 0.0]
    np.testing.assert_allclose(rows["margin"], [-0.1, 1.0])


@pytest.mark.parametrize("kept", [True, False])
def test_errors_that_hide_something_are_looked_at(monkeypatch, kept):
    """Two of the draws hide parts in known postures; what is found counts only if it is clear."""
    spec = MirrorSpec.model_validate({"least_yield": 1.0, "search": {"copies": 4, "poses": 2}})
    poor = poor_layout(BARE, spec.camera)
    task, angles = problem.Task.of(poor, spec, 0), yields.postures(poor)
    hidden = np.zeros((designing.FAILURE_DRAWS, len(angles), 3))
    hidden[3, [10, 20], 0], hidden[7, [40, 50], 2] = [0.1, 0.2], [0.5, 0.4]
    again = np.zeros_like(hidden)
    again[5, [60, 70], 1] = [0.3, 0.2]
    later = np.zeros_like(hidden)
    later[11, [80, 90], 0], later[13, [5, 15], 1] = [0.9, 0.8], [0.6, 0.5]
    answers, tasks = [1 - hidden, 1 - again, 1 - later, np.ones_like(hidden)], []
    first = Trial(free_part(poor), free_part(poor), 0.0, 0.0, 1, 0.0, no_multipliers(task))

    def search(start, limits, given, *_):
        tasks.extend(given)
        return first._replace(start=start, objective=1.0)

    verdict = Mock(spec=Verdict)
    verdict.meets.return_value = True
    monkeypatch.setattr(designing, "search", search)
    monkeypatch.setattr(designing, "coverages", lambda *_: answers.pop(0))
    monkeypatch.setattr(designing, "judged", lambda _: verdict)
    lines = (Check("clearance", 1.0, 1.0 if kept else 0.9),)
    monkeypatch.setattr(designing, "clearance_checks", lambda *_: lines)
    found, _ = designing._with_failures((first, verdict), poor, task, (poor, poor), spec, 5)
    assert found.objective == (1.0 if kept else 0.0)
    first_round, looked, last = tasks
    assert_looks_alike(first_round, task, slice(task.plain + 2, None))
    # What failed in the first round is looked at in the second, too.
    errors = 1.2 * sample_errors(spec.tolerances, 2, designing.FAILURE_DRAWS, 5)[[7, 3, 5]]
    own = slice(task.plain, task.plain + 3)
    np.testing.assert_allclose(looked.errors[own], errors)
    postures = angles[[[40, 50], [20, 10], [60, 70]]]
    np.testing.assert_allclose(np.rad2deg(looked.angles[own]), postures)
    assert_looks_alike(looked, task, slice(task.plain + 3, None))
    # With all places taken, the first ones are taken anew.
    errors = 1.2 * sample_errors(spec.tolerances, 2, designing.FAILURE_DRAWS, 5)[[13, 3, 5, 11]]
    np.testing.assert_allclose(last.errors[task.plain :], errors)
    postures = angles[[[5, 15], [20, 10], [60, 70], [80, 90]]]
    np.testing.assert_allclose(np.rad2deg(last.angles[task.plain :]), postures)


def assert_looks_alike(task, other, looks):
    np.testing.assert_array_equal(task.errors[looks], other.errors[looks])
    np.testing.assert_array_equal(task.angles[looks], other.angles[looks])


@pytest.mark.parametrize(("rounds", "searched"), [(5, 3), (2, 2)])
def test_what_gives_way_is_what_is_seen_not_the_room(monkeypatch, rounds, searched):
    """Only the clearances' multipliers are kept from round to round; without room all is as was."""
    spec = MirrorSpec.model_validate({"search": {"copies": 2, "poses": 2}})
    poor = poor_layout(BARE, spec.camera)
    task = problem.Task.of(poor, spec, 0)
    held = jax.tree.map(jnp.ones_like, no_multipliers(task))
    first = Trial(free_part(poor), free_part(poor), 0.0, 0.0, 1, 1.0, held)
    given = []

    def search(start, *others):
        *_, stages, multipliers = others
        assert stages == [designing.ROOM]
        given.append(multipliers)
        return first._replace(start=start)

    rooms = [0.8, 0.9, 1.0]
    monkeypatch.setattr(designing, "ROOM_ROUNDS", rounds)
    monkeypatch.setattr(designing, "search", search)
    monkeypatch.setattr(
        designing, "clearance_checks", lambda *_: (Check("clearance", 1.0, rooms[len(given) - 1]),)
    )
    found = designing._with_room(first, poor, task, (poor, poor), spec)
    assert len(given) == searched
    more = searched if rooms[searched - 1] == 1.0 else 0
    assert (found.steps, found.seconds) == (1 + more, 1.0 + more)
    assert not any(np.any(one["coverage"]) or np.any(one["resolution"]) for one in given)
    assert [float(np.max(one["clearance"])) for one in given] == [0.0, *[1.0] * (len(given) - 1)]


def test_the_room_counts_a_hundredfold():
    usual, room = designing.STAGES[-1].penalties, designing.ROOM.penalties
    assert float(room["clearance"]) == 100 * float(usual["clearance"])
    assert float(room["coverage"]) == float(usual["coverage"])
    assert float(room["resolution"]) == float(usual["resolution"])


@pytest.mark.parametrize(("room", "moved"), [(0.9, True), (1.0, False)])
def test_a_design_without_room_is_moved_and_judged_anew(monkeypatch, room, moved):
    spec = MirrorSpec.model_validate({"search": {"copies": 2, "poses": 2}})
    place = free_part(poor_layout(BARE, spec.camera))
    zero = no_multipliers(problem.Task.of(poor_layout(BARE, spec.camera), spec, 0))
    trial = Trial(place, place, 0.0, 0.0, 1, 0.0, zero)
    before, after = Mock(spec=Verdict), Mock(spec=Verdict)
    before.meets.return_value = after.meets.return_value = False
    monkeypatch.setattr(designing, "search", lambda *_: trial)
    monkeypatch.setattr(designing, "judged", lambda *_, everywhere=True: after)
    monkeypatch.setattr(designing, "_with_worst", lambda *_: (trial, before))
    monkeypatch.setattr(designing, "_with_room", lambda *_: trial._replace(objective=7.0))
    monkeypatch.setattr(designing, "clearance_checks", lambda *_: (Check("clearance", 1.0, room),))
    after.worst = None
    context = Context(0, "float64", lambda _: nullcontext())
    found = designing.design_mirrors(BARE, spec, context, [place])
    assert found.trials[found.chosen].objective == (7.0 if moved else 0.0)
    assert found.verdict is (after if moved else before)
