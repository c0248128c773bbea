"""The camera in any phalanx, and mirrors in any: against oracles that read the finger's file."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from jax.flatten_util import ravel_pytree
from pydantic import ValidationError

from optics import find_coverage, find_views, parse_scene
from optics.scene.camera_module import CameraModule
from optics.scene.writer import scene_tables
from studies.finger.drawing import make_finger_drawing
from studies.finger.explorer import SEEN, FingerExplorer
from studies.finger.run import dimensions
from studies.models.finger import Finger, camera_of
from studies.models.finger_file import (
    finger_tables,
    format_finger,
    packaged_finger,
    parse_finger,
    write_finger,
)
from studies.models.finger_parametric.design import FingerParametric
from studies.models.finger_parts import PHALANGES, Phalanx, joints_between
from studies.models.mirror_design.clearances import clearance_checks, find_clearances
from studies.models.mirror_design.design import first_placements
from studies.models.mirror_design.errors import perturb
from studies.models.mirror_design.figures import moving_pads
from studies.models.mirror_design.judging import coverage_grid, seen_by_rays
from studies.models.mirror_design.placement import bounds, free_part, poor_layout
from studies.models.mirror_design.problem import put_in
from studies.models.mirror_design.spec import FingerMirrorsSpec, MirrorSpec
from studies.oracles import layers as oracle
from studies.oracles.clearances import polygon_clearances
from studies.oracles.finger_tables import scene_of_finger
from studies.oracles.layered_scenes import posed_tables, read
from studies.oracles.traced_coverage import traced_coverage
from tests.helpers import assert_same
from tests.studies.fingers import bare_body
from tests.studies.test_traced_coverage import ROUGH, needs_mitsuba

RANGES = 90.0, 80.0

CASES: list[tuple[Phalanx, list[Phalanx], bool]] = [
    ("proximal", [], True),
    ("proximal", ["intermediate", "distal"], False),
    ("proximal", ["proximal", "intermediate", "distal"], True),
    ("distal", [], False),
    ("distal", ["proximal"], True),
    ("distal", ["intermediate", "distal", "intermediate"], False),
    ("intermediate", ["intermediate", "distal"], True),
]
"""What carries the camera, what carries each mirror, and whether the pads have layers."""


def settings(host: Phalanx, phalanges: Sequence[Phalanx], layered: bool = False) -> MirrorSpec:
    pads = {"thickness": [1.5, 1.0], "index": [1.49, 1.41]} if layered else {}
    given = {
        "camera": {"fov_deg": 150, "phalanx": host},
        "phalanges": phalanges,
        "pads": pads or {"thickness": [], "index": []},
    }
    return MirrorSpec.model_validate(given)


def poor(spec: MirrorSpec) -> Finger:
    """The poor layout in a body without pins."""
    given = Finger.of(bare_body(pad_clearance=0.5, range_deg=[*RANGES]))
    made = poor_layout(given, spec.camera, spec.phalanges, spec.room.mount)
    return replace(made, layers=spec.pads.layers())


def random_finger(spec: MirrorSpec, seed: int) -> Finger:
    """Camera, mirrors and ends of layers anywhere within their bounds."""
    made, rng = poor(spec), np.random.default_rng(seed)
    limits = bounds(made, spec)
    drawn = jax.tree.map(
        lambda low, high: low + (high - low) * rng.uniform(size=low.shape), *limits
    )
    return put_in(drawn, made)


@pytest.mark.parametrize(("host", "phalanges", "layered"), CASES)
def test_coverage_is_that_of_rays(tmp_path, host, phalanges, layered):
    """By Snell's law from face to face; places and turns are those of `scene_of_finger`.

    The camera's body is so wide that it hides something from the camera in the proximal phalanx.
    """
    spec, shown = settings(host, phalanges, layered), []
    by_library = jax.jit(find_coverage)
    for seed in (0, 1, 5):
        made, rng = random_finger(spec, seed), np.random.default_rng(seed)
        made = replace(made, camera=replace(camera_of(made), width=jnp.asarray(24.0)))
        write_finger(made, tmp_path / "finger.toml")
        tables = scene_of_finger(tmp_path / "finger.toml")
        degrees = rng.uniform(0, 1, (2, 2)) * RANGES
        found = np.asarray(by_library(made.scene(), jnp.deg2rad(degrees)).value)
        for (pip, dip), exact in zip(degrees.tolist(), found, strict=True):
            plain = read(posed_tables(tables, {"pip": pip, "dip": dip}))
            rays = oracle.coverage(plain, oracle.runs(plain, 1500))
            np.testing.assert_allclose(exact, rays, atol=1e-9)
        shown.append(found)
    parts = np.array(shown)
    assert np.any((parts > 0.01) & (parts < 0.99))


@needs_mitsuba
@pytest.mark.parametrize(
    ("host", "phalanges"),
    [("proximal", ["distal", "intermediate"]), ("distal", ["distal", "proximal"])],
)
def test_coverage_is_that_of_a_path_tracer(tmp_path, host, phalanges):
    made = random_finger(settings(host, phalanges, layered=True), 4)
    write_finger(made, tmp_path / "finger.toml")
    degrees = np.array([[0.0, 0.0], [34.0, 21.0], [71.0, 66.0], [15.0, 78.0]])
    found = find_coverage(made.scene(), jnp.deg2rad(degrees)).value
    np.testing.assert_allclose(
        found, traced_coverage(tmp_path / "finger.toml", degrees), atol=ROUGH
    )
    assert np.sum(np.asarray(found) < 0.99) >= 3


@pytest.mark.parametrize("layered", [False, True])
def test_the_studys_own_rays_follow_the_camera(layered):
    """A module is a part of the layered scene; a fan of rays is that of `studies.oracles.rays`."""
    made = random_finger(settings("distal", [] if layered else ["intermediate"], layered), 1)
    if layered:
        module = CameraModule(1.0, 2.5, 0.3, np.array([6.0, 6.0]), 1.0, 0.0)
        made = replace(made, camera=replace(camera_of(made), module=module))
        assert {part.frame for part in made.scene().layout.module} == {1}
    degrees = np.array([[60.0, 20.0], [10.0, 70.0]])
    exact = find_coverage(made.scene(), jnp.deg2rad(degrees)).value
    np.testing.assert_allclose(seen_by_rays(made.scene(), degrees, 150_000), exact, atol=1e-3)


def rooted_in(tables: dict[str, Any], host: str) -> dict[str, Any]:
    """The same parts, with what was the world hinged in an outer phalanx that stands still."""
    names = {host: "world", "world": "middle"}
    other = "distal" if host == "proximal" else "proximal"
    turned = {"clockwise": "counterclockwise", "counterclockwise": "clockwise"}
    own, outer = tables["frames"][host], tables["frames"][other]
    frames = {
        "middle": {**own, "parent": "world", "positive": turned[own["positive"]]},
        other: {**outer, "parent": "middle"},
    }

    def moved(part: dict[str, Any]) -> dict[str, Any]:
        body = part.get("body", "world")
        return part | {"body": names.get(body, body)}

    lists = {kind: list(map(moved, tables.get(kind, []))) for kind in ("mirrors", "blockers")}
    pads = list(map(moved, tables["pads"]))
    return tables | lists | {"camera": moved(tables["camera"]), "pads": pads, "frames": frames}


@pytest.mark.parametrize(("host", "phalanges", "layered"), [CASES[2], CASES[4], CASES[5]])
def test_it_does_not_matter_what_stands_still(host, phalanges, layered):
    """Views from a camera that moves are those from the same camera fixed, all else moving."""
    scene = random_finger(settings(host, phalanges, layered), 5).scene()
    tables = json.loads(json.dumps(scene_tables(scene)))
    assert tables["camera"]["body"] == host
    fixed = parse_scene(rooted_in(tables, host), "fixed")
    assert fixed.layout.camera_frame == -1
    poses = np.random.default_rng(6).uniform(0, 1.4, (12, len(scene.angle_names)))
    order = [scene.angle_names.index(name) for name in fixed.angle_names]
    found = find_views(scene, jnp.asarray(poses)).value
    wanted = find_views(fixed, jnp.asarray(poses[:, order])).value
    np.testing.assert_array_equal(found.present, wanted.present)
    assert_same(found, wanted, rtol=0, atol=1e-9)
    assert np.asarray(found.present).any()


@pytest.mark.parametrize(("host", "phalanges", "layered"), CASES)
def test_clearances_are_those_of_polygons(tmp_path, host, phalanges, layered):
    """Every line at the same angles; what has none is never as near as what has one may be."""
    spec, counts = settings(host, phalanges, layered), (13, 11)
    pip, dip = (np.linspace(0, end, count) for end, count in zip(RANGES, counts, strict=True))
    for seed in range(4):
        made = random_finger(spec, seed)
        write_finger(made, tmp_path / "finger.toml")
        polygons = polygon_clearances(tmp_path / "finger.toml", degrees=(pip, dip))
        apart = {frozenset(pair): float(np.min(each)) for pair, each in polygons.apart.items()}
        found = {name: float(each) for name, each in find_clearances(made, counts).items()}
        for name, value in found.items():
            pair = frozenset(name.split(" from the "))
            if len(pair) == 2:
                least = apart.pop(pair)
                # Shapely has no way out of what overlaps.
                assert max(value, 0.0) == pytest.approx(max(least, 0.0), abs=1e-9)
                assert (value < 1e-9) == (least < 1e-9)
        sunk = {name[: -len(" above its pad")] for name in found if "above" in name}
        sunk = {name for name in sunk if found[f"{name} above its pad"] < 0}
        for (one, other), least in apart.items():
            if not {one, other} & sunk and {one, other} - {f"{name} pad" for name in PHALANGES}:
                assert "palmar" in one + other or least > spec.room.clearance
        check_section(made, found)
        camera = clearance_checks(made, 1.0)[-1]
        assert camera.name == "camera inside the wall of the back"
        below = np.min(np.asarray(made.camera_corners())[:, 1]) - float(made.body.palmar)
        rooms = [camera.achieved, below, *(found[one] for one in found if "camera inside" in one)]
        assert float(np.min(polygons.inside["camera"])) == pytest.approx(min(rooms), abs=1e-6)


def check_section(made: Finger, found: dict[str, float]) -> None:
    """Mirrors inside their phalanx, by Shapely's distances from the line between its axes."""
    body, free = made.body, 1e3
    spans = {
        "proximal": (-free, 0.0),
        "intermediate": (0.0, float(body.intermediate)),
        "distal": (0.0, free),
    }
    tables = finger_tables(made)
    top = float(body.palmar) + sum(
        one["thickness"] for one in tables.get("pads", {}).get("layers", [])
    )
    for name, mirror in zip(made.mirror_names, tables.get("mirrors", []), strict=True):
        (x1, d1), (x2, d2) = mirror["from"], mirror["to"]
        line = shapely.LineString([(x1, 21 - d1), (x2, 21 - d2)])
        side = -1 if mirror["phalanx"] == "proximal" else 1  # the mount's, from the first end
        corners = shapely.get_coordinates(line.buffer(side * mirror["mount"], single_sided=True))
        start, end = spans[mirror["phalanx"]]
        axes = shapely.LineString([(start, 0), (end, 0)])
        heights = [axes.distance(shapely.Point(x, y)) if y > 0 or not start <= x <= end else y
                   for x, y in corners.tolist()]  # fmt: skip
        what = f"{name} mirror"
        assert found[f"{what} inside the dorsal face"] == pytest.approx(21 - max(heights))
        assert found[f"{what} above its pad"] == pytest.approx(np.min(corners[:, 1]) - top)
        ends = {"proximal": ("rear end", 35 + corners[:, 0]), "distal": ("tip", 32 - corners[:, 0])}
        lines = [one for one in found if one.startswith(f"{what} inside the ")]
        assert len(lines) == 1 + (mirror["phalanx"] in ends)
        if mirror["phalanx"] in ends:
            end_name, rooms = ends[mirror["phalanx"]]
            assert found[f"{what} inside the {end_name}"] == pytest.approx(np.min(rooms))


