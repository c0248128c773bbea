"""A sensor: a finger with its lens, calibrated, in a folder that ``designopt see`` takes.

``sensor.toml`` has what a person may read and change: the scene, the lens, the tolerances, the
camera's response. ``arrays.npz`` has the rest: the finger's errors with their covariance, and the
frames that it was calibrated with.
"""

from __future__ import annotations

import tomllib
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import jax.numpy as jnp
import numpy as np
import pydantic
from jaxtyping import Float, UInt8

from designopt.errors import UserError
from designopt.io.files import read_toml
from designopt.io.spec import Spec
from designopt.io.spec_files import FORMAT, Format, Length, Number, Title, validated
from designopt.io.toml_writing import format_toml
from optics import Scene, parse_scene
from optics.calibration import CalibratedLens
from optics.calibration.calibrated import LensTable, calibrated_lens, format_lens
from optics.scene.writer import scene_tables
from perception.proprioception import FingerErrors
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.lens_in_scene import with_lens
from studies.models.sensor.light import LightTable
from studies.models.sensor.made import deviations_of
from studies.models.sensor.spec import MadeSpec

DOCUMENT, ARRAYS = "sensor.toml", "arrays.npz"

COMMENT = """A sensor, calibrated by designopt calibrate finger. Lengths are mm, angles degrees.
[scene], [camera], [[mirrors]], [[pads]] and [frames] describe the finger as designed, as in a
scene's file; [lens] is its camera's lens, as in a lens's file. What was found of the finger itself
is in arrays.npz: errors in units of the deviations that [tolerances] states.
[light] is that of --light, or yours to write: without it contacts are not looked for. Empty it is
light that comes evenly from all sides; [light.red], [light.green], [light.blue] are line lamps
beside every pad: beside = "left", "right", "from" or "to", gap to the pad's edge, low and high
above its membrane."""


class SensorTable(Spec):
    """``[sensor]``."""

    name: Title = "sensor"
    """Of the sensor."""
    format: Format = FORMAT
    """Version of the file's format."""
    width: Length
    """Of the pads across the section, mm."""
    gamma: Annotated[Number, pydantic.Field(gt=0.2, lt=5)]
    """Of the camera's response: codes are light^(1/gamma)."""
    scatter: Annotated[Number, pydantic.Field(ge=0)]
    """Of the calibration frames, in units of the deviations that were stated."""


class SensorFile(Spec):
    """The whole file but for the scene's tables, which `optics.parse_scene` reads."""

    sensor: SensorTable
    """Of the whole."""
    lens: LensTable
    """The camera's lens, as in a lens file."""
    tolerances: MadeSpec
    """Standard deviations of errors of fabrication."""
    light: LightTable | None = None
    """How the pads are lit; contacts are looked for only with it."""


@dataclass(frozen=True)
class Sensor:
    """A finger that has been calibrated.

    Attributes:
        name: of the sensor.
        finger: as designed, behind its own lens and response.
        scene: as designed, with the camera's lens as designed.
        lens: of its camera.
        tolerances: standard deviations of errors of fabrication.
        gamma: codes are light^(1/gamma).
        errors: of this finger, as its frames have them.
        scatter: of these frames, in units of what was stated.
        angles: of the frames, rad.
        frames: red, green and blue.
        light: how its pads are lit; ``None`` if nobody has stated it.
    """

    name: str
    finger: FingerSensor
    scene: Scene
    lens: CalibratedLens
    tolerances: MadeSpec
    gamma: float
    errors: FingerErrors
    scatter: float
    angles: Float[np.ndarray, "frames joints"]
    frames: UInt8[np.ndarray, "frames rows columns 3"]
    light: LightTable | None = None


def finger_sensor(
    scene: Scene, lens: CalibratedLens, width: float, tolerances: MadeSpec, gamma: float
) -> FingerSensor:
    """The models of a finger behind a calibrated lens.

    Args:
        scene: as designed.
        lens: of its camera.
        width: of its pads, mm.
        tolerances: standard deviations of errors of fabrication.
        gamma: codes are light^(1/gamma).

    Its lens has no errors of fabrication: its calibration leaves hundredths of a pixel.

    Raises:
        UserError: images of the scene cannot be analysed, or the lens is another camera's.
    """
    seen = with_lens(scene, lens)
    deviations = replace(deviations_of(tolerances, seen), distortion=None, pupil=None)
    return FingerSensor.of_scene(seen, width, deviations).with_response(gamma)


def write_sensor(sensor: Sensor, folder: Path) -> None:
    """Write a sensor's two files into a folder that is there."""
    lens = tomllib.loads(format_lens(sensor.lens))
    table = {
        "name": sensor.name,
        "format": FORMAT,
        "width": sensor.finger.width,
        "gamma": sensor.gamma,
        "scatter": sensor.scatter,
    }
    tolerances = sensor.tolerances.model_dump(mode="json")
    tables = {"sensor": table, **lens, "tolerances": tolerances, **scene_tables(sensor.scene)}
    if sensor.light is not None:
        tables["light"] = sensor.light.model_dump(mode="json", exclude_none=True)
    (folder / DOCUMENT).write_text(format_toml(tables, COMMENT), encoding="utf-8")
    np.savez_compressed(
        folder / ARRAYS,
        mean=np.asarray(sensor.errors.mean),
        offsets=np.asarray(sensor.errors.offsets),
        covariance=np.asarray(sensor.errors.covariance),
        scale=np.asarray(sensor.errors.scale),
        angles=sensor.angles,
        frames=sensor.frames,
    )


def read_image_size(folder: str | Path) -> tuple[int, int]:
    """Columns and rows of the pictures of the sensor in a folder; its models are not computed.

    Raises:
        UserError: there is none, or its description is damaged.
    """
    return calibrated_lens(_read_document(Path(folder))[0].lens).size


def _read_document(path: Path) -> tuple[SensorFile, Scene]:
    if not path.is_dir():
        raise UserError(
            f"{path}: there is no such folder; make a sensor with 'designopt calibrate finger'"
        )
    tables = read_toml(path / DOCUMENT, "sensor")
    own = {name: tables[name] for name in SensorFile.model_fields if name in tables}
    rest = {name: table for name, table in tables.items() if name not in own}
    source = str(path / DOCUMENT)
    return validated(SensorFile, own, source), parse_scene(rest, source)


def read_sensor(folder: str | Path) -> Sensor:
    """The sensor in a folder.

    Raises:
        UserError: there is none, or one of its files is damaged or does not fit the other.
    """
    path = Path(folder)
    file, scene = _read_document(path)
    lens, table = calibrated_lens(file.lens), file.sensor
    finger = finger_sensor(scene, lens, table.width, file.tolerances, table.gamma)
    arrays = _read_arrays(path / ARRAYS)
    expected = finger.model.errors, (len(finger.model.views), 4, 2)
    if (len(arrays["mean"]), arrays["offsets"].shape) != expected:
        raise UserError(
            f"{path / ARRAYS}: it is of a finger with other views or errors than {DOCUMENT} "
            "describes; calibrate the finger again"
        )
    parts = (jnp.asarray(arrays[name]) for name in ("mean", "offsets", "covariance", "scale"))
    return Sensor(
        table.name, finger, scene, lens, file.tolerances, table.gamma, FingerErrors(*parts),
        table.scatter, arrays["angles"], arrays["frames"], file.light,
    )  # fmt: skip


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    names = ("mean", "offsets", "covariance", "scale", "angles", "frames")
    try:
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name] for name in names}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        reason = getattr(error, "strerror", None) or "it is damaged"
        raise UserError(f"{path}: cannot be read: {reason}; calibrate the finger again") from error
