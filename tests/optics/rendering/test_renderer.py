"""Rendered images against rays that are followed through the section, one for every pixel."""

import functools
import inspect

import cv2
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.errors import UserError
from optics.rendering import Effects, Imprint, Renderer, TactileImage
from optics.rendering.pads import BRIGHT, GREEN
from optics.scene.camera import Sensor
from optics.scene.fabrication import Fabrication, perturb
from optics.scene.scene import Scene
from optics.visibility.boundary_codes import FIRST_PAD_END, LEFT_LIMIT, RIGHT_LIMIT, SECOND_PAD_END
from optics.visibility.tracing import trace_rays
from optics.visibility.unfolding import paths_of
from optics.visibility.views import name_paths
from tests.optics.extruded import POSES, finger, imaged, looked, unfolded, views_at_poses
from tests.optics.scenes import pairs, posed

ROWS, COLUMNS, WIDTH = 240, 320, 20.0
HALF_VIEW = float(finger().camera.field_of_view) / 2
PADS = [pad.name for pad in finger().layout.pads]
PATHS = name_paths(finger().layout)
WORDS = paths_of(finger().layout, finger().layout.bounces)

BODY = 0
"""The blocker that the camera carries."""

ERRORS = Fabrication(
    camera=np.array([0.3, -0.2]),
    lateral=1.5,
    tilt=0.03,
    mirror_tilt=np.array([0.01, -0.02]),
    mirror_offset=np.array([0.2, -0.1]),
    pad_tilt=np.array([0.01, 0.02, -0.01]),
    pad_offset=np.array([0.1, -0.2, 0.3]),
    pad_shift=np.array([0.2, 0.3, -0.4]),
)

PLAIN = Effects()

ROUNDED = 0.5 + 1e-3
"""Between a stored pixel and its light, apart from rounding of that in float32."""

CORNER = 0.4
"""What the bend of a view's sides and the samples of a pad, 0.1 mm apart, take of a corner, px."""

BOTH_WAYS = 3
"""The pose in which the distal pad is seen directly and by its mirror."""

every_pose = pytest.mark.parametrize("index", range(len(POSES)))
both_fingers = pytest.mark.parametrize("errors", [None, ERRORS], ids=["designed", "made"])


@functools.cache
def renderer(
    effects: Effects, *, seed: int = 0, flawed: bool = False, rows: int = ROWS
) -> Renderer:
    errors = ERRORS if flawed else None
    return Renderer(finger(), WIDTH, effects, errors=errors, carried=(BODY,), rows=rows, seed=seed)


@functools.cache
def image(index: int, effects: Effects = PLAIN, *, flawed: bool = False) -> TactileImage:
    return renderer(effects, flawed=flawed).render(POSES[index])


@functools.cache
def made() -> Scene:
    return perturb(finger(), ERRORS, carried=(BODY,))


def pixels() -> np.ndarray:
    """Places of all pixels."""
    return np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).astype(float)


@functools.cache
def rays() -> np.ndarray:
    """Section angle and lateral slope of all pixels."""
    return looked(pixels(), HALF_VIEW, ROWS, COLUMNS)


def placed(places: np.ndarray, beside: np.ndarray | float) -> np.ndarray:
    """Where places, complex and from the camera, so far beside the section are imaged."""
    slope = beside / np.abs(places)
    return imaged(np.angle(places), slope, lambda angle: angle, HALF_VIEW, ROWS, COLUMNS)


