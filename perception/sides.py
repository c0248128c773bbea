"""The sides of views: where their edges are.

An edge is where the brightness falls below half of its step, looked for across the expected side.
All of this is in the tangent plane of the view's rays, where sides are straight.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from perception.lens import Lens, TangentPlane
from perception.masks import CLIPPED, Mask
from perception.medians import Medians, median
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

SHARES = np.linspace(TRIMMED, 1 - TRIMMED, POINTS)
"""Parts of the way along a side at which its edge is looked for."""

SAMPLE = 2 * REACH / (SAMPLES - 1)
"""From one to the next, px."""

SAMPLED = np.linspace(-REACH, REACH, SAMPLES)
"""How far outward the samples are, px."""

BRIGHTER = 0.85
"""Of the samples inside, this part is darker than what counts as the view's brightness; the rest,
which is brighter, must lie between the edges of a view where it is thin."""

QUARTERS = np.array([0.25, 0.5, 0.75], np.float32)
"""Of a step: an edge is at its half, and as wide as it is between the others."""

DEEP, SEAM = 0.9, 10.0
"""Where brightness falls by a smaller part than `DEEP` to the dark, an edge is doubted by so many
pixels per missing part: what falls halfway only may be as far off as a seam is wide."""

WIDER, GRADUAL = 1.5, 0.75
"""An edge more than so many times as wide as those of most sides is doubted by this part of the
rest of its width."""

RISE, BRIGHTENED, STEEPER, NEAR = 10.0, 1.2, 2.5, 4
"""Within twice so many samples light rises to a lamp beside a pad by so many codes and times, and
by so many times as much as just before: on a pad it changes gradually."""

LONGER = np.linspace(-REACH - 2 * NEAR * SAMPLE, REACH, 2 * NEAR + SAMPLES, dtype=np.float32)
"""How far outward samples are that begin earlier, by as much as light rises within, px."""

RISE_TO_VIEW, BRIGHTENED_BY_VIEW = 5.0, 1.05
"""The same where another view is expected beside a pad: behind a seam any rise is to that.

Light on a pad does not fall and rise again along most of a side."""

LIT, VALLEY = 0.5, 0.9
"""A lamp is beside more than this part of a side. A gap between it and the pad is darker than this
share of the pad."""

BLOOM, GLOW = 2.0, 0.3
"""Standard deviation of edges beside a lamp that is clipped or hardly apart, and of others, px."""

SMALL = 1e-4
"""Step of differences in the tangent plane."""

LEAST_CONTRAST = 5.0
"""Of 255: a lower step is no edge that can be relied on."""


Brightness = Float[np.ndarray, "rows columns"]
"""Light of an image, float32, in codes of 8 bits."""

FOLLOWING = [1, 2, 3, 0]
"""Of each side, or corner, the one behind it."""


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of several views where they are expected, clockwise as each view's plane is seen.

    Attributes:
        angle: of the tangent planes in which they are straight, rad.
        start: of every side, in that plane.
        end: of every side.
        adjoining: beside which another view is expected.
    """

    angle: Float[np.ndarray, " views"]
    start: Float[np.ndarray, "views sides 2"]
    end: Float[np.ndarray, "views sides 2"]
    adjoining: Bool[np.ndarray, "views sides"]

    @classmethod
    def between(
        cls,
        angle: Float[np.ndarray, " views"],
        corners: Float[np.ndarray, "views 4 2"],
        adjoining: Bool[np.ndarray, "views 4"],
    ) -> Sides:
        """Those from corner to corner."""
        return cls(angle, corners, corners[:, FOLLOWING], adjoining)

    @functools.cached_property
    def outward(self) -> Float[np.ndarray, "views sides 2"]:
        """Unit normals that point out of the view."""
        along = self.end - self.start
        length = np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-12)
        return np.stack([-along[..., 1] / length, along[..., 0] / length], axis=-1)

    def places(self, shares: Float[np.ndarray, " points"]) -> Float[np.ndarray, "places 2"]:
        """Places at parts 0 to 1 of the way from start to end, of one side after the other."""
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


@dataclass(frozen=True, eq=False)
class Edges:
    """Where the edges of several views' sides were found, at `SHARES` of the way along each.

    Attributes:
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
        seam: beside which light rises to another view that is expected there.
    """

    offsets: Float[np.ndarray, "views sides points"]
    scale: Float[np.ndarray, "views sides points"]
    found: Bool[np.ndarray, "views sides points"]
    contrast: Float[np.ndarray, "views sides"]
    width: Float[np.ndarray, "views sides"]
    clear: Float[np.ndarray, "views sides"]
    doubt: Float[np.ndarray, "views sides"]
    lit: Bool[np.ndarray, "views sides"]
    seam: Bool[np.ndarray, "views sides"]


