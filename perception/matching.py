"""Which view is which: quadrilaterals matched to pads and paths, without ground truth.

Every view that the finger can show is known as a family: where its corners would be for every value
of the one joint that moves it. For each joint the value is taken that explains best what was found.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from perception.lengths import measured_grazing, measured_length, measured_skew, shortened
from perception.lens import Lens
from perception.quads import Quad
from perception.quality import Quality

CAP = 75.0
"""Corners further off than so many pixels (of 1080 rows) do not speak for a view."""

AROUND = 1
"""Neighbours of a joint's best value, between which the true one lies."""

AGREEING = 3.0
"""An end of a clipped view may be so many times as far from where it is expected as those of
fingers with errors of fabrication are (root mean square): further off it is something else."""

LENGTH_SHARE, LENGTH_DEVIATIONS = 0.01, 2.5
"""A pad's length may come out wrong by that share and by so many standard deviations."""

BEFORE_LAMP = 0.5
"""A lamp that is seen across an end hides a part of the pad as likely as not, and more likely where
the finger as designed has something there."""

DOUBTED_DEVIATIONS = 1.0
"""By so many only too long, beside another view without a look for the seam between them."""

NORMAL = NormalDist()

STRAIGHT = 1.5
"""px: edges scatter less about the sides of a pad, however rough; in noise 2.5 at least."""

STEP = 7.0
"""px: sides are found within a little more (`sides.REACH`)."""

MOST_TURN, MOST_ASIDE = 0.06, 1.5
"""Rad and mm: fingers with errors of fabrication skew views by less (`measured_skew`)."""

BORDER = 8.0
"""An end nearer to the image's border than so many pixels may be cut off by it."""

NEIGHBOR = 20.0
"""A view beside another one ends within so many pixels (of 1080 rows) of its end."""

LONGER = 0.15
"""A view that is longer by no more than this share has run into what is beside it."""

Follow = Callable[[Sequence[Float[np.ndarray, "4 2"]], int | None], list[Quad | None]]
"""The quadrilaterals whose corners are expected at given places; with a seam at an end, or not."""

FOUND = (Quality.COMPLETE, Quality.CLIPPED)
"""Views with these qualities are not looked for again."""

PART = 0.6
"""Something bright that is shorter than this part of a pad may be something else."""

KNOWN = 0.04
"""To this share the length of a view must be known that was looked for where it is expected."""

FAINTER = 0.6
"""Where four sides were found, others that are less than this part as clear are other edges."""


@dataclass(frozen=True)
class ViewFamily:
    """One view of one pad, for all values of the joint that moves it.

    Corners are in the pad's own order: at its first end and lesser columns, at its second end and
    lesser columns, second and greater, first and greater.

    Attributes:
        pad: name of the pad.
        path: name of the path.
        reflections: on its way; an odd number reverses handedness.
        joint: index of the joint that moves it; ``None`` where none does.
        angles: values of that joint, rad; one, and without meaning, where there is none.
        corners: where they are imaged.
        visible: whether any of the pad is seen.
        possible: whether any of it is in some finger, with errors of fabrication.
        complete: in what share of fingers, with errors of fabrication, all of it is seen.
        unhidden: of the fingers that show any of it, in what share nothing but the image's border
            hides a part; at least one hides some where not all of them show it.
        ends: whether all fingers show it, and in none anything but the image's border hides its
            first and its second end.
        spread: root mean square distance of its first and of its second end's corners from
            ``corners``, by errors of fabrication, px.
        extent: the pad's length as this view shows it (`perception.lengths`), and its standard
            deviation by errors of fabrication, mm.
        bend: what lines through the sides of its outline, which are bent, meet off the corners, px
            (`perception.straightening`).
        wanted: whether it is asked for; other views only explain what is found.
    """

    pad: str
    path: str
    reflections: int
    joint: int | None
    angles: Float[np.ndarray, " values"]
    corners: Float[np.ndarray, "values 4 2"]
    visible: Bool[np.ndarray, " values"]
    possible: Bool[np.ndarray, " values"]
    complete: Float[np.ndarray, " values"]
    unhidden: Float[np.ndarray, " values"]
    ends: Bool[np.ndarray, "values 2"]
    spread: Float[np.ndarray, "values 2"]
    extent: Float[np.ndarray, "values 2"]
    bend: Float[np.ndarray, "values 4 2"]
    wanted: bool

    @functools.cached_property
    def as_quads(self) -> Float[np.ndarray, "values 4 2"]:
        """The corners in the order of a `Quad`."""
        return canonical(self.corners)

    @functools.cached_property
    def rows(self) -> Float[np.ndarray, "values 2"]:
        """Of its lower and its upper end."""
        return _rows_of_ends(self.as_quads)


