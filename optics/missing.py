"""By how much a pad is seen, or missed: its view in angles about the (virtual) camera.

Here every condition of a view is an interval of angles: field of view, mirrors and the pad itself
have to be met, shadows avoided. The best line of sight is the one farthest from all that must not
be met; twice its distance, the width of the gap, is negative where no line of sight is free, and
passes through 0 where a view opens. Nothing of it is shared with the pad coordinates in which
`optics.searching` finds the pieces, so that the two check each other.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from designopt.numerics import safe_arctan2
from designopt.vectors import Vector, together
from optics.boundaries import Pad, Route
from optics.camera import Camera
from optics.intervals import FAR, Interval, gaps
from optics.labels import (
    CROSSING,
    CUT_BEFORE,
    FIRST_PAD_END,
    HIGH_GRAZING,
    LEFT_LIMIT,
    LOW_GRAZING,
    RIGHT_LIMIT,
    SECOND_PAD_END,
    label_of,
    with_kind,
)
from optics.scene import Placed
from optics.unfolding import Edges, Unfolded, cut, height, unit


def angular_gap(camera: Camera, path: Unfolded, pad: Pad, above: Float[Array, ""]) -> Interval:
    """The widest gap between what must not be met, in angles (rad) about the source.

    Angles are counted from the middle of the pad, in the sense in which its sensing side shows its
    first end first. Seen from behind, the pad has a negative width, and so has a mirror. If there
    is no gap, its end comes before its start.

    Args:
        camera: the camera.
        path: the path, unfolded.
        pad: the pad.
        above: distance of the source left of the pad's line.
    """
    source = path.source
    middle = (pad.start - source) + (pad.end - source)
    sense = jnp.where(pad.side == 0, jnp.where(above < 0, -1.0, 1.0), pad.side)

    def angle(arrow: Vector) -> Array:
        across = middle.x * arrow.y - middle.y * arrow.x
        return sense * safe_arctan2(across, middle.x * arrow.x + middle.y * arrow.y)

    shown = _shown(path, pad)
    foot = unit(pad.end - pad.start).perpendicular().scaled(-above)
    seen = together(shown.starts - source, shown.ends - source, path.axis, -path.axis, foot)
    first, last, axis, back, foot = angle(seen)
    centre = (first + last) / 2

    def turned(angle: Array) -> Array:
        """The same direction, at most half a turn from the pad's centre."""
        return angle - 2 * jnp.pi * jnp.round((angle - centre) / (2 * jnp.pi))

    def spans(edges: Edges) -> Interval:
        """The angles under which segments appear."""
        from_angle, to_angle = angle(edges.starts - source), angle(edges.ends - source)
        width = to_angle - from_angle
        width = width - 2 * jnp.pi * jnp.round(width / (2 * jnp.pi))
        middle = turned(from_angle + width / 2)
        rises = width > 0
        return Interval(
            middle - jnp.abs(width) / 2,
            middle + jnp.abs(width) / 2,
            jnp.where(rises, edges.start_labels, edges.end_labels),
            jnp.where(rises, edges.end_labels, edges.start_labels),
        )

    half = camera.field_of_view / 2
    wide = half > jnp.pi / 2
    axis, back, foot = turned(axis), turned(back), turned(foot)
    room = jnp.pi / 2 - pad.grazing
    low, high = (
        jnp.where(sense > 0, one, other)
        for one, other in ((RIGHT_LIMIT, LEFT_LIMIT), (LEFT_LIMIT, RIGHT_LIMIT))
    )
    # From behind, the pad's second end comes first.
    toward_first, toward_second = (
        jnp.where(sense * above > 0, one, other)
        for one, other in ((LOW_GRAZING, HIGH_GRAZING), (HIGH_GRAZING, LOW_GRAZING))
    )
    side = jnp.where(above < 0, -1.0, 1.0)
    crossing = with_kind(path.blockers.start_labels, CROSSING)
    blockers = cut(path.blockers, pad.start, unit(pad.end - pad.start), side, crossing)
    # Mirrors first, then what may hide the pad.
    found = spans(jax.tree.map(lambda *edges: jnp.append(*edges), path.mirrors, blockers))
    away, there = path.turned_away, path.reflects
    mirrors = jax.tree.map(lambda leaf: leaf[: len(there)], found)
    hidden = jax.tree.map(lambda leaf: leaf[len(there) :], found)
    lower = [
        (first, shown.start_labels),
        (foot - room, toward_first),
        (jnp.where(wide, -FAR, axis - half), low),
    ]
    upper = [
        (last, shown.end_labels),
        (foot + room, toward_second),
        (jnp.where(wide, FAR, axis + half), high),
    ]
    from_mirrors = jnp.where(away, mirrors.end, mirrors.start)
    to_mirrors = jnp.where(away, mirrors.start, mirrors.end)
    start = jnp.append(_values(lower), jnp.where(there, from_mirrors, -FAR))
    start_labels = jnp.append(
        _labels(lower), jnp.where(away, mirrors.end_label, mirrors.start_label)
    )
    end = jnp.append(_values(upper), jnp.where(there, to_mirrors, FAR))
    end_labels = jnp.append(_labels(upper), jnp.where(away, mirrors.start_label, mirrors.end_label))
    at, to = jnp.argmax(start), jnp.argmin(end)
    # Nothing is left of a pad or mirror that lies in the line of the mirror beside it.
    left = shown.active & jnp.all(path.mirrors.active | ~there)
    last_end = jnp.where(left, end[to], jnp.minimum(start[at], end[to]))
    window = Interval(start[at], last_end, start_labels[at], end_labels[to])

    active = (blockers.active & path.in_the_way(pad.index)).reshape(-1)
    active &= hidden.end > hidden.start
    outside = Interval(back - (jnp.pi - half), back + (jnp.pi - half), high, low)
    shadows = jax.tree.map(lambda many, one: jnp.append(many, one), hidden, outside)
    found = gaps(window, shadows, jnp.append(active, wide))
    best = jnp.argmax(found.end - found.start)
    return jax.tree.map(lambda leaf: leaf[best], found)


