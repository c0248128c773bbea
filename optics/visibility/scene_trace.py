"""All that `designopt trace` computes, pose by pose in blocks, so that memory stays bounded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.errors import UserError
from designopt.programs import Program
from designopt.solution import Solution
from optics.scene.imaging import Imaging
from optics.scene.scene import Layout, Scene, place
from optics.visibility.coverage import find_views
from optics.visibility.edge_refined import RAYS, trace_views
from optics.visibility.focus import Focus, find_blur, find_focus
from optics.visibility.outline_edges import SAMPLES, OutlineEdges, find_outline_edges
from optics.visibility.second_images import clear_walls, find_second_images, find_second_outlines
from optics.visibility.sharpness import PARTS, ROUNDING, Sharpness, find_sharpness
from optics.visibility.tracing import Hits, trace_rays
from optics.visibility.unfolding import paths_of, unfold_all
from optics.visibility.views import Pieces, name_paths

SIZES = (1, 8, 64, 512)
"""Poses that are computed at a time."""

MEMORY = 2**28
"""Bytes that one block of poses may take, about."""

MOST_MEMORY = 2**32
"""Bytes that a single pose, or what is kept of all of them, may take."""

PER_PAD, PER_PATH = 500, 24
"""Bytes that are kept of every pose for a pad and for a path to it, about."""

OUTLINE = 4 * (2 * SAMPLES - 1) * 24
"""The same for an outline."""

Poses = Float[np.ndarray, "poses joints"]


class LayerImages(eqx.Module):
    """Whole outlines of layered pads and second images, in NumPy arrays; poses first.

    Attributes:
        outlines: those of all pads; none if no pad has a width, or rays slide.
        places: where their points are imaged: column and row.
        second: what appears in clear ends; none if there are none.
        corners: where the corners of second images are imaged, in all clear walls, those beside
            the section last; none likewise.
        mirrored: whether they have such corners.
    """

    outlines: OutlineEdges | None
    places: Float[Array, "*poses paths pads 4 points 2"] | None
    second: Pieces | None
    corners: Float[Array, "*poses paths walls 4 2"] | None
    mirrored: Bool[Array, "..."]


class Views(eqx.Module):
    """What is seen of the pads, in NumPy arrays; the first axis is that of the poses.

    Attributes:
        found: pieces, margins (rad) and results, with no more room than the poses need.
        codes: number of the result, shape (poses, paths, pads); messages in `REASONS`.
        coverage: part of each pad that is seen, shape (poses, pads).
        redundancy: mean number of paths that show a point of it, shape (poses, pads).
        sharpness: resolution of what is seen.
        focus: its blur and how much of it is sharp; none if the camera has no lens.
        working_blur: blur at the least and greatest distance of every piece, pixels; none likewise.
    """

    found: Solution[Pieces]
    codes: Int[np.ndarray, "poses paths pads"]
    coverage: Float[np.ndarray, "poses pads"]
    redundancy: Float[np.ndarray, "poses pads"]
    sharpness: Sharpness
    focus: Focus | None
    working_blur: Float[np.ndarray, "poses pads pieces 2"] | None = None


@dataclass(frozen=True)
class Images:
    """The virtual cameras of a scene of straight mirrors.

    Attributes:
        position: mm, shape (poses, paths, 2); the path without mirrors shows the camera itself.
        faces: whether camera and images are in front of all mirrors of the path.
    """

    position: Float[np.ndarray, "poses paths 2"]
    faces: Bool[np.ndarray, "poses paths"]


@dataclass(frozen=True)
class SceneTrace:
    """Everything that was computed.

    Attributes:
        scene: the scene.
        bounces: most reflections of a path or ray.
        paths: names of the paths.
        words: the mirrors along them.
        angles_deg: joint angles as they were asked for, degrees, shape (poses, joints).
        views: what is seen; none if the scene has no pads.
        images: the virtual cameras; none if a mirror is curved.
        rays: starts (mm) and directions (degrees) of the rays.
        hits: where the rays go, shape (poses, rays, legs); none if there are no rays.
        layers: outlines and second images; none if no pad has layers.
    """

    scene: Scene
    bounces: int
    paths: list[str]
    words: list[tuple[int, ...]]
    angles_deg: Poses
    views: Views | None
    images: Images | None
    rays: Float[np.ndarray, "rays 3"]
    hits: Hits | None
    layers: LayerImages | None = None


def trace_sweep(
    scene: Scene, angles_deg: Poses, bounces: int, rays: Float[np.ndarray, "rays 3"]
) -> SceneTrace:
    """What the camera sees and where rays go.

    Args:
        scene: the scene.
        angles_deg: joint angles in the order of ``scene.angle_names``, degrees.
        bounces: most reflections of a path or ray.
        rays: starts (mm) and directions (degrees) of rays that are followed in every pose.

    Raises:
        UserError: there are so many paths or poses that they do not fit into memory.
    """
    layout = scene.layout
    size, paths = _bytes_of_pose(layout, bounces), sum(_path_counts(layout, bounces))
    of_path = PER_PATH + (0 if scene.layers is None else OUTLINE)
    kept = len(angles_deg) * len(layout.pads) * (PER_PAD + of_path * paths)
    if max(size, kept) > MOST_MEMORY:
        raise UserError(
            f"--bounces {bounces}: {paths:,} paths in {len(angles_deg):,} poses do not fit into "
            "memory; ask for fewer reflections, or sweep fewer poses"
        )
    # Programs are for all scenes that differ in their title and in dimensions alone.
    given, scene = scene, replace(scene, layout=replace(layout, name=""))
    block, poses = max(MEMORY // size, 1), np.deg2rad(angles_deg)
    views = images = hits = layers = None
    if layout.pads:
        views = _views(scene, poses, bounces, block)
    if not layout.curved:
        shown = partial(_images, scene, bounces=bounces)
        images = Images(*_joined(_in_blocks(shown, block, poses)))
    if len(rays):
        follow = partial(_follow, scene, rays[:, :2], np.deg2rad(rays[:, 2]), bounces=bounces)
        hits = _joined(_in_blocks(follow, block, poses))
    if scene.layers is not None:
        shown = partial(_layer_images, scene, Imaging.of(scene.camera), bounces=bounces)
        layers = _joined(_in_blocks(shown, block, poses))
    names = name_paths(layout, bounces)
    words = paths_of(layout, bounces)
    return SceneTrace(given, bounces, names, words, angles_deg, views, images, rays, hits, layers)


def _views(scene: Scene, poses: Poses, bounces: int, block: int) -> Views:
    seen = _in_blocks(lambda part: _seen(scene, part, bounces=bounces), block, poses)
    parts = [(_with_room(one, max(_most_pieces(one), 1)), *more) for one, *more in seen]
    max_pieces = max(found.value.present.shape[-1] for found, *_ in parts)
    found, coverage, redundancy = _joined(
        (_with_room(one, max_pieces), *more) for one, *more in parts
    )

    def measure(part: Poses, pieces: Pieces) -> Sharpness:
        return find_sharpness(scene, part, pieces, bounces=bounces)

    # What is compared of a pad: all pieces at places between all of their ends.
    compared = 48 * len(scene.layout.pads) * 2 * max_pieces**2 * PARTS
    block = max(MEMORY // compared, 1)
    sharpness = _joined(_in_blocks(measure, block, poses, found.value))
    focus = working = None
    if scene.camera.lens is not None:
        focus = _joined(_in_blocks(partial(_focus, scene), block, found.value))
        distances = sharpness.object_distance
        working = _joined(_in_blocks(partial(_blur, scene.camera), block, distances))
    codes = jax.tree.leaves(found.result)[0]
    return Views(found, codes, coverage, redundancy, sharpness, focus, working)


@partial(Program, static_argnames=["bounces"])
def _seen(
    scene: Scene, poses: Float[Array, "poses joints"], *, bounces: int
) -> tuple[Solution[Pieces], Float[Array, "poses pads"], Float[Array, "poses pads"]]:
    """The pieces of all pads, and their coverage and redundancy."""
    engine = trace_views if scene.layout.curved else find_views
    found = engine(scene, poses, bounces=bounces)
    coverage = found.value.coverage()
    coverage = jnp.where(coverage > ROUNDING, coverage, 0.0)
    return found, coverage, found.value.redundancy()


@Program
def _focus(scene: Scene, pieces: Pieces) -> Focus:
    return jax.vmap(lambda pieces: find_focus(scene, pieces))(pieces)


_blur = Program(find_blur)


def _most_pieces(found: Solution[Pieces]) -> int:
    return int(np.max(np.sum(found.value.present, axis=-1)))


def _with_room(found: Solution[Pieces], max_pieces: int) -> Solution[Pieces]:
    """Views with room for so many pieces, at least as many as there are: those come first."""

    def resized(leaf: np.ndarray) -> np.ndarray:
        kept = leaf[:, :, :max_pieces]
        added = [(0, 0), (0, 0), (0, max_pieces - kept.shape[2]), *[(0, 0)] * (kept.ndim - 3)]
        return np.pad(kept, added)

    return eqx.tree_at(lambda found: found.value, found, jax.tree.map(resized, found.value))


@partial(Program, static_argnames=["bounces"])
def _images(
    scene: Scene, poses: Float[Array, "poses joints"], *, bounces: int
) -> tuple[Float[Array, "poses paths 2"], Bool[Array, "poses paths"]]:
    """Virtual cameras, mm, and whether all mirrors of their paths face them."""

    def in_pose(angles: Float[Array, " joints"]) -> tuple[Array, Array]:
        placed = place(scene, angles)
        paths = unfold_all(scene.layout, placed, paths_of(scene.layout, bounces))
        return placed.absolute(paths.source).stacked(), ~jnp.any(paths.turned_away, axis=-1)

    return jax.vmap(in_pose)(poses)


@partial(Program, static_argnames=["bounces"])
def _layer_images(
    scene: Scene, imaging: Imaging, poses: Float[Array, "poses joints"], *, bounces: int
) -> LayerImages:
    ends, beside = (clear_walls(scene.layout, beside) for beside in (False, True))

    def in_pose(angles: Float[Array, " joints"]) -> LayerImages:
        outlines = places = second = corners = None
        mirrored = jnp.zeros(0, bool)
        if ends:
            second = find_second_images(scene, angles, bounces=bounces)
        if scene.widths is not None and not scene.rays_slide:
            outlines = find_outline_edges(scene, angles, bounces=bounces)
            places = outlines.places(imaging)
            if ends or beside:
                found = find_second_outlines(scene, angles, bounces=bounces)
                mirrored = found.edges.present & found.total
                corners = found.edges.places(imaging)[..., 0, :]
        return LayerImages(outlines, places, second, corners, mirrored)

    return jax.vmap(in_pose)(poses)


@partial(Program, static_argnames=["bounces"])
def _follow(
    scene: Scene,
    starts: Float[Array, "rays 2"],
    directions: Float[Array, " rays"],
    poses: Float[Array, "poses joints"],
    *,
    bounces: int,
) -> Hits:
    return jax.vmap(lambda angles: trace_rays(scene, angles, starts, directions, bounces=bounces))(
        poses
    )


def _in_blocks(function: Callable[..., Any], size: int, *trees: Any) -> Iterator[Any]:
    """A function of poses, applied to so many at a time; results in NumPy arrays."""
    count = len(jax.tree.leaves(trees)[0])
    # Blocks are filled up to few sizes, so that programs serve further blocks and sweeps.
    size = min(size, next((size for size in SIZES if count <= size), SIZES[-1]))
    for begin in range(0, count, size):
        rows = np.minimum(np.arange(begin, begin + size), count - 1)
        found = function(*jax.tree.map(lambda leaf, rows=rows: np.asarray(leaf)[rows], trees))
        yield jax.tree.map(lambda leaf, left=count - begin: np.asarray(leaf)[:left], found)


def _joined(parts: Iterable[Any]) -> Any:
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _bytes_of_pose(layout: Layout, bounces: int) -> int:
    """What a pose takes in memory while it is computed, about."""
    surfaces, pads = len(layout.surfaces), max(len(layout.pads), 1)
    counts = _path_counts(layout, bounces)
    if layout.curved:
        return RAYS * (sum(counts) * (bounces + 1) + 100 * surfaces)
    # Of every path and pad a table of shadows by shadows, on as many legs as the longest path has.
    shadows = sum(count > 0 for count in counts) * surfaces + 2
    return 96 * pads * sum(counts) * shadows**2


def _path_counts(layout: Layout, bounces: int) -> list[int]:
    """How many paths there are of every length, as `paths_of` lists them."""
    bent, straight = len(layout.curved), len(layout.mirrors) - len(layout.curved)
    ends_bent, ends_straight, counts = bent, straight, [1]
    for _ in range(bounces):
        counts.append(ends_bent + ends_straight)
        # A straight mirror never follows itself.
        ends_bent, ends_straight = bent * counts[-1], straight * counts[-1] - ends_straight
    return counts
