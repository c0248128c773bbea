"""Pads under clear layers: views beside brute-force rays, closed forms and 40-digit roots."""

import math
import tomllib
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from designopt import UserError
from optics import (
    Imaging,
    Scene,
    describe_end,
    find_corners,
    find_coverage,
    find_outlines,
    find_views,
    format_scene,
    parse_scene,
    trace_views,
)
from optics.visibility import boundary_codes as codes
from optics.visibility.outlines import CORNERS
from optics.visibility.refraction import least_grazing, transmission
from optics.visibility.unfolding import paths_of
from studies.oracles import layers
from studies.oracles.layered_scenes import random_scene
from tests.helpers import check_gradients

ROUNDING = 1e-12
ENDS = 1e-6
"""Of a pad: how far the rays of the oracle may end from the library's views."""

EDGE_ON = 1e-5
"""rad: a view so narrow may be rounding."""

SLOPES = 1e-6
"""Relative: what central differences leave."""

ACRYLIC = {"thickness": 3.0, "index": 1.49}
GEL = {"thickness": 2.0, "index": 1.41}
NO_ANGLES = jnp.zeros(0)

# Most of the time is compiling, so tests share programs.
find = jax.jit(lambda scene: find_views(scene, NO_ANGLES))
outlines_of = jax.jit(lambda scene: find_outlines(scene, NO_ANGLES))


def tables(*layers: dict, camera=(2.0, 12.0), direction=-80.0, **pad) -> dict:
    """A camera over a pad, a mirror beside it, and a second, bare pad."""
    own = {"layers": list(layers)} if layers else {}
    first = {"name": "wide", "from": [0.0, 0.0], "to": [20.0, 0.0], "side": "left"}
    return {
        "scene": {"bounces": 1},
        "camera": {
            "position": list(camera),
            "direction_deg": direction,
            "fov_deg": 170.0,
            "pixels": 1000,
        },
        "mirrors": [{"name": "lid", "from": [30.0, 20.0], "to": [35.0, 2.0], "side": "right"}],
        "pads": [
            first | own | pad,
            {"name": "bare", "from": [-30.0, 6.0], "to": [-30.0, 0.0], "side": "left"},
        ],
    }


def alone(file: dict) -> dict:
    """The same without the mirror and the second pad."""
    return file | {"scene": {"bounces": 0}, "mirrors": [], "pads": file["pads"][:1]}


def scene(*layers: dict, **more) -> Scene:
    return parse_scene(tables(*layers, **more))


def assert_same_views(one, other, **tolerance) -> None:
    for name in ("present", "path", "start", "end", "pixels", "px_per_mm", "distance", "spans"):
        first, second = (np.asarray(getattr(found.value, name)) for found in (one, other))
        np.testing.assert_allclose(first, second, err_msg=name, **tolerance)
    np.testing.assert_allclose(one.margin, other.margin, **tolerance)


def test_layers_of_index_1_are_no_layers():
    air = {"thickness": 3.0, "index": 1.0, "overhang": 15.0}
    assert_same_views(find(scene(air)), find(scene()), rtol=ROUNDING, atol=ROUNDING)


def test_two_layers_of_one_index_are_one():
    halves = [{"thickness": part, "index": 1.49} for part in (1.0, 2.0)]
    assert_same_views(
        find(scene(*halves)), find(scene(ACRYLIC)), rtol=ROUNDING, atol=1e3 * ROUNDING
    )


def pieces_of(layered: Scene, found) -> list[tuple]:
    """Pad, path, entrance and ends of all pieces, as the oracle names them."""
    words = paths_of(layered.layout, layered.layout.bounces)
    pieces = []
    for pad, piece in zip(*np.nonzero(found.present), strict=True):
        faces = [f for f in layered.layout.bodies if f.kind == "clear" and f.pad == pad]
        kinds = layered.layout.layers
        entrance = "outer" if kinds and kinds[pad] else "membrane"
        face = 0 if found.face is None else found.face[pad, piece]
        if face:
            entrance = f"{('from', 'to')[faces[face - 1].end]} {faces[face - 1].layer}"
        ends = float(found.start[pad, piece]), float(found.end[pad, piece])
        pieces.append((int(pad), words[found.path[pad, piece]], entrance, *ends))
    return sorted(piece for piece in pieces if piece[4] - piece[3] > ENDS)


