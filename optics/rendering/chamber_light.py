"""Light of a lamp at the lens on the chamber's wall, and what the wall's gloss makes of it.

Walls are matt and light each other. In the straight finger the wall is a stack of coaxial rings,
between which view factors are differences of those of discs, so that the light is one linear
system for each color. What the lamp itself sends falls with the square of the distance and the
cosines at lamp and wall, in the bent finger, too: the lamp is where the camera is, so that no wall
it sees is in the shade. What walls send each other stays that of the straight finger.

Under a clear coat, walls reflect: the lamp where they face it (Beckmann's distribution of
slopes), and each other at the angle of reflection, by Fresnel's equations. Mirror images of mirror
images are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from optics.chamber.endoscope import Endoscope
from optics.chamber.rings import Rings
from optics.rendering.chamber_effects import ChamberEffects

COAT = 1.41
"""Refractive index of silicone."""

PLATE = 0.05
"""Part of the light that what is beside the lens reflects."""

COARSE = 8
"""Mirror images are followed in every so many pixels: roughness blurs them."""

NARROWEST = 0.02
"""Least roughness, at which a highlight is as wide as the lamps around the lens."""


@dataclass(frozen=True)
class WallLight:
    """Light on the walls of a straight finger: on what each ring ends, and at last on the top.

    Its unit is the brightest color of the light on the wall at B, where red meets blue.

    Attributes:
        direct: irradiance by the lamp.
        mutual: irradiance in red, green and blue by the other walls.
        lamp: of the lamp: its irradiance on what faces it 1 mm ahead of it.
    """

    direct: Float[np.ndarray, " walls"]
    mutual: Float[np.ndarray, "walls 3"]
    lamp: float

    @property
    def total(self) -> Float[np.ndarray, "walls 3"]:
        """Of lamp and walls."""
        return self.direct[:, None] + self.mutual


def exchange_of_discs(
    first: Float[np.ndarray, "#n #m"],
    second: Float[np.ndarray, "#n #m"],
    apart: Float[np.ndarray, "#n #m"],
) -> Float[np.ndarray, "n m"]:
    """Area times view factor from one coaxial disc to another one, mm².

    Source: J. R. Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-41.

    Args:
        first: radii, mm.
        second: radii of the other discs, mm.
        apart: distances, mm; at none the exchange is the lesser disc's area.

    Example:
        >>> one = np.ones((1, 1))
        >>> round(float(exchange_of_discs(one, one, one)[0, 0]) / np.pi, 3)
        0.382
    """
    squares = first**2 + second**2 + apart**2
    root = np.sqrt(np.maximum(squares**2 - 4 * (first * second) ** 2, 0))
    # Half of squares − root, without cancelling.
    return 2 * np.pi * (first * second) ** 2 / (squares + root)


def compute_wall_light(rings: Rings, colors: Float[np.ndarray, "walls 3"]) -> WallLight:
    """The light of a lamp at the lens, whose brightness is even, in the straight finger.

    Args:
        rings: of the straight finger.
        colors: reflected by what each ring ends, and at last by the top.

    Example:
        >>> from optics import Chamber
        >>> chamber = Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84)
        >>> light = compute_wall_light(Rings.of(chamber), np.full((61, 3), 0.5))
        >>> float(light.direct[-2] / light.direct[-1]) < 0.2  # the top faces the lamp
        True
    """
    depth = np.append(0.0, np.asarray(rings.arc, float) + float(rings.pinhole_offset))
    radius = np.asarray(rings.radius, float)
    radius = np.append(radius[0], radius)
    slope = np.diff(radius) / np.diff(depth)
    middle, wide = (depth[1:] + depth[:-1]) / 2, (radius[1:] + radius[:-1]) / 2
    away = np.hypot(middle, wide)
    facing = (wide - slope * middle) / np.sqrt(1 + slope**2)
    direct = np.append(middle * facing / away**4, 1 / depth[-1] ** 2)

    discs = exchange_of_discs(radius[:, None], radius[None], np.abs(depth[:, None] - depth))
    walls = len(middle)
    # From rings to discs beyond them, from which those between two such discs follow.
    onward = np.abs(np.diff(discs, axis=0))
    between = np.abs(np.diff(onward, axis=1))
    areas = 2 * np.pi * wide * np.diff(depth) * np.sqrt(1 + slope**2)
    ends = np.pi * radius**2
    own = np.arange(walls)
    between[own, own] = areas - ends[1:] - ends[:-1] + 2 * discs[own, own + 1]
    exchange = np.zeros((walls + 2, walls + 2))  # rings, top, plate
    exchange[:walls, :walls] = between
    for number, disc in ((walls, walls), (walls + 1, 0)):
        exchange[number, :walls] = exchange[:walls, number] = onward[:, disc]
    exchange[walls, walls + 1] = exchange[walls + 1, walls] = discs[0, -1]
    factors = exchange / np.concatenate([areas, ends[[-1, 0]]])[:, None]
    sent = np.append(direct, 0.0)
    mutual = np.empty((walls + 1, 3))
    for i in range(3):
        reflected = np.append(colors[:, i], PLATE)
        total = np.linalg.solve(np.eye(len(sent)) - factors * reflected, sent)
        mutual[:, i] = (total - sent)[:-1]
    unit = direct[rings.ends[0]] + mutual[rings.ends[0]].max()
    return WallLight(direct / unit, mutual / unit, 1 / unit)


def reflectance(cosine: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Part of unpolarised light that a clear coat in air reflects (Fresnel's equations).

    Example:
        >>> [round(float(part), 3) for part in reflectance(np.array([0.0, 1.0]))]
        [1.0, 0.029]
    """
    inside = np.sqrt(COAT**2 - 1 + cosine**2)
    across = (cosine - inside) / (cosine + inside)
    along = (COAT**2 * cosine - inside) / (COAT**2 * cosine + inside)
    return (across**2 + along**2) / 2