def _values(bounds: list[tuple[Array, Array]]) -> Float[Array, " bounds"]:
    return jnp.stack([value for value, _ in bounds])


def _labels(bounds: list[tuple[Array, Array]]) -> Int[Array, " bounds"]:
    return jnp.stack([label for _, label in bounds])


def _shown(path: Unfolded, pad: Pad) -> Edges:
    """The part of a pad that lies in front of the last mirror."""
    ends = jnp.asarray(FIRST_PAD_END), jnp.asarray(SECOND_PAD_END)
    shown = Edges(pad.start, pad.end, *ends, jnp.ones_like(pad.start.x, bool))
    start, along = path.last
    side = jnp.where(height(path.source, start, along) < 0, 1.0, -1.0)
    leg = jnp.sum(path.reflects)
    return cut(shown, start, along, side, label_of(leg, pad.index, CUT_BEFORE), leg > 0)


def elevation(placed: Placed, route: Route, pad: Pad) -> Float[Array, ""]:
    """Least angle (rad) by which what a path needs rises above the mirrors that it must clear.

    Seen from the virtual camera, each mirror must have a part beyond the one before it, and the
    pad beyond the last, and each mirror a part before the one that follows. Angles are those at
    the mirror's first end, positive if the higher end of the other clears its line.
    """
    source, word = route.source, route.word
    least = jnp.full_like(placed.size, jnp.pi / 2)

    def rise(over: tuple[Vector, Vector], ends: tuple[Vector, Vector], beyond: bool) -> Array:
        start, along = over[0], unit(over[1] - over[0])
        far = jnp.where(along.cross(source - start) < 0, 1.0, -1.0)
        side = far if beyond else -far
        arrows = [end - start for end in ends]
        return jnp.maximum(
            *(safe_arctan2(side * along.cross(a), jnp.abs(along.dot(a))) for a in arrows)
        )

    for i in range(word.shape[0]):
        mirror = _on_leg(placed, route, i + 1, word[i])
        ends = (word[i] >= 0) & ((word[i + 1] < 0) if i + 1 < word.shape[0] else True)
        least = jnp.where(ends, jnp.minimum(least, rise(mirror, (pad.start, pad.end), True)), least)
        if i + 1 < word.shape[0]:
            following = _on_leg(placed, route, i + 1, word[i + 1])
            both = jnp.minimum(rise(mirror, following, True), rise(following, mirror, False))
            least = jnp.where(word[i + 1] >= 0, jnp.minimum(least, both), least)
    return least


def _on_leg(
    placed: Placed, route: Route, leg: int, surface: Int[Array, ""]
) -> tuple[Vector, Vector]:
    start, end = placed.segment(surface)
    return route.folded(leg, start), route.folded(leg, end)
