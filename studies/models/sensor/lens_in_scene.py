"""A calibrated lens in the camera of a scene, in place of the one that was designed."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from designopt.errors import UserError
from optics import Imaging, Scene
from optics.calibration import CalibratedLens
from optics.scene.camera import Sensor

PITCH = 0.003
"""Size of a pixel where the scene has no sensor that states it, mm; no image depends on it."""


def with_lens(scene: Scene, lens: CalibratedLens) -> Scene:
    """The scene seen through a calibrated lens: its projection, axis, pupil and pixels.

    The camera stays where it is, and so does the field that is taken to be seen, but for what lies
    beyond the image.

    Args:
        scene: as designed.
        lens: of its camera; its pictures have the section from top to bottom.

    Raises:
        UserError: the lens is of pictures of another form than those of the scene's camera.
    """
    camera = scene.camera
    rows, columns = Imaging.of(camera).shape
    wide, high = lens.size
    if abs(wide * rows / (high * columns) - 1) > 0.01:
        turned = abs(high * rows / (wide * columns) - 1) <= 0.01
        cure = (
            "turn the pictures by 90 degrees, the board's too, so that the section runs from top "
            "to bottom"
            if turned
            else "calibrate the lens with pictures of this camera, neither cropped nor stretched"
        )
        raise UserError(
            f"the lens is of pictures of {wide}x{high} px (columns x rows), and the scene's camera "
            f"has {columns}x{rows}; {cure}"
        )
    size = np.array([high, wide]) * PITCH if camera.sensor is None else camera.sensor.size
    focal = lens.lens.focal * size[0] / high
    circle = None if camera.sensor is None else camera.sensor.image_circle
    middle = (np.array(lens.size) - 1) / 2
    found = eqx.tree_at(
        lambda one: (
            one.pixels, one.projection, one.sensor, one.pupil_shift, one.axis_offset,
        ),
        camera,
        (
            jnp.asarray(float(high)), lens.lens.projection,
            Sensor(jnp.asarray(size), wide / high, focal, circle),
            lens.lens.pupil_shift if np.any(np.asarray(lens.lens.pupil_shift)) else None,
            lens.lens.principal - middle,
        ),
        is_leaf=lambda leaf: leaf is None,
    )  # fmt: skip
    # Up to the border that is farther from the axis, and no farther than the polynomial rises.
    farther = jnp.max(
        jnp.abs(jnp.array([found.angle(jnp.asarray(0.0)), found.angle(found.pixels)]))
    )
    widest = min(float(farther), 0.999 * lens.lens.projection.widest)
    field = jnp.minimum(camera.field_of_view, 2 * widest)
    found = eqx.tree_at(lambda one: one.field_of_view, found, field)
    return eqx.tree_at(lambda one: one.camera, scene, found)
