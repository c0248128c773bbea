"""The study itself: from its spec to its results."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from scipy.stats import binomtest

from designopt import Context, Records, Report, Results
from designopt.plot.figures import MARKERS, PALETTE, new_figure
from designopt.study import plots
from designopt.study.records import Summary
from designopt.user_folders import cache_folder
from optics.rendering import ChamberEffects, ChamberRenderer
from perception import chamber as perception
from perception.chamber import Direction
from perception.chamber.directions import Use
from perception.chamber.points import NAMES
from studies.benchmarks import rings
from studies.bending_direction import BendingDirectionSpec
from studies.bending_direction.frames import TOWARDS, USES, Series, analyze, before_bending, judge
from studies.bending_direction.frames import render_series as render
from studies.bending_direction.light import (
    FOLDER,
    LEAST_DEG,
    Case,
    answer_real,
    answer_traced,
    bends_deg,
    compare_falloff,
    exposed,
    traced_cases,
)
from studies.models.one_thread import median_seconds, one_thread
from studies.models.soft_finger import best_chamber as best
from studies.models.soft_finger import robustness
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.robustness import Answer, Disturbance, Picture
from studies.models.words import spread
from studies.oracles.chamber_light import trace_once

ANSWERS = ("initial", "up", "down", "left", "right", "undefined")
"""Columns of Table II, and the answer that it does not have."""

TABLE_II = {
    "up": ((3, 296, 0, 0, 1), (9, 291, 0, 0, 0)),
    "down": ((0, 0, 292, 8, 0), (9, 0, 288, 3, 0)),
    "left": ((0, 0, 7, 288, 5), (15, 0, 0, 285, 0)),
    "right": ((0, 0, 0, 0, 300), (8, 0, 0, 0, 292)),
}
"""Paper A's Table II: answers to 300 images by true direction, without and with a threshold."""

PAPER, OURS = "paper A", "ours, all"

THRESHOLDS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0)

LEAST_DECIDED, MOST_ABSTAINED = 99.0, 6.0
"""Percent of the decided images that are right and of images left undecided, in any direction."""

CURVE_DEG = np.arange(0.0, 121.0)
"""Bends of the displacement curves."""

BENDS_DEG = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 90.0, 120.0)

DISTURBED_DEG = 25.0
"""Bend of the finger in disturbed frames, far enough to be decided where anything is."""

SHOWN = (("down", 0), ("down", 30), ("down", 60), ("down", 110), ("right", 30), ("up", 30))
"""Pictures of the report: directions and bends in degrees."""

TIMED = 64
"""Frames whose analysis is timed."""

POINTS = {"blue": "the points of blue", "all": "all points"}

ALONG = ("beg", "acdfg")
"""Points whose displacement along y and along x gives the direction."""

WORDS = dict(zip(NAMES, (*("leftmost", "lowest", "rightmost") * 2, "centre"), strict=True))
STYLES = dict(zip(NAMES, ("-", "-", ":", "--", "--", ":", "-."), strict=True))
BLUE, VERMILION, GREEN = PALETTE[:3]
YELLOW = "#C79A00"


