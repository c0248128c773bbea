"""A contact's place and size by least squares: a bulge, and how it is lit.

The membrane is lifted as `perception.contacts.membranes` has it: five unknowns. What is seen at a
place of the flat pad is the membrane where the ray first meets it, with the light of each lamp as
`perception.contacts.lamps` has it, and with light that comes evenly from all sides, of which a
membrane that leans by the unit normal n gets (1 + n_z) / 2. How much of the light of a color comes
from which lamp are linear unknowns, which make up all of it, beside a background that varies
linearly; they are eliminated (G. Golub, V. Pereyra, Inverse Problems 19 (2003) R1), and the rest is
found by damped Gauss-Newton steps with Cauchy's weights. Behind a bulge lies its shadow: of each
color the side away from its lamp does not count, nor what is behind other contacts.

What a model lacks is alike at neighboring places, and so is the noise of a compressed picture: the
covariance is the one that is right when residuals of a sector depend on each other in whatever way
(K. Liang, S. Zeger, Biometrika 73 (1986) 13). In the light of lamps the depth is off by more than
that: `DEPTH_BY_LAMPS` is added to it, and to what follows it; `EDGE_BY_LAMPS` to the edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from perception.contacts.change import CELL, NORMAL, Change, block_means
from perception.contacts.lamps import Lamps, Pieces
from perception.contacts.membranes import FADE, FLATTEST, look_up, tables

PER_RADIUS = 5
"""Samples along the radius that is expected."""

REACH = 1.3, 0.8
"""Samples lie within so many radii and so many mm more: beyond, a membrane is flat."""

APART = 0.5
"""mm between contacts, at least: what is nearer to one than that counts as its part."""

STEPS, RAY_STEPS = 30, 5
"""Of a fit; and of a ray to the membrane, from above, to meet the first of several places."""

FEWEST = 30
"""Samples for a fit."""

FLOOR = 0.005
"""The model of the light is no better than that, part of the light."""

SPREAD, FINE_SPREADS, COMPRESSED_SPREADS = 1.5, (1.5, 3.0), (3.0, 6.0)
"""Pixels: a pixel and the lens spread brightness as much as a square with such a side does; and
colors, the least and the most.

Cameras have one color for each pixel and interpolate the others (Bayer): colors are spread by a
variance of 0.5 pixels² more, twelve times which a square has squared. So are those of compressed
pictures, whose chroma has half the resolution (0.57, JPEG, 4:2:0); where it changes by less than 20
codes its fine part is dropped, too (quality 90), and edges are twice as wide. Which of both it is
is unknown: where compression has dropped nothing, diameters come out up to two pixels too small.
"""

CAUCHY = 2.385
"""Deviations at which a sample counts half: 95 % as good for normal noise (P. Holland, R. Welsch,
Commun. Stat. A 6 (1977) 813)."""

DEPTH, DEPTHS = 0.6, 0.6
"""Median of depths that are expected, mm, and the deviation of their logarithm."""

SHARES, TOTAL = 0.5, 0.3
"""Deviations of what is expected of light: all of a color's comes from its lamp, and all shares
together are as much as there is."""

BACKGROUND, RISING = 0.2, 0.1
"""Likewise of a background, part of the light, and of its slopes, 1/mm: other contacts' shadows and
light, and what the exposure leaves."""

DEPTH_BY_LAMPS, EDGE_BY_LAMPS = 0.4, 0.08
"""What the model of the light of lamps gives a contact: deviation of the logarithm of its depth,
and of the place of its edge on each side, mm. How light falls behind layers and beside other
contacts is not in the model. As found in a path tracer's pictures (`physical-check-contacts`, seed
20270)."""

TINY = 1e-6
"""What cannot be seen in any way is unknown, not a fault."""

SECTORS = 16
"""About a contact."""

LEAST = np.array([-np.inf, -np.inf, math.log(0.4), math.log(0.05), 0.0])
MOST = np.array([np.inf, np.inf, math.log(6.0), math.log(2.5), FLATTEST])
"""Of a place (mm), the logarithms of radius and depth (mm), and β."""

UNIT = np.array([0.1, 0.1, 0.1, 0.2, 0.2])
"""Of these: no step is longer than 3, steps of less than 0.05 end a fit, and slopes are those of
chords of 0.1."""

EXPECTED = np.array([0, 0, 0, math.log(DEPTH), FLATTEST / 2])
SURENESS = np.array([0, 0, 0, DEPTHS**-2, 12 / FLATTEST**2])
"""Any β is as likely as any other."""

Parameters = Float[np.ndarray, "5"]
Circle = Float[np.ndarray, "3"]
Circles = Float[np.ndarray, "_ 3"]


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted contact.

    Attributes:
        parameters: place along and across, logarithms of radius and depth, β.
        covariance: of these.
        explained: part of the change about it, beyond noise, that the model explains.
        strength: root of the squares that it explains, over what the rest is like.
        light: part of the expected light that is of the color's own lamp, or even where there is
            none; of the color where it is least.
    """

    parameters: Parameters
    covariance: Float[np.ndarray, "5 5"]
    explained: float
    strength: float
    light: float

    @property
    def circle(self) -> Circle:
        """Its place and radius, mm."""
        return np.array([*self.parameters[:2], math.exp(self.parameters[2])])


