"""Slopes of a finger's figures with respect to every dimension of it, in one call.

Four figures: the least transmission angle of a posture, the part of the distal pad that is seen and
how sharply, and the pixel row of a pad's corner. ``python examples/finger_gradient.py`` runs it.
"""

import jax
import jax.numpy as jnp

from kinematics import solve_transmission
from optics import Imaging, find_corners, find_outlines, find_views
from studies.models import Body, Finger, FingerCamera, FingerMirror, FingerSpring, Pins

jax.config.update("jax_enable_x64", True)

FINGER = Finger.of(  # mm and rad; its pads are seen in part, or their slopes would be 0
    Body(35.0, 66.8, 32.0, 25.0, 4.0, flexion=jnp.pi / 2, rim=1.5),
    Pins(*jnp.array([  # F, E, D, C, G, G'
        [-7.75, -2.0], [-21.27, 14.06], [-2.49, 13.73], [69.68, 5.27], [11.13, 2.01], [15.0, 19.0],
    ])),
    FingerSpring(stiffness=30.0, preload=0.3, servo=300.0),
    FingerCamera(17.65, 15.0, 0.156, field_of_view=3.0, pixels=1080.0, width=8.0, grazing=0.493),
    [
        FingerMirror(jnp.array([[6.47, 8.63], [18.38, 19.59]]), "distal"),
        FingerMirror(jnp.array([[-7.15, 14.63], [-32.23, 19.2]]), "proximal"),
    ],
)  # fmt: skip
PIP, DIP = jnp.deg2rad(40.0), jnp.deg2rad(10.0)
DISTAL, DIRECT, PAD_WIDTH = 2, 0, 24.0


@jax.jit
def figures(finger: Finger) -> dict[str, jax.Array]:
    """The figures of one posture; flexion is positive in the scene and negative in the linkage."""
    scene, pose = finger.scene(), jnp.stack([PIP, DIP])
    angles = solve_transmission(finger.linkage(), -pose).angles
    views = find_views(scene, pose).value
    imaging = Imaging(scene.camera, scene.camera.pixels, scene.camera.pixels * 4 / 3)
    corners = find_corners(imaging, find_outlines(scene, pose), PAD_WIDTH)
    return {
        "least transmission angle": jnp.rad2deg(jnp.min(jnp.stack(list(angles.values())))),
        "coverage of the distal pad": views.coverage()[DISTAL],
        "px/mm where it begins": views.px_per_mm[DISTAL, 0, 0],
        "row of its corner": corners[DIRECT, DISTAL, 0, 1],
    }


if __name__ == "__main__":
    values, slopes = jax.jit(lambda one: (figures(one), jax.jacrev(figures)(one)))(FINGER)
    for name, value in values.items():
        print(f"{name}: {float(value):.4g}")
        for path, slope in jax.tree.leaves_with_path(slopes[name]):
            print(f"  {jax.tree_util.keystr(path):24} {slope}")
