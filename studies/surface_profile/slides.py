"""Fingers calibrated on a flat plate and slid along surfaces; heights and shapes from images."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from designopt.study.records import Records
from optics.chamber import Posture
from optics.rendering import ChamberImage
from perception import chamber
from perception.chamber import ChamberMap, Heights, Points, SurfaceKind, compute_movements
from perception.chamber.heights import TRACKED
from studies.models.soft_finger.finger import SoftFinger, looked_at
from studies.surface_profile import SurfaceProfileSpec
from studies.surface_profile.sensor import UP, highest, postures_on
from studies.surface_profile.surfaces import KINDS, Surface, sample_surface

FINGER, TRIAL, PLATE, SIZED = 31, 32, 33, 34
"""Random numbers of fingers, trials, calibrations and surfaces of chosen sizes do not meet."""


@dataclass(frozen=True)
class Slide:
    """A surface under the finger, to be photographed.

    Attributes:
        number: of all slides.
        surface: which.
        x: places along the slide, mm.
        bare: the surface's height there, over its own lowest ridden place, mm.
        ridden: the height at which the pad rides it, likewise.
        direction: to which side the finger bends, rad.
        size: of the surface where one was chosen (`Surface.of_size`), mm; else NaN.
    """

    number: int
    surface: Surface
    x: Float[np.ndarray, " frames"]
    bare: Float[np.ndarray, " frames"]
    ridden: Float[np.ndarray, " frames"]
    direction: float
    size: float

    @classmethod
    def sample(
        cls,
        spec: SurfaceProfileSpec,
        number: int,
        seed: int,
        kind: str = "",
        size: float = math.nan,
    ) -> Slide:
        """A random one; without a kind, the kinds take turns.

        Args:
            spec: of the study.
            number: of the slide.
            seed: of everything random.
            kind: name of the kind of a surface of a chosen size.
            size: that size, mm; surfaces of all sizes are the same but for it.
        """
        which = KINDS.index(SurfaceKind[kind.upper()]) if kind else number % len(KINDS)
        stream = np.random.default_rng([seed, *([SIZED, which] if kind else [TRIAL]), number])
        surface = sample_surface(KINDS[which], spec.slide, stream)
        surface = surface.of_size(size, spec.slide) if kind else surface
        x = np.linspace(-spec.slide / 2, spec.slide / 2, spec.frames)
        bare, ridden = surface.height(x), surface.ridden(x, spec.tip_radius)
        # The finger bends towards the surface, but for some scatter.
        turned = np.deg2rad(spec.direction_scatter_deg) * float(stream.standard_normal())
        low = ridden.min()
        return cls(number, surface, x, bare - low, ridden - low, UP + turned, size)


@dataclass(frozen=True)
class SlidingTest:
    """Fingers as they are made slide along surfaces; what is found is added to records.

    Attributes:
        spec: of the study.
        seed: of everything random.
        design: map that the chamber's design predicts.
        heights: a row for every place of every slide and every number of calibration ``frames``:
            errors from the height that the pad rides, in full, ``full_error_mm``, and up to a
            constant for every slide, ``error_mm``, by b, e and g; NaN where the height is
            ``unknown``. With ``e_`` before, by e alone; with ``whole_``, by e in whole pixels, as
            in the paper but for its mm. ``bare_error_mm`` is from the bare surface,
            ``pad_error_mm`` how far the height that the pad rides is off it; ``e_px`` and
            ``whole_px`` are movements of e.
        shapes: a row for every slide: what its surface is ``called``, sagitta and roughness found
            by b, e and g; whether it is called what it is, ``told``, with ``exact_`` before by the
            heights that the pad rides, without any error.
        fingers: a row for each: the scale of b's, e's and g's movement that calibrating found over
            the design's, and the scatter at rest, of all points alike and of each.
    """

    spec: SurfaceProfileSpec
    seed: int
    design: ChamberMap
    heights: Records = field(default_factory=Records)
    shapes: Records = field(default_factory=Records)
    fingers: Records = field(default_factory=Records)

    def finger(self, number: int) -> SoftFinger:
        """One of the fingers, with errors of fabrication."""
        stream = np.random.default_rng([self.seed, FINGER, number])
        return SoftFinger.of(self.spec).made(self.spec.made, stream)

    def rest(
        self, finger: SoftFinger, severity: float, seed: int, first: int = 0
    ) -> tuple[list[Points], ChamberMap]:
        """Points of a finger that touches nothing, and the map as designed with their scatter."""
        still = finger.postures(np.zeros(self.spec.rest_frames), UP)
        rest = view_points(finger, still, severity, seed, first)
        shake, noise = chamber.estimate_scatter(compute_movements(rest, rest))
        return rest, replace(self.design, shake=shake, noise=noise)

    def slide(
        self, number: int, slides: Sequence[Slide], severity: float, counts: Sequence[int]
    ) -> None:
        """Photograph a finger at rest, on plates and on surfaces, and find heights and shapes.

        Args:
            number: of the finger; the random numbers of its images follow from it and the seed.
            slides: along which surfaces.
            severity: of the images.
            counts: frames to calibrate with; shapes are found with the first of them.
        """
        spec, finger = self.spec, self.finger(number)
        images = int(np.random.SeedSequence([self.seed, FINGER, number]).generate_state(1)[0])
        stream = np.random.default_rng([self.seed, PLATE, number])
        asked = [np.linspace(spec.preload, highest(spec), count) for count in counts]
        runs = [(one + spec.setting_error * stream.standard_normal(len(one)), UP) for one in asked]
        runs += [(spec.preload + slide.ridden, slide.direction) for slide in slides]
        deflections = np.concatenate([one for one, _ in runs])
        directions = np.concatenate([np.full(len(one), direction) for one, direction in runs])
        rest, prior = self.rest(finger, severity, images)
        postures = postures_on(finger, spec, deflections, directions)
        points = view_points(finger, postures, severity, images, spec.rest_frames)
        ends = itertools.pairwise(np.cumsum([0, *(len(one) for one, _ in runs)]))
        moved = [
            [compute_movements(points[start:end], rest, whole=whole) for whole in (False, True)]
            for start, end in ends
        ]
        maps = [
            [prior.calibrated(heights, one) for one in plate]
            for heights, plate in zip(asked, moved, strict=False)
        ]
        for slide, (subpixel, whole) in zip(slides, moved[len(counts) :], strict=True):
            kind, pad = slide.surface.kind, slide.ridden - slide.bare
            names = {"severity": severity, "finger": number + 1, "slide": slide.number}
            names |= {"surface": kind.name.lower()}
            for count, (fine, coarse) in zip(counts, maps, strict=True):
                exact = Heights(spec.preload + slide.ridden, np.ones(len(slide.x), bool))
                found = {"": fine.height(subpixel), "e_": fine.height(subpixel, use="e")}
                found["whole_"] = coarse.height(whole, use="e")
                off = {
                    way: np.where(one.known, one.mm - exact.mm, np.nan)
                    for way, one in found.items()
                }
                self.heights.add(
                    **names,
                    frames=count,
                    unknown=~found[""].known,
                    e_px=subpixel.px[:, TRACKED.index("e")],
                    whole_px=whole.px[:, TRACKED.index("e")],
                    **{f"{way}full_error_mm": one for way, one in off.items()},
                    **{f"{way}error_mm": up_to_a_constant(one) for way, one in off.items()},
                    bare_error_mm=up_to_a_constant(off[""] + pad),
                    pad_error_mm=up_to_a_constant(pad),
                )
                if count == counts[0]:
                    found["exact_"] = exact
                    shapes = {way: chamber.measure_shape(slide.x, h) for way, h in found.items()}
                    kinds = {way: chamber.classify_surface(one) for way, one in shapes.items()}
                    self.shapes.add(
                        **names,
                        size_mm=slide.size,
                        called=kinds[""].name.lower(),
                        **{f"{way}told": one is kind for way, one in kinds.items()},
                        sagitta_mm=getattr(shapes[""], "sagitta", math.nan),
                        roughness_mm=getattr(shapes[""], "roughness", math.nan),
                    )
        scales = np.ptp(maps[0][0].moved, axis=0) / np.ptp(self.design.moved, axis=0)
        scatter = {"shake_px": prior.shake, "noise_px": prior.noise}
        scaled = {f"scale_{name}": one for name, one in zip(TRACKED, scales, strict=True)}
        self.fingers.add(finger=number + 1, severity=severity, **scaled, **scatter)


def up_to_a_constant(errors: Float[np.ndarray, " frames"]) -> Float[np.ndarray, " frames"]:
    """Errors less the mean of those that are finite."""
    known = np.isfinite(errors)
    return errors - errors[known].mean() if known.any() else errors


def view_points(
    finger: SoftFinger, postures: Posture, severity: float, seed: int, first: int
) -> list[Points]:
    """Points found in a picture of every posture; the first one has this number."""
    return looked_at(finger.renderer(seed, severity=severity), postures, look, first)


def look(_: int, image: ChamberImage) -> Points:
    """Points of a picture."""
    return chamber.find_points(image.pixels, chamber.find_regions(image.pixels))
