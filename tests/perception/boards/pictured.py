"""Pictures of boards through wide lenses whose points are known without the code that finds them.

The board is OpenCV's own drawing. Rays of a lens with a textbook projection, whose entrance pupil
moves along the axis, are intersected with its plane, sixteen of each pixel.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import cv2
import numpy as np

LENSES = {
    "equidistant": (lambda angle: angle, lambda height: height),
    "equisolid": (lambda angle: 2 * np.sin(angle / 2), lambda height: 2 * np.arcsin(height / 2)),
    "stereographic": (
        lambda angle: 2 * np.tan(angle / 2),
        lambda height: 2 * np.arctan(height / 2),
    ),
}
"""Image height in focal lengths at an angle from the axis, and the inverse."""

WIDEST = 1.8
"""Of angles, rad."""

MARGIN = 3.0
"""White around a board, mm."""

BLACK, WHITE, WALL = 0.05, 0.85, 0.3


class Print(NamedTuple):
    """A board as OpenCV draws it; every edge of its modules is a multiple of 1 / density mm."""

    kind: str
    columns: int
    rows: int
    square: float
    marker: float
    words: str
    density: int

    @property
    def made(self) -> Any:
        words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.words))
        size = self.columns, self.rows
        if self.kind == "charuco":
            return cv2.aruco.CharucoBoard(size, self.square, self.marker, words)
        return cv2.aruco.GridBoard(size, self.marker, self.square - self.marker, words)

    @property
    def size(self) -> np.ndarray:
        """Width and height, mm."""
        gap = 0.0 if self.kind == "charuco" else self.square - self.marker
        return np.array([self.columns, self.rows]) * self.square - gap

    @property
    def points(self) -> np.ndarray:
        """Inner corners, or those of markers, mm."""
        made = self.made
        found = made.getChessboardCorners() if self.kind == "charuco" else made.getObjPoints()
        return np.asarray(found, float).reshape(-1, 3)[:, :2]

    def drawn(self, density: int) -> np.ndarray:
        """OpenCV's drawing of the board alone."""
        return self.made.generateImage(np.rint(self.size * density).astype(int).tolist(), None, 0)


CHARUCO = Print("charuco", 12, 9, 5.0, 3.75, "DICT_4X4_100", 40)
TAGS = Print("apriltag", 8, 6, 6.0, 4.8, "DICT_APRILTAG_36h11", 40)


