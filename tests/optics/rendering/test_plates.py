"""Rays through layers on a pad, against the oracle that goes from face to face, and formulas."""

from typing import Any

import numpy as np
import pytest

from optics import parse_scene
from optics.rendering.plates import LAMPS, Meeting, Plates, plates_of
from optics.scene.layers import GREEN
from studies.oracles.layer_box import NONE, Block, follow
from studies.oracles.layers import Layer, Pad

LENGTH, WIDTH, RAYS = 22.0, 18.0, 4000

EXACT = 2e-4
"""mm: rounding in float32 of some 100 mm."""

ACRYLIC, SILICONE = {"thickness": 3.0, "index": 1.49}, {"thickness": 2.0, "index": 1.43}
CLEAR, BEZEL = {"sides": "clear"}, {"lip": [1.5, 0.7], "height": 0.8}

PADS: dict[str, dict[str, Any]] = {
    "black": {"layers": [ACRYLIC]},
    "bezel": {"layers": [ACRYLIC | {"overhang": [1.0, 2.0], "bevel_deg": [20, -10]}, SILICONE]},
    "clear": {"layers": [ACRYLIC | CLEAR, SILICONE | CLEAR]},
    "ledges": {
        "layers": [
            ACRYLIC | {"overhang": [0.3, 0.0], "sides": {"to": "clear", "beside": "clear"}},
            SILICONE | {"overhang": [1.0, 0.5], "sides": {"from": "clear", "to": "black"}},
            {"thickness": 0.5, "index": 1.6, "sides": "clear", "overhang": [0.2, 0.4]},
        ]
    },
}
PADS["bezel"]["bezel"] = BEZEL

every_pad = pytest.mark.parametrize("kind", PADS)


def plates(pad: dict[str, Any]) -> Plates:
    place = {"name": "pad", "from": [0.0, 0.0], "to": [LENGTH, 0.0], "side": "left", "width": WIDTH}
    camera = {"position": [0, 30], "direction_deg": -90, "fov_deg": 120, "pixels": 100}
    found = plates_of(parse_scene({"camera": camera, "pads": [place | pad]}), WIDTH)[0]
    assert found is not None
    return found


def block(pad: dict[str, Any]) -> Block:
    layers, clear = [], []
    for layer in pad["layers"]:
        sides = layer.get("sides", "black")
        named = sides if isinstance(sides, dict) else dict.fromkeys(("from", "to", "beside"), sides)
        at = [named.get(name) == "clear" for name in ("from", "to", "beside")]
        over = tuple(layer.get("overhang", [0.0, 0.0]))
        bevel = tuple(np.radians(layer.get("bevel_deg", [0.0, 0.0])).tolist())
        layers.append(Layer(layer["thickness"], layer["index"], over, bevel, (at[0], at[1])))
        clear.append(at[2])
    bezel = pad.get("bezel", {"lip": [0.0, 0.0], "height": 0.0})
    own = Pad(0j, LENGTH + 0j, 1, 0.0, 0.0, tuple(layers), tuple(bezel["lip"]), bezel["height"])
    return Block(own, WIDTH, tuple(clear), "bezel" in pad)


