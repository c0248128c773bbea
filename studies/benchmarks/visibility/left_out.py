"""Operations that a scene, or a question about it, does not need."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from designopt.study.left_out import count_operations
from designopt.study.results import LeftOutRow
from optics.scene.scene import Scene
from optics.visibility.coverage import find_coverage, find_views
from optics.visibility.edge_refined import trace_views
from studies.benchmarks.visibility.cases import changed_finger, gallery

RADIUS_MM = 200.0
"""Of the mirror that is bent."""


def operations() -> list[LeftOutRow]:
    """Operation counts of programs that leave something out, beside those that need it."""
    finger = gallery("finger")
    bare = changed_finger(lambda data: data.pop("mirrors"))
    bent = changed_finger(lambda data: data["mirrors"][0].update(radius=RADIUS_MM))
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
            _refined(finger),
            _refined(bent),
        ),
        LeftOutRow(
            "coverage of the finger, and nothing else",
            "pixels, resolution, distances, margins and reasons: all that `find_views` answers",
            once,
            _count(find_views, finger),
        ),
    ]


def _exact(scene: Scene, bounces: int) -> int:
    return _count(partial(find_coverage, bounces=bounces), scene)


def _refined(scene: Scene) -> int:
    return _count(lambda scene, pose: trace_views(scene, pose).value.coverage(), scene)


def _count(function: Callable[..., Any], scene: Scene) -> int:
    return count_operations(function, scene, scene.pose())