@dataclass(frozen=True)
class ViewCatalog:
    """All views that a finger can show.

    Attributes:
        families: the views.
        lengths: of the pads by name, mm.
        grazing: of the pads by name, the angle at which they must be seen at least, rad.
        width: of the pads across the section, mm.
        joints: number of joints.
    """

    families: Sequence[ViewFamily]
    lengths: dict[str, float]
    grazing: dict[str, float]
    width: float
    joints: int


@dataclass(frozen=True, eq=False)
class View:
    """A view that was asked for, found or not.

    Attributes:
        pad: name of the pad.
        path: name of the path.
        reflections: on its way.
        quality: how it was found.
        ends: whether the pad's first and its second end are those of the view, whatever the errors
            of fabrication: of a clipped view the one that is cut off is not, and of a complete one
            not the one that something hides in some fingers, or at which not all colors end.
        corners: column and row, in the pad's own order; NaN where it is missing.
        rays: of the corners.
        covariance: of the corners, px².
        roughness: the part of it that is in every image of this view: the pad's edges are rough,
            px².
        area: of the view, px².
    """

    pad: str
    path: str
    reflections: int
    quality: Quality
    ends: tuple[bool, bool]
    corners: Float[np.ndarray, "4 2"]
    rays: Float[np.ndarray, "4 2"]
    covariance: Float[np.ndarray, "4 2 2"]
    roughness: Float[np.ndarray, "4 2 2"]
    area: float


@dataclass(frozen=True)
class Sighting:
    """What was made of an image.

    Attributes:
        views: of all views that were asked for and were found or expected.
        ghosts: quadrilaterals that are none of them.
        angles: rough joint angles, rad, the best of the catalogue; NaN where unseen.
    """

    views: tuple[View, ...]
    ghosts: tuple[Quad, ...]
    angles: Float[np.ndarray, " joints"]

    def view(self, pad: str, path: str) -> View | None:
        """The view of a pad by a path, if it was found or expected."""
        return next((v for v in self.views if (v.pad, v.path) == (pad, path)), None)

    def complete(self) -> list[View]:
        """The views that show all of their pad."""
        return [view for view in self.views if view.quality is Quality.COMPLETE]


