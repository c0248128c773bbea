"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from designopt import Context, Records, Report, Results
from designopt.plot.figures import PALETTE, new_figure
from designopt.plot.typesetting import drawn_name
from designopt.study import plots
from designopt.user_folders import cache_folder
from optics import (
    Imaging,
    Pieces,
    Scene,
    find_corners,
    find_coverage,
    find_outlines,
    find_views,
    name_paths,
    parse_scene,
)
from optics.visibility.outlines import CORNERS
from studies.models.path_tracer import require_mitsuba
from studies.oracles.judge.frames import FAN, Corner, Frame, View, judge_once, picture
from studies.physical_check import PhysicalCheckSpec
from studies.physical_check.cases import Case, cases

FOLDER = "physical-check"
"""Of judged frames, in the user's cache."""

NOTED_PX, NOTED_COVERAGE = 0.1, 1e-3
"""Differences above these are listed."""

SHOWN_PX = 1e-6
"""Smaller errors are drawn there."""

KINDS = {"none": "none", "+": "two layers", "clear": "one layer, clear ends", "bevel": "bevelled"}
"""What layers are called in the figure by a part of their name; all others are black."""

PICTURE_STEP = 2.0
"""Of the rays of a picture, px."""


def run(spec: PhysicalCheckSpec, context: Context) -> Results:
    """Judge frames with Mitsuba, predict them with the library, compare.

    Raises:
        UserError: Mitsuba is not installed, or another float type than float64.
    """
    context.require_float64("physical-check compares to a hundredth of a pixel")
    mitsuba = require_mitsuba("physical-check")
    out, found = Report(spec, package=__package__), Comparison()
    folder, shown = cache_folder(spec.cache, FOLDER), None
    for case in context.each(
        [*cases(spec, context.seed)], lambda case: f"{case.finger} finger, layers: {case.layers}"
    ):
        frames = [judge_once(case.tables, pose, folder) for pose in case.poses]
        scene = parse_scene(case.tables, case.finger)
        found.compare(case, scene, frames)
        shown = (case, scene) if case.finger == "designed" else shown
    out.values(variant=mitsuba.variant())
    add_metrics(out, found)
    add_findings(out, found)
    add_tables(out, found)
    assert shown is not None  # the designed finger is in every run
    add_figures(out, found, *shown)
    return out.results()


