"""By how much a pad is seen, or missed: its view in angles about the (virtual) camera.

Here every condition of a view is an interval of angles: field of view, mirrors and the pad itself
have to be met, shadows avoided. The best line of sight is the one farthest from all that must not
be met; twice its distance, the width of the gap, is negative where no line of sight is free, and
passes through 0 where a view opens. Nothing of it is shared with the pad coordinates in which
`optics.visibility.searching` finds the pieces, so that the two check each other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_arctan2
from designopt.vectors import Vector, stack, where
from optics.scene.camera import Camera
from optics.visibility import boundary_codes as codes
from optics.visibility.boundaries import toward
from optics.visibility.boundary_codes import label_of, with_kind
from optics.visibility.intervals import FAR, Interval, hull, widest_gap
from optics.visibility.pads import Pad, Windows
from optics.visibility.sliding import LAST
from optics.visibility.unfolding import Edges, Unfolded, cut, left_of, legs_of, unit


def angular_gap(camera: Camera, path: Unfolded, pad: Pad, inner: Windows) -> Interval:
    """The widest gap between what must not be met, in angles (rad) about the source.

    Angles are counted from the middle of the pad, in the sense in which its sensing side shows its
    first end first. Seen from behind, the pad has a negative width, and so has a mirror. If there
    is no gap, its end comes before its start.

    Args:
        camera: the camera.
        path: the path, unfolded.
        pad: the pad.
        inner: what its layers let through.
    """
    source = path.eye(pad.start, pad.end)
    step = pad.end - pad.start
    above = left_of(source, pad.start, step)
    side = jnp.where(above < 0, -1.0, 1.0)
    sense = jnp.where(pad.side == 0, side, pad.side)
    middle = _bearing(path, (pad.start - source) + (pad.end - source))

    def angle(arrow: Vector) -> Array:
        # A bearing of what no pad moves is found once for all pads, which takes less time.
        return _near(sense * (_bearing(path, arrow) - middle), 0.0)

    shown = _shown(path, pad)
    foot = step.perpendicular().scaled(-side)
    ends = path.to(shown.ends).arrow
    seen = stack(ends[0], ends[1], path.axis, -path.axis, foot)
    first, last, axis, back, foot = angle(seen)
    # Angles from the pad's middle, so that none of what can hide it lies at a jump by 2π.
    center = (first + last) / 2

    def turned(angle: Array) -> Array:
        """The same direction, at most half a turn from the pad's centre."""
        return _near(angle, center)

    def spans(angles: Float[Array, "*edges 2"], labels: Int[Array, "*edges 2"]) -> Interval:
        """The angles under which mirrors and blockers appear, from those of their ends."""
        width = _near(angles[..., 1] - angles[..., 0], 0.0)
        middle, rises = turned(angles[..., 0] + width / 2), width > 0
        return Interval(
            middle - jnp.abs(width) / 2,
            middle + jnp.abs(width) / 2,
            jnp.where(rises, labels[..., 0], labels[..., 1]),
            jnp.where(rises, labels[..., 1], labels[..., 0]),
        )

    half = camera.field_of_view / 2
    wide = half > jnp.pi / 2
    axis, back, foot = turned(axis), turned(back), turned(foot)
    low = jnp.where(sense > 0, codes.RIGHT_LIMIT, codes.LEFT_LIMIT)
    high = jnp.where(sense > 0, codes.LEFT_LIMIT, codes.RIGHT_LIMIT)
    # From behind, the pad's second end comes first.
    in_front = sense * above > 0
    toward_first = jnp.where(in_front, pad.flattest[0], pad.flattest[1])
    toward_second = jnp.where(in_front, pad.flattest[1], pad.flattest[0])
    legs: Any = LAST
    if path.sheets:
        # What a ray passes before its last mirror lies before the pad.
        legs = legs_of(path.blockers)[..., 0]
        side = jnp.where(legs < jnp.sum(path.reflects), 0.0, side)
    crossing = with_kind(path.blockers.labels[..., 0], codes.CROSSING)
    blockers = cut(path.blockers, pad.ends(), side, crossing)
    # No end of a blocker has this label before.
    is_cut = blockers.labels == crossing[..., None]
    cuts = where(is_cut[..., 0], blockers.ends[..., 0], blockers.ends[..., 1])
    at_cuts = angle(path.to(cuts, legs).arrow)
    hidden = spans(jnp.where(is_cut, at_cuts[..., None], angle(path.past().arrow)), blockers.labels)
    mirrors = spans(
        angle(path.to(path.mirrors.ends, _legs_of_mirrors(path)).arrow), path.mirrors.labels
    )
    away, there = map(path.per_window, (path.turned_away, path.reflects))
    # A least angle of 0 limits nothing; a pad seen edge-on would meet it all the same.
    oblique = jnp.where(pad.grazing > 0, jnp.pi / 2 - pad.grazing, FAR)
    lower = jnp.stack([first, foot - oblique, jnp.where(wide, -FAR, axis - half)])
    upper = jnp.stack([last, foot + oblique, jnp.where(wide, FAR, axis + half)])
    lower_labels = jnp.stack([shown.labels[0], toward_first, low])
    upper_labels = jnp.stack([shown.labels[1], toward_second, high])
    if pad.labels.size:
        places = step.scaled(inner)
        if path.slide is None:
            passed = angle(places + (pad.start - source))
        else:
            passed = angle(path.to(pad.start + places).arrow)
        # What lets more through than the surface limits nothing, from behind as from the front.
        lower = jnp.append(lower, jnp.where(inner[:, 0] > 0, passed[:, 0], -FAR))
        upper = jnp.append(upper, jnp.where(inner[:, 1] < 1, passed[:, 1], FAR))
        rows = codes.WINDOWS - 2 * jnp.arange(len(inner))
        lower_labels = jnp.append(lower_labels, rows)
        upper_labels = jnp.append(upper_labels, rows - 1)
    # From behind, a mirror begins where it ends.
    turned_round = Interval(mirrors.end, mirrors.start, mirrors.end_label, mirrors.start_label)
    open_ = jax.tree.map(partial(jnp.where, away), turned_round, mirrors)
    start = jnp.append(lower, jnp.where(there, open_.start, -FAR))
    start_labels = jnp.append(lower_labels, open_.start_label)
    end = jnp.append(upper, jnp.where(there, open_.end, FAR))
    end_labels = jnp.append(upper_labels, open_.end_label)
    at, to = jnp.argmax(start), jnp.argmin(end)
    # Nothing is left of a pad or mirror that lies in the line of the mirror beside it.
    left = shown.active & jnp.all(path.mirrors.active | ~there)
    last_end = jnp.where(left, end[to], jnp.minimum(start[at], end[to]))
    # What bounds the gap is named in the end: until then blockers have numbers in place of labels.
    number = jnp.arange(hidden.start.size).reshape(hidden.start.shape)
    window = Interval(start[at], last_end, jnp.array(-1), jnp.array(-1))

    active = blockers.active & path.in_the_way(pad.own)
    active &= hidden.end > hidden.start
    numbered = Interval(hidden.start, hidden.end, number, number)
    shadows, active = path.merged((numbered, active), partial(_around, turned))
    beyond = jnp.array(number.size)
    outside = Interval(back - (jnp.pi - half), back + (jnp.pi - half), beyond, beyond)
    shadows = jax.tree.map(lambda many, one: jnp.append(many, one), shadows, outside)
    widest = widest_gap(window, shadows, jnp.append(active, wide))
    before, after = jnp.append(hidden.end_label, low), jnp.append(hidden.start_label, high)
    at_start, at_end = widest.start_label, widest.end_label
    # A pad seen edge-on shows nothing.
    end = jnp.where(above == 0, jnp.minimum(widest.start, widest.end), widest.end)
    return Interval(
        widest.start,
        end,
        jnp.where(at_start < 0, start_labels[at], before[at_start]),
        jnp.where(at_end < 0, end_labels[to], after[at_end]),
    )


