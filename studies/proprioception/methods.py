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

from designopt import Records, Solution, UserError
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
    make_undefined,
    observe,
    select_defined,
    split_estimates,
    stack_observations,
)
from studies.models.sensor.estimators import corner_model, fit_joint_edges, gap_table
from studies.models.sensor.finger_sensor import CURE, FingerSensor
from studies.models.sensor.poses import spread_angles
from studies.proprioception import ProprioceptionSpec
from studies.proprioception.frames import FingerFrames, Frames, ranges

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

CORNER_PX = 0.25
"""Standard deviation of a corner for gap and edge, which take none of the corners' own, px."""

END_NOISE = CORNER_PX / math.sqrt(2)
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
    def of(cls, spec: ProprioceptionSpec, rows: int | None = None) -> Estimators:
        """The methods for a design, its image ``rows`` high.

        Raises:
            UserError: the scene cannot be read, or its joints have no gap.
        """
        finger = FingerSensor.of(spec, rows)
        # An error that cannot be: the same program as with it.
        deviations = eqx.tree_at(
            lambda errors: errors.distortion, finger.deviations, replace_fn=jnp.zeros_like
        )
        scene = finger.scene, finger.imaging, finger.catalog
        plain = corner_model(*scene, deviations, finger.carried)
        return cls(finger, find_gaps(finger), math.radians(spec.label_deviation_deg), plain)

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

    def observe(self, frames: Frames) -> list[Observation]:
        """What frames show of the views that are asked for."""
        return [observe(one, self.finger.model.views) for one in frames.sightings]

    def calibrate_labelled(
        self, seen: FingerFrames, model: CornerModel | None = None
    ) -> Solution[Calibration]:
        """The finger's errors from its labelled frames."""
        observed = stack_observations(self.observe(seen.spread))
        return calibrate(
            model or self.finger.model, observed, seen.spread.labels, self.label_deviation
        )

    def estimate(self, seen: FingerFrames) -> FingerEstimates:
        """All methods on the frames of one finger."""
        model, frames, spread = self.finger.model, seen.frames, seen.spread
        pixel = 1 / float(self.finger.scene.camera.focal_pixels)
        stated = {"label_deviation": self.label_deviation}
        gaps = []
        for table, labels in zip(self.gaps, seen.in_gap.labels.T, strict=True):
            measured = np.array([table.measured(one) for one in seen.in_gap.sightings])
            gaps.append(calibrate_gap(table, measured, labels, noise=CORNER_PX * pixel, **stated))
        stated["edge_deviation"] = END_NOISE * pixel
        edges = fit_joint_edges(model, spread.sightings, spread.labels, **stated)
        by_gap = [
            [NO_GAP if one is None else one.estimate(one.table.measured(sighting)) for one in gaps]
            for sighting in frames.sightings
        ]
        by_edge = [[one.estimate(sighting) for one in edges] for sighting in frames.sightings]
        by_either = [
            [select_defined(*both) for both in zip(*frame, strict=True)]
            for frame in zip(by_gap, by_edge, strict=True)
        ]
        observed, labelled_frames = self.observe(frames), stack_observations(self.observe(spread))
        # Joint angles of the nearest views in the catalog.
        rough, near = (np.stack([one.angles for one in of.sightings]) for of in (frames, spread))
        labelled, plain = self.calibrate_labelled(seen), self.calibrate_labelled(seen, self.plain)
        unlabelled = calibrate(model, stack_observations(observed), rough)
        same = calibrate(model, labelled_frames, near)
        known = FingerErrors.of(model, seen.errors, np.zeros((model.errors, model.errors)))
        pairs, by_labels, seconds = list(zip(observed, rough, strict=True)), [], []
        for pair in pairs:
            start = time.perf_counter()
            by_labels.append(by_corners(model, labelled, *pair))
            seconds.append(time.perf_counter() - start)
        given = (labelled_frames, spread.angles), self.label_deviation
        bounds = [
            compute_information_bound(model, seen.errors, one, *given)
            for one in zip(observed, frames.angles, strict=True)
        ]
        bound = Bound(*(np.stack(parts) for parts in zip(*bounds, strict=True)))

        def corners(
            of: CornerModel, errors: Solution[Calibration] | FingerErrors | None
        ) -> list[list[Estimate]]:
            return [by_corners(of, errors, *pair) for pair in pairs]

        for method, estimates in {
            GAP: by_gap,
            GAP_THEN_EDGE: by_either,
            EDGE: by_edge,
            DESIGNED: corners(model, None),
            LABELLED: by_labels,
            UNLABELLED: corners(model, unlabelled),
            SAME_UNLABELLED: corners(model, same),
            LENS_AS_DESIGNED: corners(self.plain, plain),
            EXACT: corners(model, known),
        }.items():
            own = bound if method == LABELLED else None
            self.add(method, seen.number, frames.angles, estimates, own)
        return FingerEstimates(labelled, unlabelled, gaps, seconds)

    def estimate_smooth(self, seen: FingerFrames) -> None:
        """Only the labelled calibration, on a finger with smooth edges."""
        labelled, model = self.calibrate_labelled(seen), self.finger.model
        pairs = zip(self.observe(seen.frames), seen.frames.sightings, strict=True)
        estimates = [by_corners(model, labelled, one, found.angles) for one, found in pairs]
        self.add(SMOOTH, seen.number, seen.frames.angles, estimates)

    def estimate_gap_alone(self, number: int, spec: ProprioceptionSpec, seed: int) -> None:
        """The gap without images: corners of a finger with a stated noise, and labelled frames.

        Args:
            number: of the finger.
            spec: numbers of frames, and the corners' noise.
            seed: of everything random.
        """
        finger, model, labelled = self.finger, self.finger.model, spec.labelled
        generator = np.random.default_rng([seed, 9, number])
        _, errors = finger.made(seed, number)
        known = spread_angles(ranges(self.gaps), labelled)
        asked = np.stack([generator.uniform(*r, spec.frames) for r in ranges(self.gaps)], axis=-1)
        poses = np.concatenate([known, asked])
        corners = np.array(_predict_corners(model, jnp.asarray(errors), jnp.asarray(poses)))
        corners += generator.normal(0, spec.pixel_noise, corners.shape)
        labels = known + self.label_deviation * generator.standard_normal(known.shape)
        rays = np.stack([finger.lens.rays(c.reshape(-1, 2)).reshape(c.shape) for c in corners])
        noise = spec.pixel_noise / float(finger.scene.camera.focal_pixels)
        estimates = []
        for joint, table in enumerate(self.gaps):
            first, second = (
                rays[:, model.views.index((table.pad, path)), [end, 3 - end], 0].mean(axis=-1)
                for path, end in zip(("direct", table.mirror), table.ends, strict=True)
            )
            gaps = np.abs(first - second)
            stated = {"noise": noise, "label_deviation": self.label_deviation}
            gap = calibrate_gap(table, gaps[:labelled], labels[:, joint], **stated)
            estimates.append([gap.estimate(one) if gap else NO_GAP for one in gaps[labelled:]])
        self.add(GAP_ALONE, number, asked, list(zip(*estimates, strict=True)))


