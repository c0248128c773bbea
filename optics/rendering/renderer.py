"""Rendering: every pixel's ray goes to the pad that it meets, and takes its light from there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt8

from designopt.errors import UserError
from optics.rendering.angles import checked_angles
from optics.rendering.effects import FOCUS, Effects
from optics.rendering.exposure import exposed
from optics.rendering.imprints import Imprint
from optics.rendering.pads import BRIGHT, PadAppearance, make_pad_appearance, margin_beside
from optics.scene.camera import Orthographic, Pinhole
from optics.scene.fabrication import Fabrication, perturb
from optics.scene.imaging import Imaging
from optics.scene.scene import Scene
from optics.visibility.boundary_codes import FIRST_PAD_END, SECOND_PAD_END
from optics.visibility.coverage import find_views
from optics.visibility.outlines import Outlines, find_corners, find_outlines
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, path_name

BORDER = 8
"""Pixels around a view that are looked at as well, as blur and rough edges need."""

ALONG_SIDE = 17
"""Places along each side of a pad that are projected to find its place in the image."""

GRAZING = np.deg2rad(0.05)
"""Flatter rays show nothing: what a design does not count, a camera sees all the same."""

BLOTCHES = (6, 8)
"""Rows and columns of random brightness that the finger's inside is made of."""

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