def _around(
    turned: Callable[[Array], Array], faces: tuple[Interval, Bool[Array, "solids members"]]
) -> tuple[Interval, Bool[Array, " solids"]]:
    """The angles under which solids appear, from those of their faces."""
    parts, active = faces
    # Faces on both sides of the jump by 2π are brought together first.
    middle = (parts.start + parts.end) / 2
    highest = jnp.max(jnp.where(active, middle, -FAR), axis=1)[:, None]
    jump = middle - _near(middle, highest)
    labels = parts.start_label, parts.end_label
    whole, counts = hull(Interval(parts.start - jump, parts.end - jump, *labels), active)
    middle = (whole.start + whole.end) / 2
    back = turned(middle) - middle
    labels = whole.start_label, whole.end_label
    return Interval(whole.start + back, whole.end + back, *labels), counts


def _bearing(path: Unfolded, arrow: Vector) -> Float[Array, "..."]:
    """Angle of a vector from the optical axis."""
    return safe_arctan2(path.axis.cross(arrow), path.axis.dot(arrow))


def _near(angle: Float[Array, "..."], other: Float[Array, "..."] | float) -> Float[Array, "..."]:
    """The same direction, at most half a turn from another angle."""
    return angle - 2 * jnp.pi * jnp.round((angle - other) / (2 * jnp.pi))


