"""Rendered images against crossings of their outlines, and effects against formulas."""

import functools
import inspect
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import root_scalar as root

from designopt.errors import UserError
from optics.chamber import Endoscope, Posture
from optics.rendering import ChamberEffects, ChamberImage, ChamberRenderer, chamber_renderer
from optics.rendering.chamber_renderer import BRIGHTEST
from tests.optics.chambers import chamber as finger
from tests.optics.soft_finger.marched import Press, Tube

COLUMNS, ROWS = 320, 240
FOCAL = 200.0
"""px: half the diagonal, for a field of view of a right angle."""

MASKS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]], np.float32)
"""Colours by which red, green and blue are what lies inside the outlines at B, C and D."""

WHITE = np.ones((4, 3), np.float32)
EVEN = ChamberEffects(gain=0.8, falloff=0.0)
TYPICAL = ChamberEffects.graded(1.0, gain=0.6)

CROSSING = 0.5
"""px: one painted pixel; half of one from rounding, and what a slanted edge adds in two of them."""

CROSSINGS = 0.15
"""px, root mean square: what is rounded to halves is off by 1/√48 = 0.14."""

BIAS = 0.05
"""px, mean, outwards."""

ROUNDED = 1.5
"""Of 255: a painted shade is rounded before the gain, at most 1.3, and the pixel after it."""

FRAMES = 288
"""For statistics: the standard deviation of twice as many numbers is known to 1/√1152 = 3 %."""

PER_REGION, ANGLES = 20, 192
TUBE = Tube.of(finger())


