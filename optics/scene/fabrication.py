"""What may be wrong with a finger that has been made: camera, mirrors and pads out of place."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.numerics import as_float, optional_float, safe_divide, safe_sqrt
from optics.scene.camera import Equidistant, KannalaBrandt, Projection
from optics.scene.scene import Layout, Scene


class Fabrication(eqx.Module):
    """Errors of one finger. Angles are counter-clockwise, normals to the left of from → to.

    Attributes:
        camera: of its position in the section, mm.
        lateral: of its position across the section, towards greater columns, mm.
        tilt: of the camera about its pinhole, rad.
        mirror_tilt: of each mirror about its middle, rad.
        mirror_offset: of each mirror along its normal, mm.
        pad_tilt: of each pad about its middle, rad.
        pad_offset: of each pad along its normal, mm.
        pad_shift: of each pad along itself, mm.
        distortion: k₁ that is added to the lens, r ∝ θ + k₁ θ³ of Kannala and Brandt, the field of
            view ending in the image where it did; ``None`` for a lens that is exactly as designed.
    """

    camera: Float[Array, "2"] = eqx.field(converter=as_float)
    lateral: Float[Array, ""] = eqx.field(converter=as_float)
    tilt: Float[Array, ""] = eqx.field(converter=as_float)
    mirror_tilt: Float[Array, " mirrors"] = eqx.field(converter=as_float)
    mirror_offset: Float[Array, " mirrors"] = eqx.field(converter=as_float)
    pad_tilt: Float[Array, " pads"] = eqx.field(converter=as_float)
    pad_offset: Float[Array, " pads"] = eqx.field(converter=as_float)
    pad_shift: Float[Array, " pads"] = eqx.field(converter=as_float)
    distortion: Float[Array, ""] | None = eqx.field(default=None, converter=optional_float)

    @classmethod
    def none(cls, layout: Layout) -> Fabrication:
        """No errors."""
        mirrors, pads = jnp.zeros(len(layout.mirrors)), jnp.zeros(len(layout.pads))
        zero = jnp.zeros(())
        return cls(jnp.zeros(2), zero, zero, mirrors, mirrors, pads, pads, pads)


def scale_errors(deviations: Fabrication, numbers: Float[Array, " errors"]) -> Fabrication:
    """Errors that are so many times their standard deviations, one number each, in their order.

    Example:
        >>> import numpy as np
        >>> deviations = Fabrication(
        ...     np.full(2, 0.1),
        ...     0.1,
        ...     0.02,
        ...     np.ones(1),
        ...     np.ones(1),
        ...     np.ones(1),
        ...     np.ones(1),
        ...     np.ones(1),
        ... )
        >>> made = scale_errors(deviations, jnp.arange(9.0))
        >>> [round(v, 3) for v in made.camera.tolist()]
        [0.0, 0.1]
    """
    leaves, structure = jax.tree.flatten(deviations)
    ends = np.cumsum([leaf.size for leaf in leaves])[:-1].tolist()
    parts = jnp.split(numbers, ends)
    scaled = [part.reshape(leaf.shape) * leaf for part, leaf in zip(parts, leaves, strict=True)]
    return jax.tree.unflatten(structure, scaled)


def name_fabrication_errors(layout: Layout, errors: Fabrication) -> list[str]:
    """What the entries of flattened errors are, in their order, with their units.

    Example:
        >>> from importlib.resources import files
        >>> import numpy as np
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> errors = Fabrication(
        ...     np.zeros(2),
        ...     0.0,
        ...     0.0,
        ...     np.zeros(2),
        ...     np.zeros(2),
        ...     np.zeros(1),
        ...     np.zeros(1),
        ...     np.zeros(1),
        ... )
        >>> name_fabrication_errors(scene.layout, errors)[3:5]
        ['camera tilt (rad)', 'tilt of mirror lower (rad)']
    """
    mirrors, pads = [[part.name for part in kind] for kind in (layout.mirrors, layout.pads)]
    return [
        "camera along x (mm)",
        "camera along y (mm)",
        "camera across the section (mm)",
        "camera tilt (rad)",
        *(f"tilt of mirror {name} (rad)" for name in mirrors),
        *(f"offset of mirror {name} (mm)" for name in mirrors),
        *(f"tilt of pad {name} (rad)" for name in pads),
        *(f"offset of pad {name} (mm)" for name in pads),
        *(f"shift of pad {name} (mm)" for name in pads),
        *(["lens k1"] if errors.distortion is not None else []),
    ]


def perturb(scene: Scene, errors: Fabrication, *, carried: Sequence[int] = ()) -> Scene:
    """The scene with errors of fabrication; differentiable.

    Args:
        scene: as designed.
        errors: its errors; ``lateral`` is not in the section and has no effect here.
        carried: indices of the blockers that move with the camera, such as its body.

    Raises:
        ValueError: a distortion is added to a lens that is neither equidistant nor Kannala–Brandt.

    Example:
        >>> from importlib.resources import files
        >>> import numpy as np
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> none = Fabrication(
        ...     np.zeros(2),
        ...     0.0,
        ...     0.0,
        ...     np.zeros(2),
        ...     np.zeros(2),
        ...     np.zeros(1),
        ...     np.zeros(1),
        ...     np.zeros(1),
        ... )
        >>> import dataclasses
        >>> made = perturb(scene, dataclasses.replace(none, camera=np.array([0.0, 0.1])))
        >>> [round(v, 3) for v in (made.camera.position - scene.camera.position).tolist()]
        [0.0, 0.1]
    """
    camera, blockers = scene.camera, scene.blockers
    if carried:
        held = jnp.asarray(carried)
        pinhole, moved = camera.position[None, None], (camera.position + errors.camera)[None, None]
        arms = turned(blockers[held] - pinhole, jnp.full(len(carried), errors.tilt))
        blockers = blockers.at[held].set(moved + arms)
    pads = displaced(scene.pads, errors.pad_tilt, errors.pad_offset)
    along = _directions(pads)
    projection = _distorted(camera.projection, errors.distortion)
    if camera.sensor is not None and errors.distortion is not None:
        half = camera.field_of_view / 2
        share, _ = safe_divide(camera.projection.height(half), projection.height(half))
        focal = camera.sensor.focal_length * share
        sensor = dataclasses.replace(camera.sensor, focal_length=focal)
        scene = eqx.tree_at(lambda scene: scene.camera.sensor, scene, sensor)
    return eqx.tree_at(
        lambda scene: (
            scene.camera.position,
            scene.camera.direction,
            scene.camera.projection,
            scene.mirrors,
            scene.pads,
            scene.blockers,
        ),
        scene,
        (
            camera.position + errors.camera,
            camera.direction + errors.tilt,
            projection,
            displaced(scene.mirrors, errors.mirror_tilt, errors.mirror_offset),
            pads + (errors.pad_shift[:, None] * along)[:, None],
            blockers,
        ),
    )


def _distorted(projection: Projection, k1: Float[Array, ""] | None) -> Projection:
    if k1 is None:
        return projection
    if isinstance(projection, Equidistant):
        return KannalaBrandt(jnp.zeros(4, k1.dtype).at[0].set(k1))
    if isinstance(projection, KannalaBrandt):
        return KannalaBrandt(projection.coefficients.at[0].add(k1))
    raise ValueError("a distortion is added to an equidistant or Kannala-Brandt lens only")


def turned(
    arms: Float[Array, "segments 2 2"], angle: Float[Array, " segments"]
) -> Float[Array, "segments 2 2"]:
    """Arrows to the ends of segments, turned counter-clockwise by an angle (rad) for each."""
    cosine, sine = jnp.cos(angle)[:, None], jnp.sin(angle)[:, None]
    return jnp.stack(
        [
            cosine * arms[..., 0] - sine * arms[..., 1],
            sine * arms[..., 0] + cosine * arms[..., 1],
        ],
        axis=-1,
    )


def _directions(ends: Float[Array, "segments 2 2"]) -> Float[Array, "segments 2"]:
    """Unit vectors along segments; 0 for one without a length."""
    along = ends[:, 1] - ends[:, 0]
    length = safe_sqrt(jnp.sum(along * along, axis=-1, keepdims=True))
    return safe_divide(along, jnp.broadcast_to(length, along.shape))[0]


def displaced(
    ends: Float[Array, "segments 2 2"],
    tilt: Float[Array, " segments"],
    offset: Float[Array, " segments"],
) -> Float[Array, "segments 2 2"]:
    """Segments turned about their middles, and then moved along their normals.

    Args:
        ends: of the segments, mm; none is without a length.
        tilt: counter-clockwise, rad.
        offset: to the left of their direction, mm.
    """
    middle = jnp.mean(ends, axis=1, keepdims=True)
    arms = turned(ends - middle, tilt)
    along = arms[:, 1] - arms[:, 0]
    length = jnp.sqrt(jnp.sum(along * along, axis=-1, keepdims=True))
    normal = jnp.stack([-along[:, 1], along[:, 0]], axis=-1) / length
    return middle + arms + (offset[:, None] * normal)[:, None]
