"""``designopt trace`` as a person meets it: the document, pictures, remarks and faults."""

import json
import math
import pickle
import shutil
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.cli import run
from designopt.interpreter import translate
from optics import find_views, read_scene
from optics.plot import trace_figures
from optics.visibility import scene_trace as sight
from tests.commands import check_command_refused, refused_cases
from tests.helpers import DATA, SCENES

FLAP = (DATA / "scenes/flap.toml").read_text(encoding="utf-8")
SEEN = 10 * math.tan(math.radians(30))


@pytest.fixture(autouse=True)
def _in_a_folder_of_scenes(tmp_path, monkeypatch):
    for path in (*SCENES.glob("*.toml"), *DATA.glob("scenes/*.toml")):
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def trace(capsys):
    """The document and the remarks of a command."""

    def command(*arguments: str) -> tuple[Any, str]:
        assert run(["trace", *arguments]) == 0
        shown = capsys.readouterr()
        *said, fields = shown.err.splitlines(keepends=True)
        assert fields.startswith("camera: ")  # of every scene, and tested with sold cameras
        return json.loads(shown.out), "".join(said)

    return command


def shadow(tilt: float) -> tuple[float, float]:
    """Where the flap's shadow begins and ends on the floor, mm."""
    ends = [[2, 5], [2 + 2 * math.cos(tilt), 5 + 2 * math.sin(tilt)]]
    first, last = sorted(10 * x / (10 - y) for x, y in ends)
    return first, last


def test_a_sweep_shows_the_flaps_shadow_wander(trace):
    document, said = trace("flap.toml", "--sweep", "tilt=0:180:3")
    wanted = {"scene": "flap", "engine": "exact", "bounces": 0, "lens": None, "rays": []}
    assert {key: document[key] for key in wanted} == wanted
    limit, flap = "limit of the field of view", "blocker 'flap': its end"
    coverages = []
    for pose, tilt in zip(document["poses"], (0.0, 90.0, 180.0), strict=True):
        assert pose["angles_deg"] == {"tilt": tilt, "swing": 0}
        assert (pose["mirrors"], pose["virtual_cameras"]) == ({}, {})
        pad = pose["pads"]["floor"]
        (view,) = pad["views"].values()
        first, last = shadow(math.radians(tilt))
        wanted = [[-SEEN, first], [last, SEEN]] if last < SEEN else [[-SEEN, first]]
        np.testing.assert_allclose(16 * np.array(view["intervals"]) - 8, wanted, atol=1e-12)
        ends = np.array(wanted)
        pixels = 300 + 300 / math.tan(math.radians(30)) * -ends / 10
        np.testing.assert_allclose(view["pixels"], pixels, rtol=1e-12, atol=1e-11)
        begins = "'from'" if tilt < 180 else "'to'"
        assert view["ends"][0] == [limit, f"{flap} {begins}"]
        if len(wanted) == 2:
            assert view["ends"][1] == [f"{flap} 'from'", limit]
        assert "why_not" not in view
        coverages.append(np.sum(np.diff(ends)) / 16)
        assert pad["coverage"] == pytest.approx(coverages[-1], rel=1e-13)
        assert pad["redundancy"] == pytest.approx(coverages[-1], rel=1e-13)
        # Of a pinhole that looks at it squarely, all of a line is seen equally well.
        sharpness = 30 / math.tan(math.radians(30))
        for spread in (pad["px_per_mm"], view["px_per_mm"]):
            assert spread == pytest.approx(dict.fromkeys(("min", "median", "max"), sharpness))
        assert view["distance_mm"][0] == pytest.approx(10, rel=1e-4)
        assert view["distance_mm"][1] == pytest.approx(10 / math.cos(math.radians(30)))
        hidden = pose["pads"]["wall"]
        assert (hidden["coverage"], hidden["px_per_mm"]) == (0, None)
        assert hidden["views"]["direct"]["intervals"] == []
        assert "not on the sensing side" in hidden["views"]["direct"]["why_not"]
    worst = int(np.argmin(coverages))
    first, ends, last, why = said.splitlines()
    assert f"worst at tilt = {90 * worst}°" in first
    assert f"only {100 * coverages[worst]:.3g} %" in first
    assert all(end in ends for end in (limit, f"{flap} 'to'", f"{flap} 'from'"))
    assert "pad 'wall'" in last
    assert "not on the sensing side" in why


