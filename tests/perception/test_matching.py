"""Quadrilaterals matched to views of two hinged pads, their mirrors, and a pad that stays.

All of it is written out in the camera's own axes (forward, up), mm: a phalanx, with what its mirror
shows, turns about its hinge as one body. The camera is that of `drawn`.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.lengths import measured_grazing, measured_length
from perception.matching import (
    STRAIGHT,
    Sighting,
    View,
    ViewCatalog,
    ViewFamily,
    _Search,
    match_views,
)
from perception.quads import Quad
from perception.quality import Quality
from tests.perception.drawn import Eye, Pad, quad_at

EYE = Eye(540, 720, focal=193.0)
LENS = EYE.lens()
WIDTH = 24.0
LENGTHS = {"low": 22.0, "still": 16.0, "high": 20.0}
VIEWS = (
    *(("low", "direct"), ("still", "direct"), ("high", "direct")),
    *(("high", "mirror:high"), ("low", "mirror:low")),
)
REFLECTIONS = (0, 0, 0, 1, 1)
MOVED_BY = (0, None, 1, 1, 0)
FLAT = 8.0
"""A view is seen from so many rows on."""

ANGLES = np.linspace(-0.1, 1.5, 161)
"""Values of each joint in the catalogue, rad."""

STEP = float(ANGLES[1] - ANGLES[0])
BOTH = np.array([0.7, 0.75])
"""A pose in which every pad is seen in every way."""

ALONE = VIEWS.index(("still", "direct"))
poses = st.tuples(st.floats(0.0, 1.5), st.floats(0.0, 1.5))


def corners_in(pose: Sequence[float] | np.ndarray) -> np.ndarray:
    """Corners of all views; a mirror's image of a pad is 16 mm behind it."""
    pads = {("still", "direct"): Pad((20, -8), (20, 8), WIDTH)}
    for angle, (name, side) in zip(pose, (("low", -1), ("high", 1)), strict=True):
        cosine, sine = np.cos(angle), -side * np.sin(angle)
        for path, forward in (("direct", 0.0), (f"mirror:{name}", -16.0)):
            first, second = (
                (20 + cosine * forward - sine * up, 12 * side + sine * forward + cosine * up)
                for up in (4 * side, (4 + LENGTHS[name]) * side)
            )
            pads[name, path] = Pad(first, second, WIDTH)
    return np.stack([EYE.places(pads[view].corners()) for view in VIEWS])


def shown(corners: np.ndarray) -> np.ndarray:
    """Which of all views are in the image, seen from the right side and not too flat."""
    inside = ((corners > 4) & (corners < np.array([EYE.columns, EYE.rows]) - 5)).all(axis=(-1, -2))
    rise = corners[..., [0, 3], 1].mean(axis=-1) - corners[..., [1, 2], 1].mean(axis=-1)
    upright = np.array([-1 if pad == "low" else 1 for pad, _ in VIEWS])
    return inside & (rise * upright * (-1.0) ** np.array(REFLECTIONS) > FLAT)


def catalog() -> ViewCatalog:
    """All that it can show; a view is whole or is not seen at all."""
    families = []
    corners = np.stack([corners_in((angle, angle)) for angle in ANGLES])
    there = shown(corners)
    for index, (view, joint) in enumerate(zip(VIEWS, MOVED_BY, strict=True)):
        values = slice(None) if joint is not None else slice(1)
        own = there[values, index]
        share = own.astype(float)
        seen = own, own, share, share, np.stack([own, own], axis=-1)
        # Errors of fabrication move corners by 3 px.
        spread = np.full((len(own), 2), 3.0)
        where = ANGLES[values], corners[values, index]
        extent = np.tile([LENGTHS[view[0]], 0.0], (len(spread), 1))
        bend = np.zeros((len(spread), 4, 2))
        families.append(
            ViewFamily(*view, REFLECTIONS[index], joint, *where, *seen, spread, extent, bend, True)
        )
    return ViewCatalog(families, LENGTHS, dict.fromkeys(LENGTHS, 0.01), WIDTH, 2)


