"""Rendering: every pixel's ray goes to the pad that it meets, and takes its light from there.

Rays are followed in space: over mirrors that lean and bow (`optics.rendering.ways`), and down
through the layers on a pad (`optics.rendering.plates`). What hides a pad is found in the section
(`optics.rendering.limits`). What a scene does not have costs nothing: a bare pad seen over flat
mirrors by a pupil that stays is one projection of a plane.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8

from designopt.errors import UserError
from optics.rendering.angles import checked_angles
from optics.rendering.effects import FOCUS, Effects
from optics.rendering.exposure import exposed
from optics.rendering.imprints import Imprint
from optics.rendering.limits import seen_from_outside
from optics.rendering.pads import (
    BRIGHT,
    ClearBody,
    PadAppearance,
    lamp_in_view,
    make_pad_appearance,
    margin_beside,
)
from optics.rendering.plates import LAMPS, Meeting, meet_bare, plates_of
from optics.rendering.posed import Geometry, find_geometry, free_of
from optics.rendering.ways import Rays, axes_of, legs_of, one_of
from optics.scene.camera import Orthographic, Pinhole
from optics.scene.fabrication import Fabrication, perturb
from optics.scene.imaging import CENTER, RADII, Imaging
from optics.scene.layers import CHANNELS, GREEN
from optics.scene.scene import Scene
from optics.visibility.boundary_codes import FIRST_PAD_END, SECOND_PAD_END
from optics.visibility.corners_in_space import SpatialMirror, SpatialPad
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, path_name

BORDER = 8
"""Pixels around a view that are looked at as well, as blur and rough edges need."""

AROUND = 33
"""Places along each side of a pad that are projected to find its place in the image."""

GRAZING = np.deg2rad(0.05)
"""Flatter rays show nothing: what a design does not count, a camera sees all the same."""

BLOTCHES = (6, 8)
"""Rows and columns of random brightness that the finger's inside is made of."""

PUPIL_STEPS = 3
"""Steps to where the pupil is for a place that is imaged; they need to be right to a few pixels."""

SHARPEST = 0.3
"""Radius of a disc of defocus below which it is none, px."""


@dataclass(frozen=True)
class TrueView:
    """One view of a pad that is in the image.

    Attributes:
        pad: name of the pad.
        path: name of the path.
        reflections: on its way.
        corners: column and row of the corners of the pad's sharp rectangle, in the order of
            `outlines.CORNERS`, wherever they are hidden or not.
        complete: whether this path shows all of the pad, nowhere flatter than the pad's least
            grazing angle.
        at_border: whether the view touches the image's border.
    """

    pad: str
    path: str
    reflections: int
    corners: Float[np.ndarray, "4 2"]
    complete: bool
    at_border: bool


@dataclass(frozen=True)
class TactileImage:
    """An image and the truth about it.

    Attributes:
        pixels: red, green, blue.
        labels: 0 where no pad is seen, else 1 + the index in ``views``.
        views: all views in the image.
        angles: joint angles, rad.
        errors: of the finger that was rendered.
    """

    pixels: UInt8[np.ndarray, "rows columns 3"]
    labels: UInt8[np.ndarray, "rows columns"]
    views: tuple[TrueView, ...]
    angles: Float[np.ndarray, " joints"]
    errors: Fabrication

    def view(self, pad: str, path: str) -> TrueView | None:
        """The view of a pad by a path, if there is one."""
        return next((v for v in self.views if (v.pad, v.path) == (pad, path)), None)