def slopes_of_pixels(endoscope: Endoscope, step: int = 1) -> Float[np.ndarray, "rows columns 2"]:
    """Rays (x, y, 1) that are imaged at every so many pixels: `Endoscope.image` the other way."""
    y, x = np.mgrid[: endoscope.rows : step, : endoscope.columns : step].astype(float)
    (column, row), focal = endoscope.center, float(endoscope.focal_px)
    x, y = (x - column) / focal, (y - row) / focal
    imaged, k1 = np.hypot(x, y), float(endoscope.distortion)
    slope = imaged
    for _ in range(8):
        slope = slope - (slope * (1 + k1 * slope**2) - imaged) / (1 + 3 * k1 * slope**2)
    scale = np.where(imaged > 0, slope / np.where(imaged > 0, imaged, 1), 1)
    roll, (right, below) = float(endoscope.roll), np.asarray(endoscope.pointing, float)
    cosine, sine = scale * np.cos(roll), scale * np.sin(roll)
    x, y = x * cosine - y * sine, x * sine + y * cosine
    down, depth = y * np.cos(below) + np.sin(below), np.cos(below) - y * np.sin(below)
    x, depth = x * np.cos(right) + depth * np.sin(right), depth * np.cos(right) - x * np.sin(right)
    return np.stack([x / depth, down / depth], axis=-1)


class Met(NamedTuple):
    """Where rays from the lens meet the wall, in the plane of bending: across, beside, along.

    Attributes:
        place: mm from the pinhole.
        normal: into the chamber.
        cosine: of the angle between ray and normal.
    """

    place: Float[np.ndarray, "*n 3"]
    normal: Float[np.ndarray, "*n 3"]
    cosine: Float[np.ndarray, "*n"]


class BentWall:
    """The rings of one posture as planes, without what presses them."""

    def __init__(self, rings: Rings, bend: float, direction: float) -> None:
        arc, length = np.asarray(rings.arc, float), float(rings.length)
        curvature = bend / length
        turned = curvature * arc
        half = np.sinc(turned / (2 * np.pi))
        self.center = np.stack(
            [
                arc * turned / 2 * half**2,
                np.zeros_like(arc),
                arc * np.sinc(turned / np.pi) + float(rings.pinhole_offset),
            ],
            axis=-1,
        )
        self.tangent = np.stack([np.sin(turned), np.zeros_like(arc), np.cos(turned)], axis=-1)
        self.radius = np.asarray(rings.radius, float)
        slope = np.diff(self.radius) / np.diff(arc)
        self.slope = np.append(slope[0], slope)
        self.turn = np.array(
            [[np.cos(direction), -np.sin(direction)], [np.sin(direction), np.cos(direction)]]
        )

    def meet(self, slopes: Float[np.ndarray, "*n 2"], wall: Int[np.ndarray, "*n"]) -> Met:
        """Where rays (x, y, 1) meet walls, given by the ring that ends each; the top is last."""
        top = wall == len(self.radius)
        ring = np.minimum(wall, len(self.radius) - 1)
        rays = np.concatenate([slopes @ self.turn, np.ones_like(slopes[..., :1])], axis=-1)
        center, tangent = self.center[ring], self.tangent[ring]
        ahead = np.maximum(np.sum(rays * tangent, axis=-1), 1e-3)
        place = (np.sum(center * tangent, axis=-1) / ahead)[..., None] * rays
        radial = place - center
        radial /= np.maximum(np.linalg.norm(radial, axis=-1, keepdims=True), 1e-9)
        inward = self.slope[ring][..., None] * tangent - radial
        normal = np.where(top[..., None], -tangent, inward)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        away = -np.sum(place * normal, axis=-1)
        return Met(place, normal, np.clip(away / np.linalg.norm(place, axis=-1), 1e-3, 1.0))

    def follow(
        self,
        place: Float[np.ndarray, "n 3"],
        onward: Float[np.ndarray, "n 3"],
        wall: Int[np.ndarray, " n"],
    ) -> Int[np.ndarray, " n"]:
        """The wall that each ray meets next, the top last; −1 where it leaves past the lens.

        Args:
            place: where the ray begins, at a wall.
            onward: its direction.
            wall: that wall.
        """
        count = len(self.radius)
        speed = onward @ self.tangent.T
        from_center = np.sum(self.center * self.tangent, axis=-1) - place @ self.tangent.T
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            there = from_center / speed
            beside = place[:, None] + there[..., None] * onward[:, None] - self.center
            outside = ~(np.sum(beside**2, axis=-1) < self.radius**2) | ~(there > 0)
        number = np.arange(count)
        forward = np.take_along_axis(speed, np.minimum(wall, count - 1)[:, None], axis=1)[:, 0] > 0
        later = outside & (number > wall[:, None])
        nearer = outside & (number < wall[:, None] - 1)
        ahead = np.where(later.any(axis=1), later.argmax(axis=1), count)
        back = np.where(nearer.any(axis=1), count - nearer[:, ::-1].argmax(axis=1), -1)
        return np.where(forward, ahead, back)


