"""The study itself: from its spec to its results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from designopt import Context, Records, Report, Results
from designopt.plot.figures import MARKERS, PALETTE, new_figure
from designopt.study import plots
from optics.chamber import bend_center_line
from perception import chamber
from perception.chamber import ChamberMap, Heights, SurfaceKind, compute_movements
from perception.chamber.heights import TRACKED
from perception.chamber.points import NAMES
from perception.chamber.surfaces import CURVED, CURVED_OVER_ROUGH, ROUGH
from studies.models.one_thread import median_seconds, one_thread
from studies.models.soft_finger import robustness
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.robustness import Answer, Disturbance, Picture
from studies.models.words import many
from studies.surface_profile import SurfaceProfileSpec
from studies.surface_profile.sensor import UP, designed_map, highest, postures_on
from studies.surface_profile.slides import Slide, SlidingTest, look
from studies.surface_profile.surfaces import KINDS

WAYS = {"": "b, e and g", "e_": "e", "whole_": "e, whole pixels"}
"""Points that heights are from, by the beginning of their columns; the last are the paper's."""

AS_CALIBRATED = ("whole_median_mm", "whole_p90_mm", "full_p90_mm", "pad_p90_mm", "bare_p90_mm")
"""Metrics that are columns of the table of calibrations, too."""

SIZES = {
    "sagitta": ("curved", CURVED, ["convex", "concave"]),
    "roughness": ("rough", ROUGH, ["rough"]),
}
"""What surfaces with enough of it are called, from which limit on, mm, and kinds that have it."""

BENDS_DEG = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 15.0, 20.0, 30.0, 60.0, 70.0, 80.0, 90.0, 110.0, 120.0)
"""The map ends between 17° and 18°; yellow leaves the view between 70° and 80°."""

BEND_FRAMES = 4
"""At every bend, where frames differ."""

WITHIN = 0.5
"""A height that is farther off is wrong, mm; three times the scatter by b and g alone. Nearer to
an end of the map than that, heights need not be known, nor unknown."""

TIMED = 3
"""How often the points of a picture are found, for the time it takes."""

LEAST_RANGE = 1.0
"""Of heights that are shown, mm."""

BRIGHTER = 1.6
"""Brightness of shown pictures."""


