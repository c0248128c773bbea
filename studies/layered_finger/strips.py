"""The strips of a membrane that are lost in a posture, and what bounds them.

The library names what ends each view. Where that end lies is computed again from what is named,
by a closed form that shares no line with it (`studies.oracles.shadows`).
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

from optics import Pieces, Scene, describe_end, name_paths
from optics.visibility import boundary_codes as codes
from optics.visibility.intervals import union
from optics.visibility.unfolding import paths_of
from studies.layered_finger.cases import Tables
from studies.oracles.shadows import Shadow, image, shadow

ROUNDING = 1e-9
"""A smaller part of a pad is no strip."""


class Strip(NamedTuple):
    """A lost strip, and the end of the view beside it.

    Attributes:
        start: pad coordinate where it begins.
        end: where it ends.
        at: the one of them where the view ends.
        view: the path of the view.
        bound: what ends the view.
        shadow: the end by the closed form; none for a bound that has none.
    """

    start: float
    end: float
    at: float
    view: str
    bound: str
    shadow: Shadow | None


def lost_strips(scene: Scene, tables: Tables, pieces: Pieces, pad: int) -> Iterator[Strip]:
    """Every lost strip of a pad once for each of its ends that is not the pad's.

    Args:
        scene: the finger's.
        tables: of the scene, in the posture.
        pieces: what is seen in it.
        pad: its index.
    """
    pieces = jax.tree.map(np.asarray, pieces)
    there = np.flatnonzero(pieces.present[pad])
    starts, ends = pieces.start[pad, there], pieces.end[pad, there]
    seen = union(zip(starts.tolist(), ends.tolist(), strict=True))
    edges = [0.0, *itertools.chain.from_iterable(seen), 1.0]
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if end - start <= ROUNDING:
            continue
        for at, places, labels, first in (
            (start, ends, pieces.end_label, 1),
            (end, starts, pieces.start_label, 0),
        ):
            if at in (0.0, 1.0):
                continue
            piece = int(there[np.argmin(np.abs(places - at))])
            path, label = int(pieces.path[pad, piece]), int(labels[pad, piece])
            by_face = pieces.face is not None and pieces.face[pad, piece] > 0
            early = float(pieces.pixels[pad, piece, first]) < float(scene.camera.pixels) / 2
            found = None if by_face else _closed_form(scene, tables, pad, path, label, early)
            view, bound = name_paths(scene.layout)[path], describe_end(scene.layout, label)
            yield Strip(start, end, at, view, bound, found)


def _closed_form(
    scene: Scene, tables: Tables, pad: int, path: int, label: int, early: bool
) -> Shadow | None:
    """The end of a view by its label; ``early`` is in the first half of the image line.

    Over at most one mirror. A grazing angle bounds a view below it (−π + angle) or ahead of it.
    """
    word, layout = paths_of(scene.layout, scene.layout.bounces)[path], scene.layout
    ends, leg, edge = ends_of(tables["pads"][pad]), len(word), None
    source = camera = complex(*tables["camera"]["position"])
    for index in word:
        source = image(source, ends_of(tables["mirrors"][index]))
    if label in (codes.LEFT_LIMIT, codes.RIGHT_LIMIT):
        half = float(scene.camera.field_of_view) / 2
        turn = math.radians(tables["camera"]["direction_deg"]) + (half if early else -half)
        edge, leg = camera + cmath.rect(1.0, turn), 0
    elif label in (codes.LOW_GRAZING, codes.HIGH_GRAZING):
        steep = math.radians(tables["pads"][pad]["min_grazing_deg"])
        way = cmath.rect(1.0, steep - math.pi if label == codes.LOW_GRAZING else -steep)
        edge = source + way * (ends[1] - ends[0])
    elif label in (codes.FIRST_WALL, codes.SECOND_WALL):
        edge = upper_edge(tables["pads"][pad], int(label == codes.SECOND_WALL))
    elif label >= 0:
        leg, surface, kind = map(int, codes.parts_of(label))
        if layout.kind(surface) == "mirror" and kind in (codes.FIRST_END, codes.SECOND_END):
            edge = ends_of(tables["mirrors"][surface])[kind]
        elif layout.kind(surface) == "layer" and kind == codes.SECOND_END:
            face = layout.bodies[surface - len(layout.surfaces)]
            edge = upper_edge(tables["pads"][face.pad], face.end)
    if edge is None:
        return None
    if leg < len(word):
        edge = image(edge, ends_of(tables["mirrors"][word[0]]))
    return shadow(source, edge, ends, layers_of(tables["pads"][pad]))


def upper_edge(pad: Tables, end: int) -> complex:
    """The edge of the outermost surface at an end of a pad whose layers are not bevelled."""
    ends, layers = ends_of(pad), pad.get("layers", ())
    along = (ends[1] - ends[0]) / abs(ends[1] - ends[0])
    over = layers[0]["overhang"][end] if layers else 0.0
    height = sum(layer["thickness"] for layer in layers)
    return ends[end] + along * ((over if end else -over) + 1j * height)


def layers_of(pad: Tables) -> list[tuple[float, float]]:
    """Thickness (mm) and index in green light of each layer."""
    return [(layer["thickness"], layer["index"]["green"]) for layer in pad.get("layers", ())]


def ends_of(part: Tables) -> tuple[complex, complex]:
    """Both ends of a pad, a mirror or a blocker; x + iy, mm."""
    return complex(*part["from"]), complex(*part["to"])
