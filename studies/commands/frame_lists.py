"""Lists of a finger's frames with joint angles: typed in, or read from tags on the phalanges."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from designopt.errors import UserError
from perception.sources import Frame, LostFrame, open_source
from perception.tags import find_tag_turns

SIDE = "side"
"""Column of pictures of the tags."""

APART_DEG = 10.0
"""Typed angles of two side pictures differ by so much, or more: they have to show which way tags
turn."""

AGREED_DEG = 2.0
"""By so much tags and typed angles may differ, rms."""


class LabelledFrames(NamedTuple):
    """Frames of a finger, and their labels.

    Attributes:
        names: of the pictures.
        images: red, green and blue.
        angles: rad; NaN where none is known.
    """

    names: list[str]
    images: UInt8[np.ndarray, "frames rows columns 3"]
    angles: Float[np.ndarray, "frames joints"]


def read_frames(
    path: Path, joints: Sequence[str], size: tuple[int, int]
) -> tuple[LabelledFrames, list[str]]:
    """The frames that a CSV file lists, and lines on those that cannot be read.

    Its columns are ``image``, a picture's file seen from the CSV file's folder, and for each joint
    ``<joint>_deg``; a cell is empty where the angle is not known. There may be a column ``side``:
    a picture that another camera has taken at the same time, along the joints' axes, of tags on the
    sides of the phalanges. Tag 0 is on the first phalanx, tag n on that behind the nth joint. How
    tags are stuck on follows from the frames with a side picture and typed angles; of the others
    with one, what is not typed is read from the tags.

    Raises:
        UserError: the file, a column, a cell or a picture is none of that, or tags and typed angles
            disagree.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.DictReader(stream, strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UserError(f"{path}: cannot be read as CSV: {reason}; correct it") from error
    columns = ["image", *(f"{joint}_deg" for joint in joints)]
    if not rows:
        listed = ", ".join(columns)
        raise UserError(f"{path}: it has no rows; list pictures, with the columns {listed}")
    given = [name for name in rows[0] if name is not None]
    if missing := [name for name in columns if name not in given]:
        raise UserError(
            f"{path}: column '{missing[0]}' is missing; its columns are {', '.join(columns)}"
        )
    if unknown := [name for name in given if name not in (*columns, SIDE)]:
        raise UserError(
            f"{path}: there is no column '{unknown[0]}'; its columns are {', '.join(columns)}"
        )
    typed = np.radians(
        [
            [_angle(path, number, name, row[name]) for name in columns[1:]]
            for number, row in enumerate(rows, 2)
        ]
    )
    names, images, angles, lost = [], [], [], []
    if SIDE in given:
        turns, lost = _turns_of_tags(path, [row[SIDE] or "" for row in rows], len(joints))
        typed = label_by_tags(path, typed, turns)
    for number, (row, labels) in enumerate(zip(rows, typed, strict=True), 2):
        try:
            source = open_source(str(path.parent / (row["image"] or "")), size=size)
        except UserError as error:
            lost.append(f"{path.name}, line {number}: {error}")
            continue
        with source:
            for item in source:
                if isinstance(item, Frame):
                    names.append(item.name)
                    images.append(item.image)
                    angles.append(labels)
                elif isinstance(item, LostFrame):
                    lost.append(str(item))
    if not names:
        raise UserError(f"{path}: none of its pictures can be used; the first: {lost[0]}")
    return LabelledFrames(names, np.array(images), np.array(angles)), lost


def _turns_of_tags(
    path: Path, pictures: Sequence[str], joints: int
) -> tuple[Float[np.ndarray, "rows joints"], list[str]]:
    """By how much each joint's tag is turned from the one before it, rad, and what cannot be read.

    NaN where a tag is not found.
    """
    turns, lost = np.full((len(pictures), joints), np.nan), []
    for row, picture in enumerate(pictures):
        if not picture.strip():
            continue
        try:
            with open_source(str(path.parent / picture)) as source:
                item = next(iter(source))
        except UserError as error:
            lost.append(f"{path.name}, line {row + 2}: {error}")
            continue
        if isinstance(item, Frame):
            turns[row] = np.diff(find_tag_turns(item.image, joints + 1))
        if np.isnan(turns[row]).any():
            missing = int(np.argmax(np.isnan(turns[row]))) + 1
            lost.append(f"{path.name}, line {row + 2}: {picture} shows no tag {missing}, or no 0")
    return turns, lost


def label_by_tags(
    path: Path, typed: Float[np.ndarray, "rows joints"], turns: Float[np.ndarray, "rows joints"]
) -> Float[np.ndarray, "rows joints"]:
    """Joint angles as they are typed, and where they are not, those of the tags, rad.

    A joint's angle is its tag's turn, plus one angle by which that is stuck on; seen from the other
    side of the finger, minus its turn.

    Args:
        path: of the list, for messages.
        typed: NaN where nothing is typed.
        turns: of the tags; NaN where they are not seen.

    Raises:
        UserError: the typed angles do not show how tags are stuck on, or disagree with them.
    """
    both = np.isfinite(typed) & np.isfinite(turns)
    known = np.where(both, typed, np.nan)
    spreads = [np.ptp(column[there]) for column, there in zip(known.T, both.T, strict=True)
               if there.any()]  # fmt: skip
    if len(spreads) < typed.shape[1] or max(spreads) < math.radians(APART_DEG):
        raise UserError(
            f"{path}: how tags are stuck on is unknown; type every joint's angle in a row with a "
            f"'{SIDE}' picture, and in another one that differs by {APART_DEG:g}° or more"
        )
    best: tuple[float, Float[np.ndarray, "rows joints"]] = np.inf, typed
    for sense in (1.0, -1.0):
        # Turns are cyclic: the mean of unit vectors is theirs in every case.
        off = np.where(both, np.exp(1j * (typed - sense * turns)), 0.0)
        by_tags = np.angle(np.exp(1j * (sense * turns + np.angle(off.sum(axis=0)))))
        left = float(np.sqrt(np.mean((by_tags - typed)[both] ** 2)))
        best = min(best, (left, by_tags), key=lambda one: one[0])
    left, by_tags = best
    if left > math.radians(AGREED_DEG):
        raise UserError(
            f"{path}: tags and typed angles differ by {math.degrees(left):.1f}° (rms); see whether "
            f"both are of the same joints, and '{SIDE}' pictures of the same moments"
        )
    return np.where(np.isfinite(typed), typed, by_tags)


def _angle(path: Path, number: int, column: str, text: str | None) -> float:
    if not text or not text.strip():
        return math.nan
    try:
        angle = float(text)
    except ValueError:
        angle = math.inf
    if not abs(angle) <= 180:
        raise UserError(
            f"{path}: line {number}, {column}: '{text}' is no angle in degrees; correct it"
        )
    return angle
