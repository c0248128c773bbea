"""The study's tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from designopt.study.results import Cell, Table
from perception.chamber import Direction
from perception.chamber.directions import Use
from studies.bending_direction import paper
from studies.bending_direction.design import OUTLINES, Design
from studies.bending_direction.found import USES, Found
from studies.bending_direction.frames import Series
from studies.bending_direction.odd import AtBend, Odd
from studies.bending_direction.rules import Tally
from studies.bending_direction.spec import BendingDirectionSpec
from studies.models.soft_finger.odd import status_words

OPEN = (Direction.INITIAL, Direction.UNDEFINED)
"""Answers that name no direction."""

THRESHOLDS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0)

ANSWERS = (*paper.ANSWERS, Direction.UNDEFINED)
"""The paper's columns, and the answer that it does not have."""

RULES = ("paper", "strict", "decided", "abstained")


def tables(spec: BendingDirectionSpec, found: Found) -> list[Table]:
    """Every table of the study."""
    return [
        directions(found.series, spec.threshold),
        small_bends(spec, found),
        flips(spec, found),
        thresholds(found.series),
        designs(found.designs),
        bends(found.bends),
        odd(found.odd),
    ]


def paper_tally(truth: Direction, threshold: bool) -> Tally:
    """Table II's answers."""
    counts = paper.COUNTS[truth, threshold]
    return Tally.of_counts(truth, zip(paper.ANSWERS, counts, strict=True))


def _percent(tally: Tally) -> list[Cell]:
    return [100 * getattr(tally, rule) for rule in RULES]


def directions(series: Sequence[Series], threshold: float) -> Table:
    """Table II, the paper's and ours, by every rule."""
    rows: list[list[Cell]] = []
    for frames in series:
        for least in dict.fromkeys((0.0, threshold)):
            own: list[tuple[str, Tally]] = [("paper A", paper_tally(frames.truth, least > 0))]
            own += [(f"ours, {use}", frames.tally(least, use)) for use in USES]
            rows += [
                [
                    frames.truth.name.lower(),
                    "yes" if least else "no",
                    source,
                    *(tally.count(answer) for answer in ANSWERS),
                    *_percent(tally),
                ]
                for source, tally in own
            ]
    return Table(
        "directions",
        "Table II of paper A and ours, answer by answer and rule by rule: the paper counts "
        '"initial" as correct, strictly it is not, decided leaves undecided images out',
        [
            "direction",
            "threshold",
            "source",
            *(answer.name.lower() for answer in ANSWERS),
            *(f"{rule}_percent" for rule in RULES),
        ],
        rows,
        {f"{rule}_percent": 2 for rule in RULES},
    )


def undecided(series: Sequence[Series], threshold: float, use: Use) -> int:
    """Images of all directions for which none was named."""
    return sum(frames.tally(threshold, use).undecided for frames in series)


def small_bends(spec: BendingDirectionSpec, found: Found) -> Table:
    """Undecided images at small bends, chamber by chamber."""
    rows: list[list[Cell]] = []
    for design, series in zip(found.designs, found.small, strict=True):
        for use in USES:
            tallies = [frames.tally(spec.threshold, use) for frames in series]
            plain = [frames.tally(0.0, use) for frames in series]
            right = sum(tally.count(tally.truth) for tally in plain)
            images = sum(len(tally.answers) for tally in tallies)
            wrong = sum(len(t.answers) - t.undecided - t.count(t.truth) for t in tallies)
            rows.append(
                [
                    design.name,
                    use,
                    images,
                    sum(tally.undecided for tally in tallies),
                    wrong,
                    100 * right / images,
                ]
            )
    return Table(
        "small_bends",
        f"Bends up to {spec.small_bend_deg:g}°, the same ones with the same shake and noise for "
        f"both chambers: images left undecided with a threshold of {spec.threshold:g} px, wrong "
        "ones, and right ones without a threshold",
        ["chamber", "points", "images", "undecided", "wrong", "right_without_percent"],
        rows,
        {"right_without_percent": 2},
    )


@dataclass(frozen=True)
class Flips:
    """Images that one of two chambers leaves undecided and the other does not.

    Attributes:
        gained: decided with the second chamber only.
        lost: decided with the first one only.
        p_value: chance of so many gained or more, were either as likely (one-sided sign test).
    """

    gained: int
    lost: int
    p_value: float


