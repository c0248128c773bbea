from dataclasses import replace

import cv2
import numpy as np
import pytest

from perception.chamber import (
    IN_VIEW,
    ChamberStatus,
    Direction,
    Region,
    estimate_bending_direction,
    find_points,
    find_regions,
)
from tests.perception.chamber import nowhere
from tests.perception.chamber.drawn import HALF, Ellipse, Scene
from tests.perception.chamber.traced import picture

STRAIGHT = HALF
NO_YELLOW = replace(STRAIGHT, yellow=None)
WALL = replace(STRAIGHT, blue=None)
BENT = STRAIGHT.moved(30, -12)


def overlap(outline: np.ndarray, ellipse: Ellipse | None, shape: tuple[int, int]) -> float:
    """Intersection over union of an outline's pixels with those of an ellipse."""
    assert ellipse is not None
    found = cv2.fillConvexPoly(np.zeros(shape, np.uint8), outline, 1).astype(bool)
    y, x = np.mgrid[: shape[0], : shape[1]]
    true = ellipse.holds(x, y)
    return (found & true).sum() / (found | true).sum()


AT_BLUE = Ellipse(150.3, 119.5, 47, 47)
TOUCHING = replace(STRAIGHT, yellow=AT_BLUE, top=replace(AT_BLUE, x=120.0, wide=22, high=22))
"""The top lies at blue: yellow's outline holds it all the same."""


@pytest.mark.parametrize(("gain", "noise"), [(0.4, 6.0), (1.0, 0.0), (1.0, 4.0), (2.5, 4.0)])
def test_outlines_and_labels_are_those_drawn(gain: float, noise: float):
    regions = find_regions(BENT.image(gain=gain, noise=noise))
    assert regions.status is ChamberStatus.CHAMBER
    # One pixel all around is 2 % of blue's area and 4 % of yellow's.
    assert overlap(regions.blue, BENT.blue, regions.labels.shape) > 0.98
    assert overlap(regions.yellow, BENT.yellow, regions.labels.shape) > 0.96
    # Colours mix within 3 px of an edge; everywhere else the labels are those drawn.
    drawn = BENT.labels()
    near = cv2.morphologyEx(drawn, cv2.MORPH_GRADIENT, np.ones((7, 7), np.uint8)) > 0
    # An opening leaves a few noisy pixels of the dark top unlabelled.
    assert (regions.labels == drawn)[~near].mean() > 0.999


@pytest.mark.parametrize(
    ("scene", "part", "least"), [(STRAIGHT.moved(60, 0), "blue", 0.98), (TOUCHING, "yellow", 0.96)]
)
def test_an_outline_holds_what_lies_at_its_wall(scene: Scene, part: str, least: float):
    regions = find_regions(scene.image(noise=4))
    assert overlap(getattr(regions, part), getattr(scene, part), regions.labels.shape) > least


SIGHTS = {
    "straight": (STRAIGHT.image(noise=4), ChamberStatus.CHAMBER),
    "no yellow": (NO_YELLOW.image(noise=4), ChamberStatus.NO_YELLOW),
    "wall alone": (WALL.image(noise=4), ChamberStatus.NO_CHAMBER),
    "blue alone": (np.full((240, 320, 3), (25, 50, 180), np.uint8), ChamberStatus.NO_CHAMBER),
    "grey": (np.full((240, 320, 3), 128, np.uint8), ChamberStatus.NO_CHAMBER),
    "dark inside": (replace(STRAIGHT, inner=0.02).image(noise=4), ChamberStatus.DARK_INSIDE),
    "gloss inside": (picture("straight", 2.2), ChamberStatus.GLOSSY_INSIDE),
    "yellow beside blue": (nowhere.side_by_side(np.random.default_rng(0)), ChamberStatus.NO_RINGS),
    "dark": (STRAIGHT.image(gain=0.03, noise=3), ChamberStatus.TOO_DARK),
    "black": (np.zeros((240, 320, 3), np.uint8), ChamberStatus.TOO_DARK),
    "overexposed": (STRAIGHT.image(gain=15), ChamberStatus.TOO_BRIGHT),
    "white": (np.full((240, 320, 3), 255, np.uint8), ChamberStatus.TOO_BRIGHT),
    "swapped": (STRAIGHT.image(noise=4)[..., ::-1], ChamberStatus.SWAPPED),
    "swapped, no yellow": (NO_YELLOW.image(noise=4)[..., ::-1], ChamberStatus.SWAPPED),
    "swapped and bent": (STRAIGHT.moved(60, 20).image(noise=4)[..., ::-1], ChamberStatus.SWAPPED),
    "white pixel": (np.full((1, 1, 3), 255, np.uint8), ChamberStatus.TOO_BRIGHT),
    "red pixel": (np.array([[[180, 20, 20]]], np.uint8), ChamberStatus.NO_CHAMBER),
}


@pytest.mark.parametrize("name", SIGHTS)
def test_every_status(name: str):
    image, status = SIGHTS[name]
    regions = find_regions(image)
    assert regions.status is status
    assert (len(regions.blue) > 0) == (status in IN_VIEW)
    assert (len(regions.yellow) > 0) == (status is ChamberStatus.CHAMBER)


def test_every_status_is_among_them():
    assert {status for _, status in SIGHTS.values()} == set(ChamberStatus)


@pytest.mark.parametrize("kind", nowhere.KINDS)
def test_no_chamber_is_found_where_there_is_none(kind: str):
    number = list(nowhere.KINDS).index(kind)
    for count in range(25):
        image = nowhere.KINDS[kind](np.random.default_rng([7, number, count]))
        assert find_regions(image).status not in {*IN_VIEW, ChamberStatus.SWAPPED}, count