def run(spec: BendingDirectionSpec, context: Context) -> Results:
    """Render bending fingers, estimate their directions, compare them with the true ones.

    Raises:
        UserError: no such chamber, or another float type than float64.
    """
    context.require_float64("bending-direction compares displacements of a hundredth of a pixel")
    out, seed, kept = Report(spec, package=__package__), context.seed, (0.0, spec.threshold)
    with one_thread():
        with context.step("The chamber whose image moves most"):
            finger = SoftFinger.of(spec)
            designs, held_by = best.find_best_chamber(finger, seed)
            out.figure("pictures", draw_pictures(finger, seed + 4))
        with context.step(f"{spec.images} images in every direction"):
            bends = spec.images, spec.largest_bend_deg, spec.scatter_deg
            random = render_random(finger, *bends, (seed, 3))
            add_directions(out, estimate_all(random, (*THRESHOLDS, spec.threshold)))
        with context.step("Bending from nothing to 120°"):
            add_curves(out, list(render_straight(finger, CURVE_DEG, seed + 1)))
        small, bends = Records(), (spec.small_images, spec.small_bend_deg, spec.scatter_deg)
        for design in designs:
            with context.step(f"Small bends, chamber {design.name}"):
                own = estimate_all(render_random(design.finger, *bends, (seed, 4)), kept)
                small.add(**(own | {"chamber": design.name}))
        add_chambers(out, designs, held_by, small)
        with context.step("0.01° to 120° of bend"):
            straight = render_straight(finger, np.array(BENDS_DEG), seed + 2, severity=0.0)
            perfect = estimate_all(straight, kept[:1], ["all"])
            repeated = np.repeat(BENDS_DEG, spec.stability_images)
            usual = estimate_all(render_straight(finger, repeated, seed + 2), kept, ["all"])
        with context.step("Frames that are no proper images"):
            disturbed = answer_disturbed(finger, spec.threshold, seed + 3)
            add_robustness(out, perfect, usual, disturbed)
        bends = spec.largest_bend_deg, spec.threshold, spec.scatter_deg, seed
        with context.step("A lamp at the lens, gloss and dust"):
            add_real(out, answer_real(finger, spec.real_images, *bends))
        if not spec.traced_bends or importlib.util.find_spec("mitsuba") is None:
            out.say("untraced")
        else:
            with context.step("Path-traced frames, kept for other runs"):
                add_traced(out, spec, finger, seed)
        with context.step("Run times"):
            rows = rings.measure_rings(finger)
            out.metrics(frame_ms=1e3 * time_frame(finger, spec, seed))
    evidence, holds = rings.fit_powers(rows)
    claim = out.claim("rings", [evidence], holds)
    reference = f"{rings.REFERENCE} rings per region"
    out.precision(rows, "error of the outlines' ends (px)", reference, claim)
    return out.results()


def render_random(
    finger: SoftFinger, images: int, largest_deg: float, scatter_deg: float, seed: tuple[int, int]
) -> Iterator[Series]:
    """Random bends in every direction; the same bends for every finger."""
    for number, truth in enumerate(TOWARDS):
        # Every direction is an experiment of its own, with its own lamp and its own initial frame.
        generator = np.random.default_rng([*seed, number])
        bends = generator.uniform(0, largest_deg, images)
        scatter = scatter_deg * generator.standard_normal(images)
        yield render(finger, truth, bends, scatter, seed=(*seed, number))


def render_straight(
    finger: SoftFinger, bends_deg: np.ndarray, seed: int, severity: float | None = None
) -> Iterator[Series]:
    """The same bends straight towards every direction, in frames that are numbered on."""
    for i, truth in enumerate(TOWARDS):
        first = i * len(bends_deg)
        yield render(finger, truth, bends_deg, seed=seed, first=first, severity=severity)


def estimate_all(
    series: Iterable[Series], thresholds: Sequence[float], uses: Sequence[Use] = USES
) -> Records:
    """The answers to all frames of several directions, as `Series.estimate` returns them."""
    rows = Records()
    for one in series:
        rows.add(**one.estimate(thresholds, uses))
    return rows


def answer_disturbed(finger: SoftFinger, threshold: float, seed: int) -> Records:
    """Answers to one disturbed frame of every kind in every direction; the threshold is in px."""
    truths, directions = list(TOWARDS), np.array(list(TOWARDS.values()))
    initial = before_bending(finger.renderer(seed), finger)

    def answer(picture: Picture, kind: Disturbance, number: int) -> Answer:
        regions = perception.find_regions(picture)
        points = perception.find_points(picture, regions)
        found = perception.estimate_bending_direction(
            points, initial, threshold=threshold, use="all"
        )
        wanted = truths[number] if kind.in_view else Direction.UNDEFINED
        return Answer(regions.status, found is not Direction.UNDEFINED, found is wanted)

    postures = finger.postures(np.full(len(truths), np.deg2rad(DISTURBED_DEG)), directions)
    return robustness.answer_disturbances(finger, postures, seed, answer)