def match_views(
    quads: Sequence[Quad],
    catalog: ViewCatalog,
    lens: Lens,
    follow: Follow | None = None,
) -> Sighting:
    """Assign quadrilaterals to views; every view gets its quality.

    Args:
        quads: what was found in an image.
        catalog: what the finger can show.
        lens: of the camera.
        follow: the quadrilaterals in the image whose corners are expected at given places, where
            there is one: a view that something bright beside it has spoiled is looked for again
            there, and the seam to another view at an end of it (`perception.quads.follow_quads`).
            Without it none is.

    Example:
        >>> rows, columns = np.mgrid[:90, :120]
        >>> rays = np.stack([(44.5 - rows) / 200, (columns - 59.5) / 200], axis=-1)
        >>> lens = Lens(
        ...     rays, lambda r: np.stack([59.5 + 200 * r[:, 1], 44.5 - 200 * r[:, 0]], axis=-1)
        ... )
        >>> corners = np.array([[30.0, 20.0], [30.0, 69.0], [89.0, 69.0], [89.0, 20.0]])
        >>> whole = np.ones((1, 2), bool)
        >>> family = ViewFamily(
        ...     "tip",
        ...     "direct",
        ...     0,
        ...     None,
        ...     np.zeros(1),
        ...     corners[None],
        ...     whole[:, 0],
        ...     whole[:, 0],
        ...     np.ones(1),
        ...     np.ones(1),
        ...     whole,
        ...     np.zeros((1, 2)),
        ...     np.array([[12.0, 0.1]]),
        ...     np.zeros((1, 4, 2)),
        ...     True,
        ... )
        >>> catalog = ViewCatalog([family], {"tip": 12.0}, {"tip": 0.1}, 12.0, 0)
        >>> [(view.pad, view.quality.name) for view in match_views([], catalog, lens).views]
        [('tip', 'MISSING')]
    """
    families, search = catalog.families, _Search(catalog, lens, follow)
    angles = np.full(catalog.joints, np.nan)
    cap = CAP * lens.shape[0] / 1080
    best = dict.fromkeys(range(len(families)), 0)
    distances: dict[int, Float[np.ndarray, "quads values"]] = {}
    pairs: list[tuple[float, int, int]] = []
    shift = np.zeros(2)
    quads = [*quads, *search.still(quads, cap)]
    for joint in (None, *range(catalog.joints)):
        own = [i for i, family in enumerate(families) if family.joint == joint]
        if not own or not quads:
            continue
        distances |= {i: _distances(families[i], quads, lens, shift) for i in own}
        costs = _costs([families[i] for i in own], [distances[i] for i in own], cap)
        value = int(np.argmin(costs))
        near = [
            (float(distances[i][number, value]), number, i)
            for i in own
            for number in range(len(quads))
            if families[i].visible[value] and distances[i][number, value] < cap
        ]
        best |= dict.fromkeys(own, value)
        if joint is not None and near:
            angles[joint] = families[own[0]].angles[value]
        if joint is None and near:
            # What does not move shows how the camera is out of place.
            _, number, i = min(near)
            shift = np.mean(quads[number].corners - _expected(families[i], 0, shift), axis=0)
        pairs += near
    assigned: dict[int, int] = {}
    for _, number, i in sorted(pairs):
        if number not in assigned.values() and i not in assigned:
            assigned[i] = number
    known = {families[i].joint for i in assigned}
    whole = {number for number, quad in enumerate(quads) if quad.quality is Quality.COMPLETE}
    rest = whole.difference(assigned.values())
    twice = _seen_twice(search, best, distances, {n: quads[n] for n in rest}, cap)
    angles[list(twice)] = np.nan
    views = []
    for i, family in enumerate(families):
        if not family.wanted:
            continue
        expected = family.complete[best[i]] == 1 and (family.joint in known or family.joint is None)
        view = None
        if i in assigned:
            quad = search.mended(i, best[i], quads[assigned[i]])
            view = _found(family, best[i], quad, shift, lens)
        if expected and (view is None or view.quality not in FOUND):
            other = search.complete(i, best[i], _expected(family, best[i], shift))
            if other is not None:
                view = _found(family, best[i], other, shift, lens)
        if view is not None and i in assigned and family.joint in twice:
            view = replace(view, quality=Quality.AMBIGUOUS, ends=(False, False))
        if view is not None or expected:
            views.append(view or _missing(family))
    wanted = {number for i, number in assigned.items() if families[i].wanted}
    ghosts = tuple(
        replace(quad, quality=Quality.GHOST)
        for number, quad in enumerate(quads)
        if number not in wanted and quad.quality is not Quality.LOW_CONTRAST
    )
    return Sighting(tuple(views), ghosts, angles)


def _expected(
    family: ViewFamily, value: int, shift: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "4 2"]:
    """Where a view's sides would be found, in the order of a `Quad`."""
    return canonical((family.corners + family.bend)[value : value + 1])[0] + shift


