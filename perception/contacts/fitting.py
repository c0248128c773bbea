"""A contact's place and size by least squares: a bulge, and how it is lit.

The membrane is lifted as `perception.contacts.membranes` has it: five unknowns. What is seen at a
place of the flat pad is the membrane where the ray first meets it, with the light of each lamp as
`perception.contacts.lamps` has it, and with light that comes evenly from all sides, of which a
membrane that leans by the unit normal n gets (1 + n_z) / 2. How much of the light of a color comes
from which lamp are linear unknowns, beside a background that varies linearly; they are eliminated
(G. Golub, V. Pereyra, Inverse Problems 19 (2003) R1), and the rest is found by damped Gauss-Newton
steps, with weights that leave out what fits badly. Behind a bulge lies its shadow: of each color
the side away from its lamp does not count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from perception.contacts.change import CELL, NORMAL, Change, block_means
from perception.contacts.lamps import Lamps, Pieces
from perception.contacts.membranes import FADE, FLATTEST, look_up, tables

PER_RADIUS = 5
"""Samples along the radius that is expected."""

REACH = 1.3, 0.8
"""Samples lie within so many radii and so many mm more,"""

APART = 0.5
"""and so far from other contacts, mm."""

ROUNDS, TRIALS = 14, 4
"""Steps of a fit, and how often each is shortened."""

RAY_STEPS, NEAR_STEPS = 4, 2
"""Steps along every ray to the membrane, from above it and from near it."""

STEEP = 0.8
"""Slopes of rays from which on they may meet a membrane at several places."""

FEWEST = 30
"""Samples for a fit."""

FLOOR = 0.005
"""The model of the light is no better than that, part of the light."""

SPREAD = 1.5
"""Pixels: a pixel and the lens spread what is seen over as much as a square so large."""

ROBUST = 2.5
"""Samples that are off by so many times the usual count half."""

LIT, DUSK = -0.1, 0.3
"""Cosine of the angle to a lamp's direction at which samples begin to count, and by how much it
grows until they count wholly."""

CORE = 0.15
"""mm: nearer to the middle there is no such direction."""

DEPTH, DEPTHS = 0.6, 0.6
"""Median of depths that are expected, mm, and the deviation of their logarithm."""

SHAPE, SHAPES = 0.3, 0.5
"""Mean of β that is expected, and its deviation."""

EVEN, EVENS = 1.0, 0.3
"""Part of even light where there is no lamp, and its deviation: it is never quite even."""

SHARES = 1.0
"""Parts of the light of lamps deviate by so much from the color's own lamp alone."""

FREE = 1e-3
"""Of the background nothing is known: this keeps it finite."""

HARMONICS = np.repeat(np.arange(2, 6), 2)
"""Of the logarithm of the radius over the direction from the middle, cosine and sine of each,"""

ROUNDNESS = 0.25
"""which deviate by so much over their number less one."""

_WAVES = np.ones(len(HARMONICS))

LEAST = np.array([-np.inf, -np.inf, math.log(0.4), math.log(0.05), 0.0, *-0.7 * _WAVES])
MOST = np.array([np.inf, np.inf, math.log(6.0), math.log(2.5), FLATTEST, *0.7 * _WAVES])
"""Of a place (mm), the logarithms of radius and depth (mm), β, and the harmonics."""

LONGEST = np.array([0.4, 0.4, 0.25, 0.5, 0.25, *0.2 * _WAVES])
SETTLED = np.array([0.005, 0.005, 0.003, 0.02, 0.01, *0.01 * _WAVES])
"""No step goes farther; and steps so small end a fit."""

STEPS = np.array([0.01, 0.01, 0.01, 0.02, 0.02, *0.01 * _WAVES])
"""For derivatives."""

EXPECTED = np.array([0, 0, 0, math.log(DEPTH), SHAPE, *0 * _WAVES])
SURENESS = np.array([0, 0, 0, DEPTHS**-2, SHAPES**-2, *((HARMONICS - 1) / ROUNDNESS) ** 2])

