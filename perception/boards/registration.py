"""Points of a board placed in an image by fitting what is printed about them to the pixels.

Every pixel of a window is predicted: what is printed there, imaged by the local map and blurred by
lens and pixel. All lines and modules of markers in the window then place the point together, and
none of them draws it aside. Light may change over the window. Blur and tone curve are those of all
points: at the corner of a marker alone, a bent tone curve looks like a shift.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from perception.boards.appearance import BENDS, BLURS, Appearance, Look, predict
from perception.boards.local_maps import LocalMaps, Places
from perception.boards.pattern import Pattern

REACH = 0.35
"""Pixels count by a Gaussian of this standard deviation about the point, squares."""

PLANE, SHADE, WIDER = slice(0, 3), 3, 6
SHIFT, STRETCH, BENT = slice(7, 9), slice(9, 13), 13
"""Which terms of a fit are what; the bend is the last, so that it can be left out."""

LARGEST_SHIFT, LARGEST_STRETCH = 2.0, 0.05
"""What a step may do at most: px, and px per px."""

RIDGE = 1e-6
"""Added to normal equations whose diagonal is 1: about what rounding makes of 0."""

ALIKE, SURE = 0.8, 0.05
"""Least likeness of points from which the look is learnt, and how sure of it one can be at most."""

FREEDOM = 10
"""Weighted pixels that the terms of a fit take from the noise, about."""


class Fit(NamedTuple):
    """What is found of points.

    Attributes:
        maps: as they fit the image.
        places: column and row, px.
        likeness: share of the light's variance about a point that the print explains.
        errors: standard deviation of either coordinate that is due to noise, px.
        shifts: length of the last step, px.
        look: of all points.
    """

    maps: LocalMaps
    places: Places
    likeness: Float[np.ndarray, " maps"]
    errors: Float[np.ndarray, " maps"]
    shifts: Float[np.ndarray, " maps"]
    look: Look


def register(
    image: Float[np.ndarray, "rows columns"],
    pattern: Pattern,
    maps: LocalMaps,
    points: Places,
    look: Look,
    *,
    start: Places,
    half: int,
    steps: int,
    learn_tone: bool,
) -> Fit:
    """Points of a board where they are imaged, by Gauss-Newton steps from maps near the truth.

    Args:
        image: brightness, 0 to 255.
        pattern: of the board.
        maps: about each point.
        points: their places on the board, mm.
        look: to begin with; its blur is always learnt.
        start: where these maps image the points.
        half: from the middle of the windows to their ends, px.
        steps: how many, at least one.
        learn_tone: whether to learn the look's swell, for which white must be in sight on both
            sides of something black.
    """
    windows, fit = _Windows.of(image, start, half), None
    for _ in range(steps):
        fit = windows.step(pattern, maps, points, start, look, learn_tone)
        maps, start, look = fit.maps, fit.places, fit.look
    assert fit is not None
    return fit


class _Windows(NamedTuple):
    """Windows of an image.

    Attributes:
        middles: whole pixels.
        light: brightness.
        inside: which pixels are in the image.
    """

    middles: Places
    light: Float[np.ndarray, "maps pixels pixels"]
    inside: Bool[np.ndarray, "maps pixels pixels"]

    @classmethod
    def of(cls, image: Float[np.ndarray, "rows columns"], places: Places, half: int) -> _Windows:
        middles, line = np.round(places), np.arange(-half, half + 1)
        columns, rows = (middles.astype(int)[:, part, None] + line for part in range(2))
        height, width = image.shape
        within = (rows >= 0) & (rows < height), (columns >= 0) & (columns < width)
        rows, columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
        light = image[rows[:, :, None], columns[:, None]]
        return cls(middles, light, within[0][:, :, None] & within[1][:, None])

    def step(
        self,
        pattern: Pattern,
        maps: LocalMaps,
        points: Places,
        places: Places,
        look: Look,
        learn_tone: bool,
    ) -> Fit:
        half = self.light.shape[1] // 2
        seen = predict(pattern, maps, self.middles, look, half)
        line = np.arange(-half, half + 1) - (places - self.middles)[..., None]
        x, y = np.broadcast_arrays(line[:, 0, None], line[:, 1, :, None])
        x, y = x.astype(np.float32), y.astype(np.float32)
        weights = self._weights(pattern, maps.slopes(places).astype(np.float32), points, x, y)
        blur = look.width**2 / look.power / half
        system = _System.of(self.light, weights, seen, x / half, y / half, blur)
        whole = system.solved(PLANE.stop).left
        free = system.solved(BENT + 1)
        alike = free.left < (1 - ALIKE) * whole
        variance = look.blur**2 + 2 * free.shared(WIDER, alike)
        learnt = look._replace(blur=float(np.sqrt(np.clip(variance, *np.square(BLURS)))))
        bend = look.bend
        if learn_tone:
            bend = float(np.clip(bend + free.shared(BENT, alike), *BENDS))
            learnt = learnt._replace(swell=bend * look.width)
        found = system.solved(BENT, free.contrast * (bend - look.bend))
        shift = np.clip(found.terms[:, SHIFT], -LARGEST_SHIFT, LARGEST_SHIFT)
        stretch = found.terms[:, STRETCH].reshape(-1, 2, 2) / half
        stretch = np.clip(stretch, -LARGEST_STRETCH, LARGEST_STRETCH)
        warps = np.tile(np.eye(3), (len(points), 1, 1))
        warps[:, :2, :2] += stretch
        warps[:, :2, 2] = shift - (stretch @ places[..., None])[..., 0]
        moved = maps.warped(warps)
        return Fit(
            moved,
            moved.places_of(points, places),
            (whole - found.left) / np.maximum(whole, system.weight + 1),
            np.sqrt(found.variances[:, SHIFT].mean(axis=1)),
            np.hypot(*shift.T),
            learnt,
        )

    def _weights(
        self, pattern: Pattern, slopes: np.ndarray, points: Places, x: np.ndarray, y: np.ndarray
    ) -> Float[np.ndarray, "maps pixels pixels"]:
        """How much pixels count: less far from the point, and nothing beyond the board's margin."""
        counted, squared = self.inside, np.float32(0)
        for part, end in enumerate(pattern.size):
            away = slopes[:, part, 0, None, None] * x + slopes[:, part, 1, None, None] * y
            squared = squared + away**2
            begin = points[:, part, None, None].astype(np.float32)
            counted = counted & (away > -pattern.margin - begin)
            counted = counted & (away < end + pattern.margin - begin)
        return counted * np.exp(squared * np.float32(-0.5 / (REACH * pattern.square) ** 2))


