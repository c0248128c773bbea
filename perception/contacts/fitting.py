"""A contact's place and size by least squares: a bulge, and how it is lit.

The membrane is lifted as `perception.contacts.membranes` has it: five unknowns. What is seen at a
place of the flat pad is the membrane where the ray first meets it. There a matt membrane that leans
by the unit normal n, lit from low over the pad, sends

    1 + κ n·e + μ n·e⊥ + λ (1 − n_z) + ν z

times the light of the flat one, where e points along the pad towards the lamp of a color; under
light that comes evenly from all sides it is (1 + n_z) / 2, so that only the third term is left. The
factors are linear unknowns of each color, beside a background that varies linearly; they are
eliminated (G. Golub, V. Pereyra, Inverse Problems 19 (2003) R1), and the rest is found by damped
Gauss-Newton steps, with weights that leave out what fits badly. Behind a bulge lies its shadow: of
each color the side away from its lamp does not count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from perception.contacts.change import CELL, NORMAL, Change, block_means
from perception.contacts.membranes import FADE, FLATTEST, look_up, tables

PER_RADIUS = 5
"""Samples along the radius that is expected."""

REACH = 1.3, 0.8
"""Samples lie within so many radii and so many mm more,"""

APART = 0.5
"""and so far from other contacts, mm."""

ROUNDS, TRIALS = 14, 4
"""Steps of a fit, and how often each is shortened."""

RAY_STEPS = 4
"""Steps along every ray to the membrane."""

FLOOR = 0.005
"""The model of the light is no better than that, part of the light."""

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

EVEN, EVENS = -0.5, 0.15
"""λ under even light, and its deviation: it is never quite even."""

FREE = 1e-3
"""Of factors of which nothing is known, what keeps them finite."""

LEAST = np.array([-np.inf, -np.inf, math.log(0.4), math.log(0.05), 0.0])
MOST = np.array([np.inf, np.inf, math.log(6.0), math.log(2.5), FLATTEST])
"""Of a place (mm), the logarithms of radius and depth (mm), and β."""

LONGEST = np.array([0.4, 0.4, 0.25, 0.5, 0.25])
SETTLED = np.array([0.005, 0.005, 0.003, 0.02, 0.01])
"""No step goes farther; and steps so small end a fit."""

STEPS = np.array([0.01, 0.01, 0.01, 0.02, 0.02])
"""For derivatives."""

EXPECTED = np.array([0, 0, 0, math.log(DEPTH), SHAPE])
SURENESS = np.array([0, 0, 0, DEPTHS**-2, SHAPES**-2])

Parameters = Float[np.ndarray, "5"]
Circle = Float[np.ndarray, "3"]
Circles = Float[np.ndarray, "_ 3"]
Toward = Float[np.ndarray, "3 2"]


class Samples(NamedTuple):
    """Means over squares about a contact; arrays over samples.

    Attributes:
        along: places along the pad, mm.
        across: across it from its middle, mm.
        part: by which the light has changed, of each color.
        deviation: of that.
        slopes: of the rays.
        size: of the squares, mm.
    """

    along: Float[np.ndarray, " samples"]
    across: Float[np.ndarray, " samples"]
    part: Float[np.ndarray, "samples 3"]
    deviation: Float[np.ndarray, "samples 3"]
    slopes: Float[np.ndarray, "samples 2"]
    size: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted contact.

    Attributes:
        parameters: place along and across, logarithms of radius and depth, β.
        covariance: of these.
        factors: of the light, of each color.
        scale: residuals over what noise alone would leave, at least 1.
        explained: part of the change about it that the model explains.
        strength: root of the squares that it explains, over noise.
    """

    parameters: Parameters
    covariance: Float[np.ndarray, "5 5"]
    factors: Float[np.ndarray, "3 factors"]
    scale: float
    explained: float
    strength: float

    @property
    def circle(self) -> Circle:
        """Its place and radius, mm."""
        return np.array([*self.parameters[:2], math.exp(self.parameters[2])])


def start_at(circle: Circle) -> Parameters:
    """Parameters of a contact of usual depth and shape."""
    return np.array([circle[0], circle[1], math.log(circle[2]), math.log(DEPTH), SHAPE])


