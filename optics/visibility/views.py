"""What a camera sees of each pad, by which path, and what follows: coverage and redundancy."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from optics.scene.scene import Layout
from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import parts_of
from optics.visibility.intervals import measure_of_union
from optics.visibility.unfolding import paths_of


class ViewResult(eqx.Enumeration):
    """Why a pad is not seen by a path."""

    successful = ""
    behind_mirror = (
        "The camera, or its image, is not in front of a mirror of this path: turn or move that "
        "mirror, or let its other side reflect."
    )
    behind_pad = (
        "The camera, or its image, is not on the sensing side of the pad: move the camera or the "
        "mirror, or change the pad's side."
    )
    missed = (
        "The pad lies outside of what the field of view, the mirrors and the least grazing angle "
        "let through: widen one of them, or turn the camera or a mirror."
    )
    blocked = "Other surfaces hide all of the pad: move or shorten what stands in the way."
    unseen = (
        "No ray reaches the pad by this path: move the camera, the mirrors or what stands in the "
        "way; a narrow view may be found with more rays."
    )
    too_many = "The pad is seen in more pieces than there is room for: raise max_pieces."


REASONS = {
    int(jax.tree.leaves(result)[0]): ViewResult[result]
    for result in (
        ViewResult.successful,
        ViewResult.behind_mirror,
        ViewResult.behind_pad,
        ViewResult.missed,
        ViewResult.blocked,
        ViewResult.unseen,
        ViewResult.too_many,
    )
}
"""Messages of the results by their codes, the leaves of results."""

_ENDS = {
    codes.FIRST_PAD_END: "end of the pad",
    codes.SECOND_PAD_END: "end of the pad",
    codes.LEFT_LIMIT: "limit of the field of view",
    codes.RIGHT_LIMIT: "limit of the field of view",
    codes.LOW_GRAZING: "least grazing angle",
    codes.HIGH_GRAZING: "least grazing angle",
    codes.FOLD: "fold of the image",
    codes.FIRST_BEZEL: "bezel",
    codes.SECOND_BEZEL: "bezel",
    codes.LOW_TRANSMISSION: "least transmission",
    codes.HIGH_TRANSMISSION: "least transmission",
    codes.FIRST_END: "its end 'from'",
    codes.SECOND_END: "its end 'to'",
    codes.CROSSING: "where another surface meets it",
    codes.CUT_BEFORE: "where it meets the line of a mirror",
    codes.CUT_AFTER: "where it meets the line of a mirror",
    codes.HORIZON: "where it turns away from the ray",
}
"""What bounds a piece: by the label where it is negative, otherwise by the label's kind."""

_EDGES = {codes.FIRST_END: "its lower edge", codes.SECOND_END: "its upper edge"}
"""What of a layer's end face or of a bezel bounds a piece: lower is towards the membrane."""


class Pieces(eqx.Module):
    """The pieces of each pad that are seen, in the order in which they begin.

    A piece is seen by one path, so pieces of several paths may overlap. Arrays have the shape
    (pads, pieces) after any batch axes; there is room for more pieces than there are.

    Attributes:
        present: whether there is such a piece; elsewhere all else is 0.
        path: index of the path that shows it.
        start: pad coordinate (0 at the pad's first end, 1 at its second) where it begins.
        end: where it ends.
        start_label: code of what bounds it there; see `describe_end`.
        end_label: the same for its other end.
        pixels: where its two ends are imaged, in pixels; shape (..., 2).
        px_per_mm: resolution along the pad at its two ends; shape (..., 2).
        distance: length of the path to its two ends, mm; shape (..., 2).
        spans: coordinates on each mirror of the path at which its two ends are reflected; shape
            (..., reflections, 2), 0 where the path has fewer reflections.
        face: the surface by which it is seen: 0 for the pad or its outermost surface, else 1 and
            which of its clear end faces; ``None`` where there are none.
        apparent: distance from which light of its two ends seems to come, mm, shape (..., 2); see
            `optics.visibility.refraction`. ``None`` where no pad or mirror has layers: then it is
            that of the path.
    """

    present: Bool[Array, "*pieces"]
    path: Int[Array, "*pieces"]
    start: Float[Array, "*pieces"]
    end: Float[Array, "*pieces"]
    start_label: Int[Array, "*pieces"]
    end_label: Int[Array, "*pieces"]
    pixels: Float[Array, "*pieces 2"]
    px_per_mm: Float[Array, "*pieces 2"]
    distance: Float[Array, "*pieces 2"]
    spans: Float[Array, "*pieces reflections 2"]
    face: Int[Array, "*pieces"] | None = None
    apparent: Float[Array, "*pieces 2"] | None = None

    @property
    def object_distance(self) -> Float[Array, "*pieces 2"]:
        """The distance of both ends that counts for a lens, mm."""
        return self.distance if self.apparent is None else self.apparent

    def coverage(self) -> Float[Array, "*pads"]:
        """Part of each pad that is seen by any path: the measure of the union of its pieces."""
        return measure_of_union(self.start, self.end)

    def seen(self, path: int) -> Float[Array, "*pads"]:
        """Part of each pad that is seen by one path."""
        return jnp.sum(jnp.where(self.path == path, self.end - self.start, 0.0), axis=-1)

    def redundancy(self) -> Float[Array, "*pads"]:
        """Number of paths by which a point of each pad is seen, on average over the pad."""
        return jnp.sum(self.end - self.start, axis=-1)

    def paths_seeing(self, coordinates: Float[Array, " points"]) -> Int[Array, "*pads points"]:
        """By how many paths points of each pad are seen, from their pad coordinates."""
        start, end = self.start[..., None], self.end[..., None]
        places = coordinates.reshape((1,) * (start.ndim - 1) + (-1,))
        seen = (start <= places) & (places <= end) & self.present[..., None]
        return jnp.sum(seen, axis=-2, dtype=int)


def path_name(layout: Layout, word: Sequence[int]) -> str:
    """Name of a path: ``direct``, or ``mirror:`` and its mirrors."""
    names = "+".join(layout.mirrors[i].name for i in word)
    return f"mirror:{names}" if names else "direct"


def name_paths(layout: Layout, bounces: int | None = None) -> list[str]:
    """Names of all paths in their order, up to the scene's own number of bounces by default.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> name_paths(scene.layout, 1)
        ['direct', 'mirror:lower', 'mirror:upper']
    """
    words = paths_of(layout, layout.bounces if bounces is None else bounces)
    return [path_name(layout, word) for word in words]


def describe_end(layout: Layout, label: int) -> str:
    """What bounds a piece, in words, from its label.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> describe_end(scene.layout, codes.FIRST_PAD_END)
        'end of the pad'
    """
    if label < 0:
        return _ENDS[label] if label in _ENDS else _edge_of_layers(layout, label)
    _, surface, kind = map(int, parts_of(label))
    words = _ENDS[kind]
    if layout.kind(surface) == "layer":
        top = layout.bodies[surface - len(layout.surfaces)].part == "top"
        words = words if top else _EDGES.get(kind, words)
    return f"{layout.title(surface)}: {words}"


def _edge_of_layers(layout: Layout, label: int) -> str:
    """Where layers end, in words."""
    level, end = divmod(codes.edge_of_layers(0, 0) - label, 2)
    at = ("from", "to")[end]
    if level == 0:
        return f"upper edge of layer 1 at '{at}'"
    if level >= min(len(kinds) for kinds in layout.layers if kinds):
        return f"lower edge of layer {level} at '{at}'"
    return f"edge between layers {level} and {level + 1} at '{at}'"
