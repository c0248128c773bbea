"""Rays through clear layers: closed forms, the shortest time, and the caster without layers."""

import itertools

import mpmath
import numpy as np
import pytest

from optics import parse_scene
from studies.oracles.layered_scenes import random_scene, read
from studies.oracles.layers import Layer, Pad, Scene, Surface, coverage, follow, runs
from studies.oracles.scenes import rounded

ROUNDING = 1e-12
"""A few hundred roundings of double precision, of numbers near 1."""

DOWN = -1j


def under(*layers: Layer, camera: complex = 5 + 20j, axis: complex = DOWN, **given) -> Scene:
    """A camera over a pad of 10 mm under layers."""
    pad = Pad(0, 10, 1, layers=layers, **given)
    return Scene(camera, axis, 1.0, [], [pad], [], 0)


def one(scene: Scene, angle: float):
    """One ray, numbers of one entry each, and the part where it ends."""
    seen = follow(scene, np.array([angle]))
    return seen, scene.faces[seen.end[0]].part


@pytest.mark.parametrize("seed", range(8))
def test_without_layers_it_is_the_other_caster(seed):
    tables = random_scene(np.random.default_rng(seed))[1]
    for pad in tables["pads"]:
        for key in ("layers", "bezel", "min_transmission"):
            pad.pop(key, None)
    scene, plain = read(tables), rounded(parse_scene(tables), np.zeros(0))
    angles = np.linspace(-scene.half, scene.half, 1000)
    label, along = plain.follow(plain.axis * np.exp(1j * angles))
    ray = follow(scene, angles)
    pads = [int(scene.faces[entrance].owner[1:]) for entrance in ray.entrance]
    number = [
        plain.surfaces.number(scene.word(path), pad) if seen else 0
        for path, pad, seen in zip(ray.path.tolist(), pads, ray.seen, strict=True)
    ]
    np.testing.assert_array_equal(number, label)
    np.testing.assert_allclose(ray.at[label > 0], along[label > 0], atol=1e-9)


def test_layers_of_index_1_are_air():
    mirror, post = Surface(-5 + 30j, 12 + 33j, -1), Surface(3 + 5j, 5 + 6j, 0)
    layers = tuple(Layer(t, 1.0, clear=(True, True)) for t in (1.0, 2.0, 0.5))
    clear, bare = (
        Scene(12 + 15j, DOWN, np.pi, [mirror], [Pad(0, 10, 1, 0, 0, of)], [post], 1)
        for of in (layers, ())
    )
    angles = np.linspace(-np.pi, np.pi, 5000)
    through, straight = follow(clear, angles), follow(bare, angles)
    np.testing.assert_array_equal(through.seen, straight.seen)
    assert np.ptp(through.path[through.seen]) == 1
    np.testing.assert_allclose(through.at, straight.at, atol=ROUNDING)
    np.testing.assert_allclose(through.transmission[through.seen], 1, atol=ROUNDING)


def test_apparent_depth():
    n, t, angle = 1.6, 4.0, 1e-4
    seen, _ = one(under(Layer(t, n)), angle)
    # Light from a depth t seems to come from t/n, up to the square of the angle.
    np.testing.assert_allclose(10 * seen.at - 5, (16 + t / n) * np.tan(angle), rtol=angle**2)


