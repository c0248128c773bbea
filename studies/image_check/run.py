"""The study itself: from its spec to its results."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from designopt import Context, Records, Report, Results
from designopt.plot.figures import new_figure
from designopt.study import plots
from designopt.user_folders import cache_folder
from optics import parse_scene
from optics.calibration import CalibratedLens
from optics.calibration.lens import calibrate_lens
from optics.scene.layers import CHANNELS, GREEN
from optics.visibility.outlines import CORNERS
from perception.boards import Board, detect_board
from perception.matching import Sighting
from perception.proprioception import (
    JointAngleResult,
    calibrate,
    compute_information_bound,
    find_pose,
    observe,
    stack_observations,
)
from perception.proprioception.observation import CONSTANT
from perception.quality import Quality
from studies.image_check import ImageCheckSpec
from studies.image_check.cases import (
    COUPLED,
    EVEN,
    GAP,
    Finger,
    fingers,
    in_deviations,
    nominal,
    plain,
    pose_of,
    with_lamps,
    without_layers,
)
from studies.models.board_sightings import sightings_of
from studies.models.path_tracer import require_mitsuba
from studies.models.sensor.estimators import Predictor
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.made import deviations_of, in_section
from studies.models.sensor.sensor_folder import finger_sensor
from studies.models.sensor.spec import WIDTH
from studies.oracles.judge import boards
from studies.oracles.judge.photograph import Photograph, photograph
from studies.oracles.judge.wide_lens import WideLens

FOLDER = "image-check"
"""Of pictures, in the user's cache."""

SURE = 5.0
"""Standard deviations by which an answer must be off to be wrong with confidence."""

FAR_PX = 3.0
"""A corner that is off by less is not wrong, however sure it is."""

FLOOR_PX = 0.05
"""Standard deviation of a corner in a frame beyond its own covariance: less than by default, which
is for pads with rough edges, as these are straight. It was set on ten fingers of seed 0."""

FLAT = 1e-5
"""mm: a membrane that is lifted by less is flat."""

ENDS = {(0, -1): 0, (0, 1): 1, (1, -1): 2, (1, 1): 3}
"""Places of the judge's corners, by end and side."""

NOT_SEEN = JointAngleResult[JointAngleResult.not_seen]
"""Message of a joint that no complete view shows."""

BOARDS, DICTIONARY = 12, "DICT_4X4_100"
"""Pictures of a board from which a lens is calibrated, and OpenCV's name of the board's markers."""

DESIGNED, CALIBRATED = "designed", "calibrated"
"""What is known of a lens."""

MODELS = ("in space, with layers", "in the section, in air")


def run(spec: ImageCheckSpec, context: Context) -> Results:
    """Photograph fabricated fingers, find their views, calibrate them, estimate joint angles.

    Raises:
        UserError: Mitsuba is not installed, or another float type than float64.
    """
    context.require_float64("image-check compares with a path tracer")
    require_mitsuba("image-check")
    folder = cache_folder(spec.cache, FOLDER)
    found = Findings(spec)
    # Those of the finger with everything: the others have fewer errors.
    scene = parse_scene(nominal("3 mm, pupil"), "finger")
    deviations = plain(deviations_of(spec.tolerances, scene))
    layers = ""
    tried = sorted(fingers(spec, deviations, context.seed), key=lambda one: one.layers)
    for finger in context.each(
        tried, lambda one: f"Finger {one.number}: {one.light}, layers: {one.layers}"
    ):
        if finger.layers != layers:
            # Compiled programs of all kinds of layers together exceed what a process may map.
            jax.clear_caches()
            layers = finger.layers
        photos = [
            photograph(finger.tables, finger.errors, pose_of(angles), capture, number, folder)
            for number, (angles, capture) in enumerate(
                zip(finger.poses, finger.captures, strict=True)
            )
        ]
        found.add(finger, photos, context.seed)
    out = Report(spec, package=__package__)
    add_metrics(out, found)
    add_findings(out, found)
    add_tables(out, found)
    add_figures(out, found)
    return out.results()