class Comparison:
    """Differences between judge and library, gathered frame by frame.

    Attributes:
        corners: those of the pads that the judge sees in the image, with their errors.
        ends: of the views down the middle column that both have, with their errors.
        views: of both, and whether the other has it, too.
        coverage: of every pad, by both.
        frames: how long the judge took.
        noted: what differs most.
    """

    def __init__(self) -> None:
        self.corners, self.ends, self.views = Records(), Records(), Records()
        self.coverage, self.frames, self.noted = Records(), Records(), Records()

    def compare(self, case: Case, scene: Scene, frames: Sequence[Frame]) -> None:
        """Add the frames of a case."""
        degrees = [[pose[name] for name in scene.angle_names] for pose in case.poses]
        poses = jnp.deg2rad(jnp.asarray(degrees))
        corners = predict_corners(scene, poses, case.width)
        pieces: Any = jax.tree.map(np.asarray, find_views(scene, poses).value)
        coverage = np.asarray(find_coverage(scene, poses).value)
        for i, frame in enumerate(frames):
            angles = ", ".join(f"{name} {angle:g}°" for name, angle in case.poses[i].items())
            where = {"finger": case.finger, "layers": case.layers, "pose": angles}
            self.frames.add(**where, seconds=frame.seconds)
            for corner in frame.corners:
                self._add_corner(where, scene, corner, corners[i])
            predicted = predicted_views(scene, jax.tree.map(lambda leaf, i=i: leaf[i], pieces))
            for pair in match_views(frame.views, predicted):
                self._add_views(where, case, *pair)
            for pad, other in zip(scene.layout.pads, coverage[i].tolist(), strict=True):
                seen, own = frame.coverage[pad.name], where | {"pad": pad.name}
                self.coverage.add(**own, coverage=seen, difference=seen - other)
                self._note(own, "coverage", seen, other, seen - other, NOTED_COVERAGE)

    def _add_corner(
        self, where: dict[str, str], scene: Scene, corner: Corner, predicted: np.ndarray
    ) -> None:
        names = [pad.name for pad in scene.layout.pads]
        index = paths_of(scene).index(corner.path), names.index(corner.pad)
        place = predicted[(*index, CORNERS.index((corner.end, corner.side)))]
        way, error = way_of(corner.path), float(np.hypot(*(place - corner.place)))
        own = where | {"pad": corner.pad}
        self.corners.add(**own, way=way, error_px=error, noise_px=corner.residual)
        what = f"{way}, corner at '{('from', 'to')[corner.end]}': row, px"
        self._note(own, what, corner.place[1], place[1], error, NOTED_PX)

    def _add_views(
        self, where: dict[str, str], case: Case, seen: View | None, other: View | None
    ) -> None:
        one = seen or other
        assert one is not None
        way = "end face" if "end" in one.entrance else way_of(one.path)
        own = where | {"pad": one.pad}
        self.views.add(**own, way=way, unmatched=seen is None or other is None)
        if seen is None or other is None:
            rows = [view.rows[0] if view else math.nan for view in (seen, other)]
            self._note(own, f"{way}, view of one only: first row, px", *rows, math.nan, NOTED_PX)
            return
        pad = next(pad for pad in case.tables["pads"] if pad["name"] == one.pad)
        length = 1000 * math.dist(pad["from"], pad["to"])
        for i, bound in enumerate(seen.bounds):
            error, along = other.rows[i] - seen.rows[i], other.along[i] - seen.along[i]
            self.ends.add(**own, way=way, bound=bound, error_px=error, error_um=length * along)
            what = f"{way}, view ended by {bound}: row, px"
            self._note(own, what, seen.rows[i], other.rows[i], error, NOTED_PX)

    def _note(self, where: dict[str, str], what: str, *numbers: float) -> None:
        judge, library, off, allowed = map(float, numbers)
        if not abs(off) <= allowed:
            self.noted.add(**where, what=what, judge=judge, library=library, difference=abs(off))


def predict_corners(
    scene: Scene, poses: Float[Array, "poses joints"], width: float
) -> Float[np.ndarray, "poses paths pads 4 2"]:
    """The library's corners in several poses."""
    return np.asarray(_corners(Imaging.of(scene.camera), scene, poses, jnp.asarray(width)))


@jax.jit
def _corners(
    imaging: Imaging, scene: Scene, poses: Float[Array, "poses joints"], width: Float[Array, ""]
) -> Float[Array, "poses paths pads 4 2"]:
    return jax.vmap(lambda pose: find_corners(imaging, find_outlines(scene, pose), width))(poses)


def paths_of(scene: Scene) -> list[str]:
    """Names of the mirrors of every path, as the judge has them."""
    return [name.partition(":")[2] for name in name_paths(scene.layout)]


def way_of(path: str) -> str:
    """What errors are grouped by."""
    return "mirror" if path else "direct"


def predicted_views(scene: Scene, pieces: Pieces) -> list[View]:
    """The library's pieces of one pose as the judge has its views."""
    found = []
    for index in zip(*np.nonzero(pieces.present), strict=True):
        rows = (pieces.pixels[index] - 0.5).tolist()
        along = [float(pieces.start[index]), float(pieces.end[index])]
        if rows[0] > rows[1]:
            rows, along = rows[::-1], along[::-1]
        name, path = scene.layout.pads[index[0]].name, paths_of(scene)[pieces.path[index]]
        by_end = pieces.face is not None and pieces.face[index] > 0
        found.append(View(name, path, "end" if by_end else "", rows, along, ["", ""]))
    return found


def match_views(
    judged: Sequence[View], predicted: Sequence[View]
) -> Iterator[tuple[View | None, View | None]]:
    """Views of the judge with those of the library that show the same; both where there is one.

    A predicted view that is too narrow for the judge's fan of rays is left out.
    """
    left = list(predicted)
    for seen in judged:
        same = [
            other
            for other in left
            if (other.pad, other.path) == (seen.pad, seen.path)
            and other.rows[0] < seen.rows[1]
            and other.rows[1] > seen.rows[0]
        ]
        best = min(same, key=lambda other: math.dist(other.rows, seen.rows), default=None)
        if best is not None:
            left.remove(best)
        yield seen, best
    yield from ((None, other) for other in left if other.rows[1] - other.rows[0] > 2 * FAN)


