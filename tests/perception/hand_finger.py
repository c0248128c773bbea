"""A finger with two hinged pads, each before a mirror of its own, and one pad that stays.

All is written out in the camera's own axes (forward, up), mm: a phalanx, with what its mirror
shows, turns about its hinge as one body. The camera is that of `drawn`.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from perception.matching import Sighting, ViewCatalog, ViewFamily
from perception.proprioception import CornerModel
from perception.quads import Quad
from perception.quality import Quality
from tests.perception.drawn import Eye, rays_of

EYE = Eye(540, 720, focal=193.0)
LENS = EYE.lens()
WIDTH = 24.0
LENGTHS = {"low": 22.0, "still": 16.0, "high": 20.0}
JOINTS = ("bend", "curl")
VIEWS = (
    ("low", "direct"),
    ("still", "direct"),
    ("high", "direct"),
    ("high", "mirror:high"),
    ("low", "mirror:low"),
)
REFLECTIONS = (0, 0, 0, 1, 1)
MOVED_BY = (0, None, 1, 1, 0)
SIZES = np.array([0.2, 0.2, 0.2, 0.005, 0.1, 0.1, 0.004, 0.004, 0.1, 0.1])
"""Standard deviations: camera forward, up and across (mm), its tilt (rad), offset of the low and
the high pad (mm), tilt of both mirrors (rad), and their offset (mm)."""

FLAT = 8.0
"""A view is seen from so many rows on."""

SPREAD = 3.0
"""Root mean square distance of corners from where they are expected, by errors, px."""

GRAZING = 0.01
"""Flatter views do not count, rad."""

ANGLES = np.linspace(-0.1, 1.5, 161)
"""Values of each joint in the catalogue, rad."""


def _turned(points: Float[Array, "2 2"], angle: Float[Array, ""]) -> Float[Array, "2 2"]:
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    x, y = points[:, 0], points[:, 1]
    return jnp.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def _reflected(
    points: Float[Array, "2 2"], offset: Float[Array, ""], angle: Float[Array, ""]
) -> Float[Array, "2 2"]:
    """In a line at an angle and an offset along its normal from the origin."""
    normal = jnp.stack([-jnp.sin(angle), jnp.cos(angle)])
    distance = points @ normal - offset
    return points - 2 * distance[:, None] * normal[None]


def _imaged(ends: Float[Array, "2 2"], lateral: Float[Array, ""]) -> Float[Array, "4 2"]:
    """Corners of a pad in its own order."""
    forward, up = ends[jnp.array([0, 1, 1, 0])].T
    beside = WIDTH / 2 * jnp.array([-1.0, -1.0, 1.0, 1.0]) - lateral
    off = jnp.sqrt(up**2 + beside**2)
    part = EYE.focal * jnp.arctan2(off, forward) / off
    column, row = (float(part) for part in EYE.middle)
    return jnp.stack([column + part * beside, row - part * up], axis=-1)


def predict(
    errors: Float[Array, " errors"], angles: Float[Array, " joints"]
) -> Float[Array, "views 4 2"]:
    """Corners of all views of a finger with errors, in units of their deviations."""
    forward, up, across, tilt, *rest = errors * jnp.asarray(SIZES)
    camera = jnp.stack([forward, up])[None]

    def seen(ends: Float[Array, "2 2"]) -> Float[Array, "4 2"]:
        return _imaged(_turned(ends - camera, -tilt), across)

    views = {("still", "direct"): seen(jnp.array([[20.0, -8.0], [20.0, 8.0]]))}
    for number, (name, side) in enumerate((("low", -1.0), ("high", 1.0))):
        offset, lean, shift = rest[number], rest[2 + number], rest[4 + number]
        reach = jnp.array([4.0, 4.0 + LENGTHS[name]])
        # A phalanx' mirror is on the camera's side of its pad and as good as parallel to it.
        pad = jnp.stack([jnp.stack([offset, offset]), side * reach], axis=-1)
        image = _reflected(pad, 8.0 * side + shift, jnp.asarray(side * np.pi / 2) + lean)
        for path, ends in (("direct", pad), (f"mirror:{name}", image)):
            turned = _turned(ends, -side * angles[number])
            views[name, path] = seen(turned + jnp.array([[20.0, 12.0 * side]]))
    return jnp.stack([views[view] for view in VIEWS])


MODEL = CornerModel(predict, VIEWS, MOVED_BY, len(SIZES), JOINTS, (-0.1, 1.5))

predicted = jax.jit(jax.vmap(predict))
"""For several fingers and poses at once."""


def corners_of(errors: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Corners of one finger in several poses."""
    many = np.broadcast_to(errors, (len(poses), len(SIZES)))
    return np.asarray(predicted(jnp.asarray(many), jnp.asarray(poses)))


def shown(corners: np.ndarray) -> np.ndarray:
    """Which of all views are in the image, seen from the right side and not too flat."""
    inside = ((corners > 4) & (corners < np.array([EYE.columns, EYE.rows]) - 5)).all(axis=(-1, -2))
    rise = corners[..., [0, 3], 1].mean(axis=-1) - corners[..., [1, 2], 1].mean(axis=-1)
    upright = np.array([-1 if pad == "low" else 1 for pad, _ in VIEWS])
    mirrored = np.array([(-1) ** count for count in REFLECTIONS])
    return inside & (rise * upright * mirrored > FLAT)


def catalog() -> ViewCatalog:
    """All that it can show; a view is whole or is not seen at all."""
    families = []
    for index, ((pad, path), joint) in enumerate(zip(VIEWS, MOVED_BY, strict=True)):
        angles = ANGLES if joint is not None else ANGLES[:1]
        corners = corners_of(np.zeros(len(SIZES)), np.stack([angles, angles], axis=-1))
        there = shown(corners)[:, index]
        seen = there, there, there.astype(float), np.stack([there, there], axis=-1)
        spread = np.full((len(angles), 2), SPREAD)
        view = pad, path, REFLECTIONS[index], joint, angles, corners[:, index]
        families.append(ViewFamily(*view, *seen, spread, True))
    return ViewCatalog(families, LENGTHS, dict.fromkeys(LENGTHS, GRAZING), WIDTH, len(JOINTS))


def quad_of(corners: np.ndarray, *, deviation: float = 0.1) -> Quad:
    """A quadrilateral, its corners in the pad's order or the other way up."""
    lower_first = corners[0, 1] + corners[3, 1] >= corners[1, 1] + corners[2, 1]
    ordered = corners if lower_first else corners[[1, 0, 3, 2]]
    covariance = np.broadcast_to(deviation**2 * np.eye(2), (4, 2, 2)).copy()
    rays = rays_of(EYE.directions(ordered))
    return Quad(rays, ordered, covariance, 5000.0, 100.0, 0.1, Quality.COMPLETE)


def quads_of(corners: np.ndarray) -> list[Quad]:
    """Of all views that are seen in a pose."""
    return [quad_of(one) for one in corners[shown(corners)]]


def names(sighting: Sighting, qualities: Sequence[Quality] = (Quality.COMPLETE,)) -> set[str]:
    """Views of some quality, as 'pad path'."""
    return {f"{v.pad} {v.path}" for v in sighting.views if v.quality in qualities}
