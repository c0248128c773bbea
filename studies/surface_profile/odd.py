"""Frames that are no proper images, and bends far beyond the map: what is said of heights."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from optics.chamber import bend_center_line
from perception.chamber import (
    ChamberMap,
    ChamberStatus,
    Heights,
    Points,
    compute_movements,
    estimate_scatter,
    find_points,
    find_regions,
)
from studies.models.soft_finger.finger import SoftFinger, looked_at
from studies.models.soft_finger.odd import Kind, odd_pictures
from studies.surface_profile.sensor import UP, highest, postures_on
from studies.surface_profile.spec import SurfaceProfileSpec

BENDS_DEG = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 15.0, 20.0, 30.0, 60.0, 70.0, 80.0, 90.0, 110.0, 120.0)
"""The map ends between 17° and 18°; yellow leaves the view between 70° and 80°."""

BEND_FRAMES = 4
"""At every bend, where frames differ."""

WITHIN = 0.5
"""A height that is farther off is wrong, mm; three times the scatter by b and g alone. Nearer to
an end of the map than that, heights need not be known, nor unknown."""


@dataclass(frozen=True)
class Odd:
    """What was said of one odd frame.

    Attributes:
        kind: what is odd.
        status: what was answered of the chamber; None after an exception.
        failed: whether the answer is not the defined one: sight, and a height only where blue's
            points are in view.
    """

    kind: Kind
    status: ChamberStatus | None
    failed: bool


@dataclass(frozen=True)
class AtBend:
    """Heights at one bend of a finger that nothing presses.

    Attributes:
        bend_deg: the bend.
        severity: of the pictures.
        deflection: where surfaces are touched, mm.
        heights: found.
        failures: frames whose height is missing, wrong, or not to be known.
    """

    bend_deg: float
    severity: float
    deflection: float
    heights: Heights
    failures: int


def wrong(
    chamber: ChamberMap, found: Heights, truth: Float[np.ndarray, " frames"]
) -> Bool[np.ndarray, " frames"]:
    """Frames whose height is known and off, or not known though it is well within the map."""
    right = np.isfinite(found.mm) & (np.abs(found.mm - truth) <= WITHIN)
    low, high = chamber.heights[0] + WITHIN, chamber.heights[-1] - WITHIN
    return np.where(found.known, ~right, (truth >= low) & (truth <= high))


def _at_rest(
    spec: SurfaceProfileSpec,
    design: ChamberMap,
    finger: SoftFinger,
    seed: int,
    severity: float,
    first: int,
) -> tuple[list[Points], ChamberMap]:
    """Points of a finger that touches nothing, and the map as designed with their scatter."""
    count = spec.rest_frames
    still = finger.postures(np.zeros(count), np.full(count, UP))
    renderer = finger.renderer(seed, severity=severity)
    rest = looked_at(
        renderer,
        still,
        lambda _, image: find_points(image.pixels, find_regions(image.pixels)),
        first,
    )
    shake, noise = estimate_scatter(compute_movements(rest, rest))
    return rest, dataclasses.replace(design, shake=shake, noise=noise)


def odd_frames(spec: SurfaceProfileSpec, design: ChamberMap, seed: int) -> list[Odd]:
    """Frames of every kind at the lowest, the middle and the highest deflection."""
    finger = SoftFinger.of(spec)
    truth = np.linspace(spec.preload, highest(spec), 3)
    postures = postures_on(finger, spec, truth, np.full(len(truth), UP))
    rest, chamber = _at_rest(spec, design, finger, seed, spec.severity, len(truth))
    found: list[Odd] = []
    for kind, i, picture in odd_pictures(finger, postures, seed):
        # Whatever is raised is a fault of perception, and is counted as one.
        try:
            regions = find_regions(picture)
            heights = chamber.height(compute_movements([find_points(picture, regions)], rest))
        except Exception:
            found.append(Odd(kind, None, failed=True))
        else:
            off = wrong(chamber, heights, truth[i : i + 1]) if kind.in_view else heights.known
            failed = regions.status is not kind.status or bool(off[0])
            found.append(Odd(kind, regions.status, failed))
    return found


def over_bends(spec: SurfaceProfileSpec, design: ChamberMap, seed: int) -> list[AtBend]:
    """Heights from 0.01° to 120° of bend, in perfect pictures and in those of the study."""
    finger = SoftFinger.of(spec)
    made = []
    for severity in dict.fromkeys((0.0, spec.severity)):
        frames = BEND_FRAMES if severity else 1
        bends = np.repeat(np.deg2rad(BENDS_DEG), frames)
        contact, length = jnp.asarray(spec.contact), jnp.asarray(finger.length)
        truth = np.array(
            [float(bend_center_line(contact, jnp.asarray(b), length).across) for b in bends]
        )
        rest, chamber = _at_rest(spec, design, finger, seed, severity, len(bends))
        points = looked_at(
            finger.renderer(seed, severity=severity),
            finger.postures(bends, np.full(len(bends), UP)),
            lambda _, image: find_points(image.pixels, find_regions(image.pixels)),
        )
        found = chamber.height(compute_movements(points, rest))
        failed = wrong(chamber, found, truth)
        for i, bend in enumerate(BENDS_DEG):
            own = slice(i * frames, (i + 1) * frames)
            heights = Heights(found.mm[own], found.known[own])
            made.append(
                AtBend(bend, severity, float(truth[own][0]), heights, int(failed[own].sum()))
            )
    return made
