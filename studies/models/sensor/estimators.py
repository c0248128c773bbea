"""What the optics predict of a finger, in the form in which perception takes it."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from optics import Fabrication, Imaging, Scene, find_corners_in_space, perturb, scale_errors
from optics.scene.layers import GREEN
from optics.visibility.outlines import find_outlines
from optics.visibility.unfolding import paths_of
from optics.visibility.views import name_paths
from perception.lens import Lens, Places, Rays
from perception.matching import Sighting, ViewCatalog
from perception.proprioception import CornerModel, EdgeEstimator, GapTable, fit_edges
from studies.models.sensor.catalog import ANGLES, wanted_views

ANGLES_OF_LENS = 2**16
"""Between so many angles from the axis a lens is linear: at 80° that is off by 5e-5 px at most."""


def lens_of(imaging: Imaging) -> Lens:
    """The camera's rays for the analysis of its images.

    Places are interpolated by NumPy: an image asks for few at a time, in which a call of JAX would
    take longest.
    """
    angles = np.linspace(0.0, np.pi, ANGLES_OF_LENS)
    focal = float(imaging.camera.focal_pixels)
    radii = focal * np.asarray(imaging.camera.projection.height(jnp.asarray(angles)))
    column, row = map(float, imaging.axis_place)

    def project(rays: Rays) -> Places:
        up, across = np.sin(rays[:, 0]), rays[:, 1]
        off = np.hypot(up, across)
        radius = np.interp(np.arctan2(off, np.cos(rays[:, 0])), angles, radii)
        scale = np.where(off > 0, radius / np.where(off > 0, off, 1.0), focal)
        return np.stack([column + scale * across, row - scale * up], axis=-1)

    return Lens(np.ascontiguousarray(imaging.ray_map()), project)


def corner_model(
    scene: Scene,
    imaging: Imaging,
    catalog: ViewCatalog,
    deviations: Fabrication,
    carried: Sequence[int],
) -> CornerModel:
    """What predicts the corners of the wanted views from the finger's errors and pose.

    Args:
        scene: as designed.
        imaging: its camera's image.
        catalog: its views.
        deviations: standard deviation of every error of fabrication.
        carried: indices of the blockers that move with the camera.
    """
    families, paths = wanted_views(catalog), paths_of(scene.layout, scene.layout.bounces)
    names, pads = name_paths(scene.layout), [pad.name for pad in scene.layout.pads]
    views = tuple((paths[names.index(view.path)], pads.index(view.pad)) for view in families)
    predict = Predictor(
        scene, imaging, deviations, jnp.asarray(catalog.width), views, tuple(carried)
    )
    asked = tuple((view.pad, view.path) for view in families)
    joints = tuple(view.joint for view in families)
    limits = float(ANGLES[0]), float(ANGLES[-1])
    errors = sum(leaf.size for leaf in jax.tree.leaves(deviations))
    return CornerModel(predict, asked, joints, errors, scene.angle_names, limits)


class Predictor(eqx.Module):
    """Corners of the wanted views from a finger's errors and joint angles.

    Attributes:
        scene: as designed.
        imaging: its camera's image.
        deviations: standard deviation of every error of fabrication.
        width: of the pads, mm.
        views: mirrors along the path, and index of the pad, of every view.
        carried: indices of the blockers that move with the camera.
        channel: the color, by its index among `CHANNELS`.
    """

    scene: Scene
    imaging: Imaging
    deviations: Fabrication
    width: Float[Array, ""]
    views: tuple[tuple[tuple[int, ...], int], ...] = eqx.field(static=True)
    carried: tuple[int, ...] = eqx.field(static=True)
    channel: int = eqx.field(static=True, default=GREEN)

    @eqx.filter_jit  # a search predicts in many places: they are traced once
    def __call__(
        self, errors: Float[Array, " errors"], angles: Float[Array, " joints"]
    ) -> Float[Array, "views 4 2"]:
        """Column and row of every corner; errors in units of their deviations, angles in rad."""
        fabrication = scale_errors(self.deviations, errors)
        made = perturb(self.scene, fabrication, carried=self.carried)
        imaging = eqx.tree_at(lambda imaging: imaging.camera, self.imaging, made.camera)
        given = angles, fabrication, imaging, self.width, self.views
        return find_corners_in_space(made, *given, channel=self.channel)


def fit_joint_edges(
    model: CornerModel,
    sightings: Sequence[Sighting],
    labels: Float[np.ndarray, "frames joints"],
    *,
    label_deviation: float,
    edge_deviation: float,
) -> list[EdgeEstimator]:
    """For every joint, curves of the ends of the views that it moves, from labelled frames.

    Args:
        model: of the finger.
        sightings: what was found in the frames.
        labels: joint angles in each, rad.
        label_deviation: standard deviation of the labels, rad.
        edge_deviation: standard deviation of an end's section angle, rad.
    """
    return [
        fit_edges(
            sightings,
            labels[:, joint],
            [view for view, j in zip(model.views, model.joints, strict=True) if j == joint],
            label_deviation=label_deviation,
            edge_deviation=edge_deviation,
        )
        for joint in range(len(model.names))
    ]


def gap_table(scene: Scene, catalog: ViewCatalog, pad: str) -> GapTable:
    """The gap between a pad's direct view and its mirror view, over its joint's angle.

    Raises:
        ValueError: the pad has no such views, or they never show facing ends together.
    """
    families = {family.reflections: family for family in wanted_views(catalog) if family.pad == pad}
    if 0 not in families or 1 not in families or families[0].joint is None:
        raise ValueError(f"pad '{pad}' has no direct view and mirror view that a joint moves")
    joint = families[0].joint
    poses = np.zeros((len(ANGLES), len(scene.angle_names)))
    poses[:, joint] = ANGLES
    index = [surface.name for surface in scene.layout.pads].index(pad)
    paths = [name_paths(scene.layout).index(families[i].path) for i in range(2)]
    angles = np.asarray(_outline_angles(scene, jnp.asarray(poses)))[:, paths, index]
    ends = np.stack([families[i].ends for i in range(2)], axis=1)
    return GapTable.of(pad, families[1].path, ANGLES, angles[:, 0], angles[:, 1], ends)


@eqx.filter_jit
def _outline_angles(
    scene: Scene, poses: Float[Array, "values joints"]
) -> Float[Array, "values paths pads 2"]:
    return jax.vmap(lambda pose: find_outlines(scene, pose).angle)(poses)
