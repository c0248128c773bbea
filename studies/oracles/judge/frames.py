"""What the judge finds in one frame: corners, views down the middle column, and what is covered."""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import os
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from studies.oracles.judge.fabrication import Channel, Errors, fabricated, of_channel
from studies.oracles.judge.lens import Lens
from studies.oracles.judge.solids import WIDTH, Pose, Tables, motion_of
from studies.oracles.judge.tracing import Traced, Tracer, path_of

ASPECT = 4 / 3
"""Columns of an image over its rows."""

COARSE = 8.0
"""Step of the grid on which the views of a pad are looked for, px."""

SPARE = 1.5
"""Surfaces of a pad that is alone go on so far beyond their edges, mm."""

STENCIL = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4)), axis=-1).reshape(-1, 2) * 0.5
"""Places around a corner at which membrane coordinates are traced, px: 49 rays average their
rounding, and a quadratic over 3 px leaves less of the map than they do."""

ROUNDS, STEP, TRUSTED, SETTLED, ASTRAY, FEWEST = 8, 40.0, 3.0, 1e-3, 0.01, 12
"""Newton's method on such quadratics: iterations, its longest step, how far a quadratic is trusted,
from which step on no more is needed and with which last one no place was found (px), and the fewest
rays for one."""

INSET = 0.005
"""A corner is seen if a ray beside it, so far inside the membrane (mm), is."""

FAN = 0.2
"""Step of the fan of rays down the middle column, px; what is narrower is not found."""

PARTS, REFINEMENTS = 8, 5
"""A step of the fan is divided so often into so many parts: to 6e-6 px, float32's rounding of a
direction."""


AT_END = 1e-5
"""Membrane coordinates so near 0 and 1 are the ends of a membrane."""


class Corner(NamedTuple):
    """One corner of a membrane, seen through the outermost surface.

    Attributes:
        pad: its name.
        path: names of the mirrors on the way, joined by "+"; empty without any.
        end: 0 at the membrane's end "from", 1 at "to".
        side: −1 or 1, where columns grow with it.
        place: column and row.
        residual: of the fit about it, px: the noise of a single ray.
    """

    pad: str
    path: str
    end: int
    side: int
    place: list[float]
    residual: float


class View(NamedTuple):
    """A stretch of the middle column in which one membrane is seen by one path.

    Attributes:
        pad: its name.
        path: names of the mirrors on the way, joined by "+"; empty without any.
        entrance: the face by which light enters the pad; empty where it has no layers.
        rows: of its two ends.
        along: membrane coordinates there, 0 to 1.
        bounds: what is beyond them.
    """

    pad: str
    path: str
    entrance: str
    rows: list[float]
    along: list[float]
    bounds: list[str]


class Frame(NamedTuple):
    """A judged frame.

    Attributes:
        corners: those that are seen.
        views: down the middle column, by rows.
        coverage: by the pads' names.
        seconds: what it took.
    """

    corners: list[Corner]
    views: list[View]
    coverage: dict[str, float]
    seconds: float


def judge(
    tables: Tables, pose: Pose, errors: Errors | None = None, channel: Channel = "green"
) -> Frame:
    """Judge a frame.

    Args:
        tables: of a scene file, as `tomllib` gives them.
        pose: joint angles, degrees; those not named are 0.
        errors: of fabrication, if there are any.
        channel: whose light is followed.
    """
    began = time.perf_counter()
    tables = of_channel(fabricated(tables, errors) if errors else tables, channel)
    camera = tables["camera"]
    lens = Lens.of(camera, motion_of(tables, pose, camera.get("body", "world")), ASPECT)
    tracer = Tracer(tables, pose, lens.position)
    corners = [
        corner
        for pad in range(len(tables.get("pads", [])))
        for corner in _find_corners(tables, pose, lens, tracer, pad)
    ]
    views = _find_views(tables, lens, tracer)
    names = [pad["name"] for pad in tables.get("pads", [])]
    covered = {name: union([view.along for view in views if view.pad == name]) for name in names}
    return Frame(corners, views, covered, time.perf_counter() - began)


