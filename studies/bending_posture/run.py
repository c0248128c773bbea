"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float
from scipy.stats import studentized_range

from designopt import Context, PrecisionRow, Records, Report, Results, SpecFile, UserError
from designopt.cores import usable_cores
from optics.chamber import solve_image_rates
from optics.rendering import ChamberImage
from perception.posture import PostureEstimator, Training, compute_marker_errors, find_posture
from studies.bending_posture import BendingPostureSpec, figures
from studies.bending_posture import trainings as by
from studies.bending_posture.trainings import Data, Trained, size_of, train_network
from studies.models.one_thread import median_seconds, one_thread
from studies.models.soft_finger import robustness
from studies.models.soft_finger.best_chamber import clearance
from studies.models.soft_finger.finger import DOWN, SoftFinger
from studies.models.soft_finger.robustness import Answer, Disturbance, Picture
from studies.models.soft_finger.samples import marker_places, random_postures, samples
from studies.models.soft_finger.spec import CLEARANCE, MadeSpec
from studies.models.words import many, spread

MEAN = "mean of the labels"
"""What every network is compared with."""

REGULARISATIONS = (1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)
"""Weights of L2 regularisation that are compared, for standardised labels."""

REFERENCE = (
    "the markers of the rendered finger on unseen images, over the error of the mean of the labels"
)

MARGIN = 1.2
"""A tip error that is larger by this at every seed is called worse."""

SURE = 0.95

OTHERS = {
    "another lamp": "other_lamp_tip_mm",
    "finger as made": "made_finger_tip_mm",
    "both": "both_other_tip_mm",
}
"""What is other than in training, and its metric."""

DRAWS, FRAMES = 10, 20
"""Lamps or fingers, and frames of each."""

STREAM, LAMPS, FIRST = 8, 100, 1_000_000
"""Of random numbers; added to the seed for another lamp; number of the first frame."""

BENDS_DEG = (0.01, 0.1, 1.0, 10.0, 30.0, 60.0, 90.0, 110.0, 120.0)

DISTURBED_DEG = (10.0, 25.0, 50.0)
"""Yellow is in view at all of them."""

REPEATED = 20
"""Frames at every bend."""

TIMED = 40
"""Pictures in which markers are found one after the other, for the time it takes."""

solve_rates = jax.jit(solve_image_rates)


def run(spec: BendingPostureSpec, context: Context) -> Results:
    """Render images, train networks in all ways, compare their markers with the true ones.

    Raises:
        UserError: no such chamber, or another float type than float64.
    """
    context.require_float64("bending-posture distinguishes small displacements")
    seed, out = context.seed, Report(spec, package=__package__)
    with one_thread():
        with context.step("The finger"):
            finger = SoftFinger.of(spec)
            chambers = {eta: _chamber(spec, eta) for eta in sorted(spec.etas)}
        most = max([spec.samples, *spec.counts])
        with context.step(f"{most + spec.unseen} images"):
            everything = by.sample_data(spec, finger, most, [spec.width, *spec.widths], seed)
        data, networks = everything.first(spec.samples), {}
        for way, settings in by.ways(spec, data, finger.length).items():
            with context.step(f"Trainings: {way}"):
                seeds = (replace(settings, seed=seed + i) for i in range(spec.seeds))
                networks[way] = [
                    train_network(one, data, spec.width, watch=way == by.OURS) for one in seeds
                ]
        estimators = [one.estimator for one in networks[by.OURS]]
        sweep = Records()
        for weight in REGULARISATIONS if spec.sweep else ():
            with context.step(f"L2 regularisation {weight:g}"):
                settings = Training(epochs=spec.epochs, regularisation=weight, seed=seed)
                error = train_network(settings, data, spec.width).tip_error
            sweep.add(regularisation=weight, tip_mean_mm=error)
        rows = [_time_mean(everything)]
        for width in sorted(spec.widths):
            for count in sorted(spec.counts):
                with context.step(f"{width} px wide, {count} samples"):
                    rows.append(_time_training(spec, everything, width, count, seed))
        etas = Records()
        for eta, chamber in chambers.items():
            with context.step(f"Chamber with η = {eta:g}"):
                etas.add(**measure_chamber(spec.model_copy(update={"eta": eta}), chamber, seed))
        with context.step("Other lamps and fingers"):
            others = measure_others(spec, finger, estimators, seed)
        with context.step("0.01° to 120°, and frames that are no proper images"):
            bends = measure_bends(finger, estimators[0], seed + 1)
            disturbed = answer_disturbances(finger, estimators[0], seed + 2)
        with context.step("Pictures and run time"):
            pictures = figures.draw_pictures(finger, size_of(spec.width), seed + 3)
            timed = np.deg2rad(np.linspace(0, spec.largest_bend_deg, TIMED))
            images = finger.renderer(seed + 4).render(finger.postures(timed, DOWN))
            seconds = median_seconds(lambda one: find_posture(one.pixels, estimators[0]), images)
    out.file(_save(estimators[0]))
    cores = many(usable_cores(), "core") + ", OpenCV on one thread"
    out.values(cores=cores, margin=MARGIN, labels=len(data.labels))
    paper = by.regularisations(data, finger.length)
    errors = collect_errors(networks, data)
    tips = summarize_trainings(errors, data.mean_error)
    out.metrics(mean_predictor_mm=data.mean_error)
    add_trainings(out, errors, tips, sweep, paper)
    add_sizes(out, spec, rows)
    add_others(out, errors.where(way=by.OURS), others)
    if len(etas):
        add_chambers(out, etas)
    add_robustness(out, bends, disturbed)
    out.metrics(unusable=data.unusable, frame_ms=1e3 * seconds)
    out.figure("pictures", pictures, size="{} × {}".format(*size_of(spec.width)))
    out.figure("dots", figures.draw_dots(networks, data))
    out.figure("markers", figures.draw_markers(errors))
    out.figure("learning", figures.draw_learning(estimators, data.mean_error))
    out.figure("ways", figures.draw_ways(tips, data.mean_error))
    out.figure("bends", figures.draw_bends(errors))
    if len(sweep):
        out.figure("regularisation", figures.draw_regularisation(sweep, paper))
    if len(etas):
        out.figure("etas", figures.draw_etas(etas))
    return out.results()


