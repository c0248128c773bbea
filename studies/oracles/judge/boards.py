"""Pictures of a calibration board through a wide lens, and where its points truly are in them.

Mitsuba intersects the rays and looks the reflectance of what they meet up in bitmaps; the board is
matt and lit by its surroundings and a small lamp, by the inverse square law and Lambert's.
"""

from __future__ import annotations

import functools
import importlib
import math
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np

from studies.oracles.judge.capture import Capture, expose
from studies.oracles.judge.engine import load_mitsuba
from studies.oracles.judge.wide_lens import WideLens, random_lens

__all__ = [
    "Board", "BoardPicture", "Conditions", "Pose", "WideLens", "photograph_board",
    "random_conditions", "random_lens", "random_pose",
]  # fmt: skip

FINEST = 40
"""Fewest pixels of a board's bitmap per mm; edges are ramps as wide as one."""

BLACK, WHITE = 0.05, 0.85
"""Reflectance of print and paper."""

ROOM = 150.0
"""Half the side of the room around the board, mm."""

CLUTTER = 512
"""Pixels along a wall's bitmap."""

SAMPLES = 6
"""Rays through a pixel at an edge, in each direction."""

CHUNK = 10_000
"""Such pixels at a time."""

STEP = 0.04
"""A pixel is at an edge where the light at its corners differs by more."""

NEAREST, FARTHEST = 15.0, 60.0
"""Of random boards, from the pupil to their middle, mm."""

STEEPEST = math.radians(60)
"""Of random boards, between their normal and the line of sight."""