class Findings:
    """What perception makes of pictures, beside their truth.

    Attributes:
        views: every view that is asked for and shown, and how it was found.
        corners: of the complete ones, with their errors.
        angles: joint angles of the frames without labels, by both models, with their errors.
        frames: what they were.
        shown: one picture of every kind, with what was found in it.
    """

    def __init__(self, spec: ImageCheckSpec) -> None:
        self.views, self.corners, self.angles = Records(), Records(), Records()
        self.frames = Records()
        self.shown: dict[tuple[str, str], tuple[Photograph, Sighting]] = {}
        self._spec, self._label = spec, math.radians(spec.label_deviation_deg)
        self._sensors: dict[tuple[str, bool, bool], FingerSensor] = {}

    def sensor(self, layers: str, light: str, *, air: bool = False) -> FingerSensor:
        """The finger with such layers as designed; or as the model in air and section has it."""
        lamps = has_lamps(layers, light)
        if (layers, lamps, air) not in self._sensors:
            tables = designed(layers, light)
            scene = without_layers(tables) if air else parse_scene(tables, "finger")
            deviations = deviations_of(self._spec.tolerances, scene)
            if air:
                deviations = in_section(deviations)
            self._sensors[layers, lamps, air] = FingerSensor.of_scene(scene, WIDTH, deviations)
        return self._sensors[layers, lamps, air]

    def add(self, finger: Finger, photos: Sequence[Photograph], seed: int) -> None:
        """Find views and joint angles in the pictures of one finger."""
        angles = np.deg2rad(finger.poses)
        gamma = finger.captures[0].gamma
        where = {"finger": finger.number, "light": finger.light, "layers": finger.layers}
        where["lens"] = DESIGNED if finger.lens is None else CALIBRATED
        noise = np.random.default_rng([seed, finger.number, 1]).standard_normal(angles.shape)
        labels = (angles + self._label * noise)[: self._spec.labelled]
        if finger.lens is None:
            sensor = self.sensor(finger.layers, finger.light).with_response(gamma)
        else:
            scene = parse_scene(designed(finger.layers, finger.light), "finger")
            lens = calibrate_own(finger.lens, [seed, finger.number])
            sensor = finger_sensor(scene, lens, WIDTH, self._spec.tolerances, gamma)
        start = time.perf_counter()
        sightings = [sensor.detect(photo.pixels) for photo in photos]
        seconds = (time.perf_counter() - start) / len(photos)
        unit = in_deviations(finger.errors, sensor.deviations)
        self._add_views(where, finger, sensor, photos, sightings, unit, seconds)
        self._add_angles(where | {"model": MODELS[0]}, sensor, sightings, angles, labels, unit)
        if finger.light == EVEN and finger.layers != "none" and finger.lens is None:
            # The model in air gets what was found with the layers: by itself it would find little.
            air = self.sensor(finger.layers, finger.light, air=True)
            self._add_angles(where | {"model": MODELS[1]}, air, sightings, angles, labels, None)

    def _add_views(
        self,
        where: dict[str, Any],
        finger: Finger,
        sensor: FingerSensor,
        photos: Sequence[Photograph],
        sightings: Sequence[Sighting],
        unit: Float[np.ndarray, " errors"],
        seconds: float,
    ) -> None:
        self.shown.setdefault((finger.light, finger.layers), (photos[-1], sightings[-1]))
        assert isinstance(sensor.model.predict, Predictor)
        predictions = [
            eqx.filter_jit(dataclasses.replace(sensor.model.predict, channel=channel))
            for channel in range(len(CHANNELS))
        ]
        for number, (photo, sighting) in enumerate(zip(photos, sightings, strict=True)):
            pressed = bool(finger.captures[number].contacts)
            own = where | {"frame": number, "pressed": pressed}
            self.frames.add(**own, seconds=seconds)
            given = jnp.asarray(unit), jnp.deg2rad(finger.poses[number])
            by_view = np.stack([predict(*given) for predict in predictions], axis=1)
            for (pad, path), colors in zip(sensor.model.views, by_view, strict=True):
                shown = next(
                    (s for s in photo.shown if (s.pad, s.path) == (pad, path.partition(":")[2])),
                    None,
                )
                view = sighting.view(pad, path)
                complete = view is not None and view.quality is Quality.COMPLETE
                of_view = own | {"pad": pad, "path": path}
                # What a design does not count as seen, as it is too flat, need not be found.
                flat = math.sin(sensor.catalog.grazing[pad])
                whole = shown is not None and shown.whole and shown.grazing >= flat
                quality = view.quality.name.lower() if view is not None else "none"
                false = complete and shown is None
                self.views.add(
                    **of_view, whole=whole, complete=complete, false=false, quality=quality
                )
                if not complete or shown is None:
                    continue
                order = [ENDS[corner] for corner in CORNERS]
                theirs = np.array(shown.channels)[:, order]
                # Elsewhere the outline is not that of the flat membrane's corner: clear walls
                # mirror the membrane, black ones hide it, and things pressed in lift it.
                bare = np.array(shown.seen)[order] & (np.array(shown.lifted)[order] < FLAT)
                bare &= "polished" not in finger.layers
                assert view is not None
                away = np.hypot(*np.moveaxis(colors - theirs, -1, 0)).max(axis=0)
                off = view.corners - np.where(bare[:, None], theirs[GREEN], colors[GREEN])
                spread = np.linalg.inv(view.covariance + (FLOOR_PX**2 + CONSTANT**2) * np.eye(2))
                self.corners.add(
                    **of_view,
                    error_px=np.hypot(*off.T),
                    deviations=np.sqrt(np.einsum("ci,cij,cj->c", off, spread, off)),
                    stated=[view.ends[end] for end, _ in CORNERS],
                    judged=bare,
                    model_px=np.where(bare, away, np.nan),
                )

    def _add_angles(
        self,
        where: dict[str, Any],
        sensor: FingerSensor,
        sightings: Sequence[Sighting],
        angles: Float[np.ndarray, "frames joints"],
        labels: Float[np.ndarray, "labelled joints"],
        unit: Float[np.ndarray, " errors"] | None,
    ) -> None:
        model, count = sensor.model, len(labels)
        seen = [observe(one, model.views, FLOOR_PX) for one in sightings]
        labelled = stack_observations(seen[:count])
        calibration = calibrate(model, labelled, labels, self._label)
        for number in range(count, len(seen)):
            pair = seen[number], sightings[number].angles
            found = find_pose(model, *pair, calibration.value.errors)
            ok, reasons = np.asarray(found.ok) & bool(calibration.ok), found.messages()
            if not calibration.ok:
                reasons = [reason or calibration.messages()[0] for reason in reasons]
            if unit is None:
                # The answer of the model of before, whatever it warns of.
                ok = np.array([reason != NOT_SEEN for reason in reasons])
            answers = (
                np.where(ok, one, np.nan)
                for one in map(np.asarray, (found.value.angles, found.value.deviations))
            )
            estimated, predicted = map(np.rad2deg, answers)
            bound = np.full(angles.shape[1], np.nan)
            if unit is not None:
                frame, frames = (seen[number], angles[number]), (labelled, angles[:count])
                bound = compute_information_bound(
                    model, unit, frame, frames, self._label
                ).calibrated
            self.angles.add(
                **where,
                frame=number,
                joint=list(model.names),
                angle_deg=np.rad2deg(angles[number]),
                error_deg=estimated - np.rad2deg(angles[number]),
                deviation_deg=predicted,
                bound_deg=np.rad2deg(bound),
                reason=reasons,
                flagged=~(np.asarray(found.ok) & bool(calibration.ok)),
            )


