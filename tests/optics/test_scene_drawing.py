"""A drawn scene shows what its views say, where a hand calculation puts it."""

import dataclasses
import itertools
import tomllib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.path import Path

from designopt.plot.figures import style
from designopt.solution import Solution
from optics.plot.scene_drawing import draw_scene, pose_name, scene_legend, seen_pieces
from optics.plot.section import INSIDE
from optics.scene.reading import parse_scene
from optics.scene.scene import Scene, Surface
from optics.visibility.views import Pieces, ViewResult
from studies.oracles.layered_scenes import read
from studies.oracles.layers import follow
from tests.helpers import SCENES
from tests.optics.extruded import LAYOUT, POSES, WORDS, finned, pieces_of, views_at_poses
from tests.optics.scenes import made_pieces, posed

RAYS = 4


def views_of(pose):
    return jax.tree.map(lambda leaf: leaf[pose], views_at_poses(fin=True))


def surfaces(pose):
    """Ends of mirrors, then pads, then blockers, as complex numbers."""
    return posed(finned(), POSES[pose]).ends


def drawn(pose):
    with style():
        axes = Figure(figsize=(4, 4)).subplots()
        draw_scene(axes, finned(), POSES[pose], views_of(pose), rays=RAYS)
    return axes


def lines(axes, kind):
    """Lines of a kind as complex numbers, with the rest of their names."""
    return [
        (gid.removeprefix(f"{kind}:"), line.get_xydata() @ [1, 1j])
        for line in axes.lines
        if (gid := line.get_gid() or "").startswith(f"{kind}:")
    ]


@pytest.mark.parametrize("pose", [0, 1, 3])
def test_rays_and_pads_show_what_is_seen(pose):
    axes, ends, reached = drawn(pose), surfaces(pose), {}
    camera = complex(*finned().camera.position)
    for name, ray in lines(axes, "ray"):
        path, pad = name.rsplit(":", 1)
        word, pad = WORDS[path], [part.name for part in LAYOUT.pads].index(pad)
        assert len(ray) == len(word) + 2
        assert ray[0] == pytest.approx(camera)
        part = 0j
        for leg, surface in enumerate((*word, 2 + pad), start=1):
            start, end = ends[surface]
            part = (ray[leg] - start) / (end - start)
            assert abs(part.imag) < 1e-12
            assert 0 <= part.real <= 1
            if leg <= len(word):
                # Equal angles: mirrored in the surface, the arriving ray is the one that leaves.
                along = (end - start) / abs(end - start)
                before, after = (step / abs(step) for step in np.diff(ray[leg - 1 : leg + 2]))
                assert after == pytest.approx(along * np.conj(before / along), abs=1e-12)
        reached.setdefault((path, pad), []).append(part.real)
    view = views_of(pose).value
    pieces = {
        (path, pad): found
        for index, path in enumerate(WORDS)
        for pad in range(3)
        if len(found := pieces_of(view, pad, index))
    }
    assert reached.keys() == pieces.keys()
    for key, found in pieces.items():
        groups = np.reshape(reached[key], (-1, RAYS))
        np.testing.assert_allclose(
            np.sort(np.stack([groups.min(axis=1), groups.max(axis=1)], axis=-1), axis=0),
            np.sort(found, axis=0),
            atol=50 * INSIDE,  # they pass inside; evenly spread in the image, not on the pad
        )
        assert all(np.any((found[:, 0] <= x) & (x <= found[:, 1])) for x in reached[key])

    # Pads are divided into seen and hidden.
    coverage = np.asarray(view.coverage())
    assert coverage[1] < 1  # the fin hides some
    for part, (start, end), covered in zip(LAYOUT.pads, ends[2:5], coverage, strict=True):
        parts = {
            kind: np.array([((line - start) / (end - start)).real for _, line in named])
            for kind in ("seen", "hidden")
            if (named := [pair for pair in lines(axes, kind) if pair[0] == part.name])
        }
        assert np.sum(np.diff(parts["seen"])) == pytest.approx(covered, abs=1e-12)
        everything = np.sort(np.concatenate([*parts.values()]), axis=0)
        np.testing.assert_allclose(everything[1:, 0], everything[:-1, 1], atol=1e-12)
        np.testing.assert_allclose([everything[0, 0], everything[-1, 1]], [0, 1], atol=1e-12)

    def displayed(kind, name):
        line = next(line for line in axes.lines if line.get_gid() == f"{kind}:{name}")
        return line.get_transform().transform(line.get_xydata()) @ [1, 1j]

    for part in LAYOUT.pads:  # all sense to the left, and bars lie behind that side
        face, bar = displayed("sensing", part.name), displayed("seen", part.name)
        assert np.all(((bar - face[0]) / (face[1] - face[0])).imag < 0)


