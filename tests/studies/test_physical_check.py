"""The judge of predicted images against textbook optics, and the study end to end."""

from __future__ import annotations

import importlib.util
import math
from contextlib import nullcontext
from typing import Any

import mpmath
import numpy as np
import pytest
import scipy.optimize

from designopt import UserError
from designopt.study.study import Context
from studies.models import path_tracer
from studies.oracles.judge import engine
from studies.oracles.judge.engine import Engine
from studies.oracles.judge.frames import View, judge, judge_once, picture, union
from studies.oracles.judge.lens import Lens
from studies.oracles.judge.solids import motion_of, strip
from studies.oracles.judge.tracing import Tracer
from studies.physical_check import PhysicalCheckSpec
from studies.physical_check import run as study
from tests.studies.quick import quick_run

needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None,
    reason="Mitsuba is not installed; the extra 'judge' brings it",
)

FINE_PX = 1e-3
"""Twenty times the noise of a single ray in float32."""

FINE_MM = 1e-4
"""The same on a membrane 30 mm away."""

WIDTH = 20.0
PAD: dict[str, Any] = {"name": "pad", "from": [-20, 0], "to": [25, 0], "side": "left"}
PAD["width"] = WIDTH
SCENE: dict[str, Any] = {
    "camera": {"position": [0, 30], "direction_deg": -85, "fov_deg": 140, "pixels": 700},
    "mirrors": [{"name": "wall", "from": [30, 4], "to": [34, 40], "side": "left"}],
    "pads": [PAD],
}
TWO = [{"thickness": 3, "index": 1.49}, {"thickness": 2, "index": 1.41}]


def scene_with(**pad):
    return SCENE | {"pads": [PAD | pad]}


@pytest.fixture(params=["compiled", "scalar"])
def variant(request, monkeypatch):
    """Both ways in which Mitsuba follows rays."""
    if request.param == "scalar":
        monkeypatch.setattr(engine, "find_llvm", lambda: None)
    elif engine.find_llvm() is None:
        pytest.skip("there is no library of LLVM that Mitsuba can use")
    engine.load_mitsuba.cache_clear()
    yield request.param
    engine.load_mitsuba.cache_clear()


def polarised(cosine, before, behind):
    """Transmission of light across and within the plane of incidence (Born and Wolf, §1.5.2)."""
    sine = before / behind * math.sqrt(1 - cosine**2)
    if sine >= 1:
        return np.zeros(2)
    other = math.sqrt(1 - sine**2)
    across = (before * cosine - behind * other) / (before * cosine + behind * other)
    within = (behind * cosine - before * other) / (behind * cosine + before * other)
    return 1 - np.array([across, within]) ** 2


def fresnel(*surface):
    """Transmission of unpolarised light through one surface."""
    return polarised(*surface).mean()


@needs_mitsuba
def test_light_is_refracted_reflected_and_divided_as_in_textbooks(variant):
    top, bottom, back = (strip(y - 90, y + 90, -90, 90) for y in (0j, -10j, -20j))
    traced = Engine({(1.0, 1.5): [top], (1.5, 1.0): [bottom], "mirror": [back]})
    angles = np.deg2rad([0, 20, 40, 60, 80])
    ways = np.stack([np.sin(angles), -np.cos(angles), 0 * angles], axis=-1)
    first = traced.step(-10 * ways, ways)
    assert first.group.tolist() == [0] * 5
    np.testing.assert_allclose(first.onward[:, 0], np.sin(angles) / 1.5, atol=2e-7)
    wanted = [fresnel(cosine, 1, 1.5) for cosine in np.cos(angles)]
    np.testing.assert_allclose(first.light[:, 0, 0], wanted, atol=2e-6)
    # A plate moves rays sideways and leaves their direction.
    second = traced.step(first.point + 1e-3 * first.onward, first.onward)
    np.testing.assert_allclose(second.onward, ways, atol=1e-6)
    inner = np.arcsin(np.sin(angles) / 1.5)
    np.testing.assert_allclose(second.point[:, 0], 10 * np.tan(inner), atol=FINE_MM)
    third = traced.step(second.point + 1e-3 * second.onward, second.onward)
    np.testing.assert_allclose(third.onward, ways * [1, -1, 1], atol=1e-6)
    np.testing.assert_allclose(third.light[:, 0, 0], 1, atol=1e-6)
    # Beyond the critical angle nothing leaves glass, and the back of a mirror is no mirror.
    steep, flat = ([math.sin(a), -math.cos(a), 0] for a in np.arcsin([0.6, 0.7]))
    ways = np.array([steep, flat, [0, 1, 0]])
    left = traced.step(np.array([[0, -5, 0], [0, -5, 0], [0, -30, 0]]), ways)
    assert left.light[0, 0, 0] == pytest.approx(fresnel(0.8, 1.5, 1), abs=2e-6)
    assert left.light[1:, 0, 0].tolist() == [0, 0]
    missed = traced.step(np.array([[0.0, 5, 0]]), np.array([[0.0, 1, 0]]))
    assert missed.group.tolist() == [-1]


