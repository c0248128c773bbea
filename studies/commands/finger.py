"""From frames of a finger, some with known joint angles, to a sensor."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from designopt.errors import UserError
from designopt.io.files import check_new_folder, printable
from designopt.solution import Solution
from designopt.study.result_folders import result_folder, write_document
from optics import Scene
from optics.calibration import CalibratedLens, read_lens
from optics.rendering import Effects
from perception.proprioception import (
    Calibration,
    CalibrationResult,
    FingerErrors,
    calibrate,
    observe,
    stack_observations,
    suggest_labels,
)
from studies.commands.frame_lists import LabelledFrames, read_frames
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.imaged import read_imaged, width_of
from studies.models.sensor.light import LightTable
from studies.models.sensor.made import with_new_pads
from studies.models.sensor.sensor_folder import (
    Sensor,
    finger_sensor,
    read_sensor,
    write_sensor,
)
from studies.models.sensor.spec import MadeSpec

RANGE_DEG, STEPS = 60.0, 3
"""Poses that are suggested go from 0 to so many degrees where a file states no range, by so many
values of every joint."""

GAMMAS = np.arange(1.0, 2.61, 0.2)
"""Responses of cameras that are tried; that with the least scatter of the frames is taken."""


class Known(NamedTuple):
    """What is known of a finger before its frames.

    Attributes:
        scene: as designed.
        lens: of its camera.
        width: of its pads, mm.
        tolerances: standard deviations of errors of fabrication.
        tops: the greatest angle of every joint, which begins at 0, rad; ``None`` if that is not
            known.
        gamma: of the camera's response; ``None`` if that is not known.
        before: its errors; ``None`` if nothing but their tolerances is known.
        light: how its pads are lit; ``None`` if nobody has stated it.
    """

    scene: Scene
    lens: CalibratedLens
    width: float
    tolerances: MadeSpec
    tops: Float[np.ndarray, " joints"] | None
    gamma: float | None = None
    before: FingerErrors | None = None
    light: LightTable | None = None


def read_design(lens_file: Path, finger_file: Path, width: float | None) -> Known:
    """A finger as it was designed, behind a lens.

    Args:
        lens_file: of the camera.
        finger_file: of the finger, or of its scene.
        width: of the pads, mm; ``None`` for that in the file.

    Raises:
        UserError: a file is wrong.
    """
    with jax.enable_x64(True):
        scene, ranges = read_imaged(finger_file)
        wide = width_of(scene) if width is None else width
        tops = None if ranges is None else np.radians(ranges)
        return Known(scene, read_lens(lens_file), wide, MadeSpec(), tops)


def read_with_new_pads(folder: Path) -> Known:
    """A finger that has been calibrated and then got other pads.

    Raises:
        UserError: it is no sensor.
    """
    with jax.enable_x64(True):
        old = read_sensor(folder)
        before = with_new_pads(old.errors, old.finger.deviations)
        # So far the joints are known to go.
        tops = np.max(old.angles, axis=0)
        width, gamma = old.finger.width, old.gamma
        return Known(old.scene, old.lens, width, old.tolerances, tops, gamma, before, old.light)


def calibrate_finger_from(
    frames: Path,
    known: Known,
    out: Path,
    *,
    gamma: float | None,
    label_deviation_deg: float,
    force: bool,
) -> tuple[list[str], list[str]]:
    """Calibrate a finger from frames and write the sensor's folder.

    Args:
        frames: CSV file of pictures and joint angles, degrees.
        known: of the finger.
        out: the folder.
        gamma: of the camera's response; ``None`` if it is not known otherwise.
        label_deviation_deg: standard deviation of the joint angles in the CSV file.
        force: whether an earlier sensor may be replaced.

    Returns:
        Lines of the result, and warnings.

    Raises:
        UserError: a file or an option is wrong, or the frames contradict the finger.
    """
    check_new_folder(out, force=force)
    if not label_deviation_deg > 0:
        raise UserError(f"--label-deviation {label_deviation_deg:g}: it is a positive angle")
    gamma, label = gamma or known.gamma, math.radians(label_deviation_deg)
    with jax.enable_x64(True):
        finger = finger_sensor(known.scene, known.lens, known.width, known.tolerances, 1.0)
        labelled, lost = read_frames(frames, finger.model.names, known.lens.size)
        deviation = label if np.isfinite(labelled.angles).any() else None
        tried = [gamma] if gamma is not None else GAMMAS.tolist()
        fits = [
            _calibrated(finger.with_response(one), labelled, deviation, known.before)
            for one in tried
        ]
        # Where no minimum is found, the margin is −1 and the scatter means nothing.
        best = int(np.argmax([float(one.margin) for one in fits]))
        found, response = fits[best], round(tried[best], 3)
        if not bool(found.ok):
            raise UserError(f"{frames}: {CalibrationResult[found.result]}")
        sensor = Sensor(
            printable(out.stem), finger.with_response(response), known.scene, known.lens,
            known.tolerances, response, found.value.errors, float(found.value.scatter),
            np.asarray(found.value.angles), labelled.images, known.light,
        )  # fmt: skip
        advice = _advice(finger, sensor.errors, known.tops, label)
        with result_folder(out, force=force) as folder:
            write_sensor(sensor, folder)
            write_document(folder, _document(sensor, labelled, advice))
        return [printable(str(out)), *_summary(sensor, labelled, advice)], lost


class Advice(NamedTuple):
    """Poses to label next.

    Attributes:
        before: deviation of joint angles over all poses as it is, degrees.
        poses: joint angles, degrees.
        after: deviations after each of these and those before it, degrees.
    """

    before: float
    poses: Float[np.ndarray, "poses joints"]
    after: list[float]


def _advice(
    finger: FingerSensor,
    errors: FingerErrors,
    tops: Float[np.ndarray, " joints"] | None,
    label: float,
) -> Advice:
    """Poses to label next: rendered ones, of which it is known what is seen in them."""
    joints = len(finger.model.names)
    tops = np.full(joints, math.radians(RANGE_DEG)) if tops is None else tops
    poses = np.array(list(itertools.product(*(np.linspace(0, top, STEPS) for top in tops))))
    camera = finger.renderer(Effects(), None, 0)
    sightings = [finger.detect(camera.render(pose).pixels) for pose in poses]
    seen = stack_observations([observe(one, finger.model.views) for one in sightings])
    found = suggest_labels(finger.model, errors, seen, poses, label)
    after = np.degrees(found.after).tolist()
    return Advice(math.degrees(found.before), np.degrees(poses[found.poses]), after)


def _calibrated(
    finger: FingerSensor,
    frames: LabelledFrames,
    deviation: float | None,
    before: FingerErrors | None,
) -> Solution[Calibration]:
    sightings = [finger.detect(image) for image in frames.images]
    seen = stack_observations([observe(one, finger.model.views) for one in sightings])
    rough = np.array([one.angles for one in sightings])
    angles = rough if deviation is None else frames.angles
    return calibrate(finger.model, seen, angles, deviation, before)


def _summary(sensor: Sensor, frames: LabelledFrames, advice: Advice) -> Iterator[str]:
    labels = int(np.isfinite(frames.angles).any(axis=1).sum())
    yield f"frames: {len(frames.names)}, {labels} with known joint angles"
    yield f"camera: gamma {sensor.gamma:g}"
    yield f"scatter: {sensor.scatter:.2f} of the stated deviations of corners and labels"
    both = np.degrees(sensor.angles), np.degrees(frames.angles)
    for name, found, label in zip(frames.names, *both, strict=True):
        listed = [
            f"{joint} {one:.2f}°" + ("" if np.isnan(known) else f" (label {known:.2f}°)")
            for joint, one, known in zip(sensor.finger.model.names, found, label, strict=True)
        ]
        yield f"{name}: {', '.join(listed)}"
    yield f"joint angles: ±{advice.before:.2f}° over all poses"
    for pose, after in zip(advice.poses, advice.after, strict=True):
        angles = ", ".join(
            f"{joint} {one:.0f}°"
            for joint, one in zip(sensor.finger.model.names, pose, strict=True)
        )
        yield f"label next: {angles}; then ±{after:.2f}°"


def _document(sensor: Sensor, frames: LabelledFrames, advice: Advice) -> dict[str, Any]:
    joints = sensor.finger.model.names
    angles = np.degrees(sensor.angles).tolist()
    return {
        "gamma": sensor.gamma,
        "scatter": sensor.scatter,
        "frames": [
            {"image": name, **{f"{joint}_deg": one for joint, one in zip(joints, row, strict=True)}}
            for name, row in zip(frames.names, angles, strict=True)
        ],
        "deviation_deg": advice.before,
        "label_next": [
            {f"{joint}_deg": one for joint, one in zip(joints, pose, strict=True)}
            | {"deviation_deg": after}
            for pose, after in zip(advice.poses.tolist(), advice.after, strict=True)
        ],
    }