@pytest.mark.parametrize(
    ("camera", "angle", "faces"),
    [
        (2 + 9j, 0.7, ((5j, 10 + 5j), (2j, 10 + 2j))),
        (-6 + 9j, 0.75, ((-1 + 2j, -1 + 2j + 3 * (1j + np.tan(0.2))), (2j, 10 + 2j))),
    ],
    ids=["through the outer surface", "through a bevelled end"],
)
def test_light_takes_the_shortest_time(camera, angle, faces):
    upper = Layer(3.0, 1.4, overhang=(1.0, 0.0), bevel=(0.2, 0.0), clear=(True, True))
    scene = under(upper, Layer(2.0, 1.7, overhang=(2.0, 0.0)), camera=camera)
    seen, end = one(scene, angle)
    assert end == "membrane"

    def time(*along):
        crossed = [a + mpmath.mpf(u) * (b - a) for (a, b), u in zip(faces, along, strict=True)]
        way = itertools.pairwise([mpmath.mpc(camera), *crossed, mpmath.mpc(10 * seen.at[0])])
        return sum(n * abs(q - p) for n, (p, q) in zip((1, 1.4, 1.7), way, strict=True))

    with mpmath.workdps(30):
        slopes = [lambda u, v, k=k: mpmath.diff(time, (u, v), k) for k in ((1, 0), (0, 1))]
        first = mpmath.findroot(slopes, (0.5, 0.5))[0]
        start, stop = faces[0]
        heading = start + complex(first) * (stop - start) - camera
    np.testing.assert_allclose(np.angle(heading / DOWN), angle, atol=ROUNDING)


def test_fresnel():
    n = 1.5
    head_on, _ = one(under(Layer(1, n), Layer(1, 1.2)), 0.0)
    between = 4 * n * 1.2 / (n + 1.2) ** 2
    np.testing.assert_allclose(head_on.transmission, 4 * n / (n + 1) ** 2 * between, rtol=ROUNDING)
    # At Brewster's angle light with its field in the plane of incidence goes through whole.
    brewster, _ = one(under(Layer(1, n), camera=-20 + 20j), np.arctan(n))
    across = (n**2 - 1) / (n**2 + 1)
    np.testing.assert_allclose(brewster.transmission, 1 - across**2 / 2, rtol=ROUNDING)
    np.testing.assert_allclose(brewster.grazing, np.arctan(1 / n), rtol=ROUNDING)


def test_limits_of_grazing_angle_and_transmission():
    for limits in ({"grazing": 0.5}, {"transmission": 0.9}):
        seen = follow(
            under(Layer(1, 1.5), camera=-5 + 6j, axis=1, **limits), np.linspace(-1, 0, 99)
        )
        enough = (seen.grazing >= 0.5) if "grazing" in limits else (seen.transmission >= 0.9)
        np.testing.assert_array_equal(seen.seen, np.isfinite(seen.at) & enough)
        assert 0 < seen.seen.sum() < np.isfinite(seen.at).sum()


def test_critical_angle():
    # Past a clear end at right angles: n² − sin² is the squared sine at the surface below.
    upper, lower = Layer(3.0, 1.3, clear=(True, True)), Layer(1.0, 1.25)
    critical = -np.arcsin(np.sqrt(1.3**2 - 1.25**2))
    scene = under(upper, lower, camera=-1 + 3j, axis=1)
    for beside, end in ((1e-9, "level 1"), (-1e-9, "to 1")):
        assert one(scene, critical + beside)[1] == end


@pytest.mark.parametrize("seed", range(20))
def test_light_comes_back_the_same_way(seed):
    scene, _ = random_scene(np.random.default_rng(seed))
    ray = follow(scene, angles := np.linspace(-scene.half, scene.half, 400))
    for which in np.flatnonzero(ray.seen & (ray.path == 0)):
        face = scene.faces[ray.entrance[which]]
        if face.part != "outer":
            continue
        pad = scene.pads[int(face.owner[1:])]
        along = (pad.end - pad.start) / abs(pad.end - pad.start)
        place = pad.start + ray.at[which] * (pad.end - pad.start)
        back = -ray.heading[which] / along
        slope = back.real * pad.layers[-1].index  # n sin: the same in every layer
        for layer in reversed(pad.layers):
            run = np.tan(np.arcsin(slope / layer.index)) * layer.thickness
            place += along * (run + 1j * pad.side * layer.thickness)
        aim = along * (slope + 1j * pad.side * np.sqrt(1 - slope**2))
        np.testing.assert_allclose(
            aim, -scene.axis * np.exp(1j * angles[which]), atol=1e-9
        )  # slopes near 1 lose half the digits
        off = np.imag(np.conj(aim) * (scene.camera - place))
        np.testing.assert_allclose(off, 0, atol=1e-6)


