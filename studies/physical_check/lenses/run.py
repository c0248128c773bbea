"""The study itself: from its spec to its results."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import perception.boards
from designopt import Context, Records, Report, Results, UserError
from designopt.compilation_cache import forget_programs_if_many
from designopt.study import plots
from designopt.user_folders import cache_folder
from optics.calibration import LensFit, Sightings, locate_boards
from optics.calibration.bundle import lens_of, parameters_of
from optics.calibration.lens import calibrate_lens
from optics.calibration.starts import LEAST_POINTS
from perception.boards import Board, detect_board
from studies.models import board_sightings
from studies.models.board_sightings import sightings_of
from studies.models.path_tracer import require_mitsuba
from studies.oracles.judge import boards as judge
from studies.oracles.judge.frames import sources as judge_sources
from studies.oracles.judge.keeping import kept_arrays
from studies.oracles.judge.wide_lens import WideLens
from studies.physical_check.lenses import LensCheckSpec
from studies.physical_check.lenses.baseline import calibrate_with_opencv

BOARDS: tuple[tuple[Board, Literal["charuco", "tags"], str], ...] = (
    (Board(), "charuco", "DICT_4X4_100"),
    (Board(kind="apriltag", columns=9, rows=7, square=6.5), "tags", "DICT_APRILTAG_36h11"),
)
"""Boards of one lens after the other, and what the judge and OpenCV call their kind and markers."""

FOLDER = "physical-check-lenses"
"""In the user's cache folder: what is kept."""


def run(spec: LensCheckSpec, context: Context) -> Results:
    """Take pictures with Mitsuba, calibrate, compare with the lenses they were taken with.

    Raises:
        UserError: Mitsuba is not installed, or another float type than float64.
    """
    context.require_float64("physical-check-lenses compares to a hundredth of a pixel")
    require_mitsuba("physical-check-lenses")
    folder = cache_folder(spec.cache, FOLDER)
    out = Report(spec, package=__package__)
    sets, corners, errors = Records(), Records(), Records()
    for number in context.each(range(spec.sets), lambda number: f"Lens {number + 1}"):
        _add_set(pictured(spec, context.seed, number, folder), sets, corners, errors)
        forget_programs_if_many()
    add_metrics(out, sets, corners, errors)
    add_findings(out, sets)
    add_tables(out, sets, corners, errors)
    add_figures(out, sets, errors)
    return out.results()


class Pictured(NamedTuple):
    """A lens, and what is found in its pictures of a board.

    Attributes:
        number: of the lens.
        lens: it.
        board: before it.
        given: pictures that its calibration gets; further ones follow.
        seen: the corners that are found.
        truth: where all corners are.
        seconds: that finding them took, when they were found.
    """

    number: int
    lens: WideLens
    board: Board
    given: int
    seen: Sightings
    truth: Float[np.ndarray, "pictures points 2"]
    seconds: Float[np.ndarray, " pictures"]


def pictured(spec: LensCheckSpec, seed: int, number: int, folder: Path) -> Pictured:
    """Photograph a board with a random lens, and find its corners, or take what is kept of that.

    A run that was stopped goes on; what another judge or detector has made is made again.

    Args:
        spec: of the study.
        seed: of lenses, poses and conditions.
        number: of the lens.
        folder: where corners are kept.
    """
    generator = np.random.default_rng([seed, number])
    lens = judge.random_lens(generator)
    board, kind, markers = BOARDS[number % len(BOARDS)]
    count = int(generator.integers(spec.fewest, spec.most + 1))
    made = judge.Board(kind, board.columns, board.rows, board.square, board.marker_side, markers)

    def detected() -> dict[str, Any]:
        corners, true, seconds = [], [], []
        for picture in range(count + spec.further):
            pose = judge.random_pose(generator, lens, made)
            conditions = judge.random_conditions(generator)
            taken = judge.photograph_board(lens, made, pose, conditions, picture)
            begin = time.perf_counter()
            corners.append(detect_board(taken.pixels, board))
            seconds.append(time.perf_counter() - begin)
            true.append(taken.places)
        seen = sightings_of(board, corners)
        arrays = {"places": seen.places, "deviations": seen.deviations}
        return arrays | {"truth": true, "seconds": seconds}

    asked = [seed, number, spec.fewest, spec.most, spec.further, *map(str, (board, kind, markers))]
    kept = kept_arrays(folder, _sources() + json.dumps(asked).encode(), detected)
    points = np.broadcast_to(board.points, kept["places"].shape)
    seen = Sightings(*map(jnp.asarray, (points, kept["places"], kept["deviations"])))
    return Pictured(number, lens, board, count, seen, kept["truth"], kept["seconds"])