@pytest.mark.parametrize(("host", "phalanges"), [("proximal", ["distal"]), ("distal", ["distal"])])
def test_slopes_are_central_differences(host, phalanges):
    """Of coverage and clearances over body, layers, camera and mirrors; compiled."""
    made = random_finger(settings(host, phalanges, layered=True), 8)
    flat, build = ravel_pytree(made)
    poses = jnp.deg2rad(jnp.array([[61.3, 57.7], [20.1, 12.3]]))
    weights = jnp.array([[1.0, 0.3, 0.7], [0.6, 0.2, 1.1]])

    def value(flat):
        finger = build(flat)
        seen = jnp.sum(weights * find_coverage(finger.scene(), poses).value)
        return seen + sum(find_clearances(finger, (3, 3)).values())

    point, steps = np.asarray(flat), 1e-6 * np.eye(len(flat))
    values = jax.jit(jax.vmap(value))(jnp.asarray(np.concatenate([point + steps, point - steps])))
    slope = jax.jit(jax.grad(value))(flat)
    found = (values[: len(point)] - values[len(point) :]) / 2e-6
    np.testing.assert_allclose(slope, found, rtol=1e-5, atol=1e-6)
    camera = free_part(build(slope)).camera
    assert np.min(np.abs(ravel_pytree(camera)[0])) > 1e-3


