"""The sides of a view: where their edges are, and a straight line through them.

An edge is where the brightness falls below half of its step, looked for across the expected side.
All of this is in the tangent plane of the view's rays, where sides are straight.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from perception.lens import Lens, TangentPlane
from perception.masks import CLIPPED, Mask
from perception.sampling import sampled

POINTS = 48
"""Places on every side at which its edge is looked for."""

TRIMMED = 0.1
"""Part of a side at each of its ends that round corners may have changed."""

REACH = 8.0
"""How far from the expected edge it is looked for, px."""

FEET = 2.5
"""From foot to foot an edge is so many times as wide as between the quarters of its step: 2 r to
0.81 r for a defocus disc of radius r. 91 % of a normal edge's step are between them."""

SAMPLES = 33
"""Brightness samples across each of these places."""

BRIGHTER = 0.85
"""Of the samples inside, this part is darker than what counts as the view's brightness; the rest,
which is brighter, must lie between the edges of a view where it is thin."""

ROUNDS = 5
"""Rounds of weighting places by how near to the line they are."""

LEAST_SCATTER = 0.02
"""No edge is straighter than to so many px."""

TUKEY = 4.685
"""Residuals of so many standard deviations count no more (95 % efficiency for normal ones)."""

DEEP, SEAM = 0.9, 10.0
"""Where brightness falls by a smaller part than `DEEP` to the dark, an edge is doubted by so many
pixels per missing part: what falls halfway only may be as far off as a seam is wide."""

WIDER, GRADUAL = 1.5, 0.75
"""An edge more than so many times as wide as those of most sides is doubted by this part of the
rest of its width."""

RISE, BRIGHTENED, STEEPER, NEAR = 10.0, 1.2, 2.5, 4
"""Within twice so many samples light rises to a lamp beside a pad by so many codes and times, and
by so many times as much as just before: on a pad it changes gradually."""

RISE_TO_VIEW, BRIGHTENED_BY_VIEW = 5.0, 1.05
"""The same where another view is expected beside a pad: behind a seam any rise is to that.

Light on a pad does not fall and rise again along most of a side."""

LIT, VALLEY = 0.5, 0.9
"""A lamp is beside more than this part of a side. A gap between it and the pad is darker than this
share of the pad."""

BLOOM, GLOW = 2.0, 0.3
"""Standard deviation of edges beside a lamp that is clipped or hardly apart, and of others, px."""

ENDS, SCATTERED = 6, 4.0
"""Over this part of a side at each end its edges lie on its line, but for so many standard
deviations of their mean."""

SMALL = 1e-4
"""Step of differences in the tangent plane."""

LEAST_CONTRAST = 5.0
"""Of 255: a lower step is no edge that can be relied on."""

UNKNOWN = 1.0
"""Variance of a side that was not found, in the tangent plane: it may be anywhere."""