class Renderer:
    """One made finger in front of its camera, ready for many frames.

    Building it does what stays from frame to frame: the rays of all pixels, and the looks of pads.

    Attributes:
        scene: as it was made, its camera as it images.
        imaging: the camera with its image.
    """

    def __init__(
        self,
        scene: Scene,
        width: float,
        effects: Effects,
        *,
        errors: Fabrication | None = None,
        carried: Sequence[int] = (),
        rows: int | None = None,
        seed: int = 0,
    ) -> None:
        """Make a finger.

        Args:
            scene: as designed, its mirrors straight.
            width: of the pads across the section, mm.
            effects: what makes its images worse.
            errors: of this finger; none by default.
            carried: indices of the blockers that move with the camera, such as its body.
            rows: height of the image, px, which is as wide as `Imaging.of` makes it; the camera's
                pixels by default.
            seed: of this finger's rough edges, of its inside, and of the noise of its frames.

        Raises:
            UserError: mirrors have layers or are curved, which images do not show yet.
        """
        if scene.layout.curved:
            raise UserError(
                f"{scene.layout.name}: synthetic images do not show curved mirrors; leave out "
                "'radius' of the mirrors"
            )
        if scene.mirror_layers is not None:
            raise UserError(
                f"{scene.layout.name}: synthetic images do not show mirrors through layers; leave "
                "out 'layers' of the mirrors"
            )
        self._errors = Fabrication.none(scene.layout) if errors is None else errors
        self._effects, self._width, self._seed = effects, width, seed
        made = perturb(scene, self._errors, carried=carried)
        pixels = made.camera.pixels if rows is None else jnp.full_like(made.camera.pixels, rows)
        self.scene = eqx.tree_at(lambda scene: scene.camera.pixels, made, pixels)
        self.imaging = Imaging.of(self.scene.camera)
        self._rays = self._rays_of_channels()
        self._plates = [plates_of(self.scene, width, channel) for channel in range(len(CHANNELS))]
        layers = self.scene.own_layers
        index = np.zeros((len(made.pads), 1, 1)) if layers is None else np.asarray(layers.index)
        self._disperses = np.ptp(index, axis=-1).any(axis=-1)
        self._lit = self.imaging.lit()
        self._vignette = self._vignetting()
        self._inside = self._finger_inside()
        self._paths = paths_of(scene.layout, scene.layout.bounces)
        self._looks: dict[tuple[int, tuple[Imprint, ...]], PadAppearance] = {}
        # Corners of the image look beyond the field of view, which is that of the image line.
        widest = 2 * float(np.abs(np.arctan2(self._rays[0].above, self._rays[0].ahead)).max())
        self._outside = eqx.tree_at(
            lambda scene: (scene.camera.field_of_view, scene.grazing),
            seen_from_outside(self.scene),
            (jnp.asarray(widest), jnp.full_like(made.grazing, GRAZING)),
        )
        camera = self.scene.camera
        angles = np.linspace(0, min(camera.projection.widest, np.pi) - 1e-3, RADII)
        heights = camera.projection.height(jnp.asarray(angles))
        # Here as numbers, which need no dispatch.
        self._focal = float(camera.focal_pixels)
        self._radii = angles, self._focal * np.asarray(heights)
        shift = camera.pupil_shift
        self._pupil = None if shift is None else np.asarray(shift)
        self._steep = np.sin(np.asarray(self.scene.grazing))

    def _rays_of_channels(self) -> list[Rays]:
        """Rays of all pixels: of each color where its image has a scale of its own, or of all."""
        scales = self._errors.lateral_color
        if scales is None or not np.any(scales):
            return [Rays.of(self.imaging)]
        red, blue = (1 + np.asarray(scales)).tolist()
        return [Rays.of(self.imaging, scale) for scale in (red, 1.0, blue)]

    def render(
        self,
        angles: Float[np.ndarray, " joints"],
        imprints: Mapping[str, Sequence[Imprint]] | None = None,
        *,
        frame: int = 0,
    ) -> TactileImage:
        """An image of the finger in a pose.

        Args:
            angles: joint angles in the order of ``scene.angle_names``, rad; at most a turn to
                either side, within which every pose lies.
            imprints: what is pressed into pads, by the pads' names.
            frame: number of the frame, which with the finger's seed gives its noise.

        Raises:
            UserError: angles are not finite, not as many as joints, or no radians.
            ValueError: there is no pad of a name.
        """
        layout = self.scene.layout
        joints = layout.angles
        one_each = f"give one of each joint ({', '.join(joints) or 'there is none'})"
        pose = checked_angles(angles, (len(joints),), what="joint angles", cure=one_each)
        unknown = set(imprints or ()) - {pad.name for pad in layout.pads}
        if unknown:
            raise ValueError(f"no pad is named {', '.join(sorted(unknown))}")
        geometry = self._geometry_of(pose)
        light = self._inside.copy()
        labels = np.zeros(light.shape[:2], np.uint8)
        views: list[TrueView] = []
        pieces: Pieces = geometry.pieces
        for path, word in enumerate(self._paths):
            for pad, surface in enumerate(layout.pads):
                parts = np.flatnonzero(pieces.present[pad] & (pieces.path[pad] == path))
                if not parts.size:
                    continue
                look = self._look(pad, tuple((imprints or {}).get(surface.name, ())))
                axes = axes_of(geometry.camera, geometry.mirrors, word)
                ends, around = self._placed(axes, one_of(geometry.bodies, pad), pad)
                radius = self._defocus(ends)
                window = self._window(around, radius + self._bending(geometry.mirrors, word))
                shown, color, lamps = self._seen(geometry, word, pad, parts, window, look)
                if word and self._effects.mirror_loss:
                    kept = (1 - self._effects.mirror_loss) ** len(word)
                    color *= kept
                    lamps = None if lamps is None else lamps * kept
                _laid(light[window], shown, color, lamps, radius)
                mine = shown[..., shown.shape[-1] // 2] > 0.5
                if not mine.any():
                    continue
                labels[window][mine] = len(views) + 1
                if geometry.whole is None:
                    whole = self._whole(geometry, pad, parts, axes[0])
                else:
                    whole = geometry.whole[path, pad]
                views.append(
                    TrueView(
                        surface.name,
                        path_name(layout, word),
                        len(word),
                        np.asarray(geometry.corners[path, pad]),
                        bool(whole),
                        _touches_border(labels == len(views) + 1),
                    )
                )
        generator = np.random.default_rng([self._seed, 1, frame])
        pixels = exposed(light, self._effects, generator)
        return TactileImage(pixels, labels, tuple(views), pose, self._errors)

    def _geometry_of(self, pose: Float[np.ndarray, " joints"]) -> Geometry:
        found = find_geometry(
            self.scene, self._outside, self.imaging, jnp.asarray(pose), self._width, self._errors
        )
        return jax.tree.map(np.asarray, found)

    def _seen(
        self,
        geometry: Geometry,
        word: Sequence[int],
        pad: int,
        parts: np.ndarray,
        window: tuple[slice, slice],
        look: PadAppearance,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """How much of each pixel a view fills, the light of the pad there, and of lamps.

        The first is one for all colors, or one for each if these go different ways.
        """
        plates = [of_pads[pad] for of_pads in self._plates]
        one = len(self._rays) == 1 and not self._disperses[pad]
        channels = [GREEN] if one else range(len(CHANNELS))
        found = []
        for channel in channels:
            rays = self._rays[channel % len(self._rays)].at(window)
            legs = legs_of(geometry.camera, rays, geometry.mirrors, word)
            free = free_of(geometry, pad, parts, legs, rays)
            body = one_of(geometry.bodies, pad)
            axes = np.stack([body.along, body.across, body.normal])
            at = legs[-1].within(body.start, axes)
            covered = plates[channel]
            meeting = meet_bare(*at) if covered is None else covered.meet(*at)
            found.append(self._looked(meeting, look, free * meeting.there))
        if one:
            [(shown, color, lamps)] = found
            shown = shown[..., None]
        else:
            shown = np.stack([each[0] for each in found], axis=-1)
            color = np.stack([each[1][..., i] for i, each in enumerate(found)], axis=-1)
            alight = [each[2][..., i] for i, each in enumerate(found) if each[2] is not None]
            lamps = np.stack(alight, axis=-1) if alight else None
        if self._lit is not None:
            shown = shown * self._lit[window][..., None]
        if self._vignette is not None:
            color *= self._vignette[window][..., None]
        return shown, color, lamps

    def _looked(
        self, meeting: Meeting, look: PadAppearance, free: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """How much of each pixel the pad fills, of what is free; its light, and that of lamps."""
        color, inside = look.sample(meeting.along, meeting.across)
        if meeting.margin is not None:
            inside = np.minimum(inside, meeting.margin)
        if meeting.light is not None:
            color *= meeting.light[..., None]
        lamps = None
        if look.lamps is not None:
            lamps = look.sample_lamps(meeting.along, meeting.across) * free[..., None]
        elif meeting.lamps and (self._effects.lamps or self._effects.strips):
            lamps = np.zeros((*free.shape, 3), np.float32)
            for margin, channel in meeting.lamps:
                lamps += (_filled(margin) * free)[..., None] * lamp_in_view(channel)
        return _filled(inside) * free, color, lamps

    def _whole(
        self, geometry: Geometry, pad: int, parts: np.ndarray, turn: Float[np.ndarray, "3 3"]
    ) -> bool:
        """Whether one piece shows all of a bare pad, nowhere flatter than its design counts."""
        pieces, (ahead, above, _) = geometry.pieces, geometry.bodies.along[pad] @ turn
        rays = np.exp(1j * geometry.limits[pad, parts])
        steep = np.abs(np.imag(np.conj(rays) * complex(ahead, above))).min(axis=1)
        whole = (pieces.start_label[pad, parts] == FIRST_PAD_END) & (
            pieces.end_label[pad, parts] == SECOND_PAD_END
        )
        return bool((whole & (steep >= self._steep[pad])).any())

    def _defocus(self, ends: Float[np.ndarray, "2 2"]) -> float:
        """Radius of the disc over which a view is spread, that of its middle, px; 0 if sharp."""
        if not self._effects.defocus:
            return 0.0
        distance = max(float(np.hypot(*ends.mean(axis=0))), 1.0)
        radius = self._effects.defocus * abs(1 / distance - 1 / FOCUS)
        return radius if radius > SHARPEST else 0.0

    def _placed(
        self, axes: tuple[np.ndarray, np.ndarray], body: SpatialPad, pad: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """A membrane's ends in the section, and places about what is seen, in mirrored axes, mm."""
        turn, shift = axes
        (length, width), plates = body.size, self._plates[GREEN][pad]
        edges, height = ((0.0, length), (-width / 2, width / 2)), 0.0
        if plates is not None:
            edges, height = plates.opening, plates.top
        elif self._effects.strips:
            beside = margin_beside(self._effects)
            edges = tuple((first - beside, last + beside) for first, last in edges)
        share = np.linspace(0, 1, AROUND)
        (u0, u1), (v0, v1) = edges
        u, v = u0 + share * (u1 - u0), v0 + share * (v1 - v0)
        sides = [(u, v0), (u, v1), (u0, v), (u1, v)]
        places = np.concatenate([np.stack(np.broadcast_arrays(*one), -1) for one in sides])
        start = body.start - shift
        around = start + places @ np.stack([body.along, body.across]) + height * body.normal
        ends = np.stack([start, start + length * body.along])
        return (ends @ turn)[:, :2], np.asarray(around @ turn)

    def _bending(self, mirrors: SpatialMirror, word: Sequence[int]) -> float:
        """By how much bowed mirrors may move what is seen in them, px."""
        if mirrors.bow is None or not word:
            return 0.0
        turned = sum(4 * abs(mirrors.bow[i]) / mirrors.half[i] for i in word)
        return float(turned * self._focal)

    def _look(self, pad: int, imprints: tuple[Imprint, ...]) -> PadAppearance:
        if (pad, imprints) not in self._looks:
            layout = self.scene.layout
            ends = np.asarray(self.scene.pads[pad])
            outer = layout.pads[pad].frame != layout.camera_frame
            self._looks[pad, imprints] = make_pad_appearance(
                float(np.hypot(*(ends[1] - ends[0]))),
                self._width,
                self._effects,
                imprints,
                brightness=1 - self._effects.dim_outer if outer else 1.0,
                seed=(self._seed, 2, pad),
                body=self._clear_body(pad),
            )
        return self._looks[pad, imprints]

    def _clear_body(self, pad: int) -> ClearBody | None:
        plates = self._plates[GREEN][pad]
        if plates is None:
            return None
        first = plates.plates[0]
        walls = {LAMPS[0][0]: first.kinds[0][0]}
        walls |= dict(zip(LAMPS[1], first.kinds[1], strict=True))
        guides = tuple(walls[channel] == "clear" for channel in range(len(CHANNELS)))
        return ClearBody(plates.top, first.refraction, guides, plates.mirrored)

    def _vignetting(self) -> Float[np.ndarray, "rows columns"] | None:
        if not self._effects.vignetting:
            return None
        # The cosine of the angle from the axis.
        rays = self._rays[len(self._rays) // 2]
        forward = rays.ahead / np.sqrt(1 + rays.slope**2)
        return 1 - np.float32(self._effects.vignetting) * (1 - np.maximum(forward, 0))

    def _finger_inside(self) -> Float[np.ndarray, "rows columns 3"]:
        """What the finger's inside sends: nothing, or light of leaks and lamps, in blotches."""
        shape = self._rays[0].ahead.shape
        inside = np.zeros((*shape, 3), np.float32)
        if not self._effects.ambient and not self._effects.walls:
            return inside
        generator = np.random.default_rng([self._seed, 3])
        blotches = generator.uniform(0.5, 1.0, (*BLOTCHES, 3)).astype(np.float32)
        if self._effects.ambient:
            broad = cv2.resize(blotches, shape[::-1], interpolation=cv2.INTER_LINEAR)
            inside += np.float32(self._effects.ambient) * broad
        if self._effects.walls:
            gray = generator.uniform(0.5, 1.0, BLOTCHES).astype(np.float32)
            broad = cv2.resize(gray, shape[::-1], interpolation=cv2.INTER_LINEAR)
            inside += np.float32(BRIGHT * self._effects.walls) * broad[..., None]
        if self._lit is not None:
            inside = inside * self._lit[..., None]
        return inside if self._vignette is None else inside * self._vignette[..., None]

    def _window(self, around: Float[np.ndarray, "places 3"], spare: float) -> tuple[slice, slice]:
        """The part of the image that holds a view; all of it for one that passes the camera."""
        rows, columns = self._inside.shape[:2]
        # Only these image what is behind them elsewhere than where it lies.
        pinhole = isinstance(self.imaging.camera.projection, Pinhole | Orthographic)
        if pinhole and (around[:, 0] <= 0).any():
            return slice(0, rows), slice(0, columns)
        ahead, above, across = around.T
        off = np.maximum(np.hypot(above, across), 1e-9)
        angle = np.arctan2(off, ahead)
        if self._pupil is not None:
            for _ in range(PUPIL_STEPS):
                angle = np.arctan2(off, ahead - angle**2 * np.polyval(self._pupil[::-1], angle**2))
        radius = np.interp(angle, *self._radii)
        middle = np.array([columns, rows])[:, None] / 2 - CENTER
        places = middle + radius / off * np.stack([across, -above])
        low = np.floor(places.min(axis=1) - spare) - BORDER
        high = np.ceil(places.max(axis=1) + spare) + BORDER + 1
        left, right = np.clip([low[0], high[0]], 0, columns).astype(int)
        top, bottom = np.clip([low[1], high[1]], 0, rows).astype(int)
        # A gradient needs two pixels each way.
        left, top = min(left, columns - 2), min(top, rows - 2)
        return slice(top, max(bottom, top + 2)), slice(left, max(right, left + 2))


def _laid(
    light: Float[np.ndarray, "rows columns 3"],
    shown: Float[np.ndarray, "rows columns channels"],
    color: Float[np.ndarray, "rows columns 3"],
    lamps: Float[np.ndarray, "rows columns 3"] | None,
    radius: float,
) -> None:
    """Lay a view over what is behind it, spread over a disc of defocus, and add its lamps."""
    if radius:
        reach = np.arange(-np.ceil(radius), np.ceil(radius) + 1)
        disc = np.clip(radius + 0.5 - np.hypot(reach[:, None], reach), 0, 1)
        disc /= disc.sum()
        # Places that a view fills in part count for its colour by that part.
        color = cv2.filter2D(shown * color, -1, disc)
        shown = cv2.filter2D(shown, -1, disc).reshape(shown.shape)
        color /= np.maximum(shown, 1e-6)
        lamps = None if lamps is None else cv2.filter2D(lamps, -1, disc)
    light += shown * (color - light)
    if lamps is not None:
        light += lamps


def _filled(inside: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns"]:
    """Part of each pixel within an outline, from the distance inside it."""
    down, right = np.gradient(inside)
    steepness = np.sqrt(down * down + right * right)
    return np.clip(0.5 + inside / np.maximum(steepness, 1e-6), 0, 1)


def _touches_border(seen: np.ndarray) -> bool:
    return bool(seen[[0, -1]].any() or seen[:, [0, -1]].any())
