"""Quadrilaterals told apart, on a finger that is written out by hand."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.lengths import measured_grazing
from perception.matching import match_views
from perception.quads import Quad
from perception.quality import Quality
from tests.perception.hand_finger import (
    ANGLES,
    LENGTHS,
    LENS,
    REFLECTIONS,
    SIZES,
    VIEWS,
    WIDTH,
    catalog,
    corners_of,
    names,
    quad_of,
    quads_of,
    shown,
)

KNOWN = catalog()
STEP = float(ANGLES[1] - ANGLES[0])
BOTH = np.array([0.7, 0.75])
"""A pose in which every pad is seen in every way."""

poses = st.tuples(st.floats(0.0, 1.5), st.floats(0.0, 1.5))


def corners_in(pose: np.ndarray) -> np.ndarray:
    return corners_of(np.zeros(len(SIZES)), np.asarray(pose)[None])[0]


def view_of(quad: Quad) -> tuple[str, str]:
    """The view that has a quadrilateral's place in `BOTH`."""
    off = np.abs(corners_in(BOTH).mean(axis=1) - quad.corners.mean(axis=0)).max(axis=-1)
    return VIEWS[int(off.argmin())]


def area(corners: np.ndarray) -> float:
    """Signed: by the sense in which the corners go around."""
    x, y = corners.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def without(*left_out: tuple[str, str]) -> list:
    there = zip(VIEWS, corners_in(BOTH), strict=True)
    return [quad_of(corners) for view, corners in there if view not in left_out]


@given(poses)
def test_every_view_gets_its_name_and_its_corners(pose):
    true = corners_in(pose)
    sighting = match_views(quads_of(true), KNOWN, LENS)
    for index, seen in enumerate(shown(true)):
        view = sighting.view(*VIEWS[index])
        if not seen:
            assert view is None or view.quality is Quality.MISSING
            continue
        assert view is not None
        assert view.quality is Quality.COMPLETE
        assert view.reflections == REFLECTIONS[index]
        np.testing.assert_allclose(view.corners, true[index], atol=1e-9)
    assert sighting.ghosts == ()


@given(poses)
def test_rough_angles_are_those_of_the_catalogue_that_are_nearest(pose):
    # A view that ends to be seen within a step may speak for the next value.
    found = match_views(quads_of(corners_in(pose)), KNOWN, LENS).angles
    np.testing.assert_allclose(found, pose, atol=2 * STEP)


@given(st.permutations(range(5)))
def test_the_order_of_quadrilaterals_does_not_matter(order):
    quads = quads_of(corners_in(BOTH))
    reference = match_views(quads, KNOWN, LENS)
    sighting = match_views([quads[i] for i in order], KNOWN, LENS)
    np.testing.assert_array_equal(sighting.angles, reference.angles)
    for view, other in zip(sighting.views, reference.views, strict=True):
        assert (view.pad, view.path) == (other.pad, other.path)
        np.testing.assert_array_equal(view.corners, other.corners)


def test_a_mirror_reverses_the_handedness_of_corners():
    sighting = match_views(quads_of(corners_in(BOTH)), KNOWN, LENS)
    for pad in ("low", "high"):
        direct, mirrored = sighting.view(pad, "direct"), sighting.view(pad, f"mirror:{pad}")
        assert direct is not None
        assert mirrored is not None
        assert area(direct.corners) * area(mirrored.corners) < 0


def test_rays_and_covariances_are_in_the_order_of_the_corners():
    true = corners_in(BOTH)
    quads = []
    for quad in quads_of(true):
        own = np.array([(1 + i) * np.eye(2) for i in quad.corners[:, 0]])
        quads.append(dataclasses.replace(quad, covariance=own))
    sighting = match_views(quads, KNOWN, LENS)
    assert len(sighting.complete()) == 5
    for view in sighting.views:
        np.testing.assert_allclose(view.covariance[:, 0, 0], 1 + view.corners[:, 0])
        np.testing.assert_allclose(LENS.project(view.rays), view.corners, atol=1e-6)


@pytest.mark.parametrize(("pad", "path"), VIEWS)
def test_a_view_flatter_than_its_pads_limit_is_flat(pad, path):
    quads = quads_of(corners_in(BOTH))
    own = next(i for i, quad in enumerate(quads) if view_of(quad) == (pad, path))
    angle = measured_grazing(quads[own], WIDTH)
    for limit, quality in ((0.99 * angle, Quality.COMPLETE), (1.01 * angle, Quality.FLAT)):
        known = dataclasses.replace(KNOWN, grazing=KNOWN.grazing | {pad: limit})
        view = match_views(quads, known, LENS).view(pad, path)
        assert view is not None
        assert view.quality is quality
        assert view.ends == (quality is Quality.COMPLETE,) * 2