def start_at(circle: Circle) -> Parameters:
    """Parameters of a contact of usual depth and shape."""
    return np.array([circle[0], circle[1], math.log(circle[2]), *EXPECTED[3:]])


def mean_of(fits: Sequence[Fit]) -> Fit:
    """A contact by fits that are as likely as each other: what they differ by is uncertain.

    Args:
        fits: at least one.
    """
    every = np.array([one.parameters for one in fits])
    middle = every.mean(axis=0)
    within = np.mean([one.covariance for one in fits], axis=0)
    between = (every - middle).T @ (every - middle) / len(fits)
    return replace(fits[0], parameters=middle, covariance=within + between)


def fit(
    change: Change,
    start: Parameters,
    others: Circles,
    lamps: Lamps,
    spread: float,
    steps: int = STEPS,
) -> Fit | None:
    """Fit a contact; ``None`` where there is too little of it on the pad.

    Args:
        change: of the light of its pad.
        start: parameters near which it is.
        others: contacts near it, which are left out.
        lamps: that light the pad.
        spread: side of the square over which it is seen, pixels.
        steps: at most; without any only the light is fitted.
    """
    point = np.clip(start, LEAST, MOST)
    circle = np.array([*point[:2], math.exp(point[2])])
    samples = _sample(change, circle, others, spread)
    if len(samples.along) < FEWEST:
        return None
    problem = _Problem(change, samples, lamps, circle, others)
    damping = 1e-2
    model = problem.model(point)
    if np.count_nonzero(model.lit) < FEWEST:  # it lies in the shadows of others
        return None
    weights = model.lit / samples.deviation**2
    solved = problem.solve(model, point, weights)
    for _ in range(steps):
        weights = problem.robust(model, solved)
        solved = problem.solve(model, point, weights)
        damped = solved.normal + damping * np.diag(np.diag(solved.normal))
        step = np.clip(np.linalg.solve(damped, solved.slope), -3 * UNIT, 3 * UNIT)
        newer = np.clip(point + step, LEAST, MOST)
        tried = problem.model(newer)
        result = problem.solve(tried, newer, weights)
        if result.cost > solved.cost:
            damping *= 10
            continue
        done = np.all(np.abs(newer - point) < 0.05 * UNIT)
        point, model, solved, damping = newer, tried, result, max(damping / 10, 1e-4)
        if done:
            break
    return problem.fitted(point, model, solved)


class _Samples(NamedTuple):
    """Means over squares about a contact; arrays over samples.

    Attributes:
        along: places along the pad, mm.
        across: across it from its middle, mm.
        part: by which the light has changed, of each color.
        deviation: of that.
        slopes: of the rays.
        blur: over so many mm about a place what is seen there is spread.
    """

    along: Float[np.ndarray, " samples"]
    across: Float[np.ndarray, " samples"]
    part: Float[np.ndarray, "samples colors"]
    deviation: Float[np.ndarray, "samples colors"]
    slopes: Float[np.ndarray, "samples 2"]
    blur: float