def _chamber(spec: BendingPostureSpec, eta: float) -> SoftFinger:
    try:
        return SoftFinger.of(spec.model_copy(update={"eta": eta}))
    except UserError as error:
        raise UserError(
            f"--set etas: no chamber with these dimensions has η = {eta:g}; leave it out"
        ) from error


def _save(estimator: PostureEstimator) -> SpecFile:
    words = "the trained network with its preprocessing and its training record, for "
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "posture.network"
        estimator.save(path)
        where = "`perception.posture.PostureEstimator.load`"
        return SpecFile("posture.network", words + where, path.read_bytes())


def _time_mean(data: Data) -> PrecisionRow:
    start = time.perf_counter()
    data.labels.mean(axis=0)
    seconds = time.perf_counter() - start
    return PrecisionRow(MEAN, "all samples", "training", 1.0, seconds, seconds, seconds, 0.0)


def _time_training(
    spec: BendingPostureSpec, everything: Data, width: int, count: int, seed: int
) -> PrecisionRow:
    """One training on the first samples, timed; what it compiles is part of its first epoch."""
    data = everything.first(count)
    one = train_network(Training(epochs=spec.epochs, seed=seed), data, width)
    seconds = np.diff(one.estimator.record.seconds, prepend=0.0)
    # Later epochs are alike; the first one more than these is compiling.
    epochs = seconds[1:] if len(seconds) > 1 else seconds
    total, low, high = (len(seconds) * float(f(epochs)) for f in (np.median, np.min, np.max))
    size, error = "{} × {} px".format(*size_of(width)), one.tip_error / data.mean_error
    compiling = max(float(seconds.sum()) - total, 0.0)
    setting = f"{count} samples"
    return PrecisionRow(size, setting, "training", error, total, low, high, compiling)


def measure_chamber(spec: BendingPostureSpec, finger: SoftFinger, seed: int) -> Records:
    """Tip error of every seed's training on images of a chamber, and what its images are like."""
    data = by.sample_data(spec, finger, spec.eta_samples, [spec.width], seed)
    settings = [Training(epochs=spec.epochs, seed=seed + i) for i in range(spec.seeds)]
    straight = finger.postures(np.zeros(1), np.zeros(1))
    [image] = finger.renderer(seed, severity=0.0).render(straight)
    blue, yellow, top = (float(np.ptp(outline[:, 0])) / 2 for outline in image.outlines)
    rates = solve_rates(finger.chamber, finger.endoscope, DOWN)
    return Records(
        {
            "eta": spec.eta,
            "blue_px": blue - yellow,
            "yellow_px": yellow - top,
            "yellow_px_per_deg": float(rates.value[1]) * np.pi / 180 if rates.ok else math.nan,
            "clearance_mm": float(clearance(finger.chamber)),
            "unusable": data.unusable,
            "tip_mm": [train_network(one, data, spec.width).tip_error for one in settings],
        }
    )