def fit(change: Change, start: Parameters, others: Circles, toward: Toward) -> Fit | None:
    """Fit a contact; ``None`` where there is too little of it on the pad.

    Args:
        change: of the light of its pad.
        start: parameters near which it is.
        others: contacts near it, which are left out.
        toward: directions to the lamp of each color; zeros for even light.
    """
    circle = np.array([*start[:2], math.exp(start[2])])
    samples = sample(change, circle, others)
    if len(samples.along) < 2 * start.size * len(toward):
        return None
    problem = _Problem(change, samples, toward, circle[2])
    point, damping, scale = np.clip(start, LEAST, MOST), 1e-2, 1.0
    model = problem.model(point)
    solved = problem.solve(model, point, model.lit / samples.deviation**2)
    for _ in range(ROUNDS):
        ratio = np.abs(solved.residual) / samples.deviation
        scale = max(1.0, NORMAL * float(np.median(ratio[model.lit > 0.5])))
        weights = model.lit / (samples.deviation * scale) ** 2 / (1 + (ratio / (ROBUST * scale)) ** 2)
        solved = problem.solve(model, point, weights)
        for _ in range(TRIALS):
            damped = solved.normal + damping * np.diag(np.diag(solved.normal))
            step = np.clip(np.linalg.solve(damped, solved.slope), -LONGEST, LONGEST)
            newer = np.clip(point + step, LEAST, MOST)
            tried_model = problem.model(newer)
            tried = problem.solve(tried_model, newer, weights)
            if tried.cost <= solved.cost:
                break
            damping *= 8
        else:
            break
        moved, damping = np.abs(newer - point), max(damping / 5, 1e-4)
        point, model, solved = newer, tried_model, tried
        if np.all(moved < SETTLED):
            break
    weights = model.lit / samples.deviation**2
    mean = np.sum(weights * samples.part, axis=0) / np.sum(weights, axis=0)
    total = float(np.sum(weights * (samples.part - mean) ** 2))
    rest = float(np.sum(weights * solved.residual**2))
    return Fit(
        point,
        np.linalg.inv(solved.normal),
        solved.factors,
        scale,
        1 - rest / total,
        math.sqrt(max(total - rest, 0)) / scale,
    )


def sample(change: Change, circle: Circle, others: Circles) -> Samples:
    """What has changed about a circle, away from others and from the pad's edges."""
    cells = max(1, round(circle[2] / PER_RADIUS / CELL))
    reach = REACH[0] * circle[2] + REACH[1]
    half = change.width / 2
    ranges = []
    for middle, count in zip(circle[:2] + [0, half], change.inner.shape, strict=True):
        first = min(max(0, int((middle - reach) / CELL)), count)
        blocks = max(0, min(count, int((middle + reach) / CELL) + 1) - first) // cells
        ranges.append((first, blocks))
    window = tuple(slice(first, first + blocks * cells) for first, blocks in ranges)
    u, v = np.meshgrid(
        *((first + (np.arange(blocks) + 0.5) * cells) * CELL for first, blocks in ranges),
        indexing="ij",
    )
    v = v - half
    own = np.hypot(u - circle[0], v - circle[1]) < reach
    for other in others:
        own &= np.hypot(u - other[0], v - other[1]) > other[2] + APART
    if not own.any():
        nothing = np.zeros((0, 3))
        return Samples(u[own], v[own], nothing, nothing, nothing[:, :2], cells * CELL)
    part, noisiness, slopes, inner = (
        block_means(one[window], cells)
        for one in (change.part, change.noisiness, change.slopes, change.inner.astype(np.float32))
    )
    own &= inner > 0.99
    deviation = np.hypot(change.noise(cells) * noisiness[own], FLOOR)
    return Samples(u[own], v[own], part[own], deviation, slopes[own], cells * CELL)


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


def lift(parameters: Float[np.ndarray, "sets 5"], samples: Samples, blur: float) -> Bulge:
    """Where the rays of samples meet a membrane, for parameters and others that are near them."""
    height_table, slope_table = tables(blur)
    first, second = samples.slopes.T

    def at(sets: Float[np.ndarray, "sets 5"], z: np.ndarray) -> Bulge:
        u, v, radius, depth, beta = sets.T[..., None]
        radius, depth = np.exp(radius), np.exp(depth)
        along, across = samples.along - u + first * z, samples.across - v + second * z
        away = np.sqrt(along * along + across * across) + 1e-6
        share, beyond = away / radius, np.maximum(away - radius, 0) / FADE
        lifted = depth * np.exp(-beyond * beyond)
        height = lifted * look_up(height_table, share, beta)
        slope = lifted / radius * look_up(slope_table, share, beta) - 2 / FADE * beyond * height
        slope = slope / away
        return Bulge(height, slope * along, slope * across, along, across, away)

    def nearer(z: np.ndarray, bulge: Bulge) -> np.ndarray:
        falls = 1 - first * bulge.by_along - second * bulge.by_across
        return z - (z - bulge.height) / np.clip(falls, 0.6, 3)

    # From above, so that the first of several places is met.
    z = np.full((1, len(first)), 0.9 * math.exp(parameters[0, 3]))
    for _ in range(RAY_STEPS):
        z = nearer(z, at(parameters[:1], z))
    z = nearer(np.broadcast_to(z, (len(parameters), len(first))), at(parameters, z))
    return at(parameters, z)