@functools.cache
def _sources() -> bytes:
    """What photographs boards and finds their corners: its files, and OpenCV's version."""
    detector = sorted(Path(perception.boards.__file__).parent.glob("*.py"))
    files = [*detector, Path(board_sightings.__file__)]
    own = b"".join(path.read_bytes() for path in files)
    return judge_sources() + own + cv2.__version__.encode()


def _add_set(made: Pictured, sets: Records, corners: Records, errors: Records) -> None:
    """Calibrate a lens by its pictures, add what is found."""
    number, lens, board, count, seen, truth, seconds = made
    off = np.linalg.norm(np.asarray(seen.places) - truth, axis=-1)
    where = {"lens": number, "board": board.kind, "field_deg": 2 * np.degrees(lens.largest)}
    imaged = int(np.isfinite(truth[..., 0]).sum())
    given, further = (jax.tree.map(lambda one, part=part: one[part], seen)
                      for part in (slice(count), slice(count, None)))  # fmt: skip
    begin = time.perf_counter()
    fit = failure = None
    try:
        fit = calibrate_lens(given, lens.size)
    except UserError as error:
        failure = str(error)
    took = time.perf_counter() - begin
    opencv = calibrate_with_opencv(board.points, np.asarray(given.places), lens.size)
    judged = [] if fit is None else _further(fit, further, truth[count:])
    sets.add(
        **where,
        pictures=count,
        imaged=imaged,
        found=int(np.isfinite(off).sum()),
        converged=fit is not None,
        failure=failure or "",
        moving=fit is not None and fit.pupil.value == "moving",
        held_out_px=np.nan if fit is None else fit.calibrated.held_out,
        further_px=float(np.median(judged)) if len(judged) else np.nan,
        noise_px=np.nan if fit is None else fit.calibrated.noise,
        seconds=took,
        detect_seconds=float(np.median(seconds)),
        opencv_failed=opencv.failure != "",
        opencv_failure=opencv.failure,
        opencv_px=opencv.median,
        opencv_seconds=opencv.seconds,
    )
    corners.add(board=board.kind, error_px=off[np.isfinite(off)])
    if fit is not None:
        for name, error, deviation in parameter_errors(fit, lens):
            errors.add(**where, parameter=name, error=error, deviation=deviation,
                       ratio=error / deviation)  # fmt: skip


def _further(
    fit: LensFit, seen: Sightings, truth: Float[np.ndarray, "pictures points 2"]
) -> Float[np.ndarray, " corners"]:
    """Distances of true corners from those predicted, in pictures that the fit has not had.

    A picture's pose is that of every other corner that is found in it.
    """
    used = np.asarray(seen.used).copy()
    used[:, 1::2] = False
    enough = used.sum(axis=1) >= LEAST_POINTS
    half = Sightings(
        seen.points, seen.places, jnp.where(jnp.asarray(used), seen.deviations, jnp.inf)
    )
    _, left = locate_boards(fit.calibrated, half)
    off = np.linalg.norm(left + np.asarray(seen.places) - truth, axis=-1)[:, 1::2][enough]
    return off[np.isfinite(off)]