@eqx.filter_jit
def _predict_corners(model: CornerModel, errors: jnp.ndarray, poses: jnp.ndarray) -> jnp.ndarray:
    return eqx.filter_vmap(model.predict, in_axes=(None, 0))(errors, poses)


def by_corners(
    model: CornerModel,
    known: Solution[Calibration] | FingerErrors | None,
    seen: Observation,
    guess: Float[np.ndarray, " joints"],
) -> list[Estimate]:
    """The joint angles of a frame of a finger that was calibrated, is known, or is as designed."""
    if isinstance(known, Solution):
        if not known.ok:
            return [make_undefined(known.messages()[0])] * len(guess)
        known = known.value.errors
    return split_estimates(find_pose(model, seen, guess, known))


def find_gaps(finger: FingerSensor) -> list[GapTable]:
    """The gap of every joint, in the joints' order.

    Raises:
        UserError: a joint has none.
    """
    by_joint: dict[int, GapTable] = {}
    for (pad, path), joint in zip(finger.model.views, finger.model.joints, strict=True):
        if joint is not None and path != "direct":
            try:
                by_joint[joint] = gap_table(finger.scene, finger.catalog, pad)
            except ValueError as error:
                needed = "the gap needs both of every pad that moves"
                raise UserError(f"scene: {error}; {needed}: {CURE}") from error
    names = enumerate(finger.model.names)
    if missing := ", ".join(name for joint, name in names if joint not in by_joint):
        what = f"no mirror shows a pad that {missing} moves, so it has no gap"
        raise UserError(f"scene: {what}; {CURE}")
    return [by_joint[joint] for joint in sorted(by_joint)]