class _Geometry(NamedTuple):
    """What the image of one pose follows from.

    Attributes:
        pieces: what is seen.
        limits: section angles of the pieces' ends, rad.
        ends: of the pads in the camera's own axes, unfolded, mm.
        corners: where the pads' corners are imaged.
        around: where places of the pads are imaged, their sides' among them.
        behind: whether any of these is behind a pinhole.
    """

    pieces: Pieces
    limits: Float[Array, "pads pieces 2"]
    ends: Float[Array, "paths pads 2 2"]
    corners: Float[Array, "paths pads 4 2"]
    around: Float[Array, "paths pads places 2"]
    behind: Bool[Array, "paths pads"]


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
            UserError: pads or mirrors have layers, or the entrance pupil moves, which images do not
                show yet.
        """
        if scene.layers is not None:
            raise UserError(
                f"{scene.layout.name}: synthetic images do not show the layers on pads; leave out "
                "'layers' of the pads"
            )
        if scene.mirror_layers is not None:
            raise UserError(
                f"{scene.layout.name}: synthetic images do not show mirrors through layers; leave "
                "out 'layers' of the mirrors"
            )
        if scene.camera.pupil_shift is not None:
            raise UserError(
                f"{scene.layout.name}: synthetic images are those of a pupil that stays; leave out "
                "'pupil_shift' of the camera"
            )
        self._errors = Fabrication.none(scene.layout) if errors is None else errors
        self._effects, self._width, self._seed = effects, width, seed
        self._beside = margin_beside(effects) if effects.strips else 0.0
        self._lateral = np.float32(self._errors.lateral.item())
        made = perturb(scene, self._errors, carried=carried)
        pixels = made.camera.pixels if rows is None else jnp.full_like(made.camera.pixels, rows)
        self.scene = eqx.tree_at(
            lambda scene: (scene.camera.pixels, scene.grazing),
            made,
            (pixels, jnp.full_like(made.grazing, GRAZING)),
        )
        self._least_grazing = np.asarray(scene.grazing)
        self.imaging = Imaging.of(self.scene.camera)
        rays = self.imaging.ray_map()
        self._angle, self._slope = (np.ascontiguousarray(rays[..., part]) for part in range(2))
        self._lit = self.imaging.lit()
        self._vignette = self._vignetting()
        self._inside = self._finger_inside()
        self._paths = paths_of(scene.layout, scene.layout.bounces)
        self._looks: dict[tuple[int, tuple[Imprint, ...]], PadAppearance] = {}

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
        geometry = jax.tree.map(
            np.asarray,
            _geometry(
                self.scene,
                self.imaging,
                jnp.asarray(pose),
                jnp.asarray(self._width),
                jnp.asarray(self._width + 2 * self._beside),
                self._errors.lateral,
                jnp.asarray(2 * float(np.abs(self._angle).max())),
            ),
        )
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
                radius = self._defocus(geometry.ends[path, pad])
                window = self._window(
                    geometry.around[path, pad], bool(geometry.behind[path, pad]), radius
                )
                shown, color, lamps = self._seen(geometry, path, pad, parts, window, look)
                if word and self._effects.mirror_loss:
                    kept = (1 - self._effects.mirror_loss) ** len(word)
                    color *= kept
                    lamps = None if lamps is None else lamps * kept
                _laid(light[window], shown, color, lamps, radius)
                mine = shown > 0.5
                if not mine.any():
                    continue
                labels[window][mine] = len(views) + 1
                whole = (
                    (pieces.start_label[pad, parts] == FIRST_PAD_END)
                    & (pieces.end_label[pad, parts] == SECOND_PAD_END)
                ).any() and _grazing(geometry.ends[path, pad]) >= self._least_grazing[pad]
                views.append(
                    TrueView(
                        surface.name,
                        path_name(layout, word),
                        len(word),
                        geometry.corners[path, pad],
                        bool(whole),
                        _touches_border(labels == len(views) + 1),
                    )
                )
        generator = np.random.default_rng([self._seed, 1, frame])
        pixels = exposed(light, self._effects, generator)
        return TactileImage(pixels, labels, tuple(views), pose, self._errors)

    def _seen(
        self,
        geometry: _Geometry,
        path: int,
        pad: int,
        parts: np.ndarray,
        window: tuple[slice, slice],
        look: PadAppearance,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """How much of each pixel a view fills, the light of the pad there, and of lamps beside it.
        """
        angle, slope = self._angle[window], self._slope[window]
        forward, up = np.cos(angle), np.sin(angle)
        # notation: the ray L (forward, up) meets first + part · step.
        first, last = np.asarray(geometry.ends[path, pad], np.float32)
        step = last - first
        across = forward * step[1] - up * step[0]
        across = np.where(across == 0, np.float32(1e-6), across)
        distance = (first[0] * step[1] - first[1] * step[0]) / across
        along = (first[0] * up - first[1] * forward) / across * np.float32(look.length)
        beside = slope * distance + self._lateral
        color, inside = look.sample(along, beside)
        shown = np.where(distance > 0, _filled(inside), 0)
        if self._lit is not None:
            shown = shown * self._lit[window]
        per_pixel = np.maximum(np.hypot(*np.gradient(angle)), 1e-9)
        part_shown = np.zeros_like(shown)
        for part in parts:
            pieces, here = geometry.pieces, np.ones_like(shown)
            limits = geometry.limits[pad, part]
            outward = np.sign(limits[1] - limits[0])
            # Where the pad itself ends, its outline gives the place.
            if pieces.start_label[pad, part] != FIRST_PAD_END:
                here *= np.clip(0.5 + outward * _turn(angle - limits[0]) / per_pixel, 0, 1)
            if pieces.end_label[pad, part] != SECOND_PAD_END:
                here *= np.clip(0.5 - outward * _turn(angle - limits[1]) / per_pixel, 0, 1)
            part_shown = np.maximum(part_shown, here)
        lamps = None
        if look.lamps is not None:
            lamps = look.sample_lamps(along, beside) * part_shown[..., None]
            lamps[distance <= 0] = 0
        if self._vignette is not None:
            color *= self._vignette[window][..., None]
        return shown * part_shown, color, lamps

    def _defocus(self, ends: Float[np.ndarray, "2 2"]) -> float:
        """Radius of the disc over which a view is spread, that of its middle, px; 0 if sharp."""
        if not self._effects.defocus:
            return 0.0
        distance = max(float(np.hypot(*ends.mean(axis=0))), 1.0)
        radius = self._effects.defocus * abs(1 / distance - 1 / FOCUS)
        return radius if radius > SHARPEST else 0.0

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
            )
        return self._looks[pad, imprints]

    def _vignetting(self) -> Float[np.ndarray, "rows columns"] | None:
        if not self._effects.vignetting:
            return None
        # The cosine of the angle from the axis.
        forward = np.cos(self._angle) / np.sqrt(1 + self._slope**2)
        return 1 - np.float32(self._effects.vignetting) * (1 - np.maximum(forward, 0))

    def _finger_inside(self) -> Float[np.ndarray, "rows columns 3"]:
        """What the finger's inside sends: nothing, leaks' light or the lamps', with broad blotches."""
        shape = self._angle.shape
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

    def _window(
        self, around: Float[np.ndarray, "places 2"], behind: bool, radius: float
    ) -> tuple[slice, slice]:
        """The part of the image that holds a view; all of it for one that passes the camera."""
        rows, columns = self._angle.shape
        if behind:
            return slice(0, rows), slice(0, columns)
        low = np.floor(around.min(axis=0) - radius) - BORDER
        high = np.ceil(around.max(axis=0) + radius) + BORDER + 1
        left, right = np.clip([low[0], high[0]], 0, columns).astype(int)
        top, bottom = np.clip([low[1], high[1]], 0, rows).astype(int)
        # A gradient needs two pixels each way.
        left, top = min(left, columns - 2), min(top, rows - 2)
        return slice(top, max(bottom, top + 2)), slice(left, max(right, left + 2))