def met(scene: Scene, index: int, lateral: float) -> tuple[np.ndarray, np.ndarray]:
    """The pad that the ray of each pixel meets first and the path there; −1 if none."""
    angle, slope = np.moveaxis(rays().reshape(-1, 2), -1, 0)
    section = posed(scene, POSES[index])
    positions = jnp.tile(jnp.asarray(pairs(section.position)), (len(angle), 1))
    directions = jnp.asarray(section.direction + angle)
    hits = trace_rays(scene, jnp.asarray(POSES[index]), positions, directions, bounces=1)
    mirrored = np.asarray(hits.reflected)[:, 0]
    each, last = np.arange(len(angle)), mirrored.astype(int)
    surface, active, length = (
        np.asarray(leaf)[each, last] for leaf in (hits.surface, hits.active, hits.length)
    )
    pad = surface - len(scene.layout.mirrors)
    seen = active & (pad >= 0) & (pad < len(PADS))
    seen &= np.abs(slope * length + lateral) <= WIDTH / 2
    path = np.where(mirrored, np.asarray(hits.surface)[:, 0] + 1, 0)
    shape = ROWS, COLUMNS
    return np.where(seen, pad, -1).reshape(shape), np.where(seen, path, -1).reshape(shape)


def alike(labels: np.ndarray, reach: int = 1) -> np.ndarray:
    """Where all pixels about a pixel have its label; those at the border of the image may not."""
    around = np.lib.stride_tricks.sliding_window_view(labels, (2 * reach + 1, 2 * reach + 1))
    here = np.zeros(labels.shape, bool)
    here[reach:-reach, reach:-reach] = around.min(axis=(2, 3)) == around.max(axis=(2, 3))
    return here


@both_fingers
@every_pose
def test_every_pixel_is_labelled_with_the_pad_that_its_ray_meets(index, errors):
    flawed = errors is not None
    scene, lateral = (made(), float(errors.lateral)) if flawed else (finger(), 0.0)
    found = image(index, flawed=flawed)
    pad, path = met(scene, index, lateral)
    wanted = np.zeros((ROWS, COLUMNS), int)
    for label, view in enumerate(found.views, 1):
        wanted[(pad == PADS.index(view.pad)) & (path == PATHS.index(view.path))] = label
    # Apart from outlines, and from what is beyond the field of view in the section.
    clear = alike((pad + 1) * len(PATHS) + path) & (np.abs(rays()[..., 0]) < HALF_VIEW)
    assert (wanted[clear & (pad >= 0)] > 0).all()
    np.testing.assert_array_equal(found.labels[clear], wanted[clear])
    whole = [label for label, view in enumerate(found.views, 1) if view.complete]
    assert len(np.unique(wanted[clear])) >= min(3, len(whole))


@both_fingers
@every_pose
def test_corners_of_whole_views_are_those_of_their_labels(index, errors):
    found = image(index, flawed=errors is not None)
    for label, view in enumerate(found.views, 1):
        if not view.complete:
            continue
        rows, columns = np.nonzero(found.labels == label)
        seen = columns + 1j * rows
        corners = view.corners @ [1, 1j]
        before, after = np.roll(corners, 1) - corners, np.roll(corners, -1) - corners
        before, after = before / np.abs(before), after / np.abs(after)
        half = np.abs(np.angle(before / after)) / 2
        # A circle that touches both sides of a corner holds a pixel if its radius is √½.
        nearest = np.abs(seen[:, None] - corners).min(axis=0)
        assert (nearest < np.sqrt(0.5) / np.sin(half) + CORNER).all()
        # And no pixel is outside of it.
        outward = -(before + after)
        beyond = ((seen[:, None] - corners) * np.conj(outward / np.abs(outward))).real
        assert beyond.max() < CORNER


@every_pose
def test_views_are_whole_and_at_the_border_as_is_found_by_search(index):
    pieces = views_at_poses().value
    here = {}
    for pad, piece in np.argwhere(pieces.present[index]):
        at = index, pad, piece
        ends = int(pieces.start_label[at]), int(pieces.end_label[at])
        view = PADS[pad], PATHS[pieces.path[at]]
        # What is hardly higher than a pixel may hold no pixel's middle.
        if abs(np.diff(pieces.pixels[at])[0]) > 1.5:
            here.setdefault(view, []).append(ends)
    shown = image(index)
    assert set(here) <= {(view.pad, view.path) for view in shown.views}
    for view in shown.views:
        ends = here.get((view.pad, view.path), [])
        assert view.complete == ((FIRST_PAD_END, SECOND_PAD_END) in ends)
        limits = {LEFT_LIMIT, RIGHT_LIMIT}
        assert view.at_border == any(limits & set(both) for both in ends)
        assert view.reflections == len(WORDS[PATHS.index(view.path)])