@pytest.mark.parametrize(("host", "phalanges", "layered"), CASES)
def test_a_file_has_the_phalanx(host, phalanges, layered):
    made = random_finger(settings(host, phalanges, layered), 9)
    text = format_finger(made)
    again = parse_finger(tomllib.loads(text), "copy")
    assert_same(made, again, rtol=1e-14)
    assert camera_of(again).phalanx == host
    assert format_finger(again) == text
    # Files of earlier versions have no such key.
    assert ("phalanx" in tomllib.loads(text)["camera"]) == (host != "intermediate")
    tables = json.loads(json.dumps(scene_tables(made.scene())))
    assert_same(parse_scene(tables, "finger"), made.scene(), rtol=1e-12)


def test_a_camera_needs_room_in_its_own_phalanx():
    with pytest.raises(ValidationError, match="metacarpal"):
        MirrorSpec.model_validate({"camera": {"phalanx": "metacarpal"}})
    given = {"camera": {"phalanx": "distal", "width": 14}, "body": {"distal": 14}}
    with pytest.raises(ValidationError, match=r"must be smaller than body\.distal \(14 mm\)"):
        FingerMirrorsSpec.model_validate(given)


@pytest.mark.parametrize("host", PHALANGES)
def test_errors_are_those_of_the_straight_finger(host):
    made = random_finger(settings(host, []), 3)
    before, after = (one.scene() for one in (made, perturb(made, jnp.array([0.3, -0.2, 0.03]))))
    np.testing.assert_allclose(after.camera.position - before.camera.position, [0.3, -0.2])
    assert float(after.camera.direction - before.camera.direction) == pytest.approx(0.03)