def test_blocks_of_poses_are_as_one(trace, monkeypatch):
    whole, said = trace("flap.toml", "--sweep", "tilt=0:200:3")
    # Two poses at a time, so that the last block is filled up.
    two = 2 * sight._bytes_of_pose(read_scene("flap.toml").layout, 0)
    monkeypatch.setattr(sight, "MEMORY", two)
    assert trace("flap.toml", "--sweep", "tilt=0:200:3") == (whole, said)


def test_more_pieces_than_there_is_room_for_are_told(trace, monkeypatch):
    def seen(scene, poses, *, bounces):
        found = find_views(scene, poses, bounces=bounces, max_pieces=1)
        return found, found.value.coverage(), found.value.redundancy()

    monkeypatch.setattr(sight, "_seen", seen)
    document, said = trace("flap.toml", "--sweep", "tilt=160:180:3")
    (view,) = document["poses"][2]["pads"]["floor"]["views"].values()
    assert len(view["intervals"]) == 1
    assert "more pieces" in view["incomplete"]
    assert "pad 'floor': at 3 poses it is seen in more pieces than there is room for" in said


def test_views_in_a_mirror_agree_with_dense_sampling(trace):
    document, said = trace("folded-pad.toml")
    assert said == ""
    (pose,) = document["poses"]
    pad = pose["pads"]["skin"]
    lid = np.array([[-4, 15.5], [16, 7.8]])
    length = np.linalg.norm(lid[1] - lid[0])
    along = (lid[1] - lid[0]) / length
    normal = np.array([-along[1], along[0]])
    camera, axis = np.array([-14.0, 5]), math.radians(10)
    image = camera - 2 * normal * ((camera - lid[0]) @ normal)
    np.testing.assert_allclose(pose["virtual_cameras"]["mirror:lid"], image, rtol=1e-13)
    places = np.stack([np.linspace(0, 22, 220_001), np.zeros(220_001)], axis=-1)
    turned = np.array([math.cos(axis), math.sin(axis)])
    best = 0
    for name, source, looks in (
        ("direct", camera, turned),
        ("mirror:lid", image, turned - 2 * normal * (turned @ normal)),
    ):
        view = pad["views"][name]
        assert view["intervals"] == [[0, 1]]
        arrows = places - source
        tangent = (arrows @ [-looks[1], looks[0]]) / (arrows @ looks)
        density = np.abs(np.gradient(320 / math.tan(math.radians(50)) * tangent, places[:, 0]))
        spread = {"min": density.min(), "median": np.median(density), "max": density.max()}
        assert view["px_per_mm"] == pytest.approx(spread, rel=2e-4)
        distance = np.linalg.norm(arrows, axis=1)
        assert view["distance_mm"] == pytest.approx([distance.min(), distance.max()], rel=1e-4)
        best = np.maximum(best, density)
    spread = {"min": best.min(), "median": np.median(best), "max": best.max()}
    assert pad["px_per_mm"] == pytest.approx(spread, rel=2e-4)
    assert (pad["coverage"], pad["redundancy"]) == (1, 2)
    # Seen from the virtual camera, the ends of the pad lie behind these places of the lid.
    used = []
    for end in places[[0, -1]]:
        part = (camera - image) @ normal / 2 / ((end - image) @ normal)
        used.append((image + part * (end - image) - lid[0]) @ along / length)
    np.testing.assert_allclose(pose["mirrors"]["lid"]["used"], [sorted(used)], rtol=1e-12)


@pytest.mark.slow
def test_views_in_a_parabola_are_those_of_its_equation(trace):
    document, said = trace("parabola.toml")
    assert said == ""
    assert document["engine"] == "traced"
    (pose,) = document["poses"]
    assert "virtual_cameras" not in pose
    pad = pose["pads"]["wall"]
    # A ray at φ from the axis leaves the mirror at the height 2 f tan(φ/2).
    focal = 100**2 / (4 * 60)
    heights = np.array([60, 30, 0])
    density = 1000 / math.radians(160) / focal / (1 + (heights / (2 * focal)) ** 2)
    spread = dict(zip(("min", "median", "max"), density, strict=True))
    assert pad["px_per_mm"] == pytest.approx(spread, rel=2e-4)
    assert pad["views"]["mirror:dish"]["px_per_mm"] == pytest.approx(spread, rel=2e-4)
    assert pad["coverage"] == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(pose["mirrors"]["dish"]["used"], [[0.2, 0.8]], rtol=1e-10)