def time_frame(finger: SoftFinger, spec: BendingDirectionSpec, seed: int) -> float:
    """Median seconds of one frame's analysis, one after the other on one core."""
    bends = np.deg2rad(np.linspace(0, spec.largest_bend_deg, TIMED))
    angles = np.resize(np.array(list(TOWARDS.values())), TIMED)
    images = finger.renderer(seed).render(finger.postures(bends, angles))
    return median_seconds(partial(analyze, 0), images)


def count_answer(name: str) -> Callable[[Records], int]:
    """The number of answers of that name, as `Records.summary` takes it."""
    return lambda own: int(np.sum(own["answer"] == name))


RULES: dict[str, Callable[[Records], float]] = {
    "paper_percent": lambda own: 100 * float(np.mean(own["right"] | (own["answer"] == "initial"))),
    "strict_percent": lambda own: 100 * own.stat("share right"),
    "decided_percent": lambda own: 100 * own.where(undecided=False).stat("share right"),
    "abstained_percent": lambda own: 100 * own.stat("share undecided"),
}
"""What counts as correct: with the paper's rule, "initial" does, too; strictly only the true
direction does; of the answers that name a direction those that name the true one; and the part that
names none."""


def tabulate_rules(answers: Records, threshold: float) -> Records:
    """Table II, the paper's and ours, answer by answer and by every rule.

    Args:
        answers: ours, without and with the threshold among others.
        threshold: px.
    """
    rows = Records()
    for direction, printed in TABLE_II.items():
        for word, least, counts in zip(("no", "yes"), (0.0, threshold), printed, strict=True):
            own = answers.where(direction=direction, threshold_px=least)
            paper = np.repeat(ANSWERS[:5], counts)
            rows.add(
                direction=direction,
                threshold=word,
                source=[*[PAPER] * len(paper), *(f"ours, {use}" for use in own["points"])],
                answer=[*paper, *own["answer"]],
            )
    counted = {name: count_answer(name) for name in ANSWERS}
    return judge(rows).summary("direction", "threshold", "source", **counted, **RULES)


def add_directions(out: Report, answers: Records) -> None:
    """Table II, the paper's and ours, by every rule, and what the threshold does."""
    table = tabulate_rules(answers, out["threshold"])
    out.values(least_decided=LEAST_DECIDED, most_abstained=MOST_ABSTAINED)

    def of(rule: str, threshold: str, source: str = OURS) -> np.ndarray:
        return table.where(threshold=threshold, source=source)[rule]

    strict, decided, abstained = list(RULES)[1:]
    shown = {"right_percent": (strict, "no")}
    shown |= {rule: (rule, "yes") for rule in (decided, abstained)}
    for i, name in enumerate(TABLE_II):
        for entry, rule in shown.items():
            values = {"direction": name, "paper": of(*rule, PAPER)[i]}
            out.metric(entry.replace("_", f"_{name}_"), of(*rule)[i], entry, **values)
    blue = of(strict, "no", "ours, blue")
    out.metrics(least_right_blue_percent=min(blue))
    percents = partial(spread, places=1, unit=" %")
    without, kept = (percents(of(strict, word, PAPER)) for word in ("no", "yes"))
    out.say("right", right=percents(of(strict, "no")), blue=percents(blue), paper=without)
    undecided = percents(of(abstained, "yes"))
    out.say("decided", right=percents(of(decided, "yes")), undecided=undecided)
    out.say("strict", without=without, kept=kept)
    both, keys = {rule: RULES[rule] for rule in (decided, abstained)}, ("points", "threshold_px")
    over = answers.where(threshold_px=THRESHOLDS).summary(*keys, "direction", **both)
    worst = {f"least_{decided}": f"min {decided}", f"most_{abstained}": f"max {abstained}"}
    over = over.summary(*keys, **worst)
    good = over["least_decided_percent"] >= LEAST_DECIDED
    good &= over["most_abstained_percent"] <= MOST_ABSTAINED
    if np.any(good & (over["points"] == "all")):
        least = over.where(good, points="all")["threshold_px"]
        out.say("thresholds", good=", ".join(f"{one:g}" for one in least))
    out.table("directions", table)
    out.table("thresholds", over)
    out.figure("rules", draw_rules(table))
    out.figure("thresholds", draw_thresholds(over, out["threshold"]))


