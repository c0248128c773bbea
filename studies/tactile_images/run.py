"""The study itself: from its spec to its results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from designopt import BenchmarkMethod, Context, PrecisionRow, Records, Report, Results, benchmark
from designopt.plot.typesetting import spell_out
from designopt.study import plots
from optics.rendering import Effects, Renderer, TactileImage, TrueView
from optics.rendering.effects import SOFT
from perception.detection import detect_quads
from perception.lens import Lens
from perception.matching import Sighting
from perception.paper_route import PaperRoute
from perception.quality import Quality
from perception.unwarping import PER_MM, least_scale, map_to_image, map_to_pad, map_to_pad_affinely
from studies.models.one_thread import one_thread
from studies.models.sensor.estimators import lens_of
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.sizes import compare_at_sizes
from studies.tactile_images import TactileImagesSpec, figures
from studies.tactile_images.corrupted import ANSWERS, analyze_corrupted, is_wrong

OURS, PAPER = "lines in ray space", "paper's polygon"
"""Both ways to corners."""

CORNERS = {
    "found": "defined error_px",
    "corner_median_px": "median error_px",
    "corner_p90_px": "p90 error_px",
    "paper_found": "defined paper_error_px",
    "paper_corner_median_px": "median paper_error_px",
    "paper_corner_p90_px": "p90 paper_error_px",
}
"""Statistics of corners."""

FAR = 20.0
"""A view whose corner is off by more pixels (of 1080 rows) has not been found."""

LATTICE = 9
"""Places along and across a pad at which unwarping is checked."""

REPEATS = 5
"""Frames whose rendering is timed."""

AT_SIZE = """{size}: {ours.error:.2f} px in {ours_ms:.0f} ms a frame, the paper's route
{other.error:.2f} px in {other_ms:.0f} ms."""


def run(spec: TactileImagesSpec, context: Context) -> Results:
    """Render fingers with sampled errors, find and unwarp their pads, compare with the truth.

    Raises:
        UserError: the scene cannot be read, or another float type than float64.
    """
    context.require_float64("tactile-images predicts corners to a thousandth of a pixel")
    out, seed = Report(spec, package=__package__), context.seed
    with context.step("The finger and its views"):
        finger = FingerSensor.of(spec)
    steps = np.deg2rad(np.linspace(0, spec.range_deg, spec.grid))
    joints = len(finger.model.names)
    angles = np.stack(np.meshgrid(*[steps] * joints, indexing="ij"), axis=-1).reshape(-1, joints)
    measured, independent = Measured(), Measured()
    conditions = [(gain, spec.severity, i) for gain in spec.gains for i in range(spec.fingers)]
    conditions += [(1.0, severity, 0) for severity in spec.severities if severity != spec.severity]
    for gain, severity, number in context.each(
        conditions, lambda one: f"Finger {one[2] + 1}, gain {one[0]:g}, severity {one[1]:g}"
    ):
        renderer = finger.made_renderer(Effects.graded(severity, gain), seed, number)
        measured.measure(finger, renderer, angles, gain=gain, severity=severity)
    with context.step("Effects of independent severities"):
        generator = np.random.default_rng([seed, 7])
        for number in range(spec.independent):
            effects = independent_effects(generator)
            pose = np.deg2rad(generator.uniform(0, spec.range_deg, angles[:1].shape))
            renderer = finger.made_renderer(effects, seed, number)
            independent.measure(finger, renderer, pose, gain=effects.gain, severity=np.nan)
    trials = Records()
    if spec.corrupted:
        with context.step("Corrupted frames"):
            trials = analyze_corrupted(spec, angles, seed)
    rows: list[PrecisionRow] = []
    for size in context.each(spec.sizes, lambda size: f"Images {size} px high"):
        rows += measure_size(spec, size, seed)
    claim = out.claim("lines", *compare_at_sizes(rows, OURS, PAPER, AT_SIZE))
    error = "median corner error (px of 1080 rows)"
    out.precision(rows, error, "the corners of the rendered pads' sharp rectangles", claim)
    with context.step("Rendering, effect by effect"):
        times = time_effects(finger, spec.severity, seed)
    usual = measured.where(severity=spec.severity)
    add_metrics(out, finger, usual, independent, trials)
    out.metrics(render_ms=times["milliseconds"][-1], render_plain_ms=times["milliseconds"][0])
    add_findings(out, measured, usual, independent, trials)
    add_tables(out, measured, trials, times)
    with context.step("Pictures"):
        add_figures(out, finger, measured, usual, seed)
    return out.results()


class Measured:
    """What frames have shown; all rows begin with their exposure and severity.

    Attributes:
        frames: views called complete that are not (wrong), pads that some view shows whole (shown),
            and the seconds of finding all views.
        corners: of the views that can be found: errors by lines in ray space, and by the paper's
            route; NaN where it did not find the view.
        places: of pads unwarped in their best view: errors by rays and a homography, and by an
            affine map; least scale of the view, and of the one with the largest area, px/mm.
    """

    def __init__(self) -> None:
        corners = ("pad", "path", "error_px", "paper_error_px")
        places = ("pad", "by_mirror", "place", "error_mm", "affine_error_mm", "scale", "area_scale")
        self.frames, self.corners, self.places = (
            Records({name: [] for name in ("gain", "severity", *names)})
            for names in (("wrong", "shown", "seconds"), corners, places)
        )

    def where(self, **values: float) -> Measured:
        """The same of the frames of one condition."""
        chosen = Measured()
        for name, records in vars(self).items():
            setattr(chosen, name, records.where(**values))
        return chosen

    def measure(
        self, finger: FingerSensor, renderer: Renderer, poses: np.ndarray, **condition: float
    ) -> None:
        """Render frames, each pad touched by something, and add their rows.

        Args:
            finger: as designed.
            renderer: of the finger with its errors.
            poses: joint angles of the frames, rad, shape (frames, joints).
            condition: gain and severity.
        """
        press, lens = partial(figures.touch, finger), lens_of(renderer.imaging)
        for image, sighting, seconds in finger.film(renderer, poses, press):
            whole = [(v.pad, v.path) for v in image.views if v.complete and not v.at_border]
            wrong = sum((view.pad, view.path) not in whole for view in sighting.complete())
            shown = len({pad for pad, path in whole if (pad, path) in finger.model.views})
            self.frames.add(**condition, wrong=wrong, shown=shown, seconds=seconds)
            far, polygons = FAR * len(image.pixels) / 1080, PaperRoute().corners(image.pixels)
            for view in views_to_find(finger, image):
                name = {"pad": view.pad, "path": view.path}
                found, ours = sighting.view(**name), np.full(4, np.nan)
                if found is not None and found.quality is Quality.COMPLETE:
                    errors = np.hypot(*(found.corners - view.corners).T)
                    ours = np.where(np.all(errors <= far), errors, np.nan)
                paper = nearest_errors(polygons, view.corners, far)
                self.corners.add(**condition, **name, error_px=ours, paper_error_px=paper)
            for pad in finger.catalog.lengths:
                if places := unwarp_places(finger, lens, image, sighting, pad):
                    self.places.add(**condition, pad=pad, **places)


def unwarp_places(
    finger: FingerSensor, lens: Lens, image: TactileImage, sighting: Sighting, pad: str
) -> dict[str, Any]:
    """Columns of places on a pad that is unwarped in its best view; none if there is no such view.

    Args:
        finger: as designed.
        lens: of the camera that took the image, with its errors.
        image: the truth.
        sighting: what was found.
        pad: name of the pad.
    """
    size = finger.catalog.lengths[pad], finger.width
    best, largest = finger.best_view(sighting, pad), finger.best_view(sighting, pad, "area")
    true = image.view(pad, best.path) if best is not None else None
    if best is None or largest is None or true is None:
        return {}
    steps = np.stack(np.meshgrid(*[np.linspace(0, 1, LATTICE)] * 2, indexing="ij"), axis=-1)
    places = steps.reshape(-1, 2) * size - np.array([0, finger.width / 2])
    exact = replace(best, corners=true.corners, rays=lens.rays(true.corners))
    seen = map_to_image(exact, lens, places, *size)
    return {
        "place": np.arange(len(places)),
        "by_mirror": best.path != "direct",
        "error_mm": np.hypot(*(map_to_pad(best, finger.lens, seen, *size) - places).T),
        "affine_error_mm": np.hypot(*(map_to_pad_affinely(best, seen, *size) - places).T),
        "scale": least_scale(best, finger.lens, *size),
        "area_scale": least_scale(largest, finger.lens, *size),
    }


def independent_effects(generator: np.random.Generator) -> Effects:
    """Effects of soft light, their severities independent, each of them off in one case of five.

    So the dark inside of a finger meets blur, noise and compression of every size.
    """
    severities = np.maximum(generator.uniform(-0.5, 2.0, len(SOFT)), 0.0).tolist()
    gain = float(generator.uniform(0.6, 1.5))
    return Effects.of(dict(zip(SOFT, severities, strict=True)), gain)


def views_to_find(finger: FingerSensor, image: TactileImage) -> list[TrueView]:
    """The views that are asked for, complete and off the border."""
    asked = (view for view in image.views if (view.pad, view.path) in finger.model.views)
    return [view for view in asked if view.complete and not view.at_border]


def nearest_errors(
    quads: Sequence[Float[np.ndarray, "4 2"]], corners: Float[np.ndarray, "4 2"], far: float
) -> Float[np.ndarray, "4"]:
    """Errors of the quadrilateral that is nearest to given corners, in whatever order it has them.

    NaN if a corner of the nearest is far off. This is more than the paper's route gives, which
    does not identify the views.
    """
    orders = [np.roll(way, turn) for way in ([0, 1, 2, 3], [3, 2, 1, 0]) for turn in range(4)]
    errors = [np.hypot(*(quad[order] - corners).T) for quad in quads for order in orders]
    near = [one for one in errors if one.max() <= far]
    return min(near, key=np.sum, default=np.full(4, np.nan))


def measure_size(spec: TactileImagesSpec, size: int, seed: int) -> list[PrecisionRow]:
    """Error and run time of both ways to corners over images of one size."""
    finger = FingerSensor.of(spec, size)
    renderer = finger.made_renderer(Effects.graded(spec.severity), seed)
    shape = spec.size_frames, len(finger.model.names)
    poses = np.deg2rad(np.random.default_rng([seed, 6]).uniform(0, spec.range_deg, shape))
    images = [renderer.render(pose, frame=frame) for frame, pose in enumerate(poses)]
    route = PaperRoute(block=round(PaperRoute.block * size / 1080) | 1)

    def error(found: list[list[np.ndarray]]) -> float:
        off, far = Records({"px": []}), FAR * size / 1080
        for quads, image in zip(found, images, strict=True):
            for view in views_to_find(finger, image):
                off.add(px=nearest_errors(quads, view.corners, far))
        return off.stat("median px") * 1080 / size

    at, part = (finger.image_size, "all views of a frame"), 1 / len(images)
    calls = {
        OURS: lambda: [[q.corners for q in detect_quads(i.pixels, finger.lens)] for i in images],
        PAPER: lambda: [route.corners(image.pixels) for image in images],
    }
    methods = [BenchmarkMethod(name, *at, calls[name], error, scale=part) for name in calls]
    with one_thread():
        return benchmark(methods, repeats=3)


def time_effects(finger: FingerSensor, severity: float, seed: int) -> Records:
    """Run times of rendering on one core without any effect, with each alone, and with all."""
    names, times = [field.name for field in fields(Effects)], Records()
    sizes = dict.fromkeys(set(names) - {"gain", "gamma"}, severity or 1.0)
    every = Effects.of(sizes, gain=1.2, gamma=2.2)
    alone = {name: replace(Effects(), **{name: getattr(every, name)}) for name in names}
    for name, effects in {"none": Effects(), **alone, "all": every}.items():
        pose = np.full(len(finger.model.names), np.pi / 4)
        render = partial(finger.made_renderer(effects, seed).render, pose)
        [row] = benchmark([BenchmarkMethod(name, "", "", render, lambda _: 0.0)], repeats=REPEATS)
        times.add(effect=spell_out(name), milliseconds=1e3 * row.seconds)
    return times | {"more_than_none_ms": times["milliseconds"] - times["milliseconds"][0]}


def add_metrics(
    out: Report, finger: FingerSensor, usual: Measured, independent: Measured, trials: Records
) -> None:
    """The numbers of views and pads, at all exposures of the stated severity."""
    pads, shown = usual.places.where(place=0), int(usual.frames.stat("sum shown"))
    for gain in out["gains"]:
        own = usual.corners.where(gain=gain)
        found, views = own.stat("defined error_px"), len(own) // 4
        out.metric(f"found_at_gain_{gain:g}", found, "found_at_gain", gain=gain, views=views)
    if out["independent"]:
        own = independent.corners
        out.metric("found_independent", own.stat("defined error_px"), views=len(own) // 4)
    out.metrics(**{name: usual.corners.stat(CORNERS[name]) for name in list(CORNERS)[1:]})
    for way in ("", "affine_"):
        out.metric(f"{way}unwarp_p90_mm", usual.places.stat(f"p90 {way}error_mm"))
    for way in ("", "area_"):
        out.metric(f"{way}view_scale_p10", pads.stat(f"p10 {way}scale"))
    detection = 1e3 * usual.frames.stat("median seconds")
    out.metric("detection_ms", detection, image_size=finger.image_size)
    if len(trials):
        out.metrics(corrupted_failures=int(is_wrong(trials).sum()))
    out.metric("unwarped", len(pads) / max(shown, 1), shown=shown)


def add_findings(
    out: Report, measured: Measured, usual: Measured, independent: Measured, trials: Records
) -> None:
    """Plain sentences, most important first."""
    found = {f"gain {gain:g}": out[f"found_at_gain_{gain:g}"] for gain in out["gains"]}
    out.say("found", views=len(usual.corners) // 4, parts=_listed(found))
    out.say("paper")
    if len(usual.places):
        mean, affine = (usual.places.stat(f"mean {kind}error_mm") for kind in ("", "affine_"))
        out.say("unwarping", mean_mm=mean, affine_mm=affine)
    found = {
        f"severity {s:g}": measured.where(gain=1.0, severity=s).corners.stat("defined error_px")
        for s in sorted(set(out["severities"]) - {out["severity"]})
    }
    if found:
        out.say("severities", parts=_listed(found))
    if out["independent"]:
        wrong = independent.frames.stat("sum wrong")
        out.say("independent", views=len(independent.corners) // 4, wrong=wrong)
    complete = np.isfinite(usual.corners["error_px"]).sum() // 4
    out.say("wrong", wrong=usual.frames.stat("sum wrong"), complete=complete)
    if len(trials):
        sums = {name: trials.stat(f"sum {name}") for name in ("exceptions", "refused")}
        out.say("corrupted", kinds=len(trials.group("kind")), **sums)


def _listed(found: Mapping[str, float]) -> str:
    return ", ".join(f"{100 * share:.1f} % at {where}" for where, share in found.items())


def add_tables(out: Report, measured: Measured, trials: Records, times: Records) -> None:
    """Views by condition and by kind, unwarping, rendering, and corrupted frames."""

    def count(own: Records) -> dict[str, float]:
        return {"views": len(own) // 4} | {key: own.stat(what) for key, what in CORNERS.items()}

    conditions, views = Records(), Records()
    for gain, severity in sorted(measured.frames.group("gain", "severity")):
        own = measured.where(gain=gain, severity=severity)
        row = {"gain": gain, "severity": severity, "frames": len(own.frames), **count(own.corners)}
        conditions.add(**row, wrongly_complete=int(own.frames["wrong"].sum()))
    for pad, path in sorted(measured.corners.group("pad", "path")):
        views.add(pad=pad, path=path, **count(measured.corners.where(pad=pad, path=path)))
    out.table("conditions", conditions)
    out.table("views", views)
    ways = [(way, what) for way in ("", "affine_") for what in ("mean", "p90")]
    errors = {f"{way}{what}_mm": f"{what} {way}error_mm" for way, what in ways}
    pads = {"pads": lambda own: len(own.where(place=0)), "by_mirror": "share by_mirror"}
    out.table("unwarping", measured.places.summary("pad", **pads, **errors))
    out.table("rendering", times)
    if len(trials):
        sums = {name: lambda own, name=name: int(own[name].sum()) for name in ANSWERS}
        corrupted = trials.summary("kind", "expected", frames="count refused", **sums)
        out.table("corrupted", corrupted)


def add_figures(
    out: Report, finger: FingerSensor, measured: Measured, usual: Measured, seed: int
) -> None:
    """Pictures of the first finger, distributions of errors, views found by condition."""
    renderer = finger.made_renderer(Effects.graded(out["severity"]), seed)
    shots = figures.take_shots(finger, renderer, out["range_deg"])
    joints = " / ".join(name.upper() for name in finger.model.names)
    out.figure("views", figures.draw_views(finger, shots), joints=joints)
    out.figure("masks", figures.draw_masks(shots, OURS, PAPER))
    touches = figures.unwarp_touches(finger, renderer, out["range_deg"])
    out.figure("imprints", figures.draw_imprints(finger, touches), per_mm=PER_MM)
    distances, found = Records(), Records()
    corners, places, panel = usual.corners, usual.places, "corner error (px)"
    distances.add(panel=panel, method=OURS, distance=corners["error_px"])
    distances.add(panel=panel, method=PAPER, distance=corners["paper_error_px"])
    panel = "place on the pad off by (mm)"
    distances.add(panel=panel, method="rays and homography", distance=places["error_mm"])
    distances.add(panel=panel, method="affine map (paper)", distance=places["affine_error_mm"])
    drawing = plots.ecdf(distances, "distance", by="method", panel="panel", height=3.0)
    for axes in drawing.axes:
        axes.set(xlabel=axes.get_title(), title="", xscale="log")
    out.figure("errors", drawing, most=4)
    for severity, gain in sorted(measured.corners.group("severity", "gain")):
        own = measured.corners.where(severity=severity, gain=gain)
        shares = [100 * own.stat(f"defined {column}") for column in ("error_px", "paper_error_px")]
        condition, both = f"severity {severity:g}\ngain {gain:g}", [OURS, "paper's route"]
        found.add(condition=condition, method=both, complete_views_found_percent=shares)
    style = {"marks": {"target at severity 1": 95.0}, "height": 2.8}
    column = "complete_views_found_percent"
    out.figure("success", plots.bars(found, "condition", column, by="method", **style))
