"""Pictures of what was found in a frame: outlines of views, joint angles; and of pads."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from perception import Quality
from perception.contacts import Contact
from perception.unwarping import PER_MM
from studies.commands.records import Seen
from studies.models.sensor.reading import Image, PadReading

COLORS = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (204, 121, 167), (240, 228, 66))
"""Of the pads, one after the other: red, green and blue. They are Okabe and Ito's, which differ for
the color-blind, too."""

INK, PAPER = (255, 255, 255), (0, 0, 0)

LETTERS, BREADTH = 1 / 40, 0.6
"""Size of letters, as a part of the image's height, and the most that one is broad, of its size."""

FULL = 0.5
"""A difference by which its picture is darkest or brightest; the middle is no difference."""

BLUE, ORANGE = np.array([0, 114, 178.0]), np.array([230, 159, 0.0])
"""Of places that are darker and brighter than the reference."""


def draw_overlay(seen: Seen, joints: Sequence[str], pads: Sequence[str]) -> Image:
    """A frame with the outlines of its views and contacts, the joint angles and why there are none.

    Complete views have a broad outline, others a thin one and their quality's name.

    Args:
        seen: the frame.
        joints: their names.
        pads: their names.
    """
    picture = seen.frame.image.copy()
    rows = len(picture)
    size = max(10, round(rows * LETTERS))
    broad, pen = max(2, round(rows / 360)), _Pen(picture)
    for view in seen.reading.sighting.views:
        if not np.isfinite(view.corners).all():
            continue
        color = COLORS[pads.index(view.pad) % len(COLORS)]
        complete = view.quality is Quality.COMPLETE
        _draw_outline(picture, view.corners, color, broad if complete else 1, broad + 2)
        label = view.pad if view.path == "direct" else f"{view.pad}, {view.path}"
        if not complete:
            label += f" ({view.quality.name.lower().replace('_', ' ')})"
        left, top = view.corners.min(axis=0)
        pen.write(label, (left + size / 3, top + 1.2 * size), color, round(0.8 * size))
    for shown in seen.pads.values():
        for outline in shown.outlines:
            _draw_outline(picture, outline, INK, max(1, broad - 1))
    wide = round(picture.shape[1] / (BREADTH * size))
    lines = [part for line in lines_of(seen, joints) for part in textwrap.wrap(line, wide)]
    for number, line in enumerate(lines):
        pen.write(line, (size / 2, (1.5 + 1.4 * number) * size), INK, size)
    return picture


def draw_pad(shown: PadReading) -> UInt8[np.ndarray, "along across 3"]:
    """A pad with the outlines of its contacts."""
    picture = shown.picture.copy()
    middle = picture.shape[1] / 2 / PER_MM
    for one in shown.contacts or []:
        along, across = np.add(one.outline, [0, middle]).T * PER_MM - 0.5
        _draw_outline(picture, np.stack([across, along], axis=-1), INK, 1)
    return picture


def contact_text(pad: str, contact: Contact) -> str:
    """A contact's place and size with their standard deviations, in a line."""
    both = zip(contact.measured.tolist(), contact.deviations.tolist(), strict=True)
    along, across, diameter = (f"{value:.2f} ± {deviation:.2f} mm" for value, deviation in both)
    by = ", ".join(contact.paths)
    return f"contact on {pad}: {along} along, {across} across, diameter {diameter} (by {by})"


def lines_of(seen: Seen, joints: Sequence[str]) -> list[str]:
    """Joint angles with their standard deviations, or why there are none, a line each."""
    reading = seen.reading
    degrees = np.degrees([reading.angles, reading.deviations]).T.tolist()
    lines = []
    for joint, (angle, deviation), verdict in zip(joints, degrees, reading.verdicts, strict=True):
        text = verdict if math.isnan(angle) else f"{angle:.2f}° ± {deviation:.2f}°"
        lines.append(f"{joint}: {text}")
    if seen.light_moved:
        lines.append("the light has changed")
    return lines


def difference_picture(
    difference: Float[np.ndarray, "along across 3"],
) -> UInt8[np.ndarray, "along across 3"]:
    """A difference, the mean of its colors: blue where it is darker, orange where it is brighter.

    Places without a difference are white, those with `FULL` or more have the full color.
    """
    part = np.clip(difference.mean(axis=2) / FULL, -1, 1)[..., None]
    full = np.where(part < 0, BLUE, ORANGE)
    return np.round(255 + np.abs(part) * (full - 255)).astype(np.uint8)


def _draw_outline(
    picture: Image,
    corners: Float[np.ndarray, "corners 2"],
    color: tuple[int, int, int],
    line: int,
    ground: int | None = None,
) -> None:
    """Draw a closed line on a broader dark one."""
    # Pixels' middles are whole numbers; OpenCV draws at parts of a pixel by shifted integers.
    outline = np.round(16 * corners).astype(np.int32)
    for width, ink in ((ground or line + 2, PAPER), (line, color)):
        cv2.polylines(picture, [outline], True, ink, width, cv2.LINE_AA, 4)


class _Pen:
    """Writes into a picture, each text on its own ground."""

    def __init__(self, picture: Image) -> None:
        self._picture, self._font = picture, cv2.FontFace("sans")

    def write(
        self, text: str, place: tuple[float, float], color: tuple[int, int, int], size: int
    ) -> None:
        """Write a text from the left end of its baseline; ``size`` is that of its letters, px."""
        whole, at = self._picture.shape[1::-1], (round(place[0]), round(place[1]))
        left, top, wide, high = cv2.getTextSize(whole, text, at, self._font, size)
        edge = size // 4
        first, last = (left - edge, top - edge), (left + wide + edge, top + high + edge)
        cv2.rectangle(self._picture, first, last, PAPER, cv2.FILLED)
        cv2.putText(self._picture, text, at, color, self._font, size)