def picture(tables: Tables, pose: Pose, step: float) -> np.ndarray:
    """The light from membranes that reaches the camera, 0 to 1, at every so many pixels.

    That of a bare pad is 1, and 0 where the ray reaches no membrane.
    """
    camera = tables["camera"]
    lens = Lens.of(camera, motion_of(tables, pose, camera.get("body", "world")), ASPECT)
    columns, rows = np.arange(0, lens.columns, step), np.arange(0, lens.rows, step)
    places = np.stack(np.meshgrid(columns, rows), axis=-1)
    traced = Tracer(tables, pose, lens.position).trace(*lens.sight(places.reshape(-1, 2)))
    return np.where(traced.reached, traced.transmission, 0.0).reshape(places.shape[:2])


def judge_once(tables: Tables, pose: Pose, folder: Path) -> Frame:
    """`judge`, or what it found of the same tables and pose before, kept in a folder."""
    asked = json.dumps([tables, pose], sort_keys=True).encode()
    path = folder / f"{hashlib.sha256(sources() + asked).hexdigest()}.json"
    with suppress(OSError, ValueError, TypeError):  # none, or not what was written
        corners, views, *others = json.loads(path.read_text(encoding="utf-8"))
        return Frame([Corner(*one) for one in corners], [View(*one) for one in views], *others)
    frame = judge(tables, pose)
    with tempfile.NamedTemporaryFile("w", dir=folder, delete=False, encoding="utf-8") as file:
        json.dump(frame, file)
    os.replace(file.name, path)
    return frame


@functools.cache
def sources() -> bytes:
    """The judge itself: a frame that another one has judged is judged again."""
    own = (path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))
    return b"".join([*own, version("mitsuba").encode()])


def union(intervals: Sequence[Sequence[float]]) -> float:
    """Measure of a union of intervals."""
    covered, reach = 0.0, 0.0
    for low, high in sorted((min(one), max(one)) for one in intervals):
        covered += max(high - max(low, reach), 0.0)
        reach = max(reach, high)
    return covered


def _find_corners(
    tables: Tables, pose: Pose, lens: Lens, whole: Tracer, index: int
) -> list[Corner]:
    """All corners of a pad that are seen in the image, by every path.

    They are solved for where the pad is alone and without edges, so that rays on both sides of a
    corner reach the membrane's plane.
    """
    pad, alone = tables["pads"][index], Tracer(tables, pose, lens.position, index, SPARE)
    length, half = alone.pads[index].length, pad.get("width", WIDTH) / 2
    columns, rows = np.arange(0, lens.columns, COARSE), np.arange(0, lens.rows, COARSE)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    seen = alone.trace(*lens.sight(grid))
    asked, insets, guesses = [], [], []
    for word in np.unique(seen.word[seen.reached]).tolist():
        mine = seen.reached & (seen.word == word)
        for end, side in itertools.product((0, 1), (-1, 1)):
            away = np.hypot(seen.along - end * length, seen.across - side * half)
            asked.append((word, end, side))
            insets.append(((1 - 2 * end) * INSET, -side * INSET))
            guesses.append(grid[np.argmin(np.where(mine, away, np.inf))])
    if not asked:
        return []
    words, ends, sides = np.array(asked).T
    wanted = np.stack([ends * length, sides * half], axis=-1)
    solved = find_places(alone, lens, words, np.array(guesses), wanted, np.array(insets))
    places, beside, residuals = solved
    check = whole.trace(*lens.sight(beside))
    there = check.reached & (check.word == words) & (check.pad == index) & ~whole.by_end(check)
    there &= np.all((places >= 0) & (places <= (lens.columns - 1, lens.rows - 1)), axis=-1)
    numbers = zip(asked, places.tolist(), residuals.tolist(), strict=True)
    return [
        Corner(pad["name"], path_of(tables, word), end, side, place, residual)
        for ((word, end, side), place, residual), ok in zip(numbers, there, strict=True)
        if ok
    ]