BENT = np.tan(np.pi / 4 - np.arcsin(np.sqrt(0.5) / 1.5))
"""Slope of light from above behind a bevel of 45°, at an index of 1.5."""


@pytest.mark.parametrize(
    ("layers", "given", "expected"),
    [
        ([Layer(2, 1.5)], {}, {"outer": (0, 10)}),
        ([Layer(2, 1.5, bevel=(np.pi / 4, 0))], {}, {"outer": (2, 10)}),
        (
            [Layer(2, 1.5, bevel=(np.pi / 4, 0), clear=(True, False))],
            {},
            {"from 0": (0, 2 + 2 * BENT), "outer": (2, 10)},
        ),
        ([Layer(2, 1.5, (1, 2))], {"lip": (1.5, 3), "height": 1.0}, {"outer": (0.5, 9)}),
        # Where either layer is longer than the other nothing passes, though all ends are clear.
        (
            [
                Layer(1, 1.5, clear=(True, True)),
                Layer(1, 1.3, (0, 3), (np.pi / 4, 0), (True, True)),
            ],
            {},
            {"outer": (1, 10)},
        ),
    ],
    ids=["flat", "black bevel", "clear bevel", "bezel", "ledges"],
)
@pytest.mark.parametrize("side", [1, -1], ids=["left", "right"])
def test_from_far_above(layers, given, expected, side):
    away = 1e7
    pad = Pad(0, 10, side, layers=tuple(layers), **given)
    scene = Scene(5 + side * 1j * away, -side * 1j, 20 / away, [], [pad], [], 0)
    found = {run.entrance: sorted(run.at) for run in runs(scene, 2000)}
    assert found.keys() == expected.keys()
    for part, span in expected.items():
        # Light comes down under slopes of up to 10⁻⁶.
        np.testing.assert_allclose(10 * np.array(found[part]), span, atol=1e-5)


@pytest.mark.parametrize("seed", range(10))
def test_runs_end_where_rays_change(seed):
    scene, _ = random_scene(np.random.default_rng(seed))
    found = runs(scene, 500)
    assert np.all(coverage(scene, found) <= 1)
    for run in found:
        for angle, outwards, at in zip(run.angles, (-1, 1), run.at, strict=True):
            inside, outside = angle - outwards * 1e-12, angle + outwards * 1e-12
            ray = follow(scene, np.array([angle, inside, outside]))
            np.testing.assert_allclose(ray.at[0], at, atol=ROUNDING)
            assert scene.faces[ray.entrance[0]].part == run.entrance
            same = (ray.path == ray.path[0]) & (ray.entrance == ray.entrance[0]) & ray.seen
            assert not same[2] or abs(outside) > scene.half


def test_reading_tables():
    short = {"thickness": 1, "index": 1.5, "sides": "clear", "overhang": 1, "bevel_deg": 45}
    sides = {"to": "clear", "beside": "clear"}
    long = {"thickness": 2, "index": {"red": 1.4, "green": 1.5, "blue": 1.6}, "sides": sides}
    pad = {"from": [0, 1], "to": [2, 1], "side": "right", "min_grazing_deg": 45}
    bezel = {"lip": [1, 2], "height": 3}
    camera = {"position": [1, 2], "direction_deg": 90, "fov_deg": 180}
    long |= {"overhang": [0, 2], "bevel_deg": [0, -45]}
    pads = [pad | {"layers": [short, long], "bezel": bezel}, pad]
    scene = read({"scene": {"bounces": 1}, "camera": camera, "pads": pads}, "blue")
    half = np.pi / 4
    layers = (
        Layer(1, 1.5, (1, 1), (half, half), (True, True)),
        Layer(2, 1.6, (0, 2), (0, -half), (False, True)),
    )
    expected = Pad(1j, 2 + 1j, -1, half, 0.3, layers, (1, 2), 3), Pad(1j, 2 + 1j, -1, half)
    np.testing.assert_allclose([scene.camera, scene.axis, scene.half], [1 + 2j, 1j, np.pi / 2])
    assert tuple(scene.pads) == expected