class ChamberLight:
    """What a lamp at the lens makes of painted walls.

    Args:
        rings: of the straight finger.
        endoscope: its camera where it is not shaken.
        colors: reflected by what each ring ends, and at last by the top.
        effects: of which `lamp`, `gloss` and `roughness` count.
        white: level of a white wall in the light at B.
    """

    def __init__(
        self,
        rings: Rings,
        endoscope: Endoscope,
        colors: Float[np.ndarray, "walls 3"],
        effects: ChamberEffects,
        white: float,
    ) -> None:
        self._rings, self._white = rings, white
        self._lamp, self._gloss = effects.lamp, effects.gloss
        self._roughness = max(effects.roughness, NARROWEST)
        self.light = compute_wall_light(rings, colors)
        self._sent = np.concatenate([colors * self.light.total, np.zeros((1, 3))])
        self._slopes = slopes_of_pixels(endoscope)
        self._blur = max(self._roughness * float(endoscope.focal_px) / COARSE, 0.3)

    def shine(
        self,
        shown: list[Float32[np.ndarray, "rows columns"]],
        colors: list[Float32[np.ndarray, "rows columns"]],
        painted: UInt8[np.ndarray, "rows columns"],
        bend: float,
        direction: float,
    ) -> None:
        """Add the lamp's light, and what walls mirror, to the channels of a picture.

        Args:
            shown: channels of the light that walls send without the lamp's own; they are changed.
            colors: levels of the walls in the light at B.
            painted: which ring was passed last in every pixel, from 1; 0 before the first.
            bend: of the finger, radians.
            direction: to which it bends, radians.
        """
        wall = painted.astype(np.int64)
        bent = BentWall(self._rings, bend, direction)
        met = bent.meet(self._slopes, wall)
        away = np.sum(met.place**2, axis=-1)
        direct = self.light.lamp * met.place[..., 2] * met.cosine / (away * np.sqrt(away))
        passed, added = self._lamp * direct, np.zeros((*wall.shape, 3))
        kept = np.ones_like(direct)
        if self._gloss:
            reflected = self._gloss * reflectance(met.cosine)
            kept = 1 - reflected
            passed = passed * kept
            added = self._mirrored(bent, met, wall, reflected)
            added += self._highlight(met, direct)[..., None]
        for i, (channel, color) in enumerate(zip(shown, colors, strict=True)):
            channel[:] = kept * (channel + color * passed) + self._white * added[..., i]

    def _mirrored(
        self,
        bent: BentWall,
        met: Met,
        wall: Int[np.ndarray, "rows columns"],
        reflected: Float[np.ndarray, "rows columns"],
    ) -> Float[np.ndarray, "rows columns 3"]:
        some = np.s_[COARSE // 2 :: COARSE, COARSE // 2 :: COARSE]
        place, normal, start = met.place[some], met.normal[some], wall[some]
        ray = place / np.linalg.norm(place, axis=-1, keepdims=True)
        onward = ray + 2 * met.cosine[some][..., None] * normal
        hit = bent.follow(place.reshape(-1, 3), onward.reshape(-1, 3), start.ravel())
        image = self._sent[hit].reshape(*start.shape, 3) * reflected[some][..., None]
        image = cv2.GaussianBlur(image, (0, 0), self._blur)
        return cv2.resize(image, wall.shape[::-1], interpolation=cv2.INTER_LINEAR)

    def _highlight(
        self, met: Met, direct: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """The lamp in the coat, by the slopes that face it (Beckmann's distribution)."""
        square = met.cosine**2
        facing = np.exp((1 - 1 / square) / self._roughness**2) / (self._roughness * square) ** 2
        return self._gloss * float(reflectance(np.ones(1))[0]) * facing / (4 * square) * direct