def find_edges(
    gray: Brightness | Sequence[Brightness], lens: Lens, sides: Sides, lamps: Mask | None = None
) -> Edges:
    """The edges of all sides: where light first falls below half of its step outward.

    Beside a lamp in view, or a brighter view, it rises instead, or falls to a gap before it.

    Args:
        gray: light, float32; that of each view where it is not the same for all.
        lens: of the camera.
        sides: where they are expected.
        lamps: where lamps are in view, if any are.
    """
    views, each = sides.adjoining.shape
    shape = (views, each, POINTS)
    flat, outward = sides.places(SHARES), np.repeat(sides.outward.reshape(-1, 2), POINTS, axis=0)
    rays = TangentPlane(0.0).rays(np.concatenate([flat, flat + SMALL * outward]))
    rays[:, 0] += np.tile(np.repeat(sides.angle, each * POINTS), 2)
    at, beside = lens.project(rays).reshape(2, -1, 2)
    apart = beside - at
    scale = np.maximum(np.hypot(apart[:, 0], apart[:, 1]) / SMALL, 1e-9)
    normal = apart / (SMALL * scale[:, None])
    # Column and row each by itself in memory, as they are sampled.
    first, way = (one.T[..., None].astype(np.float32) for one in (at, normal))
    places = np.moveaxis(first + LONGER * way, 0, -1)
    if isinstance(gray, np.ndarray):
        light = sampled(gray, places)
    else:
        light = np.concatenate(list(map(sampled, gray, np.split(places, views))))
    long = cv2.blur(light, (3, 1), borderType=cv2.BORDER_REPLICATE)
    profile = long[:, 2 * NEAR :]
    # A narrow view may end again within reach: the brightest quarter is surely inside.
    inner = profile[:, : SAMPLES // 2 + 1]
    inside = _brighter(inner)
    outside = profile[:, SAMPLES // 2 :].min(axis=1)
    lit, glow = np.zeros(len(flat), bool), np.zeros(len(flat))
    seam = np.repeat(sides.adjoining.ravel(), POINTS)
    in_view = lamps is not None
    if in_view or sides.adjoining.any():
        lamp = np.zeros(profile.shape, bool)
        if lamps is not None:
            lamp = sampled(lamps, places[:, 2 * NEAR :]) > 0
        # A lamp along the section may be seen too thin to be clipped.
        along = np.repeat(np.tile(np.arange(each) % 2 == 0, views) & in_view, POINTS)
        toward = lamp | (along | seam)[:, None]
        rise = _rises(long, lens, toward, seam, sides.depths(flat, outward) * scale)
        lit = np.repeat((rise < SAMPLES).reshape(-1, POINTS).mean(axis=1) > LIT, POINTS)
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
    crossings, there = _falling(profile, start, inside[:, None] - contrast[:, None] * QUARTERS)
    begins, middle, ends = SAMPLE * crossings.T - REACH
    found = np.asarray(there.all(axis=1))
    width = Medians(found.reshape(shape)).of((ends - begins).reshape(shape))
    # Where a view is too thin, as at its acute corners, another side's edge is in the way.
    thick = np.repeat(FEET * width.ravel() + REACH * (1 - BRIGHTER), POINTS)
    inward = flat - (thick / scale)[:, None] * outward
    clear = (sides.beyond(inward) < 0).all(axis=1).reshape(shape)
    # Noise and steps of rounding are of much the same size in codes, bright or dark.
    height = (lens.codes(inside) - lens.codes(outside)).reshape(shape)
    there = found.reshape(shape) & clear & (height >= LEAST_CONTRAST)
    dark = median(np.where(lit, inside, outside).reshape(shape)).min(axis=1)
    beyond_dark = inside - np.repeat(dark, each * POINTS).astype(inside.dtype)
    depth = (contrast / np.maximum(beyond_dark, 1.0)).reshape(shape)
    medians = Medians(there)
    doubt = SEAM * np.maximum(DEEP - medians.of(depth), 0.0)
    # Blur is much the same on all sides: a wider edge is a gradient of light, its half no edge.
    wider = width - WIDER * median(width)[:, None]
    doubt = np.hypot(doubt, GRADUAL * np.maximum(wider, 0.0))
    by_lamps = lit.reshape(shape)[..., 0]
    if by_lamps.any():
        doubt = np.where(by_lamps, medians.of(glow.reshape(shape)), doubt)
    return Edges(
        offsets=(middle / scale).reshape(shape),
        scale=scale.reshape(shape),
        found=there,
        contrast=np.where(medians.none, median(height), medians.of(height)),
        width=width,
        clear=clear.mean(axis=-1),
        doubt=doubt,
        lit=by_lamps & ~sides.adjoining,
        seam=by_lamps & sides.adjoining,
    )


def _brighter(inner: Float[np.ndarray, "places samples"]) -> Float[np.ndarray, " places"]:
    """What the part `BRIGHTER` of every place's samples is darker than; as `np.quantile`."""
    whole, part = divmod(BRIGHTER * (inner.shape[1] - 1), 1)
    at = int(whole)
    ordered = np.partition(inner, at + 1, axis=1)
    below, above = ordered[:, : at + 1].max(axis=1), ordered[:, at + 1]
    return above - (1 - part) * (above - below)


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
    steep &= SAMPLED[: -2 * NEAR] > 2.0 - depths[:, None]
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
    levels: Float[np.ndarray, "places levels"],
) -> tuple[Float[np.ndarray, "places levels"], Bool[np.ndarray, "places levels"]]:
    """Where brightness first falls below levels behind a start, in samples; and if it does."""
    rows, counts = np.arange(len(profile))[:, None], np.arange(SAMPLES)
    later = counts > start[:, None]
    below = (profile[:, None] < levels[..., None]) & later[:, None]
    last = np.maximum(np.argmax(below, axis=2), 1)
    high, low = profile[rows, last - 1], profile[rows, last]
    drop = high - low
    is_below = (low < levels) & later[rows, last]
    found = is_below & (drop > 0) & (high >= levels)
    return last - 1 + np.where(found, (high - levels) / np.where(drop > 0, drop, 1.0), 0.0), found
