"""Frames rendered and analysed: what was found of every view that can be found, and how well."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float

from optics.rendering import Effects, Imprint, TactileImage, TrueView
from perception.detection import detect_views
from perception.lens import Lens
from perception.matching import Sighting, View
from perception.paper_route import PaperRoute
from perception.quality import Quality
from perception.unwarping import (
    least_scale,
    map_to_image,
    map_to_pad,
    map_to_pad_affinely,
    select_view,
)
from studies.models.one_thread import one_thread
from studies.models.sensor.estimators import lens_of
from studies.models.sensor.finger_sensor import FingerSensor

FAR = 20.0
"""A view whose corner is off by more pixels (of 1080 rows) has not been found."""

LATTICE = 9
"""Places along and across a pad at which unwarping is checked."""

IMPRINTS = ("sphere", "ball array", "studded brick", "edge", "screw thread")


@dataclass(frozen=True)
class FoundView:
    """One complete view that does not touch the border, and what was found of it.

    Attributes:
        pad: name of the pad.
        path: name of the path.
        found: whether it was found complete, and nowhere far off.
        errors: of the four corners, px; NaN where it was not found.
        paper_errors: the same of the paper's route.
    """

    pad: str
    path: str
    found: bool
    errors: Float[np.ndarray, "4"]
    paper_errors: Float[np.ndarray, "4"]


@dataclass(frozen=True)
class Unwarping:
    """One pad unwarped in the view that shows it best.

    Attributes:
        pad: its name.
        path: that of the view.
        errors: how far from their true places it shows places, mm.
        affine_errors: the same by an affine map.
        scale: the view's least, px/mm.
        area_scale: that of the view with the largest area, px/mm.
    """

    pad: str
    path: str
    errors: Float[np.ndarray, " places"]
    affine_errors: Float[np.ndarray, " places"]
    scale: float
    area_scale: float


@dataclass(frozen=True)
class Frame:
    """One frame analysed.

    Attributes:
        gain: exposure.
        severity: of all other effects; NaN where each has its own.
        degrees: joint angles.
        views: those that can be found.
        wrong: views said to be complete that are not.
        unwarped: of every pad, in the view that shows it best.
        shown: pads that some view shows whole.
        seconds: of finding all views, after compiling.
    """

    gain: float
    severity: float
    degrees: tuple[float, ...]
    views: tuple[FoundView, ...]
    wrong: int
    unwarped: tuple[Unwarping, ...]
    shown: int
    seconds: float


def poses(grid: int, range_deg: float, joints: int) -> Float[np.ndarray, "poses joints"]:
    """A grid over the joints' ranges, rad."""
    steps = np.deg2rad(np.linspace(0, range_deg, grid))
    return np.stack(np.meshgrid(*[steps] * joints, indexing="ij"), axis=-1).reshape(-1, joints)


def independent_effects(generator: np.random.Generator) -> Effects:
    """Effects whose severities are independent of each other, each of them off in one case of five.

    So the dark inside of a finger meets blur, noise and compression of every size.
    """
    severities = {
        field.name: float(np.clip(generator.uniform(-0.5, 2.0), 0.0, None))
        for field in fields(Effects)
        if field.name != "gain"
    }
    parts = {name: getattr(Effects.graded(s), name) for name, s in severities.items()}
    return Effects(gain=float(generator.uniform(0.6, 1.5)), **parts)


def rendered(
    finger: FingerSensor,
    *,
    effects: Effects,
    severity: float,
    angles: Float[np.ndarray, "poses joints"],
    number: int,
    seed: int,
) -> list[Frame]:
    """Frames of one made finger, each touched by something on every pad, and analysed."""
    errors, _ = finger.made(seed, number)
    renderer = finger.renderer(effects, errors, seed=seed + number)
    lens = lens_of(renderer.imaging)
    frames = []
    # What is compiled on the way is no part of a frame's time.
    detect_views(renderer.render(angles[0]).pixels, finger.lens, finger.catalog)
    for index, pose in enumerate(angles):
        image = renderer.render(pose, touched(finger, index), frame=index)
        with one_thread():
            start = time.perf_counter()
            sighting = detect_views(image.pixels, finger.lens, finger.catalog)
            seconds = time.perf_counter() - start
        views, wrong = judged(finger, image, sighting)
        frames.append(
            Frame(
                effects.gain,
                severity,
                tuple(np.rad2deg(pose).tolist()),
                views,
                wrong,
                unwarped(finger, lens, image, sighting),
                len({view.pad for view in can_be_found(finger, image)}),
                seconds,
            )
        )
    return frames


