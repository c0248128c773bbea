"""Looks of pads against outlines drawn by OpenCV, the lights' own formulas, and statistics."""

import cv2
import numpy as np
import pytest

from optics.rendering import Effects, Imprint, make_height_map, make_pad_appearance
from optics.rendering.pads import (
    BRIGHT,
    CORRELATION,
    ELEVATION,
    GAP,
    GREEN,
    LAMP,
    MARGIN,
    STEP,
    ClearBody,
    lamp_distance,
)

LENGTH, WIDTH = 15.0, 20.0

ROUNDING = 1e-5
"""Of places and lights in float32."""

INTERPOLATED = STEP / 32
"""OpenCV interpolates at places in 32nds of a sample."""


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Where the look of a pad is sampled: along it, and across it from its middle."""
    rows, columns = (round((size + 2 * MARGIN) / STEP) for size in (LENGTH, WIDTH))
    along = (np.arange(rows) + 0.5) * STEP - MARGIN
    across = (np.arange(columns) + 0.5) * STEP - MARGIN - WIDTH / 2
    along, across = np.meshgrid(along, across, indexing="ij")
    return along, across


def drawn_outline(rounding: float) -> np.ndarray:
    """A rectangle with round corners as a polygon; its arcs err by less than 1e-6 mm."""
    turns = np.linspace(0, np.pi / 2, 400 if rounding else 1)
    corners = []
    for quarter, (x, y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        center = x * (LENGTH / 2 - rounding) + LENGTH / 2 + 1j * y * (WIDTH / 2 - rounding)
        corners.append(center + rounding * np.exp(1j * (turns + quarter * np.pi / 2)))
    outline = np.concatenate(corners)
    return np.stack([np.real(outline), np.imag(outline)], axis=-1).astype(np.float32)


@pytest.mark.parametrize("rounding", [0.0, 1.5])
def test_the_distance_inside_is_that_from_the_outline(rounding):
    look = make_pad_appearance(LENGTH, WIDTH, Effects(rounding=rounding))
    along, across = grid()
    assert look.inside.shape == along.shape
    assert (look.length, look.width) == (LENGTH, WIDTH)
    if not rounding:  # samples reach the margin beyond every side
        assert look.inside[0].max() == look.inside[:, -1].max() == pytest.approx(STEP / 2 - MARGIN)
    evenly = np.broadcast_to(BRIGHT * np.array([1, GREEN, 1]), (*along.shape, 3))
    np.testing.assert_allclose(look.light, evenly, rtol=ROUNDING)
    outline = drawn_outline(rounding)
    rng = np.random.default_rng(0)
    for row, column in rng.integers(0, look.inside.shape, (300, 2)):
        place = float(along[row, column]), float(across[row, column])
        wanted = cv2.pointPolygonTest(outline, place, measureDist=True)
        assert look.inside[row, column] == pytest.approx(wanted, abs=10 * ROUNDING)


def test_looks_are_sampled_where_they_are_asked():
    look = make_pad_appearance(LENGTH, WIDTH, Effects(led_falloff=0.5))
    rng = np.random.default_rng(1)
    along, across = rng.uniform(0, LENGTH, (1, 200)), rng.uniform(-WIDTH / 2, WIDTH / 2, (1, 200))
    light, inside = look.sample(along.astype(np.float32), across.astype(np.float32))
    from_sides = np.minimum(np.minimum(along, LENGTH - along), WIDTH / 2 - np.abs(across))
    # Between samples on both sides of a pad's diagonal the distance is a little less.
    np.testing.assert_allclose(inside, from_sides, atol=STEP / 2)
    np.testing.assert_allclose(np.median(inside - from_sides), 0, atol=INTERPOLATED)
    falls = 0.5 * across / WIDTH
    lights = np.stack([0.75 + falls, np.full_like(across, GREEN), 0.75 - falls], axis=-1)
    np.testing.assert_allclose(light, BRIGHT * lights, atol=BRIGHT * INTERPOLATED)


def test_far_away_from_a_pad_is_outside():
    look = make_pad_appearance(LENGTH, WIDTH, Effects(rounding=1.0, roughness=0.05))
    far = np.array([[-1e3, 1e3, LENGTH / 2, LENGTH / 2, 1e7, -1e7]], np.float32)
    beside = np.array([[0, 0, -1e3, 1e3, 1e7, 0]], np.float32)
    _, inside = look.sample(far, beside)
    assert (inside < -MARGIN / 2).all()


def test_rough_edges_wander_as_far_as_is_said():
    smooth = make_pad_appearance(40.0, WIDTH, Effects())
    sizes, near, far = [], [], []
    for seed in range(8):
        rough = make_pad_appearance(40.0, WIDTH, Effects(roughness=0.05), seed=(seed,))
        wander = rough.inside - smooth.inside
        assert np.std(wander) == pytest.approx(0.05, rel=0.01)
        edge = wander[:, round(MARGIN / STEP)]  # along one side
        sizes.append(np.mean(edge**2))
        apart = round(CORRELATION / STEP)
        near.append(np.mean(edge[apart:] * edge[:-apart]))
        far.append(np.mean(edge[5 * apart :] * edge[: -5 * apart]))
    # Some 25 independent places along each of eight edges: 7 % of the standard deviation.
    assert np.sqrt(np.mean(sizes)) == pytest.approx(0.05, rel=0.25)
    # White noise under a Gaussian is correlated as exp(−(d/2σ)²).
    assert np.mean(near) / np.mean(sizes) == pytest.approx(np.exp(-0.25), abs=0.1)
    assert abs(np.mean(far)) / np.mean(sizes) < 0.25


def test_rough_edges_are_those_of_their_seed():
    one, same, other = (
        make_pad_appearance(LENGTH, WIDTH, Effects(roughness=0.05), seed=seed)
        for seed in ((1, 2, 0), (1, 2, 0), (1, 2, 1))
    )
    np.testing.assert_array_equal(one.inside, same.inside)
    assert (one.inside != other.inside).any()
    np.testing.assert_array_equal(one.light, other.light)


def test_an_imprint_changes_nothing_where_the_pad_is_flat():
    effects = Effects(led_falloff=0.4)
    flat = make_pad_appearance(LENGTH, WIDTH, effects)
    pressed = make_pad_appearance(LENGTH, WIDTH, effects, [Imprint("sphere", 7.0, 2.0, 0.6)])
    along, across = grid()
    away = np.hypot(along - 7, across - 2) > np.sqrt(8**2 - 7.4**2) + 1
    np.testing.assert_array_equal(pressed.light[away], flat.light[away])
    assert (np.abs(pressed.light - flat.light)[~away] > 0.05).any()
    np.testing.assert_array_equal(pressed.inside, flat.inside)


def test_a_slope_is_lit_by_the_cosine_law():
    # Faces at 45° that look to greater columns, to smaller ones, and to the first end.
    toward = np.array([np.cos(ELEVATION), np.sin(ELEVATION)])
    faces = {"to the light": (1, 1), "away": (-1, 1), "along": (0, 1)}
    shares = {
        name: max(0.0, float(np.dot(toward, face))) / np.sqrt(2) / np.sin(ELEVATION)
        for name, face in faces.items()
    }
    across = make_pad_appearance(
        LENGTH, WIDTH, Effects(), [Imprint("edge", 7.0, 0.0, 1.5, turn=np.pi / 2)]
    )
    at = np.array([[0.75, -0.75]], np.float32)
    light, _ = across.sample(np.full_like(at, 7.0), at)
    red, blue, green = shares["to the light"], shares["away"], GREEN * shares["along"]
    wanted = BRIGHT * np.array([[red, green, blue], [blue, green, red]])
    np.testing.assert_allclose(light[0], wanted, atol=1e-3)
    along = make_pad_appearance(LENGTH, WIDTH, Effects(), [Imprint("edge", 7.0, 0.0, 1.5)])
    light, _ = along.sample(7.0 - at, np.zeros_like(at))
    sides = shares["along"]
    wanted = BRIGHT * np.array(
        [[sides, GREEN * shares["to the light"], sides], [sides, GREEN * shares["away"], sides]]
    )
    np.testing.assert_allclose(light[0], wanted, atol=1e-3)


def test_of_several_imprints_the_deepest_counts():
    sphere, brick = Imprint("sphere", 5.0, 1.0, 0.6), Imprint("studded brick", 6.0, 0.0, 0.4)
    one, other, both = (
        make_pad_appearance(LENGTH, WIDTH, Effects(), imprints).light
        for imprints in ([sphere], [brick], [sphere, brick])
    )
    depths = [make_height_map(imprint, *grid(), STEP) for imprint in (sphere, brick)]
    # Where one is the deeper of the two at the neighbours as well, of which the slope is made.
    near = np.ones((3, 3), np.uint8)
    for light, deeper in ((one, depths[0] > depths[1]), (other, depths[1] > depths[0])):
        here = cv2.erode(deeper.astype(np.uint8), near) > 0
        assert here.sum() > 500
        np.testing.assert_allclose(both[here], light[here], atol=ROUNDING)


@pytest.mark.parametrize("excess", [3.0, 9.0])
def test_lamps_light_a_pad_as_lines_of_points_do(excess):
    away = lamp_distance(excess, WIDTH)
    look = make_pad_appearance(LENGTH, WIDTH, Effects(lamps=excess))
    along, across = np.meshgrid(np.linspace(0, LENGTH, 7), np.linspace(-WIDTH / 2, WIDTH / 2, 7))
    light = look.sample(along, across)[0]

    def sent(along: np.ndarray, across: np.ndarray) -> np.ndarray:
        """By so many points of the red lamp: each sends h / r³."""
        points = (np.arange(4000) + 0.5) / 4000 * LENGTH
        squares = (WIDTH / 2 + away - across[..., None]) ** 2 + away**2
        return np.mean(away / (squares + (along[..., None] - points) ** 2) ** 1.5, axis=-1)

    edge = sent(np.array(LENGTH / 2), np.array(WIDTH / 2))
    np.testing.assert_allclose(light[..., 0], BRIGHT * sent(along, across) / edge, rtol=2e-2)
    np.testing.assert_allclose(light[..., 2], light[::-1, :, 0], rtol=1e-3)
    long = make_pad_appearance(20 * WIDTH, WIDTH, Effects(lamps=excess))
    ends = long.sample(np.full((1, 2), 10 * WIDTH), np.array([[WIDTH / 2, 0.0]]))[0][0, :, 0]
    assert ends[0] / ends[1] == pytest.approx(1 + excess, rel=0.02)


def test_shadows_are_where_something_is_in_the_way_of_a_lamp():
    imprint, excess = Imprint("studded brick", LENGTH / 2, 0.0, 1.2), 9.0
    lit, shaded = (
        make_pad_appearance(LENGTH, WIDTH, Effects(lamps=excess, shadows=s), [imprint])
        for s in (0.0, 1.0)
    )
    away = lamp_distance(excess, WIDTH)
    row = lit.light.shape[0] // 2 + round(4.0 / STEP)
    across = (np.arange(lit.light.shape[1]) + 0.5) * STEP - MARGIN - WIDTH / 2
    along, beside = grid()
    # Of the studs as they are along this row; by trying every ray to the red lamp.
    full = make_height_map(imprint, along, beside, STEP)[row]
    hidden = np.array(
        [
            any(
                full[j] > h + (away - h) * (across[j] - x) / (WIDTH / 2 + away - x) + 1e-6
                for j in range(i + 1, len(across))
            )
            for i, (x, h) in enumerate(zip(across, full, strict=True))
        ]
    )
    bright = lit.light[row, :, 0] > 1e-3
    assert 10 < hidden[bright].sum() < 0.5 * len(across)
    dark = shaded.light[row, :, 0] == 0
    assert np.mean(dark[bright] == hidden[bright]) > 0.98


def test_lamps_in_view_are_clipped_strips_beside_the_pad():
    look = make_pad_appearance(LENGTH, WIDTH, Effects(strips=1.0))
    across = np.linspace(-WIDTH / 2 - look.margin, WIDTH / 2 + look.margin, 801)
    light = look.sample_lamps(np.full((1, 801), LENGTH / 2), across[None])[0]
    for side, color in ((1, 0), (-1, 2)):
        strip = (side * across > 0) & (light[:, color] > 1)
        assert np.ptp(across[strip]) == pytest.approx(1.0, abs=2 * STEP)
        assert WIDTH / 2 - STEP <= np.abs(across[strip]).min() <= WIDTH / 2 + GAP + STEP
        assert light[strip, color].max() == pytest.approx(LAMP)
    assert look.sample_lamps(np.full((1, 801), -0.5), across[None]).max() == 0
    assert make_pad_appearance(LENGTH, WIDTH, Effects()).lamps is None


def test_light_through_an_air_gap_is_guided_to_the_membrane():
    # Rays that fall on a wall from all sides, within it to both sides of its normal, followed to
    # where they first meet the membrane, by where they have started.
    thickness, index = 4.0, 1.49
    body = ClearBody(thickness, index, (True, False, True), ((False, False), (False, False)))
    look = make_pad_appearance(LENGTH, WIDTH, Effects(lamps=4.0), body=body)
    angles = np.arcsin((np.arange(1, 2000, 2) / 2000) / index)  # evenly by the sine: Lambert
    heights = (np.arange(400) + 0.5) / 400 * thickness
    angle, height = np.meshgrid(angles, heights)
    lands = np.concatenate(
        [(height / np.tan(angle)).ravel(), ((2 * thickness - height) / np.tan(angle)).ravel()]
    )
    count, edges = np.histogram(lands, np.arange(0, WIDTH + 1))
    direct = count / count[0]
    wanted = (direct + direct.mean()) / (1 + direct.mean())
    middles = (WIDTH / 2 - (edges[1:] + edges[:-1]) / 2).astype(np.float32)[None]
    light, _ = look.sample(np.full_like(middles, LENGTH / 2), middles)
    np.testing.assert_allclose(light[0, :, 0] / BRIGHT, wanted, rtol=0.02)
    np.testing.assert_array_equal(
        look.light[..., 1], make_pad_appearance(LENGTH, WIDTH, Effects(lamps=4.0)).light[..., 1]
    )


def test_edges_that_clear_walls_mirror_bound_nothing():
    body = ClearBody(3.0, 1.49, (False, False, False), ((True, False), (False, True)))
    inside = make_pad_appearance(LENGTH, WIDTH, Effects(), body=body).inside
    along, across = grid()
    wanted = np.minimum(LENGTH - along, across + WIDTH / 2)
    open_ = wanted > 0
    np.testing.assert_allclose(inside[open_], wanted[open_], atol=ROUNDING)