def measure_others(
    spec: BendingPostureSpec, finger: SoftFinger, networks: Sequence[PostureEstimator], seed: int
) -> Records:
    """Tip errors in the same random postures, under other lamps and in other fingers.

    Returns:
        A row for every frame and network; the error of an unusable frame is NaN.
    """
    rows, size = Records(), size_of(spec.width)
    for other, lamp, made in zip(OTHERS, (True, False, True), (False, True, True), strict=True):
        for draw in range(DRAWS):
            one = finger
            if made:
                one = finger.made(MadeSpec(), np.random.default_rng([seed, STREAM, draw, 1]))
            generator = np.random.default_rng([seed, STREAM, draw, 0])
            postures = random_postures(one, FRAMES, spec.largest_bend_deg, generator)
            pictures = {"seed": seed + LAMPS + draw if lamp else seed}
            seen = samples(one, postures, (size,), **pictures, first=FIRST + FRAMES * draw)
            for number, network in enumerate(networks):
                # All frames are read, so that one program serves every finger.
                tips = compute_marker_errors(network.predict(seen.images[size]), seen.markers)
                tips = np.where(seen.usable, tips[:, -1], np.nan)
                rows.add(other=other, draw=draw, network=number, tip_mm=tips)
    return rows


def measure_bends(finger: SoftFinger, estimator: PostureEstimator, seed: int) -> Records:
    """Tip errors from 0.01° to 120°, in frames with all effects; NaN without a posture."""
    bends = np.repeat(BENDS_DEG, REPEATED)

    def look(_: int, image: ChamberImage) -> Float[np.ndarray, "3 2"]:
        markers = find_posture(image.pixels, estimator).markers
        return np.full((3, 2), np.nan) if markers is None else markers

    found = robustness.view_bends(finger, BENDS_DEG, REPEATED, look, seed=seed)
    errors = compute_marker_errors(np.stack(found), marker_places(np.deg2rad(bends), finger.length))
    return Records({"bend_deg": bends, "tip_mm": errors[:, -1]})


def answer_disturbances(finger: SoftFinger, estimator: PostureEstimator, seed: int) -> Records:
    """Disturbed frames of every kind, at a few bends."""

    def answer(picture: Picture, kind: Disturbance, _: int) -> Answer:
        found = find_posture(picture, estimator)
        given = found.markers is not None
        return Answer(found.status, given, given is kind.usable)

    postures = finger.postures(np.deg2rad(DISTURBED_DEG), DOWN)
    return robustness.answer_disturbances(finger, postures, seed, answer)


def collect_errors(networks: Mapping[str, Sequence[Trained]], data: Data) -> Records:
    """A row for every unseen image and marker of every training."""
    errors, bends = Records(), np.rad2deg(data.unseen.bends)
    for way, trained in networks.items():
        for one in trained:
            record = one.estimator.record
            names = {"way": way, "seed": record.settings.seed, "seconds": record.total_seconds}
            for marker, own in zip(figures.MARKERS, one.errors.T, strict=True):
                errors.add(**names, marker=marker, bend_deg=bends, error_mm=own)
    return errors


