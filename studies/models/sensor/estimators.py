"""What the optics predict of a finger, in the form in which perception takes it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from optics import Fabrication, Imaging, Scene, find_views, perturb, scale_errors
from optics.scene.camera import Equidistant
from optics.visibility.outlines import find_corners, find_outlines
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, name_paths
from perception.lens import Lens, Places, Rays
from perception.matching import Sighting, ViewCatalog, ViewFamily, rms_of_ends
from perception.proprioception import CornerModel, EdgeEstimator, GapTable, fit_edges

ANGLES = np.deg2rad(np.linspace(-2.0, 92.0, 95))
"""Values of every joint in the catalogue: every degree of the range, and what errors add."""

WHOLE = 1e-6
"""What is seen but for this part of a pad is all of it: rounding."""

MADE = 8
"""Fingers with errors of fabrication, beside the designed one, that show what others may show."""


def lens_of(imaging: Imaging) -> Lens:
    """The camera's rays for the analysis of its images."""

    def project(rays: Rays) -> Places:
        return np.asarray(_placed(imaging, rays))

    return Lens(np.ascontiguousarray(imaging.ray_map()), project)


@eqx.filter_jit
def _placed(imaging: Imaging, rays: Float[Array | np.ndarray, "_ 2"]) -> Float[Array, "_ 2"]:
    return imaging.place(jnp.asarray(rays[:, 0]), jnp.asarray(rays[:, 1]))


def catalog_of(
    scene: Scene, imaging: Imaging, width: float, deviations: Fabrication, carried: Sequence[int]
) -> ViewCatalog:
    """Every view that the finger can show, for all values of the joint that moves it.

    Wanted are those of every pad that moves against the camera, directly and in the mirror of its
    own phalanx, and those of other pads directly.

    Args:
        scene: as designed.
        imaging: its camera's image.
        width: of the pads, mm.
        deviations: standard deviation of every error of fabrication.
        carried: indices of the blockers that move with the camera.

    Raises:
        ValueError: several joints move a view of a pad in its own mirror.
    """
    layout, joints = scene.layout, len(scene.angle_names)
    poses = np.zeros((joints, len(ANGLES), joints))
    for joint in range(joints):
        poses[joint, :, joint] = ANGLES
    look = partial(_looked_at, poses=jnp.asarray(poses), width=width)
    corners, seen, ends_seen = look(scene, imaging)
    others = [look(*made) for made in _made(scene, imaging, deviations, carried)]
    all_corners, all_seen, all_ends = map(np.array, zip(*others, strict=True))
    all_seen = np.concatenate([seen[None], all_seen])
    whole = np.asarray(np.mean(all_seen >= 1 - WHOLE, axis=0))
    possible = np.asarray(np.any(all_seen > 0, axis=0))
    always = ends_seen & all_ends.all(axis=0)
    spread = np.sqrt(np.mean(rms_of_ends(all_corners - corners) ** 2, axis=0))
    families = []
    names, words = name_paths(layout), paths_of(layout, layout.bounces)
    for path, pad in np.argwhere(seen.max(axis=(0, 1)) > 0).tolist():
        surface, own_corners = layout.pads[pad], corners[:, :, path, pad]
        moved = np.flatnonzero(np.ptp(own_corners, axis=1).max(axis=(1, 2)) > 1e-6).tolist()
        own = all(layout.mirrors[mirror].frame == surface.frame for mirror in words[path])
        if len(moved) > 1:
            if own:
                raise ValueError(
                    f"the view of pad '{surface.name}' by {names[path]} moves with several joints; "
                    "a catalogue holds views that one joint moves"
                )
            continue
        joint, values = (moved[0], slice(None)) if moved else (None, slice(0, 1))
        at = (joint or 0, values, path, pad)
        visible, anywhere, complete, ends = (
            _of_joint(part[:, :, path, pad], joint) for part in (seen > 0, possible, whole, always)
        )
        families.append(
            ViewFamily(
                pad=surface.name,
                path=names[path],
                reflections=len(words[path]),
                joint=joint,
                angles=ANGLES[values],
                corners=corners[at],
                visible=visible,
                possible=anywhere,
                complete=complete,
                ends=ends,
                spread=spread[at],
                wanted=own,
            )
        )
    pads, by_name = np.asarray(scene.pads), [pad.name for pad in layout.pads]
    lengths = np.hypot(*(pads[:, 1] - pads[:, 0]).T).tolist()
    return ViewCatalog(
        families,
        lengths=dict(zip(by_name, lengths, strict=True)),
        grazing=dict(zip(by_name, np.asarray(scene.grazing).tolist(), strict=True)),
        width=width,
        joints=joints,
    )