@pytest.mark.parametrize(
    ("share", "short", "quality"),
    [
        (1.0, 0.98, Quality.COMPLETE),
        (0.5, 0.98, Quality.CLIPPED),
        (0.5, 1.0, Quality.COMPLETE),
        (0.0, 1.0, Quality.CLIPPED),
    ],
)
def test_where_a_part_may_be_hidden_a_view_must_be_as_long_as_its_pad(share, short, quality):
    """2 % of the length: within the errors where all is seen, too much where it may not be."""
    index = VIEWS.index(("low", "direct"))
    corners = corners_in(BOTH)[index]
    cut = corners.copy()
    cut[[1, 2]] += (1 - short) * (corners[[0, 3]] - corners[[1, 2]])
    families = list(KNOWN.families)
    doubted = np.full(len(ANGLES), share)
    families[index] = dataclasses.replace(families[index], complete=doubted)
    known = dataclasses.replace(KNOWN, families=families)
    view = match_views([quad_of(cut, deviation=0.1)], known, LENS).view("low", "direct")
    assert view is not None
    assert view.quality is quality


@pytest.mark.parametrize("view", VIEWS)
def test_what_is_covered_is_not_found_and_the_others_stay(view):
    sighting = match_views(without(view), KNOWN, LENS)
    found = sighting.view(*view)
    assert found is None or found.quality is Quality.MISSING
    assert names(sighting) == {" ".join(other) for other in VIEWS if other != view}


@pytest.mark.parametrize("view", VIEWS[:3])
def test_what_is_missing_has_no_numbers(view):
    sighting = match_views(without(view), KNOWN, LENS)
    found = sighting.view(*view)
    assert found is not None
    assert found.quality is Quality.MISSING
    assert np.isnan(found.corners).all()
    assert np.isnan(found.rays).all()
    assert found.area == 0
    np.testing.assert_allclose(sighting.angles, BOTH, atol=STEP)


def test_a_joint_that_nothing_tells_has_no_angle_and_misses_nothing():
    sighting = match_views(without(("low", "direct"), ("low", "mirror:low")), KNOWN, LENS)
    assert np.isnan(sighting.angles[0])
    assert sighting.angles[1] == pytest.approx(BOTH[1], abs=STEP)
    assert sighting.view("low", "direct") is None


def test_nothing_at_all_misses_what_does_not_move():
    sighting = match_views([], KNOWN, LENS)
    assert np.isnan(sighting.angles).all()
    assert [(v.pad, v.quality) for v in sighting.views] == [("still", Quality.MISSING)]
    assert sighting.ghosts == ()
    assert sighting.complete() == []


def test_what_is_far_from_every_view_is_a_ghost():
    ghost = quad_of(np.array([[30.0, 80.0], [30.0, 30.0], [90.0, 30.0], [90.0, 80.0]]))
    sighting = match_views([*quads_of(corners_in(BOTH)), ghost], KNOWN, LENS)
    assert sighting.ghosts == (dataclasses.replace(ghost, quality=Quality.GHOST),)
    assert len(sighting.complete()) == 5
    np.testing.assert_allclose(sighting.angles, BOTH, atol=STEP)


def test_views_that_are_not_asked_for_explain_and_are_not_told():
    families = [dataclasses.replace(f, wanted=f.path == "direct") for f in KNOWN.families]
    known = dataclasses.replace(KNOWN, families=families)
    quads = without(("low", "direct"))
    sighting = match_views(quads, known, LENS)
    assert {view.path for view in sighting.views} == {"direct"}
    assert names(sighting) == {"still direct", "high direct"}
    # The mirror's view alone has told the angle, and so that the direct view is missing.
    assert sighting.angles[0] == pytest.approx(BOTH[0], abs=STEP)
    missing = sighting.view("low", "direct")
    assert missing is not None
    assert missing.quality is Quality.MISSING
    assert len(sighting.ghosts) == 2


def test_a_camera_out_of_place_does_not_mislead():
    shift = np.array([6.0, -9.0])
    true = corners_in(BOTH) + shift
    sighting = match_views([quad_of(corners) for corners in true], KNOWN, LENS)
    assert len(sighting.complete()) == 5
    np.testing.assert_allclose(sighting.angles, BOTH, atol=STEP)


@pytest.mark.parametrize("quality", [Quality.CLIPPED, Quality.LOW_CONTRAST])
def test_a_poor_quadrilateral_stays_poor(quality):
    quads = [dataclasses.replace(quad, quality=quality) for quad in quads_of(corners_in(BOTH))]
    sighting = match_views(quads, KNOWN, LENS)
    assert sighting.complete() == []
    assert {view.quality for view in sighting.views} == {quality}


