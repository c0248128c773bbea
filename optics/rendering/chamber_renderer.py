"""Images of the endoscope in a bent and pressed finger, with the truth beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, UInt8

from optics.chamber.chamber import Chamber
from optics.chamber.endoscope import Endoscope
from optics.chamber.rings import FIELD_STOP, Apertures, Posture, Rings, find_apertures
from optics.rendering.angles import checked_angles, checked_numbers
from optics.rendering.chamber_effects import ChamberEffects
from optics.rendering.chamber_light import ChamberLight
from optics.rendering.exposure import READ_NOISE

COLORS = np.array(
    [[0.75, 0.12, 0.10], [0.10, 0.22, 0.75], [0.85, 0.70, 0.10], [0.18, 0.18, 0.18]], np.float32
)
"""Red, green and blue reflected by the red, blue and yellow walls and by the top."""

FINER = 2
"""Pixels are painted this much finer in either direction, and averaged."""

GROWN = 0.5
"""By how many painted pixels OpenCV fills a polygon beyond its outline."""

CHUNK = 32
"""Postures that are worked out at once: one program serves every number of them."""

BRIGHTEST = 1.3
"""How much brighter than at B the wall can be near the lens, where light falls in at a slant."""

PAINTED = 255 / BRIGHTEST
"""What a white wall at B is painted as: the brightest is not cut off before the gain."""

GRAIN, WHITE = 0.1, 0.9
"""Radius of a grain of dust, mm, and what it reflects."""

MOST_RINGS = 255
"""What a byte can number, beside the 0 of what lies before the first one."""

SPARE = 97
"""By how many pixels a field of noise may be shifted; fields are drawn once."""


@dataclass(frozen=True)
class ChamberImage:
    """A picture and what is true of it.

    Attributes:
        pixels: red, green, blue.
        outlines: of blue with all it encloses, of yellow with all it encloses, and of the top, in
            px with pixel centres at whole numbers; as they are seen, beyond the image's border too,
            and one point where nothing is.
        seen: whether there is anything of the three, inside the image or not.
        margins: widths of what is seen of the three in the plane of bending, px at the image's
            centre; negative: by how much it is hidden.
    """

    pixels: UInt8[np.ndarray, "rows columns 3"]
    outlines: Float[np.ndarray, "3 angles 2"]
    seen: Bool[np.ndarray, "3"]
    margins: Float[np.ndarray, "3"]


@eqx.filter_jit
def _seen(
    rings: Rings,
    endoscope: Endoscope,
    postures: Posture,
    pointing: Float[Array, "postures 2"],
    roll: Float[Array, " postures"],
    angles: int,
) -> tuple[Apertures, Float[Array, "postures rings angles 2"]]:
    def one(
        posture: Posture, pointing: Float[Array, "2"], roll: Float[Array, ""]
    ) -> tuple[Apertures, Float[Array, "rings angles 2"]]:
        through = find_apertures(rings, posture, angles)
        return through, endoscope.turned(pointing, roll).image(through.outline)

    return jax.vmap(one)(postures, pointing, roll)


class ChamberRenderer:
    """A camera in a finger. Frame ``n`` of a seed is the same however frames are asked for.

    Attributes:
        rings: of the straight finger.
        endoscope: the camera where it is not shaken.
        effects: what makes pictures worse.
    """

    def __init__(
        self,
        chamber: Chamber,
        endoscope: Endoscope,
        effects: ChamberEffects,
        *,
        seed: int | Sequence[int] = 0,
        colors: Float[np.ndarray, "4 3"] = COLORS,
        per_region: int = 20,
        angles: int = 192,
    ) -> None:
        """Prepare what all frames share.

        Args:
            chamber: of the straight finger.
            endoscope: its camera; shake turns it.
            effects: what makes pictures worse.
            seed: of everything that is random; a number, or several that are one together.
            colors: of the walls and of the top.
            per_region: rings in every region; the light changes from one to the next.
            angles: points of an outline.

        Raises:
            ValueError: the image's corners show rays farther from the axis than is followed, the
                lens images two rays at one place, or there are more rings than can be painted.
        """
        _check(endoscope)
        if not 1 <= per_region <= MOST_RINGS // 3:
            raise ValueError(f"per_region is {per_region}; give 1 to {MOST_RINGS // 3}")
        self.rings = Rings.of(chamber, per_region)
        self.endoscope = endoscope
        self.effects = effects
        self._seed = tuple(np.atleast_1d(seed).tolist())
        self._angles = angles
        walls = np.asarray(colors, float)[[*self.rings.region, 3]]
        self._depth = np.asarray(self.rings.arc) + float(self.rings.pinhole_offset)
        self._focal = float(endoscope.focal_px)
        light = np.repeat((1 - effects.lamp) * self._falling()[:, None], 3, axis=1)
        self._lamp = None
        if effects.lamp or effects.gloss:
            self._lamp = ChamberLight(self.rings, endoscope, walls, effects, PAINTED)
            light += effects.lamp * self._lamp.light.mutual
        self._shades = _tables(walls * light, exact=self._lamp is not None)
        self._colors = _tables(walls, exact=True)
        self._white = light + (effects.lamp * self._lamp.light.direct[:, None] if self._lamp else 0)
        shape = (endoscope.rows, endoscope.columns)
        generator = np.random.default_rng([*self._seed, 1])
        self._light = _light(shape, effects, generator)
        spare = (shape[0] + SPARE, shape[1] + SPARE)
        self._noise = [
            generator.standard_normal(spare, np.float32) if effects.noise else None
            for _ in range(3)
        ]

    def _falling(self) -> Float[np.ndarray, " walls"]:
        """Light by the power of the distance, before each ring and on the top; 1 at B."""
        at_b = self._depth[self.rings.ends[0]]
        light = np.minimum((at_b / self._depth) ** self.effects.falloff, BRIGHTEST)
        # The wall between two rings has their mean light; before the first there is only its own.
        return np.concatenate([light[:1], (light[:-1] + light[1:]) / 2, light[-1:]])

    def render(self, postures: Posture, first: int = 0) -> list[ChamberImage]:
        """Pictures of some postures.

        Args:
            postures: one batch axis; bends and directions of at most a turn to either side, within
                which all lie.
            first: number of the first frame; the number and the seed choose shake and noise.

        Raises:
            UserError: postures are not finite, differ in number, are pressed at other places than
                the rings, or have angles that are no radians.
        """
        leaves = self._checked(postures)
        count = len(leaves.bend)
        images: list[ChamberImage] = []
        for start in range(0, count, CHUNK):
            some = np.minimum(np.arange(start, start + CHUNK), count - 1)
            chunk = jax.tree.map(lambda leaf, some=some: leaf[some], leaves)
            images += self._chunk(chunk, first + start, min(CHUNK, count - start))
        return images

    def _checked(self, postures: Posture) -> Posture:
        batch = "give arrays with one axis of postures, in radians"
        bend = checked_angles(postures.bend, ("postures",), what="bends", cure=batch)
        direction = checked_angles(postures.direction, bend.shape, what="directions", cure=batch)
        rings = (*bend.shape, len(self.rings.arc))
        pressed = checked_numbers(
            postures.pressed,
            rings,
            what="depths to which postures are pressed",
            cure="give one in mm for every ring of every posture",
        )
        return eqx.tree_at(
            lambda one: (one.bend, one.direction, one.pressed), postures, (bend, direction, pressed)
        )

    def _chunk(self, postures: Posture, first: int, number: int) -> list[ChamberImage]:
        generators = [np.random.default_rng([*self._seed, 2, first + i]) for i in range(number)]
        shaken = np.zeros((CHUNK, 3))
        spread = [self.effects.shake / self._focal] * 2 + [math.radians(self.effects.roll_deg)]
        for i, generator in enumerate(generators):
            shaken[i] = spread * generator.standard_normal(3)
        # JAX's float type may be that of another thread: frames are the same in every one.
        with jax.enable_x64(self.rings.arc.dtype == np.float64):
            dtype = self.rings.arc.dtype
            through, outlines = _seen(
                self.rings,
                self.endoscope,
                jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), postures),
                jnp.asarray(shaken[:, :2], dtype),
                jnp.asarray(shaken[:, 2], dtype),
                self._angles,
            )
        ends = np.array(self.rings.ends)
        outlines, seen = np.asarray(outlines), np.asarray(through.seen)
        widths = self._focal * np.asarray(through.spans.width)
        bends = np.stack([postures.bend, postures.direction], axis=-1)
        return [
            ChamberImage(
                self._exposed(self._painted(outlines[i], seen[i]), bends[i], generator),
                outlines[i, ends],
                seen[i, ends],
                widths[i, ends],
            )
            for i, generator in enumerate(generators)
        ]

    def _painted(
        self, outlines: Float[np.ndarray, "rings angles 2"], seen: Bool[np.ndarray, " rings"]
    ) -> UInt8[np.ndarray, "fine_rows fine_columns"]:
        """Which ring was passed last, in every fine pixel."""
        rows, columns = FINER * self.endoscope.rows, FINER * self.endoscope.columns
        painted = np.zeros((rows, columns), np.uint8)
        fine = _inset(FINER * (outlines + 0.5) - 0.5, GROWN)
        fixed = np.round(16 * fine).astype(np.int32)
        for ring in np.flatnonzero(seen):
            cv2.fillPoly(painted, [fixed[ring]], int(ring) + 1, cv2.LINE_8, 4)
        return painted

    def _exposed(
        self,
        painted: UInt8[np.ndarray, "fine_rows fine_columns"],
        bend: Float[np.ndarray, "2"],
        generator: np.random.Generator,
    ) -> UInt8[np.ndarray, "rows columns 3"]:
        effects = self.effects
        size = (self.endoscope.columns, self.endoscope.rows)
        exposure = math.exp(effects.flicker * generator.standard_normal())
        shown = [_resized(painted, shade, size) for shade in self._shades]
        if self._lamp:
            colors = [_resized(painted, color, size) for color in self._colors]
            self._lamp.shine(shown, colors, painted[::FINER, ::FINER], *bend)
        if effects.speckles:
            self._strew(shown, painted[::FINER, ::FINER], generator)
        channels = []
        for channel, noise in zip(shown, self._noise, strict=True):
            if effects.blur:
                channel = cv2.GaussianBlur(channel, (0, 0), effects.blur)
            light = cv2.multiply(channel, self._light[0], scale=exposure, dtype=cv2.CV_32F)
            if effects.glare:
                light = cv2.scaleAdd(self._light[1], exposure, light)
            if noise is not None:
                level = cv2.addWeighted(light, 255.0, light, 0.0, (255 * READ_NOISE) ** 2)
                grain = cv2.multiply(
                    cv2.sqrt(level), _shifted(noise, size, generator), scale=effects.noise
                )
                light = cv2.add(light, grain)
            # Rounded, and cut off at 0 and 255.
            channels.append(cv2.addWeighted(light, 1.0, light, 0.0, 0.0, dtype=cv2.CV_8U))
        return cv2.merge(channels)

    def _strew(
        self,
        shown: list[np.ndarray],
        painted: UInt8[np.ndarray, "rows columns"],
        generator: np.random.Generator,
    ) -> None:
        """Lay grains of white dust on the walls; the picture's channels are changed."""
        rows, columns = painted.shape
        for _ in range(generator.poisson(self.effects.speckles)):
            row, column = generator.uniform(0, rows), generator.uniform(0, columns)
            wall = min(int(painted[int(row), int(column)]), len(self._depth) - 1)
            radius = self._focal * GRAIN / self._depth[wall]
            box = np.s_[
                max(int(row - radius), 0) : int(row + radius) + 2,
                max(int(column - radius), 0) : int(column + radius) + 2,
            ]
            y, x = np.mgrid[box]
            y, x = y[: rows - box[0].start], x[: rows - box[0].start]
            covered = np.clip(radius + 0.5 - np.hypot(y - row, x - column), 0, 1)
            covered = covered[:, : columns - box[1].start]
            for channel, light in zip(shown, self._white[wall], strict=True):
                own = channel[box]
                own[:] = own + covered * (WHITE * PAINTED * light - own)


