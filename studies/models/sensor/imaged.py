"""What images are made of: a scene's file, or a finger's, which has its joints' ranges too."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from designopt.errors import UserError
from designopt.io.files import read_toml
from optics import Scene, read_scene
from studies.models.finger_file import bare_finger, read_finger
from studies.models.sensor.spec import WIDTH


class Imaged(NamedTuple):
    """A scene of which images are made.

    Attributes:
        scene: as designed.
        ranges_deg: the greatest angle of every joint, which begins at 0, degrees; ``None`` for a
            scene, whose file has none.
    """

    scene: Scene
    ranges_deg: tuple[float, ...] | None


def read_imaged(path: str | Path) -> Imaged:
    """The scene in a file of a scene or of a finger.

    Raises:
        UserError: the file describes neither.
    """
    if "finger" in read_toml(path, "scene"):
        finger = read_finger(path)
        return Imaged(finger.scene(), finger.body.ranges_deg)
    return Imaged(read_scene(Path(path)), None)


def designed(path: str) -> Scene:
    """The scene in such a file; that of the bare finger if none is named.

    Raises:
        UserError: the file describes neither.
    """
    return read_imaged(path).scene if path else bare_finger().scene()


def width_of(scene: Scene) -> float:
    """The one width that all pads have in a scene's file, mm; paper B's where it has none.

    Raises:
        UserError: pads have different widths.
    """
    stated = np.array([]) if scene.widths is None else np.asarray(scene.widths)
    widths = np.unique(stated[np.isfinite(stated)])
    if len(widths) > 1:
        raise UserError(
            f"{scene.layout.name}: its pads are {' and '.join(f'{one:g}' for one in widths)} mm "
            "wide, and an image has pads of one width; choose it with --width"
        )
    return float(widths[0]) if len(widths) else WIDTH