def touched(finger: FingerSensor, index: int) -> dict[str, list[Imprint]]:
    """Something pressed into the middle of every pad, another thing from frame to frame."""
    return {
        pad: [Imprint(IMPRINTS[(index + number) % len(IMPRINTS)], along=length / 2)]
        for number, (pad, length) in enumerate(finger.catalog.lengths.items())
    }


def can_be_found(finger: FingerSensor, image: TactileImage) -> list[TrueView]:
    """The views that are asked for, complete and off the border."""
    wanted = {(family.pad, family.path) for family in finger.catalog.families if family.wanted}
    return [
        view
        for view in image.views
        if (view.pad, view.path) in wanted and view.complete and not view.at_border
    ]


def judged(
    finger: FingerSensor, image: TactileImage, sighting: Sighting
) -> tuple[tuple[FoundView, ...], int]:
    """What was found of every view, and how many were said to be complete wrongly."""
    far = FAR * image.pixels.shape[0] / 1080
    true = can_be_found(finger, image)
    polygons = PaperRoute().corners(image.pixels)
    views = []
    for one in true:
        seen = sighting.view(one.pad, one.path)
        errors = np.full(4, np.nan)
        if seen is not None and seen.quality is Quality.COMPLETE:
            errors = np.hypot(*(seen.corners - one.corners).T)
        found = bool(np.all(errors <= far))
        views.append(
            FoundView(
                one.pad,
                one.path,
                found,
                errors if found else np.full(4, np.nan),
                nearest_errors(polygons, one.corners, far),
            )
        )
    known = {(view.pad, view.path) for view in image.views if view.complete and not view.at_border}
    wrong = sum((view.pad, view.path) not in known for view in sighting.complete())
    return tuple(views), wrong


def nearest_errors(
    quads: Sequence[Float[np.ndarray, "4 2"]], corners: Float[np.ndarray, "4 2"], far: float
) -> Float[np.ndarray, "4"]:
    """Errors of the quadrilateral that is nearest to given corners, in whatever order it has them.

    NaN if a corner of the nearest is far off. This is more than the paper's route can know: it
    does not say which view is which.
    """
    best = np.full(4, np.nan)
    for quad in quads:
        orders = [
            np.roll(order, turn) for order in ([0, 1, 2, 3], [3, 2, 1, 0]) for turn in range(4)
        ]
        for order in orders:
            errors = np.hypot(*(quad[order] - corners).T)
            if errors.max() <= far and not errors.sum() >= np.nansum(best) > 0:
                best = errors
    return best


def unwarped(
    finger: FingerSensor, lens: Lens, image: TactileImage, sighting: Sighting
) -> tuple[Unwarping, ...]:
    """Every pad unwarped in its best view, and where its places have gone.

    Args:
        finger: as designed.
        lens: of the camera that took the image, with its errors.
        image: the truth.
        sighting: what was found.
    """
    made = []
    for pad, length in finger.catalog.lengths.items():
        views = [view for view in sighting.views if view.pad == pad]
        best = select_view(views, finger.lens, length, finger.width)
        largest = select_view(views, finger.lens, length, finger.width, by="area")
        true = image.view(pad, best.path) if best is not None else None
        if best is None or largest is None or true is None:
            continue
        half = finger.width / 2
        along, across = np.linspace(0, length, LATTICE), np.linspace(-half, half, LATTICE)
        places = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)
        seen = map_to_image(_true_view(best, true, lens), lens, places, length, finger.width)
        shown = map_to_pad(best, finger.lens, seen, length, finger.width)
        affine = map_to_pad_affinely(best, seen, length, finger.width)
        made.append(
            Unwarping(
                pad,
                best.path,
                np.hypot(*(shown - places).T),
                np.hypot(*(affine - places).T),
                least_scale(best, finger.lens, length, finger.width),
                least_scale(largest, finger.lens, length, finger.width),
            )
        )
    return tuple(made)


def _true_view(view: View, true: TrueView, lens: Lens) -> View:
    return replace(view, corners=true.corners, rays=lens.rays(true.corners))