def with_length(share: float, *, of: str = "still", kept: int = 0) -> np.ndarray:
    """Corners in which one direct view is as long as a share of its pad, from one end."""
    corners = corners_in(BOTH).copy()
    index = VIEWS.index((of, "direct"))
    half = share * LENGTHS[of]
    ends = np.array([-8.0, -8.0 + half]) if kept == 0 else np.array([8.0 - half, 8.0])
    forward, beside = 20.0, np.array([-12.0, -12.0, 12.0, 12.0])
    up = ends[[0, 1, 1, 0]]
    off = np.hypot(up, beside)
    part = 193.0 * np.arctan2(off, forward) / off
    corners[index] = np.stack([359.5 + part * beside, 269.5 - part * up], axis=-1)
    return corners


@pytest.mark.parametrize(
    ("share", "quality"),
    [
        (0.7, Quality.CLIPPED),
        (0.9, Quality.CLIPPED),
        (1.0, Quality.COMPLETE),
        (1.1, Quality.MERGED),
        (1.3, Quality.MERGED),
    ],
)
def test_a_view_that_is_not_as_long_as_its_pad_is_not_all_of_it(share, quality):
    # Nothing is beside it that it could have run into.
    own = [quad_of(corners) for corners in with_length(share)[1:2]]
    view = match_views(own, KNOWN, LENS).view("still", "direct")
    assert view is not None
    assert view.quality is quality


@pytest.mark.parametrize("share", [1.02, 1.06, 1.1])
@pytest.mark.parametrize("end", [0, 1])
def test_a_view_that_has_run_into_its_neighbour_ends_where_the_pad_does(share, end):
    corners = with_length(share, kept=1 - end)
    true = with_length(1.0)[1]
    # A family beside that end, as a pad that touches this one would have.
    row = (corners[1, [0, 3], 1] if end == 0 else corners[1, [1, 2], 1]).mean()
    beside = dataclasses.replace(
        KNOWN.families[1],
        pad="beside",
        corners=(corners[1] + [0, row - corners[1, 0 if end else 1, 1]])[None],
        wanted=False,
    )
    known = dataclasses.replace(KNOWN, families=[*KNOWN.families, beside])
    view = match_views([quad_of(corners[1])], known, LENS).view("still", "direct")
    assert view is not None
    assert view.quality is Quality.COMPLETE
    np.testing.assert_allclose(view.corners, true, atol=1e-6)


@pytest.mark.parametrize("end", [0, 1])
def test_an_end_that_some_fingers_hide_is_not_granted(end):
    index = VIEWS.index(("low", "direct"))
    families = list(KNOWN.families)
    seen = families[index].ends.copy()
    near = np.argmin(np.abs(ANGLES - BOTH[0])) + 1
    seen[near:, end] = False
    families[index] = dataclasses.replace(families[index], ends=seen)
    known = dataclasses.replace(KNOWN, families=families)
    view = match_views(quads_of(corners_in(BOTH)), known, LENS).view("low", "direct")
    assert view is not None
    assert view.quality is Quality.COMPLETE
    assert view.ends == (end == 1, end == 0)


def test_where_no_value_nearby_shows_all_of_a_pad_it_is_clipped():
    families = [
        dataclasses.replace(f, complete=np.zeros_like(f.complete)) if f.pad == "low" else f
        for f in KNOWN.families
    ]
    sighting = match_views(
        quads_of(corners_in(BOTH)), dataclasses.replace(KNOWN, families=families), LENS
    )
    assert names(sighting, [Quality.CLIPPED]) == {"low direct", "low mirror:low"}
    assert names(sighting) == {"still direct", "high direct", "high mirror:high"}


def test_a_pad_seen_at_two_joint_angles_is_ambiguous_and_the_others_stay():
    """A double exposure: the second joint's pad is there once more, as it is at another angle."""
    other = corners_in(BOTH + np.array([0.0, 0.45]))
    index = max(
        (i for i, family in enumerate(KNOWN.families) if family.wanted and family.joint == 1),
        key=lambda i: area(other[i]) ** 2,
    )
    quads = [*quads_of(corners_in(BOTH)), quad_of(other[index])]
    sighting = match_views(quads, KNOWN, LENS)
    assert sighting.angles[0] == pytest.approx(BOTH[0], abs=2 * STEP)
    assert np.isnan(sighting.angles[1])
    for view, family in zip(sighting.views, KNOWN.families, strict=True):
        if family.joint == 1:
            assert view.quality in (Quality.AMBIGUOUS, Quality.MISSING)
            assert view.ends == (False, False)
        else:
            assert view.quality is Quality.COMPLETE