KNOWN = catalog()


def quad_of(corners: np.ndarray, *, deviation: float = 0.1) -> Quad:
    """A quadrilateral, its corners in the pad's order or the other way up."""
    lower_first = corners[0, 1] + corners[3, 1] >= corners[1, 1] + corners[2, 1]
    ordered = corners if lower_first else corners[[1, 0, 3, 2]]
    return quad_at(EYE, ordered, deviation=deviation)


def quads_of(corners: np.ndarray) -> list[Quad]:
    """Of all views that are seen in a pose."""
    return [quad_of(one) for one in corners[shown(corners)]]


def names(sighting: Sighting) -> set[tuple[str, str]]:
    return {(view.pad, view.path) for view in sighting.complete()}


def found_in(sighting: Sighting, pad: str, path: str) -> View:
    view = sighting.view(pad, path)
    assert view is not None
    return view


def without(*left_out: tuple[str, str]) -> list[Quad]:
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


def test_a_family_s_ends_are_ordered_as_those_of_a_quadrilateral_in_the_image():
    for family in KNOWN.families:
        for corners, quad, rows in zip(family.corners, family.as_quads, family.rows, strict=True):
            assert {tuple(corner) for corner in quad} == {tuple(corner) for corner in corners}
            lower, upper = sorted([corners[[0, 3], 1].mean(), corners[[1, 2], 1].mean()])[::-1]
            assert rows.tolist() == pytest.approx([lower, upper])
            assert quad[[0, 3], 1].mean() == pytest.approx(lower)


def test_in_any_order_corners_rays_and_covariances_are_those_of_a_pad():
    quads = []
    for quad in quads_of(corners_in(BOTH)):
        own = np.array([(1 + i) * np.eye(2) for i in quad.corners[:, 0]])
        upper = np.array([False, True])
        quads.append(dataclasses.replace(quad, covariance=own, roughness=own / 2, apart=upper))
    reference = match_views(quads, KNOWN, LENS)
    for order in ([4, 3, 2, 1, 0], [1, 3, 0, 4, 2], [2, 0, 4, 1, 3]):
        sighting = match_views([quads[i] for i in order], KNOWN, LENS)
        np.testing.assert_array_equal(sighting.angles, reference.angles)
        assert [(view.pad, view.path) for view in sighting.complete()] == list(VIEWS)
        for view, corners in zip(sighting.views, corners_in(BOTH), strict=True):
            np.testing.assert_array_equal(view.corners, corners)
            np.testing.assert_allclose(view.covariance[:, 0, 0], 1 + view.corners[:, 0])
            np.testing.assert_array_equal(view.roughness, view.covariance / 2)
            # Where colors end apart is no end of the pad: here the one that is higher in the image.
            higher = int(np.argmin([corners[[0, 3], 1].mean(), corners[[1, 2], 1].mean()]))
            assert view.ends == (higher == 1, higher == 0)
            np.testing.assert_allclose(LENS.project(view.rays), view.corners, atol=1e-6)


def test_what_stays_shows_how_the_camera_is_out_of_place():
    moved = corners_in(BOTH) + np.array([20.0, -15.0])
    sighting = match_views([quad_of(corners) for corners in moved], KNOWN, LENS)
    np.testing.assert_allclose(sighting.angles, BOTH, atol=STEP)
    assert [(view.pad, view.path) for view in sighting.views] == list(VIEWS)
    for view, corners in zip(sighting.views, moved, strict=True):
        np.testing.assert_allclose(view.corners, corners, atol=1e-6)


@pytest.mark.parametrize(("pad", "path"), VIEWS)
def test_a_view_flatter_than_its_pads_limit_is_flat(pad, path):
    quads = quads_of(corners_in(BOTH))
    angle = measured_grazing(quads[VIEWS.index((pad, path))], WIDTH)
    for limit, quality in ((0.99 * angle, Quality.COMPLETE), (1.01 * angle, Quality.FLAT)):
        known = dataclasses.replace(KNOWN, grazing=KNOWN.grazing | {pad: limit})
        view = found_in(match_views(quads, known, LENS), pad, path)
        assert view.quality is quality
        assert view.ends == (quality is Quality.COMPLETE,) * 2