def rays(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A camera above the layers, and directions to places on and about the pad."""
    draw = np.random.default_rng(seed)
    camera = np.array([draw.uniform(-10, 30), draw.uniform(-12, 12), draw.uniform(9, 25)])
    places = draw.uniform([-4, -WIDTH / 2 - 3, 0], [LENGTH + 4, WIDTH / 2 + 3, 6], (RAYS, 3))
    return camera, places - camera


def met(pad: dict[str, Any], camera: np.ndarray, directions: np.ndarray) -> Meeting:
    way = [np.float32(directions[None, :, axis]) for axis in range(3)]
    return plates(pad).meet((camera[0], camera[1], camera[2]), (way[0], way[1], way[2]))


def flat(part: np.ndarray | None) -> np.ndarray:
    assert part is not None
    return part[0]


@every_pad
@pytest.mark.parametrize("seed", range(3))
def test_rays_reach_the_membrane_where_the_oracle_follows_them_to(kind, seed):
    camera, directions = rays(seed)
    found = met(PADS[kind], camera, directions)
    wanted = follow(block(PADS[kind]), camera, directions)
    along, across = found.along[0], found.across[0]
    edges = np.minimum(np.minimum(along, LENGTH - along), WIDTH / 2 - np.abs(across))
    margin = np.minimum(flat(found.margin), edges)
    # The oracle reflects a ray once; what reaches the membrane only by more is left out.
    once = (wanted.layer == NONE) | wanted.sensed
    clear = once & (np.abs(margin) > EXACT)
    np.testing.assert_array_equal(margin[clear] > 0, wanted.sensed[clear])
    assert found.there.all()
    here = wanted.sensed & clear
    assert here.sum() > 100
    assert (wanted.layer[here] != NONE).any() == ("clear" in str(PADS[kind]["layers"]))
    np.testing.assert_allclose(along[here], wanted.place[here, 0], atol=EXACT)
    np.testing.assert_allclose(across[here], wanted.place[here, 1], atol=EXACT)


def passed(angle: np.ndarray, before: float, after: float) -> tuple[np.ndarray, np.ndarray]:
    """Through one surface (Fresnel): the angle inside, and what is not reflected."""
    inside = np.arcsin(np.sin(angle) * before / after)
    turn, both = angle - inside, angle + inside
    reflected = (np.sin(turn) / np.sin(both)) ** 2, (np.tan(turn) / np.tan(both)) ** 2
    return inside, 1 - np.array(reflected)


def test_light_comes_through_as_fresnel_has_it():
    camera, directions = rays(0)
    found = met(PADS["bezel"], camera, directions)
    angle = np.arctan2(np.hypot(*directions.T[:2]), -directions[:, 2])
    inside, first = passed(angle, 1.0, ACRYLIC["index"])
    _, second = passed(inside, ACRYLIC["index"], SILICONE["index"])
    np.testing.assert_allclose(flat(found.light), (first * second).mean(axis=0), atol=1e-4)


def test_a_wall_of_low_index_reflects_a_part():
    index = 1.2
    pad = {"layers": [{"thickness": 4.0, "index": index, "sides": "clear"}]}
    camera, directions = rays(1)
    found = met(pad, camera, directions)
    way = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    # Against the wall at the second end, by the angles to its normal on both sides.
    x = camera[0] + (camera[2] - 4.0) * -way[:, 0] / way[:, 2]
    depth = 4.0 * way[:, 0] / np.sqrt(index**2 - 1 + way[:, 2] ** 2)
    at_wall = (x < LENGTH) & (x + depth > LENGTH)
    y = camera[1] + (camera[2] - 4.0) * -way[:, 1] / way[:, 2]
    y = y + 4.0 * way[:, 1] / np.sqrt(index**2 - 1 + way[:, 2] ** 2)
    at_wall &= np.abs(y) < WIDTH / 2
    inner = np.arccos(way[:, 0] / index)
    total = index * np.sin(inner) >= 1
    down = np.arctan2(np.hypot(*way.T[:2]), -way[:, 2])
    _, through = passed(down, 1.0, index)
    weak = at_wall & ~total & (way[:, 0] > 0)
    _, lost = passed(inner[weak], index, 1.0)
    wanted = through.mean(axis=0)[weak] * (1 - lost).mean(axis=0)
    assert weak.sum() > 20
    np.testing.assert_allclose(flat(found.light)[weak], wanted, atol=2e-4)
    mirrored = at_wall & total & (way[:, 0] > 0)
    np.testing.assert_allclose(
        flat(found.light)[mirrored], through.mean(axis=0)[mirrored], atol=2e-4
    )


def test_lamps_are_met_at_their_walls():
    pad = {"layers": [ACRYLIC | {"sides": {"to": "lamp", "beside": "lamp"}}]}
    dark = {"layers": [ACRYLIC]}
    camera, directions = rays(2)
    found, wanted = met(pad, camera, directions), follow(block(dark), camera, directions)
    shown = np.zeros((3, RAYS), bool)
    for margin, color in found.lamps:
        shown[color] |= margin[0] > 0
    at_wall = (wanted.first == "wall") & (wanted.met[:, 2] < 3.0 - EXACT)
    to = at_wall & (np.abs(wanted.met[:, 0] - LENGTH) < 1e-6)
    left, right = (at_wall & (np.abs(wanted.met[:, 1] - y) < 1e-6) for y in (-9.0, 9.0))
    assert LAMPS[1] == (2, 0)
    assert LAMPS[0] == (GREEN, GREEN)
    # What is beyond two walls at the membrane's level counts for the one at the pad's end.
    off = np.maximum(-found.along[0], found.along[0] - LENGTH) > 0
    off_across = np.abs(found.across[0]) > WIDTH / 2
    for color, wall in enumerate((right, to, left)):
        assert wall.sum() > 20
        np.testing.assert_array_equal(shown[color][~(off & off_across)], wall[~(off & off_across)])
    both = off & off_across & (found.along[0] > 0) & at_wall
    np.testing.assert_array_equal(shown[:, both], np.array([[False], [True], [False]]) & both[both])


def test_edges_under_clear_walls_bound_nothing():
    assert plates(PADS["clear"]).mirrored == ((True, True), (True, True))
    assert plates(PADS["black"]).mirrored == ((False, False), (False, False))
    assert plates(PADS["ledges"]).mirrored == ((False, False), (True, True))


def test_a_camera_below_the_surface_sees_nothing():
    aside, down = np.full((1, 1), 0.3, np.float32), np.full((1, 1), -1, np.float32)
    assert not plates(PADS["black"]).meet((5.0, 0.0, 2.0), (aside, aside, down)).there.any()