def has_lamps(layers: str, light: str) -> bool:
    """Whether lamps are parts that hide something: beside layers, or coupled to them, none is."""
    return light != EVEN and layers == "none"


def designed(layers: str, light: str) -> dict[str, Any]:
    """Tables of the finger as it was designed."""
    return with_lamps(nominal(layers)) if has_lamps(layers, light) else nominal(layers)


def calibrate_own(lens: WideLens, seed: list[int]) -> CalibratedLens:
    """A lens as the pictures of a board have it that the judge has taken with it."""
    generator, board, seen = np.random.default_rng([*seed, 2]), Board(), []
    made = boards.Board(
        "charuco", board.columns, board.rows, board.square, board.marker_side, DICTIONARY
    )
    for number in range(BOARDS):
        pose = boards.random_pose(generator, lens, made)
        conditions = boards.random_conditions(generator)
        taken = boards.photograph_board(lens, made, pose, conditions, number)
        seen.append(detect_board(taken.pixels, board))
    return calibrate_lens(sightings_of(board, seen), lens.size).calibrated


def ratio_of_variances(angles: Records) -> float:
    """Mean predicted variance over mean squared error."""
    return (angles.stat("rms deviation_deg") / angles.stat("rms error_deg")) ** 2


def add_metrics(out: Report, found: Findings) -> None:
    """The study's numbers."""
    frames, views, corners = found.frames, found.views, found.corners
    lit = frames["light"] != EVEN
    out.metrics(
        frames=len(frames),
        frames_with_lamps=int(lit.sum()),
        frames_pressed=int(frames["pressed"].sum()),
    )
    whole = views.where(whole=True)
    out.metrics(views=len(whole), views_found=whole.stat("share complete"))
    out.metrics(views_false=int(views["false"].sum()))
    out.metrics(model_worst_px=corners.stat("max model_px"))
    out.metrics(corners=len(corners), corners_judged=corners.stat("share judged"))
    judged = corners.where(judged=True)
    both = {"even": judged.where(light=EVEN), "lamps": judged.where(light=[GAP, COUPLED])}
    for light, own in both.items():
        if len(own):
            out.metrics(
                **{
                    f"corner_median_{light}_px": own.stat("median error_px"),
                    f"corner_p95_{light}_px": own.stat("p95 error_px"),
                }
            )
    sure = (corners["deviations"] > SURE) & (corners["error_px"] > FAR_PX) & corners["stated"]
    out.metrics(corners_wrong=int(sure.sum()))
    ours = defined(found.angles.where(model=MODELS[0]))
    out.metrics(angles=len(ours))
    out.metrics(angles_defined=found.angles.where(model=MODELS[0]).stat("defined error_deg"))
    own = ours.where(lens=CALIBRATED)
    if len(own):
        out.metrics(
            corner_median_calibrated_px=judged.where(lens=CALIBRATED).stat("median error_px"),
            angle_mean_calibrated_deg=own.stat("mean_abs error_deg"),
            angle_p95_calibrated_deg=own.stat("p95_abs error_deg"),
        )
    for light, own in ours.where(lens=DESIGNED).group("light").items():
        name = {EVEN: "even", GAP: "gap", COUPLED: "coupled"}[str(light)]
        over = own.stat("rms error_deg") / own.stat("rms bound_deg")
        out.metrics(
            **{
                f"angle_mean_{name}_deg": own.stat("mean_abs error_deg"),
                f"over_bound_{name}": over,
                f"variance_{name}": ratio_of_variances(own),
            }
        )
    if len(ours):
        out.metrics(variance=ratio_of_variances(ours))
    wrong = np.abs(ours["error_deg"]) > SURE * ours["deviation_deg"]
    out.metrics(angles_wrong=int(wrong.sum()))
    air = found.angles.where(model=MODELS[1])
    if len(air):
        out.metrics(
            air_mean_deg=air.stat("mean_abs error_deg"),
            air_flagged=air.stat("share flagged"),
        )
    out.metrics(detection_ms=1e3 * frames.stat("median seconds"))