def test_poses_and_sweeps_give_the_angles(trace):
    document, _ = trace("flap.toml", "--pose", "swing=70", "--sweep", "tilt=-30:30:3")
    wanted = [(-30.0, 70.0), (0.0, 70.0), (30.0, 70.0)]
    poses = document["poses"]
    assert [tuple(pose["angles_deg"].items()) for pose in poses] == [
        (("tilt", tilt), ("swing", swing)) for tilt, swing in wanted
    ]
    views = find_views(read_scene("flap.toml"), jnp.deg2rad(jnp.array(wanted)), bounces=0)
    for number, pose in enumerate(poses):
        for index, name in enumerate(("floor", "wall")):
            (view,) = pose["pads"][name]["views"].values()
            assert len(view["intervals"]) == int(views.value.present[number, index].sum())
            margin = math.degrees(views.margin[number, 0, index])
            assert view["margin_deg"] == pytest.approx(margin, rel=1e-12)


def test_rays_go_from_mirror_to_mirror_until_something_ends_them(trace):
    ends = {
        "50,40,225": "it leaves the scene",
        "20,100,0": "it ends at blocker 'post'",
        "-5,20,0": "it ends at the back of mirror 'wall'",
        "20,-5,-90": "it leaves the scene",
    }
    document, said = trace("corner.toml", *(f"--ray={ray}" for ray in ends))
    assert said == "corner: there are no pads to be seen\n"
    (pose,) = document["poses"]
    assert (pose["angles_deg"], pose["pads"]) == ({}, {})
    names = "floor", "wall", "floor+wall", "wall+floor"
    assert set(pose["virtual_cameras"]) == {f"mirror:{name}" for name in names}
    rays = document["rays"]
    assert [ray["end"] for ray in rays] == list(ends.values())
    assert [len(ray["hits"]) for ray in rays] == [2, 1, 1, 0]
    assert {(ray["pose"], *ray["start"], ray["direction_deg"]) for ray in rays} == {
        (0, *map(float, ray.split(","))) for ray in ends
    }
    first, second = rays[0]["hits"]
    root = math.sqrt(2)
    for hit, wanted in (
        (first, ["mirror:floor", 10, 0, 0.05, 135, 40 * root, 45, True]),
        (second, ["mirror:wall", 0, 10, 0.05, 45, 50 * root, 45, True]),
    ):
        keys = ["element", "x", "y", "coordinate", "direction_deg", "path_length_mm"]
        assert list(hit) == [*keys, "grazing_deg", "reflected"]
        element, *numbers = hit.values()
        assert element == wanted[0]
        assert numbers == pytest.approx(wanted[1:], abs=1e-12)
    document, _ = trace("corner.toml", "--ray=50,40,225", "--bounces", "1")
    assert len(document["rays"][0]["hits"]) == 2
    assert "one more than --bounces" in document["rays"][0]["end"]


def test_rays_are_followed_in_every_pose(trace):
    document, _ = trace("flap.toml", "--sweep", "tilt=0:180:3", "--ray=3,9,-90", "--ray=20,4,180")
    rays = document["rays"]
    floor, wall = "it ends at pad 'floor'", "it ends at pad 'wall'"
    ends = "it ends at blocker 'flap'", wall, floor, wall, floor, wall
    assert [(ray["pose"], ray["end"]) for ray in rays] == list(
        zip((0, 0, 1, 1, 2, 2), ends, strict=True)
    )
    assert rays[2]["hits"][0]["coordinate"] == pytest.approx(11 / 16)
    document, _ = trace("flap.toml", "--sweep", "tilt=0:180:3", "--ray=3,4,0", "--ray=0,-1,90")
    assert document["rays"][0]["end"] == "it ends at the back of pad 'wall'"
    assert document["rays"][1]["end"] == "it ends at the back of pad 'floor'"


PLATE = """
pads = [{ name = "floor", from = [-5, 0], to = [5, 0], side = "left", layers = [{ thickness = 3, index = 1.5 }] }]
[camera]
position = [0, 15]
direction_deg = -90
fov_deg = 120
pixels = 1000
max_blur_px = 4
lens = { focal_length = 2, f_number = 2, focus = 20 }
"""  # noqa: E501


