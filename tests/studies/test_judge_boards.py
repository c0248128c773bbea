"""Pictures of calibration boards against formulas, Mitsuba's hits and OpenCV's detectors."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from studies.oracles.judge import boards
from studies.oracles.judge.boards import (
    BLACK,
    FARTHEST,
    NEAREST,
    STEEPEST,
    WHITE,
    Board,
    Conditions,
    Pose,
    photograph_board,
    random_conditions,
    random_pose,
)
from studies.oracles.judge.capture import Capture, expose
from studies.oracles.judge.engine import find_llvm
from studies.oracles.judge.wide_lens import PROJECTIONS, WideLens, random_lens

needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None or find_llvm() is None,
    reason="needs Mitsuba, which the extra 'judge' brings, and LLVM",
)

TAGS = Board("tags", 5, 4, 4.0, 3.2, "DICT_APRILTAG_36h11")
CHESS = Board()
EITHER = pytest.mark.parametrize("board", [CHESS, TAGS], ids=["charuco", "tags"])

CLEAN = Conditions(share=0.0, vignetting=0.0, capture=Capture(noise=0.0, blur=0.6))

EXACT_PX = 1e-6
"""Of places whose angles are interpolated."""

FLOAT32_PX, FLOAT32_MM = 1e-3, 1e-4
"""Of places that rays in float32 meet."""


def lens_of(size=(640, 480), focal=240.0, projection="equidistant", pupil=(0.4, 0.0)) -> WideLens:
    middle = (size[0] - 1) / 2 + 1.7, (size[1] - 1) / 2 - 2.3
    return WideLens(size, focal, middle, ((1.0, projection),), pupil, math.radians(80))


def facing(board: Board, distance: float, *turns: float) -> Pose:
    """The middle of a board on the axis, turned about x, y and z."""
    rotation = cv2.Rodrigues(np.array(turns))[0]
    shift = np.array([0, 0, distance]) - rotation @ np.append(board.extent / 2, 0)
    return Pose(rotation, shift)


def meet(board: Board, pose: Pose, lens: WideLens, places):
    """Points of the sheet that Mitsuba's rays of places meet."""
    ways, shifts = lens.sight(places)
    begin = shifts[:, None] * [0.0, 0.0, 1.0] - pose.translation
    begin, ways = (np.asarray((one @ pose.rotation).T, np.float32) for one in (begin, ways))
    _, distance, paper = boards._meet(*boards._scene(board), begin, ways)
    assert paper.all()
    return (begin + distance * ways).T


def look_down(board: Board, points):
    """Reflectance at points of the sheet."""
    begin = np.array([*points.T, np.full(len(points), -1.0)], np.float32)
    ways = np.zeros_like(begin)
    ways[2] = 1.0
    return boards._meet(*boards._scene(board), begin, ways)[0]


def test_random_lenses_are_wide_and_their_heights_rise():
    generator, kinds = np.random.default_rng(0), set()
    for _ in range(60):
        lens = random_lens(generator)
        angles = np.linspace(0, lens.largest, 3000)
        heights = lens.focal * lens.heights(angles)
        assert np.all(np.diff(heights) > 0)
        assert 60 <= math.degrees(lens.largest) <= 100
        assert 0.44 * lens.size[1] <= heights[-1] <= math.hypot(*lens.size) / 2 + 1e-9
        assert np.all(np.abs(np.array(lens.middle) / np.subtract(lens.size, 1) - 0.5) < 0.05)
        assert 0 <= lens.pupil[0] <= 1
        assert sum(share for share, _ in lens.blend) == pytest.approx(1)
        kinds.add((len(lens.blend), isinstance(lens.blend[0][1], str)))
    assert kinds == {(1, True), (1, False), (2, True)}


def test_only_a_blend_with_the_arctangent_is_no_polynomial():
    """Least squares with as many coefficients as Kannala and Brandt's."""
    angles = np.linspace(0, math.radians(100), 2001)[1:]

    def misfit(lens):
        height = 600 * lens.heights(angles) / lens.heights(angles[-1:])
        powers = angles[:, None] ** np.arange(1, 10, 2)
        fit = powers @ np.linalg.lstsq(powers, height, rcond=None)[0]
        return np.sqrt(np.mean((fit - height) ** 2))

    lens = lens_of()
    for name in ("equidistant", "equisolid", "stereographic", "orthographic"):
        assert misfit(lens._replace(blend=((1.0, name),))) < 0.01
    assert misfit(lens._replace(blend=((1.0, (0.05, -0.01, 1e-3, 1e-4)),))) < 1e-6
    blend = (0.5, "stereographic"), (0.5, "arctangent")
    assert misfit(lens._replace(blend=blend)) > 0.05