@pytest.mark.parametrize(
    ("share", "short", "quality"),
    [(1, 0.98, "COMPLETE"), (0.5, 0.98, "CLIPPED"), (0.5, 1, "COMPLETE"), (0, 1, "CLIPPED")],
)
def test_where_a_part_may_be_hidden_a_view_must_be_as_long_as_its_pad(share, short, quality):
    """2 % of the length: within the errors where all is seen, too much where it may not be."""
    corners = corners_in(BOTH)[0]
    cut = corners.copy()
    cut[[1, 2]] += (1 - short) * (corners[[0, 3]] - corners[[1, 2]])
    known = changed(0, unhidden=np.full(len(ANGLES), float(share)))
    view = found_in(match_views([quad_of(cut, deviation=0.1)], known, LENS), *VIEWS[0])
    assert view.quality is Quality[quality]


@pytest.mark.parametrize(
    ("share", "short", "limit", "quality"),
    [(1, 1, 0, "COMPLETE"), (1, 0.98, 0, "CLIPPED"), (0, 1, 0, "CLIPPED"), (1, 1, 1.5, "FLAT")],
)
def test_what_a_lamp_lies_across_must_be_as_long_as_its_pad(share, short, limit, quality):
    """Whatever is seen of the pad by the catalogue: the lamp may not be in it."""
    corners = corners_in(BOTH)[0]
    cut = corners.copy()
    cut[[1, 2]] += (1 - short) * (corners[[0, 3]] - corners[[1, 2]])
    known = changed(0, unhidden=np.full(len(ANGLES), float(share)))
    known = dataclasses.replace(known, grazing=known.grazing | {VIEWS[0][0]: limit})
    quad = dataclasses.replace(quad_of(cut), quality=Quality.CLIPPED, before_lamp=True)
    view = found_in(match_views([quad], known, LENS), *VIEWS[0])
    assert view.quality is Quality[quality]
    assert view.ends == (quality == "COMPLETE",) * 2 or quality == "CLIPPED"
    # What is no line is not all of it, but may have its other end.
    rough = dataclasses.replace(quad, scatter=9.0)
    view = found_in(match_views([rough], known, LENS), *VIEWS[0])
    assert view.quality is Quality.CLIPPED


@pytest.mark.parametrize("lost", [*((view,) for view in VIEWS), VIEWS, VIEWS[:1] + VIEWS[-1:]])
def test_what_is_covered_is_missing_without_numbers_and_the_others_stay(lost):
    sighting = match_views(without(*lost), KNOWN, LENS)
    assert names(sighting) == set(VIEWS) - set(lost)
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
    [found] = sighting.ghosts
    assert found.quality is Quality.GHOST
    np.testing.assert_array_equal(found.corners, ghost.corners)
    assert len(sighting.complete()) == 5
    np.testing.assert_allclose(sighting.angles, BOTH, atol=STEP)


def test_views_that_are_not_asked_for_explain_and_are_not_returned():
    families = [dataclasses.replace(f, wanted=f.path == "direct") for f in KNOWN.families]
    known = dataclasses.replace(KNOWN, families=families)
    sighting = match_views(without(("low", "direct")), known, LENS)
    assert names(sighting) == {("still", "direct"), ("high", "direct")}
    # The mirror's view alone gives the angle, by which the direct view is missing.
    assert sighting.angles[0] == pytest.approx(BOTH[0], abs=STEP)
    assert found_in(sighting, "low", "direct").quality is Quality.MISSING
    assert len(sighting.views) == 3
    assert len(sighting.ghosts) == 2