def add_curves(out: Report, curves: Sequence[Series]) -> None:
    """The two stages of the paper's Fig. 12: yellow shrinks until it is gone, then blue shrinks."""
    gone, kept, shrinking = [], [], True
    for series in curves:
        blue, yellow = np.array([frame.areas for frame in series.frames]).T
        at = gone_at(yellow, series.bends_deg)
        if at is None:
            kept.append(series.name)
        else:
            gone.append(f"{series.name} {at:.0f}°")
            shrinking &= bool(blue[-1] < blue[np.searchsorted(series.bends_deg, at)])
    if gone:
        out.say("stages" if shrinking else "gone", gone=", ".join(gone))
    if kept:
        out.say("in-view", kept=" and ".join(kept))
    out.figure("curves", draw_curves(curves))


def gone_at(areas: np.ndarray, bends: np.ndarray) -> float | None:
    """The bend from which on nothing is left of an area; None if something always is."""
    left = np.flatnonzero(areas)
    first = left[-1] + 1 if len(left) else 0
    return float(bends[first]) if first < len(bends) else None


def compare_chambers(small: Records) -> Records:
    """How every chamber decides the same bends, with the same shake and noise.

    Args:
        small: answers of every ``chamber``, the study's own first, in the same order.

    Returns:
        By ``chamber`` and ``points``: ``images``, those left ``undecided`` and the ``wrong`` ones;
        ``gained``, decided with this chamber and not with the study's own, and ``lost``, the other
        way round; ``p_value``, the chance of so many gained or more, were either as likely
        (one-sided sign test).
    """
    after, chambers = small["undecided"], len(small.group("chamber"))
    before = np.tile(after[: len(after) // chambers], chambers)

    def p_value(own: Records) -> float:
        gained, changed = own.stat("sum gained"), own.stat("sum gained") + own.stat("sum lost")
        test = binomtest(int(gained), int(changed), alternative="greater") if changed else None
        return float(test.pvalue) if test else 1.0

    return (small | {"gained": before & ~after, "lost": ~before & after}).summary(
        "chamber",
        "points",
        images="count bend_deg",
        **{name: f"sum {name}" for name in ("undecided", "wrong", "gained", "lost")},
        p_value=p_value,
    )


def add_chambers(
    out: Report, designs: Sequence[best.Design], held_by: Sequence[str], small: Records
) -> None:
    """How fast outlines move with every chamber, and what that changes at small bends."""
    own, most = designs[0], designs[-1]
    kept, plain = (small.where(threshold_px=least) for least in (out["threshold"], 0.0))
    table = compare_chambers(kept)
    plain = plain.summary("chamber", "points", right=RULES["strict_percent"])
    out.metrics(rate_spec_px_per_deg=own.rates.mean(), rate_best_px_per_deg=most.rates.mean())
    moved = []
    for word, slopes in zip(("η", "Δl_B", "θ_BC"), own.slopes.T, strict=True):
        outlines = [name for name, slope in zip(best.OUTLINES, slopes, strict=True) if slope]
        moved.append(f"{word}, that of {' and '.join(outlines)}")
    out.say("rates", own=own, moved="; ".join(moved))
    word = "most" if most.rates.mean() > own.rates.mean() else "at most"
    angle = np.rad2deg(float(most.dimensions.wall_angle_bc))
    values = {"gains": most.rates / own.rates - 1, "angle": angle, "inside": best.INSIDE}
    out.say("best", best=most, most=word, held_by=", ".join(held_by), **values)
    for use, words in POINTS.items():
        rows = table.where(points=use)
        before, *between, after = rows["undecided"].tolist()
        values = {"points": words, "before": before, "after": after, "fewer": before - 1}
        values |= {name: rows[name][-1] for name in ("images", "gained", "lost", "p_value")}
        numbers = {"undecided_small_spec": before, "undecided_small_best": after}
        numbers["fewer_undecided_p_value"] = values["p_value"]
        for name, value in numbers.items():
            out.metric(f"{name}_{use}", value, name, **values)
        alone = zip(between, rows["chamber"][1:-1], strict=True)
        out.say("small", **values, alone=", ".join(f"{count} with {one}" for count, one in alone))
    out.metrics(wrong_small=int(table["wrong"].sum()))
    out.table("small_bends", table | {"right_without_percent": plain["right"]})
    out.table("flips", table.where(table["chamber"] != best.OWN))
    out.table("designs", best.tabulate(designs))
    out.figure("small_bends", draw_small_bends(out["small_bend_deg"], (own, most), kept))


def add_robustness(out: Report, perfect: Records, usual: Records, disturbed: Records) -> None:
    """Answers from nearly straight to far bent, and to frames that are no proper images."""
    failures = disturbed.stat("sum failed")
    kinds = robustness.summarize_disturbances(disturbed)
    out.metric("odd_failures", failures, frames=len(disturbed))
    wrong = len(perfect) - perfect.stat("sum right")
    out.metric("wrong_perfect", wrong, images=len(perfect))
    kept = usual.where(usual["threshold_px"] > 0)
    if len(kept):
        wrong = kept.stat("sum wrong") + count_answer("undefined")(kept)
        out.metric("wrong_with_threshold", wrong, images=len(kept))
    answered = f"{failures} wrong answers" if failures else "the answer defined for them, each"
    out.say("disturbed", frames=len(disturbed), kinds=len(kinds), answered=answered)
    bends = perfect | {"images": "perfect"}
    bends.add(**(usual | {"images": "with all effects"}))
    counted: dict[str, Summary] = {"right": "sum right", "not_bent": count_answer("initial")}
    counted |= {"wrong": "sum wrong", "undefined": count_answer("undefined")}
    out.table("bends", bends.summary("images", "threshold_px", "bend_deg", **counted))
    expected = np.where(kinds["in_view"], "the direction", "undefined")
    out.table("odd_frames", kinds | {"expected_direction": expected})


def add_real(out: Report, answers: Records) -> None:
    """Directions in rendered frames in the light of a lamp at the lens."""
    count = len(answers)
    out.values(least_deg=LEAST_DEG)
    right = 100 * answers.stat("share right")
    out.metric("real_right_percent", right, images=count)
    out.metric("real_wrong", answers.stat("sum wrong"), images=count)


def add_traced(out: Report, spec: BendingDirectionSpec, finger: SoftFinger, seed: int) -> None:
    """Directions in path-traced frames, and the light's falling off in them."""
    folder = cache_folder(spec.cache, FOLDER)
    bends = bends_deg(spec.traced_bends, spec.largest_bend_deg)
    cases = traced_cases(finger, bends, spec.scatter_deg, seed)
    answers = answer_traced(cases, spec.threshold, folder)
    frames, count = sum(len(own) - 1 for own in cases.values()), len(answers)
    right, wrong = 100 * answers.stat("share right"), answers.stat("sum wrong")
    out.metric("traced_right_percent", right, frames=frames, images=count)
    out.metric("traced_wrong", wrong, images=count)
    ratios = compare_falloff(finger, cases["matt"][0].frame, folder)
    out.metrics(red_over_yellow=ratios["traced"])
    error = 100 * abs(ratios["rendered"] / ratios["traced"] - 1)
    out.metric("falloff_error_percent", error)
    out.say("falloff", **ratios)
    out.say("traced", frames=frames, images=count, right=right, wrong=wrong)
    counted: dict[str, Summary] = {"images": "count bend_deg", "right": "sum right"}
    counted |= {"undecided": "sum undecided", "wrong": "sum wrong"}
    counted["sights"] = lambda own: ", ".join(sorted(set(own["status"])))
    out.table("traced", answers.summary("walls", "exposure", **counted))
    out.figure("traced", draw_traced(finger, cases, folder))


def draw_traced(finger: SoftFinger, cases: dict[str, list[Case]], folder: Path) -> Figure:
    """Path-traced frames over rendered ones of the same postures."""
    drawing, grid = new_figure(4, 4, height=6.0)
    for walls, rows in zip(("matt", "glossy"), (grid[:2], grid[2:]), strict=True):
        straight, *bent = cases[walls]
        chosen = [straight, bent[0], bent[len(bent) // 2], bent[-1]]
        effects = ChamberEffects(lamp=1.0, gloss=float(walls == "glossy"), gain=0.4)
        renderer = ChamberRenderer(finger.chamber, finger.endoscope, effects)
        bends = np.array([case.frame.bend for case in chosen])
        directions = np.array([case.frame.direction for case in chosen])
        images = renderer.render(finger.postures(bends, directions))
        for i, (case, image) in enumerate(zip(chosen, images, strict=True)):
            rows[0, i].imshow(exposed(trace_once(case.frame, folder), "for screens"))
            rows[1, i].imshow(exposed(image.pixels / np.float32(255), "for screens"))
            where = f"{case.truth.name.lower()}, {case.bend_deg:.0f}°" if i else "straight"
            rows[0, i].set_title(f"{walls}: {where}" if i == 0 else where)
            rows[1, i].set_title("the same, rendered" if i == 0 else "")
    for axes in grid.flat:
        axes.set_axis_off()
    return drawing


def draw_pictures(finger: SoftFinger, seed: int) -> Figure:
    """Pictures with outlines as they are and points as they were found."""
    names, bends = zip(*SHOWN, strict=True)
    directions = np.array([TOWARDS[Direction[name.upper()]] for name in names])
    images = finger.renderer(seed).render(finger.postures(np.deg2rad(bends), directions))
    drawing, grid = new_figure(2, 3, height=4.2)
    for axes, (name, bend), image in zip(grid.flat, SHOWN, images, strict=True):
        axes.imshow(image.pixels)
        for outline, seen in zip(image.outlines, image.seen, strict=True):
            if seen:
                axes.add_patch(Polygon(outline, fill=False, color="white", linewidth=0.8))
        points = analyze(0, image).points
        for letter, place, seen in zip(NAMES, points.xy, points.seen, strict=True):
            if seen:
                axes.plot(*place, "+", color="black", markersize=8, markeredgewidth=1.6)
                axes.annotate(letter, place, (3, 3), textcoords="offset points", color="white")
        rows, columns = image.pixels.shape[:2]
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
        axes.set_title(f"{name}, {bend}°" if bend else "straight")
        axes.set_axis_off()
    return drawing


def draw_curves(curves: Sequence[Series]) -> Figure:
    """The paper's Fig. 12: displacements over the bend, and what is left of the regions."""
    drawing, grid = new_figure(3, 2, height=8.0)
    for axes, series in zip(grid[:2].flat, curves, strict=True):
        sideways = series.truth in (Direction.LEFT, Direction.RIGHT)
        points = [frame.points for frame in series.frames]
        moved = [perception.compute_displacements(one, series.initial) for one in points]
        along = np.array(moved)[:, :, 0 if sideways else 1]
        along[~np.array([one.seen for one in points])] = np.nan
        for name in ALONG[sideways]:
            region, color = ("yellow", YELLOW) if name in "def" else ("blue", BLUE)
            style = {"color": color, "linewidth": 2.2 if name == "g" else 1.3}
            style["label"] = f"{name}: {WORDS[name]} of {region}"
            axes.plot(series.bends_deg, along[:, NAMES.index(name)], STYLES[name], **style)
        axes.set(title=f"Bending {series.name}", xlim=(0, 120), xlabel="bend (°)")
        axes.set_ylabel(f"displacement along {'x' if sideways else 'y'} (px)")
    for axes, series in zip(grid[2], curves[1::2], strict=True):  # down, right
        areas = 1e-3 * np.array([frame.areas for frame in series.frames]).T
        kinds = (("blue", BLUE, "--"), ("yellow", YELLOW, "-."))
        for area, (name, color, style) in zip(areas, kinds, strict=True):
            line = {"color": color, "linewidth": 2.2, "label": f"below: area of {name}"}
            axes.plot(series.bends_deg, area, style, **line)
        axes.set(title=f"What is seen, bending {series.name}", xlim=(0, 120), ylim=(0, None))
        axes.set(xlabel="bend (°)", ylabel="area (1000 px)")
    return drawing


def draw_rules(table: Records) -> Figure:
    """Table II and ours, rule by rule."""
    titles = ['the paper\'s rule: "initial" is correct', "strict"]
    titles += ["of the decided ones, right", "undecided"]
    sources = {PAPER: "0.6", "ours, blue": BLUE, OURS: GREEN}
    drawing, grid = new_figure(2, 2, height=5.6)
    for axes, rule, title in zip(grid.flat, RULES, titles, strict=True):
        bars = [(source, word) for source in sources for word in ("no", "yes")]
        for i, (source, word) in enumerate(bars):
            heights = table.where(source=source, threshold=word)[rule]
            label = source if source == PAPER else f"{source} points"
            label += ", with threshold" if word == "yes" else ", no threshold"
            style = {"color": sources[source], "hatch": "///" if word == "yes" else ""}
            places = np.arange(len(heights)) + (i - 2.5) * 0.14
            axes.bar(places, heights, 0.13, edgecolor="white", label=label, **style)
        axes.set(xticks=range(len(TABLE_II)), xticklabels=TABLE_II)
        axes.set(ylabel="images (%)", title=title)
        if rule == "abstained_percent":
            axes.set_ylim(0, None)
        else:
            start_near(axes, table[rule])
    return drawing


def start_near(axes: Axes, percents: np.ndarray) -> None:
    """Let an axis of percentages start just below the least of them."""
    axes.set_ylim(math.floor(np.nanmin(percents, initial=100.0)) - 2, 100.3)


def draw_thresholds(over: Records, threshold: float) -> Figure:
    """Decided and undecided images over the threshold."""
    names = {"least_decided_percent": "of the decided ones, right (%)"}
    names["most_abstained_percent"] = "undecided (%)"
    rows = over | {"points": [f"{use} points" for use in over["points"]]}
    drawing = plots.lines(rows, "threshold_px", list(names), by="points", names=names)
    start_near(drawing.axes[0], over["least_decided_percent"])
    drawing.axes[1].set_ylim(0, 1.05 * max(1.0, np.nanmax(over["most_abstained_percent"])))
    for axes in drawing.axes:
        axes.axvline(threshold, color="0.5", linestyle=":", linewidth=1)
    return drawing


def draw_small_bends(largest_deg: float, designs: Sequence[best.Design], kept: Records) -> Figure:
    """Small bends: what is left undecided, and how fast outlines move."""
    drawing, [[left, right]] = new_figure(1, 2, height=3.7)
    edges = np.linspace(0, largest_deg, 9)
    styles = (("-", VERMILION, ""), ("--", BLUE, "///"))
    for i, (design, (style, color, hatch)) in enumerate(zip(designs, styles, strict=True)):
        for use, marker in zip(POINTS, MARKERS, strict=False):
            own = kept.where(chamber=design.name, points=use)
            images = np.histogram(own["bend_deg"], edges)[0]
            undecided = np.histogram(own.where(own["undecided"])["bend_deg"], edges)[0]
            share = 100 * undecided / np.maximum(images, 1)
            line = {"color": color, "marker": marker, "label": f"{design.name}, {use} points"}
            left.plot(edges[:-1] + edges[1] / 2, share, style, **line)
        bar = {"color": color, "hatch": hatch, "edgecolor": "white"}
        places = np.arange(3) + (i - 0.5) * 0.36
        right.bar(places, design.rates, 0.34, label=f"chamber {design.name}", **bar)
    left.set(xlabel="bend (°)", ylabel="undecided (%)", title="Small bends", ylim=(0, 105))
    right.set(xticks=range(3), xticklabels=best.OUTLINES, ylabel="displacement (px/°)")
    right.set_title("How fast outlines start to move")
    return drawing
