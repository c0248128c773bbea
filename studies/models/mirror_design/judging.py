"""The verdict on a finger, found apart from the search: degree by degree, and by rays."""

from __future__ import annotations

import json
import math
import time
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.solution import Solution
from optics import Pieces, Scene, find_coverage, find_views
from optics.scene.writer import scene_tables
from optics.visibility.sharpness import find_sharpness
from studies.models.finger import Finger, camera_of
from studies.models.finger_parts import PHALANGES, joints_between
from studies.models.mirror_design.postures import (
    ROUNDING,
    WorstPostures,
    find_worst_postures,
    whole_degrees,
)
from studies.models.mirror_design.seeing import together
from studies.oracles import layers
from studies.oracles.layered_scenes import posed_tables, read
from studies.oracles.scenes import rounded, seen_by_fan


class Verdict(eqx.Module):
    """What is seen degree by degree, both joints bent alike, and at worst over all postures.

    Attributes:
        degrees: of both joints, each of them up to the end of its own range.
        coverage: part of each pad that is seen.
        single: the largest part that one path shows: 1 where one view shows all of the pad.
        px_per_mm: least resolution of each pad, each place in its best view; 0 if nothing is seen.
        views: the views themselves.
        worst: over all pairs of angles, between the degrees too; ``None`` where only the row of
            degrees is asked for, on which what is worst is then taken.
    """

    degrees: Float[np.ndarray, " poses"]
    coverage: Float[np.ndarray, "poses pads"]
    single: Float[np.ndarray, "poses pads"]
    px_per_mm: Float[np.ndarray, "poses pads"]
    views: Solution[Pieces]
    worst: WorstPostures | None = None

    @property
    def worst_coverage(self) -> float:
        """Least coverage of any pad in any posture; 1 but for rounding is 1."""
        row = _worst(self.coverage)
        return row if self.worst is None else min(row, self.worst.least_coverage)

    @property
    def in_single_views(self) -> float:
        """Part of the postures in which every pad is whole in one view."""
        return float(np.mean(np.all(self.single >= 1 - ROUNDING, axis=1)))

    @property
    def mean_coverage(self) -> float:
        """Part of all pads that is seen, on average over postures and pads."""
        return float(np.mean(self.coverage))

    def meets(self, floor: float) -> bool:
        """Whether everything is seen, with at least a resolution (px/mm)."""
        return self.worst_coverage == 1.0 and self.worst_px_per_mm >= floor

    def quality(self, floor: float) -> tuple[float, float]:
        """Greater is better: coverage, then resolution (px/mm) up to what is asked for."""
        return self.worst_coverage, min(self.worst_px_per_mm, floor)

    @property
    def worst_px_per_mm(self) -> float:
        """Least resolution of any pad in any posture."""
        row = float(np.min(self.px_per_mm))
        return row if self.worst is None else min(row, self.worst.least_px_per_mm)


def _worst(coverage: np.ndarray) -> float:
    worst = float(np.min(coverage))
    return 1.0 if worst >= 1 - ROUNDING else worst


def percent_at_least(part: float) -> str:
    """A part in percent, rounded down: what is not all is not 100 %."""
    return f"{math.floor(1e4 * part) / 100:g} %"


def judged(finger: Finger, *, everywhere: bool = True) -> Verdict:
    """What a finger's camera shows.

    Args:
        finger: with camera and mirrors.
        everywhere: over all pairs of joint angles, not just degree by degree with both alike.
    """
    scene, degrees = finger.scene(), whole_degrees(finger.body.range_deg)
    row = np.minimum(np.stack([degrees, degrees], axis=-1), finger.body.ranges_deg)
    poses = jnp.deg2rad(jnp.asarray(row))
    views = find_views(scene, poses)
    sharp = find_sharpness(scene, np.asarray(poses), views.value, bounces=scene.layout.bounces)
    paths = range(len(scene.layout.mirrors) + 1)
    single = np.max([views.value.seen(path) for path in paths], axis=0)
    coverage, px_per_mm = np.asarray(views.value.coverage()), sharp.px_per_mm[..., 0]
    worst = find_worst_postures(finger) if everywhere else None
    return Verdict(degrees, coverage, np.asarray(single), px_per_mm, views, worst)