class _Search(NamedTuple):
    """Looks again for views in an image, where their sides are expected."""

    catalog: ViewCatalog
    lens: Lens
    follow: Follow | None

    def judged(self, index: int, value: int, quad: Quad) -> Quad:
        """A quadrilateral, and whether its sides, if all are good, are those of all of the pad."""
        if quad.quality is not Quality.COMPLETE and not quad.before_lamp:
            return quad
        # Edges are found in noise, too, but not in a line; before a lamp they are of the lamp.
        if quad.scatter >= STRAIGHT:
            return quad if quad.before_lamp else replace(quad, quality=Quality.LOW_CONTRAST)
        catalog, lens = self.catalog, self.lens
        family = catalog.families[index]
        turn, aside = measured_skew(quad, catalog.width)
        if turn > MOST_TURN or aside > MOST_ASIDE:
            return replace(quad, quality=Quality.MERGED)
        if measured_grazing(quad, catalog.width) < catalog.grazing[family.pad]:
            return replace(quad, quality=Quality.FLAT)
        whole = float(family.unhidden[_around(value)].mean())
        if quad.before_lamp:
            whole = min(whole, BEFORE_LAMP)
        wanted, of_finger = family.extent[value].tolist()
        length, of_corners = measured_length(quad, catalog.width, lens)
        deviation = math.hypot(of_corners, of_finger)
        allowed = LENGTH_SHARE * wanted + LENGTH_DEVIATIONS * deviation
        short = allowed
        if 0 < whole < 1:
            ends = family.corners[value, [0, 3]].mean(axis=0), family.corners[value, [1, 2]].mean(0)
            away = float(family.spread[value].max() / np.hypot(*np.subtract(*ends)))
            short = min(short, deviation * _doubted_from(whole, deviation / wanted, away))
        if whole == 0 or length < wanted - short:
            return replace(quad, quality=Quality.CLIPPED)
        beside = _beside(catalog.families, index, value, quad, lens)
        # Where the image can be searched for a seam, a view without one has not run into another.
        unsure = beside is not None and self.follow is None
        if length <= wanted + (DOUBTED_DEVIATIONS * deviation if unsure else allowed):
            if quad.before_lamp:
                return replace(quad, quality=Quality.COMPLETE, before_lamp=False)
            return quad
        if beside is None or length > (1 + LONGER) * wanted + allowed:
            return replace(quad, quality=Quality.MERGED)
        return shortened(quad, catalog.width, family.extent[value], lens, 1 - beside)

    def complete(
        self, index: int, value: int, start: Float[np.ndarray, "4 2"], beside: int | None = None
    ) -> Quad | None:
        """A complete view whose corners are expected at given places, if it is there.

        Args:
            index: of the view.
            value: of its joint, by index.
            start: the places.
            beside: its end (0 the lower) that must have a seam to another view, if one must.
        """
        (quad,) = self.at([start], beside)
        return quad if quad is not None and self.is_sure(index, value, quad) else None

    def at(
        self, starts: Sequence[Float[np.ndarray, "4 2"]], beside: int | None = None
    ) -> list[Quad | None]:
        """What `follow` finds at given places of one view, if they are in the image at all."""
        if self.follow is None or not np.isfinite(starts).all():
            return [None] * len(starts)
        return self.follow(starts, beside)

    def is_sure(self, index: int, value: int, quad: Quad) -> bool:
        """Whether its length shows that what was looked for where a view is expected is it."""
        if quad.quality is not Quality.COMPLETE or self.judged(index, value, quad) is not quad:
            return False
        length, deviation = measured_length(quad, self.catalog.width, self.lens)
        return deviation < KNOWN * length

    def likeliest(self, index: int, value: int, quads: Iterable[Quad | None]) -> Quad | None:
        """Of several views those that are sure, of these the one with the pad's likeliest length.

        It is where four sides are surely those of the pad, not of what adjoins it.
        """
        wanted, of_finger = self.catalog.families[index].extent[value].tolist()

        def likelihood(quad: Quad) -> float:
            length, of_corners = measured_length(quad, self.catalog.width, self.lens)
            # Else corners that are known well would count against a view.
            deviation = math.hypot(of_corners, of_finger, LENGTH_SHARE * wanted)
            return -(((length - wanted) / deviation) ** 2) / 2 - math.log(deviation)

        sure = (q for q in quads if q is not None and self.is_sure(index, value, q))
        return max(sure, key=likelihood, default=None)

    def mended(self, index: int, value: int, quad: Quad) -> Quad:
        """A view, judged; if it runs into something bright, looked for where its pad would end."""
        catalog, lens = self.catalog, self.lens
        judged = self.judged(index, value, quad)
        cut = judged.quality in (Quality.FLAT, Quality.CLIPPED)
        if quad.quality is not Quality.COMPLETE or cut:
            return judged
        beside = _beside(catalog.families, index, value, quad, lens)
        if judged is quad and beside is None:
            return judged
        extent = catalog.families[index].extent[value]
        starts = [shortened(quad, catalog.width, extent, lens, kept).corners for kept in range(2)]
        if beside is not None:
            at_seam = self.complete(index, value, starts[1 - beside], beside)
            # One that ends before the seam ends in the dark, and has not run into the other.
            if at_seam is not None and self.length(at_seam) < self.length(quad):
                return at_seam
        if judged is quad:
            return judged
        # At both ends it may have run into something: at both at once, and one after the other.
        found = self.at([*starts, (starts[0] + starts[1]) / 2])
        for one in found[:2]:
            if one is None or self.length(one) >= self.length(quad):
                continue
            if self.judged(index, value, one).quality is Quality.MERGED:
                again = (shortened(one, catalog.width, extent, lens, kept) for kept in range(2))
                found += self.at([other.corners for other in again])
        return self.likeliest(index, value, found) or judged

    def length(self, quad: Quad) -> float:
        """A pad's length as a view shows it, mm."""
        return measured_length(quad, self.catalog.width, self.lens)[0]

    def still(self, quads: Sequence[Quad], cap: float) -> Iterator[Quad]:
        """Views that no joint moves, where nothing complete was found: looked for all about there.

        They show how the camera is out of place, which all others need.
        """
        for index, family in enumerate(self.catalog.families):
            if family.joint is not None or not family.wanted or family.complete[0] < 1:
                continue
            away = _distances(family, quads, self.lens, np.zeros(2))[:, 0] if quads else np.zeros(0)
            near = [quads[number] for number in np.argsort(away) if away[number] < cap]
            judged = (self.judged(index, 0, quad).quality for quad in near)
            if Quality.COMPLETE in judged:
                continue
            quad = self.mended(index, 0, near[0]) if near else None
            if quad is None or quad.quality is not Quality.COMPLETE:
                reach = AGREEING * float(family.spread[0].max())
                quad = self.about(index, reach)
                clear = [one.contrast for one in near if one.quality is Quality.COMPLETE]
                if quad is not None and quad.contrast < FAINTER * max(clear, default=0):
                    quad = None
            if quad is not None:
                yield quad

    def about(self, index: int, reach: float) -> Quad | None:
        """A view that no joint moves, looked for above and below where it is expected.

        If it is not there it may be to the left or to the right, where a turned camera has it.

        Args:
            index: of the view.
            reach: how far above and below, px.
        """
        rows = np.arange(-reach, reach + 1, STEP)
        expected = partial(_expected, self.catalog.families[index], 0)
        for columns in ([0.0], [-STEP, STEP]):
            shifts = np.array([(column, row) for column in columns for row in rows])
            if quad := self.likeliest(index, 0, self.at([expected(shift) for shift in shifts])):
                return quad
        return None