def test_what_is_flatter_than_a_design_counts_is_shown_but_not_whole():
    # Of the distal pad all is, of the proximal one its first end.
    for index, pad in ((4, "distal"), (BOTH_WAYS, "proximal")):
        section = posed(finger(), POSES[index])
        ends = section.ends[2 + PADS.index(pad)]
        rays_to_ends = (ends - section.position) / (ends[1] - ends[0])
        flattest = np.abs(np.angle(rays_to_ends**2) / 2).min()
        assert flattest < float(finger().grazing[PADS.index(pad)])
        view = image(index).view(pad, "direct")
        assert view is not None
        assert not view.complete
        assert (image(index).labels == image(index).views.index(view) + 1).any()
    unlimited = eqx.tree_at(lambda scene: scene.grazing, finger(), jnp.zeros(3))
    view = Renderer(unlimited, WIDTH, PLAIN, rows=ROWS).render(POSES[4]).view("distal", "direct")
    assert view is not None
    assert view.complete


def test_an_image_says_what_it_shows():
    found = image(BOTH_WAYS, flawed=True)
    assert found.pixels.shape == (ROWS, COLUMNS, 3)
    assert found.labels.shape == (ROWS, COLUMNS)
    np.testing.assert_array_equal(found.angles, POSES[BOTH_WAYS])
    assert found.errors is ERRORS
    assert found.labels.max() <= len(found.views)
    for view in found.views:
        assert found.view(view.pad, view.path) is view
    assert found.view("distal", "mirror:proximal") is None
    seen = {(view.pad, view.path) for i in range(len(POSES)) for view in image(i).views}
    assert {(pad, "direct") for pad in PADS} < seen
    assert {(pad, f"mirror:{pad}") for pad in ("proximal", "distal")} < seen
    order = [(PATHS.index(view.path), PADS.index(view.pad)) for view in found.views]
    assert order == sorted(order)


# In the other pose there is a sliver of a view that fills no pixel.
@pytest.mark.parametrize("index", [0, 4])
def test_without_effects_there_is_the_light_of_pads_and_nothing_else(index):
    found = image(index)
    flat = alike(found.labels, 2)
    assert not found.pixels[flat & (found.labels == 0)].any()
    wanted = 255 * BRIGHT * np.array([1, GREEN, 1])
    inside = found.pixels[flat & (found.labels > 0)].astype(float)
    assert len(inside) > 1000
    assert np.abs(inside - wanted).max() < ROUNDED


@pytest.mark.parametrize("index", [0, 2])
def test_light_is_lost_by_mirrors_on_other_phalanges_and_beside_the_axis(index):
    effects = Effects(dim_outer=0.3, mirror_loss=0.1, vignetting=0.25, gain=1.1)
    found = image(index, effects)
    np.testing.assert_array_equal(found.labels, image(index).labels)
    off = np.hypot(*np.moveaxis(pixels() - [(COLUMNS - 1) / 2, (ROWS - 1) / 2], -1, 0))
    forward = np.maximum(np.cos(off * 2 * HALF_VIEW / ROWS), 0)
    flat = alike(found.labels, 2)
    for label, view in enumerate(found.views, 1):
        here = flat & (found.labels == label)
        light = 1.1 * BRIGHT * 0.9**view.reflections * (1 if view.pad == "intermediate" else 0.7)
        wanted = 255 * light * (1 - 0.25 * (1 - forward[here]))[:, None] * [1, GREEN, 1]
        np.testing.assert_allclose(found.pixels[here], wanted, atol=ROUNDED)
    assert not found.pixels[flat & (found.labels == 0)].any()


