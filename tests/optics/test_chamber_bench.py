"""The chamber's bench: what it shows against Eq. 1 written out, its failures, its improvement."""

import dataclasses
import math
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from optics.explore.chamber_bench import FIELDS, ChamberBench
from optics.explore.chamber_improving import narrowest

from designopt import UserError
from optics import ChamberResult
from optics.chamber.designed import DesignedChamber
from optics.chamber.file import read_chamber
from tests.helpers import figure_of, readings
from tests.optics.chambers import PAPER

ROUNDING = 1e-12

LENGTHS = ("a, red length", "b, blue length", "c, yellow length", "h, reference height")


def bench_of(chamber=PAPER):
    """A bench with axes to show in, and where its knobs stand."""
    bench = ChamberBench(DesignedChamber("soft", chamber))
    figure_of(bench)
    return bench, {knob.name: knob.value for knob in bench.knobs}


def eq_1(values):
    """Δl_C, Δl_D, θ_CD and image heights, by Eqs. 1-3 as printed, with plain numbers."""
    a, b, c, h = (values[name] for name in LENGTHS)
    depths = [s + values["δ, pinhole offset"] for s in (a, a + b, a + b + c)]
    over = values["f, focal length"] - values["v, image distance"]
    offset_c = values["Δl_B, offset of B"] - b * math.tan(math.radians(values["θ_BC, blue wall"]))
    image_b = over * (h + values["Δl_B, offset of B"]) / depths[0]
    image_c = over * (h + offset_c) / depths[1]
    image_d = image_c - values["η, imaging ratio"] * (image_b - image_c)
    offset_d = h - image_d * depths[2] / over
    angle = math.degrees(math.atan2(offset_c + offset_d, c))
    return offset_c, offset_d, angle, (image_b, image_c, image_d)


MOVES = [
    {},
    {"η, imaging ratio": 0.9},
    {"θ_BC, blue wall": -3.0, "Δl_B, offset of B": 3.0},
    {"a, red length": 55.0, "b, blue length": 20.0, "c, yellow length": 45.0},
    {"f, focal length": 3.8, "v, image distance": 2.0},
    {"h, reference height": 7.0, "δ, pinhole offset": 3.0, "Δl_A, offset of A": 7.0},
]


@pytest.fixture(scope="module")
def paper():
    return bench_of()


@pytest.mark.parametrize("moves", MOVES)
def test_readings_and_picture_are_those_of_eq_1(paper, moves):
    bench, values = paper
    values = values | moves
    shown = bench.show(values)
    offset_c, offset_d, angle, images = eq_1(values)
    found = readings(shown)
    expected = {
        "η, imaging ratio": values["η, imaging ratio"],
        "Δl_D, offset of D": offset_d,
        "θ_CD, yellow wall": angle,
        "Δl_C, offset of C": offset_c,
        "Δd_b, blue ring": images[0] - images[1],
        "Δd_c, yellow ring": images[1] - images[2],
        "Δd_d, top": images[2],
        "T_B, image height": images[0],
        "T_C, image height": images[1],
        "T_D, image height": images[2],
        "room of D inside Δl_A": values["Δl_A, offset of A"] - abs(offset_d),
    }
    assert list(found) == [*expected, "margin"]
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name
    section, line, sensor = shown.artists[0].axes.figure.axes
    s_b, s_c = values["a, red length"], values["a, red length"] + values["b, blue length"]
    s_d = s_c + values["c, yellow length"]
    corners = [
        (0.0, values["Δl_A, offset of A"]),
        (s_b, values["Δl_B, offset of B"]),
        (s_c, offset_c),
        (s_d, -offset_d),
        (s_d, -values["h, reference height"]),
    ]
    walls = [one.get_xydata() for one in section.lines if one.get_linewidth() > 3]
    np.testing.assert_allclose(walls, [*pairwise(corners)], atol=1e-9)
    radii = [patch.radius for patch in sensor.patches if hasattr(patch, "radius")]
    np.testing.assert_allclose(radii, images, rtol=1e-9)
    (mark,) = [one for one in line.lines if one.get_marker() == "o"]
    np.testing.assert_allclose(
        mark.get_xydata(), [[values["η, imaging ratio"], offset_d]], rtol=1e-9
    )
    for x, y in (*corners, (-values["δ, pinhole offset"], -values["h, reference height"])):
        assert section.get_xlim()[0] <= x <= section.get_xlim()[1]
        assert section.get_ylim()[0] <= y <= section.get_ylim()[1]
    assert sensor.get_xlim()[1] > images[0]


def test_knobs_begin_at_the_design():
    bench, values = bench_of()
    assert bench.title == "soft"
    assert len(values) == len(bench.knobs)
    assert all(knob.low < knob.value < knob.high for knob in bench.knobs)
    assert {knob.kind for knob in bench.knobs} == {"dimension"}
    assert values["η, imaging ratio"] == pytest.approx(
        float(PAPER.imaging_ratio().value), rel=ROUNDING
    )
    assert values["θ_BC, blue wall"] == pytest.approx(2.0, rel=ROUNDING)
    assert readings(bench.show(values))["Δl_D, offset of D"] == pytest.approx(2.55, rel=ROUNDING)