@pytest.mark.parametrize("projection", ["equidistant", "equisolid", "stereographic"])
def test_without_a_moving_pupil_places_are_those_of_the_textbook(projection):
    lens = lens_of(projection=projection, pupil=(0.0, 0.0))
    points = np.random.default_rng(0).normal(0, 8, (200, 3)) + np.array([0, 0, 12])
    angle = np.arctan2(np.hypot(*points.T[:2]), points[:, 2])
    radius = 240 * PROJECTIONS[projection](angle)
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    wanted = radius[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1) + lens.middle
    inside = np.all((wanted >= -0.5) & (wanted <= np.array([639.5, 479.5])), axis=-1)
    inside &= angle <= lens.largest
    places = lens.project(points)
    assert 50 < inside.sum() < 200
    assert np.array_equal(np.isfinite(places[:, 0]), inside)
    np.testing.assert_allclose(places[inside], wanted[inside], atol=EXACT_PX)


def test_points_on_a_ray_from_the_moved_pupil_are_imaged_where_the_ray_belongs():
    generator = np.random.default_rng(2)
    for _ in range(20):
        lens = random_lens(generator)
        e2, e4 = lens.pupil
        angle, azimuth = generator.uniform(0, 0.95 * lens.largest), generator.uniform(0, 6.28)
        flat = np.array([math.cos(azimuth), math.sin(azimuth)])
        way = np.append(math.sin(angle) * flat, math.cos(angle))
        begin = np.array([0, 0, e2 * angle**2 + e4 * angle**4])
        point = begin + generator.uniform(10, 60) * way
        wanted = lens.middle + lens.focal * lens.heights(np.array([angle])) * flat
        if np.all((wanted >= -0.5) & (wanted <= np.array(lens.size) - 0.5)):
            np.testing.assert_allclose(lens.project(point[None])[0], wanted, atol=EXACT_PX)
            found, shift = lens.sight(wanted[None])
            np.testing.assert_allclose(found[0], way, atol=1e-8)
            assert shift[0] == pytest.approx(begin[2], abs=1e-8)


def test_beyond_the_largest_angle_there_is_no_ray():
    lens = lens_of(focal=100.0)
    edge = 100 * math.radians(80)
    aside = np.array([[edge - 0.01, 0.0], [edge + 0.01, 0.0]])
    ways, shifts = lens.sight(lens.middle + aside)
    assert np.isfinite([*ways[0], shifts[0]]).all()
    assert np.isnan([*ways[1], shifts[1]]).all()