class View(NamedTuple):
    """A lens and a board before it: a point p of the board is at turn p + place, mm.

    The pupil of rays at an angle is `pupil` times its square before that along the axis, mm.
    """

    lens: str = "equidistant"
    half_field: float = np.radians(80)
    size: tuple[int, int] = (480, 360)
    pupil: float = 0.8
    turn: np.ndarray = np.eye(3)
    place: tuple[float, float, float] = (-30.0, -22.0, 25.0)

    @property
    def focal(self) -> float:
        """Such that the field fills the image's diagonal, px."""
        return np.hypot(*self.size) / 2 / LENSES[self.lens][0](self.half_field)

    @property
    def middle(self) -> np.ndarray:
        return (np.array(self.size) - 1) / 2 + [3.2, -2.1]

    def sight(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions of rays, and how far before the pupil of the axis they pass it."""
        offsets = places - self.middle
        radius = np.hypot(*np.moveaxis(offsets, -1, 0))
        angle = LENSES[self.lens][1](radius / self.focal)
        share = np.sin(angle) / np.maximum(radius, 1e-12)
        ways = np.concatenate([share[..., None] * offsets, np.cos(angle)[..., None]], axis=-1)
        return ways, self.pupil * angle**2

    def places(self, points: np.ndarray) -> np.ndarray:
        """Where points of the board are imaged: the ray at an angle is found by bisection."""
        space = points @ self.turn[:, :2].T + self.place
        across = np.hypot(*space.T[:2])
        low, high = np.zeros(len(space)), np.full(len(space), WIDEST)
        angle = low
        for _ in range(60):
            angle = (low + high) / 2
            beyond = across * np.cos(angle) < (space[:, 2] - self.pupil * angle**2) * np.sin(angle)
            low, high = np.where(beyond, low, angle), np.where(beyond, angle, high)
        share = self.focal * LENSES[self.lens][0](angle) / np.maximum(across, 1e-12)
        return self.middle + share[:, None] * space[:, :2]

    def board(self, places: np.ndarray) -> np.ndarray:
        """Which point of the board's plane is seen, mm; far outside where none is."""
        ways, shifts = self.sight(places)
        normal = self.turn[:, 2]
        along = ways @ normal
        far = (np.dot(self.place, normal) - shifts * normal[2]) / np.where(along > 0, along, 1)
        hits = far[..., None] * ways - self.place
        hits[..., 2] += shifts
        return np.where((along > 0.02)[..., None], hits @ self.turn[:, :2], 1e6)


def turned(tilt: float, toward: float, roll: float) -> np.ndarray:
    """A rotation that tilts a board's z axis from that of the camera, all in degrees."""
    axis = np.array([np.cos(np.radians(toward)), np.sin(np.radians(toward)), 0])
    tilted, _ = cv2.Rodrigues(np.radians(tilt) * axis)
    rolled, _ = cv2.Rodrigues(np.array([0, 0, np.radians(roll)]))
    return tilted @ rolled


def before(view: View, printed: Print, off: float, distance: float, turn: np.ndarray) -> View:
    """The view with the board's middle at an angle off the axis (degrees), towards lesser rows."""
    side = np.radians(off)
    middle = distance * np.array([0.3 * np.sin(side), -np.sin(side), np.cos(side)])
    faced, _ = cv2.Rodrigues(np.array([side, 0.0, 0.0]))
    whole = faced @ turn
    place = middle - whole @ np.append(printed.size / 2, 0)
    return view._replace(turn=whole, place=tuple(place.tolist()))


@functools.lru_cache(maxsize=4)
def _drawn(printed: Print) -> np.ndarray:
    return printed.drawn(printed.density)


def picture(
    view: View,
    printed: Print,
    *,
    blur: float = 0.7,
    noise: float = 0.01,
    gamma: float = 1.0,
    vignetting: float = 0.4,
    jpeg: int | None = None,
) -> np.ndarray:
    """A picture: blur in px, noise and vignetting as shares of the brightest light."""
    columns, rows = view.size
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(float)
    low, high = np.full(2, -MARGIN), printed.size + MARGIN

    def on_paper(seen: np.ndarray) -> np.ndarray:
        return np.all((seen > low) & (seen < high), axis=-1)

    light = np.full((rows, columns), WALL)
    near = cv2.dilate(on_paper(view.board(grid)).astype(np.uint8), np.ones((5, 5))) > 0
    total, image = np.zeros(np.count_nonzero(near)), _drawn(printed)
    for shift in np.stack(np.meshgrid(*2 * [(np.arange(4) - 1.5) / 4]), axis=-1).reshape(-1, 2):
        seen = view.board(grid[near] + shift)
        paper = on_paper(seen)
        texels = np.floor(np.where(paper[:, None], seen, 0) * printed.density).astype(int)
        texels = texels[:, ::-1]
        inked = paper & (texels >= 0).all(axis=1) & (texels < image.shape).all(axis=1)
        levels = np.where(paper, WHITE, WALL)
        levels[inked] = np.where(image[tuple(texels[inked].T)] > 0, WHITE, BLACK)
        total += levels
    light[near] = total / 16
    radius = np.hypot(*np.moveaxis(grid - view.middle, -1, 0)) / np.hypot(columns, rows) * 2
    light = cv2.GaussianBlur(light * (1 - vignetting * radius**2), (0, 0), blur)
    light = np.maximum(light, 0) ** (1 / gamma)
    light = light + noise * np.random.default_rng(0).standard_normal(light.shape)
    codes = np.rint(255 * np.clip(light, 0, 1)).astype(np.uint8)
    if jpeg is not None:
        _, stream = cv2.imencode(".jpg", codes, [cv2.IMWRITE_JPEG_QUALITY, jpeg])
        codes = np.asarray(cv2.imdecode(stream, cv2.IMREAD_GRAYSCALE))
    return codes
