"""What is kept of every frame: a row of readings.csv, and all of it as a line of readings.jsonl.

Each is written whole and at once, so that a process killed at any moment leaves whole lines.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from designopt.io.csv_text import csv_text
from perception.contacts import Contact
from perception.sources import Frame, Light, LostFrame, Notice
from studies.models.sensor.reading import PadReading, Reading

MEASURED = "along", "across", "diameter"
"""Of a contact."""

CSV, JSONL = "readings.csv", "readings.jsonl"


class Seen(NamedTuple):
    """A frame that was read.

    Attributes:
        frame: as it came.
        reading: of it.
        pads: that it shows whole, by name; none where nobody asks for them.
        light: against that of the source's first frame; ``None`` of picture files.
        light_moved: whether that is another, by the last verdict.
        latency: s from the frame's arrival to its reading.
    """

    frame: Frame
    reading: Reading
    pads: dict[str, PadReading]
    light: Light | None
    light_moved: bool
    latency: float


class Records:
    """The two files, open.

    Args:
        folder: that is there.
        joints: their names.
        pads: names of those that are recorded.
    """

    def __init__(self, folder: Path, joints: Sequence[str], pads: Sequence[str]) -> None:
        self.joints, self.pads = joints, pads
        self._csv = (folder / CSV).open("wb", buffering=0)
        self._jsonl = (folder / JSONL).open("wb", buffering=0)
        columns = ["frame", "name", "time_s", "latency_s"]
        for joint in joints:
            columns += [f"{joint}_deg", f"{joint}_deviation_deg", f"{joint}_verdict"]
        columns += ["misfit", "views", "light_moved"]
        for pad in pads:
            columns += [f"{pad}_view", f"{pad}_change", f"{pad}_contacts"]
            for name in MEASURED:  # of the strongest
                columns += [f"{pad}_{name}_mm", f"{pad}_{name}_deviation_mm"]
        self._row(columns)

    def close(self) -> None:
        """Close both."""
        self._csv.close()
        self._jsonl.close()

    def add(self, seen: Seen) -> str:
        """Keep a frame, and return its line of JSON."""
        frame, reading = seen.frame, seen.reading
        row: list[object] = [
            frame.number,
            frame.name,
            digits(frame.time, 4),
            digits(seen.latency, 4),
        ]
        angles = np.degrees([reading.angles, reading.deviations]).T.tolist()
        for (angle, deviation), verdict in zip(angles, reading.verdicts, strict=True):
            row += [digits(angle, 4), digits(deviation, 4), verdict]
        complete = len(reading.sighting.complete())
        row += [digits(float(reading.misfit.rms), 3), complete, int(seen.light_moved)]
        for pad in self.pads:
            row += _pad_cells(seen.pads.get(pad))
        self._row(row)
        return self._line(document_of(seen, self.joints))

    def note(self, item: LostFrame | Notice) -> str:
        """Keep what came in place of a frame, and return its line of JSON."""
        time = digits(item.time, 4)
        if isinstance(item, Notice):
            return self._line({"notice": item.text, "time_s": time})
        about = {"frame": item.number, "name": item.name, "time_s": time, "lost": item.count}
        return self._line(about | {"loss": item.loss.name.lower(), "reason": item.reason})

    def _row(self, cells: Sequence[object]) -> None:
        self._csv.write(csv_text([cells]).encode())

    def _line(self, document: dict[str, Any]) -> str:
        text = json.dumps(document, ensure_ascii=False, allow_nan=False)
        self._jsonl.write(f"{text}\n".encode())
        return text


def document_of(seen: Seen, joints: Sequence[str]) -> dict[str, Any]:
    """All that is kept of a frame, angles in degrees."""
    frame, reading = seen.frame, seen.reading
    angles, deviations = np.degrees([reading.angles, reading.deviations]).tolist()
    by_joint = {
        joint: {
            "angle_deg": digits(angle, 6),
            "deviation_deg": digits(deviation, 6),
            "verdict": verdict,
        }
        for joint, angle, deviation, verdict in zip(
            joints, angles, deviations, reading.verdicts, strict=True
        )
    }
    misfit = reading.misfit
    document: dict[str, Any] = {
        "frame": frame.number,
        "name": frame.name,
        "time_s": digits(frame.time, 4),
        "latency_s": digits(seen.latency, 4),
        "joints": by_joint,
        "misfit": {
            "chi_squared": digits(float(misfit.chi_squared), 3),
            "degrees_of_freedom": int(misfit.degrees_of_freedom),
            "rms": digits(float(misfit.rms), 4),
            "tail": digits(float(misfit.tail), 12),
        },
        "views": [
            {
                "pad": view.pad,
                "path": view.path,
                "quality": view.quality.name.lower(),
                "ends": list(view.ends),
                "corners_px": [[digits(one, 3) for one in row] for row in view.corners.tolist()],
            }
            for view in reading.sighting.views
        ],
        "pads": {
            pad: {
                "path": shown.view.path,
                "change": digits(shown.change, 5),
                "contacts": None
                if shown.contacts is None
                else [_contact_document(one) for one in shown.contacts],
            }
            for pad, shown in seen.pads.items()
        },
    }
    if seen.light is not None:
        gains = [digits(gain, 4) for gain in seen.light.gains.tolist()]
        document["light"] = {"moved": seen.light_moved, "gains": gains}
    return document


def _pad_cells(shown: PadReading | None) -> list[object]:
    """A pad's cells of a row; those of its strongest contact are empty where there is none."""
    cells: list[object] = ["", None, None]
    contacts = None
    if shown is not None:
        contacts = shown.contacts
        count = None if contacts is None else len(contacts)
        cells = [shown.view.path, digits(shown.change, 5), count]
    if not contacts:
        return cells + [None] * (2 * len(MEASURED))
    both = np.stack([contacts[0].measured, contacts[0].deviations], axis=-1)
    return cells + [digits(one, 4) for one in both.ravel().tolist()]


def _contact_document(contact: Contact) -> dict[str, Any]:
    document: dict[str, Any] = {"paths": list(contact.paths)}
    for name, value, deviation in zip(
        MEASURED, contact.measured.tolist(), contact.deviations.tolist(), strict=True
    ):
        document[f"{name}_mm"] = digits(value, 4)
        document[f"{name}_deviation_mm"] = digits(deviation, 4)
    strength = digits(contact.strength, 2)
    return document | {"depth_mm": digits(contact.depth, 2), "strength": strength}


def digits(number: float | None, count: int) -> float | None:
    """A number rounded to so many decimals; ``None`` for what is no number."""
    return None if number is None or not math.isfinite(number) else round(number, count)
