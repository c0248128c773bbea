"""What the study says: findings in sentences, and metrics with targets."""

from __future__ import annotations

import math

import numpy as np

from designopt.study.results import Metric, Target
from perception.posture import compute_marker_errors
from studies.models.soft_finger.targets import stated
from studies.object_size.found import Found
from studies.object_size.spec import ObjectSizeSpec
from studies.object_size.tables import counts, summary, told_apart
from studies.object_size.trials import Measured

DEFAULT = ObjectSizeSpec()

ERROR_MM, TOLD_APART = 3.0, 0.95


def metrics(spec: ObjectSizeSpec, found: Found) -> list[Metric]:
    """The study's numbers; targets belong to the stated finger, hand and grasps."""
    asked = stated(
        spec,
        free=frozenset({"other_lamp_grasps"}),
        least={name: getattr(DEFAULT, name) for name in ("grasps", "random_grasps",
                                                         "stability_images")},
    )  # fmt: skip
    random = found.random
    error, bias, _, p95 = summary(random.errors(random.diameters))
    grasp = summary(random.errors(random.by_true_bend))[0]
    image = summary(random.errors(random.by_true_place))[0]
    other = summary(found.other_lamp.errors(found.other_lamp.diameters))[0]
    other_image = summary(found.other_lamp.errors(found.other_lamp.by_true_place))[0]
    trials, undefined = _undefined(found.grasps)
    others, other_undefined = _undefined([found.other_lamp])
    redrawn = sum(m.grasps.redrawn for m in [*found.grasps, found.other_lamp])
    tips, off = _off(found)
    frames = len(found.odd) + sum(len(one.said) for one in found.bends)
    slopes = np.abs(found.curve.slopes)

    def mm(name: str, value: float, description: str, target: Target | None = None) -> Metric:
        return Metric(name, value, "mm", description, None, target if asked else None)

    sizes = f"bottles of {spec.least:g} to {spec.largest:g} mm"
    return [
        mm("mean_absolute_error_mm", error, f"of the diameters of {spec.random_grasps} {sizes}, "
           "where there is an answer", Target("<=", ERROR_MM)),
        Metric("told_apart", told_apart(spec, found.bottles), "", "part of "
               f"{len(found.bottles.diameters)} grasps whose bottle was told from the others; "
               "without an answer it was not", None,
               Target(">=", TOLD_APART) if asked else None),
        mm("bias_mm", bias, f"mean error of the diameters of the same {sizes}"),
        mm("p95_mm", p95, "95th percentile of their absolute error"),
        mm("grasp_error_mm", grasp, "mean absolute error by the true bend: what a bottle off its "
           "place and the wall's giving way do"),
        mm("image_error_mm", image, "mean absolute error with the bottle's true place and wall: "
           "what is off in the bend found on the image"),
        Metric("undefined", undefined, "", f"of {trials} grasps, those without an answer", None,
               Target("<=", 0) if asked else None),
        Metric("odd_failures", found.odd_failures, "", f"of {frames} frames that are no proper "
               "images, or of fingers bent by 0.01° to 120°, those without the answer defined for "
               "them", None, Target("<=", 0) if asked else None),
        Metric("redrawn", redrawn, "", f"of {trials + others} grasps, bottles that lay so that the "
               "finger missed them, and were put into the hand anew"),
        mm("other_lamp_error_mm", other, f"mean absolute error of {others} {sizes} with a lamp "
           "that the network was not trained with"),
        mm("other_lamp_image_error_mm", other_image, "the same with the bottle's true place and "
           "wall"),
        Metric("other_lamp_undefined", other_undefined, "", "of these, grasps without an answer"),
        mm("tip_error_mm", float(tips.mean()) if len(tips) else math.nan, "mean distance of the "
           "fingertip's marker from where it is, over all grasps in which the chamber is seen"),
        Metric("bend_error_deg", float(np.rad2deg(np.sqrt(np.mean(off**2)))) if len(off)
               else math.nan, "°", "root mean square error of the bend over the same grasps"),
        Metric("largest_bend_error_deg", float(np.rad2deg(np.abs(off).max(initial=0))), "°", "the "
               "largest of these errors"),
        mm("largest_residual_mm", max(float(m.estimates.residuals.max()) for m in found.grasps),
           "the farthest that an image's markers are from their arc, over all grasps; beyond "
           f"{spec.largest_residual:g} mm there is no answer"),
        Metric("least_mm_per_deg", float(slopes.min()), "mm/°", "diameter for a degree of bend, "
               "where that is least"),
        Metric("largest_mm_per_deg", float(slopes.max()), "mm/°", "the same where it is most"),
        Metric("training_seconds", found.record.total_seconds, "s", f"training of the network on "
               f"{found.record.samples} images, compiling included"),
        Metric("frame_ms", 1e3 * found.seconds, "ms", "median time from a picture to a diameter, "
               "one after the other; OpenCV on one core, JAX on those that there are"),
    ]  # fmt: skip