def find_places(
    alone: Tracer, lens: Lens, words: np.ndarray, places: np.ndarray, wanted: np.ndarray,
    insets: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Places that show the wanted membrane coordinates, those of insets, and the fits' residuals.

    All are NaN where rays do not get there: where too few do for a quadratic, or so few, on one
    side of the place only, that it still moves after all rounds.
    """
    u, v = STENCIL.T
    basis = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    beside, residuals = np.full_like(places, np.nan), np.full(len(places), np.nan)
    before = places
    for _ in range(ROUNDS):
        before = places.copy()
        traced = alone.trace(*lens.sight((places[:, None] + STENCIL).reshape(-1, 2)))
        shape = len(places), len(STENCIL)
        valid = (traced.reached & (traced.word == np.repeat(words, shape[1]))).reshape(shape)
        on = np.stack([traced.along, traced.across], axis=-1).reshape(*shape, 2)
        for i, ok in enumerate(valid):
            if ok.sum() < FEWEST:
                places[i] = beside[i] = residuals[i] = np.nan
                continue
            fit = np.linalg.lstsq(basis[ok], on[i, ok])[0]
            off = on[i, ok] - basis[ok] @ fit
            scale = np.sqrt(abs(np.linalg.det(fit[1:3])))  # mm per px
            residuals[i] = np.sqrt(np.mean(off * off)) / scale
            beside[i] = places[i] + _invert(fit, wanted[i] + insets[i])
            places[i] = places[i] + _invert(fit, wanted[i])
        if np.all((np.abs(places - before) < SETTLED) | np.isnan(places)):
            break
    astray = np.any(np.abs(places - before) > ASTRAY, axis=-1)
    places[astray] = beside[astray] = residuals[astray] = np.nan
    return places, beside, residuals


def _invert(fit: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Where a quadratic has a value, from its slopes; far away, one step of Newton's method."""
    back = np.linalg.inv(fit[1:3])
    step = (wanted - fit[0]) @ back
    if np.linalg.norm(step) > TRUSTED:
        return step * min(1.0, STEP / np.linalg.norm(step))
    for _ in range(5):
        u, v = step
        step = (wanted - fit[0] - np.array([u * u, u * v, v * v]) @ fit[3:]) @ back
    return step


def _find_views(tables: Tables, lens: Lens, tracer: Tracer) -> list[View]:
    """Views down the middle column, from the first row to the last."""
    middle, _ = lens.middle

    def trace(rows: np.ndarray) -> tuple[Traced, np.ndarray]:
        places = np.stack([np.full(len(rows), middle), rows], axis=-1)
        traced = tracer.trace(*lens.sight(places))
        return traced, traced.labels()

    rows = np.linspace(-0.5, lens.rows - 0.5, round(lens.rows / FAN) + 1)[1:-1]
    traced, labels = trace(rows)
    changes = np.flatnonzero(np.any(labels[1:] != labels[:-1], axis=-1))
    firsts, lasts = np.append(0, changes + 1), np.append(changes, len(rows) - 1)
    kept = traced.seen[firsts]
    firsts, lasts = firsts[kept], lasts[kept]
    # A view's ends lie between its outermost ray and the next one, which is of another view.
    inner = np.concatenate([rows[firsts], rows[lasts]])
    own = np.concatenate([labels[firsts], labels[lasts]])
    outer = np.concatenate([rows[firsts] - FAN, rows[lasts] + FAN])
    outer = np.clip(outer, -0.5, lens.rows - 0.5)
    for _ in range(REFINEMENTS):
        step = (outer - inner) / PARTS
        between = inner[:, None] + step[:, None] * np.arange(1, PARTS)
        of_rays = trace(between.ravel())[1].reshape(*between.shape, -1)
        same = np.all(of_rays == own[:, None], axis=-1)
        # Up to the first ray that shows something else.
        inner = inner + step * np.sum(np.logical_and.accumulate(same, axis=1), axis=1)
        outer = inner + step
    within, beyond = trace(inner)[0], trace(outer)[0]
    pads, limit = tables.get("pads", []), (lens.rows - 0.001) / 2
    along = within.along / np.array([frame.length for frame in tracer.pads])[within.pad]

    def bound(end: int) -> str:
        if abs(outer[end] - (lens.rows - 1) / 2) > limit:
            return "limit of the image"
        if abs(along[end] - 0.5) > 0.5 - AT_END:
            return "end of the pad"
        if beyond.seen[end]:
            return f"pad {pads[beyond.pad[end]]['name']}"
        return tracer.describe(int(beyond.end[end]))

    def view(first: int, last: int) -> View:
        pad, word, entrance, _ = own[first].tolist()
        through, both = tracer.describe(entrance) if entrance >= 0 else "", [first, last]
        numbers = inner[both].tolist(), along[both].tolist()
        name = pads[pad]["name"]
        return View(name, path_of(tables, word), through, *numbers, [bound(end) for end in both])

    return [view(i, i + len(firsts)) for i in range(len(firsts))]