def flipped(before: Sequence[Series], after: Sequence[Series], threshold: float, use: Use) -> Flips:
    """How the same bends, with the same shake and noise, are decided with two chambers."""
    gained = lost = 0
    for one, other in zip(before, after, strict=True):
        pairs = zip(
            one.tally(threshold, use).answers, other.tally(threshold, use).answers, strict=True
        )
        for first, second in pairs:
            gained += first in OPEN and second not in OPEN
            lost += first not in OPEN and second in OPEN
    both = gained + lost
    p_value = float(binomtest(gained, both, alternative="greater").pvalue) if both else 1.0
    return Flips(gained, lost, p_value)


def flips(spec: BendingDirectionSpec, found: Found) -> Table:
    """Every chamber against the study's own, image by image."""
    rows: list[list[Cell]] = []
    for design, series in zip(found.designs[1:], found.small[1:], strict=True):
        for use in USES:
            one = flipped(found.small[0], series, spec.threshold, use)
            rows.append([design.name, use, one.gained, one.lost, one.p_value])
    return Table(
        "flips",
        "Images of small bends that only this chamber decides, and that only the study's own does, "
        "with the one-sided sign test's chance that this is luck",
        ["chamber", "points", "gained", "lost", "p_value"],
        rows,
    )


def thresholds(series: Sequence[Series]) -> Table:
    """Decided and undecided images over the threshold, the worst direction of each."""
    rows: list[list[Cell]] = []
    for use in USES:
        for least in THRESHOLDS:
            tallies = [frames.tally(least, use) for frames in series]
            decided = [100 * t.decided for t in tallies if t.undecided < len(t.answers)]
            rows.append(
                [use, least, min(decided, default=None),
                 max(100 * tally.abstained for tally in tallies)]
            )  # fmt: skip
    return Table(
        "thresholds",
        "Over the threshold, in the direction where it is worst: of the decided images those that "
        "are right, and the undecided ones",
        ["points", "threshold_px", "least_decided_percent", "most_abstained_percent"],
        rows,
        {"least_decided_percent": 2, "most_abstained_percent": 2},
    )


def designs(made: Sequence[Design]) -> Table:
    """Chambers, how their images move, and what changes that."""
    rows: list[list[Cell]] = []
    for design in made:
        for outline, rate, slopes in zip(OUTLINES, design.rates, design.slopes, strict=True):
            rows.append(
                [
                    design.name,
                    float(design.knobs.eta),
                    float(design.knobs.offset_b),
                    float(np.rad2deg(design.knobs.wall_angle_bc)),
                    float(design.finger.chamber.offset_d),
                    outline,
                    float(rate),
                    *map(float, slopes),
                ]
            )
    return Table(
        "designs",
        "Displacement of each outline per degree of bend as the finger starts to bend, and its "
        "derivatives with respect to η, Δl_B and θ_BC",
        [
            "chamber",
            "eta",
            "offset_b_mm",
            "theta_bc_deg",
            "offset_d_mm",
            "outline",
            "rate_px_per_deg",
            "slope_eta_px_per_deg",
            "slope_offset_b_px_per_deg_mm",
            "slope_theta_bc_px_per_deg2",
        ],
        rows,
    )


def bends(rows: Sequence[AtBend]) -> Table:
    """Answers over the bend."""
    answers = ("right", "not bent", "wrong", "undefined")
    return Table(
        "bends",
        "Answers of all points from hardly bent to far, over all directions",
        ["images", "threshold_px", "bend_deg", *(one.replace(" ", "_") for one in answers)],
        [
            [row.images, row.threshold, row.bend_deg, *(row.answers[one] for one in answers)]
            for row in rows
        ],
    )


def odd(frames: Sequence[Odd]) -> Table:
    """Answers to frames that are no proper images."""
    rows: list[list[Cell]] = []
    for kind in dict.fromkeys(frame.kind for frame in frames):
        own = [frame for frame in frames if frame.kind == kind]
        rows.append(
            [
                kind.name,
                len(own),
                status_words(kind.status),
                "the direction" if kind.in_view else "undefined",
                ", ".join(sorted({status_words(frame.status)
                                  for frame in own})),
                sum(frame.failed for frame in own),
            ]
        )  # fmt: skip
    return Table(
        "odd_frames",
        "Frames that are no proper images: what is to be answered, and how often it was not",
        ["kind", "frames", "expected_sight", "expected_direction", "sights", "failures"],
        rows,
    )