class Board(NamedTuple):
    """A printed board: x to the right, y down, z into the paper, from its upper left corner, mm.

    Attributes:
        kind: "charuco" is a chessboard with markers in its white squares, of which the inner
            corners of squares are points; "tags" is a grid of markers, whose corners are.
        columns: of squares or of markers.
        rows: of them.
        square: from one column to the next, mm.
        marker: side of a marker, mm.
        dictionary: name in `cv2.aruco`.
    """

    kind: Literal["charuco", "tags"] = "charuco"
    columns: int = 8
    rows: int = 6
    square: float = 3.0
    marker: float = 2.25
    dictionary: str = "DICT_4X4_100"

    def made(self) -> Any:
        """OpenCV's `CharucoBoard` or `GridBoard`, in mm."""
        words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        count = self.columns, self.rows
        if self.kind == "charuco":
            return cv2.aruco.CharucoBoard(count, self.square, self.marker, words)
        return cv2.aruco.GridBoard(count, self.marker, self.square - self.marker, words)

    @property
    def extent(self) -> np.ndarray:
        """Width and height without the paper's margin, mm."""
        gap = 0.0 if self.kind == "charuco" else self.square - self.marker
        return np.array([self.columns, self.rows]) * self.square - gap

    @property
    def points(self) -> np.ndarray:
        """Points (x, y, 0) in OpenCV's order, mm, shape (points, 3).

        They are corners of squares, or the four of each marker, clockwise from its upper left one.
        """
        made = self.made()
        corners = made.getChessboardCorners() if self.kind == "charuco" else made.getObjPoints()
        return np.asarray(corners, float).reshape(-1, 3)

    @property
    def margin(self) -> float:
        """Width of the white paper around it, mm."""
        return self.square / 2

    def bitmap(self) -> tuple[np.ndarray, float]:
        """Gray levels of the paper, whose corner is at minus the margin, and pixels per mm.

        All edges of squares and markers are edges of pixels.

        Raises:
            ValueError: no fine bitmap has them all there.
        """
        words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        cells, least = words.markerSize + 2, math.ceil(FINEST * self.square)
        for pitch in range(least + least % 2, 5 * least, 2):
            side = pitch * self.marker / self.square
            if abs(side - round(side)) < 1e-6 and round(side) % cells == round(side) % 2 == 0:
                break
        else:
            raise ValueError(f"marker / square is no ratio of small numbers: {self}")
        scale = pitch / self.square
        width, height = np.rint(self.extent * scale).astype(int).tolist()
        print_ = self.made().generateImage((width, height), None, 0, 1)
        return np.pad(print_, pitch // 2, constant_values=255), scale


class Pose(NamedTuple):
    """Of a board before a lens: a point p of the board is at rotation p + translation, mm.

    Attributes:
        rotation: shape (3, 3).
        translation: shape (3,), mm.
    """

    rotation: np.ndarray
    translation: np.ndarray

    def places(self, lens: WideLens, points: np.ndarray) -> np.ndarray:
        """Where points of the board are imaged: column and row, NaN where they are not."""
        return lens.project(points @ self.rotation.T + self.translation)


class Conditions(NamedTuple):
    """Light on the board, and how the picture is taken.

    Attributes:
        lamp: place of a small lamp in the camera's frame, mm.
        share: of the light at the board's middle, what comes from the lamp; the rest comes evenly
            from everywhere.
        walls: brightness of the room, of that of white paper.
        vignetting: what the image loses towards its largest angle, as the angle's square.
        capture: exposure, blur, noise, gamma and JPEG.
    """

    lamp: tuple[float, float, float] = (8.0, -3.0, 0.0)
    share: float = 0.5
    walls: float = 0.3
    vignetting: float = 0.3
    capture: Capture = Capture()


class BoardPicture(NamedTuple):
    """A picture and its truth.

    Attributes:
        pixels: gray levels, 8 bits, shape (rows, columns).
        places: column and row of every point of the board, shape (points, 2), NaN where it is not
            in the image.
    """

    pixels: np.ndarray
    places: np.ndarray


def random_pose(generator: np.random.Generator, lens: WideLens, board: Board) -> Pose:
    """A board somewhere in the image, turned and tilted, with a quarter of its points imaged."""
    middle = np.append(board.extent / 2, 0.0)
    while True:
        angle, azimuth = generator.random() * lens.largest, generator.uniform(0, 2 * math.pi)
        tilt, toward = STEEPEST * generator.random(), generator.uniform(0, 2 * math.pi)
        turn = _turned(2, azimuth) @ _turned(1, angle)
        sight = turn[:, 2]
        turn = turn @ _turned(2, toward) @ _turned(1, tilt)
        turn = turn @ _turned(2, generator.uniform(0, 2 * math.pi))
        distance = generator.uniform(NEAREST, FARTHEST)
        pose = Pose(turn, distance * sight - turn @ middle)
        seen = np.isfinite(pose.places(lens, board.points)[:, 0])
        if 4 * np.count_nonzero(seen) >= len(seen):
            return pose


def random_conditions(generator: np.random.Generator) -> Conditions:
    """Uneven light, and what cameras do: blur, noise, gamma and JPEG."""
    around, aside = generator.uniform(0, 2 * math.pi), generator.uniform(5, 30)
    lamp = aside * math.cos(around), aside * math.sin(around), generator.uniform(-5, 2)
    capture = Capture(
        exposure=generator.uniform(0.6, 0.95),
        gamma=float(generator.choice([1.0, 2.2])),
        noise=generator.uniform(0.005, 0.015),
        blur=generator.uniform(0.4, 1.0),
        jpeg=int(generator.integers(80, 101)) if generator.random() < 0.7 else None,
    )
    share, walls, vignetting = generator.uniform((0.0, 0.02, 0.1), (0.8, 0.6, 0.7)).tolist()
    return Conditions(lamp, share, walls, vignetting, capture)


def photograph_board(
    lens: WideLens, board: Board, pose: Pose, conditions: Conditions, seed: int
) -> BoardPicture:
    """Take a picture.

    Args:
        lens: the camera.
        board: its bitmap is kept for its next pictures.
        pose: of the board, its print towards the lens.
        conditions: light and capture.
        seed: of the noise, and of rays within pixels.

    Raises:
        ModuleNotFoundError: Mitsuba is not installed.
        RuntimeError: there is no LLVM for it, without which a picture takes minutes.
    """
    generator, lit = np.random.default_rng(seed), _LitBoard(board, pose, conditions)
    columns, rows = lens.size
    inside, ways, shifts, fading = _sights(lens)
    corners, paper = np.zeros((2, rows + 1, columns + 1), np.float32)
    corners[inside], paper[inside] = lit.light(ways, shifts)
    # Of pixels with the same light at all corners, that is taken.
    four = np.stack(_of_pixels(corners))
    light, sheet = four.mean(axis=0), np.any(_of_pixels(paper), axis=0)
    edges = np.argwhere(sheet & (np.ptp(four, axis=0) > STEP))
    # Of others the mean, of one ray somewhere in each of the squares of a pixel.
    square = np.stack(np.meshgrid(*2 * [np.arange(SAMPLES)]), axis=-1).reshape(-1, 2)
    for part in np.array_split(edges, len(edges) // CHUNK + 1):
        within = (square + generator.random((len(part), SAMPLES**2, 2))) / SAMPLES - 0.5
        values = lit.at(lens, (part[:, None, ::-1] + within).reshape(-1, 2))
        light[tuple(part.T)] = values.reshape(-1, SAMPLES**2).mean(axis=-1)
    light *= conditions.capture.exposure * (1 - conditions.vignetting * fading)
    pixels = expose(light, np.ones(()), conditions.capture, generator)
    return BoardPicture(pixels, pose.places(lens, board.points))


class _LitBoard:
    """A board in a room, in its own frame, and its light."""

    def __init__(self, board: Board, pose: Pose, conditions: Conditions) -> None:
        self._scene, self._pose, self._conditions = _scene(board), pose, conditions
        self._lamp = (np.array(conditions.lamp) - pose.translation) @ pose.rotation
        low, high = -board.margin, board.extent + board.margin
        nearest = np.append(np.clip(self._lamp[:2], low, high), 0.0)
        self._least = float(np.linalg.norm(self._lamp - nearest))

    def at(self, lens: WideLens, places: np.ndarray) -> np.ndarray:
        """What reaches places of the image, shape (places,)."""
        ways, shifts = lens.sight(places)
        seen, found = np.isfinite(shifts), np.zeros(len(places), np.float32)
        if seen.any():  # Dr.Jit ends the process without rays
            found[seen], _ = self.light(ways[seen], shifts[seen])
        return found

    def light(self, ways: np.ndarray, shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What rays in the camera's frame bring, and whether it comes from the paper.

        White paper brings 1 where it is brightest.
        """
        # Vectors in the board's frame have the shape (3, rays), thrice as fast as (rays, 3).
        turn = self._pose.rotation.T.astype(np.float32)
        pupil = (self._pose.rotation.T @ self._pose.translation).astype(np.float32)
        ways = turn @ ways.astype(np.float32).T
        begin = turn[:, 2:] * shifts.astype(np.float32) - pupil[:, None]
        reflectance, distance, paper = _meet(*self._scene, begin, ways)
        share = self._conditions.share
        light = reflectance * (self._conditions.walls / WHITE)
        place = begin[:, paper] + distance[paper] * ways[:, paper]
        far = np.linalg.norm(place - self._lamp[:, None].astype(np.float32), axis=0)
        # Cosine by square: its height over the paper's plane by the distance's third power.
        lamp = (self._least / far) ** 3 if self._lamp[2] < 0 else 0.0
        light[paper] = reflectance[paper] / WHITE * (1 - share + share * lamp)
        return light, paper


def _meet(
    scene: Any, sheet: Any, begin: np.ndarray, ways: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reflectance and distance of what rays meet, and whether that is the sheet.

    Where rays begin, and unit vectors, have the shape (3, rays).
    """
    mi, dr = load_mitsuba(), importlib.import_module("drjit")
    start, way = ([mi.Float(np.ascontiguousarray(one)) for one in v] for v in (begin, ways))
    met = scene.ray_intersect(mi.Ray3f(mi.Point3f(*start), mi.Vector3f(*way)))
    reflectance = met.bsdf().eval_diffuse_reflectance(met)[0, 0][0]
    number = dr.reinterpret_array(mi.UInt32, met.shape)
    dr.eval(reflectance, met.t, number)
    own = int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(sheet))[0])
    return np.array(reflectance), np.array(met.t), np.array(number) == own


@functools.lru_cache(maxsize=4)
def _scene(board: Board) -> tuple[Any, Any]:
    """The board's sheet in a room around it, in the board's frame, and the sheet alone."""
    mi = load_mitsuba()
    if mi.variant().startswith("scalar"):
        raise RuntimeError("pictures of boards need LLVM 16 or newer for Mitsuba")
    print_, _ = board.bitmap()
    width, height = board.extent
    sheet = np.diag([width / 2 + board.margin, height / 2 + board.margin, 1.0, 1.0])
    room = np.diag([ROOM, ROOM, ROOM, 1.0])
    for one in sheet, room:
        one[:2, 3] = width / 2, height / 2
    levels = BLACK + (WHITE - BLACK) / 255 * print_.astype(np.float32)

    def shape(kind: str, to_world: np.ndarray, levels: np.ndarray) -> dict[str, Any]:
        bitmap = {"type": "bitmap", "data": mi.TensorXf(levels[..., None]), "raw": True}
        bitmap["wrap_mode"] = "clamp"
        bsdf = {"type": "diffuse", "reflectance": bitmap}
        return {"type": kind, "to_world": mi.ScalarTransform4f(to_world), "bsdf": bsdf}

    paper = mi.load_dict(shape("rectangle", sheet, levels))
    walls = shape("cube", room, _clutter())
    return mi.load_dict({"type": "scene", "sheet": paper, "room": walls}), paper


def _clutter() -> np.ndarray:
    """A wall's reflectance: gray, with rectangles of other grays and some texture."""
    generator = np.random.default_rng(0)
    wall = np.full((CLUTTER, CLUTTER), 0.5, np.float32)
    for level in generator.uniform(0.05, 0.95, 60):
        low, size = generator.integers(0, CLUTTER, 2), generator.integers(8, CLUTTER // 4, 2)
        cv2.rectangle(wall, low.tolist(), (low + size).tolist(), float(level), -1)
    wall += 0.05 * cv2.GaussianBlur(generator.standard_normal(wall.shape, np.float32), (0, 0), 2)
    return np.clip(wall, 0.0, 1.0)


@functools.lru_cache(maxsize=1)
def _sights(lens: WideLens) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rays of the corners of pixels.

    Returns:
        Which have one, shape (rows + 1, columns + 1); the rays' directions and pupils; and of
        pixels (θ / largest)², shape (rows, columns).
    """
    columns, rows = lens.size
    grid = np.stack(np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)), axis=-1) - 0.5
    ways, shifts = lens.sight(grid.reshape(-1, 2))
    inside = np.isfinite(shifts)
    angles = np.arccos(np.clip(np.where(inside, ways[:, 2], -1), -1, 1)).reshape(grid.shape[:2])
    fading = np.minimum(np.mean(_of_pixels(angles), axis=0) / lens.largest, 1) ** 2
    ways, shifts = ways[inside].astype(np.float32), shifts[inside].astype(np.float32)
    return inside.reshape(grid.shape[:2]), ways, shifts, fading.astype(np.float32)


def _of_pixels(corners: np.ndarray) -> list[np.ndarray]:
    """The four corners of pixels."""
    return [corners[i : i - 1 or None, j : j - 1 or None] for i in (0, 1) for j in (0, 1)]


def _turned(axis: int, angle: float) -> np.ndarray:
    """A rotation about an axis of the frame."""
    vector = np.zeros(3)
    vector[axis] = angle
    return cv2.Rodrigues(vector)[0]