def canonical(corners: Float[np.ndarray, "*values 4 2"]) -> Float[np.ndarray, "*values 4 2"]:
    """A pad's corners in the order of a `Quad`: its lower end first."""
    lower = _first_is_lower(corners)[..., None, None]
    return np.where(lower, corners, corners[..., [1, 0, 3, 2], :])


def _first_is_lower(corners: Float[np.ndarray, "*values 4 2"]) -> Bool[np.ndarray, "*values"]:
    first, second = (corners[..., end, 1].mean(axis=-1) for end in ([0, 3], [1, 2]))
    return np.asarray(first >= second)


def _distances(
    family: ViewFamily, quads: Sequence[Quad], lens: Lens, shift: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "quads values"]:
    """Root mean square distance of corners, of every quadrilateral from every value's."""
    rows, columns = lens.shape
    expected = np.clip(family.as_quads + shift, 0, [columns - 1, rows - 1])
    there = np.stack([quad.corners for quad in quads])
    off = (there[:, None] - expected).reshape(len(quads), -1, 8)
    return np.sqrt(np.einsum("qvc,qvc->qv", off, off) / 4)


def _costs(
    families: Sequence[ViewFamily],
    distances: Sequence[Float[np.ndarray, "quads values"]],
    cap: float,
) -> Float[np.ndarray, " values"]:
    """What each value of a joint leaves unexplained: of the views, and of what was found."""
    shown = np.stack(
        [np.where(f.visible, d, np.inf) for f, d in zip(families, distances, strict=True)]
    )
    by_view = np.minimum(shown.min(axis=1), cap)
    visible = np.stack([family.visible for family in families])
    by_quad = np.minimum(shown.min(axis=0), cap)
    return np.where(visible, by_view, 0.0).sum(axis=0) + by_quad.sum(axis=0)


def _seen_twice(
    search: _Search,
    best: Mapping[int, int],
    distances: Mapping[int, Float[np.ndarray, "quads values"]],
    rest: Mapping[int, Quad],
    cap: float,
) -> set[int]:
    """Joints of which the rest of the image shows a pad at another angle than what was matched.

    A complete quadrilateral that no view explains as well at the angles that were found, and that
    is as long as most of the pad there, is a view of a pad at another angle: the image is a double
    exposure, or shows another finger.
    """
    catalog, joints = search.catalog, set()
    for number, quad in rest.items():
        explained, other, moved = np.inf, cap, None
        for i, family in enumerate(catalog.families):
            own = np.where(family.visible, distances[i][number], np.inf)
            explained = min(explained, own[_around(best[i])].min())
            if family.wanted and family.joint is not None and own.min() < other:
                other, moved = own.min(), (i, int(own.argmin()))
        if moved is not None and other < explained:
            judged = search.judged(*moved, quad)
            enough = search.length(quad) > PART * catalog.families[moved[0]].extent[moved[1], 0]
            if judged.quality in FOUND and enough:
                joints.add(catalog.families[moved[0]].joint)
    return joints