def test_hinges_and_moving_parts_are_where_they_belong():
    axes = drawn(1)
    assert {name: line[0] for name, line in lines(axes, "hinge")} == pytest.approx(
        {"proximal": 0, "distal": 23}
    )
    mirrors = dict(lines(axes, "mirror"))
    for part, ends in zip(LAYOUT.mirrors, surfaces(1), strict=False):
        np.testing.assert_allclose(mirrors[part.name], ends, atol=1e-12)
    drawn_blockers = [name for name, _ in lines(axes, "blocker")]
    assert drawn_blockers == [part.name for part in LAYOUT.blockers]


@pytest.mark.parametrize("pose", [0, 2])
def test_labels_name_all_and_stand_clear(pose):
    axes = drawn(pose)
    names = {text.get_text() for text in axes.texts}
    assert names == {"proximal", "intermediate", "distal", "proximal mirror", "distal mirror"}
    points = 72 / axes.figure.dpi
    places = [axes.transData.transform(text.get_position()) * points for text in axes.texts]
    assert all(axes.bbox.contains(*(place / points)) for place in places)
    for one, other in itertools.combinations(places, 2):
        assert np.hypot(*(one - other)) > 6
    for (start, end), place in itertools.product(surfaces(pose)[:5], places):
        middle = complex(*axes.transData.inverted().transform(place / points))
        along = (end - start) / abs(end - start)
        part = np.clip(((middle - start) / along).real, 0, abs(end - start))
        foot = start + part * along
        gap = np.hypot(*(axes.transData.transform((foot.real, foot.imag)) * points - place))
        assert gap > 3.5  # half the height of a label


def test_a_pose_is_named_by_its_angles():
    assert pose_name(finned(), np.radians([30, 20])) == "PIP 30°, DIP 20°"
    for angles, degrees, name in (
        (("elbow", "dip"), [30, 12.5], "elbow 30°, DIP 12.5°"),
        ((), [], "finger"),
    ):
        layout = dataclasses.replace(LAYOUT, angles=angles)
        scene = dataclasses.replace(finned(), layout=layout)
        assert pose_name(scene, np.radians(degrees)) == name


def test_the_legend_names_the_paths_that_see():
    for pose in range(len(POSES)):
        _, names = scene_legend(finned(), views_of(pose))
        view = views_of(pose).value
        seen = [[*WORDS][path] for path in np.unique(view.path[view.present])]
        assert [name for name in names if name in WORDS] == seen
    handles, names = scene_legend(finned(), views_at_poses(fin=True))
    assert len(handles) == len(names) == len(set(names))
    assert {*WORDS, "pad, hidden", "hinge", "blocker", "mirror, ticks on its back"} <= {*names}
    assert not {"two-sided mirror", "one-sided blocker"} & {*names}
    others = (Surface("one", 1), Surface("other", -1))
    layout = dataclasses.replace(LAYOUT, mirrors=(Surface("flat", 0),) * 2, blockers=others)
    _, names = scene_legend(dataclasses.replace(finned(), layout=layout), views_of(0))
    assert {"two-sided mirror", "one-sided blocker"} <= {*names}
    assert not {"blocker", "mirror, ticks on its back"} & {*names}


def by_hand(pieces: Pieces) -> Solution[Pieces]:
    """Views of one pose."""
    return Solution(pieces, jnp.zeros(()), jnp.zeros(()), ViewResult.successful)


def test_overlapping_pieces_are_drawn_as_one():
    start, end, path = np.zeros((3, 3, 4))
    start[0], end[0], path[0] = (0.1, 0.3, 0.8, 0.82), (0.4, 0.6, 0.9, 0.85), (0, 1, 2, 0)
    views = by_hand(made_pieces(start, end, path.astype(int)))
    assert seen_pieces(views, 0) == [(0.1, 0.6), (0.8, 0.9)]
    assert seen_pieces(views, 1) == []


def seen(position: list[float], direction: float, fov: float, **surfaces: object) -> Scene:
    """What a pinhole sees of surfaces, by one reflection."""
    camera = {"position": position, "direction_deg": direction, "fov_deg": fov, "pixels": 1000}
    table = {"name": "test", "bounces": 1}
    return parse_scene({"camera": camera | {"projection": "pinhole"}, "scene": table, **surfaces})