def _sample(change: Change, circle: Circle, others: Circles, spread: float) -> _Samples:
    """What has changed about a circle, away from others and from the pad's edges."""
    along, across, radius = circle.tolist()
    cells = max(1, round(radius / PER_RADIUS / CELL))
    reach, half = REACH[0] * radius + REACH[1], change.width / 2
    ranges = []
    for middle, count in zip((along, across + half), change.inner.shape, strict=True):
        first = min(max(0, int((middle - reach) / CELL)), count)
        blocks = max(0, min(count, int((middle + reach) / CELL) + 1) - first) // cells
        ranges.append((first, blocks))
    if not all(blocks for _, blocks in ranges):
        none = np.zeros(0)
        return _Samples(none, none, *np.zeros((2, 0, 1)), slopes=np.zeros((0, 2)), blur=0.0)
    window = tuple(slice(first, first + blocks * cells) for first, blocks in ranges)
    u, v = np.meshgrid(
        *((first + (np.arange(blocks) + 0.5) * cells) * CELL for first, blocks in ranges),
        indexing="ij",
    )
    v = v - half
    fields = change.part, change.noisiness, change.unsure, change.slopes
    inner = block_means(change.inner[window].astype(np.float32), cells)
    part, noisiness, unsure, slopes = (block_means(one[window], cells) for one in fields)
    own = (np.hypot(u - along, v - across) < reach) & (inner > 0.99)
    for other in others:
        own &= np.hypot(u - other[0], v - other[1]) > other[2] + APART
    blur = math.hypot(cells * CELL, spread * math.sqrt(change.pixels_at(along, across).prod()))
    deviation = np.hypot(change.noise(cells) * noisiness[own], np.hypot(unsure[own], FLOOR))
    return _Samples(u[own], v[own], part[own], deviation, slopes[own], blur)


class _Bulge(NamedTuple):
    """A membrane at places; arrays of the shape (sets of parameters, places).

    Attributes:
        height: mm.
        lean: how far its unit normal leans along the pad, and across.
        upright: the normal's component up.
        along: of the places from its middle, mm.
        across: likewise.
    """

    height: np.ndarray
    lean: tuple[np.ndarray, np.ndarray]
    upright: np.ndarray
    along: np.ndarray
    across: np.ndarray


