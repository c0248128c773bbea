"""Random scenes: the answers beside brute force, central differences and themselves in float32."""

from __future__ import annotations

from typing import Any

import numpy as np

from designopt.study.records import Records
from designopt.study.study import Context
from studies.oracles.rays import Bounds, Fans, bounds, follow
from studies.stability.judging import largest
from studies.stability.visibility import StabilitySpec
from studies.stability.visibility.scenes import (
    CAMERA,
    MIRRORS,
    PADS,
    PIXELS,
    STRUCTURE,
    Answers,
    Weights,
    ask,
    random_rows,
)

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


def compare(spec: StabilitySpec, context: Context) -> tuple[Records, Records]:
    """Compare the answers for random scenes, with each number of bounces.

    Returns:
        A row for each number of bounces, and rows of the scenes with each: whether the rays are
        ``fine``, then ``off``, ``excess``, ``step``, ``differ`` and ``disagree`` (`gaps`),
        ``non_finite`` and ``single``, the error in float32 (NaN where it is not asked for).
    """
    table, scenes = Records(), Records()
    rows = random_rows(spec.scenes, context.seed)
    with context.step(f"{spec.rays} rays in each of {spec.scenes} scenes"):
        found = bounds(STRUCTURE, Fans.of_rows(STRUCTURE, rows), spec.rays, spec.bounces)
    answers, coarse = {}, {}
    for bounces in range(1, spec.bounces + 1):
        with context.step(f"Random scenes, {bounces} bounces at most"):
            answers[bounces] = ask(bounces, rows)
            coarse[bounces] = gaps(found, answers[bounces], bounces)
    differ = np.any([some["differ"] for some in coarse.values()], axis=0)
    again = np.flatnonzero(differ | (np.arange(len(rows)) < spec.reference_scenes))
    with context.step(f"{spec.fine_rays} rays in each of {len(again)} scenes"):
        fans = Fans.of_rows(STRUCTURE, rows[again])
        closer = bounds(STRUCTURE, fans, spec.fine_rays, spec.bounces, BETWEEN)
    for bounces, own_answers in answers.items():
        fine = gaps(closer, own_answers.part(again), bounces)
        non_finite, single = own_answers.non_finite, np.full(len(rows), np.nan)
        with context.step(f"Gradients, {bounces} bounces at most"):
            slopes = gradients(bounces, rows[: spec.gradient_scenes])
        if spec.float32:
            with context.step(f"float32, {bounces} bounces at most"):
                in_single, single = compare_float32(bounces, rows)
                non_finite = non_finite + in_single
        own = {"bounces": bounces, "scene": np.arange(len(rows)), "fine": False}
        scenes.add(**own, **coarse[bounces], non_finite=non_finite, single=single)
        own |= {"scene": again, "fine": True}
        scenes.add(**own, **fine, non_finite=0, single=np.nan)
        table.add(
            bounces=bounces,
            scenes=len(rows),
            differ=np.sum(coarse[bounces]["differ"]),
            shot_again=len(again),
            differ_again=np.sum(fine["differ"]),
            disagree=np.sum(fine["disagree"]),
            worst_excess=largest(coarse[bounces]["excess"]),
            worst_excess_again=largest(fine["excess"]),
            worst_error_again=largest(fine["off"]),
            worst_step_again=largest(fine["step"]),
            wrong_verdicts=wrong_verdicts(found, own_answers),
            **landings(rows, own_answers, bounces),
            **slopes,
        )
    return table, scenes


def gaps(found: Bounds, answers: Answers, bounces: int) -> dict[str, np.ndarray]:
    """How the answers for some scenes lie in the bounds that rays found there.

    Returns:
        By name, of shape (scenes,): how far a coverage is ``off`` the middle of its bounds; by how
        much coverages, or what a path shows, leave theirs (``excess``); how much of a pad lies
        between two neighbouring rays (``step``), so that they miss what is narrower, such as a
        slit or a shadow between them; whether bounds are left at all, or the answer is NaN
        (``differ``), and whether by more than that (``disagree``).
    """
    coverage, seen = answers.numbers["coverage"], answers.numbers["seen"]
    around = found.coverage[:, bounces - 1]
    pairs = ((around, coverage), (found.seen[:, :, : seen.shape[1]], seen))
    beyond = [_worst(np.maximum(inner - own, own - outer)) for (inner, outer), own in pairs]
    excess = np.maximum(0, np.max(beyond, axis=0))
    return {
        "off": _worst(abs(coverage - np.mean(around, axis=0))),
        "excess": excess,
        "step": found.step,
        "differ": ~(excess <= SLACK),
        "disagree": ~(excess <= SLACK + found.step),
    }