def check_structure(structure: int, count: int) -> None:
    """Compare random scenes of one structure with rays."""
    rng = np.random.default_rng([structure, 7])
    assert_views_are_shown([random_scene(rng, structure) for _ in range(count)])


def assert_views_are_shown(drawn: list[tuple[layers.Scene, dict]]) -> None:
    """Compare scenes of one structure with rays."""
    scenes = [parse_scene(table) for _, table in drawn]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes)
    found = jax.jit(jax.vmap(lambda scene: find_views(scene, NO_ANGLES)))(stacked)
    assert all(
        np.isfinite(leaf).all()
        for leaf in jax.tree.leaves(found)
        if jnp.issubdtype(leaf.dtype, jnp.floating)
    )
    for i, (plain, _) in enumerate(drawn):
        pieces = pieces_of(scenes[i], jax.tree.map(lambda x, i=i: np.asarray(x[i]), found.value))
        # More rays find what lies between the rays of a coarse fan.
        for rays in (2000, 20_000, 200_000):
            shown = sorted(
                (run.pad, tuple(run.word), run.entrance, min(run.at), max(run.at))
                for run in layers.runs(plain, rays)
                if max(run.at) - min(run.at) > ENDS
            )
            if [piece[:3] for piece in pieces] == [piece[:3] for piece in shown]:
                break
        assert [piece[:3] for piece in pieces] == [piece[:3] for piece in shown], i
        for piece, run in zip(pieces, shown, strict=True):
            np.testing.assert_allclose(piece[3:], run[3:], atol=ENDS, err_msg=str(i))
    present, paths = (np.asarray(of) for of in (found.value.present, found.value.path))
    seen = np.zeros(found.margin.shape, bool)
    for i, pad, piece in zip(*np.nonzero(present), strict=True):
        seen[i, paths[i, pad, piece], pad] = True
    margin = np.asarray(found.margin)
    assert np.all((seen == (margin > 0)) | (np.abs(margin) < EDGE_ON))


def test_random_scenes_show_what_rays_show():
    # Clear ends, two mirrors seen twice, and blockers.
    check_structure(1, 40)


@pytest.mark.nightly
@pytest.mark.parametrize("structure", range(20))
def test_ten_thousand_random_scenes(structure):
    check_structure(structure, 500)


def seen_numbers(layered: Scene) -> jax.Array:
    """All that views consist of, with weights, as one number."""
    found = find_views(layered, NO_ANGLES)
    view, margin = found.value, found.margin
    per_end = view.pixels / 100 + view.px_per_mm / 10 + view.distance / 10
    return jnp.sum(view.start - 0.7 * view.end) + jnp.sum(per_end) + jnp.sum(margin)


numbers_and_slopes = jax.jit(jax.value_and_grad(seen_numbers))


def check_slopes(function, design) -> None:
    numbers, restored = ravel_pytree(design)

    def of_entries(entries: list[jax.Array]) -> jax.Array:
        return function(restored(jnp.stack(entries)))

    check_gradients(of_entries, list(numbers[:, None]), rtol=SLOPES, atol=SLOPES)


