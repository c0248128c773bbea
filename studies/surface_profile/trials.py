"""Fingers calibrated on a flat plate and slid along surfaces; what their images say."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from optics.chamber import Posture
from perception.chamber import (
    ChamberMap,
    Heights,
    Movements,
    Points,
    Shape,
    SurfaceKind,
    classify_surface,
    compute_movements,
    estimate_scatter,
    find_points,
    find_regions,
    measure_shape,
)
from studies.models.soft_finger.finger import SoftFinger, looked_at
from studies.surface_profile.sensor import UP, designed_map, highest, postures_on
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.surfaces import KINDS, Surface, drawn

FINGER, TRIAL, PLATE = 31, 32, 33
"""Random numbers of fingers, trials and calibrations do not meet."""

POINTS, YELLOW, WHOLE = "b, e and g", "e", "e, whole pixels"
"""Three ways to a height; the last is the paper's, but for its millimetres."""

WAYS = POINTS, YELLOW, WHOLE


@dataclass(frozen=True)
class Slide:
    """A surface under the finger, to be photographed.

    Attributes:
        number: of all trials.
        surface: which.
        x: places along the slide, mm.
        bare: the surface's height there, over its own lowest ridden place, mm.
        ridden: the height at which the pad rides it, likewise.
        direction: to which side the finger bends, rad.
    """

    number: int
    surface: Surface
    x: Float[np.ndarray, " frames"]
    bare: Float[np.ndarray, " frames"]
    ridden: Float[np.ndarray, " frames"]
    direction: float

    @classmethod
    def drawn(cls, spec: SurfaceProfileSpec, number: int, seed: int) -> Slide:
        """One of all trials; the kinds take turns."""
        generator = np.random.default_rng([seed, TRIAL, number])
        surface = drawn(KINDS[number % len(KINDS)], spec.slide, generator)
        return cls.under(spec, number, surface, generator)

    @classmethod
    def under(
        cls, spec: SurfaceProfileSpec, number: int, surface: Surface, generator: np.random.Generator
    ) -> Slide:
        """Along a surface, the finger bent towards it but for some scatter."""
        x = np.linspace(-spec.slide / 2, spec.slide / 2, spec.frames)
        ridden = surface.ridden(x, spec.tip_radius)
        turned = np.deg2rad(spec.direction_scatter_deg) * float(generator.standard_normal())
        lowest = ridden.min()
        return cls(number, surface, x, surface.height(x) - lowest, ridden - lowest, UP + turned)


@dataclass(frozen=True)
class Trial:
    """What a slide's images said.

    Attributes:
        slide: the truth.
        severity: of the images.
        finger: which.
        moved: b, e and g, finer than a pixel.
        whole: in whole pixels.
        heights: deflections found, by the way in `WAYS`, mm.
        shapes: of these profiles; none where too little of one is known.
    """

    slide: Slide
    severity: float
    finger: int
    moved: Movements
    whole: Movements
    heights: dict[str, Heights]
    shapes: dict[str, Shape | None]

    def kind(self, way: str = POINTS) -> SurfaceKind:
        """What the surface was taken for."""
        return classify_surface(self.shapes[way])

    def told(self, way: str = POINTS) -> bool:
        """Whether it was taken for what it is."""
        return self.kind(way) is self.slide.surface.kind


@dataclass(frozen=True)
class Touching:
    """One finger with all frames of its that are asked for.

    Attributes:
        number: of the finger.
        severity: of its images.
        shake: of all points alike, at rest, px.
        noise: of each point, at rest, px.
        calibrations: by number of frames, the map, with `WHOLE` that for whole pixels.
        trials: its slides.
    """

    number: int
    severity: float
    shake: float
    noise: float
    calibrations: dict[int, tuple[ChamberMap, ChamberMap]]
    trials: list[Trial]