class _Model(NamedTuple):
    """Of a point and of points beside it; arrays of the shape (colors, points, samples, …).

    Attributes:
        terms: of the light, which the factors multiply.
        relit: by which part there is more light where rays meet the membrane.
        lit: how much samples count, shape (samples, colors).
    """

    terms: np.ndarray
    relit: np.ndarray
    lit: np.ndarray


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

    def __init__(self, change: Change, samples: Samples, toward: Toward, radius: float) -> None:
        self._change, self._samples, self._toward = change, samples, toward
        self._even = not toward.any()
        away = samples.along - samples.along.mean(), samples.across - samples.across.mean()
        background = np.stack([np.ones_like(away[0]), *away], axis=-1)
        self._background = np.broadcast_to(background, (len(toward), *background.shape))
        self._blur = round(samples.size / radius, 1)
        self._light = change.at(change.light, samples.along, samples.across)
        self._ridge = np.full(7, FREE)
        self._pull = np.zeros_like(self._ridge)
        if self._even:
            self._ridge = np.array([EVENS**-2, *np.zeros(3)]) + FREE
            self._pull = np.array([EVEN * EVENS**-2, *np.zeros(3)])

    def model(self, point: Parameters) -> _Model:
        """The light of samples at a point, and at one beside it for each parameter."""
        samples, toward = self._samples, self._toward
        bulge = lift(np.vstack([point, point + np.diag(STEPS)]), samples, self._blur)
        upright = 1 / np.sqrt(1 + bulge.by_along**2 + bulge.by_across**2)
        if self._even:
            terms = np.broadcast_to((1 - upright)[..., None], (3, *upright.shape, 1))
            return _Model(terms, np.zeros(terms.shape[:-1]), np.ones_like(samples.part))
        lean = -upright * np.stack([bulge.by_along, bulge.by_across])
        ahead = np.tensordot(toward, lean, 1)
        aside = np.tensordot(np.column_stack([-toward[:, 1], toward[:, 0]]), lean, 1)
        both = (np.broadcast_to(one, ahead.shape) for one in (1 - upright, bulge.height))
        along, across = (
            place + slope * bulge.height
            for place, slope in zip(samples[:2], samples.slopes.T, strict=True)
        )
        relit = np.exp(self._change.at(self._change.light, along, across) - self._light)
        relit = np.moveaxis(relit, -1, 0)
        terms = np.stack([ahead, aside, *both], axis=-1) * relit[..., None]
        cosine = (np.stack([bulge.along[0], bulge.across[0]], -1) @ toward.T) / (
            bulge.away[0, :, None] + CORE
        )
        return _Model(terms, relit - 1, np.clip((cosine - LIT) / DUSK, 0, 1))

    def solve(self, model: _Model, point: Parameters, weights: np.ndarray) -> _Solved:
        """The factors at a point, and the normal equations of its parameters without them."""
        count, weight = model.terms.shape[-1], weights.T
        basis = np.concatenate([model.terms[:, 0], self._background], axis=-1)
        weighted = basis * weight[..., None]
        turned = np.swapaxes(weighted, 1, 2)
        inverse = np.linalg.inv(turned @ basis + np.diag(self._ridge))
        data = self._samples.part.T - model.relit[:, 0]
        factors = (inverse @ (turned @ data[..., None] + self._pull[:, None]))[..., 0]
        residual = data - (basis @ factors[..., None])[..., 0]
        by_terms = (model.terms[:, 1:] - model.terms[:, :1]) @ factors[:, None, :count, None]
        change = by_terms[..., 0] + model.relit[:, 1:] - model.relit[:, :1]
        jacobian = np.swapaxes(change / STEPS[:, None], 1, 2)
        own = np.swapaxes(jacobian * weight[..., None], 1, 2)
        mixed = turned @ jacobian
        normal = own @ jacobian - np.swapaxes(mixed, 1, 2) @ inverse @ mixed
        # The factors are where their own slope is 0, so that it adds nothing.
        slope = np.sum(own @ residual[..., None], axis=0)[:, 0]
        off = EXPECTED - point
        cost = np.sum(weight * residual**2) + np.sum(SURENESS * off**2)
        if self._even:
            cost += np.sum((factors[:, 0] - EVEN) ** 2) / EVENS**2
        return _Solved(
            float(cost),
            np.sum(normal, axis=0) + np.diag(SURENESS),
            slope + SURENESS * off,
            residual.T,
            factors,
        )