def _found(
    family: ViewFamily, value: int, quad: Quad, shift: Float[np.ndarray, "2"], lens: Lens
) -> View:
    """The view that a quadrilateral is, which was judged."""
    order = [0, 1, 2, 3] if _first_is_lower(family.corners[value]) else [1, 0, 3, 2]
    ends = np.asarray(family.ends[_around(value)].all(axis=0))
    if quad.quality is Quality.CLIPPED:
        off = quad.corners[order] - shift - family.corners[value]
        ends &= _off_border(quad.corners[order], lens)
        ends &= rms_of_ends(off) < AGREEING * family.spread[value]
        # Where both ends are expected, what has cut the view is unknown.
        ends &= not ends.all()
    elif quad.quality is not Quality.COMPLETE:
        ends = np.zeros(2, bool)
    ends &= ~quad.apart[order[:2]]
    corners = quad.corners[order] - family.bend[value]
    return View(
        pad=family.pad,
        path=family.path,
        reflections=family.reflections,
        quality=quad.quality,
        ends=(bool(ends[0]), bool(ends[1])),
        corners=corners,
        rays=lens.rays(corners) if family.bend[value].any() else quad.rays[order],
        covariance=quad.covariance[order],
        roughness=quad.roughness[order],
        area=quad.area,
    )


def _doubted_from(share: float, deviation: float, spread: float) -> float:
    """By how many standard deviations short a view is as likely all of its pad as a part of it.

    What hides a part moves over the pad's end by errors of fabrication, as far as that end moves
    (normal): of the fingers that hide a part, so many hide as much as a view is short. Fewer than
    none are standard deviations too long.

    Args:
        share: of the fingers of which it is all.
        deviation: of the length, as a part of it.
        spread: of the ends, as a part of the length.
    """
    hidden = NORMAL.pdf(NORMAL.inv_cdf(share)) / max(spread, deviation)
    odds = share * NORMAL.pdf(0) / deviation / hidden
    return math.copysign(math.sqrt(2 * abs(math.log(odds))), odds - 1)


def _around(value: int) -> slice:
    """The indices of a joint's best value and of its neighbours."""
    return slice(max(value - AROUND, 0), value + AROUND + 1)


def rms_of_ends(offsets: Float[np.ndarray, "*values 4 2"]) -> Float[np.ndarray, "*values 2"]:
    """Root mean square length of the offsets of the first and of the second end's corners."""
    squares = np.sum(offsets**2, axis=-1)
    ends = [squares[..., [0, 3]], squares[..., [1, 2]]]
    return np.sqrt(np.stack([end.mean(axis=-1) for end in ends], axis=-1))


def _off_border(corners: Float[np.ndarray, "4 2"], lens: Lens) -> Bool[np.ndarray, "2"]:
    """Whether both corners of the first and of the second end are away from the image's border."""
    limits = np.array(lens.shape[::-1]) - 1 - BORDER
    inside = np.all((corners > BORDER) & (corners < limits), axis=-1)
    return np.array([inside[[0, 3]].all(), inside[[1, 2]].all()])


def _beside(
    families: Sequence[ViewFamily], index: int, value: int, quad: Quad, lens: Lens
) -> int | None:
    """At which end of a view another one lies by the catalogue; ``None`` where none is near."""
    nearest, found = NEIGHBOR * lens.shape[0] / 1080, None
    own = _rows_of_ends(quad.corners).tolist()
    for number, family in enumerate(families):
        at = 0 if family.joint is None else value
        if number == index or family.joint not in (None, families[index].joint):
            continue
        if not family.possible[at]:
            continue
        for end, row in enumerate(own):
            gap = min(abs(row - other) for other in family.rows[at].tolist())
            if gap < nearest:
                nearest, found = gap, end
    return found


def _rows_of_ends(quads: Float[np.ndarray, "*quads 4 2"]) -> Float[np.ndarray, "*quads 2"]:
    """Mean rows of the lower and the upper end of quadrilaterals."""
    return (quads[..., :2, 1] + quads[..., :1:-1, 1]) / 2


def _missing(family: ViewFamily) -> View:
    nothing = np.full((4, 2), np.nan)
    return View(
        pad=family.pad,
        path=family.path,
        reflections=family.reflections,
        quality=Quality.MISSING,
        ends=(False, False),
        corners=nothing,
        rays=nothing,
        covariance=np.full((4, 2, 2), np.nan),
        roughness=np.full((4, 2, 2), np.nan),
        area=0.0,
    )
