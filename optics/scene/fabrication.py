"""What may be wrong with a finger that has been made: camera, mirrors, pads and their layers.

Some errors leave the section a section: `perturb` puts them into the scene. The others turn parts
out of it; only what is computed in space has them (`optics.visibility.corners_in_space`).
"""

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

    Those that are ``None`` are errors that a finger cannot have. In space, "across" is across the
    section, towards greater columns of the image.

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
        yaw: by how much the optical axis turns across, rad.
        roll: by how much the camera's up direction then turns across, about the optical axis, rad.
        mirror_lean: by how much each mirror's normal turns across, about its line, rad.
        mirror_bow: of each mirror, a flexible sheet held at its two ends, of its middle along its
            normal, mm; it is a parabola in the section.
        pad_lean: by how much each pad's normal turns across, about its line, rad.
        thickness: of each layer on each pad, which grows towards the camera, mm.
        index: of refraction of each layer, of all colors alike.
        pupil: of the first coefficient of the camera's ``pupil_shift``, mm per rad².
        lateral_color: of the image's scale in red and in blue, over that in green.
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
    yaw: Float[Array, ""] | None = eqx.field(default=None, converter=optional_float)
    roll: Float[Array, ""] | None = eqx.field(default=None, converter=optional_float)
    mirror_lean: Float[Array, " mirrors"] | None = eqx.field(default=None, converter=optional_float)
    mirror_bow: Float[Array, " mirrors"] | None = eqx.field(default=None, converter=optional_float)
    pad_lean: Float[Array, " pads"] | None = eqx.field(default=None, converter=optional_float)
    thickness: Float[Array, "pads layers"] | None = eqx.field(
        default=None, converter=optional_float
    )
    index: Float[Array, "pads layers"] | None = eqx.field(default=None, converter=optional_float)
    pupil: Float[Array, ""] | None = eqx.field(default=None, converter=optional_float)
    lateral_color: Float[Array, "2"] | None = eqx.field(default=None, converter=optional_float)

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
    most = max(map(len, layout.layers), default=0)
    layers = [f"{pad}, layer {number}" for pad in pads for number in range(1, most + 1)]
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
        *_named("lens k1", errors.distortion),
        *_named("camera yaw (rad)", errors.yaw),
        *_named("camera roll (rad)", errors.roll),
        *_named("lean of mirror {} (rad)", errors.mirror_lean, mirrors),
        *_named("bow of mirror {} (mm)", errors.mirror_bow, mirrors),
        *_named("lean of pad {} (rad)", errors.pad_lean, pads),
        *_named("thickness of pad {} (mm)", errors.thickness, layers),
        *_named("index of pad {}", errors.index, layers),
        *_named("pupil shift (mm/rad²)", errors.pupil),
        *_named("scale of the image in {}", errors.lateral_color, ("red", "blue")),
    ]


def _named(text: str, errors: Array | None, of: Sequence[str] = ("",)) -> list[str]:
    return [] if errors is None else [text.format(part) for part in of]


def perturb(scene: Scene, errors: Fabrication, *, carried: Sequence[int] = ()) -> Scene:
    """The scene with errors of fabrication; differentiable.

    Args:
        scene: as designed.
        errors: its errors, of which those out of the section have no effect here: ``lateral``,
            ``yaw``, ``roll``, the leans, ``mirror_bow``, ``lateral_color``.
        carried: indices of the blockers that move with the camera, such as its body.

    Raises:
        ValueError: a distortion is added to a lens that is neither equidistant nor Kannala–Brandt,
            or an error to layers or to a shift of the pupil that the scene does not have.

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
    scene = _with_layers(scene, errors)
    if errors.pupil is not None:
        if camera.pupil_shift is None:
            raise ValueError("the entrance pupil stays: it has no error of its shift")
        shift = camera.pupil_shift.at[0].add(errors.pupil)
        scene = eqx.tree_at(lambda scene: scene.camera.pupil_shift, scene, shift)
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


def _with_layers(scene: Scene, errors: Fabrication) -> Scene:
    """The scene with errors of the layers on pads."""
    if errors.thickness is None and errors.index is None:
        return scene
    if scene.layers is None:
        raise ValueError("no pad has layers: they have no errors")
    thickness, index = scene.layers.thickness, scene.layers.index
    if errors.thickness is not None:
        thickness = thickness + errors.thickness
    if errors.index is not None:
        index = index + errors.index[..., None]
    layers = dataclasses.replace(scene.layers, thickness=thickness, index=index)
    return eqx.tree_at(lambda scene: scene.layers, scene, layers)


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