def test_behind_layers_blur_is_that_of_the_apparent_distance(trace):
    Path("plate.toml").write_text(PLATE)
    document, said = trace("plate.toml")
    view = document["poses"][0]["pads"]["floor"]["views"]["direct"]
    least, greatest = view["apparent_distance_mm"]
    # From the middle along the normal: the thickness over the index.
    assert least == pytest.approx(12 + 3 / 1.5, rel=1e-12)
    assert least < greatest < view["distance_mm"][1]
    lens = document["lens"]
    wanted = [abs(lens["sensor_distance_mm"] * (1 / 2 - 1 / far) - 1) for far in (least, greatest)]
    assert np.array(wanted) / lens["pixel_mm"] == pytest.approx(view["blur_px_at_distance"])
    assert f"px at an apparent {least:.4g} mm is more than max_blur_px = 4" in said
    assert "--ray" not in said


def test_rays_end_at_the_surface_of_layers_and_are_said_to(trace):
    Path("plate.toml").write_text(PLATE)
    document, said = trace("plate.toml", "--ray=1,15,-90", "--ray=9,1,180")
    onto, beside = document["rays"]
    assert (onto["hits"][0]["y"], beside["hits"][0]["x"]) == (3.0, 5.0)
    assert onto["end"] == "it ends at pad 'floor'"
    assert beside["end"] == "it ends at pad 'floor', layer 1 at 'to'"
    assert "--ray: rays end where they meet layers (of 'floor'), not at the membrane\n" in said
    _, said = trace("plate.toml", "--ray=1,15,90")
    assert "--ray" not in said


def test_files_are_written_whole_and_replaced_only_by_force(tmp_path, capsys):
    before = {path.name for path in tmp_path.iterdir()}
    command = ["trace", "flap.toml", "--sweep", "tilt=0:180:3", "--json", "t.json"]
    command += ["--figure", "t.png", "--chart", "t.svg", "--ray", "3,9,-90"]
    assert run(command) == 0
    assert capsys.readouterr().out == ""
    names = {"t.json", "t.png", "t.svg"}
    assert {path.name for path in tmp_path.iterdir()} == before | names
    written = {name: (tmp_path / name).read_bytes() for name in names}
    assert all(written.values())
    again = [part.replace("0:180", "0:90") for part in command[:6]]
    assert run(again) == 2
    assert "exists already" in capsys.readouterr().err
    assert {name: (tmp_path / name).read_bytes() for name in names} == written
    assert run([*again, "--force"]) == 0
    last = json.loads((tmp_path / "t.json").read_text())["poses"][2]
    assert last["angles_deg"]["tilt"] == 90
    assert {path.name for path in tmp_path.iterdir()} == before | names


def test_a_chart_shows_the_documents_resolution(monkeypatch):
    figures = []
    monkeypatch.setattr(trace_figures, "_save", lambda figure, path: figures.append(figure))
    command = ["trace", "flap.toml", "--sweep", "tilt=0:180:3", "--json", "t.json"]
    assert run([*command, "--chart", "t.svg"]) == 0
    poses = json.loads(Path("t.json").read_text())["poses"]
    lines = {line.get_gid(): line for axes in figures[0].axes for line in axes.lines}
    for kind, name in (("least", "min"), ("greatest", "max")):
        wanted = [pose["pads"]["floor"]["px_per_mm"][name] for pose in poses]
        np.testing.assert_array_equal(lines[f"{kind}:floor"].get_ydata(), wanted)


@pytest.mark.parametrize(("line", "words"), refused_cases("trace"))
def test_faults_are_one_line_and_leave_nothing_behind(line, words, tmp_path, capsys):
    (tmp_path / "linkage.toml").write_text(FLAP.replace("[camera]", "[joints]"))
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    check_command_refused(capsys, line, words)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_too_many_paths_are_refused(tmp_path, capsys):
    mirrors = "".join(
        f"[[mirrors]]\nname = 'm{i}'\nfrom = [{i}, -5]\nto = [{i + 1}, -5]\n" for i in range(12)
    )
    (tmp_path / "many.toml").write_text(FLAP + mirrors)
    # 1 + 12 + 12·11 + … + 12·11⁵
    paths = f"{1 + 12 * (11**6 - 1) // 10:,} paths"
    check_command_refused(capsys, "trace many.toml --bounces 6", [paths])


def test_what_is_seen_is_numpys_alone():
    """No step of the program is JAX's: it can be kept."""
    scene = read_scene(SCENES / "finger.toml")
    seen = jax.make_jaxpr(lambda angles: find_views(scene, angles).value)(jnp.zeros((2, 2)))
    assert pickle.dumps(translate(seen))