def _lift(parameters: Float[np.ndarray, "sets 5"], samples: _Samples, blur: float) -> _Bulge:
    """Where the rays of samples meet a membrane, for parameters and others that are near them."""
    height_table, slope_table = tables(blur)
    # Single precision is four times as fast.
    first, second = samples.slopes.T
    places = np.stack([samples.along, samples.across]).astype(np.float32)

    def at(sets: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
        u, v, radius, depth, beta = sets.T[..., None].astype(np.float32)
        radius, depth = np.exp(radius), np.exp(depth)
        along, across = places[0] - u + first * z, places[1] - v + second * z
        away = np.sqrt(along * along + across * across) + 1e-6
        beyond = np.maximum(away - radius, 0) / FADE
        share, lifted = away / radius, depth * np.exp(-beyond * beyond)
        height = lifted * look_up(height_table, share, beta)
        slope = lifted / radius * look_up(slope_table, share, beta) - 2 / FADE * beyond * height
        slope = slope / away
        return height, slope * along, slope * across, along, across

    def nearer(sets: np.ndarray, z: np.ndarray) -> np.ndarray:
        height, by_along, by_across, _, _ = at(sets, z)
        return z - (z - height) / np.clip(1 - first * by_along - second * by_across, 0.6, 3)

    z = np.full((1, len(first)), math.exp(parameters[0, 3]), np.float32)
    for _ in range(RAY_STEPS):
        z = nearer(parameters[:1], z)
    height, by_along, by_across, along, across = at(parameters, nearer(parameters, z))
    upright = 1 / np.sqrt(1 + by_along * by_along + by_across * by_across)
    return _Bulge(height, (-upright * by_along, -upright * by_across), upright, along, across)


class _Model(NamedTuple):
    """Of a point and of points beside it; arrays of the shape (colors, points, samples, …).

    Attributes:
        terms: of the light, which the factors multiply.
        relit: by which part there is more light where rays meet the membrane.
        lit: how much samples count, shape (samples, colors).
        sector: of each sample.
    """

    terms: np.ndarray
    relit: np.ndarray
    lit: Float[np.ndarray, "samples colors"]
    sector: Int[np.ndarray, " samples"]


class _Solved(NamedTuple):
    """Least squares about a point.

    Attributes:
        cost: weighted sum of squares.
        normal: matrix of the normal equations of the parameters.
        slope: their right-hand side.
        scores: each sample's part of that.
        prior: covariance of what the slope has from what is expected.
        residual: of the samples.
        factors: of the light, and of the background.
    """

    cost: float
    normal: Float[np.ndarray, "5 5"]
    slope: Parameters
    scores: Float[np.ndarray, "samples 5"]
    prior: Float[np.ndarray, "5 5"]
    residual: Float[np.ndarray, "samples colors"]
    factors: Float[np.ndarray, "colors factors"]


class _Problem:
    """Least squares of one contact's parameters."""

    def __init__(
        self, change: Change, samples: _Samples, lamps: Lamps, circle: Circle, others: Circles
    ) -> None:
        self._change, self._samples = change, samples
        away = samples.along - circle[0], samples.across - circle[1]
        self._background = np.stack([np.ones_like(away[0]), *away], axis=-1)
        self._blur = round(min(samples.blur / circle[2], 1.0), 1)
        self._light, self._visible = (
            change.at(one, samples.along, samples.across) for one in (change.light, change.visible)
        )
        present = [lamp for lamp in lamps if lamp is not None]
        self._pieces = [Pieces.of(one, circle[:2], *samples[:2]) for one in present]
        colors = samples.part.shape[1]
        self._toward = np.zeros((colors, 2))
        self._mean = np.zeros((colors, len(present) + 4))
        self._own = np.zeros(self._mean.shape, bool)
        for color, lamp in enumerate(lamps):
            if lamp is None:
                self._mean[color, : len(present)] = 1 / len(present)
            else:
                self._toward[color] = lamp.toward(circle[:2])
                self._own[color, present.index(lamp)] = True
        if not present:
            self._own[:, 0] = True
        self._mean[self._own] = 1
        self._free = np.ones_like(samples.part)
        for along, across, radius in others:
            away = np.stack([samples.along - along, samples.across - across], axis=-1)
            behind = away @ self._toward.T < 0
            beside = np.abs(away @ (self._toward @ [[0, 1], [-1, 0]]).T) < radius + APART
            self._free[behind & beside] = 0
        lit = np.array([1] * (len(present) + 1) + [0] * 3)
        each = (SHARES**-2 if present else 0) * lit
        each[-3:] = BACKGROUND**-2, RISING**-2, RISING**-2
        self._ridge = np.diag(each) + np.outer(lit, lit) / TOTAL**2

    def model(self, point: Parameters) -> _Model:
        """The light of samples at a point, and at one beside it for each parameter."""
        samples = self._samples
        bulge = _lift(np.vstack([point, point + np.diag(0.1 * UNIT)]), samples, self._blur)
        even = (bulge.upright - 1) / 2
        lights = [one.light(*bulge.lean, bulge.upright, bulge.height) - 1 for one in self._pieces]
        relit = np.ones((len(self._mean), *even.shape))
        lit = self._free
        if self._pieces:
            at = (place + slope * bulge.height
                  for place, slope in zip(samples[:2], samples.slopes.T, strict=True))  # fmt: skip
            light = self._change.at(self._change.light, *at) - self._light
            relit = np.exp(np.moveaxis(light, -1, 0))
        along, across = bulge.along[0], bulge.across[0]
        if self._pieces:
            away = np.hypot(along, across)[:, None] + 1e-6
            lit = lit * np.clip(np.stack([along, across], -1) @ self._toward.T / away, 0, 1)
        turn = np.arctan2(across, along) / (2 * np.pi) * SECTORS
        visible = self._visible.T[:, None]
        terms = np.stack([*lights, even], axis=-1) * (visible * relit)[..., None]
        return _Model(terms, visible * (relit - 1), lit, turn.astype(int) % SECTORS)

    def scale(self, model: _Model, solved: _Solved) -> float:
        """Residuals over what noise alone would leave, at least 1."""
        ratio = np.abs(solved.residual) / self._samples.deviation
        return max(1.0, NORMAL * float(np.median(ratio[model.lit > 0])))

    def robust(self, model: _Model, solved: _Solved) -> Float[np.ndarray, "samples colors"]:
        """Weights by which samples that are off count less."""
        deviation = self.scale(model, solved) * self._samples.deviation
        off = solved.residual / (CAUCHY * deviation)
        return model.lit / deviation**2 / (1 + off**2)

    def fitted(self, point: Parameters, model: _Model, solved: _Solved) -> Fit:
        """The result at the end of a fit, with its covariance."""
        part, weight = self._samples.part, model.lit / self._samples.deviation**2
        mean = np.sum(weight * part, axis=0) / (np.sum(weight, axis=0) + TINY)
        total = float(np.sum(weight * (part - mean) ** 2))
        rest = float(np.sum(weight * solved.residual**2))
        noise = min(rest, float(np.sum(model.lit)))
        sectors = np.zeros((SECTORS, 5))
        np.add.at(sectors, model.sector, solved.scores)
        spread = SECTORS / (SECTORS - 5) * sectors.T @ sectors
        inverse = np.linalg.inv(solved.normal)
        covariance = inverse @ (spread + solved.prior) @ inverse
        if self._pieces:
            # How the rest of the parameters follows the depth.
            follows = covariance[:, 3] / covariance[3, 3]
            covariance = covariance + DEPTH_BY_LAMPS**2 * np.outer(follows, follows)
            # Edges on two sides that are off apart move the middle and the radius alike.
            edge = EDGE_BY_LAMPS**2 / 2 * np.array([1, 1, math.exp(-2 * point[2]), 0, 0])
            covariance += np.diag(edge)
        return Fit(
            point,
            covariance,
            (total - rest) / max(total - noise, TINY),
            math.sqrt(max(total - rest, 0)) / self.scale(model, solved),
            float(solved.factors[self._own].min()),
        )

    def solve(self, model: _Model, point: Parameters, weights: np.ndarray) -> _Solved:
        """The factors at a point, and the normal equations of its parameters without them."""
        count, weight = model.terms.shape[-1], weights.T
        background = np.broadcast_to(self._background, (len(weight), *self._background.shape))
        basis = np.concatenate([model.terms[:, 0], background], axis=-1)
        turned = np.swapaxes(basis * weight[..., None], 1, 2)
        inverse = np.linalg.inv(turned @ basis + self._ridge)
        data = self._samples.part.T - model.relit[:, 0]
        pulled = turned @ data[..., None] + (self._mean @ self._ridge)[..., None]
        factors = (inverse @ pulled)[..., 0]
        residual = data - (basis @ factors[..., None])[..., 0]
        by_terms = (model.terms[:, 1:] - model.terms[:, :1]) @ factors[:, None, :count, None]
        change = by_terms[..., 0] + model.relit[:, 1:] - model.relit[:, :1]
        jacobian = np.swapaxes(change / (0.1 * UNIT[:, None]), 1, 2)
        taken = inverse @ (turned @ jacobian)
        own = jacobian - basis @ taken
        prior = np.sum(np.swapaxes(taken, 1, 2) @ self._ridge @ taken, axis=0)
        scores = np.sum((weight * residual)[..., None] * own, axis=0)
        weighted = jacobian * weight[..., None]
        normal = np.sum(np.swapaxes(weighted, 1, 2) @ own, axis=0) + np.diag(SURENESS + TINY)
        short = EXPECTED - point
        slope = np.sum(weighted * residual[..., None], axis=(0, 1)) + SURENESS * short
        cost = np.sum(weight * residual**2) + np.sum(SURENESS * short**2)
        off = factors - self._mean
        cost += np.sum(off @ self._ridge * off)
        prior = prior + np.diag(SURENESS)
        return _Solved(float(cost), normal, slope, scores, prior, residual.T, factors)
