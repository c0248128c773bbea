"""Bright blobs of an image, each at the threshold at which its outline is most stable.

One threshold does not survive exposures and uneven light: thresholds are swept, and of a blob that
lives through several of them the outline is kept that changes least (the idea of J. Matas et al.,
*Robust wide baseline stereo from maximally stable extremal regions*, BMVC 2002). Blobs of a higher
threshold lie within those of a lower one, so they form trees; where a blob falls into several,
these are kept in its place.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Int

from perception.masks import Gray, global_mask, seam_mask

LEVELS = 24
"""Thresholds of the sweep, in equal ratios up to full scale."""

SEAM, SHARE = 9, 0.8
"""A dark seam narrower than this many pixels of 1080 rows, and no brighter than this share of what
is beside it, parts two views."""

SPREAD = 1.5
"""The sweep begins so many standard deviations above the background's median."""

LEAST_AREA = 1.5e-4
"""Of the image; smaller blobs are specks."""

STEADY = 0.5
"""An edge moves by less than so many pixels from threshold to threshold; a gradient by more."""

MOSTLY = 0.3
"""Of a blob whose outline wanders, more than this part is in its stable branches."""

UNEVEN, AREAS = 0.25, 2.5
"""Halves of one view differ in their rows by less than this part, and in area by less than this
ratio."""

MOST = 64
"""Blobs of one threshold that are looked at; an image with more shows no finger."""

LIKE = 0.02
"""A part that is smaller than this share of a blob falling apart is a chip, not a part."""


@dataclass(frozen=True, eq=False)
class Blob:
    """A bright blob.

    Attributes:
        contour: its outermost pixels, column and row.
        area: within the contour, px².
    """

    contour: Int[np.ndarray, "_ 2"]
    area: float

    @functools.cached_property
    def box(self) -> tuple[int, int, int, int]:
        """Its first column and row, and those behind its last."""
        left, top, width, height = cv2.boundingRect(self.contour)
        return left, top, left + width, top + height


@dataclass
class _Node:
    blob: Blob
    children: list[_Node] = field(default_factory=list)


def stable_blobs(gray: Gray) -> list[Blob]:
    """The blobs of an image, each at its most stable threshold; none overlaps another."""
    smooth = cv2.blur(gray, (3, 3))
    levels = _levels(smooth)
    size = max(3, round(SEAM * len(gray) / 1080) | 1)
    # What is dark all about takes as long as what is not. A seam's mask reaches so far at most.
    columns, rows = _bright_part(smooth, levels, 3 * size)
    smooth, corner = smooth[rows, columns], (columns.start, rows.start)
    if not smooth.size:
        return []
    seams = seam_mask(smooth, size, SHARE)
    # Opened once, before it is parted by thresholds: flat morphology commutes with them.
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (3, 3))
    opened = cv2.morphologyEx(cv2.subtract(smooth, seams), cv2.MORPH_OPEN, square)
    roots: list[_Node] = []
    previous: list[_Node] = []
    least = LEAST_AREA * gray.size
    for level in levels:
        nodes = [_Node(blob) for blob in _blobs(opened, level, corner, least)]
        if not nodes:
            break
        for node in nodes:
            parent = _parent(node, previous)
            (roots if parent is None else parent.children).append(node)
        previous = nodes
        if len(nodes) == MOST:
            continue
        # What is brighter still lies within these.
        columns, rows = _extent([node.blob for node in nodes], corner)
        opened, corner = opened[rows, columns], (corner[0] + columns.start, corner[1] + rows.start)
    return [blob for root in roots for blob in _best(root)[0]]


def join_halves(blobs: list[Blob]) -> list[Blob]:
    """Blobs, those joined that are the two halves of one view.

    Every pad goes from side to side, and no other is beside it there: what is bright on the same
    rows are the edges of one pad, lit by lamps beside them, whose middle is too dark. Nothing else
    is between them.
    """
    joined: list[Blob] = []
    for blob in sorted(blobs, key=lambda one: one.area, reverse=True):
        half = next((i for i, other in enumerate(joined) if _are_halves(blob, other)), None)
        if half is None:
            joined.append(blob)
            continue
        hull = cv2.convexHull(np.concatenate([blob.contour, joined[half].contour]))
        both = Blob(hull.reshape(-1, 2), cv2.contourArea(hull))
        if any(_holds(both, one) for one in blobs if one not in (blob, joined[half])):
            joined.append(blob)
        else:
            joined[half] = both
    return joined


def _are_halves(one: Blob, other: Blob) -> bool:
    """Whether two blobs are beside each other, with about the same rows and area."""
    left, top, right, bottom = one.box
    other_left, other_top, other_right, other_bottom = other.box
    apart = right <= other_left or other_right <= left
    off = max(abs(top - other_top), abs(bottom - other_bottom))
    alike = other.area < AREAS * one.area and one.area < AREAS * other.area
    return bool(apart and alike and off < UNEVEN * (bottom - 1 - top))