@pytest.mark.parametrize(("host", "phalanges", "layered"), CASES)
def test_searches_begin_within_their_bounds(host, phalanges, layered):
    spec = settings(host, phalanges, layered)
    # With more the poor layout is too deep: the search begins at the nearest place inside.
    spec = spec.model_copy(update={"room": spec.room.model_copy(update={"clearance": 1.0})})
    made = poor(spec)
    least, greatest = bounds(made, spec)
    starts = first_placements(made, spec, 0)
    assert len(starts) == 3
    for start in starts:
        for low, value, high in zip(*map(jax.tree.leaves, (least, start, greatest)), strict=True):
            assert bool(jnp.all((low <= value + 1e-12) & (value <= high + 1e-12)))
    # Over its own phalanx, whatever carries it.
    along = sorted(abs(float(camera_of(one).along)) for one in (least, greatest))
    assert along == [4.0, float(getattr(made.body, host)) - 4.0]
    # A mirror between two joints may reach beyond both, another one as far as the end wall.
    ends = {"proximal": (-34.0, 5.0), "intermediate": (-5.0, 28.0), "distal": (-5.0, 31.0)}
    reached = dict.fromkeys(phalanges, (math.inf, -math.inf))
    for low, high in zip(least.mirrors, greatest.mirrors, strict=True):
        first, last = reached[low.phalanx]
        own = float(jnp.min(low.ends[:, 0])), float(jnp.max(high.ends[:, 0]))
        reached[low.phalanx] = min(first, own[0]), max(last, own[1])
    assert reached == {phalanx: ends[phalanx] for phalanx in reached}