HEIGHTS = {
    "pinhole": math.tan,
    "equidistant": lambda angle: angle,
    "equisolid": lambda angle: 2 * math.sin(angle / 2),
    "stereographic": lambda angle: 2 * math.tan(angle / 2),
    "orthographic": math.sin,
}


@pytest.mark.parametrize("projection", [*HEIGHTS, (-0.03, 0.004, 0.0, 0.0)])
def test_a_lens_images_angles_at_the_heights_of_its_projection(projection):
    camera = SCENE["camera"] | {"projection": projection}
    lens = Lens.of(camera, (1, 0), 4 / 3)
    height = HEIGHTS.get(projection) or (lambda a: a - 0.03 * a**3 + 0.004 * a**5)
    focal = 350 / height(math.radians(70))
    axis = np.array([math.cos(math.radians(-85)), math.sin(math.radians(-85)), 0])
    for angle, turn in ((0.0, 0.0), (0.3, 0.0), (0.8, 2.0), (1.2, -1.0)):
        radius = focal * height(angle)
        place = np.array(lens.middle) + radius * np.array([math.cos(turn), math.sin(turn)])
        [ray] = lens.rays(place[None])
        assert math.acos(min(ray @ axis, 1)) == pytest.approx(angle, abs=1e-7)
        assert ray[2] == pytest.approx(math.sin(angle) * math.cos(turn), abs=1e-9)
    # Rows grow clockwise: below the middle of an image that looks down is what lies to the left.
    assert lens.rays(np.array([[lens.middle[0], lens.rows]]))[0, 0] < axis[0]
    if projection == "orthographic":
        assert np.isnan(lens.rays(np.array([[-500.0, 0.0]]))).all()


def test_frames_turn_about_their_hinges_and_carry_each_other():
    frames = {
        "arm": {"hinge": [10, 0], "angle": "a"},
        "hand": {"hinge": [20, 0], "angle": "b", "parent": "arm", "positive": "clockwise"},
    }
    turn, shift = motion_of({"frames": frames}, {"a": 90, "b": 90}, "hand")
    # Its hinge is now above the arm's, and both turns cancel.
    assert turn * 20 + shift == pytest.approx(10 + 10j)
    assert turn * 30 + shift == pytest.approx(20 + 10j)
    turn, shift = motion_of({"frames": frames}, {"a": 90}, "hand")
    assert turn * 30 + shift == pytest.approx(10 + 20j)


def apparent_place(camera, layers, target, mirror=None):
    """Where a point of the membrane y = 0 is imaged through layers: a root of Snell's law.

    The camera is replaced by its image behind the mirror, and the ray turned back.
    """
    ends = [complex(*mirror[key]) for key in ("from", "to")] if mirror else [0, 1]
    along = (ends[1] - ends[0]) / abs(ends[1] - ends[0])
    pupil = complex(*camera["position"])
    source = ends[0] + along * ((pupil - ends[0]) / along).conjugate() if mirror else pupil
    reach = mpmath.hypot(target[0] - source.real, target[1])
    plates = [(source.imag - sum(one["thickness"] for one in layers), 1)]
    plates += [(one["thickness"], one["index"]) for one in layers]

    def missed(sine):
        return sum(t * sine / mpmath.sqrt(n * n - sine * sine) for t, n in plates) - reach

    sine = mpmath.findroot(missed, (0.0, 0.99999), solver="anderson", tol=1e-24)
    section = complex(sine * (target[0] - source.real) / reach, -mpmath.sqrt(1 - sine**2))
    side = float(sine * target[1] / reach)
    if mirror:
        section = along * (section / along).conjugate()
    section /= complex(*[f(math.radians(camera["direction_deg"])) for f in (math.cos, math.sin)])
    off = math.hypot(section.imag, side)
    focal = camera["pixels"] / 2 / math.radians(camera["fov_deg"] / 2)
    scale = focal * math.atan2(off, section.real) / off
    rows, columns = camera["pixels"], round(4 / 3 * camera["pixels"])
    return (columns - 1) / 2 + scale * side, (rows - 1) / 2 - scale * section.imag


