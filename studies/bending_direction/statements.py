"""What the study says: findings in sentences, and metrics with targets."""

from __future__ import annotations

import math

import numpy as np

from designopt.study.results import Metric, Target
from studies.bending_direction.design import INSIDE, OUTLINES, Design
from studies.bending_direction.found import USES, Found
from studies.bending_direction.spec import BendingDirectionSpec
from studies.bending_direction.tables import THRESHOLDS, flipped, paper_tally, undecided
from studies.models.soft_finger.targets import stated

RIGHT, DECIDED, ABSTAINED, FRAME_MS = 96.0, 99.0, 6.0, 5.0

KNOBS = ("η", "Δl_B", "θ_BC")

LUCK = 0.01
"""Chance up to which fewer undecided images are taken for no luck."""


def metrics(spec: BendingDirectionSpec, found: Found) -> list[Metric]:
    """The study's numbers; targets belong to the stated finger and images."""
    asked = stated(
        spec,
        free=frozenset(),
        least={"images": 300, "small_images": 1000, "stability_images": 20},
    )
    made: list[Metric] = []

    def add(
        name: str,
        value: float,
        unit: str,
        description: str,
        target: Target | None = None,
        reference: float | None = None,
    ) -> None:
        made.append(Metric(name, value, unit, description, reference, target if asked else None))

    for frames in found.series:
        name = frames.truth.name.lower()
        plain, kept = frames.tally(0.0, "all"), frames.tally(spec.threshold, "all")
        printed = paper_tally(frames.truth, threshold=False)
        printed_kept = paper_tally(frames.truth, threshold=True)
        add(f"right_{name}_percent", 100 * plain.strict, "%",
            f"images bent {name} that are called so, without a threshold, by all points",
            Target(">=", RIGHT), 100 * printed.strict)  # fmt: skip
        add(f"decided_{name}_percent", 100 * kept.decided, "%",
            f"of those bent {name} and decided with a threshold of {spec.threshold:g} px, the "
            "part that is right", Target(">=", DECIDED), 100 * printed_kept.decided)  # fmt: skip
        add(f"abstained_{name}_percent", 100 * kept.abstained, "%",
            f"images bent {name} that are left undecided with it",
            Target("<=", ABSTAINED), 100 * printed_kept.abstained)  # fmt: skip
    blue = min(frames.tally(0.0, "blue").strict for frames in found.series)
    add("least_right_blue_percent", 100 * blue, "%",
        "the least part that is right in a direction by the points of blue alone, as in the paper, "
        "without a threshold", None, 96.0)  # fmt: skip
    add("frame_ms", 1e3 * found.seconds, "ms", "median time to find regions and points in a frame "
        "of 640 × 480 px on one core", Target("<=", FRAME_MS))  # fmt: skip
    own, best = found.designs[0], found.designs[-1]
    for key, design, words in (("spec", own, "the chamber in the spec"),
                               ("best", best, "the best chamber")):  # fmt: skip
        add(f"rate_{key}_px_per_deg", float(design.rates.mean()), "px/°",
            f"displacement per degree of bend as it starts, mean of the three outlines, {words}"
            )  # fmt: skip
    for use in USES[:2]:
        before, after = (undecided(found.small[i], spec.threshold, use) for i in (0, -1))
        points = "all points" if use == "all" else "the points of blue"
        add(f"undecided_small_spec_{use}", before, "", f"undecided images at small bends by "
            f"{points}, chamber in the spec")  # fmt: skip
        add(f"undecided_small_best_{use}", after, "", "the same images with the best chamber",
            Target("<=", before - 1))  # fmt: skip
        luck = flipped(found.small[0], found.small[-1], spec.threshold, use)
        add(f"fewer_undecided_p_value_{use}", luck.p_value, "", f"chance that this is luck: "
            f"{luck.gained} images are decided by the best chamber only, {luck.lost} by the other "
            "only", Target("<=", LUCK))  # fmt: skip
    add("odd_failures", sum(frame.failed for frame in found.odd), "",
        f"of {len(found.odd)} frames that are no proper images, those without the defined answer",
        Target("<=", 0))  # fmt: skip
    perfect = [row for row in found.bends if row.images == "perfect"]
    add("wrong_perfect", sum(row.answers.total() - row.answers["right"] for row in perfect), "",
        f"of {sum(row.answers.total() for row in perfect)} perfect images from 0.01° to 120° of "
        "bend, those with another answer than the right one, no threshold")  # fmt: skip
    kept = [row for row in found.bends if row.threshold]
    if kept:
        wrong = sum(row.answers["wrong"] + row.answers["undefined"] for row in kept)
        add("wrong_with_threshold", wrong, "", f"of {sum(row.answers.total() for row in kept)} "
            "images with all effects from 0.01° to 120°, wrong or missing directions with the "
            "threshold", Target("<=", 0))  # fmt: skip
    return made