def test_rays_from_the_focus_of_a_parabola_leave_parallel():
    focal, half = 40.0, 60.0
    depth = half**2 / (4 * focal)
    dish = {"name": "dish", "from": [depth, half], "to": [depth, -half], "side": "left"}
    wall = {"name": "wall", "from": [200, -30], "to": [200, 50], "side": "left"}
    mirrors = [dish | {"radius": 2 * focal, "conic": -1}]
    scene = seen([focal, 0], 180, 170, mirrors=mirrors, pads=[wall])
    # A ray at an angle φ from the axis leaves at the height 2 f tan(φ / 2).
    heights = np.array([-30.0, 50.0])
    pixels = scene.camera.pixel(jnp.asarray(-2 * np.arctan(heights / (2 * focal))))
    views = by_hand(made_pieces([[0]], [[1]], [[1]], 1, pixels=pixels[None, None]))
    axes = Figure(figsize=(6, 4)).subplots()
    draw_scene(axes, scene, np.zeros(0), views, rays=7)
    rays = np.array([ray for _, ray in lines(axes, "ray")])
    assert rays.shape == (7, 3)
    x, y = np.real(rays), np.imag(rays)
    np.testing.assert_allclose(x[:, 1], y[:, 1] ** 2 / (4 * focal), atol=1e-10)
    np.testing.assert_allclose(y[:, 1], y[:, 2], atol=1e-10)
    np.testing.assert_allclose(x[:, 2], 200, atol=1e-10)
    np.testing.assert_allclose(y[[0, -1], 2], heights, atol=1e-3)  # they pass on the inside
    ((_, arc),) = lines(axes, "mirror")
    np.testing.assert_allclose(arc.real, arc.imag**2 / (4 * focal), atol=1e-10)
    assert arc[0] == pytest.approx(depth + 1j * half)
    assert arc[-1] == pytest.approx(depth - 1j * half)


@pytest.mark.parametrize("distance", [70.0, 100.0, 1e4])
def test_a_camera_that_is_far_away_stays_outside(distance):
    # The pad is 10 mm long, so from 80 mm on.
    pad = {"name": "wall", "from": [-5, 0], "to": [5, 0], "side": "left"}
    scene = seen([0, distance], -90, 0.5, pads=[pad])
    axes = Figure(figsize=(4, 4)).subplots()
    draw_scene(axes, scene, np.zeros(0), by_hand(made_pieces([[0]], [[0]], [[0]])))
    inside = axes.get_ylim()[1] > distance
    assert inside == (distance < 80)
    assert axes.get_title() == ("test" if inside else f"test (camera {distance:,.0f} mm away)")


def layered(**more: Any) -> dict[str, Any]:
    """The gallery's scene of layered pads: its tables, and more."""
    tables = tomllib.loads((SCENES / "layered-pad.toml").read_text(encoding="utf-8"))
    return tables | {"scene": {"name": "layered", "bounces": 1}} | more


AIMS = [
    ("direct", "tip", (8, 5), (27, 5), 4),  # through the outermost surface
    ("direct", "tip", (7, 4.8), (7, 3.2), 4),  # through the clear end of the first layer
    ("direct", "tip", (7, 1.8), (7, 0.1), 3),  # and of the second, on the membrane itself
    ("mirror:lid", "tip", (11, 21.5), (17, 18.5), 5),
    ("direct", "middle", (-27, 5), (-8, 5), 4),
]
"""Path, pad, where the first and the last ray go at first, and how many corners they have."""