def _plates(
    spec: SurfaceProfileSpec, counts: Sequence[int], seed: int, number: int
) -> tuple[list[Float[np.ndarray, " some"]], list[Float[np.ndarray, " some"]]]:
    """Heights of the plate as asked for and as set, for every number of frames."""
    generator = np.random.default_rng([seed, PLATE, number])
    asked, real = [], []
    for count in counts:
        heights = np.linspace(spec.preload, highest(spec), count)
        asked.append(heights)
        real.append(heights + spec.setting_error * generator.standard_normal(count))
    return asked, real


def made_finger(spec: SurfaceProfileSpec, seed: int, number: int) -> SoftFinger:
    """One of the fingers, with errors of fabrication."""
    generator = np.random.default_rng([seed, FINGER, number])
    return SoftFinger.of(spec).made(spec.made, generator)


def touched(
    spec: SurfaceProfileSpec,
    design: ChamberMap,
    number: int,
    slides: Sequence[Slide],
    seed: int,
    *,
    severity: float,
    counts: Sequence[int],
) -> Touching:
    """Photograph a finger at rest, on plates and on surfaces, and find heights.

    Args:
        spec: of the study.
        design: the map as designed.
        number: of the finger; the random numbers of its images follow from it and the seed.
        slides: along which surfaces.
        seed: of everything random.
        severity: of the images.
        counts: frames to calibrate with; heights are found with the first of them.
    """
    finger = made_finger(spec, seed, number)
    images = int(np.random.SeedSequence([seed, FINGER, number]).generate_state(1)[0])
    asked, real = _plates(spec, counts, seed, number)
    deflections = [*real, *[spec.preload + slide.ridden for slide in slides]]
    directions = [np.full(len(one), UP) for one in real]
    directions += [np.full(len(slide.x), slide.direction) for slide in slides]
    still = finger.postures(np.zeros(spec.rest_frames), np.full(spec.rest_frames, UP))
    rest = _points(finger, still, images, severity, 0)
    postures = postures_on(finger, spec, np.concatenate(deflections), np.concatenate(directions))
    frames = _points(finger, postures, images, severity, spec.rest_frames)
    starts = np.cumsum([0, *map(len, deflections)])
    runs = [frames[start:end] for start, end in itertools.pairwise(starts)]

    shake, noise = estimate_scatter(compute_movements(rest, rest))
    prior = dataclasses.replace(design, shake=shake, noise=noise)
    calibrations = {
        count: (
            prior.calibrated(heights, compute_movements(run, rest)),
            prior.calibrated(heights, compute_movements(run, rest, whole=True)),
        )
        for count, heights, run in zip(counts, asked, runs, strict=False)
    }
    trials = []
    for slide, run in zip(slides, runs[len(counts) :], strict=True):
        moved, whole = compute_movements(run, rest), compute_movements(run, rest, whole=True)
        heights = found_heights(spec, calibrations[counts[0]], moved, whole)
        shapes = {way: measure_shape(slide.x, found) for way, found in heights.items()}
        trials.append(Trial(slide, severity, number, moved, whole, heights, shapes))
    return Touching(number, severity, shake, noise, calibrations, trials)


def found_heights(
    spec: SurfaceProfileSpec,
    maps: tuple[ChamberMap, ChamberMap],
    moved: Movements,
    whole: Movements,
) -> dict[str, Heights]:
    """Heights over that of the preload, in every way."""
    fine, coarse = maps
    found = {
        POINTS: fine.height(moved),
        YELLOW: fine.height(moved, use="e"),
        WHOLE: coarse.height(whole, use="e"),
    }
    return {
        way: Heights(np.where(one.known, one.mm - spec.preload, 0.0), one.known)
        for way, one in found.items()
    }


def _points(
    finger: SoftFinger, postures: Posture, seed: int, severity: float, first: int
) -> list[Points]:
    renderer = finger.renderer(seed, severity=severity)
    return looked_at(
        renderer,
        postures,
        lambda _, image: find_points(image.pixels, find_regions(image.pixels)),
        first,
    )


def design_of(spec: SurfaceProfileSpec) -> ChamberMap:
    """The map that the design predicts."""
    return designed_map(SoftFinger.of(spec), spec)
