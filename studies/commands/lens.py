"""From pictures of a board to a lens's file, its figure, and what to do next."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import jax
import numpy as np

from designopt.errors import UserError
from designopt.io.files import check_targets, printable, replaced_when_complete
from designopt.plot.figures import style, trim
from optics.calibration import LensFit, PupilModel, Suggestion
from optics.calibration.calibrated import format_lens
from optics.calibration.guidance import predict_deviations, suggest_pictures
from optics.calibration.lens import calibrate_lens
from optics.plot.lens_figure import draw_lens_fit
from perception.boards import Board, BoardCorners, detect_board, read_board
from perception.sources import Frame, LostFrame, VideoFile, open_source
from studies.models.board_sightings import sightings_of

MOST = 60
"""Pictures that are used; of a longer video, those that differ most."""

MOVED = 0.02
"""Frames whose corners have moved by less than this part of the image's width show nothing new."""

NAMED = 5
"""Files that a line names; of more, their number."""


@dataclass
class BoardPictures:
    """What pictures show of a board.

    Attributes:
        names: of the pictures that show some of it.
        corners: of the board in each of them.
        empty: names of those that show none.
        lost: lines on those that cannot be read.
        size: columns and rows of all.
    """

    names: list[str] = field(default_factory=list)
    corners: list[BoardCorners] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    size: tuple[int, int] = (0, 0)


def calibrate_from(
    pictures: str, board_file: Path | None, distance: str, out: Path, *, force: bool
) -> tuple[list[str], list[str]]:
    """Calibrate a lens and write its file and its figure.

    Returns:
        Lines of the result, and warnings.

    Raises:
        UserError: a file or an option is wrong, or the pictures determine no lens.
    """
    near, far = _distances(distance)
    figures = [out.with_suffix(ending) for ending in (".png", ".svg")]
    check_targets({"--out": out} | {f"--out {one}": one for one in figures}, force=force)
    board = Board() if board_file is None else read_board(board_file)
    found = find_boards(pictures, board)
    with jax.enable_x64(True):
        fit = calibrate_lens(sightings_of(board, found.corners), found.size, printable(out.stem))
        middle = math.sqrt(near * far)
        deviations = predict_deviations(fit.calibrated, middle)
        suggestions = suggest_pictures(fit.calibrated, board.points, (near, far))
        with style():
            figure = draw_lens_fit(fit, deviations, suggestions)
            trim(figure)
            with ExitStack() as all_or_none:
                for path in figures:
                    figure.savefig(all_or_none.enter_context(replaced_when_complete(path)))
                partial = all_or_none.enter_context(replaced_when_complete(out))
                partial.write_text(format_lens(fit.calibrated), encoding="utf-8")
        lines = [*_summary(fit, found, deviations.rms, middle), *_advice(suggestions)]
        remarks = [*found.lost, *_remarks(fit, found, near, far)]
    return [printable(str(out)), *lines], remarks


def _distances(text: str) -> tuple[float, float]:
    try:
        near, far = map(float, text.split(":"))
    except ValueError:
        near = far = math.nan
    if not 0 < near < far <= 1e5:
        raise UserError(f"--distance {text}: write it as NEAREST:FARTHEST in mm, such as 15:60")
    return near, far


def find_boards(pictures: str, board: Board) -> BoardPictures:
    """What the pictures of a folder, or the frames of a video, show of a board.

    Raises:
        UserError: there are no such pictures, they have different sizes, or none shows the board.
    """
    found = BoardPictures()
    with open_source(pictures) as source:
        video = isinstance(source, VideoFile)
        for item in source:
            if isinstance(item, LostFrame):
                found.lost.append(str(item))
            elif isinstance(item, Frame):
                _look(found, item, board, novel=video)
            if len(found.names) >= 2 * MOST:
                _thin_out(found)
    if not found.names:
        raise UserError(
            f"{pictures}: no picture shows the board, of {len(found.empty)} that can be read and "
            f"{len(found.lost)} that cannot; check --board, light and focus"
        )
    while len(found.names) > MOST:
        _thin_out(found)
    return found


