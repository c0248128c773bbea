"""Exact visibility: which parts of each pad a camera sees, directly and in straight mirrors.

What bounds which piece is searched without derivatives (`optics.visibility.searching`). The ends
are then computed again from the bounds that the search has found, and this carries the derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from designopt.batching import map_in_chunks
from designopt.numerics import as_float
from designopt.programs import QuickJit
from designopt.solution import Solution
from designopt.vectors import Vector
from optics.scene.camera import Camera
from optics.scene.scene import Placed, Scene, place
from optics.visibility.boundaries import Bound, label_of_bound, meeting
from optics.visibility.boundary_codes import PAD_ENDS
from optics.visibility.image_scale import look, reflections
from optics.visibility.intervals import Interval, measure_of_union
from optics.visibility.lines_of_sight import coordinates, scales
from optics.visibility.pads import Faces, Pad, Windows
from optics.visibility.refraction import Cover, Scale
from optics.visibility.searching import Found, find
from optics.visibility.unfolding import Unfolded, paths_of, unfold_all
from optics.visibility.views import Pieces, ViewResult
from optics.visibility.visibility_margin import angular_gap, margin

TABLE = 2**19
"""Comparisons of shadows with shadows that are made at a time, so that they stay in the cache."""


@partial(QuickJit, static_argnames=("bounces", "max_pieces"))
def find_views(
    scene: Scene,
    angles: Float[Array, "*batch joints"],
    *,
    bounces: int | None = None,
    max_pieces: int | None = None,
) -> Solution[Pieces]:
    """What the camera sees of every pad, directly and by up to ``bounces`` reflections.

    Args:
        scene: the scene, its mirrors straight; ``jax.vmap`` over it for a batch of designs.
        angles: joint angles in the order of ``scene.angle_names``, rad. Many poses are fastest
            in one array; a gradient keeps numbers of all of them, 80 kB for each pose of a finger.
        bounces: most reflections of a path; the scene's own number by default.
        max_pieces: most pieces in which a pad is seen; by default 8 and two for every path.

    Returns:
        The pieces of each pad. ``margin`` and ``result`` are of the shape (paths, pads), paths in
        the order of `name_paths`. ``margin`` (rad) is the angle at the (virtual) camera of the
        widest piece that is seen; of a pad that is not seen, minus the angle by which it is
        missed: by which the shadows, mirrors and limits that hide it must give way at least until
        a line of sight is free. Its derivative shows the way out. ``residual`` is 0: nothing is
        iterated. A surface through the camera hides nothing, and where surfaces lie on one
        another what is seen there means nothing.

    Raises:
        ValueError: a mirror is curved (`trace_views` sees in these), there is no pad, or a number
            of bounces or pieces makes no sense.

    Example:
        >>> from importlib.resources import files
        >>> from optics import name_paths, read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> pieces = find_views(scene, jnp.zeros(0)).value
        >>> [name_paths(scene.layout)[i] for i in pieces.path[pieces.present].tolist()]
        ['mirror:lower+upper']
    """
    words = _words(scene, bounces, max_pieces, "find_views")
    camera = scene.camera

    def search(camera: Camera, paths: Unfolded, faces: Faces) -> tuple[Found, Interval]:
        found = find(camera, paths, faces, max_pieces)
        return found, _by_path_and_face(partial(angular_gap, camera), paths, faces)

    def views(
        placed: Placed, paths: Unfolded, faces: Faces, searched: tuple[Found, Interval]
    ) -> Solution[Pieces]:
        found, widest = searched
        pieces = pieces_of(camera, placed.size, paths, faces, found)
        margins = faces.widest(_by_path_and_face(partial(margin, camera), paths, faces, widest))
        result = jax.tree.map(jnp.transpose, found.result)
        return Solution(pieces, margins, jnp.zeros_like(margins), result)

    return _in_poses(scene, as_float(angles), words, search, views)


def find_pieces(scene: Scene, angles: Float[Array, "*batch joints"]) -> Solution[Pieces]:
    """The pieces that `find_views` finds, without the angles by which pads are missed.

    It has two thirds of its equations. ``margin`` is as in `find_coverage`.
    """
    words = _words(scene, None, None, "find_pieces")

    def search(camera: Camera, paths: Unfolded, faces: Faces) -> Found:
        return find(camera, paths, faces, None)

    def pieces(placed: Placed, paths: Unfolded, faces: Faces, found: Found) -> Solution[Pieces]:
        seen = pieces_of(scene.camera, placed.size, paths, faces, found)
        result = jax.tree.map(jnp.transpose, found.result)
        return Solution(seen, found.free, jnp.zeros_like(found.free), result)

    return _in_poses(scene, as_float(angles), words, search, pieces)


@partial(QuickJit, static_argnames=("bounces", "max_pieces"))
def find_coverage(
    scene: Scene,
    angles: Float[Array, "*batch joints"],
    *,
    bounces: int | None = None,
    max_pieces: int | None = None,
) -> Solution[Float[Array, "*batch pads"]]:
    """Part of every pad that the camera sees, directly and by up to ``bounces`` reflections.

    The coverage of what `find_views` finds, and nothing else: it compiles faster.

    Args:
        scene: as in `find_views`.
        angles: as in `find_views`.
        bounces: as in `find_views`.
        max_pieces: as in `find_views`.

    Returns:
        The coverage, 0 to 1. ``margin`` and ``result`` are of its shape; ``margin`` is the room,
        and one, minus the number of pieces: if it is not positive, pieces were left out and the
        coverage is too small. ``residual`` is 0.

    Raises:
        ValueError: as in `find_views`.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/half-height-mirror.toml")
        >>> found = find_coverage(scene, jnp.zeros(0))
        >>> bool(found.ok.all()), [round(value, 4) for value in found.value.tolist()]
        (True, [1.0])
    """
    words = _words(scene, bounces, max_pieces, "find_coverage")

    def search(camera: Camera, paths: Unfolded, faces: Faces) -> Found:
        return find(camera, paths, faces, max_pieces)

    def coverage(
        placed: Placed, paths: Unfolded, faces: Faces, found: Found
    ) -> Solution[Float[Array, " pads"]]:
        *_, ends = _ends(scene.camera, paths, faces, found)
        seen = measure_of_union(ends[..., 0], ends[..., 1])
        return Solution(seen, found.free, jnp.zeros_like(seen), jax.vmap(_room_left)(found.free))

    return _in_poses(scene, as_float(angles), words, search, coverage)


def _words(
    scene: Scene, bounces: int | None, max_pieces: int | None, asked: str
) -> list[tuple[int, ...]]:
    """The paths, if everything that was given is as exact visibility needs it."""
    layout = scene.layout
    bounces = layout.bounces if bounces is None else bounces
    if bounces < 0 or (max_pieces is not None and max_pieces < 1):
        raise ValueError(f"{asked}: bounces must be 0 or more, and max_pieces 1 or more")
    if not layout.pads:
        raise ValueError(f"{asked}: the scene has no pad; trace_rays follows rays without one")
    if layout.curved:
        names = ", ".join(layout.mirrors[i].name for i in layout.curved)
        raise ValueError(f"{asked}: mirrors {names} are curved; use trace_views")
    return paths_of(layout, bounces)


def _in_poses(
    scene: Scene,
    angles: Float[Array, "*batch joints"],
    words: list[tuple[int, ...]],
    search: Callable[[Camera, Unfolded, Faces], Any],
    answer: Callable[[Placed, Unfolded, Faces, Any], Any],
) -> Any:
    """In every pose the answer from what a search without derivatives has found."""
    batch, layout = angles.shape[:-1], scene.layout

    def unfolded(angles: Float[Array, " joints"]) -> tuple[Placed, Unfolded, Faces]:
        placed = place(scene, angles)
        paths = unfold_all(layout, placed, words)
        return placed, paths, Faces.all_of(scene, placed, paths)

    if batch:
        poses = angles.reshape(math.prod(batch), angles.shape[-1])
        placed, paths, faces = jax.vmap(unfolded)(poses)
    else:
        placed, paths, faces = unfolded(angles)
    # The search decides by comparisons only: its derivatives would be 0, or those of the ends once
    # more, and a reverse pass would keep its tables.
    camera, still = jax.lax.stop_gradient((scene.camera, (paths, faces)))
    if not batch:
        return answer(placed, paths, faces, search(camera, *still))
    shadows = (len(words[-1]) + 1) * layout.solids.size + 1
    looked_at = len(layout.pads) + sum(face.kind == "clear" for face in layout.bodies)
    most = max(TABLE // (looked_at * len(words) * shadows**2), 1)
    found = map_in_chunks(jax.vmap(lambda view: search(camera, *view)), still, most)
    answers = jax.vmap(answer)(placed, paths, faces, found)
    return jax.tree.map(lambda leaf: leaf.reshape(*batch, *leaf.shape[1:]), answers)


def pieces_of(
    camera: Camera, size: Float[Array, ""], paths: Unfolded, faces: Faces, found: Found
) -> Pieces:
    """The pieces that were found, with their derivatives."""
    labels, entries, ends = _ends(camera, paths, faces, found)
    labels = jnp.where(found.present[..., None], labels, 0)

    def scale(cover: Cover | None, ends: Vector, entries: Array, by: Unfolded) -> Any:
        return scales(by, cover, ends, entries)

    def piece(pad: Pad, _: Windows, path: Int[Array, ""], *of_piece: Any) -> tuple[Any, ...]:
        return _seen(camera, size, pad, *of_piece)

    by = paths.at(found.path)
    scaled = faces.through(scale, found.face, entries, by)
    given = found.face, found.path, by, found.present, entries, scaled
    *seen, apparent, spans = faces.of_pieces(piece, *given)
    starts, stops = (ends[..., 0], ends[..., 1]), (labels[..., 0], labels[..., 1])
    return Pieces(
        found.present,
        found.path,
        *starts,
        *stops,
        *seen,
        spans=spans,
        face=found.face,
        apparent=apparent,
    )


def _by_path_and_face(
    function: Callable[..., Any], paths: Unfolded, faces: Faces, *more: Any
) -> Any:
    """A function of a path, a surface that is seen, and what belongs to both."""
    both = faces.windows, *more
    of_path = jax.vmap(function, (None, 0, *[0] * len(both)))
    return jax.vmap(of_path, (0, None, *[0] * len(both)))(paths, faces.seen, *both)


def _ends(
    camera: Camera, paths: Unfolded, faces: Faces, found: Found
) -> tuple[Array, Array, Array]:
    """Of the ends of all pieces their labels, and with derivatives entries and pad coordinates."""

    def ends(
        pad: Pad, inner: Windows, path: Int[Array, ""], by: Unfolded, bounds: Int[Array, "2"]
    ) -> Any:
        bound = jax.vmap(partial(Bound.of, paths, path, by))(bounds)
        labels = jax.vmap(partial(label_of_bound, pad))(bound)
        return labels, jax.vmap(partial(meeting, camera, by, pad, inner))(bound)

    def behind(cover: Cover | None, ends: Vector, entries: Array, by: Unfolded) -> Array:
        return entries if cover is None else coordinates(by, cover, ends, entries)

    by = paths.at(found.path)
    labels, entries = faces.of_pieces(ends, found.face, found.path, by, found.bounds)
    # Set to 0 before they are used: what is computed of them twice is then one computation.
    there = found.present[..., None]
    entries = jnp.where(there, entries, 0.0)
    on_pads = faces.through(behind, found.face, entries, by)
    if faces.fronts is not None:
        # A ray to an end of the membrane meets it exactly, wherever it enters.
        for end, label in enumerate(PAD_ENDS):
            on_pads = jnp.where(labels == label, float(end), on_pads)
    return labels, entries, jnp.where(there, on_pads, 0.0)


def _seen(
    camera: Camera,
    size: Float[Array, ""],
    pad: Pad,
    by: Unfolded,
    present: Bool[Array, ""],
    entries: Float[Array, "2"],
    scale: Scale | None,
) -> tuple[Array | None, ...]:
    """How the ends of a piece appear; all of it is 0 where there is none."""
    seen = *look(camera, size, by, pad, entries, scale), reflections(by, pad, entries)
    # An empty slot repeats some path at coordinate 0, where a look may be undefined.
    return jax.tree.map(lambda number: jnp.where(present, number, 0.0), seen)


def _room_left(free: Float[Array, ""]) -> ViewResult:
    return ViewResult.where(free > 0, ViewResult.successful, ViewResult.too_many)
