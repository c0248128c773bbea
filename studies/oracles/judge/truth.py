"""What is truly in a picture: where membranes' corners are, and which membranes are seen whole."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from studies.oracles.judge.capture import Capture
from studies.oracles.judge.contacts import Contacts
from studies.oracles.judge.fabrication import CHANNELS, of_channel
from studies.oracles.judge.frames import ASPECT, INSET, SPARE, find_places
from studies.oracles.judge.lens import Lens
from studies.oracles.judge.solids import WIDTH, Pose, Tables, motion_of
from studies.oracles.judge.tracing import Tracer, path_of

STEP = 4.0
"""Of the grid on which what is shown is looked for, px."""

ON_EDGE, WITHIN = 13, 6
"""Places along each edge of a membrane, and rows and columns of places in it, that must be seen."""

BORDER = 1.0
"""So near the image's border a place is not in it, px."""

ENDS = tuple(itertools.product((0, 1), (-1, 1)))
"""Of a membrane, and sides across: its corners in their order."""


class ViewTruth(NamedTuple):
    """A pad by a path that shows something of it.

    Attributes:
        pad: its name.
        path: names of the mirrors as light from the camera meets them, joined by "+".
        corners: columns and rows of the flat membrane's, in the order of `ENDS`: "from" at lesser
            and at greater columns' side, "to" at both; NaN where no ray gets there. Green light.
        seen: whether each is, in the image.
        whole: whether all corners, and places along all edges and within, are.
        channels: corners in red, green and blue light.
        grazing: least sine of the angle between rays and the outermost surface.
        transmission: least part of the light that comes through.
        lifted: how far what is pressed in lifts each corner, mm.
    """

    pad: str
    path: str
    corners: list[list[float]]
    seen: list[bool]
    whole: bool
    channels: list[list[list[float]]]
    grazing: float
    transmission: float
    lifted: list[float]


def find_view_truths(tables: Tables, pose: Pose, capture: Capture) -> list[ViewTruth]:
    """All pads by all paths that show something of them through their outermost surfaces."""
    scenes = [of_channel(tables, channel) for channel in CHANNELS]
    camera = tables["camera"]
    motion = motion_of(tables, pose, camera.get("body", "world"))
    lenses = [Lens.of(scene["camera"], motion, ASPECT) for scene in scenes]
    lens, contacts = lenses[1], Contacts(tables, capture.contacts)
    whole = Tracer(scenes[1], pose, lens.position, lamps=capture.light == "lamps")
    columns, rows = np.arange(0, lens.columns, STEP), np.arange(0, lens.rows, STEP)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    seen = whole.trace(*lens.sight(grid))
    top = seen.reached & ~whole.by_end(seen)
    found = []
    for index, pad in enumerate(tables.get("pads", [])):
        words = np.unique(seen.word[top & (seen.pad == index)]).tolist()
        if not words:
            continue
        half, length = pad.get("width", WIDTH) / 2, whole.pads[index].length
        wanted, insets = _places(length, half)
        corners = np.array([(end * length, side * half) for end, side in ENDS])
        alone = Tracer(scenes[1], pose, lens.position, index, SPARE)
        near = alone.trace(*lens.sight(grid))
        lifted = contacts.heights(index, *np.clip(corners.T, [[0], [-half]], None)).tolist()
        for word in words:
            mine = np.flatnonzero(near.reached & (near.word == word))
            on = np.stack([near.along[mine], near.across[mine]], axis=-1)

            def guess(targets: np.ndarray, on: np.ndarray = on, mine: np.ndarray = mine):
                away = np.linalg.norm(on[:, None] - targets, axis=-1)
                return grid[mine[np.argmin(away, axis=0)]]

            numbers = np.full(len(wanted), word)
            places, beside, _ = find_places(alone, lens, numbers, guess(wanted), wanted, insets)
            there = whole.trace(*lens.sight(beside))
            ok = there.reached & (there.word == word) & (there.pad == index)
            ok &= ~whole.by_end(there) & np.all(
                (places >= BORDER) & (places <= np.subtract((lens.columns, lens.rows), 1 + BORDER)),
                axis=-1,
            )
            channels = [
                places[:4]
                if scene == scenes[1]
                else find_places(
                    Tracer(scene, pose, own.position, index, SPARE), own, numbers[:4],
                    guess(corners), corners, insets[:4],
                )[0]
                for scene, own in zip(scenes, lenses, strict=True)
            ]  # fmt: skip
            path, least = path_of(tables, word), (there.grazing[ok], there.transmission[ok])
            grazing, light = (float(np.min(one, initial=1.0)) for one in least)
            found.append(
                ViewTruth(
                    pad["name"], path, places[:4].tolist(), ok[:4].tolist(), bool(ok.all()),
                    [one.tolist() for one in channels], grazing, light, lifted,
                )
            )  # fmt: skip
    return found


def _places(length: float, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Places of a membrane, corners first, and how far inwards from each a ray must be seen."""
    places, insets = [], []
    for end, side in ENDS:
        places.append((end * length, side * half))
        insets.append(((1 - 2 * end) * INSET, -side * INSET))
    for share in (np.arange(ON_EDGE) + 0.5) / ON_EDGE:
        for end in (0, 1):
            places.append((end * length, (2 * share - 1) * half))
            insets.append(((1 - 2 * end) * INSET, 0.0))
        for side in (-1, 1):
            places.append((share * length, side * half))
            insets.append((0.0, -side * INSET))
    inner = (np.arange(WITHIN) + 0.5) / WITHIN
    for one, other in itertools.product(inner, inner):
        places.append((one * length, (2 * other - 1) * half))
        insets.append((0.0, 0.0))
    return np.array(places), np.array(insets)