def _undefined(grasps: list[Measured]) -> tuple[int, int]:
    """Number of grasps, and of those without an answer."""
    known = np.concatenate([one.estimates.known for one in grasps])
    return len(known), int(np.count_nonzero(~known))


def _off(found: Found) -> tuple[np.ndarray, np.ndarray]:
    """Errors of tips, mm, and of bends, in radians, where the chamber is seen."""
    tips, bends = [], []
    for one in found.grasps:
        said = one.estimates
        truth = one.marker_truth(float(found.hand.length))
        tips.append(compute_marker_errors(said.markers, truth)[said.seen, -1])
        bends.append((said.bends - one.grasps.bends)[said.seen])
    return np.concatenate(tips), np.concatenate(bends)


def findings(spec: ObjectSizeSpec, found: Found) -> list[str]:
    """Plain sentences, most important first."""
    random, curve = found.random, found.curve
    error, bias, _, p95 = summary(random.errors(random.diameters))
    grasp, image = (
        summary(random.errors(diameters))[0]
        for diameters in (random.by_true_bend, random.by_true_place)
    )
    right = int(np.trace(counts(spec, found)))
    names = [f"{diameter:g}" for diameter in spec.bottles]
    bends = np.rad2deg(curve.bends)
    slopes = np.abs(curve.slopes)
    lines = [
        f"Of {len(found.bottles.diameters)} grasps of bottles of {', '.join(names[:-1])} and "
        f"{names[-1]} mm, {right} ({100 * told_apart(spec, found.bottles):.1f} %) were told for "
        "what they are by the nearest diameter.",
        f"Diameters of {int(np.count_nonzero(random.estimates.known))} bottles with an answer, of "
        f"{spec.random_grasps} of {spec.least:g} to {spec.largest:g} mm, are off by {error:.2f} mm "
        f"in the mean and by {p95:.2f} mm at the 95th percentile; the bias is {bias:+.2f} mm.",
        f"By the true bend they would still be off by {grasp:.2f} mm, for a bottle is off its "
        "place and presses the wall in more or less; by the bend found on the image alone, with "
        f"the bottle's place known, by {image:.2f} mm.",
        _curve(found, bends, slopes),
    ]
    trials, undefined = _undefined(found.grasps)
    lines.append(
        f"{undefined} of {trials} grasps had no answer."
        if undefined
        else f"All {trials} grasps had an answer."
    )
    other = found.other_lamp
    by_image = summary(other.errors(other.by_true_place))[0]
    lines.append(
        f"With a lamp that the network was not trained with, "
        f"{int(np.count_nonzero(other.estimates.known))} of {len(other.diameters)} grasps have an "
        f"answer, off by {summary(other.errors(other.diameters))[0]:.2f} mm in the mean, by "
        f"{by_image:.2f} mm for the image alone."
    )
    frames = len(found.odd) + sum(len(one.said) for one in found.bends)
    failed = found.odd_failures
    lines.append(
        f"{frames} frames of fingers bent by 0.01° to 120°, and such that are no proper images "
        "(dark, saturated, out of the chamber, a region missing, colours swapped and the like), "
        "have "
        + (
            f"{failed} answers not defined for them."
            if failed
            else "the answer defined for them, each."
        )
    )
    return lines


def _curve(found: Found, bends: np.ndarray, slopes: np.ndarray) -> str:
    one = found.curve
    span = (
        f"from {one.diameters[0]:g} to {one.diameters[-1]:g} mm the finger bends by {bends[0]:.1f} "
        f"to {bends[-1]:.1f}°, and a degree is worth {slopes.min():.2f} to {slopes.max():.2f} mm"
    )
    if not one.monotone:
        return f"The bend does not tell the diameter everywhere: {span}."
    tip = one.arcs >= float(found.hand.length)
    at_tip = ""
    if tip.any() and not tip.all():
        at_tip = f"; bottles up to {one.diameters[tip][-1]:.0f} mm touch the fingertip, wider ones "
        at_tip += "the finger before it"
    return f"The wider a bottle, the less the finger bends: {span}{at_tip}."