def _tables(
    light: Float[np.ndarray, "walls 3"], *, exact: bool
) -> list[UInt8[np.ndarray, " 256"] | Float32[np.ndarray, " 256"]]:
    """What the light of walls, 1 for white at B, is painted as; in whole levels if not exact."""
    table = np.zeros((256, 3))
    table[: len(light)] = PAINTED * light
    kind = np.float32 if exact else np.uint8
    return [np.ascontiguousarray((one if exact else np.round(one)).astype(kind)) for one in table.T]


def _resized(
    painted: UInt8[np.ndarray, "fine_rows fine_columns"], table: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    return cv2.resize(cv2.LUT(painted, table), size, interpolation=cv2.INTER_AREA)


def _check(endoscope: Endoscope) -> None:
    """That every pixel shows one ray that is followed, however the camera is turned."""
    corner, k1 = math.tan(float(endoscope.field_of_view) / 2), float(endoscope.distortion)
    turned, stop = float(np.hypot(*endoscope.pointing)), math.atan(FIELD_STOP)
    if turned + stop < math.pi / 2:
        near, far = math.tan(stop - turned), math.tan(stop + turned)
        rises = 1 + 3 * k1 * far**2 > 0
        if rises and near > 0 and 0 < corner < near * (1 + k1 * near**2):
            return
    raise ValueError(
        f"a field of view of {math.degrees(float(endoscope.field_of_view)):.0f} degrees, turned by "
        f"{math.degrees(turned):.0f} degrees, with a distortion of {k1:g} shows rays that are not "
        "followed; make one of them smaller"
    )


def _light(
    shape: tuple[int, int], effects: ChamberEffects, generator: np.random.Generator
) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns"]]:
    """What the painted light is multiplied by, and what is added to it."""
    rows, columns = shape
    half = math.hypot(rows, columns) / 2
    y, x = np.mgrid[:rows, :columns]
    x, y = (x - (columns - 1) / 2) / half, (y - (rows - 1) / 2) / half
    lamp = generator.uniform(0, 2 * math.pi)
    side = (x * math.cos(lamp) + y * math.sin(lamp) + 1) / 2
    field = (1 - effects.uneven * (1 - side)) * (1 - effects.vignetting * (x**2 + y**2))
    spot = np.exp(-((x - 0.55 * math.cos(lamp)) ** 2 + (y - 0.55 * math.sin(lamp)) ** 2) / 0.005)
    glare = 255 * effects.gain * effects.glare * spot
    return (effects.gain * BRIGHTEST * field).astype(np.float32), glare.astype(np.float32)


def _shifted(
    noise: Float[np.ndarray, "spare_rows spare_columns"],
    size: tuple[int, int],
    generator: np.random.Generator,
) -> Float[np.ndarray, "rows columns"]:
    down, right = generator.integers(0, SPARE, 2)
    return noise[down : down + size[1], right : right + size[0]]


def _inset(
    outlines: Float[np.ndarray, "rings angles 2"], by: float
) -> Float[np.ndarray, "rings angles 2"]:
    """Closed outlines moved inwards along their normals."""
    along = np.roll(outlines, -1, axis=1) - np.roll(outlines, 1, axis=1)
    length = np.maximum(np.hypot(along[..., :1], along[..., 1:]), 1e-12)
    # From right to down: the inside is to the left of the way along it, turned from x to y.
    inwards = np.concatenate([-along[..., 1:], along[..., :1]], axis=-1) / length
    return outlines + by * inwards
