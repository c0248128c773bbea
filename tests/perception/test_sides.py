"""Edges of drawn pads, where they were drawn."""

import dataclasses
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from perception.lens import Lens, TangentPlane
from perception.lines import fit_lines
from perception.masks import lamp_mask
from perception.sides import (
    BRIGHTER,
    DEEP,
    SEAM,
    SHARES,
    Sides,
    _brighter,
    find_edges,
)
from tests.perception.drawn import BRIGHT, DARK, Eye, Pad, defocused, drawn, rays_of, stored

EYE = Eye()
LENS = EYE.lens()
PAD = Pad((20, -14), (22, 12))


def sides_of(pad: Pad, moved: float = 0.0, adjoining: int | None = None) -> Sides:
    """The true sides of one view, all moved outward in the tangent plane."""
    rays = rays_of(pad.corners())
    plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
    beside = np.arange(4)[None] == (-1 if adjoining is None else adjoining)
    sides = Sides.between(np.array([plane.angle]), plane.flat(rays)[None], beside)
    return shifted(sides, moved * sides.outward)


def shifted(sides: Sides, by: np.ndarray | float) -> Sides:
    return dataclasses.replace(sides, start=sides.start + by, end=sides.end + by)


def edges_of(
    gray: np.ndarray, sides: Sides, lamps: np.ndarray | None = None, lens: Lens = LENS
) -> SimpleNamespace:
    """The `Edges` of one view alone."""
    edges = find_edges(gray, lens, sides, lamps)
    return SimpleNamespace(**{name: every[0] for name, every in vars(edges).items()})


@pytest.mark.parametrize("pixels", [-4.0, 0.0, 5.0])
def test_edges_are_found_where_the_pad_ends(pixels):
    light = cv2.GaussianBlur(drawn(EYE, [PAD]), (0, 0), 0.7)
    sides = sides_of(PAD, pixels / EYE.focal)
    edges = edges_of(stored(light).astype(np.float32), sides)
    assert edges.found.all()
    # With the edge well inside, few samples show how bright the pad is.
    np.testing.assert_allclose(edges.contrast, BRIGHT - DARK, rtol=0.02)
    assert edges.doubt.tolist() == [0, 0, 0, 0]
    off = (edges.offsets + pixels / EYE.focal) * edges.scale
    # The lattice of pixels shows in single places.
    np.testing.assert_allclose(off, 0, atol=0.3)
    np.testing.assert_allclose(off.mean(axis=1), 0, atol=0.1)
    plane, moved = TangentPlane(float(sides.angle[0])), shifted(sides, 1e-3 * sides.outward)
    at, out = (LENS.project(plane.rays(one.places(SHARES))) for one in (sides, moved))
    scale = np.hypot(*(out - at).T) / 1e-3
    np.testing.assert_allclose(edges.scale.ravel(), scale, rtol=0.01)
    dark = edges_of(np.full((360, 480), BRIGHT, np.float32), sides)
    assert not dark.found.any()
    assert dark.contrast.tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize("beside", [0.2, 0.5])
def test_an_edge_that_does_not_fall_to_the_dark_is_doubted(beside):
    # Another pad goes on beyond the upper end.
    other = Pad(PAD.second, tuple(np.add(PAD.second, 8 * PAD.step)))
    level = DARK + beside * (BRIGHT - DARK)
    looks = [lambda places, level=level: np.full(len(places), level) for level in (BRIGHT, level)]
    sides = sides_of(PAD)
    gray = stored(drawn(EYE, [PAD, other], looks)).astype(np.float32)
    edges = edges_of(gray, sides)
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
    sides = sides_of(PAD)
    light = drawn(EYE, [PAD])
    gray = stored(spread(light, size) if size else light).astype(np.float32)
    edges = edges_of(gray, sides)
    # Pixels, values between them and the mean of three samples spread it by about one pixel.
    np.testing.assert_allclose(edges.width, np.hypot(quarters * size, 1.0), rtol=0.1)