ROUND, DEPTH_INDEX = 5, 3
"""Parameters of a round contact; the harmonics come after. Which of them the depth is."""

CORNERS = 72
"""Of the polygon that an outline is."""

Parameters = Float[np.ndarray, " parameters"]
Circle = Float[np.ndarray, "3"]
Circles = Float[np.ndarray, "_ 3"]


class Samples(NamedTuple):
    """Means over squares about a contact; arrays over samples.

    Attributes:
        along: places along the pad, mm.
        across: across it from its middle, mm.
        part: by which the light has changed, of each color.
        deviation: of that.
        slopes: of the rays.
        size: of the squares, mm.
        blur: over so many mm about a place what is seen there is spread.
    """

    along: Float[np.ndarray, " samples"]
    across: Float[np.ndarray, " samples"]
    part: Float[np.ndarray, "samples 3"]
    deviation: Float[np.ndarray, "samples 3"]
    slopes: Float[np.ndarray, "samples 2"]
    size: float
    blur: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted contact.

    Attributes:
        parameters: place along and across, logarithms of radius and depth, β; and harmonics.
        covariance: of these.
        factors: of the light, of each color.
        scale: residuals over what noise alone would leave, at least 1.
        explained: part of the change about it that the model explains.
        strength: root of the squares that it explains, over noise.
        light: of its color's own lamp, or that comes evenly where there is none, over what is
            expected; mean of the colors.
    """

    parameters: Parameters
    covariance: Float[np.ndarray, "parameters parameters"]
    factors: Float[np.ndarray, "3 factors"]
    scale: float
    explained: float
    strength: float
    light: float

    @property
    def circle(self) -> Circle:
        """Its place and radius, mm."""
        return circle_of(self.parameters)

    @property
    def outline(self) -> Float[np.ndarray, "corners 2"]:
        """Polygon, mm."""
        angles = np.arange(CORNERS) * (2 * np.pi / CORNERS)
        count = len(self.parameters) - ROUND
        turns = HARMONICS[:count:2, None] * angles
        waves = np.stack([np.cos(turns), np.sin(turns)], axis=1).reshape(count, CORNERS)
        radius = np.exp(self.parameters[2] + self.parameters[ROUND:] @ waves)
        return self.parameters[:2] + radius[:, None] * np.stack(
            [np.cos(angles), np.sin(angles)], -1
        )


def circle_of(parameters: Parameters) -> Circle:
    """Place and radius, mm."""
    return np.array([*parameters[:2], math.exp(parameters[2])])


def start_at(circle: Circle) -> Parameters:
    """Parameters of a round contact of usual depth and shape."""
    return np.array([circle[0], circle[1], math.log(circle[2]), math.log(DEPTH), SHAPE])


def fit(
    change: Change, start: Parameters, others: Circles, lamps: Lamps, rounds: int = ROUNDS
) -> Fit | None:
    """Fit a contact; ``None`` where there is too little of it on the pad.

    Args:
        change: of the light of its pad.
        start: parameters near which it is; with harmonics where it need not be round.
        others: contacts near it, which are left out.
        lamps: that light the pad.
        rounds: most steps; without any only the factors are fitted.
    """
    count = len(start)
    circle = circle_of(start)
    samples = sample(change, circle, others)
    if len(samples.along) < FEWEST:
        return None
    problem = _Problem(change, samples, lamps, circle)
    shallow = float(np.abs(samples.slopes).max()) < STEEP
    point, damping, scale = np.clip(start, LEAST[:count], MOST[:count]), 1e-2, 1.0
    model = problem.model(point, None)
    solved = problem.solve(model, point, model.lit / samples.deviation**2)
    for _ in range(rounds):
        ratio = np.abs(solved.residual) / samples.deviation
        scale = max(1.0, NORMAL * float(np.median(ratio[model.lit > 0.5])))
        weights = (
            model.lit / (samples.deviation * scale) ** 2 / (1 + (ratio / (ROBUST * scale)) ** 2)
        )
        solved = problem.solve(model, point, weights)
        for _ in range(TRIALS):
            damped = solved.normal + damping * np.diag(np.diag(solved.normal))
            step = np.linalg.solve(damped, solved.slope)
            step = np.clip(step, -LONGEST[:count], LONGEST[:count])
            newer = np.clip(point + step, LEAST[:count], MOST[:count])
            tried_model = problem.model(newer, model.height if shallow else None)
            tried = problem.solve(tried_model, newer, weights)
            if tried.cost <= solved.cost:
                break
            damping *= 8
        else:
            break
        moved, damping = np.abs(newer - point), max(damping / 5, 1e-4)
        point, model, solved = newer, tried_model, tried
        if np.all(moved < SETTLED[:count]):
            break
    weights = model.lit / samples.deviation**2
    mean = np.sum(weights * samples.part, axis=0) / (np.sum(weights, axis=0) + 1e-12)
    total = float(np.sum(weights * (samples.part - mean) ** 2))
    rest = float(np.sum(weights * solved.residual**2))
    return Fit(
        point,
        np.linalg.inv(solved.normal),
        solved.factors,
        scale,
        1 - rest / total,
        math.sqrt(max(total - rest, 0)) / scale,
        problem.own_light(solved.factors),
    )


def sample(change: Change, circle: Circle, others: Circles) -> Samples:
    """What has changed about a circle, away from others and from the pad's edges."""
    cells = max(1, round(circle[2] / PER_RADIUS / CELL))
    along, across = circle[:2].tolist()
    size, reach = cells * CELL, REACH[0] * circle[2] + REACH[1]
    half = change.width / 2
    ranges = []
    for middle, count in zip((along, across + half), change.inner.shape, strict=True):
        first = min(max(0, int((middle - reach) / CELL)), count)
        blocks = max(0, min(count, int((middle + reach) / CELL) + 1) - first) // cells
        ranges.append((first, blocks))
    window = tuple(slice(first, first + blocks * cells) for first, blocks in ranges)
    u, v = np.meshgrid(
        *((first + (np.arange(blocks) + 0.5) * cells) * CELL for first, blocks in ranges),
        indexing="ij",
    )
    v = v - half
    own = np.hypot(u - along, v - across) < reach
    for other in others:
        own &= np.hypot(u - other[0], v - other[1]) > other[2] + APART
    if not own.any():
        nothing = np.zeros((0, 3))
        return Samples(u[own], v[own], nothing, nothing, nothing[:, :2], size, size)
    part, noisiness, slopes, inner = (
        block_means(one[window], cells)
        for one in (change.part, change.noisiness, change.slopes, change.inner.astype(np.float32))
    )
    own &= inner > 0.99
    deviation = np.hypot(change.noise(cells) * noisiness[own], FLOOR)
    blur = math.hypot(size, SPREAD * math.sqrt(change.pixels_at(along, across).prod()))
    return Samples(u[own], v[own], part[own], deviation, slopes[own], size, blur)