def defined(angles: Records) -> Records:
    """The rows with an answer."""
    return angles.where(np.isfinite(angles["error_deg"]))


def add_findings(out: Report, found: Findings) -> None:
    """Plain sentences, most important first."""
    out.say("views")
    if len(found.corners.where(light=EVEN)):
        out.say("corners")
    if len(defined(found.angles.where(model=MODELS[0], light=EVEN, lens=DESIGNED))):
        out.say("angles")
    if len(defined(found.angles.where(model=MODELS[0], lens=CALIBRATED))):
        out.say("calibrated")
    if len(found.angles.where(model=MODELS[1])):
        out.say("air")
    out.say("model")


def add_tables(out: Report, found: Findings) -> None:
    """Views, corners and angles by light and layers, and what was not found."""
    by = ("lens", "light", "layers")
    whole = found.views.where(whole=True)
    out.table("views", whole.summary(*by, views="count complete", found="share complete"))
    errors = {"median_px": "median error_px", "p95_px": "p95 error_px", "worst_px": "max error_px"}
    count = {"corners": "count error_px"}
    out.table("corners", found.corners.summary(*by, "pressed", "judged", **count, **errors))
    angles = {"frames": "count error_deg", "defined": "defined error_deg"}
    angles |= {"mean_deg": "mean_abs error_deg", "p95_deg": "p95_abs error_deg"}
    angles |= {"rms_deg": "rms error_deg", "predicted_deg": "rms deviation_deg"}
    rows = defined(found.angles)
    out.table("angles", rows.summary("model", *by, **angles, bound_deg="rms bound_deg"))
    missed = whole.where(complete=False)
    if len(missed):
        out.table("missed", missed)


def add_figures(out: Report, found: Findings) -> None:
    """Pictures with what was found in them, distributions of errors, predicted deviations."""
    out.figure("pictures", draw_pictures(found))
    names = {"error_px": "error of a corner (px)"}
    drawn = found.corners.where(judged=True)
    out.figure("corners", plots.ecdf(drawn, "error_px", by="light", log="x", names=names))
    names = {"error_deg": "absolute error (°)"}
    rows = defined(found.angles)
    out.figure(
        "angles", plots.ecdf(rows, "error_deg", by="model", log="x", least=1e-3, names=names)
    )
    ours = rows.where(model=MODELS[0])
    out.figure("deviations", plots.qq(ours, "error_deg", "deviation_deg", by="light"))


def draw_pictures(found: Findings) -> Figure:
    """A frame of every light, and the corners of the views that were found complete."""
    chosen = {light: (layers, *shot) for (light, layers), shot in found.shown.items()}
    drawing, [row] = new_figure(1, len(chosen), height=3.0)
    for axes, (light, (layers, photo, sighting)) in zip(row, chosen.items(), strict=True):
        axes.imshow(photo.pixels)
        axes.set_axis_off()
        axes.set_title(f"{light}\nlayers: {layers}")
        for view in sighting.complete():
            axes.plot(*view.corners.T, "o", color="white", fillstyle="none", markersize=4)
        axes.set(xlim=(300, 1140), ylim=(1080, 0))
    return drawing
