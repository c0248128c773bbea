"""Everything that the study measured, and errors of profiles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from perception.chamber import ChamberMap, Heights, Points, SurfaceKind
from studies.surface_profile.limits import Sized
from studies.surface_profile.odd import AtBend, Odd
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.trials import POINTS, Touching, Trial, found_heights


@dataclass(frozen=True)
class Picture:
    """A picture for the figures: what it shows, in words, its pixels and what was found."""

    title: str
    pixels: UInt8[np.ndarray, "rows columns 3"]
    points: Points


@dataclass(frozen=True)
class Found:
    """Everything that was measured.

    Attributes:
        design: the map that the chamber's design predicts.
        fingers: at the stated severity; those with slides.
        severities: one finger at others.
        sized: surfaces of sizes through the limits.
        odd: frames that are no proper images.
        bends: heights over the bend.
        seconds: to find the points of a frame, on one core.
        pictures: what the camera sees.
    """

    design: ChamberMap
    fingers: list[Touching]
    severities: list[Touching]
    sized: list[Sized]
    odd: list[Odd]
    bends: list[AtBend]
    seconds: float
    pictures: list[Picture]

    @property
    def trials(self) -> list[Trial]:
        """All at the stated severity, in their order."""
        every = [trial for finger in self.fingers for trial in finger.trials]
        return sorted(every, key=lambda trial: trial.slide.number)


def of_kind(trials: Iterable[Trial], kind: SurfaceKind) -> list[Trial]:
    """Those whose surface is of a kind."""
    return [trial for trial in trials if trial.slide.surface.kind is kind]


def profile_errors(
    found: Heights, truth: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, " known"]:
    """Heights found less the true ones, up to a constant: less their mean, mm."""
    off = (found.mm - truth)[found.known]
    return off - off.mean() if len(off) else off


def errors(trials: Iterable[Trial], way: str = POINTS) -> Float[np.ndarray, " known"]:
    """Of all heights of some trials, from those that the pad rides."""
    return _joined(profile_errors(one.heights[way], one.slide.ridden) for one in trials)


def surface_errors(trials: Iterable[Trial], way: str = POINTS) -> Float[np.ndarray, " known"]:
    """The same from the bare surface."""
    return _joined(profile_errors(one.heights[way], one.slide.bare) for one in trials)


def stylus_errors(trials: Iterable[Trial]) -> Float[np.ndarray, " known"]:
    """What of it is the pad's: by how much it rides higher than the surface, up to a constant."""
    off = [one.slide.ridden - one.slide.bare for one in trials]
    return _joined(one - one.mean() for one in off)


def calibrated_errors(
    spec: SurfaceProfileSpec, fingers: Iterable[Touching], count: int, way: str
) -> tuple[Float[np.ndarray, " known"], Float[np.ndarray, " known"]]:
    """Up to a constant and in full, of all heights by maps from so many calibration frames."""
    shapes, whole = [], []
    for finger in fingers:
        for trial in finger.trials:
            maps = finger.calibrations[count]
            found = found_heights(spec, maps, trial.moved, trial.whole)[way]
            shapes.append(profile_errors(found, trial.slide.ridden))
            whole.append((found.mm - trial.slide.ridden)[found.known])
    return _joined(shapes), _joined(whole)


def quantiles(numbers: Float[np.ndarray, " _"], *at: float) -> tuple[float, ...]:
    """Quantiles of the numbers' magnitudes; NaN of nothing."""
    return tuple(
        float(np.quantile(np.abs(numbers), q)) if len(numbers) else float("nan") for q in at
    )


def share(told: Iterable[bool]) -> float:
    """Part that is true; NaN of nothing."""
    every = list(told)
    return sum(every) / len(every) if every else float("nan")


def _joined(parts: Iterable[np.ndarray] | Iterator[np.ndarray]) -> Float[np.ndarray, " _"]:
    return np.concatenate([*parts, np.zeros(0)])
