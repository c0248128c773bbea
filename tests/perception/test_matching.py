"""Quadrilaterals told apart, on a finger that is written out by hand."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.lengths import measured_grazing
from perception.matching import Sighting, View, ViewCatalog, match_views
from perception.quads import Quad
from perception.quality import Quality
from tests.perception.drawn import Pad
from tests.perception.hand_finger import (
    ANGLES,
    EYE,
    LENGTHS,
    LENS,
    MOVED_BY,
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


def found_in(sighting: Sighting, pad: str, path: str) -> View:
    view = sighting.view(pad, path)
    assert view is not None
    return view


def without(*left_out: tuple[str, str]) -> list:
    there = zip(VIEWS, corners_in(BOTH), strict=True)
    return [quad_of(corners) for view, corners in there if view not in left_out]


def changed(index: int, **values: np.ndarray) -> ViewCatalog:
    """The catalogue with one family changed."""
    families = list(KNOWN.families)
    families[index] = dataclasses.replace(families[index], **values)
    return dataclasses.replace(KNOWN, families=families)


@given(poses)
def test_every_view_gets_its_name_its_corners_and_near_angles(pose):
    true = corners_in(pose)
    sighting = match_views(quads_of(true), KNOWN, LENS)
    for index, seen in enumerate(shown(true)):
        if not seen:
            view = sighting.view(*VIEWS[index])
            assert view is None or view.quality is Quality.MISSING
            continue
        view = found_in(sighting, *VIEWS[index])
        assert view.quality is Quality.COMPLETE
        assert view.reflections == REFLECTIONS[index]
        np.testing.assert_allclose(view.corners, true[index], atol=1e-9)
    assert sighting.ghosts == ()
    # A view that ends to be seen within a step may speak for the next value.
    np.testing.assert_allclose(sighting.angles, pose, atol=2 * STEP)


@pytest.mark.parametrize("order", [[4, 3, 2, 1, 0], [1, 3, 0, 4, 2], [2, 0, 4, 1, 3]])
def test_the_order_of_quadrilaterals_does_not_matter(order):
    quads = quads_of(corners_in(BOTH))
    reference = match_views(quads, KNOWN, LENS)
    sighting = match_views([quads[i] for i in order], KNOWN, LENS)
    np.testing.assert_array_equal(sighting.angles, reference.angles)
    for view, other in zip(sighting.views, reference.views, strict=True):
        assert (view.pad, view.path) == (other.pad, other.path)
        np.testing.assert_array_equal(view.corners, other.corners)


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
        view = found_in(match_views(quads, known, LENS), pad, path)
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
    known = changed(index, complete=np.full(len(ANGLES), share))
    view = found_in(match_views([quad_of(cut, deviation=0.1)], known, LENS), "low", "direct")
    assert view.quality is quality


@pytest.mark.parametrize("lost", [*((view,) for view in VIEWS), VIEWS, VIEWS[:1] + VIEWS[-1:]])
def test_what_is_covered_is_missing_without_numbers_and_the_others_stay(lost):
    sighting = match_views(without(*lost), KNOWN, LENS)
    assert names(sighting) == {" ".join(other) for other in VIEWS if other not in lost}
    for view in lost:
        found = sighting.view(*view)
        joint = MOVED_BY[VIEWS.index(view)]
        # Where nothing of a joint is seen its angle is not known, and so not what should be seen.
        dark = joint is not None and np.isnan(sighting.angles[joint])
        assert (found is None) == dark or view[1] != "direct"
        if found is not None:
            assert found.quality is Quality.MISSING
            assert found.area == 0
            assert np.isnan([found.corners, found.rays]).all()
    for joint, pad in enumerate(("low", "high")):
        seen = {path for name, path in VIEWS if name == pad and (name, path) not in lost}
        assert np.isnan(sighting.angles[joint]) == (not seen)
        if f"mirror:{pad}" in seen:
            assert sighting.angles[joint] == pytest.approx(BOTH[joint], abs=STEP)


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
    missing = found_in(sighting, "low", "direct")
    assert missing.quality is Quality.MISSING
    assert len(sighting.ghosts) == 2


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
    pad = Pad((20.0, ends[0]), (20.0, ends[1]), width=WIDTH)
    corners[index] = EYE.places(pad.corners())
    return corners


@pytest.mark.parametrize(
    ("share", "quality"),
    [(0.9, Quality.CLIPPED), (1.0, Quality.COMPLETE), (1.1, Quality.MERGED)],
)
def test_a_view_that_is_not_as_long_as_its_pad_is_not_all_of_it(share, quality):
    # Nothing is beside it that it could have run into.
    own = [quad_of(corners) for corners in with_length(share)[1:2]]
    view = found_in(match_views(own, KNOWN, LENS), "still", "direct")
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
    view = found_in(match_views([quad_of(corners[1])], known, LENS), "still", "direct")
    assert view.quality is Quality.COMPLETE
    np.testing.assert_allclose(view.corners, true, atol=1e-6)


@pytest.mark.parametrize("end", [0, 1])
def test_an_end_that_some_fingers_hide_is_not_granted(end):
    index = VIEWS.index(("low", "direct"))
    seen = KNOWN.families[index].ends.copy()
    seen[np.argmin(np.abs(ANGLES - BOTH[0])) + 1 :, end] = False
    sighting = match_views(quads_of(corners_in(BOTH)), changed(index, ends=seen), LENS)
    view = found_in(sighting, "low", "direct")
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
        key=lambda i: np.ptp(other[i], axis=0).prod(),
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
