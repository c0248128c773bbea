"""Operations that a scene, or a question about it, does not need."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import partial
from typing import Any

from designopt.left_out import count_operations
from designopt.results import LeftOutRow
from optics import scene_from
from optics.edge_refined import trace_views
from optics.scene import Scene
from optics.visibility import find_views
from studies.visibility_precision.cases import GALLERY, gallery

RADIUS_MM = 200.0
"""Of the mirror that is bent."""


def operations() -> list[LeftOutRow]:
    """Operation counts of programs that leave something out, beside those that need it."""
    finger = gallery("finger")
    bare = _changed(lambda data: data.pop("mirrors"))
    bent = _changed(lambda data: data["mirrors"][0].update(radius=RADIUS_MM))
    once, twice = (_exact(finger, bounces) for bounces in (1, 2))
    return [
        LeftOutRow(
            "coverage of a finger without mirrors",
            "unfolding and apertures: a finger with mirrors, one reflection",
            _exact(bare, 0),
            once,
        ),
        LeftOutRow(
            "coverage of the finger by one reflection",
            "paths over two mirrors, which cut each other's views",
            once,
            twice,
        ),
        LeftOutRow(
            "coverage of the finger by edge-refined rays, its mirrors straight",
            "conic sections, their quadratic equations and horizons: the same with a curved mirror",
            _count(lambda scene, pose: trace_views(scene, pose).value.coverage(), finger),
            _count(lambda scene, pose: trace_views(scene, pose).value.coverage(), bent),
        ),
        LeftOutRow(
            "coverage of the finger, and nothing else",
            "pixels, resolution, distances, margins and reasons: all that find_views answers",
            once,
            _count(find_views, finger),
        ),
    ]


def _changed(change: Callable[[dict[str, Any]], Any]) -> Scene:
    """The finger of the gallery with a change to its file."""
    data = tomllib.loads((GALLERY / "finger.toml").read_text(encoding="utf-8"))
    change(data)
    return scene_from(data, "finger")


def _exact(scene: Scene, bounces: int) -> int:
    finder = partial(find_views, bounces=bounces)
    return _count(lambda scene, pose: finder(scene, pose).value.coverage(), scene)


def _count(function: Callable[..., Any], scene: Scene) -> int:
    return count_operations(function, scene, scene.pose())