def summarize_trainings(errors: Records, mean: float) -> Records:
    """A row for every training, with its tip error over that of the study's own from that seed."""
    tips = errors.where(marker="tip").summary(
        *("way", "seed", "seconds"), tip_mean_mm="mean error_mm", tip_p95_mm="p95 error_mm"
    )
    tip, ours = tips["tip_mean_mm"], tips.where(way=by.OURS)["tip_mean_mm"]
    ratios = tip / np.tile(ours, len(tip) // len(ours))
    return tips | {"ratio": ratios, "times_better_than_mean": mean / tip}


def compare_ratios(ratios: Float[np.ndarray, " seeds"]) -> str:
    """What tip errors over others, seed by seed, show of the first."""
    if ratios.min() >= MARGIN:
        return "worse"
    return "better" if ratios.max() <= 1 / MARGIN else "no different"


def add_trainings(
    out: Report, errors: Records, tips: Records, sweep: Records, paper: Mapping[str, float]
) -> None:
    """Tip errors of every way of training, and of the readings of the paper's regularisation."""
    ways = tips.summary(
        "way",
        tip_mean_mm="mean tip_mean_mm",
        least_ratio="min ratio",
        largest_ratio="max ratio",
        shown_to_be=lambda own: compare_ratios(own["ratio"]),
        ratios=lambda own: spread(own["ratio"], 2),
        tips=lambda own: spread(own["tip_mean_mm"], 2),
    )
    units = {"unit": list(paper), "regularisation": list(paper.values())}
    readings = ways.where(way=list(by.READINGS.values())) | units
    of, ours = ways.group("way"), tips.where(way=by.OURS)
    times, mean = ours["times_better_than_mean"], out["mean_predictor_mm"]
    for seed, tip in zip(ours["seed"], ours["tip_mean_mm"], strict=True):
        out.metric(f"tip_seed_{seed}_mm", tip, "tip_seed_mm", seed=seed)
    out.metrics(
        training_seconds=ours.stat("max seconds"),
        times_better_than_mean=times.min(),
        tip_p95_mm=ours.stat("mean tip_p95_mm"),
        equal_weights_tip_mm=of[by.EQUAL]["tip_mean_mm"][0],
        weighted_tip_mm=of[by.OURS]["tip_mean_mm"][0],
        kept_rate_ratio=of[by.KEPT]["least_ratio"][0],
        raw_images_ratio=of[by.RAW]["least_ratio"][0],
    )
    for unit, ratio in zip(paper, readings["least_ratio"], strict=True):
        out.metric(f"regularisation_{unit.replace(' ', '_')}_ratio", ratio)
    out.values(ours=of[by.OURS], equal=of[by.EQUAL], kept=of[by.KEPT], raw=of[by.RAW])
    out.values(**{unit.split()[-1]: own for unit, own in readings.group("unit").items()})
    values = {"times": spread(times, 0 if times.min() > 10 else 1)}
    values |= {"number": many(len(ours), "seed"), "seconds": spread(ours["seconds"], 2)}
    out.say("trained", **values)
    effect = {"worse": "help the tip, as in the paper", "better": "harm the tip here"}
    shown = effect.get(of[by.EQUAL]["shown_to_be"][0], "make no difference that is shown here")
    out.say("weights", shown=shown)
    out.say("readings")
    if len(sweep):
        best = np.argmin(sweep["tip_mean_mm"])
        out.say("sweep", weight=sweep["regularisation"][best], tip=sweep["tip_mean_mm"][best])
    out.say("rate")
    out.say("raw")
    table, blank = Records(), ("seconds", "tip_p95_mm", "times_better_than_mean", "ratio")
    table.add(way=MEAN, seed=[None], tip_mean_mm=mean, **dict.fromkeys(blank, math.nan))
    table.add(**tips)
    out.table("trainings", table)
    compared = errors.where(way=by.EQUAL)
    compared.add(**errors.where(way=by.OURS))
    whats = {"mean_mm": "mean error_mm", "deviation_mm": "sd error_mm", "p95_mm": "p95 error_mm"}
    out.table("markers", compared.summary("way", "marker", **whats))
    out.table("readings", readings)
    if len(sweep):
        out.table("regularisations", sweep)


def add_sizes(out: Report, spec: BendingPostureSpec, rows: Sequence[PrecisionRow]) -> None:
    """Error against training time, and the claim that more samples leave less of it."""
    mean, networks, claims = out["mean_predictor_mm"], rows[1:], []
    if networks:
        best = min(networks, key=lambda row: row.error)
        size, setting, seconds = best.method, best.setting, best.seconds
        out.say("sizes", size=size, setting=setting, tip=mean * best.error, seconds=seconds)
    counts = sorted(spec.counts)
    if networks and len(counts) > 1:
        evidence, holds = compare_counts(networks, mean)
        claims.append(out.claim("samples", evidence, holds, fewest=counts[0], most=counts[-1]))
    out.precision(rows, "relative tip error", REFERENCE, *claims)


def compare_counts(rows: Sequence[PrecisionRow], mean: float) -> tuple[list[str], bool]:
    """What networks reach at every image size, and whether the most samples leave the least error.

    Args:
        rows: of networks, at every size by rising number of samples.
        mean: tip error of the mean of the labels, of which errors are parts, mm.
    """
    holds, evidence = True, []
    for size in dict.fromkeys(row.method for row in rows):
        own = [row for row in rows if row.method == size]
        holds &= own[-1].error < own[0].error and all(row.error < 1 for row in own)
        tried = [f"{mean * row.error:.2f} mm in {row.seconds:.1f} s ({row.setting})" for row in own]
        evidence.append(f"{size}: {', '.join(tried)}.")
    return evidence, holds


def add_others(out: Report, ours: Records, others: Records) -> None:
    """Tip errors where something is other than in training."""
    tips, networks = ours.where(marker="tip"), len(ours.group("seed"))
    every = Records({"other": "nothing", "draw": 0, "tip_mm": tips["error_mm"]})
    every.add(**{name: others[name] for name in ("other", "draw", "tip_mm")})

    def worst(own: Records) -> float:
        known = own["other"][0] in OTHERS
        return own.summary("draw", mm="mean tip_mm").stat("max mm") if known else math.nan

    table = every.summary(
        "other",
        lamps_or_fingers=lambda own: len(own.group("draw")),
        frames=lambda own: len(own) // networks,
        usable=lambda own: int(np.isfinite(own["tip_mm"]).sum()) // networks,
        tip_mean_mm="mean tip_mm",
        tip_p95_mm="p95 tip_mm",
        worst_mean_mm=worst,
    )
    rows = table.where(other=list(OTHERS))
    for name, tip, usable in zip(OTHERS.values(), rows["tip_mean_mm"], rows["usable"], strict=True):
        out.metric(name, tip, images=usable, draws=DRAWS)
    if np.isfinite(rows["tip_mean_mm"]).all():
        out.say("others")
    out.table("elsewhere", table)


def compare_chambers(etas: Records) -> tuple[float, float, float] | None:
    """Whether one chamber reads the posture better than another; None if too few are known.

    Means over seeds of as many chambers are compared at once, for the best and the worst of several
    lie apart even if all are alike.

    Returns:
        The difference of the largest and the least mean, mm; the same in standard errors of a mean
        over the seeds, pooled over the chambers; and how many of these it would exceed in 5 % of
        the cases if all chambers were alike (Tukey's studentised range).
    """
    tips = [own["tip_mm"] for own in etas.group("eta").values()]
    seeds = min(map(len, tips))
    if len(tips) < 2 or seeds < 2:
        return None
    difference = float(np.ptp([one.mean() for one in tips]))
    error = math.sqrt(np.mean([one.var(ddof=1) for one in tips]) / seeds)
    limit = float(studentized_range.ppf(SURE, len(tips), len(tips) * (seeds - 1)))
    return difference, difference / max(error, 1e-12), limit


def add_chambers(out: Report, etas: Records) -> None:
    """Whether accuracy chooses η, and the paper's own criterion."""
    tips = {"tip_mean_mm": "mean tip_mm", "tip_least_mm": "min tip_mm", "tip_most_mm": "max tip_mm"}
    same = ("blue_px", "yellow_px", "yellow_px_per_deg", "clearance_mm")
    rows = etas.summary("eta", "unusable", **{name: f"max {name}" for name in same}, **tips)
    comparison, verdict = compare_chambers(etas), "eta-few"
    out.values(room=CLEARANCE, best=rows["eta"][np.argmin(rows["tip_mean_mm"])])
    for name, column in (("means", "tip_mean_mm"), ("rooms", "clearance_mm")):
        each = zip(rows["eta"], rows[column], strict=True)
        out.values(**{name: ", ".join(f"{value:.2f} mm at {eta:g}" for eta, value in each)})
    if comparison:
        difference, errors, limit = comparison
        out.values(limit=limit)
        out.metrics(eta_difference_mm=difference, eta_difference_errors=errors)
        verdict = "eta-apart" if errors > limit else "eta-alike"
    out.say(verdict)
    roomy = rows["eta"][rows["clearance_mm"] >= CLEARANCE]
    out.say("room-chosen" if len(roomy) else "room-none", largest=max(roomy, default=math.nan))
    out.table("etas", rows)


def add_robustness(out: Report, bends: Records, disturbed: Records) -> None:
    """Answers from 0.01° to 120° of bend, and to disturbed frames."""
    rows = bends.summary(
        "bend_deg",
        frames="count tip_mm",
        answered=lambda own: int(np.isfinite(own["tip_mm"]).sum()),
        tip_mean_mm="mean tip_mm",
        tip_most_mm="max tip_mm",
    )
    out.values(bent=len(bends), odd=len(disturbed))
    unanswered = len(bends) - rows.stat("sum answered")
    out.metrics(unanswered=unanswered, odd_failures=disturbed.stat("sum failed"))
    known = rows.where(rows["answered"] > 0)
    if len(known):
        worst = np.argmax(known["tip_mean_mm"])
        out.say("bends", tip=known["tip_mean_mm"][worst], bend=known["bend_deg"][worst])
    else:
        out.say("no-bends")
    out.say("odd")
    out.table("bends", rows)
    answers = robustness.summarize_disturbances(disturbed)
    expected = np.where(answers["usable"], "a posture", "none")
    out.table("odd_frames", answers | {"expected": expected, "with_posture": answers["given"]})