def _look(found: BoardPictures, frame: Frame, board: Board, *, novel: bool) -> None:
    """Add a picture, unless it shows no board or, if that is asked for, nothing novel."""
    rows, columns, _ = frame.image.shape
    if found.size not in ((0, 0), (columns, rows)):
        raise UserError(
            f"{frame.name}: it has {columns}x{rows} px and those before it "
            f"{found.size[0]}x{found.size[1]} px; calibrate with pictures of one size"
        )
    found.size = columns, rows
    corners = detect_board(frame.image, board)
    if corners is None:
        found.empty.append(frame.name)
        return
    if novel and found.names and _moved(found.corners[-1], corners) < MOVED * columns:
        return
    found.names.append(frame.name)
    found.corners.append(corners)


def _moved(one: BoardCorners, other: BoardCorners) -> float:
    """Root mean square distance between the points that both show, px; infinite without any."""
    _, first, second = np.intersect1d(one.numbers, other.numbers, return_indices=True)
    away = np.linalg.norm(one.places[first] - other.places[second], axis=1)
    return float(np.sqrt(np.mean(away**2))) if len(away) else math.inf


def _thin_out(found: BoardPictures) -> None:
    """Leave the picture out that differs least from the one after it."""
    apart = [_moved(*pair) for pair in itertools.pairwise(found.corners)]
    least = int(np.argmin(apart))
    for kept in (found.names, found.corners):
        kept.pop(least)


def _summary(fit: LensFit, found: BoardPictures, rms: float, distance: float) -> Iterator[str]:
    lens, deviations = fit.calibrated, fit.calibrated.deviations
    (column, row), corners = lens.lens.principal.tolist(), int(fit.used.sum())
    fixed, moving = (fit.held_out[model].rms for model in PupilModel)
    left_out = int(np.isfinite(fit.sightings.places[..., 0]).sum()) - corners
    yield (
        f"pictures: {lens.pictures} used, {len(found.empty)} without a board, {len(found.lost)} "
        f"unreadable; corners: {corners} used, {left_out} left out"
    )
    yield f"focal length: {lens.lens.focal:.3f} ± {deviations[0]:.3f} px"
    yield (
        f"principal point: {column:.3f} ± {deviations[1]:.3f}, {row:.3f} ± {deviations[2]:.3f} px"
    )
    coefficients = ", ".join(f"{one:.6g}" for one in lens.lens.coefficients.tolist())
    yield f"projection: k1 ... k{len(lens.lens.coefficients)} = {coefficients}"
    e2, e4 = lens.lens.pupil_shift.tolist()
    yield (
        f"pupil: {fit.pupil.value}, {e2:.3f} ± {deviations[-2]:.3f} mm/rad² and {e4:.3f} ± "
        f"{deviations[-1]:.3f} mm/rad⁴ (held-out corners: {moving:.3f} px rms moving, "
        f"{fixed:.3f} px fixed)"
    )
    yield (
        f"corners: {lens.noise:.3f} px deviation, {lens.held_out:.3f} px off in held-out pictures "
        f"(median), up to {math.degrees(lens.widest):.1f}° from the axis"
    )
    yield f"places at {distance:.0f} mm, up to there: {rms:.3f} px deviation"


def _advice(suggestions: Sequence[Suggestion]) -> Iterator[str]:
    """Which pictures to take next."""
    if not suggestions:
        yield "next: no further picture is worth taking"
    for number, one in enumerate(suggestions, 1):
        tilted = (
            "facing the camera" if one.tilt == 0 else f"tilted by {math.degrees(one.tilt):.0f}°"
        )
        yield (
            f"next {number}: board {one.distance:.0f} mm away, its middle at column "
            f"{one.place[0]:.0f}, row {one.place[1]:.0f} ({math.degrees(one.angle):.0f}° from the "
            f"axis), {tilted}: {one.deviation:.3f} px"
        )


def _remarks(fit: LensFit, found: BoardPictures, near: float, far: float) -> Iterator[str]:
    """What a person should learn of the pictures."""
    pairs = zip(fit.pictures, fit.distances(), strict=True)
    elsewhere = [found.names[i] for i, away in pairs if not near <= away <= far]
    unused = [name for i, name in enumerate(found.names) if i not in fit.pictures]
    for names, what in (
        (
            elsewhere,
            f"the board is not {near:g} to {far:g} mm away, where the pads will be: only there the "
            "moving pupil shows; take others, or set --distance",
        ),
        (unused, "too little of the board is seen to use it"),
        (found.empty, "no board is found"),
    ):
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        if names:
            yield f"{', '.join(names[:NAMED])}{more}: {what}"