def run(spec: SurfaceProfileSpec, context: Context) -> Results:
    """Calibrate fingers, slide them along surfaces, compare profiles and kinds with the true ones.

    Raises:
        UserError: no map follows from the settings, or another float type than float64.
    """
    context.require_float64("surface-profile predicts points to a thousandth of a pixel")
    seed, out = context.seed, Report(spec, package=__package__)
    with context.step("The map that the design predicts"):
        test = SlidingTest(spec, seed, designed_map(SoftFinger.of(spec), spec))
        slides = [Slide.sample(spec, number, seed) for number in range(len(KINDS) * spec.trials)]
    counts = list(dict.fromkeys([spec.calibration, *spec.calibrations]))
    fingers = range(min(spec.fingers, spec.trials))
    for finger in context.each(fingers, lambda finger: f"Slides of finger {finger + 1}"):
        own = [slide for slide in slides if slide.number // len(KINDS) % spec.fingers == finger]
        test.slide(finger, own, spec.severity, counts)
    frames = sort_rows(summarize_heights(test.heights, "frames"), "frames")
    with context.step(f"{len(spec.severities)} other severities"):
        severities = measure_severities(test, slides[: len(KINDS) * spec.severity_trials])
    with context.step(f"{len(spec.sagittas) + len(spec.roughnesses)} sizes through the limits"):
        sizes = measure_sizes(SlidingTest(spec, seed, test.design))
    add_numbers(out, test, frames, sizes)
    add_tables(out, test, frames)
    out.table("severities", severities)
    if len(sizes):
        out.table("sizes", sizes)
    with context.step("Frames that are no proper images, and bends up to 120°"):
        disturbed, bends = answer_disturbances(test, seed + 1), measure_bends(test, seed + 2)
    add_robustness(out, test, disturbed, bends)
    out.figure("profiles", draw_profiles(test, slides))
    with context.step("Pictures, and the time that a frame takes"):
        drawing, seconds = draw_pictures(test, slides)
    out.figure("pictures", drawing)
    out.metrics(perception_ms=1e3 * seconds)
    out.figure("kinds", draw_kinds(test.shapes), most=5)
    out.figure("errors", draw_errors(test, frames, severities), most=5)
    if len(sizes):
        out.figure("limits", draw_limits(sizes), most=4)
    return out.results()


def measure_severities(test: SlidingTest, slides: Sequence[Slide]) -> Records:
    """A row for every severity, the stated one by all fingers, others by the first one."""
    spec = test.spec
    heights = test.heights.where(frames=spec.calibration)
    test = replace(test, heights=heights, shapes=Records(test.shapes), fingers=Records())
    for severity in (one for one in spec.severities if one != spec.severity):
        test.slide(0, slides, severity, [spec.calibration])
    told = test.shapes.summary("severity", told_apart="share told")["told_apart"]
    return sort_rows(summarize_heights(heights, "severity") | {"told_apart": told}, "severity")


def measure_sizes(test: SlidingTest) -> Records:
    """A row for every size of surfaces through a limit, rising."""
    spec, fingers = test.spec, min(test.spec.fingers, test.spec.trials)
    sizes = {"sagitta": spec.sagittas, "roughness": spec.roughnesses}
    slides = [
        Slide.sample(spec, number, test.seed, kinds[number % len(kinds)], size)
        for quantity, (_, _, kinds) in SIZES.items()
        for size in sorted(sizes[quantity])
        for number in range(spec.size_slides)
    ]
    for finger in range(fingers):
        # Pairs of kinds share the fingers.
        if own := [slide for slide in slides if slide.number // 2 % fingers == finger]:
            test.slide(finger, own, spec.severity, [spec.calibration])
    rows = Records()
    for quantity, (_, limit, kinds) in SIZES.items() if slides else ():
        own = test.shapes.where(surface=kinds) | {"quantity": quantity, "limit_mm": limit}
        told = {f"{way}told": f"share {way}told" for way in ("", "whole_", "exact_")}
        told |= {"slides": "count told", "found_mm": f"median_abs {quantity}_mm"}
        rows.add(**own.summary("quantity", "limit_mm", "size_mm", **told))
    return rows


def find_limits(sizes: Records, told: str) -> tuple[float, float]:
    """From which size on surfaces are called what they are.

    Args:
        sizes: a row for every size, rising.
        told: column with the part that is called so.

    Returns:
        The largest size up to which none is, and the least from which on all are; NaN if some of
        the least size are, or not all of the largest.
    """
    size, part = sizes["size_mm"], sizes[told]
    none = size[np.logical_and.accumulate(part == 0)]
    every = size[np.logical_and.accumulate((part == 1)[::-1])[::-1]]
    return max(none, default=np.nan), min(every, default=np.nan)


def is_wrong(
    design: ChamberMap, found: Heights, truth: Float[np.ndarray, " frames"]
) -> Bool[np.ndarray, " frames"]:
    """Frames whose height is known and off, or not known though it is well within the map."""
    right = np.isfinite(found.mm) & (np.abs(found.mm - truth) <= WITHIN)
    low, high = design.heights[0] + WITHIN, design.heights[-1] - WITHIN
    return np.where(found.known, ~right, (truth >= low) & (truth <= high))


def answer_disturbances(test: SlidingTest, seed: int) -> Records:
    """Disturbed frames at the lowest, the middle and the highest deflection."""
    finger, truth = SoftFinger.of(test.spec), np.linspace(test.spec.preload, highest(test.spec), 3)
    postures = postures_on(finger, test.spec, truth, np.full(3, UP))
    rest, fitted = test.rest(finger, test.spec.severity, seed, first=3)

    def answer(picture: Picture, kind: Disturbance, number: int) -> Answer:
        regions = chamber.find_regions(picture)
        points = [chamber.find_points(picture, regions)]
        found = fitted.height(compute_movements(points, rest))
        wrong = is_wrong(fitted, found, truth[[number]]) if kind.in_view else found.known
        return Answer(regions.status, bool(found.known[0]), not wrong[0])

    return robustness.answer_disturbances(finger, postures, seed, answer)


def measure_bends(test: SlidingTest, seed: int) -> Records:
    """Heights of a finger that nothing presses, in perfect pictures and in those of the study."""
    finger, rows = SoftFinger.of(test.spec), Records()
    contact, length = jnp.asarray(test.spec.contact), jnp.asarray(finger.length)
    for severity in dict.fromkeys((0.0, test.spec.severity)):
        frames = BEND_FRAMES if severity else 1
        bends = np.repeat(BENDS_DEG, frames)
        each = jax.vmap(bend_center_line, in_axes=(None, 0, None))
        truth = np.asarray(each(contact, jnp.asarray(np.deg2rad(bends)), length).across)
        rest, fitted = test.rest(finger, severity, seed, first=len(bends))
        look_up = {"seed": seed, "direction": UP, "severity": severity}
        points = robustness.view_bends(finger, BENDS_DEG, frames, look, **look_up)
        found = fitted.height(compute_movements(points, rest))
        rows.add(
            severity=severity,
            bend_deg=bends,
            deflection_mm=truth,
            known=found.known,
            off_mm=np.where(found.known, found.mm - truth, np.nan),
            failed=is_wrong(fitted, found, truth),
        )
    return rows


def sort_rows(rows: Records, column: str) -> Records:
    """The rows in the order of a column."""
    order = np.argsort(rows[column], kind="stable")
    return Records({name: values[order] for name, values in dict(rows).items()})


def summarize_heights(heights: Records, by: str) -> Records:
    """Slides, unknown heights, and median and 90th percentile of errors, in the order of groups."""
    errors = [column for column in dict(heights) if column.endswith("error_mm")]
    statistics_of = {
        f"{column.removesuffix('error_mm')}{part}_mm": f"{part}_abs {column}"
        for column in errors
        for part in ("median", "p90")
    }
    statistics_of["heights_unknown"] = "sum unknown"
    return heights.summary(by, slides=lambda own: len(own.group("slide")), **statistics_of)


def add_numbers(out: Report, test: SlidingTest, frames: Records, sizes: Records) -> None:
    """Metrics and findings on profiles and kinds."""
    spec, shapes, fingers = test.spec, test.shapes, test.fingers
    stated = frames.where(frames=spec.calibration)
    middle = np.array([(spec.preload + highest(spec)) / 2])
    blue, yellow, _ = test.design.resolution(middle)[0]
    out.values(surfaces=len(shapes), heights=spec.frames * len(shapes))
    out.metrics(
        told_apart=shapes.stat("share told"),
        profile_median_mm=stated["median_mm"][0],
        profile_p90_mm=stated["p90_mm"][0],
        yellow_median_mm=stated["e_median_mm"][0],
        yellow_p90_mm=stated["e_p90_mm"][0],
        **{name: stated[name][0] for name in AS_CALIBRATED},
        resolution_mm_per_px=yellow,
        blue_resolution_mm_per_px=blue,
        whole_told_apart=shapes.stat("share whole_told"),
        heights_unknown=int(stated["heights_unknown"][0]),
    )
    own = shapes.group("surface")
    told = [f"{rows.stat('sum told')} of {len(rows)} {name}" for name, rows in own.items()]
    out.say("kinds", used=many(len(fingers), "finger"), told=", ".join(told))
    shake, noise = fingers.stat("median shake_px"), fingers.stat("median noise_px")
    out.say("ways", shake=shake, shake_mm=shake * yellow, noise=noise)
    rough = test.heights.where(frames=spec.calibration, surface="rough")
    out.say("pad", rough=summarize_heights(rough, "surface"))
    out.say(
        "margins",
        smooth=own["flat"].stat("max roughness_mm"),
        uneven=own["rough"].stat("min roughness_mm"),
        curved=shapes.where(surface=["concave", "convex"]).stat("min_abs sagitta_mm"),
        level=shapes.where(surface=["flat", "rough"]).stat("max_abs sagitta_mm"),
        **{f"{called}_limit": limit for called, limit, _ in SIZES.values()},
    )
    by_quantity, least = sizes.group("quantity") if len(sizes) else {}, {}
    for quantity, rows in by_quantity.items():
        called, limit, _ = SIZES[quantity]
        least[called] = find_limits(rows, "told")[1]
        out.values(quantity=quantity, called=called, limit=limit)
        number = many(int(rows["slides"][0]), "surface")
        found = "; ".join(_describe_limits(rows, way) for way in ("", "whole_"))
        first, last = rows["size_mm"][[0, -1]]
        out.say("limits", number=number, least=first, largest=last, found=found)
    curved, rough = (least.get(called, np.nan) for called, *_ in SIZES.values())
    out.metrics(curved_from_mm=curved, rough_from_mm=rough)
    if 0 in frames["frames"]:
        out.say("calibration", first=frames.where(frames=0), last=stated)


def _describe_limits(sizes: Records, way: str) -> str:
    none, every = find_limits(sizes, f"{way}told")
    low = f"none up to {none:g} mm" if np.isfinite(none) else "some even of the least"
    high = f"all from {every:g} mm on" if np.isfinite(every) else "not even all of the largest"
    return f"by {WAYS[way]} {low} and {high}"


def add_tables(out: Report, test: SlidingTest, frames: Records) -> None:
    """Profiles and kinds, by surface, points, calibration and finger."""
    heights = test.heights.where(frames=test.spec.calibration)
    stated = frames.where(frames=test.spec.calibration)
    confusion, called = Records(), [kind.name.lower() for kind in (*KINDS, SurfaceKind.UNDEFINED)]
    for surface, own in test.shapes.group("surface").items():
        confusion.add(surface=surface, **{name: list(own["called"]).count(name) for name in called})
    out.table("confusion", confusion)
    out.table("kinds", summarize_heights(heights, "surface"))
    ways = Records()
    for way, points in WAYS.items():
        errors = {name: stated[f"{way}{name}"] for name in ("median_mm", "p90_mm")}
        ways.add(points=points, **errors, told_apart=test.shapes.stat(f"share {way}told"))
    out.table("ways", ways)
    out.table("calibration", frames)
    out.table("fingers", test.fingers | {"p90_mm": summarize_heights(heights, "finger")["p90_mm"]})


def add_robustness(out: Report, test: SlidingTest, disturbed: Records, bends: Records) -> None:
    """Answers to disturbed frames and over the bend."""
    failures = disturbed.stat("sum failed") + bends.stat("sum failed")
    out.values(odd=len(disturbed) + len(bends), within=WITHIN, map_end=test.design.heights[-1])
    out.metrics(odd_failures=failures)
    wrong = f"have {many(int(failures), 'wrong answer')}"
    out.say("odd", answered=wrong if failures else "have the answer defined for them, each")
    answers = robustness.summarize_disturbances(disturbed)
    height = np.where(answers["in_view"], f"within {WITHIN:g} mm", "not known")
    out.table("odd_frames", answers | {"expected_height": height})
    keys = ("severity", "bend_deg", "deflection_mm")
    whats = {"frames": "count failed", "known": "sum known", "failures": "sum failed"}
    out.table("bends", bends.summary(*keys, worst_mm="max_abs off_mm", **whats))


def draw_profiles(test: SlidingTest, slides: Sequence[Slide]) -> Figure:
    """One slide of each kind, as in the paper's Fig. 14 and in mm."""
    spec, heights = test.spec, test.heights.where(frames=test.spec.calibration)
    drawing, grid = new_figure(2, len(KINDS), height=4.8)
    for (above, below), slide in zip(grid.T, slides, strict=False):
        own = heights.where(slide=slide.number)
        above.set_title(slide.surface.kind.name.lower())
        coarse = {"where": "mid", "color": PALETTE[4], "label": "e in whole pixels"}
        above.step(slide.x, own["whole_px"], **coarse)
        above.plot(slide.x, own["e_px"], color=PALETTE[6], label="e finer than a pixel")
        x = np.linspace(slide.x[0], slide.x[-1], 401)
        lowest = slide.surface.ridden(slide.x, spec.tip_radius).min()
        below.plot(x, slide.surface.height(x) - lowest, color="0.6", label="surface")
        ridden = slide.surface.ridden(x, spec.tip_radius) - lowest
        below.plot(x, ridden, "--", color="black", linewidth=1, label="ridden by the pad")
        dots = {"color": PALETTE[0], "markersize": 3.5, "label": "found by b, e and g"}
        below.plot(slide.x, slide.ridden + own["error_mm"], ".", **dots)
        low, high = below.get_ylim()
        more = max(LEAST_RANGE - (high - low), 0) / 2
        below.set(xlabel="along the slide (mm)", ylim=(low - more, high + more))
    grid[0, 0].set_ylabel("movement of e (px)")
    grid[1, 0].set_ylabel("height (mm)")
    return drawing


def draw_pictures(test: SlidingTest, slides: Sequence[Slide]) -> tuple[Figure, float]:
    """The first finger at rest and on the first convex surface; seconds for a picture's points."""
    finger = test.finger(0)
    renderer = finger.renderer(test.seed)
    slide = slides[KINDS.index(SurfaceKind.CONVEX)]
    order = np.argsort(slide.ridden)
    deflections = test.spec.preload + slide.ridden[order[[0, len(order) // 2, -1]]]
    still = renderer.render(finger.postures(np.zeros(1), UP))
    postures = postures_on(finger, test.spec, deflections, np.full(3, slide.direction))
    titles = ["at rest", *(f"deflected by {one:.1f} mm" for one in deflections)]
    drawing, [row] = new_figure(1, len(titles), height=2.0)
    images = [*still, *renderer.render(postures, 1)]
    with one_thread():
        seconds = median_seconds(partial(look, 0), TIMED * images)
    for axes, title, image in zip(row, titles, images, strict=True):
        points = look(0, image)
        axes.imshow(np.clip(BRIGHTER * image.pixels.astype(float), 0, 255).astype(np.uint8))
        axes.set_axis_off()
        axes.set_title(title, fontsize=8)
        for marker, name in zip("ovs", TRACKED, strict=True):
            if points.seen[NAMES.index(name)]:
                style = {"color": "white", "markeredgecolor": "black", "linestyle": "none"}
                place = points.xy[NAMES.index(name)]
                axes.plot(*place, marker, markersize=5, label=name, **style)
    return drawing, seconds


def draw_kinds(shapes: Records) -> Figure:
    """Sagitta and roughness of all surfaces, and the limits between the kinds."""
    drawing, [[axes]] = new_figure(height=3.6)
    for i, (name, own) in enumerate(shapes.group("surface").items()):
        place = own["sagitta_mm"], own["roughness_mm"]
        axes.plot(*place, MARKERS[i], color=PALETTE[i], markerfacecolor="none", label=name)
    high = max(axes.get_ylim()[1], 2 * ROUGH)
    end = max(CURVED_OVER_ROUGH * high, 2 * CURVED)
    line = {"color": "black", "linewidth": 1, "linestyle": ":"}
    axes.plot([-CURVED, CURVED], [ROUGH, ROUGH], **line, label="limits")
    sagittas = np.array([CURVED, CURVED, end])
    for side in (-1, 1):
        axes.plot(side * sagittas, np.array([0, CURVED, end]) / CURVED_OVER_ROUGH, **line)
    reach = max(2 * CURVED, shapes.stat("max_abs sagitta_mm"))  # NaN last: then it is the first
    axes.set(xlabel="sagitta (mm)", ylabel="roughness (mm)", ylim=(0, high))
    axes.set_xlim(-1.05 * reach, 1.05 * reach)
    return drawing


def draw_errors(test: SlidingTest, frames: Records, severities: Records) -> Figure:
    """Distribution of errors; errors over the number of calibration frames and severity."""
    heights = test.heights.where(frames=test.spec.calibration)
    drawing, [[below, *others]] = new_figure(1, 3, height=3.1, width_ratios=(1.2, 1, 1))
    for i, (way, name) in enumerate(WAYS.items()):
        errors = heights[f"{way}error_mm"]
        errors = np.sort(np.abs(errors[np.isfinite(errors)]))
        parts = 100 * (np.arange(len(errors)) + 1) / max(len(errors), 1)
        below.plot(errors, parts, plots.DASHES[i], color=PALETTE[i], label=name)
    below.set(xlabel="error of a height (mm)", ylabel="part below (%)", ylim=(0, 101))
    parts = {"": "profile", "full_": "height itself"}
    for axes, rows, x, lines, first in zip(
        others, (frames, severities), ("frames", "severity"), (parts, WAYS), (3, 0), strict=True
    ):
        for i, (way, name) in enumerate(lines.items(), first):
            style = {"color": PALETTE[i], "marker": MARKERS[i], "linestyle": plots.DASHES[i]}
            axes.plot(rows[x], rows[f"{way}p90_mm"], label=name, **style)
        axes.set(xlabel=x, ylabel="90 % are below (mm)", ylim=(0, None))
    others[0].set_xlabel("calibration frames")
    return drawing


def draw_limits(sizes: Records) -> Figure:
    """Part called what it is over the true size."""
    rows, own = Records(), {way: WAYS[way] for way in ("", "whole_")}
    for way, points in {"exact_": "the ridden heights, exactly", **own}.items():
        rows.add(**(sizes | {"points": f"by {points}", "told_percent": 100 * sizes[f"{way}told"]}))
    drawing = plots.lines(rows, "size_mm", "told_percent", by="points", panel="quantity")
    for axes, quantity in zip(drawing.axes, sizes.group("quantity"), strict=True):
        called, limit, _ = SIZES[quantity]
        axes.axvline(limit, color="black", linewidth=1, linestyle="-.", label="limit")
        axes.set(xlabel=f"true {quantity} (mm)", ylabel=f"called {called} (%)")
        axes.set(xlim=(0, None), ylim=(-3, 103))
    return drawing