@eqx.filter_jit
def _geometry(
    scene: Scene,
    imaging: Imaging,
    angles: Float[Array, " joints"],
    width: Float[Array, ""],
    beside: Float[Array, ""],
    lateral: Float[Array, ""],
    field_of_view: Float[Array, ""],
) -> _Geometry:
    # Corners of the image look beyond the field of view, which is that of the image line.
    wide = eqx.tree_at(lambda scene: scene.camera.field_of_view, scene, field_of_view)
    pieces = find_views(wide, angles).value
    outlines = find_outlines(scene, angles)
    around, behind = _places(imaging, outlines, beside, lateral)
    return _Geometry(
        pieces,
        wide.camera.angle(pieces.pixels),
        outlines.ends(),
        find_corners(imaging, outlines, width, lateral),
        around,
        behind,
    )


def _places(
    imaging: Imaging, outlines: Outlines, width: Float[Array, ""], lateral: Float[Array, ""]
) -> tuple[Float[Array, "paths pads places 2"], Bool[Array, "paths pads"]]:
    """Where a lattice of places of every pad is imaged, and whether any is behind a pinhole."""
    ends = outlines.ends()
    share = jnp.linspace(0.0, 1.0, ALONG_SIDE, dtype=ends.dtype)
    first, last = ends[..., :1, :], ends[..., 1:, :]
    line = first + share[None, None, :, None] * (last - first)
    distance = jnp.linalg.norm(line, axis=-1)[..., None]
    angle = jnp.arctan2(line[..., 1], line[..., 0])[..., None]
    slope = ((share - 0.5) * width - lateral)[None, None, None] / distance
    places = imaging.place(jnp.broadcast_to(angle, slope.shape), slope)
    # Only these image what is behind them elsewhere than where it lies.
    pinhole = isinstance(imaging.camera.projection, Pinhole | Orthographic)
    behind = jnp.any(line[..., 0] <= 0, axis=-1) & pinhole
    return places.reshape(*ends.shape[:2], -1, 2), behind


def _laid(
    light: Float[np.ndarray, "rows columns 3"],
    shown: Float[np.ndarray, "rows columns"],
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
        color = cv2.filter2D(shown[..., None] * color, -1, disc)
        shown = cv2.filter2D(shown, -1, disc)
        color /= np.maximum(shown, 1e-6)[..., None]
        lamps = None if lamps is None else cv2.filter2D(lamps, -1, disc)
    light += shown[..., None] * (color - light)
    if lamps is not None:
        light += lamps


def _grazing(ends: Float[np.ndarray, "2 2"]) -> float:
    """The flattest angle at which a whole pad is seen, rad: at one of its ends."""
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    rays = ends / np.hypot(*ends.T)[:, None]
    return float(np.arcsin(np.abs(rays[:, 0] * along[1] - rays[:, 1] * along[0])).min())


def _turn(angle: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns"]:
    """An angle by which to turn, from −π to π."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


def _filled(inside: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns"]:
    """Part of each pixel within an outline, from the distance inside it."""
    down, right = np.gradient(inside)
    steepness = np.sqrt(down * down + right * right)
    return np.clip(0.5 + inside / np.maximum(steepness, 1e-6), 0, 1)


def _touches_border(seen: np.ndarray) -> bool:
    return bool(seen[[0, -1]].any() or seen[:, [0, -1]].any())
