"""Edges of drawn pads, and lines through edges against least squares and repeats."""

import dataclasses

import cv2
import numpy as np
import pytest
import scipy.ndimage

from perception.lens import TangentPlane
from perception.masks import lamp_mask
from perception.sides import (
    BRIGHTER,
    DEEP,
    POINTS,
    SEAM,
    TRIMMED,
    Edges,
    Line,
    Outline,
    Side,
    _brighter,
    _Medians,
    find_all_edges,
    find_edges,
    fit_all_lines,
    fit_lines,
)
from tests.perception.drawn import BRIGHT, DARK, Eye, Pad, defocused, drawn, rays_of, stored

EYE = Eye()
LENS = EYE.lens()
PAD = Pad((20, -14), (22, 12))
SHARES = np.linspace(TRIMMED, 1 - TRIMMED, POINTS)
SCALE = 150.0
"""Pixels per unit of the tangent plane."""

ROUGH = 0.01 * np.fromstring(
    "-66 -71 -87 -79 -72 -60 -40 -28 -20 10 23 27 34 44 44 46 42 39 31 28 24 21 20 20 30 25 24 16 "
    "14 7 7 5 -6 0 -1 9 12 13 14 10 2 -9 -18 -30 -50 -61 -69 -73",
    sep=" ",
)
"""A rough side as it was rendered, px: its ends lie apart from its middle."""


def lines_of(
    offsets: np.ndarray, found: np.ndarray | bool = True, doubt: float = 0.0
) -> list[Line]:
    """Of sides by offsets in pixels; beside them one that is straight, which must not matter."""
    rows = np.vstack([offsets / SCALE, 3 * SHARES])
    there, ones = np.broadcast_to(found, rows.shape).copy(), np.ones(len(rows))
    there[-1] = True
    doubts = doubt * (np.arange(len(rows)) < len(rows) - 1)
    scale = np.full(rows.shape, SCALE)
    lit = np.zeros(len(rows), bool)
    edges = Edges(SHARES, rows, scale, there, 100 * ones, ones, ones, doubts, lit)
    *lines, beside = fit_lines(edges)
    assert beside.turn == pytest.approx(3)
    return lines


def line_of(offsets: np.ndarray, found: np.ndarray | bool = True, doubt: float = 0.0) -> Line:
    return lines_of(offsets, found, doubt)[0]