@pytest.mark.parametrize("mirrored", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_slopes_of_views(mirrored):
    clear = ACRYLIC | {"sides": "clear", "overhang": 0.4, "bevel_deg": 8}
    file = tables(clear, GEL | {"overhang": [2.0, 1.0]}, camera=(-5.0, 8.0), min_grazing_deg=3.0)
    layered = parse_scene(file | {"pads": file["pads"][:1]} if mirrored else alone(file))
    view = find(layered).value
    assert {0, 1} <= set(view.face[view.present].tolist())
    check_slopes(seen_numbers, layered)


def test_slopes_of_views_through_outermost_surfaces_and_by_a_mirror():
    layers = ACRYLIC | {"bevel_deg": 8}, GEL | {"overhang": [1.0, 2.0]}
    file = tables(*layers, min_grazing_deg=3.0)
    layered = parse_scene(file | {"pads": file["pads"][:1]})
    assert bool(find(layered).value.present.any())
    check_slopes(seen_numbers, layered)


@pytest.mark.parametrize(
    "clear", [0, *(pytest.param(n, marks=pytest.mark.nightly) for n in (1, 2))]
)
def test_slopes_of_margins(clear):
    """The view through layers that overhang one another, from beside both ends of the pad."""
    layers = [ACRYLIC | {"overhang": 0.4}, GEL | {"overhang": 2.0}]
    layers = [of | {"sides": "clear"} if i == clear else of for i, of in enumerate(layers)]
    aside = alone(tables(*layers, camera=(-10.0, 3.0), direction=0.0))
    layered, rng = parse_scene(aside), np.random.default_rng(0)
    places = np.stack([rng.uniform(-12, -5, 100), rng.uniform(0.5, 12, 100)], axis=1)
    places[::2, 0] = 20 - places[::2, 0]

    def margin(place: jax.Array) -> jax.Array:
        direction = jnp.where(place[0] > 10, jnp.pi, 0.0)
        camera = replace(layered.camera, position=place, direction=direction)
        return find_views(replace(layered, camera=camera), NO_ANGLES).margin[0, 0]

    margins, step = jax.jit(jax.vmap(margin)), 1e-5 * np.eye(2)
    slopes = jax.jit(jax.vmap(jax.grad(margin)))(jnp.asarray(places))
    ends = [[margins(jnp.asarray(places + sign * way)) for sign in (1, -1)] for way in step]
    differences = np.stack([(after - before) / 2e-5 for after, before in ends], axis=1)
    np.testing.assert_allclose(slopes, differences, atol=1e-7)


@pytest.mark.nightly
@pytest.mark.parametrize("structure", range(20))
def test_slopes_of_random_scenes(structure):
    rng = np.random.default_rng([structure, 8])
    drawn = [parse_scene(random_scene(rng, structure)[1]) for _ in range(100)]
    scenes = jax.tree.map(lambda *leaves: jnp.stack(leaves), *drawn)

    def off(leaf: jax.Array, low: float, high: float) -> jax.Array:
        return leaf + rng.uniform(low, high, leaf.shape)

    # A design whose ends are exactly flush is a kink.
    flush = lambda scenes: (scenes.layers.overhang, scenes.layers.bevel)  # noqa: E731
    overhang, bevel = flush(scenes)
    scenes = eqx.tree_at(flush, scenes, (off(overhang, 0.01, 0.1), off(bevel, -0.02, 0.02)))

    def ends(scene: Scene) -> tuple[jax.Array, tuple[jax.Array, ...]]:
        view = find_views(scene, NO_ANGLES).value
        weights = jnp.linspace(0.5, 1.5, view.start.shape[1])
        number = jnp.sum(view.start @ weights + view.end @ (2 - weights))
        return number, (view.present, view.path, view.start_label, view.end_label)

    (_, bounds), slopes = jax.jit(jax.vmap(jax.value_and_grad(ends, has_aux=True)))(scenes)
    direction = jax.tree.map(lambda leaf: rng.normal(size=leaf.shape), scenes)
    parts = jax.tree.map(
        lambda slope, way: (slope * way).reshape(100, -1).sum(1), slopes, direction
    )
    slope = np.asarray(sum(jax.tree.leaves(parts)))
    assert np.isfinite(slope).all()
    found = jax.jit(jax.vmap(ends))

    def shifted(step: float) -> np.ndarray:
        """The ends a step along the direction; NaN where something else bounds a piece."""
        number, others = found(jax.tree.map(lambda a, b: a + step * b, scenes, direction))
        pairs = zip(bounds, others, strict=True)
        same = [np.all((a == b).reshape(100, -1), axis=1) for a, b in pairs]
        return np.where(np.all(same, axis=0), number, np.nan)

    def difference(step: float) -> np.ndarray:
        near, far = (shifted(part * step) - shifted(-part * step) for part in (1, 2))
        return (8 * near - far) / (12 * step)  # of fourth order

    differences = np.array([difference(step) for step in (3e-5, 1e-5, 3e-6, 1e-6, 3e-7)])
    # Between rounding and the curve's next term, where two steps agree best.
    agreement = np.abs(np.diff(differences, axis=0))
    agreement = np.where(np.isnan(agreement), np.inf, agreement)
    best = np.argmin(agreement, axis=0), np.arange(100)
    usable = np.isfinite(agreement[best])
    assert usable.mean() > 0.5
    error = np.abs(differences[1:][best] - slope) / (1 + np.abs(slope))
    assert error[usable].max() < SLOPES


def test_entries_of_layers_that_are_not_there_do_not_count():
    thin = {"name": "thin", "from": [22.0, 0.0], "to": [30.0, 0.0], "side": "left"}
    file = tables(ACRYLIC, GEL, camera=(-4.0, 9.0))
    plain = parse_scene(alone(file) | {"pads": [*file["pads"], thin | {"layers": [GEL]}]})
    assert plain.layers is not None
    value, slopes = numbers_and_slopes(plain)
    mine = slopes.layers
    # The first pad has both layers, the second none, the third one; and none has a bezel.
    assert bool(jnp.all(mine.thickness[0] != 0))
    assert mine.thickness[2, 0] != 0
    absent = [(leaf[1], leaf[2, 1]) for leaf in (mine.thickness, mine.index, mine.overhang)]
    absent += [(mine.bevel[1], mine.bevel[2, 1]), mine.lip, mine.height, mine.transmission[1]]
    assert all(not np.any(leaf) for leaf in jax.tree.leaves(absent))

    def changed(leaf: jax.Array) -> jax.Array:
        return leaf.at[1].set(1.3).at[2, 1].set(1.3) if leaf.ndim > 1 else leaf

    moved = jax.tree.map(changed, plain.layers)
    ones = jnp.ones_like(moved.lip), jnp.ones_like(moved.height), moved.transmission.at[1].set(0.5)
    moved = eqx.tree_at(
        lambda layers: (layers.lip, layers.height, layers.transmission), moved, ones
    )
    assert numbers_and_slopes(eqx.tree_at(lambda scene: scene.layers, plain, moved))[0] == value


def test_views_stay_finite_down_to_grazing_incidence():
    for height in 10.0 ** np.arange(-9, 1):
        file = tables(ACRYLIC, GEL, camera=(2.0, 5.0 + height), min_transmission=0.0)
        value, slopes = numbers_and_slopes(parse_scene(alone(file)))
        leaves = [leaf for leaf in jax.tree.leaves(slopes) if leaf.size]
        assert np.isfinite(value)
        assert all(np.isfinite(leaf).all() for leaf in leaves)


def snell_slope(height: float, layers: list[tuple[float, float]], along: float) -> mpmath.mpf:
    """Tangent of the angle in air of the ray that goes so far along, in 40 digits."""
    with mpmath.workdps(40):

        def missed(sine):
            inside = sum(t * sine / mpmath.sqrt(mpmath.mpf(n) ** 2 - sine**2) for t, n in layers)
            return height * sine / mpmath.sqrt(1 - sine**2) + inside - along

        sine = mpmath.findroot(
            missed, (0, mpmath.mpf(1) - mpmath.mpf(10) ** -30), solver="anderson"
        )
        return sine / mpmath.sqrt(1 - sine**2)


def test_corners_are_where_snells_law_puts_them():
    layered, width, lateral = scene(ACRYLIC, GEL), 24.0, 1.5
    imaging = Imaging.of(layered.camera)
    outlines = outlines_of(layered)
    corners = np.asarray(find_corners(imaging, outlines, width, lateral))
    for corner, (end, side) in enumerate(CORNERS):
        along, beside = 20.0 * end - 2.0, side * width / 2 - lateral
        way = math.hypot(along, beside)
        slope = float(snell_slope(7.0, [(3.0, 1.49), (2.0, 1.41)], way))
        ray = np.array([along / way * slope, -1.0, beside / way * slope])
        axis = np.array([math.cos(math.radians(-80)), math.sin(math.radians(-80)), 0.0])
        # An equidistant lens: the radius in the image is the angle from the axis, times the scale.
        theta = math.acos(ray @ axis / np.linalg.norm(ray))
        up = np.array([-axis[1], axis[0], 0.0]) @ ray
        radius = 1000 / math.radians(170) * theta / math.hypot(up, ray[2])
        wanted = imaging.columns / 2 - 0.5 + radius * ray[2], 499.5 - radius * up
        np.testing.assert_allclose(corners[0, 0, corner], wanted, atol=1e-8)


def test_ends_of_views_are_on_the_outlines():
    layered = scene(ACRYLIC | {"overhang": 1}, GEL)
    found, outlines = find(layered), outlines_of(layered)
    view = found.value
    whole = np.asarray(view.present[0] & (view.start_label[0] == codes.FIRST_PAD_END))
    assert whole.any()
    paths = np.asarray(view.path[0])[whole]
    pixels = layered.camera.pixel(outlines.angle[paths, 0, 0])
    np.testing.assert_allclose(np.asarray(view.pixels[0, :, 0])[whole], pixels, atol=1e-9)


def test_a_black_end_hides_the_strip_behind_it():
    """t tan θ, with θ the angle in the layer of the ray past the upper edge (from air, 45°)."""
    layered = scene(ACRYLIC, camera=(-5.0, 8.0), direction=-45.0)
    view = find(layered).value
    first = int(np.flatnonzero(view.present[0] & (view.path[0] == 0))[0])
    strip = 3 * math.tan(math.asin(math.sin(math.pi / 4) / 1.49))
    np.testing.assert_allclose(float(view.start[0, first]) * 20, strip, rtol=1e-12)
    assert describe_end(layered.layout, int(view.start_label[0, first])) == (
        "upper edge of layer 1 at 'from'"
    )


def test_a_bezel_and_a_dark_surface_are_named():
    seat = {"lip": 4.0, "height": 0.5}
    layered = scene(ACRYLIC, camera=(10.0, 7.0), min_transmission=0.9)
    view = find(layered).value
    direct = np.flatnonzero(view.present[0] & (view.path[0] == 0))
    labels = {int(view.start_label[0, i]) for i in direct} | {
        int(view.end_label[0, i]) for i in direct
    }
    assert {describe_end(layered.layout, label) for label in labels} == {"least transmission"}
    bright = scene(ACRYLIC, camera=(10.0, 13.0), bezel=seat)
    view = find(bright).value
    assert describe_end(bright.layout, int(view.start_label[0, 0])) == "bezel"
    # Past the lip's edge on the surface, from 10 mm above it and 6 mm along.
    hidden = 4 - 3 * math.tan(math.asin(6 / math.hypot(6, 10) / 1.49))
    np.testing.assert_allclose(float(view.start[0, 0]) * 20, hidden, rtol=1e-12)


def test_a_layer_hides_what_is_behind_it():
    """The camera looks along the first pad: its body, 3 mm high, stands before the second pad."""
    pads = [
        {"name": "near", "from": [10.0, 0.0], "to": [20.0, 0.0], "side": "left"},
        {"name": "far", "from": [30.0, 4.0], "to": [30.0, -4.0], "side": "right"},
    ]
    camera = {"position": [0.0, 1.0], "direction_deg": 0.0, "fov_deg": 90.0, "pixels": 1000}
    bare = parse_scene({"camera": camera, "pads": pads})
    layered = parse_scene({"camera": camera, "pads": [pads[0] | {"layers": [ACRYLIC]}, pads[1]]})
    shown = [float(find_coverage(s, NO_ANGLES).value[1]) for s in (bare, layered)]
    # Without the layer the pad's line hides what lies below its ends: rays over (20, 0).
    assert shown[0] > 0.5
    # With it rays pass over the upper edge at (10, 3): at x = 30 they are at y = 7.
    assert shown[1] == pytest.approx(shown[0] - lost(), abs=1e-12)


def lost() -> float:
    """What rays from (0, 1) reach of x = 30, y from −4 to 4, that pass y 0 … 3 at x = 10 or 20."""
    low, high = 1 + 3 * (0 - 1), 4.0  # below y = −2 the pad's line and its body hide nothing new
    return (high - max(low, 1 + 1.5 * (0 - 1))) / 8


def test_transmission_is_fresnels():
    n = jnp.array([1.49, 1.41])
    through_air = 4 * 1.49 / (1 + 1.49) ** 2
    between = 4 * 1.49 * 1.41 / (1.49 + 1.41) ** 2
    head_on = float(transmission(n, jnp.asarray(math.pi / 2)))
    assert head_on == pytest.approx(through_air * between, rel=1e-12)
    for least in (0.3, 0.6, 0.9):
        angle = least_grazing(n, jnp.asarray(least))
        assert float(transmission(n, angle)) == pytest.approx(least, rel=1e-9)
    assert float(least_grazing(n, jnp.asarray(0.99))) == pytest.approx(math.pi / 2)
    check_slopes(lambda given: least_grazing(*given), (n, jnp.asarray(0.6)))


def test_a_layered_scene_is_written_and_read_again():
    layers = [
        ACRYLIC | {"sides": {"from": "clear"}, "bevel_deg": [1.5, -3]},
        GEL | {"index": {"red": 1.4, "green": 1.41, "blue": 1.42}, "overhang": 2},
    ]
    layered = scene(*layers, width=24, bezel={"lip": [1, 2], "height": 0.5}, min_transmission=0.2)
    again = parse_scene(tomllib.loads(format_scene(layered)), "wide")
    assert again.layout.layers == layered.layout.layers
    same = jax.tree.map(lambda a, b: bool(np.array_equal(a, b, equal_nan=True)), layered, again)
    assert all(jax.tree.leaves(same))


@pytest.mark.parametrize(
    ("layers", "pad", "message"),
    [
        ([ACRYLIC], {"side": "both"}, "layers lie on the sensing side"),
        ([], {"bezel": {"lip": 1, "height": 1}}, "'bezel' is of a pad with layers"),
        ([ACRYLIC | {"bevel_deg": 75}], {}, "make the bevels"),
        ([ACRYLIC | {"index": 0.9}], {}, "pads.0.layers.0.index"),
        ([ACRYLIC | {"sides": "white"}], {}, "pads.0.layers.0.sides"),
        ([ACRYLIC], {"bezel": {"lip": 10, "height": 1}}, "the bezel covers 20 mm"),
    ],
)
def test_what_cannot_be_built_is_refused(layers, pad, message):
    with pytest.raises(UserError, match=message):
        scene(*layers, **pad)


def test_what_does_not_look_through_layers_refuses_them():
    layered = scene(ACRYLIC)
    with pytest.raises(ValueError, match="layers"):
        trace_views(layered, NO_ANGLES)
    curved = tables(ACRYLIC)
    curved["mirrors"][0] |= {"radius": 100.0}
    with pytest.raises(UserError, match="curved mirrors"):
        parse_scene(curved)


def test_light_through_a_clear_end_ends_at_the_least_transmission():
    n, entry = 1.49, 1.5
    outside = math.atan2(8.0 - entry, 1.0)
    inside = math.asin(math.sin(outside) / n)
    turn, both = outside - inside, outside + inside
    reflected = (math.sin(turn) / math.sin(both)) ** 2, (math.tan(turn) / math.tan(both)) ** 2
    clear = ACRYLIC | {"sides": "clear"}
    layered = scene(clear, camera=(-1.0, 8.0), min_transmission=1 - sum(reflected) / 2)
    found = find(layered).value
    piece = np.flatnonzero(found.present[0] & (found.path[0] == 0) & (found.face[0] == 1))
    assert piece.size == 1
    assert found.start[0, piece[0]] == pytest.approx(entry / math.tan(inside) / 20, abs=ROUNDING)
    label = int(found.start_label[0, piece[0]])
    assert describe_end(layered.layout, label) == "least transmission"