def test_edges_of_other_sides_are_near_at_a_thin_view_s_ends():
    thin = Pad((12, -20), (40, -62))
    sides = sides_of(thin)
    sharp, blurred = (
        edges_of(defocused(drawn(EYE, [thin]), r).astype(np.float32), sides) for r in (1.0, 3.0)
    )
    assert (blurred.clear < sharp.clear).any()
    assert not (blurred.found & ~sharp.found).any()


@pytest.mark.parametrize("blur", [0.8, 2.0])
def test_a_known_response_gives_edges_back(blur):
    light = cv2.GaussianBlur(drawn(EYE, [PAD]), (0, 0), blur)
    sides = sides_of(PAD)
    codes = np.rint(255 * (light / 255) ** (1 / 2.2)).astype(np.uint8)
    lens = dataclasses.replace(LENS, response=255 * (np.arange(256) / 255) ** 2.2)
    coded = edges_of(codes.astype(np.float32), sides)
    known = edges_of(lens.light(codes), sides, lens=lens)
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
    sides = sides_of(PAD)
    light = drawn(EYE, [PAD])
    middle = sides.places(np.array([0.5]))[[2]]
    edge = LENS.project(TangentPlane(float(sides.angle[0])).rays(middle))[0, 0]
    columns = np.arange(EYE.columns)
    # The right side is nearly upright.
    lamp = (columns > edge + gap + 2) & (columns < edge + gap + 14)
    light[np.ix_((np.arange(EYE.rows) > 90) & (np.arange(EYE.rows) < 260), lamp)] = 1000
    codes = stored(cv2.GaussianBlur(light, (0, 0), 0.8))
    lamps = lamp_mask(codes, codes)
    assert lamps.any()
    edges = edges_of(codes.astype(np.float32), sides, lamps)
    lines = fit_lines(find_edges(codes.astype(np.float32), LENS, sides, lamps))
    off = lines.at(0.5)[0, 2] * edges.scale[2].mean()
    deviation = np.sqrt(lines.variances(0.5)[0, 2, 0]) * edges.scale[2].mean()
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
    own = sides_of(PAD, adjoining=1), shifted(sides_of(PAD), 0.9), sides_of(PAD, 4 / EYE.focal)
    names = [one.name for one in dataclasses.fields(Sides)]
    every = Sides(*(np.concatenate([getattr(one, name) for one in own]) for name in names))
    together = find_edges(gray, LENS, every, lamps)
    lines = fit_lines(together)
    assert np.any(together.found[[0, 2]], axis=(1, 2)).all()
    for i, one in enumerate(own):
        alone = find_edges(gray, LENS, one, lamps)
        for all_views, view in [(together, alone), (lines, fit_lines(alone))]:
            for field in dataclasses.fields(view):
                whole, part = (getattr(result, field.name) for result in (all_views, view))
                np.testing.assert_allclose(whole[i], part[0], rtol=1e-12, atol=0)


def test_an_edge_wider_than_the_others_is_a_gradient_and_doubted():
    def look(places):
        # Towards the second end light falls to a fifth, from 5 mm before it on.
        return BRIGHT * np.clip((PAD.length - places[:, 0]) / 5, 0.2, 1.0)

    sides = sides_of(PAD)
    gray = stored(cv2.GaussianBlur(drawn(EYE, [PAD], [look]), (0, 0), 0.8)).astype(np.float32)
    edges = edges_of(gray, sides)
    off = np.abs((edges.offsets * edges.scale).mean(axis=1))
    assert off[1] > 1
    assert off[1] < 3 * edges.doubt[1]
    assert edges.doubt[3] == 0


def test_what_the_brighter_samples_exceed_is_a_quantile():
    inner = np.random.default_rng(4).uniform(0, 255, (50, 17)).astype(np.float32)
    np.testing.assert_array_equal(_brighter(inner), np.quantile(inner, BRIGHTER, axis=1))
