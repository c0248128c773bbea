"""Every view that a finger can show: where its corners are, and what of it is seen, over joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from optics import (
    Fabrication,
    Imaging,
    Scene,
    find_corners_in_space,
    find_sides_in_space,
    find_views,
    perturb,
    scale_errors,
)
from optics.scene.camera import Equidistant
from optics.visibility.boundary_codes import LEFT_LIMIT, RIGHT_LIMIT, is_own_end
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, name_paths
from perception.lengths import apparent_length
from perception.lens import Lens
from perception.matching import BORDER, ViewCatalog, ViewFamily, rms_of_ends
from perception.straightening import SHARES, find_straight_corners

ANGLES = np.deg2rad(np.linspace(-2.0, 92.0, 95))
"""Values of every joint in the catalogue: every degree of the range, and what errors add."""

MADE = 32
"""Fingers with errors of fabrication, beside the designed one, that show what others may show."""


class PosedViews(NamedTuple):
    """One finger in the poses of a catalogue; arrays of the shape (joints, values, paths, pads).

    Attributes:
        corners: where they are imaged.
        seen: whether anything is seen.
        ends: whether the view ends where the pad does, its bezel or layers, or the image, at its
            first and at its second end.
        unhidden: whether one view reaches from one such end to the other.
        whole: whether it reaches from one end of the pad to the other.
    """

    corners: Float[np.ndarray, "*views 4 2"]
    seen: Bool[np.ndarray, "*views"]
    ends: Bool[np.ndarray, "*views 2"]
    unhidden: Bool[np.ndarray, "*views"]
    whole: Bool[np.ndarray, "*views"]


def catalog_of(
    scene: Scene,
    imaging: Imaging,
    lens: Lens,
    width: float,
    deviations: Fabrication,
    carried: Sequence[int],
) -> ViewCatalog:
    """Every view that the finger can show, for all values of the joint that moves it.

    Wanted are those of every pad that moves against the camera, directly and in the mirror of its
    own phalanx, and those of other pads directly.

    Args:
        scene: as designed.
        imaging: its camera's image.
        lens: the rays of that image.
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
    # The finger without errors is the first of them: all are seen by one program.
    drawn = np.zeros((1 + MADE, sum(leaf.size for leaf in jax.tree.leaves(deviations))))
    drawn[1:] = np.random.default_rng(0).standard_normal(drawn[1:].shape)
    own, *made = (
        find_posed_views(*_made(scene, imaging, deviations, carried, numbers), width, poses)
        for numbers in drawn
    )
    others = PosedViews(*map(np.array, zip(*made, strict=True)))
    together = PosedViews(*(np.concatenate([a[None], b]) for a, b in zip(own, others, strict=True)))
    complete, shown = np.mean(together.whole, axis=0), np.sum(together.seen, axis=0)
    hidden = np.sum(together.seen & ~together.unhidden, axis=0)
    # Where the view is about to vanish, a finger without it would hide a part a little before.
    hidden = np.maximum(hidden, shown < len(together.seen))
    possible, unhidden = shown > 0, 1 - hidden / np.maximum(shown, 1)
    always = np.all(together.ends, axis=0)
    spread = np.sqrt(np.mean(rms_of_ends(others.corners - own.corners) ** 2, axis=0))
    # `Lens.rays` ends at the image's border; these do not.
    rays = np.asarray(_rays_of(imaging, jnp.asarray(together.corners)))
    bends = _bends(scene, imaging, lens, width, poses, own.corners)
    families = []
    names, words = name_paths(layout), paths_of(layout, layout.bounces)
    for path, pad in np.argwhere(own.seen.any(axis=(0, 1))).tolist():
        surface, own_corners = layout.pads[pad], own.corners[:, :, path, pad]
        moved = np.flatnonzero(np.ptp(own_corners, axis=1).max(axis=(1, 2)) > 1e-6).tolist()
        in_own_mirror = all(layout.mirrors[mirror].frame == surface.frame for mirror in words[path])
        if len(moved) > 1:
            if in_own_mirror:
                raise ValueError(
                    f"the view of pad '{surface.name}' by {names[path]} moves with several joints; "
                    "a catalogue holds views that one joint moves"
                )
            continue
        joint, values = (moved[0], slice(None)) if moved else (None, slice(0, 1))
        at = (joint or 0, values, path, pad)
        visible, anywhere, whole, clear, ends = (
            _of_joint(part[:, :, path, pad], joint)
            for part in (own.seen, possible, complete, unhidden, always)
        )
        families.append(
            ViewFamily(
                pad=surface.name,
                path=names[path],
                reflections=len(words[path]),
                joint=joint,
                angles=ANGLES[values],
                corners=own.corners[at],
                visible=visible,
                possible=anywhere,
                complete=whole,
                unhidden=clear,
                ends=ends,
                spread=spread[at],
                extent=_extent(rays[(slice(None), *at)], width),
                bend=bends[at] if bends is not None else np.zeros_like(own.corners[at]),
                wanted=in_own_mirror,
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


def _extent(
    rays: Float[np.ndarray, "fingers values 4 2"], width: float
) -> Float[np.ndarray, "values 2"]:
    """Apparent length of a pad in its views, and its standard deviation over fingers, mm."""
    lengths = apparent_length(rays, width)
    return np.stack([lengths[0], np.std(lengths[1:], axis=0)], axis=-1)


def _bends(
    scene: Scene,
    imaging: Imaging,
    lens: Lens,
    width: float,
    poses: Float[np.ndarray, "joints values joints"],
    corners: Float[np.ndarray, "*views 4 2"],
) -> Float[np.ndarray, "*views 4 2"] | None:
    """What lines through the sides of the views meet off their corners; ``None`` for straight ones.

    A mirror's bow is an error that no catalogue has.
    """
    if scene.layers is None and scene.camera.pupil_shift is None:
        return None
    sides = _sides_of(scene, imaging, jnp.asarray(poses), width, _views_of(scene))
    rays = np.asarray(_rays_of(imaging, sides))
    rays = rays.reshape(-1, *rays.shape[-3:])
    straight = np.stack([find_straight_corners(one, lens) for one in rays])
    # Seen edge-on a pad has no corners; such a view is too flat to count.
    return np.nan_to_num(straight.reshape(corners.shape) - corners, nan=0.0)


@eqx.filter_jit
def _made(
    scene: Scene,
    imaging: Imaging,
    deviations: Fabrication,
    carried: Sequence[int],
    numbers: Float[Array | np.ndarray, " errors"],
) -> tuple[Scene, Imaging, Fabrication]:
    """A finger, its camera's image and its errors: so many times their deviations."""
    errors = scale_errors(deviations, jnp.asarray(numbers))
    one = perturb(scene, errors, carried=carried)
    return one, eqx.tree_at(lambda imaging: imaging.camera, imaging, one.camera), errors


def find_posed_views(
    scene: Scene,
    imaging: Imaging,
    errors: Fabrication,
    width: float,
    poses: Float[np.ndarray, "joints values joints"],
) -> PosedViews:
    """What a finger shows in several poses."""
    views, pads = _views_of(scene), len(scene.layout.pads)
    shape = *poses.shape[:2], len(views) // pads, pads
    corners = np.asarray(_corners_of(scene, imaging, errors, jnp.asarray(poses), width, views))
    # Where views end does not depend on the lens: one program is compiled for all lenses.
    plain = eqx.tree_at(lambda scene: scene.camera.projection, scene, Equidistant())
    pieces: Pieces = jax.tree.map(np.asarray, _pieces_of(plain, jnp.asarray(poses)))
    first, second = is_own_end(pieces.start_label, 0), is_own_end(pieces.end_label, 1)
    # What is beyond a field of view that ends within the image is hidden, not cut off by a border.
    fills_image = imaging.camera.pixel(imaging.camera.field_of_view / 2) < BORDER
    limits = (LEFT_LIMIT, RIGHT_LIMIT) if fills_image else ()
    first_or_limit = first | np.isin(pieces.start_label, limits)
    second_or_limit = second | np.isin(pieces.end_label, limits)
    by_end_face = np.zeros_like(pieces.present) if pieces.face is None else pieces.face > 0
    by_path = []
    for path in range(shape[2]):
        there = pieces.present & (pieces.path == path)
        # A view through a clear end adjoins the one through the top: together they have no corners.
        alone = there & ~np.any(there & by_end_face, axis=-1, keepdims=True)
        by_path.append(
            [
                there,
                alone & first_or_limit,
                alone & second_or_limit,
                alone & first_or_limit & second_or_limit,
                alone & first & second,
            ]
        )
    seen, *ends, unhidden, whole = (
        np.stack([np.any(kind, axis=-1) for kind in kinds], axis=-2)
        for kinds in zip(*by_path, strict=True)
    )
    by_end = np.stack(ends, axis=-1)
    return PosedViews(corners.reshape(*shape, 4, 2), seen, by_end, unhidden, whole)


def _views_of(scene: Scene) -> tuple[tuple[tuple[int, ...], int], ...]:
    """Every path, and the pads by it."""
    words, pads = paths_of(scene.layout, scene.layout.bounces), range(len(scene.layout.pads))
    return tuple((word, pad) for word in words for pad in pads)


@eqx.filter_jit
def _sides_of(
    scene: Scene,
    imaging: Imaging,
    poses: Float[Array, "*batch joints"],
    width: float,
    views: Sequence[tuple[tuple[int, ...], int]],
) -> Float[Array, "*batch views 4 points 2"]:
    none = Fabrication.none(scene.layout)

    def one(pose: Float[Array, " joints"]) -> Float[Array, "views 4 points 2"]:
        return find_sides_in_space(scene, pose, none, imaging, width, views, SHARES)

    return jax.vmap(jax.vmap(one))(poses)


_rays_of = eqx.filter_jit(Imaging.ray)


@eqx.filter_jit
def _pieces_of(scene: Scene, poses: Float[Array, "*batch joints"]) -> Pieces:
    # Compiled without margins, which take long.
    return find_views(scene, poses).value


@eqx.filter_jit
def _corners_of(
    scene: Scene,
    imaging: Imaging,
    errors: Fabrication,
    poses: Float[Array, "*batch joints"],
    width: float,
    views: Sequence[tuple[tuple[int, ...], int]],
) -> Float[Array, "*batch views 4 2"]:
    def one(pose: Float[Array, " joints"]) -> Float[Array, "views 4 2"]:
        return find_corners_in_space(scene, pose, errors, imaging, width, views)

    return jax.vmap(jax.vmap(one))(poses)


def wanted_views(catalog: ViewCatalog) -> list[ViewFamily]:
    """The views that are asked for, in the order of the catalogue."""
    return [family for family in catalog.families if family.wanted]