def _of_joint(part: np.ndarray, joint: int | None) -> np.ndarray:
    """What is seen over the values of a joint, from that over the joints and their values."""
    # Where no joint moves a view, what is hidden in some poses is still seen in others.
    return part.max(axis=(0, 1))[None] if joint is None else part[joint]


def _made(
    scene: Scene, imaging: Imaging, deviations: Fabrication, carried: Sequence[int]
) -> Iterator[tuple[Scene, Imaging]]:
    """Fingers with errors of fabrication, and their cameras' images."""
    generator = np.random.default_rng(0)
    for _ in range(MADE):
        errors = generator.standard_normal(sum(leaf.size for leaf in jax.tree.leaves(deviations)))
        made = perturb(scene, scale_errors(deviations, jnp.asarray(errors)), carried=carried)
        yield made, eqx.tree_at(lambda imaging: imaging.camera, imaging, made.camera)


def _looked_at(
    scene: Scene, imaging: Imaging, poses: Float[Array, "joints values joints"], width: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every pose, path and pad: corners, the part that is seen, and which ends are."""
    corners = _corners_of(scene, imaging, poses, width)
    # Where views end does not depend on the lens: one program is compiled for all lenses.
    plain = eqx.tree_at(lambda scene: scene.camera.projection, scene, Equidistant())
    pieces: Pieces = jax.tree.map(np.asarray, _pieces_of(plain, poses))
    shares, ends = [], []
    for path in range(len(paths_of(scene.layout, scene.layout.bounces))):
        there = pieces.present & (pieces.path == path)
        shares.append(np.where(there, pieces.end - pieces.start, 0.0).sum(axis=-1))
        first = (there & (pieces.start <= WHOLE)).any(axis=-1)
        second = (there & (pieces.end >= 1 - WHOLE)).any(axis=-1)
        ends.append(np.stack([first, second], axis=-1))
    return np.asarray(corners), np.stack(shares, axis=-2), np.stack(ends, axis=-3)


@eqx.filter_jit
def _pieces_of(scene: Scene, poses: Float[Array, "*batch joints"]) -> Pieces:
    # Compiled without margins, which take long.
    return find_views(scene, poses).value


@eqx.filter_jit
def _corners_of(
    scene: Scene, imaging: Imaging, poses: Float[Array, "*batch joints"], width: float
) -> Float[Array, "*batch paths pads 4 2"]:
    def one(pose: Float[Array, " joints"]) -> Float[Array, "paths pads 4 2"]:
        return find_corners(imaging, find_outlines(scene, pose), width)

    return jax.vmap(jax.vmap(one))(poses)


def wanted_views(catalog: ViewCatalog) -> list[ViewFamily]:
    """The views that are asked for, in the order of the catalogue."""
    return [family for family in catalog.families if family.wanted]


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
    views = wanted_views(catalog)
    names, pads = name_paths(scene.layout), [pad.name for pad in scene.layout.pads]
    of_path = tuple(names.index(view.path) for view in views)
    of_pad = tuple(pads.index(view.pad) for view in views)
    finger = scene, imaging, deviations, jnp.asarray(catalog.width)
    predict = Predictor(*finger, of_path, of_pad, tuple(carried))
    asked, joints = tuple((view.pad, view.path) for view in views), tuple(v.joint for v in views)
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
        paths: of every view, the index of its path.
        pads: and of its pad.
        carried: indices of the blockers that move with the camera.
    """

    scene: Scene
    imaging: Imaging
    deviations: Fabrication
    width: Float[Array, ""]
    paths: tuple[int, ...] = eqx.field(static=True)
    pads: tuple[int, ...] = eqx.field(static=True)
    carried: tuple[int, ...] = eqx.field(static=True)

    def __call__(
        self, errors: Float[Array, " errors"], angles: Float[Array, " joints"]
    ) -> Float[Array, "views 4 2"]:
        """Column and row of every corner; errors in units of their deviations, angles in rad."""
        fabrication = scale_errors(self.deviations, errors)
        made = perturb(self.scene, fabrication, carried=self.carried)
        imaging = eqx.tree_at(lambda imaging: imaging.camera, self.imaging, made.camera)
        outlines = find_outlines(made, angles)
        corners = find_corners(imaging, outlines, self.width, fabrication.lateral)
        return corners[np.array(self.paths), np.array(self.pads)]


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