def test_beyond_the_image_circle_of_a_lens_it_is_dark():
    focal = 1.2 / HALF_VIEW  # mm, on pixels of 10 µm: the image is that of the finger above
    sensor = Sensor(np.array([2.4, 3.2]), COLUMNS / ROWS, focal, image_circle=2.0)
    scene = eqx.tree_at(
        lambda scene: (scene.camera.sensor, scene.camera.field_of_view),
        finger(),
        (sensor, jnp.asarray(2.0 / focal)),
        is_leaf=lambda leaf: leaf is None,
    )
    shown = Renderer(scene, WIDTH, Effects(ambient=0.2), rows=ROWS).render(POSES[0])
    row, column = np.indices((ROWS, COLUMNS))
    lit = np.hypot(row - (ROWS - 1) / 2, column - (COLUMNS - 1) / 2) <= 100
    assert (shown.labels[~lit] == 0).all()
    assert (shown.pixels[~lit] == 0).all()
    np.testing.assert_array_equal(shown.labels[lit] > 0, image(0).labels[lit] > 0)
    assert (shown.pixels[lit].max(axis=-1) > 0).all()


def test_the_inside_of_a_finger_is_dim_and_blotchy():
    effects = Effects(ambient=0.2)
    one, again, other = (
        renderer(effects, seed=seed).render(POSES[0], frame=frame)
        for seed, frame in ((0, 0), (0, 1), (1, 0))
    )
    background = alike(one.labels, 2) & (one.labels == 0)
    shown = one.pixels[background] / 255
    assert 0.5 * 0.2 - 0.5 / 255 <= shown.min() < shown.max() <= 0.2 + 0.5 / 255
    assert shown.std() > 0.01
    steps = np.abs(np.diff(one.pixels.astype(int), axis=1))[background[:, 1:] & background[:, :-1]]
    assert steps.max() <= 2  # broad
    np.testing.assert_array_equal(one.pixels, again.pixels)
    assert (one.pixels != other.pixels)[background].any()
    pads = alike(one.labels, 2) & (one.labels > 0)
    difference = one.pixels[pads].astype(float) - image(0).pixels[pads]
    assert np.abs(difference).max() <= 1  # as half of a step is rounded


def test_frames_differ_in_their_noise_alone():
    effects = Effects(noise=0.02, roughness=0.1)
    finger_0 = renderer(effects)
    one, same, other = (finger_0.render(POSES[1], frame=frame) for frame in (3, 3, 4))
    np.testing.assert_array_equal(one.pixels, same.pixels)
    assert (one.pixels != other.pixels).mean() > 0.2
    np.testing.assert_array_equal(one.labels, other.labels)
    # Made anew, it is the same finger; with another seed it is another one.
    for seed, alike_again in ((0, True), (1, False)):
        again = Renderer(finger(), WIDTH, effects, carried=(BODY,), rows=ROWS, seed=seed)
        found = again.render(POSES[1], frame=3)
        assert np.array_equal(found.pixels, one.pixels) == alike_again
        assert np.array_equal(found.labels, one.labels) == alike_again


def centre_of_change(pressed: TactileImage, view: int) -> np.ndarray:
    """Column and row about which a view differs from that without imprints."""
    change = np.abs(pressed.pixels.astype(float) - image(BOTH_WAYS).pixels).sum(axis=-1)
    change *= pressed.labels == view + 1
    assert change.sum() > 100
    return (pixels() * change[..., None]).sum(axis=(0, 1)) / change.sum()


