"""Lines within a view along its sides: where a clear layer's wall begins to show the pad again.

Under a clear layer the pad is seen twice near a polished wall, and the outline is that of the
wall's image; where the pad itself ends there is a seam, darker or a step of light, about as long as
the side. The image does not show which of both is the pad's edge: that follows from a model of the
layers, which is given both. Even light leaves no seam.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from perception.lens import Lens, TangentPlane
from perception.sampling import sampled
from perception.sides import LEAST_CONTRAST, POINTS, SMALL, TRIMMED, Edges, Side, fit_lines

NEAREST, FURTHEST = 4, 44
"""Inner lines are looked for between so many px within a side (of 1080 rows the furthest)."""

ALIKE = 5
"""Places along a side of which the mean is taken, and over which light rises or falls, samples."""

DEEPEST = 0.4
"""Part of the way to the opposite side."""

WITHIN, SHARE, UNSURE = 1.5, 0.6, 2.0
"""At least this share of a side's places has its steepest step so near to the line, px, and its
ends are as sure as that."""


@dataclass(frozen=True)
class InnerLine:
    """A line along a side of a view, within it.

    Attributes:
        ends: column and row of where it begins and ends beside the side's ends, clockwise.
        variance: of these across the line, px².
        step: of light from inside outward, in codes; negative where it becomes darker.
        share: of the side along which it is seen.
    """

    ends: Float[np.ndarray, "2 2"]
    variance: Float[np.ndarray, "2"]
    step: float
    share: float


NONE: tuple[InnerLine | None, ...] = (None, None, None, None)
"""Of a view without any."""


def find_inner_lines(
    gray: Float[np.ndarray, "rows columns"], lens: Lens, plane: TangentPlane, sides: list[Side]
) -> tuple[InnerLine | None, ...]:
    """The line within each side; ``None`` where there is none.

    Args:
        gray: light, float32.
        lens: of the camera.
        plane: in which the sides are straight.
        sides: where they were found.
    """
    shares = np.linspace(TRIMMED, 1 - TRIMMED, POINTS)
    flat = np.concatenate([side.places(shares) for side in sides])
    outward = np.repeat([side.outward for side in sides], POINTS, axis=0)
    both = lens.project(plane.rays(np.concatenate([flat, flat + SMALL * outward])))
    at, beside = both[: len(flat)], both[len(flat) :]
    scale = np.maximum(np.hypot(*(beside - at).T) / SMALL, 1e-9)
    normal = (beside - at) / (SMALL * scale[:, None])
    furthest = max(FURTHEST * lens.shape[0] / 1080, 3.0 * NEAREST)
    depth = np.arange(NEAREST, furthest)
    light = lens.codes(sampled(gray, at[:, None] - depth[:, None] * normal[:, None]))
    shape = (len(sides), POINTS)
    smooth = np.stack([cv2.blur(one, (1, ALIKE)) for one in light.reshape(*shape, -1)])
    # Light two px further out less that two px further in.
    rise = smooth[..., :-4] - smooth[..., 4:]
    steepest = np.argmax(np.abs(rise), axis=-1)
    step = np.take_along_axis(rise, steepest[..., None], axis=-1)[..., 0]
    ones, scales = np.ones(len(sides)), scale.reshape(shape)
    offsets = -(NEAREST + 2.0 + steepest)
    middles = [side.places(np.array([0.5]))[0] for side in sides]
    across = [np.hypot(*(middles[i] - middles[i - 2])) for i in range(len(sides))]
    # Further in, it may be the other side.
    near = -offsets < DEEPEST * np.array(across)[:, None] * scales
    found = near & (np.abs(step) >= LEAST_CONTRAST)
    lines = fit_lines(
        Edges(shares, offsets / scales, scales, found, ones, ones, ones, np.zeros(len(sides)))
    )
    inner: list[InnerLine | None] = []
    for i, (side, line) in enumerate(zip(sides, lines, strict=True)):
        off = offsets[i] - line.at(shares) * scales[i]
        there = found[i] & (np.abs(off) < WITHIN)
        variance = np.array([line.variance(0.0), line.variance(1.0)]) * np.mean(scales[i]) ** 2
        if there.mean() < SHARE or variance.max() > UNSURE**2:
            inner.append(None)
            continue
        ends = [side.start + line.at(0.0) * side.outward, side.end + line.at(1.0) * side.outward]
        places = lens.project(plane.rays(np.stack(ends)))
        inner.append(
            InnerLine(places, variance, float(np.median(step[i][there])), float(there.mean()))
        )
    return tuple(inner)