@pytest.fixture(autouse=True, scope="module")
def _small_chunks():
    """Most of a frame's time is that of the whole chunk that it is worked out in."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chamber_renderer, "CHUNK", 8)
        yield


def postures(*rows: tuple[float, float, float], per_region: int = PER_REGION) -> Posture:
    """Bends and directions in degrees, and depths of a press at 70 mm by an object of 20 mm."""
    arc = np.interp(np.arange(1, 3 * per_region + 1) / per_region, range(4), TUBE.arcs)
    bend, direction, depth = np.transpose(np.array(rows, float))
    pressed = [np.sign(each) * Press(70.0, 20.0, each).at(arc) for each in depth]
    return Posture(*map(jnp.asarray, (np.deg2rad(bend), np.deg2rad(direction), np.array(pressed))))


@functools.cache
def renderer(
    effects: ChamberEffects = EVEN, *, colors: str = "masks", seed: int | tuple[int, int] = 0
) -> ChamberRenderer:
    chosen = {"masks": MASKS, "white": WHITE}[colors]
    camera = Endoscope(np.pi / 2, columns=COLUMNS, rows=ROWS, distortion=-0.05)
    return ChamberRenderer(finger(), camera, effects, seed=seed, colors=chosen, angles=ANGLES)


def straight(effects: ChamberEffects, colors: str = "masks") -> np.ndarray:
    """Pixels of a straight finger."""
    return renderer(effects, colors=colors).render(STRAIGHT)[0].pixels.astype(float)


STRAIGHT = postures((0, 0, 0))
SHOWN = ((0, 0, 0), (10, 20, 0), (20, 100, 0), (25, 230, 3), (15, 300, -5), (40, 0, 0), (35, 90, 4))


@functools.cache
def shown() -> list[ChamberImage]:
    return renderer().render(postures(*SHOWN))


def take(some: Posture, start: int, stop: int) -> Posture:
    return jax.tree.map(lambda leaf: leaf[start:stop], some)


def assert_same(image: ChamberImage, other: ChamberImage) -> None:
    for each in fields(ChamberImage):
        np.testing.assert_array_equal(getattr(image, each.name), getattr(other, each.name))


def covered(image: ChamberImage, region: int) -> np.ndarray:
    """Part of every pixel that is inside an outline."""
    channel = image.pixels[..., region].astype(float)
    return channel / channel.max()


def crossings(outline: np.ndarray, row: float) -> np.ndarray:
    """Columns at which a closed outline crosses a row."""
    following = np.roll(outline, -1, axis=0)
    crossed = (outline[:, 1] > row) != (following[:, 1] > row)
    start, end = outline[crossed], following[crossed]
    part = (row - start[:, 1]) / (end[:, 1] - start[:, 1])
    return np.sort(start[:, 0] + part * (end[:, 0] - start[:, 0]))


def test_every_outline_is_inside_the_image_in_some_case():
    for region in range(3):
        assert sum(bool(image.seen[region]) and _inside(image, region) for image in shown()) >= 3


def _inside(image: ChamberImage, region: int) -> bool:
    outline = image.outlines[region]
    return bool((outline > 1).all() and (outline < [COLUMNS - 2, ROWS - 2]).all())


def edge_errors(image: ChamberImage, region: int) -> np.ndarray:
    """Outwards, px: where rows pass from dark to light, against where they cross the outline.

    Rows are compared that cross the outline steeply all over their height: the light up to the
    middle of the region is the length of the row that is inside.
    """
    outline, part = image.outlines[region], covered(image, region)
    errors = []
    for row in range(ROWS):
        ends = [crossings(outline, row + off) for off in (-0.5, -0.25, 0, 0.25, 0.5)]
        if any(len(each) != 2 for each in ends):
            continue
        left, right = np.transpose(ends)
        if max(np.ptp(left), np.ptp(right)) > 0.7 or right[2] - left[2] < 4:
            continue
        middle = round((left[2] + right[2]) / 2)
        errors.append(part[row, :middle].sum() - (middle - 0.5 - left.mean()))
        errors.append(part[row, middle:].sum() - (right.mean() - (middle - 0.5)))
    return np.array(errors)


@pytest.mark.parametrize("region", range(3))
def test_rows_become_light_where_they_cross_the_outlines(region):
    errors = np.concatenate([edge_errors(image, region) for image in shown() if image.seen[region]])
    assert len(errors) > 100
    assert np.abs(errors).max() < CROSSING
    assert np.sqrt(np.mean(errors**2)) < CROSSINGS
    assert abs(errors.mean()) < BIAS


def test_margins_are_widths_in_the_plane_of_bending():
    # Straight and unpressed, twice the radius; the distortion is apart from it.
    margins = renderer().render(STRAIGHT)[0].margins
    wanted = 2 * FOCAL * TUBE.radii[1:] / (TUBE.arcs[1:] + TUBE.pinhole)
    np.testing.assert_allclose(margins, wanted, rtol=1e-12)
    for image in shown():
        np.testing.assert_array_equal(image.seen, image.margins > 0)
        assert not image.pixels[..., ~np.asarray(image.seen)].any()
    hidden = renderer().render(postures((120, 0, 0)))[0]
    assert hidden.margins[2] < 0


MANY = postures(*[(i % 7 * 9.0, 37.0 * i % 360, i % 5 - 2.0) for i in range(11)])
"""More than are worked out at once."""


def test_frames_are_the_same_however_they_are_asked_for():
    whole = renderer(TYPICAL).render(MANY)
    assert len(whole) == 11
    assert whole[0].pixels.shape == (ROWS, COLUMNS, 3)
    for start, stop in ((5, 6), (6, 11), (10, 11)):
        images = renderer(TYPICAL).render(take(MANY, start, stop), first=start)
        for image, same in zip(images, whole[start:stop], strict=True):
            assert_same(image, same)
    # The same by a renderer that is made anew.
    assert_same(renderer.__wrapped__(TYPICAL).render(take(MANY, 0, 1))[0], whole[0])


def test_frames_and_seeds_differ():
    same = postures(*[SHOWN[1]] * 2)
    one, two = renderer(TYPICAL).render(same)
    other = renderer(TYPICAL, seed=1).render(same)[0]
    assert (one.pixels != two.pixels).any()
    assert (one.pixels != other.pixels).any()
    assert (one.outlines != two.outlines).any()


def test_effects_without_size_change_nothing():
    same = renderer(EVEN, seed=5).render(postures(SHOWN[1]), 9)[0]
    np.testing.assert_array_equal(same.pixels, shown()[1].pixels)
    assert replace(ChamberEffects.graded(0.0), gain=0.8, falloff=0.0) == EVEN


@pytest.mark.parametrize(
    "effect", [each.name for each in fields(ChamberEffects) if each.name != "gain"]
)
def test_each_effect_does_something(effect):
    size = {"falloff": 1.0, "shake": 3.0, "roll_deg": 3.0, "speckles": 30.0}.get(effect, 0.3)
    usual, plain = EVEN, shown()[1]
    if effect == "roughness":  # that of the gloss
        usual = replace(EVEN, gloss=1.0)
        plain = renderer(usual).render(postures(SHOWN[1]))[0]
    changed = renderer(replace(usual, **{effect: size})).render(postures(SHOWN[1]))[0]
    assert (changed.pixels != plain.pixels).any()
    moved = (changed.outlines != shown()[1].outlines).any()
    assert moved == (effect in ("shake", "roll_deg"))


UPRIGHT = {"bend": np.zeros(2), "direction": np.zeros(2), "pressed": np.zeros((2, 60))}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bend": [30.0, 0.0]}, r"bends are in radians, .* 30 is more; .* numpy\.deg2rad\(30\)\?"),
        ({"direction": [0.0, -90.0]}, r"directions are in radians, .* -90 is more; did you mean"),
        ({"bend": [np.nan, 0.0]}, "bends have values that are not finite"),
        ({"direction": [0.0, np.inf]}, "directions have values that are not finite"),
        ({"pressed": np.full((2, 60), np.nan)}, "pressed have values that are not"),
        ({"bend": 0.0}, r"bends have the shape \(postures\), not \(\); give arrays with one axis"),
        ({"direction": np.zeros(3)}, r"directions have the shape \(2\), not \(3,\)"),
        ({"pressed": np.zeros((2, 5))}, r"shape \(2, 60\), not \(2, 5\); give one in mm"),
        ({"bend": "much"}, "bends are numbers, not str"),
        ({"bend": [None, 0.0]}, "bends are numbers, not list"),
        ({"bend": [True, False]}, "bends are numbers, not list"),
        ({"bend": [[0.0], [0.0, 1.0]]}, "bends are numbers, not list"),
    ],
)
def test_postures_that_are_none_are_refused(change, words):
    # As users make them, without the run-time checks of types.
    posture = object.__new__(Posture)
    for name, value in (UPRIGHT | change).items():
        object.__setattr__(posture, name, value)
    with pytest.raises(UserError, match=words):
        inspect.unwrap(ChamberRenderer.render)(renderer(), posture)


def test_postures_within_a_turn_are_imaged():
    around = renderer().render(postures((0, 360, 0), (0, -360, 0)))
    np.testing.assert_array_equal(around[0].pixels, around[1].pixels)
    assert len(renderer().render(postures((360, 0, 0), (-360, 0, 0)))) == 2


@pytest.mark.parametrize(
    ("degrees", "distortion", "pointing", "words"),
    [*((degrees, 0.0, 0.0, "field of view") for degrees in (0.0, -20.0, 100.5, 170.0, 200.0)),
     (90.0, -0.3, 0.0, "distortion"), (60.0, 0.0, 0.6, "turned"), (60.0, 0.0, 1.2, "turned")],
)  # fmt: skip
def test_cameras_whose_rays_are_not_followed_are_refused(degrees, distortion, pointing, words):
    camera = Endoscope(np.deg2rad(degrees), distortion).turned(np.array([pointing, 0.0]), 0.0)
    with pytest.raises(ValueError, match=words):
        ChamberRenderer(finger(), camera, EVEN)


def test_light_falls_with_the_distance_from_the_lens():
    # A straight finger of white walls; along a row the wall's distance follows from its slope.
    power = 1.5
    pixels = straight(ChamberEffects(gain=0.7, falloff=power), "white")[ROWS // 2]

    def above(arc: float, slope: float) -> float:
        return np.interp(arc, TUBE.arcs, TUBE.radii) - slope * (arc + TUBE.pinhole)

    depth_b = 40.0 + TUBE.pinhole
    for column in range(175, 231, 5):
        off = (column - (COLUMNS - 1) / 2) / FOCAL
        slope = root(lambda r, off=off: r * (1 - 0.05 * r**2) - off, bracket=(0, 1)).root
        hit = above(100.0, slope) < 0
        depth = root(above, args=(slope,), bracket=(0, 100)).root if hit else 100.0
        depth += TUBE.pinhole
        # From one ring to the next, some 2 mm or 5 % away, the light is the same.
        wanted = 255 * 0.7 * min((depth_b / depth) ** power, BRIGHTEST)
        np.testing.assert_allclose(pixels[column], wanted, rtol=power * 2 / depth, atol=ROUNDED)


def test_gain_scales_the_light():
    bright = renderer(replace(EVEN, gain=0.9)).render(postures(*SHOWN[:2]))
    dim = renderer(replace(EVEN, gain=0.3)).render(postures(*SHOWN[:2]))
    for one, other in zip(bright, dim, strict=True):
        assert one.pixels.max() == pytest.approx(255 * 0.9, abs=ROUNDED)
        np.testing.assert_allclose(one.pixels / 3.0, other.pixels, atol=2 / 3 + 1e-6)  # roundings
    over = straight(replace(EVEN, gain=3.0))
    assert over.max() == 255
    assert not over[0].any()


def test_light_is_lost_in_the_corners_and_away_from_the_lamp():
    vignetted = straight(replace(EVEN, vignetting=0.3), "white")
    y, x = np.mgrid[:ROWS, :COLUMNS] - np.array([(ROWS - 1) / 2, (COLUMNS - 1) / 2])[:, None, None]
    corner = (x**2 + y**2) / (COLUMNS**2 + ROWS**2) * 4
    wanted = 255 * 0.8 * (1 - 0.3 * corner)
    assert np.abs(vignetted - wanted[..., None]).max() < ROUNDED
    light = straight(replace(EVEN, uneven=0.4), "white")[..., 0]
    # A slope from full light at the rim near the lamp to 60 % at the other: a plane.
    plane = np.stack([np.ones(x.size), x.ravel(), y.ravel()], axis=1)
    (middle, right, down), *_ = np.linalg.lstsq(plane, light.ravel(), rcond=None)
    assert np.abs(plane @ [middle, right, down] - light.ravel()).max() < ROUNDED
    assert middle == pytest.approx(255 * 0.8 * 0.8, abs=ROUNDED)
    half = np.hypot(COLUMNS, ROWS) / 2
    assert np.hypot(right, down) * half == pytest.approx(255 * 0.8 * 0.2, abs=0.5)


def test_glare_is_a_spot_of_its_brightness():
    dim = replace(EVEN, gain=0.5)
    added = (straight(replace(dim, glare=0.4)) - straight(dim))[..., 2]
    assert added.max() == pytest.approx(255 * 0.5 * 0.4, abs=ROUNDED)
    assert (added > 1).mean() < 0.05


def test_blur_spreads_an_edge_by_its_standard_deviation():
    def spread(effects: ChamberEffects) -> float:
        # The middle rows cross the outline of B at a right angle.
        rows = straight(effects)[ROWS // 2 - 4 : ROWS // 2 + 4, COLUMNS // 2 :, 0]
        weights = -np.diff(rows.mean(axis=0))
        place = np.arange(len(weights))
        mean = (weights * place).sum() / weights.sum()
        return float((weights * (place - mean) ** 2).sum() / weights.sum())

    for size in (0.8, 2.0):
        variance = spread(replace(EVEN, blur=size)) - spread(EVEN)
        assert np.sqrt(variance) == pytest.approx(size, rel=0.05)


@pytest.mark.parametrize("gain", [0.3, 0.7])
def test_noise_is_that_of_photons_and_of_reading(gain):
    size = 0.03
    effects = ChamberEffects(gain=gain, falloff=0.0, noise=size)
    images = renderer(effects, colors="white").render(postures(*[(0, 0, 0)] * 6))
    stack = np.stack([image.pixels for image in images]).astype(float)
    level = 255 * gain
    # Photons: the light's square root; reading: a fifth; and a twelfth for rounding to integers.
    wanted = np.sqrt((size * 255) ** 2 * (gain + 0.2**2) + 1 / 12)
    assert stack.mean() == pytest.approx(level, abs=ROUNDED)
    assert stack.std() == pytest.approx(wanted, rel=0.01)
    # Of one frame and the next, and of two colours, it is not the same.
    samples = (stack - stack.mean()).reshape(6, -1, 3)
    frames = np.corrcoef(samples[..., 0])
    colors = np.corrcoef(samples[0].T)
    assert np.abs(frames - np.eye(6)).max() < 0.02  # 1/√76 800 is 0.004
    assert np.abs(colors - np.eye(3)).max() < 0.02


def moved(effects: ChamberEffects) -> np.ndarray:
    """Outlines at B of many frames of a straight finger, about the middle of the image."""
    camera = Endoscope(np.pi / 2, columns=COLUMNS // 8, rows=ROWS // 8)
    small = ChamberRenderer(finger(), camera, effects, per_region=2, angles=32)
    still = postures(*[(0, 0, 0)] * FRAMES, per_region=2)
    images = small.render(still)
    return np.stack([image.outlines[0] for image in images]) - camera.center


def test_shake_moves_outlines_by_its_standard_deviation():
    size = 0.5
    centers = moved(ChamberEffects(shake=size)).mean(axis=1)
    # About the axis an image moves by f tan of the angle; the outline's middle by 5 % more, where
    # it is imaged 0.26 f off the axis: 1 + 3/4 · 0.26².
    np.testing.assert_allclose(centers.std(axis=0), size * 1.05, rtol=0.1)
    assert np.abs(centers.mean(axis=0)).max() < 4 * size / np.sqrt(FRAMES)
    assert abs(np.corrcoef(centers.T)[0, 1]) < 4 / np.sqrt(FRAMES)


def test_roll_turns_outlines_by_its_standard_deviation():
    size = 2.0
    outlines = moved(ChamberEffects(roll_deg=size)) @ [1, 1j]
    turn = np.angle((outlines * np.conj(outlines[0])).sum(axis=1))
    assert np.rad2deg(turn).std() == pytest.approx(size, rel=0.15)
    turned = np.abs(outlines) - np.abs(outlines[0])
    assert np.abs(turned).max() < 1e-9


def test_more_rings_than_a_byte_can_number_are_refused():
    camera = Endoscope(np.pi / 3, columns=COLUMNS, rows=ROWS)
    for number in (0, 86):
        with pytest.raises(ValueError, match="per_region"):
            ChamberRenderer(finger(), camera, EVEN, per_region=number)
    most = ChamberRenderer(finger(), camera, EVEN, per_region=85, angles=32)
    row = most.render(postures((0, 0, 0), per_region=85))[0].pixels[120]
    assert row[160].max() < row[130].max()  # the top, the last to be painted


def test_a_camera_that_is_mounted_askew_stays_so():
    camera = Endoscope(np.deg2rad(60.0))
    ahead, askew = (
        ChamberRenderer(finger(), one, EVEN).render(STRAIGHT)[0].outlines[0].mean(axis=0)
        for one in (camera, camera.turned(np.array([0.1, 0.0]), 0.0))
    )
    # Turned to the right by 0.1, the camera images what was ahead at a tangent to its left.
    shift = float(camera.focal_px) * np.tan(0.1)
    assert ahead[0] - askew[0] == pytest.approx(shift, rel=0.05)
    assert askew[1] == pytest.approx(ahead[1], abs=1e-6)


def test_frames_are_the_same_from_several_threads():
    several = renderer(TYPICAL, seed=(3, 1))
    one_by_one = [take(MANY, i, i + 1) for i in range(4)]
    with ThreadPoolExecutor(4) as pool:
        threaded = list(pool.map(several.render, one_by_one, range(4)))
    for image, (other,) in zip(several.render(take(MANY, 0, 4)), threaded, strict=True):
        assert_same(image, other)


def test_single_precision_is_good_to_a_hundredth_of_a_pixel():
    def outlines() -> np.ndarray:
        renderer = ChamberRenderer(finger(), Endoscope(np.deg2rad(60.0)), EVEN)
        bends = jnp.deg2rad(jnp.asarray([0.0, 0.01, 40.0, 110.0]))
        images = renderer.render(Posture(bends, jnp.ones(4), jnp.zeros((4, 60))))
        return np.stack([image.outlines[:2] for image in images])

    with jax.enable_x64(False):
        single = outlines()
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, outlines(), atol=0.01)