def test_mirrors_turn_imprints_along_the_pad_and_not_across_it():
    seen = [(view.pad, view.path) for view in image(BOTH_WAYS).views]
    direct, mirrored = (seen.index(("distal", path)) for path in ("direct", "mirror:distal"))
    section = posed(finger(), POSES[BOTH_WAYS])
    start, end = section.ends[2 + PADS.index("distal")]
    rows = {}
    for along in (14.0, 22.0):
        for across in (-5.0, 5.0):
            imprint = Imprint("sphere", along, across, 0.4)
            pressed = renderer(PLAIN).render(POSES[BOTH_WAYS], {"distal": [imprint]})
            np.testing.assert_array_equal(pressed.labels, image(BOTH_WAYS).labels)
            place = start + along * (end - start) / np.abs(end - start)
            for view, word in ((direct, ()), (mirrored, (0,))):
                wanted = placed(unfolded(section, word, np.array(place)), across)
                found = centre_of_change(pressed, view)
                np.testing.assert_allclose(found, wanted, atol=0.75)
                assert (found[0] > COLUMNS / 2) == (across > 0)
                rows[view, along, across] = found[1]
            elsewhere = (pressed.pixels != image(BOTH_WAYS).pixels).any(axis=-1)
            assert set(pressed.labels[elsewhere]) <= {0, direct + 1, mirrored + 1}
    for across in (-5.0, 5.0):
        assert rows[direct, 22.0, across] < rows[direct, 14.0, across] - 2
        assert rows[mirrored, 22.0, across] > rows[mirrored, 14.0, across] + 2


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        (np.array([0.5]), r"joint angles have the shape \(2\), not \(1,\); .* \(pip, dip\)"),
        (np.zeros((1, 2)), r"not \(1, 2\)"),
        (0.5, r"not \(\)"),
        (np.array([30.0, 0.2]), r"in radians, .* 30 is more; did you mean numpy\.deg2rad\(30\)\?"),
        (np.array([np.nan, 0.2]), "not finite"),
        ("pip", "joint angles are numbers, not str"),
    ],
)
def test_angles_that_are_none_of_the_joints_are_refused(angles, words):
    # As users have it, without the run-time checks of types.
    with pytest.raises(UserError, match=words):
        inspect.unwrap(Renderer.render)(renderer(PLAIN), angles)


def test_walls_are_gray_and_as_bright_as_they_reflect():
    shown = renderer(Effects(walls=0.08)).render(POSES[0])
    light = shown.pixels[alike(shown.labels, 2) & (shown.labels == 0)] / 255
    most = 0.08 * BRIGHT
    assert 0.5 * most - 0.5 / 255 <= light.min() < light.max() <= most + 0.5 / 255
    assert (np.ptp(light, axis=1) == 0).all()


def test_out_of_focus_a_view_is_spread_by_its_distance():
    """Light past an edge is that of the disc beyond it, the edge being straight."""
    sharp, spread = (renderer(Effects(defocus=size)).render(POSES[0]) for size in (0.0, 60.0))
    np.testing.assert_array_equal(sharp.labels, spread.labels)
    changed = np.abs(sharp.pixels.astype(int) - spread.pixels).max(axis=-1) > 2
    edges = ~alike(sharp.labels, 1)
    assert changed.any()
    reach = cv2.dilate(edges.astype(np.uint8), np.ones((13, 13), np.uint8)) > 0
    assert not (changed & ~reach).any()
    # No light is lost.
    total, whole = spread.pixels[..., 0].sum(dtype=float), sharp.pixels[..., 0].sum(dtype=float)
    assert total == pytest.approx(whole, rel=0.02)


def test_lamps_in_view_are_beside_pads_and_no_part_of_them():
    shown, plain = (renderer(Effects(strips=size)).render(POSES[0]) for size in (1.0, 0.0))
    np.testing.assert_array_equal(shown.labels, plain.labels)
    lamps = (shown.pixels == 255).any(axis=-1)
    assert lamps.sum() > 100
    assert (shown.labels[lamps] == 0).mean() > 0.9
    beside = alike(shown.labels, 2) & (shown.labels > 0)
    np.testing.assert_array_equal(shown.pixels[beside], plain.pixels[beside])