def test_rays_go_on_through_layers_as_snells_law_bends_them():
    tables = layered()
    scene, camera = parse_scene(tables), complex(*tables["camera"]["position"])
    axis = np.exp(1j * np.radians(tables["camera"]["direction_deg"]))
    pixels, path, present = np.zeros((2, 4, 2)), np.zeros((2, 4), int), np.zeros((2, 4))
    for name, pad, *places, _ in AIMS:
        row = ["tip", "middle"].index(pad)
        slot = int(np.sum(present[row]))
        turned = np.angle((np.array(places) @ [1, 1j] - camera) / axis)
        pixels[row, slot] = scene.camera.pixel(jnp.asarray(turned))
        path[row, slot], present[row, slot] = ["direct", "mirror:lid"].index(name), 1
    views = by_hand(made_pieces(0 * present, present, path, 1, pixels=jnp.asarray(pixels)))
    axes = Figure(figsize=(6, 4)).subplots()
    draw_scene(axes, scene, np.zeros(0), views, rays=RAYS)
    rays = lines(axes, "ray")
    assert len(rays) == RAYS * len(AIMS)
    turns = np.array([np.angle((ray[1] - ray[0]) / axis) for _, ray in rays])
    reached = follow(read(tables), turns).at
    for (name, ray), at, aim in zip(rays, reached, np.repeat(range(len(AIMS)), RAYS), strict=True):
        path_name, pad, *_, corners = AIMS[aim]
        assert name == f"{path_name}:{pad}"
        assert len(ray) == corners
        membrane = next(np.array([p["from"], p["to"]]) for p in tables["pads"] if p["name"] == pad)
        start, end = membrane @ [1, 1j]
        assert ray[-1] == pytest.approx(start + at * (end - start), abs=1e-9)


def test_layers_and_bezel_stand_on_the_membrane_in_any_pose():
    tables = layered(frames={"f": {"hinge": [1, 2], "angle": "dip", "positive": "clockwise"}})
    tables["pads"] = [part | {"body": "f"} for part in tables["pads"]]
    scene = parse_scene(tables)
    nothing = by_hand(made_pieces(np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((2, 1), int), 1))
    axes = Figure(figsize=(6, 4)).subplots()
    draw_scene(axes, scene, np.radians([25.0]), nothing)
    # Along the middle pad from its first end, and above it.
    ten, twenty = 3 * np.tan(np.radians([10, 20]))
    low, high = -2 + twenty, 26 - ten
    outlines = {
        "layer 1:middle": [(-2, 2), (26, 2), (high, 5), (low, 5)],
        "layer 2:middle": [(0, 0), (25, 0), (25, 2), (0, 2)],
        "bezel:middle": [(low, 5), (low, 5.8), (low + 1.5, 5.8), (low + 1.5, 5)],
    }
    found: dict[Any, Any] = {
        part.get_gid(): part.get_xy() @ [1, 1j]
        for part in axes.patches[::-1]  # of the bezel's two parts the first is kept
        if type(part) is Polygon
    }
    assert found.keys() == outlines.keys() | {"layer 1:tip", "layer 2:tip"}

    def placed(places):
        return 1 + 2j + (np.array(places) @ [1, 1j] - 32 - 1 - 2j) * np.exp(-1j * np.radians(25))

    for name, places in outlines.items():
        np.testing.assert_allclose(found[name][:-1], placed(places), atol=1e-12)
    sensing = dict(lines(axes, "sensing"))
    np.testing.assert_allclose(sensing["middle"], placed([(0, 0), (25, 0)]), atol=1e-12)
    ends = [line for name, line in lines(axes, "end") if name == "middle"]
    wanted = [[(-2, 2), (low, 5)], [(26, 2), (high, 5)], [(0, 0), (0, 2)], [(25, 0), (25, 2)]]
    np.testing.assert_allclose(ends, [placed(pair) for pair in wanted], atol=1e-12)
    widths = {
        name: {line.get_linewidth() for line in axes.lines if line.get_gid() == f"end:{name}"}
        for name in ("tip", "middle")
    }
    assert max(widths["tip"]) < min(widths["middle"])  # clear ends, and black ones
    ledges = [line for name, line in lines(axes, "ledge") if name == "middle"]
    np.testing.assert_allclose(
        ends_of(ledges), ends_of([placed([(-2, 2), (0, 2)]), placed([(25, 2), (26, 2)])])
    )
    for text in axes.texts:
        x, y = text.get_position()
        for outline in found.values():
            assert not Path(np.stack([outline.real, outline.imag], -1)).contains_point((x, y))


def ends_of(segments):
    """Segments whichever end comes first."""
    return np.sort_complex(np.ravel(segments))


def test_the_legend_tells_of_layers_where_there_are_any():
    nothing = by_hand(made_pieces(np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((2, 1), int), 1))
    words = {"layer", "clear end of a layer", "opaque end of a layer", "bezel"}
    tables = layered()
    assert words <= {*scene_legend(parse_scene(tables), nothing)[1]}
    tables["pads"] = tables["pads"][:1]
    assert words & {*scene_legend(parse_scene(tables), nothing)[1]} == {
        "layer",
        "clear end of a layer",
    }
    assert not words & {*scene_legend(finned(), views_of(0))[1]}