def add_metrics(out: Report, found: Comparison) -> None:
    """The study's numbers."""
    corners, ends = found.corners, found.ends
    out.metrics(
        frames=len(found.frames),
        corners=len(corners),
        corner_median_px=corners.stat("median error_px"),
        corner_worst_px=corners.stat("max error_px"),
        noise_median_px=corners.stat("median noise_px"),
        view_end_median_px=ends.stat("median_abs error_px"),
        view_end_worst_px=ends.stat("max_abs error_px"),
        view_end_worst_um=ends.stat("max_abs error_um"),
        views=len(found.views),
        views_unmatched=found.views.stat("sum unmatched"),
        coverage_worst=found.coverage.stat("max_abs difference"),
        judge_seconds=found.frames.stat("median seconds"),
    )


def add_findings(out: Report, found: Comparison) -> None:
    """Plain sentences, most important first."""
    out.say("corners")
    bare = found.corners.where(layers="none")
    if 0 < len(bare) < len(found.corners):
        worst = bare.stat("max error_px")
        out.say("bare", median=bare.stat("median error_px"), worst=worst, count=len(bare))
    out.say("views")
    out.say("coverage")
    if len(found.noted):
        out.say("noted", count=len(found.noted))
    out.say("noise")


def add_tables(out: Report, found: Comparison) -> None:
    """Errors by layers and way, coverage by layers, the largest differences."""
    by, errors = ("layers", "way"), {"median_px": "median_abs error_px"}
    errors |= {"p95_px": "p95_abs error_px", "worst_px": "max_abs error_px"}
    count, noise = "count error_px", "median noise_px"
    out.table("corners", found.corners.summary(*by, corners=count, **errors, noise_px=noise))
    worst = "max_abs error_um"
    out.table("ends", found.ends.summary(*by, ends=count, **errors, worst_um=worst))
    views = {"views": "count unmatched", "unmatched": "sum unmatched"}
    out.table("views", found.views.summary(*by, **views))
    seen = {"frames": "count coverage", "least": "min coverage", "mean": "mean coverage"}
    seen |= {"worst_difference": "max_abs difference"}
    out.table("coverage", found.coverage.summary("layers", "pad", **seen))
    if len(found.noted):
        out.table("noted", found.noted)


def add_figures(out: Report, found: Comparison, case: Case, scene: Scene) -> None:
    """Distribution of the corners' errors, and a frame as the judge sees it."""
    names, marks = {"error_px": "error of a corner (px)"}, {"target": 0.01}
    kinds = [
        next((kind for part, kind in KINDS.items() if part in layers), "one layer, black")
        for layers in found.corners["layers"].tolist()
    ]
    drawn = found.corners | {"kind": kinds}
    drawing = plots.ecdf(
        drawn, "error_px", by="kind", marks=marks, log="x", least=SHOWN_PX, names=names
    )
    out.figure("corners", drawing)
    out.figure("frame", draw_frame(case, scene), layers=case.layers, most=2)


def draw_frame(case: Case, scene: Scene) -> Figure:
    """The judge's picture of a case's first pose, and the library's corners in it."""
    pose = case.poses[0]
    angles = jnp.deg2rad(jnp.asarray([[pose[name] for name in scene.angle_names]]))
    [corners] = predict_corners(scene, angles, case.width)
    drawing, [[axes]] = new_figure(1, 1, height=4.0)
    light = picture(case.tables, pose, PICTURE_STEP)
    rows, columns = (PICTURE_STEP * size for size in light.shape)
    axes.imshow(light, cmap="gray", vmin=0, vmax=1, extent=(-0.5, columns, rows, -0.5))
    for color, path, of_path in zip(PALETTE, paths_of(scene), corners, strict=False):
        places = of_path.reshape(-1, 2)
        places = places[np.all((places >= 0) & (places <= (columns, rows)), axis=-1)]
        if not len(places):
            continue
        label = f"predicted corners, {f'mirror {path}' if path else 'direct'}"
        axes.plot(*places.T, "o", color=color, fillstyle="none", label=drawn_name(label))
    axes.set(xlim=(0, columns), ylim=(rows, 0), xlabel="column (px)", ylabel="row (px)")
    axes.grid(visible=False)
    return drawing