@needs_mitsuba
@pytest.mark.parametrize("layers", [[], TWO[:1], TWO, TWO[::-1]], ids=["0", "3", "3+2", "2+3"])
def test_corners_appear_where_snells_law_has_them(layers):
    found = judge(scene_with(layers=layers), {})
    assert len(found.corners) == 6  # the mirror is too short to show all
    for corner in found.corners:
        target = PAD[("from", "to")[corner.end]][0], corner.side * WIDTH / 2
        mirror = SCENE["mirrors"][0] if corner.path else None
        wanted = apparent_place(SCENE["camera"], layers, target, mirror)
        assert corner.place == pytest.approx(wanted, abs=FINE_PX)
        assert corner.residual < FINE_PX


@needs_mitsuba
@pytest.mark.parametrize("layers", [[], TWO], ids=["bare", "layered"])
def test_the_picture_ends_where_the_outline_of_a_membrane_is_predicted(layers):
    tables: dict[str, Any] = scene_with(layers=layers)
    tracer = Tracer(tables, {}, 30j)
    lens = Lens.of(tables["camera"], (1, 0), 4 / 3)
    for x in (-15.0, 0.0, 11.0):
        place = np.array(apparent_place(tables["camera"], layers, (x, WIDTH / 2)))
        traced = tracer.trace(lens.rays(place + np.array([[-FINE_PX, 0], [FINE_PX, 0]])))
        assert traced.seen.tolist() == [True, False]
        assert traced.along[0] == pytest.approx(x + 20, abs=FINE_MM)


def met_below(place, layers, upper):
    """Where a ray in the section through a place of the outermost surface meets the membrane."""
    slope = (place - upper.real) / math.hypot(place - upper.real, upper.imag)
    return place + sum(
        one["thickness"] * slope / math.sqrt(one["index"] ** 2 - slope**2) for one in layers
    )


def bright_entry(least):
    """Where rays from 10 mm before and 15 mm above bring just the least light through `TWO`."""

    def missing(place):
        cosine = 15 / math.hypot(15, place + 10)
        inner = math.sqrt(1 - (1 - cosine**2) / TWO[0]["index"] ** 2)
        light = polarised(cosine, 1, TWO[0]["index"])
        light = light * polarised(inner, TWO[0]["index"], TWO[1]["index"])
        return light.mean() - least

    return scipy.optimize.brentq(missing, 1, 60)


@needs_mitsuba
def test_black_ends_lips_and_the_least_transmission_bound_what_is_seen():
    """A camera 10 mm beyond the end of a pad, 15 mm above its layers."""
    camera = SCENE["camera"] | {"position": [-30, 20], "direction_deg": -40}

    def seen(**more):
        [view] = judge({"camera": camera, "pads": [PAD | {"layers": TWO} | more]}, {}).views
        assert view.entrance == "top"
        return view

    def along(entry):
        return met_below(entry, TWO, -10 + 15j) / 45

    over_edge = seen()
    assert over_edge.bounds[0] == "end of the pad"
    assert over_edge.along[0] == pytest.approx(1, abs=1e-6)
    assert over_edge.along[1] == pytest.approx(along(0), abs=FINE_MM / 45)
    # A lip 2 mm long and 1 mm high: the line of sight over its upper inner edge.
    over_lip = seen(bezel={"lip": [2, 0], "height": 1})
    assert over_lip.along[1] == pytest.approx(along(2 + 12 / 14), abs=FINE_MM / 45)
    bright = seen(min_transmission=0.9)
    assert bright.bounds[0] == "least transmission"
    assert bright.along[0] == pytest.approx(along(bright_entry(0.9)), abs=1e-5)  # light: to 1e-6