@pytest.mark.parametrize(
    ("host", "moving", "joints"),
    [
        ("proximal", {"intermediate": "PIP", "distal": "DIP"}, [(), (0,), (0, 1)]),
        ("intermediate", {"proximal": "PIP", "distal": "DIP"}, [(0,), (), (1,)]),
        ("distal", {"proximal": "PIP", "intermediate": "DIP"}, [(0, 1), (1,), ()]),
    ],
)
def test_pads_move_by_the_joints_between(host, moving, joints):
    """Each joint alone, by the library's own coverage: without mirrors nothing else matters."""
    assert [tuple(joints_between(pad, host)) for pad in PHALANGES] == joints
    made = poor(settings(host, []))
    assert moving_pads(made.scene()) == moving
    square = coverage_grid(made)
    assert square.disagreement <= 1e-12
    for pad, own in enumerate(joints):
        varies = [float(np.max(np.ptp(square.coverage[..., pad], axis=axis))) for axis in (0, 1)]
        assert {joint for joint in (0, 1) if varies[joint] > 1e-12} <= {*own}


@pytest.mark.parametrize("host", ["proximal", "distal"])
def test_tables_drawing_and_explorer_follow_the_camera(host):
    made = packaged_finger()
    camera = replace(
        camera_of(made), phalanx=host, along=jnp.asarray(-12.0 if host == "proximal" else 9.0)
    )
    phalanges: list[Phalanx] = ["intermediate", "distal"]
    mirrors = [
        replace(part, phalanx=one) for part, one in zip(made.mirrors, phalanges, strict=True)
    ]
    made = replace(made, camera=camera, mirrors=tuple(mirrors))
    table, origin = dimensions(made), "A" if host == "proximal" else "B"
    own = f"camera, from {origin} in the {host} phalanx"
    assert {part for part in table["part"] if "from" in part} == {
        own,
        "intermediate mirror, from A in its phalanx",
        "distal mirror, from B in its phalanx",
    }
    place = table.where(part=own)["value"]
    depth = float(camera.depth)
    np.testing.assert_allclose(place[:2], [float(camera.along), 21.0 - depth])
    drawing = make_finger_drawing(made)
    (circle,) = [one for one in drawing.circles if one.layer == "camera"]
    x = float(camera.along) + (23.0 if host == "distal" else 0.0)
    np.testing.assert_allclose(circle.center, [x, 21.0 - depth])
    # The ends of a mirror on the phalanx that stands still are measured from a joint.
    ends = np.asarray(made.scene().mirrors)[0]
    starts = [one.start for one in drawing.dimensions if math.dist(one.end, ends[1]) < 1e-9]
    assert (0.0, 0.0) in [tuple(map(float, start)) for start in starts]
    explorer = FingerExplorer(FingerParametric(made))
    assert explorer.values()["camera.along"] == float(camera.along)
    (view,) = [one for one in explorer.sketch() if one.name == SEEN]
    (handle,) = [one for one in view.handles if one.name == "camera"]
    np.testing.assert_allclose(handle.place, [x, 21.0 - depth], atol=1e-9)