def findings(spec: BendingDirectionSpec, found: Found) -> list[str]:
    """Plain sentences, most important first."""
    plain = [frames.tally(0.0, "all") for frames in found.series]
    kept = [frames.tally(spec.threshold, "all") for frames in found.series]
    lines = [
        f"Without a threshold {_range([t.strict for t in plain])} of the images of a direction are "
        f"right, by all seven points; the paper's blue points reach "
        f"{_range([f.tally(0.0, 'blue').strict for f in found.series])}, and have "
        f"{_range([paper_tally(f.truth, threshold=False).strict for f in found.series])} in "
        "Table II.",
        f"With a threshold of {spec.threshold:g} px {_range([t.decided for t in kept])} of those "
        f"decided are right, and {_range([t.abstained for t in kept])} are left undecided.",
        f'Table II counts "initial" as correct. Counted strictly, it has '
        f"{_printed(found, threshold=False)} right without and {_printed(found, threshold=True)} "
        "with its threshold.",
        *_thresholds(found),
        *_stages(found),
        *_design(spec, found),
    ]
    failed = [frame for frame in found.odd if frame.failed]
    kinds = len({frame.kind for frame in found.odd})
    lines.append(
        f"{len(found.odd)} frames of {kinds} kinds that are no proper images (dark, saturated, out "
        "of the chamber, a region missing, colours swapped and the like) have "
        + (f"{len(failed)} wrong answers." if failed else "the answer defined for them, each.")
    )
    return lines


def _range(parts: list[float]) -> str:
    parts = [part for part in parts if math.isfinite(part)]
    if not parts:
        return "none"
    low, high = 100 * min(parts), 100 * max(parts)
    return f"{low:.1f} %" if f"{low:.1f}" == f"{high:.1f}" else f"{low:.1f}–{high:.1f} %"


def gone_at(areas: np.ndarray, bends: np.ndarray) -> float | None:
    """The bend from which on nothing is left of an area; None if something always is."""
    empty = areas == 0
    if empty.all():
        return float(bends[0])
    if not empty[-1]:
        return None
    return float(bends[len(empty) - int(np.argmin(empty[::-1]))])


def _printed(found: Found, *, threshold: bool) -> str:
    return _range([paper_tally(frames.truth, threshold).strict for frames in found.series])


def _thresholds(found: Found) -> list[str]:
    """Which thresholds meet both what is asked of decided and of undecided images."""
    good = []
    for least in THRESHOLDS:
        tallies = [frames.tally(least, "all") for frames in found.series]
        if all(100 * t.decided >= DECIDED and 100 * t.abstained <= ABSTAINED for t in tallies):
            good.append(least)
    if not good:
        return []
    return [
        f"Of the thresholds tried, {', '.join(f'{least:g}' for least in good)} px leave at most "
        f"{ABSTAINED:g} % undecided with at least {DECIDED:g} % of the others right in every "
        "direction."
    ]


def _stages(found: Found) -> list[str]:
    gone, kept, shrinking = [], [], True
    for frames in found.curves:
        blue, yellow = np.array([look.areas for look in frames.looks]).T
        name, bends = frames.truth.name.lower(), np.rad2deg(frames.bends)
        at = gone_at(yellow, bends)
        if at is None:
            kept.append(name)
        else:
            gone.append(f"{name} {at:.0f}°")
            shrinking &= bool(blue[-1] < blue[np.searchsorted(bends, at)])
    lines = []
    if gone:
        then = ", and then blue shrinks" if shrinking else ""
        lines.append(
            f"Yellow shrinks until it is gone, from {', '.join(gone)} of bend on{then}: "
            "the two stages of the paper's Fig. 12."
            if then
            else f"Yellow is gone from {', '.join(gone)} of bend on."
        )
    if kept:
        lines.append(f"Bending {' and '.join(kept)}, yellow is in view up to 120°.")
    return lines


def _design(spec: BendingDirectionSpec, found: Found) -> list[str]:
    own, best = found.designs[0], found.designs[-1]
    gains = 100 * (best.rates / own.rates - 1)
    moved = []
    for knob, slopes in zip(KNOBS, own.slopes.T, strict=True):
        outlines = [name for name, slope in zip(OUTLINES, slopes, strict=True) if slope]
        moved.append(f"{knob}, that of {' and '.join(outlines)}")
    lines = [
        f"As the finger starts to bend, the outlines of blue, yellow and top move by "
        f"{_numbers(own)} px per degree. What changes it: {'; '.join(moved)}. The paper's points "
        "are none of the top's.",
        f"Within Table I's limits, and with blue inside the image by {INSIDE:g} px, they move "
        f"{'most' if best.rates.mean() > own.rates.mean() else 'at most'}, {_numbers(best)} px per "
        "degree, with "
        f"η = {float(best.knobs.eta):.2f}, Δl_B = {float(best.knobs.offset_b):.2f} mm and "
        f"θ_BC = {np.rad2deg(float(best.knobs.wall_angle_bc)):.2f}° "
        f"({gains[0]:+.1f} %, {gains[1]:+.1f} %, {gains[2]:+.1f} %); what holds it: "
        f"{', '.join(found.held_by)}.",
    ]
    images = sum(len(frames.looks) for frames in found.small[0])
    for use in USES[:2]:
        points = "all points" if use == "all" else "the points of blue"
        counts = [undecided(series, spec.threshold, use) for series in found.small]
        luck = flipped(found.small[0], found.small[-1], spec.threshold, use)
        alone = ", ".join(
            f"{count} with {design.name}"
            for design, count in zip(found.designs[1:-1], counts[1:-1], strict=True)
        )
        lines.append(
            f"Of {images} images of bends up to {spec.small_bend_deg:g}°, {points} leave "
            f"{counts[0]} undecided with the chamber in the spec, {counts[-1]} with that chamber "
            f"({luck.gained} gained, {luck.lost} lost, p = {luck.p_value:.2g}); {alone}."
        )
    return lines


def _numbers(design: Design) -> str:
    blue, yellow, top = design.rates
    return f"{blue:.2f}, {yellow:.2f} and {top:.2f}"