def parameter_errors(fit: LensFit, lens: WideLens) -> Iterator[tuple[str, float, float]]:
    """What parameters are off by, and their deviations, in px, and the pupil's shift in mm.

    Of the polynomial, whose coefficients depend on each other, image heights at three angles are
    compared, as far as there have been corners.
    """
    calibrated = fit.calibrated
    small = 1e-4
    slope = float(lens.heights(np.array([small]))[0]) / small
    shares = np.array([0.4, 0.7, 0.95])
    angles = shares * calibrated.widest
    heights = lens.focal * lens.heights(angles)
    truth = [lens.focal * slope, *lens.middle, *heights, lens.shifts(angles[2:])[0]]

    def quantities(parameters: Array) -> Array:
        own = lens_of(parameters)
        raised = own.focal * own.projection.height(jnp.asarray(angles))
        return jnp.concatenate([parameters[:3], raised, own.shift(jnp.asarray(angles[2:]))])

    parameters = jnp.asarray(parameters_of(calibrated.lens))
    found, slopes = (
        np.asarray(quantities(parameters)),
        np.asarray(jax.jacfwd(quantities)(parameters)),
    )
    deviations = np.sqrt(np.einsum("qi,ij,qj->q", slopes, calibrated.covariance, slopes))
    names = ["focal length", "column of the axis", "row of the axis"]
    names += [f"image height at {share:.0%} of the field" for share in shares]
    names += [f"shift of the pupil at {shares[2]:.0%}"]
    for name, one, true, deviation in zip(names, found, truth, deviations, strict=True):
        if deviation > 0:
            yield name, float(one - true), float(deviation)


def add_metrics(out: Report, sets: Records, corners: Records, errors: Records) -> None:
    """The study's numbers."""
    ratios = {name: own.stat("rms ratio") for name, own in errors.group("parameter").items()}
    worst = max(ratios.values(), key=lambda ratio: abs(np.log(ratio)), default=np.nan)
    out.metrics(
        sets=len(sets),
        converged=sets.stat("share converged"),
        held_out_px=sets.stat("median held_out_px"),
        held_out_worst_px=sets.stat("max held_out_px"),
        further_px=sets.stat("median further_px"),
        further_worst_px=sets.stat("max further_px"),
        deviation_ratio=errors.stat("rms ratio"),
        deviation_ratio_worst=worst,
        corner_median_px=corners.stat("median error_px"),
        corner_p99_px=corners.stat("p99 error_px"),
        corners_found=sets.stat("sum found") / sets.stat("sum imaged"),
        seconds=sets.stat("median seconds"),
        detect_seconds=sets.stat("median detect_seconds"),
        opencv_failed=sets.stat("share opencv_failed"),
        opencv_px=sets.where(opencv_failed=False).stat("median opencv_px"),
    )


def add_findings(out: Report, sets: Records) -> None:
    """Plain sentences, most important first."""
    out.say("converged")
    out.say("deviations")
    out.say("opencv", failures=int(sets.stat("sum opencv_failed")))
    failed = sets.where(converged=False)
    if len(failed):
        out.say("failed", count=len(failed), first=str(failed["failure"][0]))


def add_tables(out: Report, sets: Records, corners: Records, errors: Records) -> None:
    """Errors by parameter, by field of view and board; every set."""
    ratio = {"rms_ratio": "rms ratio", "median_abs": "median_abs error"}
    of_lenses = {"lenses": "count error", **ratio}
    out.table("parameters", errors.summary("parameter", **of_lenses))
    bands = np.floor(sets["field_deg"].astype(float) / 20) * 20
    by = {"lenses": "count converged", "converged": "share converged"}
    by |= {"held_out_px": "median held_out_px", "further_px": "median further_px"}
    by |= {"opencv_failed": "share opencv_failed", "opencv_px": "median opencv_px"}
    by |= {"seconds": "median seconds", "opencv_seconds": "median opencv_seconds"}
    out.table("fields", (sets | {"from_deg": bands}).summary("from_deg", **by))
    found = {"corners": "count error_px", "median_px": "median error_px"}
    found |= {"p99_px": "p99 error_px", "worst_px": "max error_px"}
    out.table("corners", corners.summary("board", **found))
    out.table("sets", sets)


def add_figures(out: Report, sets: Records, errors: Records) -> None:
    """Errors of held-out corners over the field of view, and ratios of errors to deviations."""
    names = {"further_px": "error of corners (px)", "ratio": "error over deviation"}
    out.figure("further", plots.ecdf(sets, "further_px", by="board", log="x", names=names))
    out.figure("ratios", plots.ecdf(errors, "ratio", by="parameter", names=names))