@pytest.mark.parametrize(
    ("moves", "result", "margin"),
    [
        ({"θ_BC, blue wall": -15.0}, ChamberResult.blue_edge_on, None),
        ({"δ, pinhole offset": -41.0}, ChamberResult.behind_pinhole, -1.0),
        ({"b, blue length": -1.0}, ChamberResult.no_length, -1.0),
    ],
)
def test_a_failure_is_told_and_nothing_is_saved(moves, result, margin):
    bench, values = bench_of()
    names = list(readings(bench.show(values)))
    shown = bench.show(values | moves)
    assert shown.message == ChamberResult[result]
    found = readings(shown)
    assert list(found) == names
    assert {name for name, value in found.items() if value is not None} == {"margin"}
    if margin is None:
        # The pinhole's distance from the line of the blue wall.
        angle = math.radians(moves["θ_BC, blue wall"])
        above = (values["h, reference height"] + values["Δl_B, offset of B"]) * math.cos(angle)
        margin = above + (values["a, red length"] + values["δ, pinhole offset"]) * math.sin(angle)
    assert found["margin"] == pytest.approx(margin, rel=1e-9)
    with pytest.raises(UserError, match="no chamber to write: "):
        bench.specs(values | moves)
    with pytest.raises(UserError, match="nothing to improve: "):
        next(bench.optimise(values | moves))


def test_a_wall_that_leaves_the_chamber_is_told(paper):
    bench, values = paper
    assert bench.show(values).message == ""
    outside = bench.show(values | {"η, imaging ratio": 0.9})
    room = readings(outside)["room of D inside Δl_A"]
    assert room < 0
    assert f"D lies outside the wall at the lens, by {-room:.3g} mm" in outside.message
    assert "the top has no ring" in bench.show(values | {"η, imaging ratio": 1.15}).message


def test_the_file_is_the_chamber_as_it_stands(paper, tmp_path):
    bench, values = paper
    values = values | {
        "η, imaging ratio": 0.71,
        "θ_BC, blue wall": -1.25,
        "Δl_B, offset of B": 2.5,
        "c, yellow length": 33.0,
        "δ, pinhole offset": 1.5,
        "f, focal length": 4.2,
    }
    (file,) = bench.specs(values)
    path = tmp_path / file.name
    path.write_text(str(file.content), encoding="utf-8")
    name, chamber = read_chamber(path)
    assert name == "soft"
    for knob, field in FIELDS.items():
        assert float(getattr(chamber, field)) == pytest.approx(values[knob], rel=ROUNDING)
    assert math.degrees(float(chamber.wall_angle_bc)) == pytest.approx(-1.25, rel=ROUNDING)
    assert float(chamber.offset_d) == pytest.approx(eq_1(values)[1], rel=1e-9)
    again = ChamberBench(DesignedChamber.read(path))
    for knob in again.knobs:
        assert knob.value == pytest.approx(values[knob.name], rel=ROUNDING)


def test_the_narrowest_ring_becomes_the_widest_there_is(paper):
    """Against all walls on a grid, by Eq. 1 written out."""
    bench, values = paper
    steps = list(bench.optimise(values | {"η, imaging ratio": 0.5}))
    knobs = {knob.name: knob for knob in bench.knobs}
    for step in steps:
        assert set(step.values) == set(knobs)
        for name, value in step.values.items():
            assert knobs[name].low - 1e-12 <= value <= knobs[name].high + 1e-12
            if name not in ("η, imaging ratio", "θ_BC, blue wall", "Δl_B, offset of B"):
                assert value == values[name]
    shown = readings(bench.show(steps[-1].values))
    rings = [shown[name] for name in ("Δd_b, blue ring", "Δd_c, yellow ring", "Δd_d, top")]
    assert f"{min(rings):.4g} mm" in steps[-1].message
    assert "not converged" not in steps[-1].message

    reach = np.linspace(-4.1, 4.1, 83)
    b, c, d = np.meshgrid(reach, reach, reach, indexing="ij")
    images = [
        0.5 * (8.616 + height) / (s + 0.844) for height, s in ((b, 40.0), (c, 70.0), (-d, 100.0))
    ]
    widths = np.min([images[0] - images[1], images[1] - images[2], images[2]], axis=0)
    assert min(rings) >= np.max(widths) * (1 - 1e-6)
    # Δl_C at Δl_A, and the top as wide as the yellow ring.
    assert min(rings) == pytest.approx(0.5 * (8.616 + 4.1) / 70.844 / 2, rel=1e-5)
    offsets = [shown["Δl_C, offset of C"], shown["Δl_D, offset of D"]]
    offsets.append(steps[-1].values["Δl_B, offset of B"])
    assert np.max(np.abs(offsets)) <= 4.1 * (1 + 1e-5)
    with pytest.raises(UserError, match="at f = v no ring has a width"):
        next(bench.optimise(values | {"v, image distance": values["f, focal length"]}))


def test_the_narrowest_ring_does_not_depend_on_which_way_up_the_image_is():
    turned = dataclasses.replace(PAPER, image_distance=jnp.asarray(4.5))
    assert float(narrowest(PAPER)) == pytest.approx(float(jnp.min(PAPER.ring_widths().value)))
    assert float(narrowest(turned)) == pytest.approx(float(narrowest(PAPER)), rel=ROUNDING)


def test_showing_compiles_once(paper, monkeypatch):
    bench, values = paper
    bench.show(values)

    def traced_again(*arguments):
        raise AssertionError("it was traced again")

    monkeypatch.setattr("optics.explore.chamber_bench.solve_dimension_for_ratio", traced_again)
    for moves in MOVES:
        bench.show(values | moves)