@pytest.mark.parametrize("quality", [Quality.CLIPPED, Quality.LOW_CONTRAST])
def test_a_poor_quadrilateral_stays_poor(quality):
    quads = [dataclasses.replace(quad, quality=quality) for quad in quads_of(corners_in(BOTH))]
    sighting = match_views(quads, KNOWN, LENS)
    assert sighting.complete() == []
    assert {view.quality for view in sighting.views} == {quality}


def still_of_length(share: float, *, kept: int = 0) -> np.ndarray:
    """Corners of the pad that stays, as long as a share of it, from one end."""
    length = share * LENGTHS["still"]
    ends = ((20.0, -8.0), (20.0, length - 8)) if kept == 0 else ((20.0, 8 - length), (20.0, 8.0))
    return EYE.places(Pad(*ends, width=WIDTH).corners())


@pytest.mark.parametrize(
    ("share", "quality"), [(0.9, Quality.CLIPPED), (1.0, Quality.COMPLETE), (1.1, Quality.MERGED)]
)
def test_a_view_that_is_not_as_long_as_its_pad_is_not_all_of_it(share, quality):
    # Nothing is beside it that it could have run into.
    sighting = match_views([quad_of(still_of_length(share))], KNOWN, LENS)
    assert found_in(sighting, *VIEWS[ALONE]).quality is quality


def beside_at(end: int, corners: np.ndarray) -> ViewCatalog:
    """With a family beside an end of a view, as a pad that touches this one would have."""
    beside = corners.copy()
    own = [[0, 3], [1, 2]][end]
    beside[:, 1] += corners[own, 1].mean() - corners[1 - end, 1]
    family = dataclasses.replace(KNOWN.families[ALONE], pad="beside", wanted=False)
    family = dataclasses.replace(family, corners=beside[None])
    return dataclasses.replace(KNOWN, families=[*KNOWN.families, family])


@pytest.mark.parametrize("share", [1.02, 1.06, 1.1])
@pytest.mark.parametrize("end", [0, 1])
def test_a_view_that_has_run_into_its_neighbour_ends_where_the_pad_does(share, end):
    corners = still_of_length(share, kept=1 - end)
    view = found_in(match_views([quad_of(corners)], beside_at(end, corners), LENS), *VIEWS[ALONE])
    assert view.quality is Quality.COMPLETE
    np.testing.assert_allclose(view.corners, still_of_length(1.0), atol=1e-6)


@pytest.mark.parametrize("share", [0.98, 1.02])
@pytest.mark.parametrize("end", [0, 1])
def test_beside_another_view_the_seam_ends_a_view_unless_it_ends_before(share, end):
    """What `follow` finds at the seam is the pad; the view was found longer, or shorter."""
    corners, seam = still_of_length(share, kept=1 - end), still_of_length(1.0, kept=1 - end)
    asked = []

    def follow(starts, beside):
        asked.append(beside)
        return [quad_of(seam) if beside == end else None for _ in starts]

    sighting = match_views([quad_of(corners)], beside_at(end, corners), LENS, follow)
    view = found_in(sighting, *VIEWS[ALONE])
    assert end in asked
    assert 1 - end not in asked
    assert view.quality is Quality.COMPLETE
    np.testing.assert_allclose(view.corners, seam if share > 1 else corners, atol=1e-6)


def test_a_view_that_has_run_into_something_at_both_ends_is_looked_for_between():
    corners, pad = still_of_length(1.0), still_of_length(1.0)
    corners[:, 1] += np.where(corners[:, 1] > pad[:, 1].mean(), 12.0, -12.0)

    def follow(starts, _) -> list[Quad | None]:
        return [quad_of(pad if np.abs(one - pad).max() < 8 else corners) for one in starts]

    sighting = match_views([quad_of(corners)], KNOWN, LENS)
    assert found_in(sighting, *VIEWS[ALONE]).quality is Quality.MERGED
    view = found_in(match_views([quad_of(corners)], KNOWN, LENS, follow), *VIEWS[ALONE])
    assert view.quality is Quality.COMPLETE
    np.testing.assert_allclose(view.corners, pad, atol=1e-6)