def _legs_of_mirrors(path: Unfolded) -> Int[Array, "windows 1"] | int:
    """Of the ends of mirrors, on the way in and out, the legs whose rays pass them."""
    if not path.sheets:
        return LAST
    into = jnp.arange(len(path.reflects))
    return jnp.concatenate([into, into + 1])[:, None]


def _shown(path: Unfolded, pad: Pad) -> Edges:
    """The part of a pad that lies in front of the last mirror."""
    whole = Edges(pad.ends(), pad.edges, jnp.asarray(True))
    start, along = path.last[0], path.last[1] - path.last[0]
    leg = jnp.sum(path.reflects)
    behind = jnp.where(left_of(path.source, start, along) < 0, 1.0, -1.0)
    side = jnp.where(leg > 0, behind, 0.0)
    return cut(whole, path.last, side, label_of(leg, pad.index, codes.CUT_BEFORE))


def elevation(path: Unfolded, pad: Pad) -> Float[Array, ""]:
    """Least angle (rad) by which what a path needs rises above the mirrors that it must clear.

    Seen from the virtual camera, each mirror must have a part beyond the one before it, and the
    pad beyond the last, and each mirror a part before the one that follows. Angles are those at
    the mirror's first end, positive if the higher end of the other clears its line.
    """
    least = jnp.full_like(path.source.x, jnp.pi / 2)

    def rise(over: Vector, other: Vector, beyond: bool) -> Array:
        start, along = over[0], unit(over[1] - over[0])
        far = jnp.where(along.cross(path.source - start) < 0, 1.0, -1.0)
        side, arrows = far if beyond else -far, other - start
        angles = safe_arctan2(side * along.cross(arrows), jnp.abs(along.dot(arrows)))
        return jnp.maximum(angles[0], angles[1])

    count = path.reflects.shape[0]
    for i in range(count):
        mirror = path.whole[i]
        goes_on = path.reflects[i + 1] if i + 1 < count else jnp.asarray(False)
        to_pad = jnp.minimum(least, rise(mirror, pad.ends(), True))
        least = jnp.where(path.reflects[i] & ~goes_on, to_pad, least)
        if i + 1 < count:
            following = path.whole[i + 1]
            both = jnp.minimum(rise(mirror, following, True), rise(following, mirror, False))
            least = jnp.where(goes_on, jnp.minimum(least, both), least)
    return least


def margin(
    camera: Camera, path: Unfolded, pad: Pad, inner: Windows, widest: Interval
) -> Float[Array, ""]:
    """The width (rad) of the gap that was found, with the derivative of the lines that bound it."""
    labels = jnp.stack([widest.start_label, widest.end_label])
    first, last = jax.vmap(lambda label: toward(camera, path, pad, inner, label))(labels).angle()
    above = (pad.end - pad.start).cross(path.eye(pad.start, pad.end) - pad.start)
    sense = jnp.where(pad.side == 0, jnp.where(above < 0, -1.0, 1.0), pad.side)
    moving = sense * (last - first)
    # The value comes from the search, where each angle is on its turn; the slope from the two
    # directions, for the search has none.
    gap = widest.end - widest.start + (moving - jax.lax.stop_gradient(moving))
    # Where a mirror is turned away by more than the gap is wide, it is this angle that must change
    # before any line of sight opens; widening the gap would lead nowhere.
    rises = elevation(path, pad)
    return jnp.where(rises < 0, jnp.minimum(rises, gap), gap)