class _Found(NamedTuple):
    """A solution.

    Attributes:
        contrast: of black and white.
        terms: relative to the contrast.
        variances: of the terms.
        left: sum of weighted squares that is not explained.
    """

    contrast: Float[np.ndarray, " maps"]
    terms: Float[np.ndarray, "maps terms"]
    variances: Float[np.ndarray, "maps terms"]
    left: Float[np.ndarray, " maps"]

    def shared(self, term: int, alike: Bool[np.ndarray, " maps"]) -> float:
        """The mean of a term over all points that are alike, and one more of which it is 0."""
        weights = alike / (self.variances[:, term] + SURE**2)
        return float(weights @ self.terms[:, term] / (weights.sum() + 1 / SURE**2))


class _System(NamedTuple):
    """Normal equations of each window.

    Attributes:
        normal: matrices, of terms that are scaled to a diagonal of 1.
        side: right sides.
        noise: covariance of the right sides where every pixel has a variance of 1.
        scale: of the terms.
        total: sum of weighted squares of the light about its mean.
        weight: sum of weights.
    """

    normal: Float[np.ndarray, "maps terms terms"]
    side: Float[np.ndarray, "maps terms"]
    noise: Float[np.ndarray, "maps terms terms"]
    scale: Float[np.ndarray, "maps terms"]
    total: Float[np.ndarray, " maps"]
    weight: Float[np.ndarray, " maps"]

    @classmethod
    def of(
        cls,
        light: np.ndarray,
        weights: np.ndarray,
        seen: Appearance,
        x: np.ndarray,
        y: np.ndarray,
        blur: float,
    ) -> _System:
        n, shade, right, down = len(light), seen.shade, seen.right, seen.down
        # Uneven light falls on the print, and both are blurred together: of x s, a Gaussian of the
        # variance σ² makes x s + σ² ds/dx. Without the second term edges move to the darker side.
        lit = shade * x + blur * right, shade * y + blur * down
        light_terms = (np.ones_like(x), x, y, shade, *lit, seen.wider)
        moves = (right, down, right * x, right * y, down * x, down * y)
        terms = np.stack((*light_terms, *moves, seen.bent), axis=1).reshape(n, BENT + 1, -1)
        weights, light = weights.reshape(n, 1, -1), light.reshape(n, -1, 1)
        count = weights.sum(axis=2)
        light = light - (weights @ light) / np.maximum(count, 1e-6)[..., None]
        scale = 1 / np.sqrt(np.maximum((terms * terms * weights).sum(axis=2), 1e-6))
        terms *= scale[..., None]
        weighted = terms * weights
        return cls(
            (weighted @ terms.swapaxes(1, 2)).astype(float) + RIDGE * np.eye(BENT + 1),
            (weighted @ light)[..., 0].astype(float),
            (weighted @ weighted.swapaxes(1, 2)).astype(float),
            scale.astype(float),
            (weights @ light**2)[:, 0, 0].astype(float),
            count[:, 0].astype(float),
        )

    def solved(self, count: int, bent: Float[np.ndarray, " maps"] | None = None) -> _Found:
        """The solution with the first terms alone.

        Args:
            count: of terms.
            bent: the value of the term after these, 0 by default.
        """
        side, total = self.side[:, :count], self.total
        if bent is not None:
            bent = bent / self.scale[:, count]
            total = total - bent * (2 * self.side[:, count] - bent * self.normal[:, count, count])
            side = side - bent[:, None] * self.normal[:, :count, count]
        inverse = np.linalg.inv(self.normal[:, :count, :count])
        found = (inverse @ side[..., None])[..., 0]
        left = np.maximum(total - (found * side).sum(axis=1), 0)
        scale = self.scale[:, :count]
        contrast = found[:, SHADE] * scale[:, SHADE] if count > SHADE else np.ones(len(found))
        contrast = np.where(np.abs(contrast) < 1, 1.0, contrast)
        spread = ((inverse @ self.noise[:, :count, :count]) * inverse).sum(axis=2)
        noise = left / np.maximum(self.weight - FREEDOM, 1)
        relative = scale / contrast[:, None]
        variances = np.maximum(spread, 0) * noise[:, None] * relative**2
        return _Found(contrast, found * relative, variances, left)