@pytest.mark.parametrize("aside", [-11.0, 0.0, 11.0])
def test_what_stays_is_looked_for_where_a_camera_out_of_place_has_it(aside):
    pad = still_of_length(1.0) + np.array([aside, 6.0])

    def follow(starts, _) -> list[Quad | None]:
        return [quad_of(pad) if np.abs(one - pad).max() < 8 else None for one in starts]

    view = found_in(match_views([], KNOWN, LENS, follow), *VIEWS[ALONE])
    assert view.quality is Quality.COMPLETE
    np.testing.assert_allclose(view.corners, pad, atol=1e-6)


def test_of_views_from_several_starts_the_one_as_long_as_the_pad_counts():
    """The other is within the tolerance, too, as its length is little known."""
    corners, pad = still_of_length(1.1), still_of_length(1.0)
    long = quad_of(still_of_length(1.03), deviation=1.0)
    long = dataclasses.replace(long, contrast=200.0)

    def follow(starts, _) -> list[Quad | None]:
        # From one of the two ends, and from the other.
        beyond = [one[:, 1].max() > pad[:, 1].max() + 3 for one in starts]
        return [long if is_beyond else quad_of(pad) for is_beyond in beyond]

    view = found_in(match_views([quad_of(corners)], KNOWN, LENS, follow), *VIEWS[ALONE])
    np.testing.assert_allclose(view.corners, pad, atol=1e-6)


def test_corners_that_are_known_well_do_not_count_against_a_view():
    """Its length is known to 0.1 %, and 0.25 % too short; the other is right, but known to 1 %."""
    eye = Eye(2160, 2880, focal=772.0)

    def still(share: float, deviation: float) -> Quad:
        pad = Pad((20.0, -8.0), (20.0, share * LENGTHS["still"] - 8.0), WIDTH)
        return quad_at(eye, eye.places(pad.corners()), deviation=deviation)

    lens, sharp, faint = eye.lens(), still(0.9975, 0.1), still(1.0, 4.0)
    known = [measured_length(quad, WIDTH, lens)[1] / LENGTHS["still"] for quad in (sharp, faint)]
    assert known == pytest.approx([0.001, 0.01], rel=0.2)
    assert _Search(KNOWN, lens, None).likeliest(ALONE, 0, [faint, sharp]) is sharp


def test_sides_that_are_no_lines_are_none_of_a_pad():
    quads = [dataclasses.replace(quad, scatter=STRAIGHT) for quad in quads_of(corners_in(BOTH))]
    sighting = match_views(quads, KNOWN, LENS)
    assert {view.quality for view in sighting.views} == {Quality.LOW_CONTRAST}


@pytest.mark.parametrize("end", [0, 1])
def test_an_end_that_some_fingers_hide_is_not_granted(end):
    seen = KNOWN.families[0].ends.copy()
    seen[np.argmin(np.abs(ANGLES - BOTH[0])) + 1 :, end] = False
    sighting = match_views(quads_of(corners_in(BOTH)), changed(0, ends=seen), LENS)
    view = found_in(sighting, *VIEWS[0])
    assert view.quality is Quality.COMPLETE
    assert view.ends == (end == 1, end == 0)


def test_a_pad_seen_at_two_joint_angles_is_ambiguous_and_the_others_stay():
    """A double exposure: the second joint's pad is there once more, as it is at another angle."""
    other = corners_in(BOTH + np.array([0.0, 0.45]))[MOVED_BY.index(1)]
    sighting = match_views([*quads_of(corners_in(BOTH)), quad_of(other)], KNOWN, LENS)
    assert sighting.angles[0] == pytest.approx(BOTH[0], abs=2 * STEP)
    assert np.isnan(sighting.angles[1])
    for view, joint in zip(sighting.views, MOVED_BY, strict=True):
        if joint == 1:
            assert view.quality in (Quality.AMBIGUOUS, Quality.MISSING)
            assert view.ends == (False, False)
        else:
            assert view.quality is Quality.COMPLETE
