"""Every way to estimate joint angles, on the frames of fingers with sampled errors."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from designopt.solution import Solution
from designopt.study.records import Records
from perception.proprioception import (
    Bound,
    Calibration,
    CornerModel,
    Estimate,
    FingerErrors,
    GapEstimator,
    GapTable,
    Observation,
    calibrate,
    calibrate_gap,
    compute_information_bound,
    find_pose,
    fit_edges,
    make_undefined,
    observe,
    select_defined,
    split_estimates,
    stack_observations,
)
from perception.proprioception.observation import FLOOR
from studies.models.sensor.estimators import corner_model
from studies.models.sensor.finger_sensor import FingerSensor
from studies.proprioception.frames import FingerFrames, spread_angles

GAP_ALONE = "1 gap, corners with stated noise"
GAP = "1 gap, as in the paper"
GAP_THEN_EDGE = "1 gap, else edge"
EDGE = "2 one edge, no model"
DESIGNED = "3 all corners, as designed"
LABELLED = "4 all corners, labelled frames"
UNLABELLED = "5 all corners, all frames, no labels"
SAME_UNLABELLED = "5 all corners, the same frames without labels"
LENS_AS_DESIGNED = "4 without the lens's error"
SMOOTH = "4 with smooth edges"
EXACT = "all corners, finger known"

METHODS = [GAP, EDGE, DESIGNED, LABELLED, UNLABELLED]
"""From the simplest on."""

END_NOISE = FLOOR / math.sqrt(2)
"""Standard deviation of an end's section angle in an image, px: an end is the mean of two corners.
"""

NO_GAP = make_undefined("the gap could not be calibrated")


@dataclass(frozen=True)
class FingerEstimates:
    """What was found of one finger beside its joint angles.

    Attributes:
        labelled: calibration with labels.
        unlabelled: calibration without.
        gaps: the calibrated gap of every joint.
        seconds: of one joint-angle solve, for each frame.
    """

    labelled: Solution[Calibration]
    unlabelled: Solution[Calibration]
    gaps: list[GapEstimator | None]
    seconds: list[float]


@dataclass(frozen=True)
class Estimators:
    """All methods for fingers of one design.

    Attributes:
        finger: as designed.
        gaps: the gap of every joint.
        label_deviation: rad.
        plain: the model that takes the lens as designed.
        records: a row for each estimate, by `add`.
    """

    finger: FingerSensor
    gaps: list[GapTable]
    label_deviation: float
    plain: CornerModel
    records: Records = field(default_factory=Records)

    @classmethod
    def of(cls, finger: FingerSensor, gaps: list[GapTable], label_deviation: float) -> Estimators:
        """The methods for a design."""
        # An error that cannot be: the same program as with it.
        deviations = eqx.tree_at(
            lambda errors: errors.distortion, finger.deviations, replace_fn=jnp.zeros_like
        )
        plain = corner_model(
            finger.scene, finger.imaging, finger.catalog, deviations, finger.carried
        )
        return cls(finger, gaps, label_deviation, plain)

    def add(
        self,
        method: str,
        finger: int,
        angles: Float[np.ndarray, "frames joints"],
        estimates: Sequence[Sequence[Estimate]],
        bound: Bound | None = None,
    ) -> None:
        """Rows of one method: for each frame and joint the angle, the error and what is predicted.

        Args:
            method: its name.
            finger: number of the finger.
            angles: true ones, rad.
            estimates: of each frame and joint.
            bound: least standard deviations, where they were computed.
        """
        frames, joints = angles.shape
        answers = [one for frame in estimates for one in frame]
        bound = bound or Bound(np.full(angles.shape, np.nan), np.full(angles.shape, np.nan))
        self.records.add(
            method=method,
            finger=finger,
            frame=np.repeat(np.arange(frames), joints),
            joint=list(self.finger.model.names) * frames,
            angle_deg=np.rad2deg(angles.ravel()),
            error_deg=np.rad2deg([one.angle for one in answers] - angles.ravel()),
            deviation_deg=np.rad2deg([one.deviation for one in answers]),
            bound_deg=np.rad2deg(bound.calibrated.ravel()),
            bound_known_deg=np.rad2deg(bound.finger_known.ravel()),
            reason=[one.reason for one in answers],
        )

    def calibrate_labelled(self, seen: FingerFrames) -> Solution[Calibration]:
        """The finger's errors from its labelled frames."""
        return calibrate(
            self.finger.model, self._spread(seen), seen.spread_labels, self.label_deviation
        )

    def _spread(self, seen: FingerFrames) -> Observation:
        views = self.finger.model.views
        return stack_observations([observe(one, views) for one in seen.spread.sightings])

    def estimate(self, seen: FingerFrames) -> FingerEstimates:
        """All methods on the frames of one finger."""
        model, frames = self.finger.model, seen.frames
        pixel = 1 / float(self.finger.scene.camera.focal_pixels)
        gaps = [
            calibrate_gap(
                table,
                np.array([table.measured(one) for one in seen.in_gap.sightings]),
                seen.gap_labels[:, joint],
                noise=FLOOR * pixel,
                label_deviation=self.label_deviation,
            )
            for joint, table in enumerate(self.gaps)
        ]
        edges = [
            fit_edges(
                seen.spread.sightings,
                seen.spread_labels[:, joint],
                [view for view, j in zip(model.views, model.joints, strict=True) if j == joint],
                label_deviation=self.label_deviation,
                edge_deviation=END_NOISE * pixel,
            )
            for joint in range(len(model.names))
        ]
        observed, spread = (
            [observe(one, model.views) for one in frames.sightings],
            self._spread(seen),
        )
        labels = seen.spread_labels
        labelled = self.calibrate_labelled(seen)
        plain = calibrate(self.plain, spread, labels, self.label_deviation)
        rough = np.stack([one.angles for one in frames.sightings])
        unlabelled = calibrate(model, stack_observations(observed), rough)
        same = calibrate(model, spread, np.stack([one.angles for one in seen.spread.sightings]))
        known = FingerErrors.of(model, seen.errors, np.zeros((model.errors, model.errors)))

        by_gap = [
            [NO_GAP if one is None else one.estimate(one.table.measured(sighting)) for one in gaps]
            for sighting in frames.sightings
        ]
        by_edge = [[one.estimate(sighting) for one in edges] for sighting in frames.sightings]
        by_labels, seconds = [], []
        for observation, guess in zip(observed, rough, strict=True):
            start = time.perf_counter()
            by_labels.append(by_corners(model, labelled, observation, guess))
            seconds.append(time.perf_counter() - start)
        bounds = [
            compute_information_bound(
                model, seen.errors, one, (spread, seen.spread.angles), self.label_deviation
            )
            for one in zip(observed, frames.angles, strict=True)
        ]
        bound = Bound(*(np.stack(parts) for parts in zip(*bounds, strict=True)))
        pairs = list(zip(observed, rough, strict=True))
        for method, estimates in {
            GAP: by_gap,
            GAP_THEN_EDGE: [
                [select_defined(*both) for both in zip(*frame, strict=True)]
                for frame in zip(by_gap, by_edge, strict=True)
            ],
            EDGE: by_edge,
            DESIGNED: [split_estimates(find_pose(model, *pair)) for pair in pairs],
            LABELLED: by_labels,
            UNLABELLED: [by_corners(model, unlabelled, *pair) for pair in pairs],
            SAME_UNLABELLED: [by_corners(model, same, *pair) for pair in pairs],
            LENS_AS_DESIGNED: [by_corners(self.plain, plain, *pair) for pair in pairs],
            EXACT: [split_estimates(find_pose(model, *pair, known)) for pair in pairs],
        }.items():
            self.add(
                method, seen.number, frames.angles, estimates, bound if method == LABELLED else None
            )
        return FingerEstimates(labelled, unlabelled, gaps, seconds)

    def estimate_smooth(self, seen: FingerFrames) -> None:
        """Only the labelled calibration, on a finger with smooth edges."""
        labelled = self.calibrate_labelled(seen)
        model = self.finger.model
        estimates = [
            by_corners(model, labelled, observe(one, model.views), one.angles)
            for one in seen.frames.sightings
        ]
        self.add(SMOOTH, seen.number, seen.frames.angles, estimates)

    def estimate_gap_alone(
        self, number: int, *, frames: int, labelled: int, noise: float, seed: int
    ) -> None:
        """The gap without images: corners of a finger with a stated noise, and labelled frames.

        Args:
            number: of the finger.
            frames: random frames, in which both joints have a gap.
            labelled: frames for the calibration.
            noise: standard deviation of every corner's column and row, px.
            seed: of everything random.
        """
        finger, model = self.finger, self.finger.model
        limits = [(float(table.angles[0]), float(table.angles[-1])) for table in self.gaps]
        generator = np.random.default_rng([seed, 9, number])
        _, errors = finger.made(seed, number)
        known = spread_angles(limits, labelled)
        asked = np.stack([generator.uniform(*limit, frames) for limit in limits], axis=-1)
        poses = np.concatenate([known, asked])
        corners = np.array(_predict_corners(model, jnp.asarray(errors), jnp.asarray(poses)))
        corners += generator.normal(0, noise, corners.shape)
        labels = known + self.label_deviation * generator.standard_normal(known.shape)
        rays = np.stack([finger.lens.rays(c.reshape(-1, 2)).reshape(c.shape) for c in corners])
        estimates = []
        for joint, table in enumerate(self.gaps):
            first, second = (
                rays[:, model.views.index((table.pad, path)), [end, 3 - end], 0].mean(axis=-1)
                for path, end in zip(("direct", table.mirror), table.ends, strict=True)
            )
            gaps = np.abs(first - second)
            gap = calibrate_gap(
                table,
                gaps[:labelled],
                labels[:, joint],
                noise=noise / float(finger.scene.camera.focal_pixels),
                label_deviation=self.label_deviation,
            )
            estimates.append([gap.estimate(one) if gap else NO_GAP for one in gaps[labelled:]])
        self.add(GAP_ALONE, number, asked, list(zip(*estimates, strict=True)))


@eqx.filter_jit
def _predict_corners(model: CornerModel, errors: jnp.ndarray, poses: jnp.ndarray) -> jnp.ndarray:
    return eqx.filter_vmap(model.predict, in_axes=(None, 0))(errors, poses)


def by_corners(
    model: CornerModel,
    known: Solution[Calibration],
    seen: Observation,
    guess: Float[np.ndarray, " joints"],
) -> list[Estimate]:
    """The joint angles of a frame of a calibrated finger."""
    if not known.ok:
        return [make_undefined(known.messages()[0])] * len(guess)
    return split_estimates(find_pose(model, seen, guess, known.value.errors))