class Bulge(NamedTuple):
    """A membrane at places; arrays of the shape (sets of parameters, places).

    Attributes:
        height: mm.
        by_along: its slope along the pad.
        by_across: and across it.
        along: of the places from its middle, mm.
        across: likewise.
        away: likewise.
    """

    height: np.ndarray
    by_along: np.ndarray
    by_across: np.ndarray
    along: np.ndarray
    across: np.ndarray
    away: np.ndarray


def lift(
    parameters: Float[np.ndarray, "sets parameters"],
    samples: Samples,
    blur: float,
    start: Float[np.ndarray, " samples"] | None,
) -> Bulge:
    """Where the rays of samples meet a membrane, for parameters and others that are near them.

    Args:
        parameters: the first ones, and others.
        samples: about the contact.
        blur: means of the membrane over so much of its radius are taken.
        start: heights near which the rays meet it, where they are known.
    """
    height_table, slope_table = tables(blur)
    # Single precision is four times as fast.
    first, second = samples.slopes.T
    places = np.stack([samples.along, samples.across]).astype(np.float32)

    def at(sets: Float[np.ndarray, "sets parameters"], z: np.ndarray) -> Bulge:
        u, v, radius, depth, beta, *waves = sets.T[..., None].astype(np.float32)
        along, across = places[0] - u + first * z, places[1] - v + second * z
        away = np.sqrt(along * along + across * across) + 1e-6
        turn = 0.0
        if waves:
            cosine, sine = along / away, across / away
            turn = np.zeros_like(away)
            c, s, radius = cosine, sine, radius + turn
            for number, a, b in zip(HARMONICS[::2], waves[::2], waves[1::2], strict=False):
                c, s = c * cosine - s * sine, s * cosine + c * sine
                radius += a * c + b * s
                turn += number * (b * c - a * s)
        radius, depth = np.exp(radius), np.exp(depth)
        beyond = np.maximum(away - radius, 0) / FADE
        share, lifted = away / radius, depth * np.exp(-beyond * beyond)
        height = lifted * look_up(height_table, share, beta)
        slope = lifted / radius * look_up(slope_table, share, beta) - 2 / FADE * beyond * height
        slope = slope / away
        by_along, by_across = slope * (along + turn * across), slope * (across - turn * along)
        return Bulge(height, by_along, by_across, along, across, away)

    def nearer(z: np.ndarray, bulge: Bulge) -> np.ndarray:
        falls = 1 - first * bulge.by_along - second * bulge.by_across
        return z - (z - bulge.height) / np.clip(falls, 0.6, 3)

    if start is None:
        # From above, so that the first of several places is met.
        z = np.full((1, len(first)), 0.9 * math.exp(parameters[0, 3]), np.float32)
        for _ in range(RAY_STEPS):
            z = nearer(z, at(parameters[:1], z))
    else:
        z = start[None]
    z = np.broadcast_to(z, (len(parameters), len(first)))
    for _ in range(NEAR_STEPS):
        z = nearer(z, at(parameters, z))
    return at(parameters, z)