def test_a_yellow_ring_is_found_however_dark_or_called_so():
    true = replace(BENT, top=None)
    for inner in (1.0, 0.25, 1 / 12, 1 / 16, 1 / 32, 1 / 50):
        for noise in (0.0, 2.0):
            image = replace(true, inner=inner).image(noise=noise)
            regions = find_regions(image)
            points = find_points(image, regions)
            dark = regions.status is ChamberStatus.DARK_INSIDE and inner < 1 / 12
            assert dark or regions.status is ChamberStatus.CHAMBER, (inner, noise)
            across = points.xy[[3, 4, 5], [0, 1, 0]] - true.points[[3, 4, 5], [0, 1, 0]]
            # A yellow that is hardly brighter than its noise has no finer edge than this.
            assert np.abs(across[points.seen[3:6]]).max(initial=0.0) < 2, (inner, noise)


def test_a_lens_with_black_corners_shows_the_chamber():
    image = STRAIGHT.moved(40, 0).image(noise=2)
    y, x = np.mgrid[:240, :320]
    image[np.hypot(x - 159.5, y - 119.5) > 125] = (4, 3, 3)
    regions = find_regions(image)
    assert regions.status is ChamberStatus.CHAMBER
    # Its outline ends between where the black begins and where blue would.
    assert 159.5 + 125 - 1 < regions.blue[:, 0].max() < 159.5 + 40 + 90


def test_an_image_for_screens_shows_the_chamber():
    """Its levels go with the light to the power of 1/2.2: colours differ by less."""
    image = (255 * (BENT.image(noise=2) / 255.0) ** (1 / 2.2)).astype(np.uint8)
    regions = find_regions(image)
    assert regions.status is ChamberStatus.CHAMBER
    assert overlap(regions.blue, BENT.blue, regions.labels.shape) > 0.98


def test_dark_corners_specks_and_highlights_do_not_matter():
    image = STRAIGHT.image(noise=4)
    clean = find_regions(image)
    y, x = np.mgrid[:240, :320]
    image[np.hypot(x - 159.5, y - 119.5) > 170] = (6, 4, 4)
    cv2.circle(image, (159, 48), 8, (255, 255, 255), -1)  # on the blue ring
    cv2.circle(image, (140, 90), 5, (255, 255, 255), -1)  # where blue and yellow meet
    cv2.rectangle(image, (10, 100), (14, 104), (20, 50, 190), -1)  # a blue speck on the wall
    regions = find_regions(image)
    assert regions.status is ChamberStatus.CHAMBER
    for name in ("blue", "yellow"):
        box, usual = (np.array(cv2.boundingRect(getattr(r, name))) for r in (regions, clean))
        assert np.abs(box - usual).max() <= 1


def corrupt(number: int) -> np.ndarray:
    """A frame that something is wrong with."""
    rng = np.random.default_rng(number)
    rows, columns = (int(n) for n in rng.integers(1, 90, 2))
    walls, usual = nowhere.WALLS.astype(np.uint8), STRAIGHT.image(noise=4)
    match number % 6:
        case 0:
            return rng.integers(0, 256, (rows, columns, 3), dtype=np.uint8)
        case 1:
            return walls[rng.integers(0, 4, (rows, columns))]
        case 2:  # patches of these colours
            patches = walls[rng.integers(0, 4, (3, 4))]
            return cv2.resize(patches, (columns, rows), interpolation=cv2.INTER_NEAREST)
        case 3:  # rows of another frame, as of a broken cable
            usual[rng.integers(0, 240) :] = np.roll(usual, int(rng.integers(1, 300)), 1)[0]
            return usual
        case 4:
            return np.ascontiguousarray(STRAIGHT.image(noise=40, seed=number)[:rows, :columns])
        case _:
            return (usual * rng.uniform(0, 1, 3)).astype(np.uint8)


def test_every_frame_has_an_answer():
    image = STRAIGHT.image()
    initial = find_points(image, find_regions(image))
    for number in range(48):
        image = corrupt(number)
        regions = find_regions(image)
        points = find_points(image, regions)
        assert np.isfinite(points.xy).all()
        assert (points.xy[~points.seen] == 0).all()
        inside = points.xy[points.seen]
        assert (inside >= -0.5).all()
        assert (inside <= np.array(image.shape[1::-1]) - 0.5).all()
        seen = regions.status in IN_VIEW
        direction = estimate_bending_direction(points, initial, use="all")
        assert (direction is Direction.UNDEFINED) == (not seen)


def test_labels_by_outlines_are_those_drawn_without_highlights_between():
    image = BENT.image(noise=4.0).copy()
    cv2.circle(image, (40, 30), 9, (255, 200, 200), -1)  # a highlight on the red wall
    assert BENT.blue is not None
    cv2.circle(image, (int(BENT.blue.x) - 70, int(BENT.blue.y)), 5, (255, 255, 255), -1)
    regions = find_regions(image)
    assert np.any(regions.labels[25:36, 35:46] == Region.OTHER)
    drawn = BENT.labels()
    # Outlines are whole pixels: labels differ on edges alone, by a pixel or two.
    wrong = (regions.nested() != drawn).astype(np.uint8)
    assert not cv2.erode(wrong, np.ones((3, 3), np.uint8)).any()
    assert wrong.mean() < 0.02
    assert np.all(find_regions(np.full((40, 60, 3), 120, np.uint8)).nested() == Region.RED)