def sides_of(pad: Pad, moved: float = 0.0) -> tuple[TangentPlane, list[Side]]:
    """The true sides, all moved outward in the tangent plane."""
    rays = rays_of(pad.corners())
    plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
    corners = plane.flat(rays)
    sides = [Side(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    return plane, [
        Side(side.start + moved * side.outward, side.end + moved * side.outward) for side in sides
    ]


@pytest.mark.parametrize("pixels", [-4.0, 0.0, 5.0])
def test_edges_are_found_where_the_pad_ends(pixels):
    light = cv2.GaussianBlur(drawn(EYE, [PAD]), (0, 0), 0.7)
    plane, sides = sides_of(PAD, pixels / EYE.focal)
    edges = find_edges(stored(light).astype(np.float32), LENS, plane, sides)
    assert edges.found.all()
    # With the edge well inside, few samples show how bright the pad is.
    np.testing.assert_allclose(edges.contrast, BRIGHT - DARK, rtol=0.02)
    assert edges.doubt.tolist() == [0, 0, 0, 0]
    off = (edges.offsets + pixels / EYE.focal) * edges.scale
    # The lattice of pixels shows in single places.
    np.testing.assert_allclose(off, 0, atol=0.3)
    np.testing.assert_allclose(off.mean(axis=1), 0, atol=0.1)
    for side, scale in zip(sides, edges.scale, strict=True):
        places = side.places(edges.shares)
        at, out = (LENS.project(plane.rays(p)) for p in (places, places + 1e-3 * side.outward))
        np.testing.assert_allclose(scale, np.hypot(*(out - at).T) / 1e-3, rtol=0.01)
    dark = find_edges(np.full((360, 480), BRIGHT, np.float32), LENS, plane, sides)
    assert not dark.found.any()
    assert dark.contrast.tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize("beside", [0.2, 0.5])
def test_an_edge_that_does_not_fall_to_the_dark_is_doubted(beside):
    # Another pad goes on beyond the upper end.
    other = Pad(PAD.second, tuple(np.add(PAD.second, 8 * PAD.step)))
    level = DARK + beside * (BRIGHT - DARK)
    looks = [lambda places, level=level: np.full(len(places), level) for level in (BRIGHT, level)]
    plane, sides = sides_of(PAD)
    gray = stored(drawn(EYE, [PAD, other], looks)).astype(np.float32)
    edges = find_edges(gray, LENS, plane, sides)
    assert edges.doubt[1] == pytest.approx(SEAM * (DEEP - (1 - beside)), abs=0.1)
    assert edges.contrast[1] == pytest.approx((1 - beside) * (BRIGHT - DARK), abs=1)
    assert edges.doubt[[0, 2, 3]].tolist() == [0, 0, 0]


@pytest.mark.parametrize("size", [0.0, 1.5, 3.0])
@pytest.mark.parametrize(
    ("spread", "quarters"),
    [(lambda light, size: cv2.GaussianBlur(light, (0, 0), size), 1.349), (defocused, 0.808)],
    ids=["normal", "disc"],
)
def test_an_edge_is_as_wide_as_the_spread_of_its_light(spread, quarters, size):
    plane, sides = sides_of(PAD)
    light = drawn(EYE, [PAD])
    gray = stored(spread(light, size) if size else light).astype(np.float32)
    edges = find_edges(gray, LENS, plane, sides)
    # Pixels, values between them and the mean of three samples spread it by about one pixel.
    np.testing.assert_allclose(edges.width, np.hypot(quarters * size, 1.0), rtol=0.1)


def test_edges_of_other_sides_are_near_at_a_thin_view_s_ends():
    thin = Pad((12, -20), (40, -62))
    plane, sides = sides_of(thin)
    sharp, blurred = (
        find_edges(defocused(drawn(EYE, [thin]), r).astype(np.float32), LENS, plane, sides)
        for r in (1.0, 3.0)
    )
    assert (blurred.clear < sharp.clear).any()
    assert not (blurred.found & ~sharp.found).any()


def test_a_line_through_good_edges_is_that_of_least_squares():
    offsets = 0.7 - 1.3 * SHARES + np.random.default_rng(0).normal(0, 0.1, POINTS)
    line = line_of(offsets)
    slope, constant = np.polyfit(SHARES, offsets, 1)
    # Tukey's weights of normal residuals take a line away from the mean by a part of its error.
    assert line.offset * SCALE == pytest.approx(constant, abs=0.02)
    assert line.turn * SCALE == pytest.approx(slope, abs=0.04)
    assert line.scatter == pytest.approx(0.1, rel=0.3)
    assert line.at(0.5) == pytest.approx(line.offset + line.turn / 2)


@pytest.mark.parametrize(("alike", "within"), [(False, 0.3), (True, 0.5)])
def test_the_variance_of_a_line_is_the_scatter_of_repeats(alike, within):
    rough = np.random.default_rng(1).normal(0, 0.3, (400, POINTS + 4))
    if alike:
        # How alike neighbours err is estimated from these few; ignored, it would be a fifth.
        rough = scipy.ndimage.uniform_filter1d(rough, 5, axis=1)
    lines = lines_of(rough[:, 2:-2])
    for share in (0.0, 0.5, 1.0):
        scatter = np.var([line.at(share) for line in lines])
        expected = np.mean([line.variances(share)[0] for line in lines])
        # 400 draws know a variance to 7 % (1 σ); weights make it a little larger than stated.
        assert expected / scatter == pytest.approx(1, abs=within)


@pytest.mark.parametrize(("rough", "noise"), [(0.3, 0.1), (0.3, 0.3), (0.0, 0.3)])
def test_roughness_is_what_all_frames_of_a_side_have_alike(rough, noise):
    """The rest of a line's variance is about what scatters from frame to frame, or is larger."""
    generator = np.random.default_rng(2)
    white = np.sqrt(5) * rough * generator.standard_normal((400, POINTS + 4))
    shapes = scipy.ndimage.uniform_filter1d(white, 5, axis=1)[:, 2:-2]
    frames = [lines_of(shapes + noise * generator.standard_normal(shapes.shape)) for _ in range(2)]
    for share in (0.0, 0.5, 1.0):
        first, second = ([line.at(share) for line in lines] for lines in frames)
        stated = np.mean([line.variances(share) for lines in frames for line in lines], axis=0)
        by_frame = (stated[0] - stated[1]) / (np.var(np.subtract(first, second)) / 2)
        # What a rough edge has that neighbours do not share counts as noise: a fifth of it here.
        assert 0.75 < by_frame < (1.4 if noise >= rough else 3)
        if rough:
            # Noise hides how far roughness reaches, so that of equal parts only half is found.
            assert 0.4 < stated[1] / np.cov(first, second)[0, 1] < 1.3
        else:
            assert stated[1] < stated[0] / 3


def test_outliers_on_a_third_of_a_side_and_places_without_an_edge_do_not_move_its_line():
    offsets = 0.2 + 0.5 * SHARES + np.random.default_rng(3).normal(0, 0.1, POINTS)
    spoilt = offsets.copy()
    spoilt[20:36] -= 4
    there = np.arange(POINTS) % 3 > 0
    lines = line_of(spoilt), line_of(np.where(there, offsets, 50.0), there)
    for line in lines:
        for share in (0, 1):
            clean = line_of(offsets).at(share)
            assert line.at(share) * SCALE == pytest.approx(clean * SCALE, abs=0.1)


@pytest.mark.parametrize(("shift", "turn"), [(0.65, -0.9), (-0.7, 1.5), (1.0, 1.0)])
def test_the_line_does_not_depend_on_where_the_side_was_expected(shift, turn):
    expected = shift + turn * SHARES
    line, moved = line_of(ROUGH), line_of(ROUGH - expected)
    for share in (0, 1):
        found = moved.at(share) * SCALE + shift + turn * share
        assert found == pytest.approx(line.at(share) * SCALE, abs=0.05)


def test_doubt_is_added_to_the_variance_and_a_side_hardly_found_may_be_anywhere():
    offsets = np.random.default_rng(4).normal(0, 0.1, POINTS)
    sure, doubted = line_of(offsets), line_of(offsets, doubt=3.0)
    added = (doubted.variances(0.3)[0] - sure.variances(0.3)[0]) * SCALE**2
    assert added == pytest.approx(3.0**2)
    line = line_of(np.zeros(POINTS), np.arange(POINTS) < POINTS // 4 - 1)
    assert (line.offset, line.turn, line.scatter) == (0, 0, np.inf)
    assert np.sqrt(line.variances(0.5)[0]) * SCALE > 100


@pytest.mark.parametrize("blur", [0.8, 2.0])
def test_a_known_response_gives_edges_back(blur):
    light = cv2.GaussianBlur(drawn(EYE, [PAD]), (0, 0), blur)
    plane, sides = sides_of(PAD)
    codes = np.rint(255 * (light / 255) ** (1 / 2.2)).astype(np.uint8)
    lens = dataclasses.replace(LENS, response=255 * (np.arange(256) / 255) ** 2.2)
    coded = find_edges(codes.astype(np.float32), LENS, plane, sides)
    known = find_edges(lens.light(codes), lens, plane, sides)
    off, outward = ((e.offsets * e.scale).mean(axis=1) for e in (known, coded))
    np.testing.assert_allclose(off, 0, atol=0.1)
    # Half of the coded step is less than a quarter of the light's.
    assert (outward > 0.35 * blur).all()
    # Of a code's step, not of the light's.
    dark, bright = ((level / 255) ** (1 / 2.2) * 255 for level in (DARK, BRIGHT))
    np.testing.assert_allclose(known.contrast, bright - dark, rtol=0.03)


@pytest.mark.parametrize(("gap", "within"), [(0.0, 3.0), (2.5, 3.0), (8.0, 0.4)])
def test_beside_a_lamp_an_edge_is_where_the_pad_ends_or_is_doubted(gap, within):
    """Gaps in px; the lamp is four times as bright as what is clipped."""
    plane, sides = sides_of(PAD)
    light = drawn(EYE, [PAD])
    edge = LENS.project(plane.rays(sides[2].places(np.array([0.5]))))[0, 0]
    columns = np.arange(EYE.columns)
    # The right side is nearly upright.
    lamp = (columns > edge + gap + 2) & (columns < edge + gap + 14)
    light[np.ix_((np.arange(EYE.rows) > 90) & (np.arange(EYE.rows) < 260), lamp)] = 1000
    codes = stored(cv2.GaussianBlur(light, (0, 0), 0.8))
    lamps = lamp_mask(codes, codes)
    assert lamps.any()
    edges = find_edges(codes.astype(np.float32), LENS, plane, sides, lamps)
    line = fit_lines(edges)[2]
    off = line.at(0.5) * edges.scale[2].mean()
    deviation = np.sqrt(line.variances(0.5)[0]) * edges.scale[2].mean()
    assert abs(off) < within
    assert abs(off) < 3 * np.hypot(deviation, 0.1)
    assert edges.doubt[[0, 1, 3]].tolist() == [0, 0, 0]
    assert edges.lit.tolist() == [False, False, gap < 8, False]


@pytest.mark.parametrize("lamp", [False, True])
def test_views_together_have_the_edges_and_lines_of_each_by_itself(lamp):
    """One beside a lamp or beside another view, one that is dark, and one that is well off."""
    light = cv2.GaussianBlur(drawn(EYE, [PAD]), (0, 0), 0.8)
    light[100:250, 330:345] += 1000 * lamp
    codes = stored(light)
    gray, lamps = codes.astype(np.float32), lamp_mask(codes, codes)
    assert lamps.any() == lamp
    plane, sides = sides_of(PAD)
    dark = [Side(side.start + 0.9, side.end + 0.9) for side in sides]
    outlines = [
        Outline(plane, sides, 1),
        Outline(plane, dark),
        Outline(*sides_of(PAD, 4 / EYE.focal)),
    ]
    together = find_all_edges(gray, LENS, outlines, lamps)
    lines = fit_all_lines(together)
    assert together[0].found.any()
    assert together[2].found.any()
    for (one, own, beside), edges, of_view in zip(outlines, together, lines, strict=True):
        alone = find_edges(gray, LENS, one, own, lamps, beside)
        np.testing.assert_equal(dataclasses.asdict(edges), dataclasses.asdict(alone))
        np.testing.assert_equal(
            [dataclasses.asdict(line) for line in of_view],
            [dataclasses.asdict(line) for line in fit_lines(alone)],
        )


def test_an_edge_wider_than_the_others_is_a_gradient_and_doubted():
    def look(places):
        # Towards the second end light falls to a fifth, from 5 mm before it on.
        return BRIGHT * np.clip((PAD.length - places[:, 0]) / 5, 0.2, 1.0)

    plane, sides = sides_of(PAD)
    gray = stored(cv2.GaussianBlur(drawn(EYE, [PAD], [look]), (0, 0), 0.8)).astype(np.float32)
    edges = find_edges(gray, LENS, plane, sides)
    off = np.abs((edges.offsets * edges.scale).mean(axis=1))
    assert off[1] > 1
    assert off[1] < 3 * edges.doubt[1]
    assert edges.doubt[3] == 0


@pytest.mark.parametrize("bulge", [0.0, 1.0, 3.0])
def test_a_line_whose_end_is_bent_is_unsure_there(bulge):
    offsets = np.random.default_rng(5).normal(0, 0.1, POINTS)
    offsets[-POINTS // 5 :] += bulge
    line = line_of(offsets)
    start, end = (np.sqrt(line.variances(share)[0]) * SCALE for share in (0.0, 1.0))
    assert start < 0.15
    if bulge:
        assert end == pytest.approx(bulge, rel=0.3)
        assert abs(line.at(1.0) * SCALE - bulge) < 2 * end
    else:
        assert end < 0.15


@pytest.mark.parametrize("shape", [(6, 9), (4, 5, 8)])
def test_medians_are_those_of_the_values_that_are_there(shape):
    generator = np.random.default_rng(3)
    values = generator.standard_normal(shape)
    there = generator.random(shape) < np.linspace(0, 1, shape[-2])[:, None]
    there[..., 1, :] = np.arange(shape[-1]) == 2
    expected = [
        np.median(one[own]) if own.any() else 0.0
        for one, own in zip(
            values.reshape(-1, shape[-1]), there.reshape(-1, shape[-1]), strict=True
        )
    ]
    np.testing.assert_array_equal(_Medians(there).of(values).ravel(), expected)


def test_what_the_brighter_samples_exceed_is_a_quantile():
    inner = np.random.default_rng(4).uniform(0, 255, (50, 17)).astype(np.float32)
    np.testing.assert_array_equal(_brighter(inner), np.quantile(inner, BRIGHTER, axis=1))