class _Model(NamedTuple):
    """Of a point and of points beside it; arrays of the shape (colors, points, samples, …).

    Attributes:
        terms: of the light, which the factors multiply.
        relit: by which part there is more light where rays meet the membrane.
        lit: how much samples count, shape (samples, colors).
        height: of the membrane at the point, mm.
    """

    terms: np.ndarray
    relit: np.ndarray
    lit: np.ndarray
    height: np.ndarray


class _Solved(NamedTuple):
    """Least squares about a point.

    Attributes:
        cost: weighted sum of squares.
        normal: matrix of the normal equations of the parameters.
        slope: their right-hand side.
        residual: shape (samples, colors).
        factors: of the light, shape (colors, factors).
    """

    cost: float
    normal: np.ndarray
    slope: np.ndarray
    residual: np.ndarray
    factors: np.ndarray


class _Problem:
    """Least squares of one contact's parameters."""

    def __init__(self, change: Change, samples: Samples, lamps: Lamps, circle: Circle) -> None:
        self._change, self._samples = change, samples
        colors = samples.part.shape[1]
        away = samples.along - samples.along.mean(), samples.across - samples.across.mean()
        background = np.stack([np.ones_like(away[0]), *away], axis=-1)
        self._background = np.broadcast_to(background, (colors, *background.shape))
        self._blur = round(min(samples.blur / circle[2], 1.0), 1)
        self._light = change.at(change.light, samples.along, samples.across)
        present = [lamp for lamp in lamps if lamp is not None]
        places = circle[:2], samples.along, samples.across
        self._pieces = [Pieces.of(lamp, *places) for lamp in present]
        self._toward = np.zeros((colors, 2))
        self._mean = np.zeros((colors, len(present) + 1))
        for color, lamp in enumerate(lamps):
            if lamp is not None:
                self._toward[color] = lamp.toward(circle[:2])
                self._mean[color, present.index(lamp)] = 1.0
        deviation = SHARES
        if not present:
            self._mean[:], deviation = EVEN, EVENS
        sure = np.full(len(present) + 1, deviation**-2)
        self._ridge = np.append(sure, np.full(3, FREE))
        self._pull = np.hstack([self._mean * sure, np.zeros((colors, 3))])

    def own_light(self, factors: np.ndarray) -> float:
        """The light of each color's own lamp, or even light, over what is expected: their mean."""
        count = self._mean.shape[1]
        return float(np.sum(factors[:, :count] * self._mean) / np.sum(self._mean))

    def model(self, point: Parameters, start: np.ndarray | None) -> _Model:
        """The light of samples at a point, and at one beside it for each parameter."""
        samples = self._samples
        beside = point + np.diag(STEPS[: len(point)])
        bulge = lift(np.vstack([point, beside]), samples, self._blur, start)
        upright = 1 / np.sqrt(1 + bulge.by_along**2 + bulge.by_across**2)
        even = (upright - 1) / 2
        if not self._pieces:
            terms = np.broadcast_to(even[..., None], (*self._background.shape[:1], *even.shape, 1))
            return _Model(
                terms, np.zeros(terms.shape[:-1]), np.ones_like(samples.part), bulge.height[0]
            )
        lean = -upright * bulge.by_along, -upright * bulge.by_across
        lights = [one.light(*lean, upright, bulge.height) - 1 for one in self._pieces]
        terms = np.stack([*lights, even], axis=-1)
        along, across = (
            place + slope * bulge.height
            for place, slope in zip(samples[:2], samples.slopes.T, strict=True)
        )
        relit = np.exp(self._change.at(self._change.light, along, across) - self._light)
        relit = np.moveaxis(relit, -1, 0)
        places = np.stack([bulge.along[0], bulge.across[0]], axis=-1)
        cosine = places @ self._toward.T / (bulge.away[0, :, None] + CORE)
        lit = np.clip((cosine - LIT) / DUSK, 0, 1) * self._toward.any(axis=1)
        return _Model(terms * relit[..., None], relit - 1, lit, bulge.height[0])

    def solve(self, model: _Model, point: Parameters, weights: np.ndarray) -> _Solved:
        """The factors at a point, and the normal equations of its parameters without them."""
        count, weight = model.terms.shape[-1], weights.T
        basis = np.concatenate([model.terms[:, 0], self._background], axis=-1)
        weighted = basis * weight[..., None]
        turned = np.swapaxes(weighted, 1, 2)
        inverse = np.linalg.inv(turned @ basis + np.diag(self._ridge))
        data = self._samples.part.T - model.relit[:, 0]
        factors = (inverse @ (turned @ data[..., None] + self._pull[..., None]))[..., 0]
        residual = data - (basis @ factors[..., None])[..., 0]
        by_terms = (model.terms[:, 1:] - model.terms[:, :1]) @ factors[:, None, :count, None]
        change = by_terms[..., 0] + model.relit[:, 1:] - model.relit[:, :1]
        jacobian = np.swapaxes(change / STEPS[: len(point), None], 1, 2)
        own = np.swapaxes(jacobian * weight[..., None], 1, 2)
        mixed = turned @ jacobian
        normal = own @ jacobian - np.swapaxes(mixed, 1, 2) @ inverse @ mixed
        # The factors are where their own slope is 0, so that it adds nothing.
        slope = np.sum(own @ residual[..., None], axis=0)[:, 0]
        sureness = SURENESS[: len(point)]
        short = EXPECTED[: len(point)] - point
        cost = np.sum(weight * residual**2) + np.sum(sureness * short**2)
        off = factors[:, :count] - self._mean
        cost += np.sum(self._ridge[:count] * off**2)
        return _Solved(
            float(cost),
            np.sum(normal, axis=0) + np.diag(sureness),
            slope + sureness * short,
            residual.T,
            factors,
        )
