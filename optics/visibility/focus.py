"""How sharp a camera with a real lens sees its pads: blur at the length of the unfolded path.

A flat mirror does not change the distance at which a lens sees a point: that is the length of the
path. Layers over a pad bring it nearer: the distance is then the radius of curvature of its wave in
the section (`optics.visibility.refraction`), and blur that along the image line. Of layers on flat
mirrors it is that across the section. Curved mirrors also move the image along the ray, which is
left out here, and `Focus.sharp` takes the length of the path along a piece as in a flat one.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import as_float, safe_divide, safe_sqrt
from optics.scene.camera import Camera
from optics.scene.scene import Scene
from optics.scene.thin_lens import ThinLens
from optics.visibility.views import Pieces


class Focus(eqx.Module):
    """Sharpness of each piece of a view; arrays have the shape of `Pieces.start`.

    Attributes:
        blur: diameter of the blur spot at the two ends of each piece, pixels, shape (..., 2).
        sharp: part of each piece over which the blur stays within the accepted one; ``None`` where
            pads have layers, behind which blur may be least or greatest between a piece's ends.
        limits: nearest and farthest distance at which it does, mm, shape (2,); the farthest may
            be infinite.
    """

    blur: Float[Array, "*pieces 2"]
    sharp: Float[Array, "*pieces"] | None
    limits: Float[Array, "2"]


def find_blur(camera: Camera, distance: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """Diameter of the blur spot of points at distances, pixels.

    Between two distances it is nowhere larger than at the worse of them.

    Args:
        camera: one with a lens.
        distance: along the unfolded path, mm; behind layers the apparent one.

    Raises:
        ValueError: the camera has no lens.

    Example:
        >>> from optics import Camera, Pinhole, ThinLens
        >>> lens = ThinLens(focal_length=4.0, aperture=2.0, sensor_distance=5.0)
        >>> camera = Camera(jnp.zeros(2), 0.0, 1.0, 100.0, Pinhole(), lens)
        >>> [round(blur, 6) for blur in find_blur(camera, jnp.array([20.0, 40.0])).tolist()]
        [0.0, 4.576219]
    """
    return _spots(_lens_of(camera), camera.pixel_size, distance)


def _lens_of(camera: Camera) -> ThinLens:
    if camera.lens is None:
        raise ValueError("the camera has no lens; give it one, [camera.lens] in a file")
    return camera.lens


def _spots(
    lens: ThinLens, pitch: Float[Array, ""], distance: Float[Array, "*points"]
) -> Float[Array, "*points"]:
    blurs = jax.vmap(lambda distance: lens.image(distance).value.blur_diameter)
    spot, _ = safe_divide(blurs(distance.reshape(-1)), jnp.broadcast_to(pitch, (distance.size,)))
    return spot.reshape(distance.shape)


def find_focus(scene: Scene, pieces: Pieces, *, accepted: ArrayLike = 1.0) -> Focus:
    """Blur and depth of field along the pieces that a camera sees.

    A pixel is as large as sensor distance over focal length in pixels, or as a pixel of its sensor.

    Args:
        scene: the scene; its camera has a lens.
        pieces: what it sees.
        accepted: diameter of the largest accepted blur spot, pixels.

    Raises:
        ValueError: the camera has no lens.

    Example:
        >>> from importlib.resources import files
        >>> from optics import ThinLens, find_views, read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/half-height-mirror.toml")
        >>> lens = ThinLens(focal_length=4.0, aperture=1.4, sensor_distance=4.03)
        >>> scene = eqx.tree_at(
        ...     lambda s: s.camera.lens, scene, lens, is_leaf=lambda leaf: leaf is None
        ... )
        >>> views = find_views(scene, jnp.zeros(0), bounces=0).value
        >>> jax.jit(find_focus)(scene, views).sharp.shape == views.present.shape
        True
    """
    lens, pitch = _lens_of(scene.camera), scene.camera.pixel_size
    spot = _spots(lens, pitch, pieces.object_distance)
    blur = jnp.where(pieces.present[..., None], spot, 0.0)

    near, far = lens.depth_of_field(as_float(accepted).astype(pitch.dtype) * pitch).value
    limits = jnp.stack([_distance(near), _distance(far)])
    if pieces.apparent is not None:
        return Focus(blur, None, limits)
    ends = scene.pads[:, 1] - scene.pads[:, 0]
    lengths = safe_sqrt(ends[:, 0] ** 2 + ends[:, 1] ** 2).reshape(-1, 1)
    lengths = (pieces.end - pieces.start) * jnp.broadcast_to(lengths, pieces.start.shape)
    within = [_part_nearer(pieces.distance, lengths, limit) for limit in limits]
    sharp = jnp.where(pieces.present, within[1] - within[0], 0.0)
    return Focus(blur, sharp, limits)


def _distance(vergence: Float[Array, ""]) -> Float[Array, ""]:
    """The distance of a vergence; infinite where that is not positive."""
    real = vergence > 0
    return jnp.where(real, 1 / jnp.where(real, vergence, 1.0), jnp.inf)


def _part_nearer(
    distances: Float[Array, "*pieces 2"], length: Float[Array, "*pieces"], limit: Float[Array, ""]
) -> Float[Array, "*pieces"]:
    """Part of a straight piece that is nearer to the (virtual) camera than a limit.

    At the part τ of its length ℓ the squared distance is (1 − τ) a² + τ b² − τ (1 − τ) ℓ²
    (Stewart's theorem), so the limit is passed at the two roots of a quadratic equation.
    """
    finite = jnp.isfinite(limit)
    square = jnp.where(finite, limit, 0.0) ** 2
    first, last = distances[..., 0] ** 2, distances[..., 1] ** 2
    middle, _ = safe_divide(first + length**2 - last, 2 * length**2)
    offset, _ = safe_divide(first - square, length**2)
    half = safe_sqrt(middle**2 - offset)
    part = jnp.clip(middle + half, 0, 1) - jnp.clip(middle - half, 0, 1)
    return jnp.where(finite, part, 1.0)