@needs_mitsuba
def test_light_that_enters_a_clear_end_is_followed_to_the_membrane():
    camera = SCENE["camera"] | {"position": [-40, 6], "direction_deg": 0}
    pad = PAD | {"layers": [{"thickness": 5, "index": 1.49, "sides": {"from": "clear"}}]}
    found = judge({"camera": camera, "pads": [pad]}, {})
    [view] = [one for one in found.views if one.entrance != "top"]
    # The line of sight to the upper edge of the end, 20 mm away and 1 mm lower, and what follows.
    down = 1 / math.hypot(1, 20)
    met = 5 / (down / math.sqrt(1.49**2 - down**2))
    assert met > 45
    assert view.along[0] == pytest.approx(1, abs=1e-6)
    assert view.along[1] == pytest.approx(0, abs=1e-5)
    assert view.entrance == "end 'from' of layer 1 of pad pad"


@needs_mitsuba
def test_a_pad_that_is_written_from_its_other_end_looks_the_same():
    layer = {"thickness": 3, "index": 1.49, "sides": {"to": "clear"}}
    layer |= {"overhang": [0, 1], "bevel_deg": [5, -10]}
    back = layer | {"sides": {"from": "clear"}, "overhang": [1, 0], "bevel_deg": [-10, 5]}
    one = scene_with(layers=[layer], bezel={"lip": [1, 0.5], "height": 0.5})
    turned = {"from": PAD["to"], "to": PAD["from"], "side": "right", "layers": [back]}
    other = scene_with(**turned, bezel={"lip": [0.5, 1], "height": 0.5})
    first, second = judge(one, {}), judge(other, {})
    assert len(first.views) >= 3
    for view, same in zip(first.views, second.views, strict=True):
        assert view.rows == pytest.approx(same.rows, abs=FINE_PX)
        assert view.along == pytest.approx([1 - x for x in same.along], abs=FINE_MM)
        assert view.path == same.path
    assert any("end 'to'" in view.entrance for view in first.views)
    assert first.coverage == pytest.approx(second.coverage, abs=FINE_MM)


@needs_mitsuba
def test_frames_are_judged_once_and_shown(tmp_path):
    first = judge_once(SCENE, {}, tmp_path)
    assert judge_once(SCENE, {}, tmp_path) == first
    [kept] = tmp_path.iterdir()
    kept.write_text(kept.read_text(encoding="utf-8")[:-9], encoding="utf-8")
    assert judge_once(SCENE, {}, tmp_path).views == first.views
    light = picture(SCENE, {}, 20.0)
    assert light.shape == (35, 47)
    assert set(np.unique(light)) == {0.0, 1.0}


def test_coverage_is_the_measure_of_a_union():
    assert union([(0.5, 0.2), (0.4, 0.6), (0.9, 0.8)]) == pytest.approx(0.5)
    assert union([]) == 0


def test_views_are_matched_with_the_nearest_of_the_same_path():
    def view(low, high, path=""):
        return View("pad", path, "", [low, high], [0, 1], ["", ""])

    judged = [view(0, 10), view(20, 30), view(50, 60, "wall")]
    predicted = [view(19, 31), view(1, 9), view(50, 60), view(70, 70.1)]
    pairs = list(study.match_views(judged, predicted))
    both = [(judged[0], predicted[1]), (judged[1], predicted[0])]
    assert pairs == [*both, (judged[2], None), (None, predicted[2])]


def test_without_mitsuba_one_line_says_what_to_install(monkeypatch):
    def missing():
        raise ModuleNotFoundError("No module named 'mitsuba'")

    monkeypatch.setattr(path_tracer, "load_mitsuba", missing)
    context = Context(0, "float64", lambda _: nullcontext())
    with pytest.raises(UserError, match=r"pip install 'designopt\[judge\]'"):
        study.run(PhysicalCheckSpec(), context)


@needs_mitsuba
def test_a_quick_run_finds_the_library_right(tmp_path):
    done = quick_run("physical-check", tmp_path, f"cache={tmp_path / 'judged'}")
    assert done.measured["frames"] == 2
    assert done.measured["corner_worst_px"] <= 0.01
    assert done.measured["view_end_worst_px"] <= 0.01
    assert done.measured["coverage_worst"] <= 1e-5
    assert done.measured["views_unmatched"] == 0
    assert {row[0] for row in done.rows("corners")} == {"none"}
