"""Random scenes: an engine beside brute force, central differences and itself in float32."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from designopt.study.study import Context
from studies.oracles.rays import Bounds, bounds, follow
from studies.stability.visibility.answers import Answers, Asked, Engine, Weights, ask
from studies.stability.visibility.scenes import (
    FIELD_OF_VIEW,
    INPUTS,
    MIRRORS,
    PADS,
    PIXELS,
    STRUCTURE,
    fans_of,
    random_rows,
)
from studies.stability.visibility.spec import StabilitySpec

SLACK = 1e-9
"""By how much a coverage may leave the bounds of the rays: the rounding of the rays themselves."""

BETWEEN = 2000
"""Rays that are shot between the two at either end of a run where rays are fine."""

UNDECIDED = 1e-12
"""Margins up to which either verdict is accepted, rad."""

STEPS = (1e-6, 3e-7)
AGREEMENT = 1e-7
"""Steps of the central differences, and how well the two must agree to be a derivative."""

GROUPS: dict[str, Weights] = {
    "coverage and parts": {"coverage": 1.0, "seen": 1.0},
    "margins": {"margin": 1.0},
    "pixels, resolution, distances, reflections": {
        "pixels": 1e-3,
        "px_per_mm": 1e-3,
        "distance": 1.0,
        "spans": 1.0,
    },
}
"""The sums whose gradients are compared, each of order 1."""


@dataclass(frozen=True)
class Gaps:
    """How an engine's answers lie in the bounds of rays; arrays of shape (scenes,).

    Attributes:
        off: how far a coverage is from the middle of its bounds.
        excess: by how much coverages, or what a path shows, leave their bounds.
        step: how much of a pad lies between two neighbouring rays: what is narrower, such as a
            slit or a shadow between them, they cannot know.
    """

    off: np.ndarray
    excess: np.ndarray
    step: np.ndarray

    @property
    def differ(self) -> np.ndarray:
        """Whether bounds are left at all, or what is said is no number."""
        return ~(self.excess <= SLACK)

    @property
    def disagree(self) -> np.ndarray:
        """Whether they are left by more than the rays cannot know."""
        return ~(self.excess <= SLACK + self.step)


def gaps(found: Bounds, answers: Answers, bounces: int) -> Gaps:
    """Compare the answers for some scenes with what rays found there."""
    coverage, seen = answers.numbers["coverage"], answers.numbers["seen"]
    around = found.coverage[:, bounces - 1]
    pairs = ((around, coverage), (found.seen[:, :, : seen.shape[1]], seen))
    beyond = [_worst(np.maximum(inner - said, said - outer)) for (inner, outer), said in pairs]
    off = _worst(abs(coverage - np.mean(around, axis=0)))
    return Gaps(off, np.maximum(0, np.max(beyond, axis=0)), found.step)


def _worst(errors: np.ndarray) -> np.ndarray:
    """The largest error of each scene."""
    return np.max(errors.reshape(len(errors), -1), axis=1)


def wrong_verdicts(found: Bounds, answers: Answers) -> int:
    """Views that rays show and the engine denies, or whose verdict, margin and parts disagree."""
    ok, margin = answers.ok, answers.numbers["margin"]
    shown = found.seen[0, :, : ok.shape[1]] > 0
    contrary = (ok != (margin > 0)) & (abs(margin) > UNDECIDED)
    return int(np.sum((shown & ~ok) | contrary | (ok != (answers.numbers["seen"] > 0))))


@dataclass(frozen=True)
class Landings:
    """Rays sent out from the pixels at which the engine images the ends of its pieces.

    Attributes:
        rays: how many.
        angle: largest angle by which one misses the end of its piece, rad.
        distance: largest relative error of a distance.
        reflection: largest error of a coordinate on a mirror.
        resolution: largest relative error of a resolution.
    """

    rays: int
    angle: float
    distance: float
    reflection: float
    resolution: float


def landings(rows: np.ndarray, answers: Answers, bounces: int) -> Landings:
    """Follow a ray to either end of every piece: does it arrive there, and as far away as said?"""
    numbers, worst, rays = answers.numbers, np.zeros(4), 0
    for path, word in enumerate(STRUCTURE.words(bounces)):
        for pad in range(PADS):
            scene, piece = np.nonzero((answers.present & (answers.path == path))[:, pad])
            some, width = fans_of(rows[scene]), rows[scene, FIELD_OF_VIEW]
            ends = rows[scene].reshape(-1, INPUTS)[:, 4 * (MIRRORS + pad) : 4 * (MIRRORS + pad) + 4]
            long = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
            for end, where in enumerate((answers.start, answers.end)):
                at = (scene, pad, piece, end)
                turn = (PIXELS / 2 - numbers["pixels"][at]) * width / PIXELS
                hit, length, mirrors = follow(STRUCTURE, some, turn, word, pad)
                near = [
                    follow(STRUCTURE, some, turn + move, word, pad)[0] for move in (-1e-6, 1e-6)
                ]
                slope = abs(near[1] - near[0]) / 2e-6
                spans = numbers["spans"][scene, pad, piece, : len(word), end]
                errors = (
                    (hit - where[scene, pad, piece]) / slope,
                    length / numbers["distance"][at] - 1,
                    mirrors - spans,
                    PIXELS / width / (slope * long) / numbers["px_per_mm"][at] - 1,
                )
                worst = np.maximum(worst, [np.max(abs(error), initial=0.0) for error in errors])
                rays += len(scene)
    return Landings(rays, *worst.tolist())


@dataclass(frozen=True)
class Gradients:
    """Gradients beside central differences at two steps.

    Attributes:
        entries: how many derivatives were compared: those where both steps agree.
        left_out: how many were not: where they do not, a view changes its topology nearby.
        worst: largest error by the name of the sum, relative to the gradient's largest entry or 1.
    """

    entries: int
    left_out: int
    worst: dict[str, float]


def gradients(asked: Asked, rows: np.ndarray) -> Gradients:
    """Compare the gradients of a few sums with respect to every input of every scene.

    Args:
        asked: what is asked of which engine.
        rows: shape (scenes, inputs).
    """
    scenes, inputs = rows.shape
    moves = np.array([sign * step for step in STEPS for sign in (1, -1)])
    moved = rows + moves[:, None, None, None] * np.eye(inputs)[:, None]
    answers = ask(asked, moved.reshape(-1, inputs))
    worst, compared = {}, []
    for name, weights in GROUPS.items():
        gradient = ask(asked, rows, weights).gradient
        scale = np.maximum(1, np.max(abs(gradient), axis=1, keepdims=True))
        sums = answers.summed(weights).reshape(len(STEPS), 2, inputs, scenes)
        first, second = (
            (high - low).T / (2 * step) for step, (high, low) in zip(STEPS, sums, strict=True)
        )
        smooth = abs(first - second) < AGREEMENT * scale
        worst[name] = float(np.max((abs(gradient - first) / scale)[smooth], initial=0.0))
        compared.append(smooth)
    entries = int(np.sum(compared))
    return Gradients(entries, len(GROUPS) * rows.size - entries, worst)


@dataclass(frozen=True)
class Compared:
    """An engine's answers for random scenes, with one number of bounces.

    Attributes:
        bounces: most reflections of a path.
        coarse: beside the rays of all scenes.
        fine: beside more rays of some: those that differed, and a sample.
        wrong_verdicts: how many, of all views.
        non_finite: how many numbers are not finite, gradients included, by float type.
        landings: what rays from the said pixels meet.
        single: error of coverages and parts in float32, shape (scenes,); empty if not asked for.
        gradients: gradients beside central differences.
    """

    bounces: int
    coarse: Gaps
    fine: Gaps
    wrong_verdicts: int
    non_finite: dict[str, int]
    landings: Landings
    single: np.ndarray
    gradients: Gradients


def compare(engine: Engine, spec: StabilitySpec, context: Context) -> list[Compared]:
    """Compare an engine's answers for random scenes, with each number of bounces."""
    rows = random_rows(spec.scenes, context.seed)
    counts = range(1, spec.bounces + 1)
    answers = {}
    for bounces in counts:
        with context.step(f"Random scenes, {_times(bounces)}"):
            answers[bounces] = ask(Asked(engine, bounces), rows)
    with context.step(f"{spec.rays} rays in each of {spec.scenes} scenes"):
        found = bounds(STRUCTURE, fans_of(rows), spec.rays, spec.bounces)
    coarse = {bounces: gaps(found, answers[bounces], bounces) for bounces in counts}
    differ = np.any([some.differ for some in coarse.values()], axis=0)
    again = np.flatnonzero(differ | (np.arange(len(rows)) < spec.reference_scenes))
    with context.step(f"{spec.fine_rays} rays in each of {len(again)} scenes"):
        closer = bounds(STRUCTURE, fans_of(rows[again]), spec.fine_rays, spec.bounces, BETWEEN)
    result = []
    for bounces in counts:
        asked, said = Asked(engine, bounces), answers[bounces]
        with context.step(f"Gradients, {_times(bounces)}"):
            slopes = gradients(asked, rows[: spec.gradient_scenes])
        non_finite, single = {"float64": int(np.sum(said.non_finite))}, np.zeros(0)
        if spec.float32:
            with context.step(f"float32, {_times(bounces)}"):
                non_finite["float32"], single = _in_single(asked, rows)
        compared = Compared(
            bounces=bounces,
            coarse=coarse[bounces],
            fine=gaps(closer, said.part(again), bounces),
            wrong_verdicts=wrong_verdicts(found, said),
            non_finite=non_finite,
            landings=landings(rows, said, bounces),
            single=single,
            gradients=slopes,
        )
        result.append(compared)
    return result


def _times(bounces: int) -> str:
    return "one bounce" if bounces == 1 else f"{bounces} bounces"


def _in_single(asked: Asked, rows: np.ndarray) -> tuple[int, np.ndarray]:
    """Numbers that are not finite, and errors beside float64 for the same, rounded, inputs."""
    rounded = rows.astype(np.float32)
    single, double = ask(asked, rounded), ask(asked, rounded.astype(float))
    errors = [_worst(abs(single.numbers[n] - double.numbers[n])) for n in ("coverage", "seen")]
    return int(np.sum(single.non_finite)), np.max(errors, axis=0)