class Square(NamedTuple):
    """All pairs of joint angles beside one row of them.

    Attributes:
        coverage: of every pad, shape (PIP, DIP, pads).
        disagreement: largest deviation from the row, of pads that one joint or none moves against
            the camera.
        speedup: run time of all pairs over that of the row.
    """

    coverage: Float[np.ndarray, "pip dip pads"]
    disagreement: float
    speedup: float

    @property
    def worst_coverage(self) -> float:
        """Least coverage of any pad in any posture; 1 but for rounding is 1."""
        return _worst(self.coverage)


def coverage_grid(finger: Finger) -> Square:
    """Coverage for all pairs of angles, and how far the row deviates from it."""
    scene = finger.scene()
    angles = jnp.deg2rad(jnp.asarray(whole_degrees(min(finger.body.ranges_deg))))
    mesh = jnp.stack(jnp.meshgrid(angles, angles, indexing="ij"), axis=-1)
    row, row_seconds = _timed(scene, together(angles))
    square, square_seconds = _timed(scene, mesh)
    deviations, host = [0.0], camera_of(finger).phalanx
    for pad, name in enumerate(PHALANGES):
        joints = joints_between(name, host)
        if len(joints) < 2:
            expected = row[None, :, pad] if 1 in joints else row[:, None, pad]
            deviations.append(float(np.max(np.abs(square[..., pad] - expected))))
    return Square(square, max(deviations), square_seconds / row_seconds)


def _timed(scene: Scene, poses: Float[Array, "*poses joints"]) -> tuple[np.ndarray, float]:
    find_coverage(scene, poses).value.block_until_ready()
    begin = time.perf_counter()
    found = find_coverage(scene, poses).value.block_until_ready()
    return np.asarray(found), time.perf_counter() - begin


def seen_by_rays(
    scene: Scene, degrees: Float[np.ndarray, "poses 2"], rays: int
) -> Float[np.ndarray, "poses pads"]:
    """Coverage by a fan of rays in plain NumPy, which shares nothing with the exact method.

    Args:
        scene: the scene.
        degrees: PIP and DIP of every pose.
        rays: over the field of view. Behind layers the ends of what is seen are refined, so that a
            hundredth of them is enough.
    """
    if scene.layers is not None:
        few = max(rays // 100, 500)
        return np.stack([_through_layers(scene, pip, dip, few) for pip, dip in degrees.tolist()])
    angles = np.deg2rad(degrees).tolist()
    poses = [scene.pose({"pip": pip, "dip": dip}) for pip, dip in angles]
    return np.stack([seen_by_fan(rounded(scene, pose), rays).coverage for pose in poses])


def _through_layers(
    scene: Scene, pip_deg: float, dip_deg: float, rays: int
) -> Float[np.ndarray, " pads"]:
    """The same through layers: rays by Snell's law from face to face, of the scene's tables."""
    tables = json.loads(json.dumps(scene_tables(scene)))
    camera, frames = scene.camera, tables["frames"]
    tables["camera"]["fov_deg"] = math.degrees(float(camera.field_of_view))
    if camera.module is not None:
        for ends in np.asarray(camera.module.outline(camera.position, camera.direction)).tolist():
            line = {"name": "module", "from": ends[0], "to": ends[1]}
            tables["blockers"].append(line | {"body": tables["camera"].get("body")})
    angles = {frames["proximal"]["angle"]: pip_deg, frames["distal"]["angle"]: dip_deg}
    plain = read(posed_tables(tables, angles))
    return layers.coverage(plain, layers.runs(plain, rays))
