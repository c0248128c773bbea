"""Surfaces less and less curved, and less and less rough, through the limits between the kinds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from perception.chamber import ChamberMap, Heights, SurfaceKind, classify_surface, measure_shape
from perception.chamber.surfaces import CURVED, ROUGH
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.surfaces import KINDS, drawn
from studies.surface_profile.trials import POINTS, Slide, Trial, touched

Quantity = Literal["sagitta", "roughness"]

OF: dict[Quantity, tuple[SurfaceKind, ...]] = {
    "sagitta": (SurfaceKind.CONVEX, SurfaceKind.CONCAVE),
    "roughness": (SurfaceKind.ROUGH,),
}
"""Kinds that have it, which take turns."""

LIMIT: dict[Quantity, float] = {"sagitta": CURVED, "roughness": ROUGH}
"""From which on a surface is called of these kinds, mm."""

WORD: dict[Quantity, str] = {"sagitta": "curved", "roughness": "rough"}
"""What it is called then."""

SIZED = 34
"""Random numbers of these surfaces do not meet others."""


@dataclass(frozen=True)
class Sized:
    """Slides along surfaces of one size.

    Attributes:
        quantity: which of the two was chosen.
        size: its true value, mm.
        trials: the slides; curved surfaces have no shoulders.
    """

    quantity: Quantity
    size: float
    trials: list[Trial]

    def told(self, way: str = POINTS) -> float:
        """Part that is called what it is; convex called concave is not."""
        return float(np.mean([one.told(way) for one in self.trials]))

    def told_exactly(self) -> float:
        """The same by the heights that the pad rides, without any error."""
        kinds = []
        for one in (trial.slide for trial in self.trials):
            exact = Heights(one.ridden, np.ones(len(one.x), bool))
            kinds.append(classify_surface(measure_shape(one.x, exact)) is one.surface.kind)
        return float(np.mean(kinds))

    def found(self, way: str = POINTS) -> float:
        """Median of the sagittas' magnitudes or roughnesses found, mm; NaN of nothing."""
        shapes = [one.shapes[way] for one in self.trials]
        sizes = [
            abs(one.sagitta) if self.quantity == "sagitta" else one.roughness
            for one in shapes
            if one
        ]
        return float(np.median(sizes)) if sizes else float("nan")


def slides(spec: SurfaceProfileSpec, quantity: Quantity, size: float, seed: int) -> list[Slide]:
    """Along surfaces of one size; at every size they are the same ones but for it."""
    made = []
    for number in range(spec.size_slides):
        kind = OF[quantity][number % len(OF[quantity])]
        generator = np.random.default_rng([seed, SIZED, KINDS.index(kind), number])
        surface = drawn(kind, spec.slide, generator).of_size(size, spec.slide)
        made.append(Slide.under(spec, number, surface, generator))
    return made


def over_sizes(spec: SurfaceProfileSpec, design: ChamberMap, seed: int) -> list[Sized]:
    """All sizes, sagittas first, each rising; by the study's fingers, calibrated as they are."""
    chosen: dict[Quantity, list[float]] = {
        "sagitta": spec.sagittas,
        "roughness": spec.roughnesses,
    }
    sizes: list[tuple[Quantity, float]] = [
        (quantity, size) for quantity in chosen for size in sorted(chosen[quantity])
    ]
    asked = [
        (number, slide)
        for number, (quantity, size) in enumerate(sizes)
        for slide in slides(spec, quantity, size, seed)
    ]
    trials: list[list[Trial]] = [[] for _ in sizes]
    fingers = min(spec.fingers, spec.trials)
    for finger in range(fingers):
        # Pairs of kinds share the fingers.
        own = [(i, slide) for i, slide in asked if slide.number // 2 % fingers == finger]
        if own:
            found = touched(
                spec,
                design,
                finger,
                [slide for _, slide in own],
                seed,
                severity=spec.severity,
                counts=[spec.calibration],
            )
            for (i, _), trial in zip(own, found.trials, strict=True):
                trials[i].append(trial)
    return [
        Sized(quantity, size, some) for (quantity, size), some in zip(sizes, trials, strict=True)
    ]


def of_quantity(sized: Sequence[Sized], quantity: Quantity) -> list[Sized]:
    """Sizes of one of the two."""
    return [one for one in sized if one.quantity == quantity]


def none_up_to(sized: Sequence[Sized], way: str = POINTS) -> float | None:
    """The largest size up to which none is told; None where some of the least size are."""
    least = None
    for one in sized:
        if one.told(way) > 0:
            break
        least = one.size
    return least


def all_from(sized: Sequence[Sized], way: str = POINTS) -> float | None:
    """The least size from which on all are told; None where not all of the largest size are."""
    most = None
    for one in reversed(sized):
        if one.told(way) < 1:
            break
        most = one.size
    return most
