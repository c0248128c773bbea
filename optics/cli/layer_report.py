"""What layers add to the JSON of `designopt trace`: outlines with their bounds, second images."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from optics.visibility.outline_edges import EDGES, BoundName, name_bound
from optics.visibility.scene_trace import SceneTrace
from optics.visibility.second_images import clear_walls, describe_second_end

Entry = dict[str, Any]


def outline_of_view(trace: SceneTrace, pose: int, path: int, pad: int) -> Entry | None:
    """Where a view's outline is imaged, edge by edge in parts, and what bounds each part.

    Nothing of a pad without layers or width, or whose outline has no four edges.
    """
    layout, layers = trace.scene.layout, trace.layers
    if layers is None or layers.outlines is None or layers.places is None:
        return None
    if not layout.layers[pad] or not layers.outlines.present[pose, path, pad]:
        return None
    levels, places = layers.outlines.level[pose, path, pad], layers.places[pose, path, pad]
    return {
        name: _parts([name_bound(layout, pad, level) for level in of_edge], points)
        for name, of_edge, points in zip(EDGES, levels.tolist(), places.tolist(), strict=True)
    }


def _parts(bounds: Sequence[BoundName], points: Sequence[Sequence[float]]) -> list[Entry]:
    """The parts of an edge that one thing bounds; between their ends every second point."""
    cuts = [i for i in range(1, len(bounds)) if bounds[i] != bounds[i - 1]]
    parts = []
    for first, last in itertools.pairwise([0, *cuts, len(bounds)]):
        kept = [i for i in range(first, last + 1) if i % 2 == 0 or i in (first, last)]
        parts.append({"bound": bounds[first], "places": [points[i] for i in kept]})
    return parts


def second_images_of(trace: SceneTrace, pose: int, pad: int) -> list[Entry]:
    """What of a pad appears once more in a clear wall of its layers, and where, by every path."""
    layout, layers = trace.scene.layout, trace.layers
    if layers is None:
        return []
    ends, beside = (clear_walls(layout, beside) for beside in (False, True))
    found = []
    for path, name in enumerate(trace.paths):
        for number, wall in enumerate([*ends, *beside]):
            if wall.pad != pad:
                continue
            entry: Entry = {}
            if number < len(ends):
                entry |= _pieces(trace, pose, path, number)
            if layers.corners is not None and layers.mirrored[pose, path, number]:
                entry["corners"] = layers.corners[pose, path, number].tolist()
            if entry:
                found.append({"wall": wall.name, "path": name} | entry)
    return found


def _pieces(trace: SceneTrace, pose: int, path: int, wall: int) -> Entry:
    """What appears in a clear end."""
    assert trace.layers is not None
    second = jax.tree.map(lambda leaf: leaf[pose, wall], trace.layers.second)
    there = np.flatnonzero(second.present & (second.path == path))
    if not len(there):
        return {}
    second = jax.tree.map(lambda leaf: leaf[there].tolist(), second)
    layout = trace.scene.layout
    labels = zip(second.start_label, second.end_label, strict=True)
    return {
        "intervals": [list(pair) for pair in zip(second.start, second.end, strict=True)],
        "ends": [[describe_second_end(layout, label) for label in pair] for pair in labels],
        "pixels": second.pixels,
    }