def _worst(errors: np.ndarray) -> np.ndarray:
    """The largest error of each scene."""
    return np.max(errors.reshape(len(errors), -1), axis=1)


def wrong_verdicts(found: Bounds, answers: Answers) -> int:
    """Views that rays show and the answers deny, or whose verdict, margin and parts disagree."""
    ok, margin = answers.ok, answers.numbers["margin"]
    shown = found.seen[0, :, : ok.shape[1]] > 0
    contrary = (ok != (margin > 0)) & (abs(margin) > UNDECIDED)
    return int(np.sum((shown & ~ok) | contrary | (ok != (answers.numbers["seen"] > 0))))


def landings(rows: np.ndarray, answers: Answers, bounces: int) -> dict[str, Any]:
    """Follow a ray from the pixel at which each end of each piece is imaged.

    Returns:
        By name, how many rays; the largest angle by which one misses its end; the largest relative
        errors of a distance and of a resolution, and the largest error of a coordinate on a mirror.
    """
    numbers, worst, rays = answers.numbers, np.zeros(4), 0
    for path, word in enumerate(STRUCTURE.words(bounces)):
        for pad in range(PADS):
            scene, piece = np.nonzero((answers.present & (answers.path == path))[:, pad])
            some, width = Fans.of_rows(STRUCTURE, rows[scene]), rows[scene, CAMERA.stop + 1]
            first, last = np.moveaxis(some.ends[:, MIRRORS + pad], 1, 0)
            long = np.hypot(*(last - first).T)
            for end, where in enumerate((answers.start, answers.end)):
                at = (scene, pad, piece, end)
                turn = (PIXELS / 2 - numbers["pixels"][at]) * width / PIXELS
                hit, length, mirrors = follow(STRUCTURE, some, turn, word, pad)
                beside = (follow(STRUCTURE, some, turn + by, word, pad)[0] for by in (-1e-6, 1e-6))
                slope = abs(np.subtract(*beside)) / 2e-6
                spans = numbers["spans"][scene, pad, piece, : len(word), end]
                errors = (
                    (hit - where[scene, pad, piece]) / slope,
                    length / numbers["distance"][at] - 1,
                    mirrors - spans,
                    PIXELS / width / (slope * long) / numbers["px_per_mm"][at] - 1,
                )
                worst = np.maximum(worst, [np.max(abs(error), initial=0.0) for error in errors])
                rays += len(scene)
    names = ("worst_landing_rad", "worst_distance", "worst_reflection", "worst_resolution")
    return {"landings": rays, **dict(zip(names, worst.tolist(), strict=True))}


def gradients(bounces: int, rows: np.ndarray) -> dict[str, Any]:
    """Compare the gradients of a few sums with central differences at two steps.

    Args:
        bounces: most reflections of a path.
        rows: shape (scenes, inputs).

    Returns:
        By name, how many derivatives were compared, those where both steps agree; how many were
        left out, as a view changes its topology nearby; and by the name of the sum the largest
        error, relative to the gradient's largest entry or 1.
    """
    scenes, inputs = rows.shape
    moves = np.array([sign * step for step in STEPS for sign in (1, -1)])
    moved = rows + moves[:, None, None, None] * np.eye(inputs)[:, None]
    answers = ask(bounces, moved.reshape(-1, inputs))
    worst, compared = {}, 0
    for name, weights in GROUPS.items():
        gradient = ask(bounces, rows, weights).gradient
        scale = np.maximum(1, np.max(abs(gradient), axis=1, keepdims=True))
        sums = answers.summed(weights).reshape(len(STEPS), 2, inputs, scenes)
        first, second = (
            (high - low).T / (2 * step) for step, (high, low) in zip(STEPS, sums, strict=True)
        )
        smooth = abs(first - second) < AGREEMENT * scale
        error = (abs(gradient - first) / scale)[smooth]
        worst[f"worst_gradient: {name}"] = float(np.max(error, initial=0.0))
        compared += int(np.sum(smooth))
    return {"derivatives": compared, "left_out": len(GROUPS) * rows.size - compared, **worst}


def compare_float32(bounces: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers that are not finite, and errors beside float64 for the same, rounded, inputs."""
    rounded = rows.astype(np.float32)
    single, double = ask(bounces, rounded), ask(bounces, rounded.astype(float))
    errors = [_worst(abs(single.numbers[n] - double.numbers[n])) for n in ("coverage", "seen")]
    return single.non_finite, np.max(errors, axis=0)