def _levels(gray: Gray) -> tuple[float, ...]:
    """Thresholds from just above the background to full scale."""
    # Every fourth row shows the background as well as all of them do.
    counts = cv2.calcHist([gray[::4]], [0], None, [256], [0, 256]).ravel().astype(int)
    values = np.arange(256)
    middle = _median(values, counts)
    deviation = 1.4826 * _median(np.abs(values - middle), counts)
    lowest = middle + SPREAD * max(deviation, 1.0)
    if lowest >= 250:
        return ()
    return _levels_from(lowest)


@functools.cache
def _levels_from(lowest: float) -> tuple[float, ...]:
    """Thresholds in equal ratios: those between the same two values part an image alike."""
    return tuple(np.unique(np.floor(np.geomspace(lowest, 250.0, LEVELS))).tolist())


def _median(values: Int[np.ndarray, " bins"], counts: Int[np.ndarray, " bins"]) -> int:
    """Of values that occur so often."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(counts[order])
    return int(values[order[np.searchsorted(reached, reached[-1] / 2)]])


def _bright_part(gray: Gray, levels: Sequence[float], margin: int) -> tuple[slice, slice]:
    """Columns and rows of what is brighter than the first of some levels, and of what is near."""
    bright = global_mask(gray, levels[0]) if levels else np.zeros((1, 1), np.uint8)
    left, top, width, height = cv2.boundingRect(bright)
    sizes = zip((left, top), (width, height), strict=True)
    columns, rows = (
        slice(max(first - margin, 0), first + size + margin) if size else slice(0, 0)
        for first, size in sizes
    )
    return columns, rows


def _blobs(gray: Gray, level: float, corner: tuple[int, int], least: float) -> list[Blob]:
    """What is brighter than a level in a part of an image.

    Args:
        gray: the part.
        level: the threshold.
        corner: column and row of its first pixel.
        least: area of a blob that is no speck, px².
    """
    mask = global_mask(gray, level)
    contours = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=corner)[0]
    # The circle has the shortest outline around an area: most specks need no closer look.
    outlines = [c.reshape(-1, 2) for c in contours if len(c) ** 2 >= 4 * least]
    areas = map(cv2.contourArea, outlines)
    return [
        Blob(outline, area) for outline, area in zip(outlines, areas, strict=True) if area >= least
    ][:MOST]


def _extent(blobs: Sequence[Blob], corner: tuple[int, int]) -> tuple[slice, slice]:
    """Columns and rows of some blobs, from a part's first pixel on."""
    left, top, right, bottom = zip(*(blob.box for blob in blobs), strict=True)
    return (
        slice(min(left) - corner[0], max(right) - corner[0]),
        slice(min(top) - corner[1], max(bottom) - corner[1]),
    )


def _parent(node: _Node, previous: Sequence[_Node]) -> _Node | None:
    """Which of the blobs of the threshold below holds one; ``None`` where none does."""
    column, row, _, _ = node.blob.box
    around = [
        other
        for other in previous
        if other.blob.box[0] <= column < other.blob.box[2]
        and other.blob.box[1] <= row < other.blob.box[3]
    ]
    if len(around) == 1 and len(previous) < MOST:
        return around[0]
    return next((other for other in around if _holds(other.blob, node.blob)), None)


def _holds(outer: Blob, inner: Blob) -> bool:
    column, row = inner.contour[0].tolist()
    return cv2.pointPolygonTest(outer.contour, (column, row), False) >= 0


def _best(node: _Node) -> tuple[list[Blob], float]:
    """The blobs of a tree, and by how many pixels a threshold moves the least stable of them.

    They are those of its branches where all of these are stable, else the stablest of its stem.
    What only a gradient of light parts is not stable: its outline wanders with the threshold. Where
    that of the stem wanders, too, as about a pad on walls that it lights, most of it in stable
    branches is enough.
    """
    chain = [node.blob]
    while len(parts := _parts(node)) == 1:
        node = parts[0]
        chain.append(node.blob)
    blob, shift = _stablest(chain)
    if parts:
        branches = [_best(part) for part in parts]
        worst = max(shift for _, shift in branches)
        steady = [(blobs, shift) for blobs, shift in branches if shift <= STEADY]
        filled = sum(blob.area for blobs, _ in steady for blob in blobs)
        if shift > STEADY and filled > MOSTLY * chain[-1].area:
            worst = max(shift for _, shift in steady)
        if worst <= max(STEADY, shift):
            return [blob for blobs, _ in branches for blob in blobs], worst
    return [blob], shift


def _stablest(chain: list[Blob]) -> tuple[Blob, float]:
    """The blob of a chain that changes least, and by how many pixels its outline moves."""
    if len(chain) == 1:
        return chain[0], np.inf
    areas = np.array([blob.area for blob in chain])
    perimeters = np.array([len(blob.contour) for blob in chain])
    shifts = np.abs(np.diff(areas)) / perimeters[1:]
    # The first and the last have one neighbour only.
    moved = np.maximum(np.append(shifts[0], shifts), np.append(shifts, shifts[-1]))
    steadiest = int(np.argmin(moved))
    return chain[steadiest], float(moved[steadiest])


def _parts(node: _Node) -> list[_Node]:
    """What a blob falls into, without chips."""
    return [c for c in node.children if c.blob.area > LIKE * node.blob.area]