@EITHER
def test_edges_of_the_print_are_edges_of_pixels(board):
    """About every point three pixels are alike, or diagonal ones."""
    bitmap, scale = board.bitmap()
    assert scale >= 40
    assert bitmap.shape == tuple(np.rint((board.extent[::-1] + 2 * board.margin) * scale))
    spots = (board.points[:, :2] + board.margin) * scale
    np.testing.assert_allclose(spots, np.rint(spots), atol=1e-3)
    column, row = np.rint(spots).astype(int).T
    four = [bitmap[row + i, column + j] // 255 for i in (-1, 0) for j in (-1, 0)]
    if board.kind == "charuco":
        assert len(spots) == (board.columns - 1) * (board.rows - 1)
        assert np.array_equal(four[0], four[3])
        assert np.array_equal(four[1], four[2])
        assert np.all(four[0] != four[1])
    else:  # the pixel within the marker is black: to the lower right of its first corner
        assert len(spots) == 4 * board.columns * board.rows
        assert np.all(np.sum(four, axis=0) == 3)
        for corner, within in enumerate((3, 2, 0, 1)):
            assert np.all(four[within][corner::4] == 0)


def test_a_ratio_of_large_numbers_is_refused():
    with pytest.raises(ValueError, match="no ratio of small numbers"):
        Board(square=3.0, marker=2.2361).bitmap()


def test_without_llvm_one_line_says_what_is_needed(monkeypatch):
    scalar = SimpleNamespace(variant=lambda: "scalar_spectral_polarized")
    monkeypatch.setattr(boards, "load_mitsuba", lambda: scalar)
    with pytest.raises(RuntimeError, match="LLVM"):
        boards._scene(Board(columns=3))


@needs_mitsuba
def test_mitsuba_has_the_print_where_it_belongs():
    """Half way between black and white at the edges of squares; away from edges the bitmap's."""
    bitmap, scale = CHESS.bitmap()
    corners = CHESS.points[:, :2]
    for aside in ([0.3, 0.0], [-0.3, 0.0], [0.0, 0.3], [0.0, -0.3]):
        middle = look_down(CHESS, corners + aside)
        slope = (WHITE - BLACK) * scale  # per mm, of an edge
        np.testing.assert_allclose(middle, (BLACK + WHITE) / 2, atol=0.002 * slope)
    generator = np.random.default_rng(1)
    points = generator.uniform(-CHESS.margin, CHESS.extent + CHESS.margin, (2000, 2))
    column, row = ((points + CHESS.margin) * scale).astype(int).T
    flat = cv2.dilate(bitmap, np.ones((5, 5))) == cv2.erode(bitmap, np.ones((5, 5)))
    known = flat[row, column]
    assert known.sum() > 1000
    wanted = np.where(bitmap[row, column] > 0, WHITE, BLACK)
    np.testing.assert_allclose(look_down(CHESS, points)[known], wanted[known], atol=1e-3)


@needs_mitsuba
@EITHER
def test_rays_through_true_places_hit_the_points(board):
    generator = np.random.default_rng(3)
    for _ in range(6):
        lens = random_lens(generator)
        pose = random_pose(generator, lens, board)
        places = pose.places(lens, board.points)
        seen = np.isfinite(places[:, 0])
        hits = meet(board, pose, lens, places[seen])
        np.testing.assert_allclose(hits, board.points[seen], atol=FLOAT32_MM)
        back = pose.places(lens, hits.astype(float))
        np.testing.assert_allclose(back, places[seen], atol=FLOAT32_PX)


def test_random_poses_are_near_tilted_and_in_the_image():
    generator, tilts, parts = np.random.default_rng(4), [], []
    for _ in range(60):
        lens = random_lens(generator)
        rotation, translation = pose = random_pose(generator, lens, CHESS)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        middle = rotation @ np.append(CHESS.extent / 2, 0) + translation
        distance = np.linalg.norm(middle)
        assert NEAREST <= distance <= FARTHEST
        tilts.append(math.acos(rotation[:, 2] @ middle / distance))
        parts.append(np.isfinite(pose.places(lens, CHESS.points)[:, 0]).mean())
    assert max(tilts) <= STEEPEST
    assert max(tilts) > 0.8 * STEEPEST
    assert 0.25 <= min(parts) < 1 == max(parts)


@needs_mitsuba
def test_paper_is_as_bright_as_the_laws_of_light_have_it():
    """Lambert's cosine, the inverse square, exposure and vignetting, on the white margin."""
    lens, pose = lens_of(), facing(CHESS, 22.0, 0.3, -0.4, 0.5)
    conditions = CLEAN._replace(lamp=(9.0, 4.0, -1.0), share=0.7, vignetting=0.4)
    pixels, _ = photograph_board(lens, CHESS, pose, conditions, 0)
    middle = -CHESS.margin / 2
    spots = [(x, middle, 0.0) for x in np.linspace(0, CHESS.extent[0], 9)]
    spots += [(middle, y, 0.0) for y in np.linspace(0, CHESS.extent[1], 9)]
    places = pose.places(lens, np.array(spots))
    assert np.isfinite(places).all()
    columns, rows = places.T.astype(np.float32)
    measured = cv2.remap(pixels.astype(np.float32), columns, rows, cv2.INTER_LINEAR)
    seen = np.array(spots) @ pose.rotation.T + pose.translation
    away = np.array(conditions.lamp) - seen
    far = np.linalg.norm(away, axis=-1)
    lamp = away @ -pose.rotation[:, 2] / far / far**2
    sheet = np.stack(
        np.meshgrid(
            *(np.linspace(-CHESS.margin, size + CHESS.margin, 300) for size in CHESS.extent), [0.0]
        ),
        axis=-1,
    ).reshape(-1, 3)
    all_away = np.array(conditions.lamp) - (sheet @ pose.rotation.T + pose.translation)
    all_lamp = all_away @ -pose.rotation[:, 2] / np.linalg.norm(all_away, axis=-1) ** 3
    angle = np.hypot(*(places - lens.middle).T) / lens.focal
    wanted = 0.8 * (0.3 + 0.7 * lamp / all_lamp.max()) * (1 - 0.4 * (angle / lens.largest) ** 2)
    assert np.ptp(wanted) > 0.2
    np.testing.assert_allclose(measured.ravel() / 255, wanted, atol=1.5 / 255)


@needs_mitsuba
@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_corners_of_squares_are_found_without_bias(turn):
    """An image a tenth of a pixel or a board 2 µm off would have one.

    OpenCV's corners err by where they are within pixels, the less the more blur there is.
    """
    lens, pose = lens_of((800, 600), 420.0), facing(CHESS, 24.0, 0.2, 0.3, turn)
    conditions = CLEAN._replace(capture=Capture(noise=0.0, blur=1.0))
    pixels, places = photograph_board(lens, CHESS, pose, conditions, 0)
    assert pixels.dtype == np.uint8
    assert pixels.shape == (600, 800)
    found, numbers, *_ = cv2.aruco.CharucoDetector(CHESS.made()).detectBoard(pixels)
    assert found is not None
    assert numbers is not None
    off = np.asarray(found).reshape(-1, 2) - places[np.asarray(numbers, int).ravel()]
    assert len(off) >= 0.9 * len(places)
    assert np.all(np.abs(off) < 0.12)
    assert np.all(np.abs(off.mean(axis=0)) < 0.03)


@needs_mitsuba
@EITHER
def test_markers_are_found_where_they_are(board):
    lens, pose = lens_of((800, 600), 420.0), facing(board, 20.0, -0.3, 0.2, -0.7)
    conditions = Conditions(capture=Capture(noise=0.01, blur=0.7, jpeg=90))
    pixels, _ = photograph_board(lens, board, pose, conditions, 5)
    made, parameters = board.made(), cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(made.getDictionary(), parameters)
    corners, numbers, _ = detector.detectMarkers(pixels)
    assert numbers is not None
    places = pose.places(lens, np.reshape(made.getObjPoints(), (-1, 3))).reshape(-1, 4, 2)
    whole = np.isfinite(places).all(axis=(1, 2))
    order = {number: i for i, number in enumerate(made.getIds().ravel().tolist())}
    off = np.array(
        [
            corner.reshape(4, 2) - places[order[number]]
            for corner, number in zip(corners, numbers.ravel().tolist(), strict=True)
        ]
    )
    assert len(off) >= 0.8 * whole.sum() >= 12
    assert np.all(np.abs(off) < 0.5)
    # OpenCV has all corners of a marker too far inside: its middle is without that.
    assert np.all(np.abs(off.mean(axis=1)) < 0.1)


@needs_mitsuba
def test_the_same_seed_is_the_same_picture():
    generator = np.random.default_rng(6)
    lens = random_lens(generator)._replace(size=(320, 240), middle=(159.5, 119.5), focal=110.0)
    pose, conditions = random_pose(generator, lens, CHESS), random_conditions(generator)
    first, again, other = (photograph_board(lens, CHESS, pose, conditions, s) for s in (1, 1, 2))
    assert np.array_equal(first.pixels, again.pixels)
    assert not np.array_equal(first.pixels, other.pixels)
    np.testing.assert_array_equal(first.places, other.places)


@needs_mitsuba
def test_many_rays_go_where_they_make_a_difference(monkeypatch):
    """As if there were as many in all pixels of the sheet: other rays differ as much."""
    lens, pose = lens_of((320, 240), 150.0), facing(CHESS, 24.0, 0.5, 0.6, 0.3)
    conditions = CLEAN._replace(capture=Capture(noise=0.0, blur=0.0))

    def levels(seed):
        return photograph_board(lens, CHESS, pose, conditions, seed).pixels.astype(float)

    quick = levels(0)
    monkeypatch.setattr(boards, "STEP", -1.0)
    full, other = levels(0), levels(1)
    assert 0 < np.mean(np.abs(quick - full)) < 1.1 * np.mean(np.abs(other - full))
    assert np.max(np.abs(quick - full)) < 40  # of 204


@needs_mitsuba
def test_a_board_behind_the_camera_is_not_in_the_picture():
    lens, pose = lens_of((320, 240), 110.0), facing(CHESS, -30.0, 0.1, 0.2, 0.3)
    dark = CLEAN._replace(walls=0.0)
    pixels, places = photograph_board(lens, CHESS, pose, dark, 0)
    assert np.isnan(places).all()
    assert not pixels.any()
    ahead, _ = photograph_board(lens, CHESS, facing(CHESS, 30.0, 0.0, 0.0, 0.0), dark, 0)
    assert ahead.max() > 200


def test_gray_light_is_exposed_like_colored_light():
    gray = cv2.GaussianBlur(np.random.default_rng(0).random((40, 60)), (0, 0), 3)
    gray = (gray - gray.min()) / np.ptp(gray)
    for jpeg in (None, 95):
        capture = dataclasses.replace(Capture(noise=0.0), jpeg=jpeg)
        one = expose(gray, np.ones(()), capture, np.random.default_rng(0))
        three = np.repeat(gray[..., None], 3, axis=-1)
        colored = expose(three, np.ones(()), capture, np.random.default_rng(0))
        assert one.shape == gray.shape
        np.testing.assert_allclose(colored, one[..., None].repeat(3, -1), atol=2)