@dataclass(frozen=True)
class Side:
    """A side, from corner to corner in the tangent plane, clockwise as the plane is seen."""

    start: Float[np.ndarray, "2"]
    end: Float[np.ndarray, "2"]

    @functools.cached_property
    def outward(self) -> Float[np.ndarray, "2"]:
        """Unit normal that points out of the view."""
        along = self.end - self.start
        return np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-12)

    def places(self, shares: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 2"]:
        """Places at parts 0 to 1 of the way from start to end."""
        return self.start + shares[:, None] * (self.end - self.start)


@dataclass(frozen=True)
class Edges:
    """Where the edges of a view's sides were found.

    Attributes:
        shares: places along every side, 0 to 1.
        offsets: outward from the side, tangent plane.
        scale: px per unit of the tangent plane across the side.
        found: where an edge was found at all.
        contrast: step of brightness in codes, the median over the places where an edge was found,
            or over all of a side that has none.
        width: of the edge, from three quarters of its step to one quarter, px, the median over the
            places.
        clear: part of the side that the other sides' edges do not reach.
        doubt: standard deviation of all of a side's edge together, px: next to another view the
            brightness does not fall to the dark, and its half is no edge; next to a lamp in view it
            rises, and is clipped.
        lit: which sides are beside a lamp.
        seam: whether light rises to another view, beside the side where one is expected.
    """

    shares: Float[np.ndarray, " points"]
    offsets: Float[np.ndarray, "sides points"]
    scale: Float[np.ndarray, "sides points"]
    found: Bool[np.ndarray, "sides points"]
    contrast: Float[np.ndarray, " sides"]
    width: Float[np.ndarray, " sides"]
    clear: Float[np.ndarray, " sides"]
    doubt: Float[np.ndarray, " sides"]
    lit: Bool[np.ndarray, " sides"]
    seam: bool = False


@dataclass(frozen=True)
class Line:
    """A side moved outward by ``offset + turn · share``.

    Attributes:
        offset: tangent plane.
        turn: tangent plane.
        covariance: of both.
        roughness: the part of it that neighbouring edges share: where a pad's own edge is rough.
        scatter: standard deviation of the edges about it, px.
    """

    offset: float
    turn: float
    covariance: Float[np.ndarray, "2 2"]
    roughness: Float[np.ndarray, "2 2"]
    scatter: float

    def at(self, share: float) -> float:
        """How far outward the line is at a part of the side, tangent plane."""
        return self.offset + self.turn * share

    def variances(self, share: float) -> tuple[float, float]:
        """Variance of that, and the part of it that is the edge's roughness."""
        both = (self.covariance, self.roughness)
        of_all, rough = (
            float(one[0, 0] + share * (one[0, 1] + one[1, 0] + share * one[1, 1])) for one in both
        )
        return of_all, rough


class Outline(NamedTuple):
    """The sides of one view, where they are expected.

    Attributes:
        plane: in which the sides are straight.
        sides: four of them.
        adjoining: index of the side beside which another view is expected, if one is.
    """

    plane: TangentPlane
    sides: list[Side]
    adjoining: int | None = None


class _Sides(NamedTuple):
    """The sides of several views, all arrays; places are those of one view after the other."""

    start: Float[np.ndarray, "views sides 2"]
    end: Float[np.ndarray, "views sides 2"]
    outward: Float[np.ndarray, "views sides 2"]

    @classmethod
    def of(cls, outlines: Sequence[Outline]) -> _Sides:
        """Those of outlines."""
        all_sides = [outline.sides for outline in outlines]
        starts = np.array([[side.start for side in sides] for sides in all_sides])
        ends = np.array([[side.end for side in sides] for sides in all_sides])
        return cls(starts, ends, np.array([[side.outward for side in one] for one in all_sides]))

    def places(self, shares: Float[np.ndarray, " points"]) -> Float[np.ndarray, "places 2"]:
        """As `Side.places`, of one side after the other."""
        ways = shares[:, None] * (self.end - self.start)[:, :, None]
        return (self.start[:, :, None] + ways).reshape(-1, 2)

    def along_normals(
        self, vectors: Float[np.ndarray, "places 2"]
    ) -> Float[np.ndarray, "views sides places_of_a_view"]:
        """Products of vectors with the normals of all sides of their view."""
        of_views = vectors.reshape(len(self.start), -1, 2)
        return self.outward @ np.swapaxes(of_views, 1, 2)

    def beyond(
        self, places: Float[np.ndarray, "places 2"]
    ) -> Float[np.ndarray, "views sides places_of_a_view"]:
        """How far outward places are from all sides of their view, tangent plane."""
        return self.along_normals(places) - np.sum(self.start * self.outward, -1)[..., None]

    def depths(
        self, places: Float[np.ndarray, "places 2"], outward: Float[np.ndarray, "places 2"]
    ) -> Float[np.ndarray, " places"]:
        """How far it is inward from places on the sides to another side, tangent plane."""
        toward = self.along_normals(outward)
        ahead = toward < -1e-9
        depths = np.where(ahead, self.beyond(places) / np.where(ahead, toward, 1.0), np.inf)
        return depths.min(axis=1).ravel()


def find_edges(
    gray: Float[np.ndarray, "rows columns"],
    lens: Lens,
    plane: TangentPlane,
    sides: list[Side],
    lamps: Mask | None = None,
    adjoining: int | None = None,
) -> Edges:
    """The edges of all sides: where light first falls below half of its step outward.

    Beside a lamp in view, or a brighter view, it rises instead, or falls to a gap before it.

    Args:
        gray: light, float32.
        lens: of the camera.
        plane: in which the sides are straight.
        sides: where they are expected.
        lamps: where lamps are in view, if any are.
        adjoining: index of the side beside which another view is expected, if one is.
    """
    return find_all_edges(gray, lens, [Outline(plane, sides, adjoining)], lamps)[0]


def find_all_edges(
    gray: Float[np.ndarray, "rows columns"],
    lens: Lens,
    outlines: Sequence[Outline],
    lamps: Mask | None = None,
) -> list[Edges]:
    """As `find_edges`, of several views at once, which takes half of the time."""
    shares = np.linspace(TRIMMED, 1 - TRIMMED, POINTS)
    views, each = len(outlines), len(outlines[0].sides)
    shape = (views * each, POINTS)
    sides = _Sides.of(outlines)
    flat, outward = sides.places(shares), np.repeat(sides.outward.reshape(-1, 2), POINTS, axis=0)
    rays = TangentPlane(0.0).rays(np.concatenate([flat, flat + SMALL * outward]))
    middles = np.repeat([outline.plane.angle for outline in outlines], each * POINTS)
    at, beside = np.split(lens.project(rays + np.tile(middles, 2)[:, None] * [1, 0]), 2)
    scale = np.maximum(np.hypot(*(beside - at).T) / SMALL, 1e-9)
    normal = (beside - at) / (SMALL * scale[:, None])
    reach = np.linspace(-REACH, REACH, SAMPLES)
    step = reach[1] - reach[0]
    longer = np.concatenate([reach[0] - step * np.arange(2 * NEAR, 0, -1), reach])
    # Column and row each by itself in memory, as they are sampled.
    first, way = (one.T[..., None].astype(np.float32) for one in (at, normal))
    places = np.moveaxis(first + longer.astype(np.float32) * way, 0, -1)
    long = cv2.blur(sampled(gray, places), (3, 1), borderType=cv2.BORDER_REPLICATE)
    profile = long[:, 2 * NEAR :]
    # A narrow view may end again within reach: the brightest quarter is surely inside.
    inner = profile[:, : SAMPLES // 2 + 1]
    inside = _brighter(inner)
    outside = profile[:, SAMPLES // 2 :].min(axis=1)
    lit, glow = np.zeros(len(flat), bool), np.zeros(len(flat))
    adjoins = [[i == outline.adjoining for i in range(each)] for outline in outlines]
    seam = np.repeat(np.ravel(adjoins), POINTS)
    in_view = lamps is not None and bool(lamps.any())
    if in_view or seam.any():
        lamp = np.zeros(profile.shape, bool)
        if lamps is not None:
            lamp = sampled(lamps, places[:, 2 * NEAR :]) > 0
        # A lamp along the section may be seen too thin to be clipped.
        along = np.repeat(np.tile(np.arange(each) % 2 == 0, views) & in_view, POINTS)
        toward = lamp | (along | seam)[:, None]
        rise = _rises(long, lens, toward, seam, sides.depths(flat, outward) * scale)
        lit = np.repeat((rise < SAMPLES).reshape(shape).mean(axis=1) > LIT, POINTS)
        profile[lit], inside[lit], outside[lit], glow[lit] = _before_lamps(
            profile[lit], lens, rise[lit]
        )
        # Where the lamp of such a side is not found, no edge is; nor are a lamp's own ones.
        profile[lit & (rise == SAMPLES)] = 0
        own = ~lit & lamp.any(axis=1)
        profile[own] = np.where(lamp[own], profile[own].min(axis=1, keepdims=True), profile[own])
        inside[own] = _brighter(inner[own])
    start = SAMPLES // 2 - np.argmax(inner[:, ::-1] >= inside[:, None], axis=1)
    contrast = inside - outside
    crossings = [_falling(profile, start, inside - part * contrast) for part in (0.25, 0.5, 0.75)]
    begins, middle, ends = (reach[0] + step * place for place, _ in crossings)
    found = np.all([there for _, there in crossings], axis=0)
    width = _Medians(found.reshape(shape)).of((ends - begins).reshape(shape))
    # Where a view is too thin, as at its acute corners, another side's edge is in the way.
    thick = np.repeat(FEET * width + REACH * (1 - BRIGHTER), POINTS)
    inward = flat - (thick / scale)[:, None] * outward
    clear = (sides.beyond(inward) < 0).all(axis=1).ravel()
    # Noise and steps of rounding are of much the same size in codes, bright or dark.
    height = lens.codes(inside) - lens.codes(outside)
    there = (found & clear & (height >= LEAST_CONTRAST)).reshape(shape)
    whole = _Medians(np.ones(shape, bool))
    by_side = whole.of(np.where(lit, inside, outside).reshape(shape))
    dark = np.repeat(by_side.reshape(views, each).min(axis=1), each * POINTS)
    depth = contrast / np.maximum(inside - dark.astype(inside.dtype), 1.0)
    medians = _Medians(there)
    deep = medians.of(depth.reshape(shape))
    doubt = SEAM * np.maximum(DEEP - deep, 0.0)
    # Blur is much the same on all sides: a wider edge is a gradient of light, its half no edge.
    usual = np.repeat(_Medians(np.ones((views, each), bool)).of(width.reshape(views, each)), each)
    doubt = np.hypot(doubt, GRADUAL * np.maximum(width - WIDER * usual, 0.0))
    by_lamps = np.asarray(lit.reshape(shape)[:, 0])
    doubt = np.where(by_lamps, medians.of(glow.reshape(shape)), doubt)
    heights = height.reshape(shape)
    contrasts = np.where(there.any(axis=1), medians.of(heights), whole.of(heights))
    offsets, scales = (middle / scale).reshape(shape), scale.reshape(shape)
    clearness, seams = clear.reshape(shape).mean(axis=1), seam[::POINTS]
    return [
        Edges(
            shares=shares,
            offsets=offsets[own],
            scale=scales[own],
            found=there[own],
            contrast=contrasts[own],
            width=width[own],
            clear=clearness[own],
            doubt=doubt[own],
            lit=by_lamps[own] & ~seams[own],
            seam=bool((by_lamps[own] & seams[own]).any()),
        )
        for own in (slice(each * i, each * (i + 1)) for i in range(views))
    ]


def _brighter(inner: Float[np.ndarray, "places samples"]) -> Float[np.ndarray, " places"]:
    """What the part `BRIGHTER` of every place's samples is darker than; as `np.quantile`."""
    below, part = divmod(BRIGHTER * (inner.shape[1] - 1), 1)
    at = int(below)
    ordered = np.partition(inner, (at, at + 1), axis=1)
    return ordered[:, at + 1] - (1 - part) * (ordered[:, at + 1] - ordered[:, at])


def _rises(
    profile: Float[np.ndarray, "places longer"],
    lens: Lens,
    toward: Bool[np.ndarray, "places samples"],
    seam: Bool[np.ndarray, " places"],
    depths: Float[np.ndarray, " places"],
) -> Int[np.ndarray, " places"]:
    """Where light first rises steeply outward, in samples; their number where it does not.

    Args:
        profile: of light, which begins so much before that of the edges as the rise is wide.
        lens: of the camera.
        toward: where lamps or another view may be: to there it rises.
        seam: whether that is another view.
        depths: px to another side of the view, beyond which the edge of that may rise.
    """
    earlier, before, behind = (
        profile[:, 2 * NEAR * i :][:, : SAMPLES - 2 * NEAR] for i in range(3)
    )
    brightened = np.where(seam, BRIGHTENED_BY_VIEW, BRIGHTENED)[:, None]
    steep = behind > np.maximum(brightened * before, before + STEEPER * (before - earlier))
    inward = np.linspace(-REACH, REACH, SAMPLES)[: -2 * NEAR]
    steep &= inward > 2.0 - depths[:, None]
    steep &= toward[:, 2 * NEAR :]
    enough = np.broadcast_to(np.where(seam, RISE_TO_VIEW, RISE)[:, None], steep.shape)[steep]
    steep[steep] = lens.codes(behind[steep]) - lens.codes(before[steep]) > enough
    first = np.argmax(steep, axis=1)
    counts = np.arange(steep.shape[1])
    near = (counts >= first[:, None]) & (counts <= first[:, None] + 2 * NEAR)
    steepest = np.argmax(np.where(near, behind - before, -np.inf), axis=1)
    return np.where(steep.any(axis=1), steepest + NEAR, SAMPLES)


def _before_lamps(
    profile: Float[np.ndarray, "places samples"], lens: Lens, rise: Int[np.ndarray, " places"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Profiles beside lamps as those of edges: with light inside and outside, and what is doubted.

    A gap between a pad and a lamp does not become dark: half of the way down to its floor is the
    edge. Where there is no gap it is half of the way up to the lamp: what rises is turned over.
    """
    rise = np.minimum(rise, SAMPLES - NEAR - 1)
    rows, counts = np.arange(len(profile)), np.arange(SAMPLES)
    first = rise - NEAR
    floor, later = profile[rows, first], counts > first[:, None]
    before = np.where(later, 0.0, profile)
    pad = before.max(axis=1)
    gap = floor < VALLEY * pad
    lamp = later & (counts <= rise[:, None] + 2 * NEAR)
    peak = np.where(lamp, profile, 0.0).max(axis=1)
    risen = np.minimum(np.maximum.accumulate(np.where(later, profile, 0.0), axis=1), peak[:, None])
    turned = np.where(gap[:, None], floor[:, None], 2 * floor[:, None] - risen)
    inside = np.where(gap, pad, floor)
    outside = np.where(gap, floor, 2 * floor - peak)
    beside = np.where(lens.codes(peak) >= CLIPPED, BLOOM, GLOW)
    doubt = np.where(gap, BLOOM * floor / np.maximum(pad, 1e-6), beside)
    return np.where(later, turned, profile), inside, outside, doubt


def _falling(
    profile: Float[np.ndarray, "places samples"],
    start: Int[np.ndarray, " places"],
    level: Float[np.ndarray, " places"],
) -> tuple[Float[np.ndarray, " places"], Bool[np.ndarray, " places"]]:
    """Where brightness first falls below a level behind a start, in samples; and if it does."""
    rows, counts = np.arange(len(profile)), np.arange(profile.shape[1])
    below = (profile < level[:, None]) & (counts > start[:, None])
    last = np.maximum(np.argmax(below, axis=1), 1)
    high, low = profile[rows, last - 1], profile[rows, last]
    drop = high - low
    found = below.any(axis=1) & (drop > 0) & (high >= level)
    return last - 1 + np.where(found, (high - level) / np.where(drop > 0, drop, 1.0), 0.0), found


def fit_lines(edges: Edges) -> list[Line]:
    """A line through the edges of every side: Tukey's weights, begun at the repeated median.

    Sources: A. F. Siegel, *Robust regression using repeated medians*, Biometrika 69 (1982) 242;
    P. J. Huber, E. M. Ronchetti, *Robust Statistics*, 2nd ed., §7.8. Neighbouring edges err alike,
    so the covariance counts fewer of them: n (1 − r) / (1 + r) for the correlation r of neighbours.
    Noise has no neighbours: the part 1 − r of their variance is as in n independent edges.
    """
    return fit_all_lines([edges])[0]


def fit_all_lines(views: Sequence[Edges]) -> list[list[Line]]:
    """As `fit_lines`, of several views at once, which takes a third of the time."""
    each = len(views[0].found)
    parts = "offsets", "scale", "found", "contrast", "width", "clear", "doubt", "lit"
    edges = replace(
        views[0],
        **{name: np.concatenate([getattr(view, name) for view in views]) for name in parts},
    )
    lines = _lines(edges)
    return [lines[start : start + each] for start in range(0, len(lines), each)]


def _lines(edges: Edges) -> list[Line]:
    unknown = Line(0.0, 0.0, np.diag([UNKNOWN, 0.0]), np.zeros((2, 2)), np.inf)
    found, offsets = edges.found, edges.offsets * edges.scale
    if not found.any():
        return [unknown] * len(found)
    medians = _Medians(found)
    design = np.stack([edges.scale, edges.scale * edges.shares])
    products = np.stack([design[0] ** 2, design[0] * design[1], design[1] ** 2, *design * offsets])
    solution, weights, normal = _repeated_medians(edges), found * 1.0, np.zeros((len(found), 2, 2))
    for _ in range(ROUNDS):
        left = offsets - np.einsum("isp,si->sp", design, solution)
        far = left / (TUKEY * medians.deviation(left))
        weights = np.where(found, np.maximum(1 - far**2, 0) ** 2, 0.0)
        solution, normal = _weighted(products, weights)
    left = offsets - np.einsum("isp,si->sp", design, solution)
    deviation = medians.deviation(left)
    bend = _bends(left, deviation[:, 0], found)
    variance = np.sum(weights * left**2, axis=1) / np.maximum(np.sum(weights, axis=1) - 2, 1)
    furthest = TUKEY * deviation
    near = np.where(found, np.clip(left, -furthest, furthest), 0.0)
    pairs = np.maximum((found[:, 1:] & found[:, :-1]).sum(axis=1), 1)
    mean_square = np.sum(near**2, axis=1) / np.maximum(found.sum(axis=1), 1)
    alike = np.sum(near[:, 1:] * near[:, :-1], axis=1) / pairs / np.maximum(mean_square, 1e-12)
    alike = np.clip(alike, 0.0, 0.9)
    independent = variance[:, None, None] * np.linalg.inv(normal)
    covariance = ((1 + alike) / (1 - alike))[:, None, None] * independent
    roughness = covariance - (1 - alike)[:, None, None] * independent
    scale = np.mean(edges.scale, axis=1)
    covariance[:, 0, 0] += (edges.doubt / scale) ** 2
    # What moves one end only, and turns the side.
    first, last = (bend / scale[:, None]).T ** 2
    covariance += first[:, None, None] * np.array([[1, -1], [-1, 1]])
    covariance[:, 1, 1] += last
    return [
        Line(
            offset=float(line[0]),
            turn=float(line[1]),
            covariance=covariance[i],
            roughness=roughness[i],
            scatter=float(np.sqrt(variance[i])),
        )
        if found[i].sum() >= POINTS // 4
        else unknown
        for i, line in enumerate(solution)
    ]


def _bends(
    left: Float[np.ndarray, "sides places"],
    deviation: Float[np.ndarray, " sides"],
    found: Bool[np.ndarray, "sides places"],
) -> Float[np.ndarray, "sides 2"]:
    """By how much the edges near each end of a side lie off its line, all to one side, px.

    A contact that bulges the gel near a corner moves them: the line does not follow, but whether it
    or they are the pad's side the edges do not show. What scatter alone does is taken off.
    """
    part = left.shape[1] // ENDS
    off = []
    for one in (slice(0, part), slice(left.shape[1] - part, None)):
        there = found[:, one]
        middle = _Medians(there).of(left[:, one])
        scatter = deviation / np.sqrt(np.maximum(there.sum(axis=1), 1))
        off.append(np.maximum(np.abs(middle) - SCATTERED * scatter, 0.0))
    return np.stack(off, axis=-1)


def _weighted(
    products: Float[np.ndarray, "5 sides places"], weights: Float[np.ndarray, "sides places"]
) -> tuple[Float[np.ndarray, "sides 2"], Float[np.ndarray, "sides 2 2"]]:
    """Weighted least squares of two unknowns, and their normal matrix.

    Args:
        products: of the unknowns' factors: both of the first, one of each, both of the second, and
            of each with what is wanted.
        weights: of every place's residual.
    """
    first, mixed, second, *wanted = np.einsum("isp,sp->is", products, weights)
    # Where all weight lies in one place, the side keeps its direction.
    least = 1e-12 * (first + second) + 1e-30
    first, second = first + least, second + least
    determinant = first * second - mixed**2
    solution = second * wanted[0] - mixed * wanted[1], first * wanted[1] - mixed * wanted[0]
    normal = np.stack([first, mixed, mixed, second], axis=-1).reshape(-1, 2, 2)
    return np.stack(solution, axis=-1) / determinant[:, None], normal


def _repeated_medians(edges: Edges) -> Float[np.ndarray, "sides 2"]:
    """Offset and turn of every side: of each place the median turn to the others, of these again.

    A line added to all of the edges is added to the result, however bad the edges are.
    """
    run = edges.shares - edges.shares[:, None] + np.eye(len(edges.shares))
    turns = (edges.offsets[:, None, :] - edges.offsets[..., None]) / run
    others = edges.found[:, None, :] & ~np.eye(len(edges.shares), dtype=bool)
    medians = _Medians(edges.found)
    turn = medians.of(_Medians(others).of(turns))
    offset = medians.of(edges.offsets - turn[:, None] * edges.shares)
    return np.stack([offset, turn], axis=-1)


class _Medians:
    """Medians along the last axis of the values that are there, whose ranks are counted once.

    Args:
        there: which values count.
    """

    def __init__(self, there: Bool[np.ndarray, "*sides places"]) -> None:
        count = there.sum(axis=-1)
        self._without, self._none = ~there, count == 0
        starts = np.arange(count.size).reshape(count.shape) * there.shape[-1]
        self._lower = starts + np.maximum(count - 1, 0) // 2
        self._upper = starts + np.minimum(count // 2, there.shape[-1] - 1)

    def of(self, values: Float[np.ndarray, "*sides places"]) -> Float[np.ndarray, "*sides"]:
        """The medians; 0 where no value is there."""
        ordered = np.where(self._without, np.inf, values)
        ordered.sort(axis=-1)
        flat = ordered.reshape(-1)
        return np.where(self._none, 0.0, (flat[self._lower] + flat[self._upper]) / 2)

    def deviation(self, left: Float[np.ndarray, "sides places"]) -> Float[np.ndarray, "sides 1"]:
        """Standard deviation of most of the residuals; never quite 0."""
        return np.maximum(1.4826 * self.of(np.abs(left)), LEAST_SCATTER)[:, None]
