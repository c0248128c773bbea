"""The ladder: every way to estimate joint angles, on the frames of one made finger."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from designopt.solution import Solution
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
from studies.proprioception.watching import Watched

GAP = "1 gap, as in the paper"
GAP_THEN_EDGE = "1 gap, else edge"
EDGE = "2 one edge, no model"
DESIGNED = "3 all corners, as designed"
LABELLED = "4 all corners, labelled frames"
UNLABELLED = "5 all corners, all frames, no labels"
SAME_UNLABELLED = "5 all corners, the same frames without labels"
LENS_AS_DESIGNED = "4 without the lens's error"
EXACT = "all corners, finger known"

RUNGS = (GAP, EDGE, DESIGNED, LABELLED, UNLABELLED)
"""The methods, from the simplest on."""

END_NOISE = FLOOR / math.sqrt(2)
"""Standard deviation of an end's section angle in an image, px: an end is the mean of two corners.
"""


@dataclass(frozen=True)
class Answer:
    """One joint angle by one method, and the truth.

    Attributes:
        method: its name.
        finger: number of the finger.
        frame: number of the frame.
        joint: name of the joint.
        truth: rad.
        estimate: by the method.
    """

    method: str
    finger: int
    frame: int
    joint: str
    truth: float
    estimate: Estimate

    @property
    def error(self) -> float:
        """Estimate minus truth, rad; NaN where it is undefined."""
        return self.estimate.angle - self.truth


@dataclass(frozen=True)
class Climbed:
    """All answers for one finger, and what its calibrations found.

    Attributes:
        answers: of all methods, frames and joints.
        labelled: calibration with labels.
        unlabelled: calibration without.
        bound: least standard deviations, rad, of every frame and joint, with labels.
        seconds: of one joint-angle solve, for each frame.
        meters: the calibrated gap of every joint.
    """

    answers: list[Answer]
    labelled: Solution[Calibration]
    unlabelled: Solution[Calibration]
    bound: Bound
    seconds: list[float]
    meters: list[GapEstimator | None]


@dataclass(frozen=True)
class Ladder:
    """The methods ready for many fingers of one design.

    Attributes:
        finger: as designed.
        tables: the gap of every joint.
        label_deviation: rad.
        plain: the model that takes the lens as designed.
    """

    finger: FingerSensor
    tables: list[GapTable]
    label_deviation: float
    plain: CornerModel

    @classmethod
    def of(cls, finger: FingerSensor, tables: list[GapTable], label_deviation: float) -> Ladder:
        """The methods for a design."""
        # An error that cannot be: the same program as with it.
        deviations = eqx.tree_at(
            lambda errors: errors.distortion, finger.deviations, replace_fn=jnp.zeros_like
        )
        plain = corner_model(
            finger.scene, finger.imaging, finger.catalog, deviations, finger.carried
        )
        return cls(finger, tables, label_deviation, plain)

    def labels(self, number: int, seen: Watched, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """What is told of the labelled frames, spread and in the gap: their angles with errors."""
        generator = np.random.default_rng([seed, 8, number])
        noise = self.label_deviation * generator.standard_normal((2, *seen.spread.angles.shape))
        return seen.spread.angles + noise[0], seen.in_gap.angles + noise[1]

    def climbed(self, number: int, seen: Watched, seed: int) -> Climbed:
        """All methods on the frames of one finger."""
        finger, model = self.finger, self.finger.model
        labels, gap_labels = self.labels(number, seen, seed)
        frames = seen.frames
        pixel = 1 / float(finger.scene.camera.focal_pixels)
        meters = [
            calibrate_gap(
                table,
                np.array([table.measured(one) for one in seen.in_gap.sightings]),
                gap_labels[:, joint],
                noise=FLOOR * pixel,
                label_deviation=self.label_deviation,
            )
            for joint, table in enumerate(self.tables)
        ]
        rulers = [
            fit_edges(
                seen.spread.sightings,
                labels[:, joint],
                [view for view, j in zip(model.views, model.joints, strict=True) if j == joint],
                label_deviation=self.label_deviation,
                edge_deviation=END_NOISE * pixel,
            )
            for joint in range(len(model.names))
        ]
        seen_frames = [observe(one, model.views) for one in frames.sightings]
        calibration_frames = stack_observations(
            [observe(one, model.views) for one in seen.spread.sightings]
        )
        labelled = calibrate(model, calibration_frames, labels, self.label_deviation)
        plain = calibrate(self.plain, calibration_frames, labels, self.label_deviation)
        rough = np.stack([one.angles for one in frames.sightings])
        unlabelled = calibrate(model, stack_observations(seen_frames), rough)
        guesses = np.stack([one.angles for one in seen.spread.sightings])
        same = calibrate(model, calibration_frames, guesses)

        answers: list[Answer] = []
        seconds: list[float] = []
        bounds: list[Bound] = []
        exact = np.zeros((model.errors, model.errors))
        for index, (truth, sighting, observation) in enumerate(
            zip(frames.angles, frames.sightings, seen_frames, strict=True)
        ):
            gaps = [
                make_undefined("the gap could not be calibrated")
                if meter is None
                else meter.estimate(meter.table.measured(sighting))
                for meter in meters
            ]
            edges = [ruler.estimate(sighting) for ruler in rulers]
            guess = sighting.angles

            start = time.perf_counter()
            by_labels = _by_all_corners(model, labelled, observation, guess)
            seconds.append(time.perf_counter() - start)
            by_method: dict[str, Sequence[Estimate]] = {
                GAP: gaps,
                GAP_THEN_EDGE: [select_defined(*pair) for pair in zip(gaps, edges, strict=True)],
                EDGE: edges,
                DESIGNED: split_estimates(find_pose(model, observation, guess)),
                LABELLED: by_labels,
                UNLABELLED: _by_all_corners(model, unlabelled, observation, guess),
                SAME_UNLABELLED: _by_all_corners(model, same, observation, guess),
                LENS_AS_DESIGNED: _by_all_corners(self.plain, plain, observation, guess),
                EXACT: split_estimates(
                    find_pose(model, observation, guess, FingerErrors.of(model, seen.errors, exact))
                ),
            }
            answers += [
                Answer(method, number, index, name, float(truth[joint]), estimates[joint])
                for method, estimates in by_method.items()
                for joint, name in enumerate(model.names)
            ]
            bounds.append(
                compute_information_bound(
                    model,
                    seen.errors,
                    (observation, truth),
                    (calibration_frames, seen.spread.angles),
                    self.label_deviation,
                )
            )
        bound = Bound(*(np.stack(parts) for parts in zip(*bounds, strict=True)))
        return Climbed(answers, labelled, unlabelled, bound, seconds, meters)


def _by_all_corners(
    model: CornerModel,
    known: Solution[Calibration],
    seen: Observation,
    guess: Float[np.ndarray, " joints"],
) -> list[Estimate]:
    """The joint angles of a frame of a calibrated finger."""
    if not known.ok:
        return [make_undefined(known.messages()[0])] * len(guess)
    return split_estimates(find_pose(model, seen, guess, known.value.errors))


def solved(ladder: Ladder, number: int, seen: Watched, seed: int) -> list[Answer]:
    """Only the answers of the labelled calibration."""
    model = ladder.finger.model
    labels, _ = ladder.labels(number, seen, seed)
    frames = stack_observations([observe(one, model.views) for one in seen.spread.sightings])
    found = calibrate(model, frames, labels, ladder.label_deviation)
    answers = []
    for index, (truth, sighting) in enumerate(
        zip(seen.frames.angles, seen.frames.sightings, strict=True)
    ):
        seen_here = observe(sighting, model.views)
        estimates = _by_all_corners(model, found, seen_here, sighting.angles)
        answers += [
            Answer(LABELLED, number, index, name, float(truth[joint]), estimates[joint])
            for joint, name in enumerate(model.names)
        ]
    return answers


def errors_deg(answers: Sequence[Answer]) -> Float[np.ndarray, " defined"]:
    """Errors of the answers that are defined, degrees."""
    errors = np.array([answer.error for answer in answers])
    return np.rad2deg(errors[np.isfinite(errors)])


def of_method(answers: Sequence[Answer], method: str, joint: str | None = None) -> list[Answer]:
    """The answers of a method, for one joint or for all."""
    return [a for a in answers if a.method == method and joint in (None, a.joint)]


def defined_share(answers: Sequence[Answer]) -> float:
    """Part of the answers that are defined."""
    return float(np.mean([math.isfinite(answer.error) for answer in answers]))


def variance_ratio(answers: Sequence[Answer]) -> float:
    """Mean squared error over mean predicted variance, of the answers that are defined."""
    pairs = [(a.error**2, a.estimate.deviation**2) for a in answers if a.estimate.defined]
    squares, variances = np.array(pairs).reshape(-1, 2).T
    return float(np.mean(squares) / np.mean(variances)) if len(squares) else math.nan
