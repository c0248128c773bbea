"""What one frame shows of a calibrated finger: views, joint angles or why there are none, pads."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import cv2
import jax
import numpy as np
from jaxtyping import Float, UInt8

from perception import Sighting, View, compare_with_reference
from perception.contacts import Contact, find_contacts, fuse_contacts, has_fine_colors
from perception.places import find_sight
from perception.proprioception import JointAngles, Misfit, find_pose, observe
from perception.unwarping import PER_MM, PlacesOf
from studies.models.sensor.sensor_folder import Sensor

SQUARE_MM = 1.0
"""Changes are averaged over squares of this side: of a single sample, noise would be greatest."""

RIM_MM = 1.5
"""Beside a pad's edges nothing counts as a change: these are round, and known to tenths of a mm."""

Image = UInt8[np.ndarray, "rows columns 3"]


@dataclass(frozen=True, eq=False)
class PadReading:
    """A pad as the view shows it that shows it best, and what is pressed into it by all views.

    Attributes:
        view: that view, complete.
        picture: the pad as seen from straight above, `PER_MM` samples per mm.
        difference: by how much each place and color is brighter than in the sensor's frame that
            shows the same view at the nearest joint angles, each over its own smooth part; ``None``
            if no frame shows that view.
        contacts: the strongest first; ``None`` if the sensor states no light, or no frame of it
            shows any of the pad's views.
        places: where the pad is imaged in each view that contacts were looked for in.
    """

    view: View
    picture: UInt8[np.ndarray, "along across 3"]
    difference: Float[np.ndarray, "along across 3"] | None
    contacts: list[Contact] | None = None
    places: tuple[PlacesOf, ...] = ()

    @property
    def outlines(self) -> list[Float[np.ndarray, "corners 2"]]:
        """Of every contact in each of the views: columns and rows in the frame.

        The membrane leaves what is pressed in about half as high as it is lifted.
        """
        return [
            places_of(np.insert(one.outline, 2, one.depth / 2, axis=1))
            for one in self.contacts or []
            for places_of in self.places
        ]

    @functools.cached_property
    def change(self) -> float:
        """The greatest difference, the mean of its colors over squares, but for the pad's rim.

        NaN where there is no difference, or nothing but rim.
        """
        if self.difference is None:
            return float("nan")
        side, rim = round(SQUARE_MM * PER_MM), round(RIM_MM * PER_MM)
        mean = cv2.blur(self.difference.mean(axis=2), (side, side))[rim:-rim, rim:-rim]
        return float(np.abs(mean).max()) if mean.size else float("nan")


@dataclass(frozen=True, eq=False)
class Reading:
    """What a frame shows.

    Attributes:
        sighting: the views that were found or expected.
        angles: of the joints, rad; NaN where they are refused.
        deviations: their standard deviations, rad; NaN where they are refused.
        verdicts: of every joint why its angle is refused; empty where it is not.
        misfit: of all corners, at the angles that fit best, refused or not.
    """

    sighting: Sighting
    angles: Float[np.ndarray, " joints"]
    deviations: Float[np.ndarray, " joints"]
    verdicts: tuple[str, ...]
    misfit: Misfit

    @property
    def is_refused(self) -> bool:
        """Whether no joint has an angle."""
        return bool(np.isnan(self.angles).all())


class Reader:
    """Reads frames of a sensor, one after the other; each by itself.

    It computes in float64: call it within ``jax.enable_x64(True)``.

    Args:
        sensor: calibrated.
    """

    def __init__(self, sensor: Sensor) -> None:
        self.sensor, self.finger = sensor, sensor.finger

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.finger.model.names

    @property
    def pads(self) -> tuple[str, ...]:
        """Names of the pads."""
        return tuple(self.finger.catalog.lengths)

    def read(self, image: Image, sighting: Sighting | None = None) -> Reading:
        """What a frame shows.

        Args:
            image: red, green and blue.
            sighting: `FingerSensor.detect` of it, where that is known already.

        Raises:
            UserError: it is no image of this sensor's camera.
        """
        found = self.finger.detect(image) if sighting is None else sighting
        model = self.finger.model
        solution = find_pose(model, observe(found, model.views), found.angles, self.sensor.errors)
        pose: JointAngles = jax.tree.map(np.asarray, solution.value)
        valid = np.asarray(solution.ok)
        angles = np.where(valid, pose.angles, np.nan)
        deviations = np.where(valid, pose.deviations, np.nan)
        return Reading(found, angles, deviations, tuple(solution.messages()), pose.misfit)

    def read_pads(self, image: Image, reading: Reading) -> dict[str, PadReading]:
        """The pads that the frame of a reading shows whole, by name."""
        near = np.where(np.isnan(reading.angles), reading.sighting.angles, reading.angles)
        places = self.finger.find_places(reading.sighting, near)
        fine = self.sensor.light is not None and has_fine_colors(image)
        pads = {}
        for pad in self.pads:
            view = self.finger.best_view(reading.sighting, pad)
            if view is None:
                continue
            views = [view]
            if self.sensor.light is not None:  # others matter to contacts alone
                complete = reading.sighting.complete()
                views += [one for one in complete if one.pad == pad and one is not view]
            own = [places[pad, one.path] for one in views]
            pads[pad] = self._read_pad(image, views, own, near, fine=fine)
        return pads

    def _read_pad(
        self,
        image: Image,
        views: list[View],
        places: list[PlacesOf],
        angles: Float[np.ndarray, " joints"],
        *,
        fine: bool,
    ) -> PadReading:
        """A pad by its complete views, the best one first."""
        finger, light = self.finger, self.sensor.light
        pictures = [finger.unwarp(image, *one) for one in zip(views, places, strict=True)]
        references = [self._reference(view, angles) for view in views]
        difference = None
        if references[0] is not None:
            difference = compare_with_reference(pictures[0], references[0])
        found = []
        if light is not None:
            size = finger.catalog.lengths[views[0].pad], finger.width
            lamps, response = light.lamps(*size), finger.lens.response
            for view, places_of, picture, reference in zip(
                views, places, pictures, references, strict=True
            ):
                if reference is not None:
                    sight = find_sight(places_of, *size)
                    found.append(
                        find_contacts(picture, reference, view, sight, lamps, response, fine=fine)
                    )
        contacts = fuse_contacts(found) if found else None
        return PadReading(views[0], pictures[0], difference, contacts, tuple(places))

    def _reference(
        self, view: View, angles: Float[np.ndarray, " joints"]
    ) -> UInt8[np.ndarray, "along across 3"] | None:
        """The pad in the frame of the sensor that shows this view at the nearest joint angles."""
        shown = self._references.get((view.pad, view.path), [])
        if not shown:
            return None
        away = [np.nansum((self.sensor.angles[frame] - angles) ** 2) for frame, _ in shown]
        return shown[int(np.argmin(away))][1]

    @functools.cached_property
    def _references(self) -> dict[tuple[str, str], list[tuple[int, np.ndarray]]]:
        """By pad and path, the sensor's frames that show the view whole, and the pad in each."""
        found: dict[tuple[str, str], list[tuple[int, np.ndarray]]] = {}
        for number, frame in enumerate(self.sensor.frames):
            sighting = self.finger.detect(frame)
            places = self.finger.find_places(sighting, self.sensor.angles[number])
            for view in sighting.complete():
                name = view.pad, view.path
                picture = self.finger.unwarp(frame, view, places[name])
                found.setdefault(name, []).append((number, picture))
        return found
