"""The study itself: from its spec to its results."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from designopt import Context, Records, Report, Results, UserError
from designopt.plot.figures import MARKERS, PALETTE, new_figure
from designopt.study import plots
from optics.chamber import bend_center_line
from optics.rendering import ChamberImage
from perception import posture
from perception.chamber import ChamberStatus
from perception.posture import USABLE, PostureEstimate, PostureEstimator
from studies.models.one_thread import median_seconds, one_thread
from studies.models.soft_finger import robustness
from studies.models.soft_finger.finger import DOWN, SoftFinger
from studies.models.soft_finger.grasp import Hand, bend_around, touched
from studies.models.soft_finger.robustness import Answer, Disturbance, Picture
from studies.models.soft_finger.samples import boundaries, random_postures, samples
from studies.object_size import ObjectSizeSpec, trials
from studies.object_size.trials import Reader, estimate

ERROR_MM = 3.0
"""Largest mean absolute error of a diameter."""

PLACES, LISTED, DRAWN = 241, 20, 8
"""Diameters of the curve, and every which of them is listed or drawn."""

TIMED = 40
"""Pictures whose way to a diameter is timed."""

TRAINING, BOTTLES, RANDOM, OTHER_LAMP = 5, 6, 7, 8
"""Streams of random numbers."""

BENDS_DEG = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 90.0, 110.0, 120.0)

DISTURBED_DEG = (10.0, 25.0, 50.0)
"""Bends of the finger in disturbed frames; yellow is in view at all of them."""

WITHIN = 5.0
"""How far a diameter may be off the bottle's, mm; more is another answer than the defined one."""

ALL = ("the bottles", "random", "random, another lamp")
"""Sets of grasps."""

WAYS = {
    "image and grasp": "error_mm",
    "grasp alone (true bend)": "grasp_error_mm",
    "image alone (true place)": "image_error_mm",
}
"""What may be off in a diameter, and the column of its errors."""

solve_bends = jax.jit(jax.vmap(bend_around, in_axes=(None, 0)))

BLUE, VERMILION, GREEN = PALETTE[:3]
GLASS, SKIN = "#D8E6EE", "#F3D9C8"


def run(spec: ObjectSizeSpec, context: Context) -> Results:
    """Train, grasp bottles, estimate their diameters, compare them with the true ones.

    Raises:
        UserError: no such chamber or grasp, or another float type than float64.
    """
    context.require_float64("object-size finds where a finger touches to a millionth of a mm")
    out, seed, rows = Report(spec, package=__package__), context.seed, Records()
    with one_thread():
        with context.step("The finger and its grasps"):
            finger = SoftFinger.of(spec)
            hand = trials.designed_hand(spec, finger.length)
            curve = curve_of(hand, spec)
        with context.step(f"{spec.samples} labelled images"):
            estimator = train_network(spec, finger, seed)
            reader = Reader(estimator, hand, spec.largest_residual)
        # The same seed as in training: the same finger, with the same lamp.
        bottles = np.repeat(spec.bottles, spec.grasps)
        numbers = np.cumsum([spec.samples, len(bottles), spec.random_grasps]).tolist()
        sets = (
            (bottles, BOTTLES, seed, numbers[0]),
            (_any_size(spec, spec.random_grasps, seed, RANDOM), RANDOM, seed, numbers[1]),
            (_any_size(spec, spec.other_lamp_grasps, seed, OTHER_LAMP), OTHER_LAMP, seed + 1, 0),
        )
        for name, (diameters, stream, lamp, first) in zip(ALL, sets, strict=True):
            with context.step(f"{len(diameters)} grasps, {name}"):
                generator = np.random.default_rng([seed, stream, 1])
                grasps = trials.sample_grasps(spec, finger, diameters, generator)
                own = trials.measure(reader, finger, grasps, lamp, first)
                rows.add(**(own | {"diameters": name}))
        with context.step("From 0.01° to 120°, and frames that are no proper images"):
            bends = answer_bends(finger, reader, spec.stability_images, seed)
            disturbed = answer_disturbed(finger, reader, seed)
        with context.step("Pictures and run time"):
            # The bottles in their places, pressed as in the mean.
            around = np.asarray(solve_bends(hand, jnp.asarray(spec.bottles)).value)
            images = finger.renderer(seed).render(finger.postures(around, DOWN), numbers[2])
            seconds = time_frame(finger, reader, seed, numbers[2] + len(images))
    add_grasps(out, rows)
    add_robustness(out, bends, disturbed)
    add_curve(out, curve, finger.length)
    out.values(trained=estimator.record.samples)
    out.metrics(training_seconds=estimator.record.total_seconds, frame_ms=1e3 * seconds)
    out.figure("grasps", draw_grasps(spec, hand, around), most=5)
    out.figure("pictures", draw_pictures(spec, images))
    return out.results()


def curve_of(hand: Hand, spec: ObjectSizeSpec) -> Records:
    """Diameter over bend from the least diameter to the largest, with every bottle in its place.

    Returns:
        ``diameter_mm``, ``bend_deg``, ``contact_mm`` (where along the finger the bottle touches)
        and ``mm_per_deg``, the derivative of the diameter by the bend.

    Raises:
        UserError: the finger does not touch one of them, or one of the bottles.
    """
    ends = min(spec.least, *spec.bottles), max(spec.largest, *spec.bottles)
    diameters = jnp.linspace(*ends, PLACES)
    solved = solve_bends(hand, diameters)
    if not bool(jnp.all(solved.ok)):
        number = int(jnp.argmin(solved.ok))
        raise UserError(
            f"a bottle of {float(diameters[number]):.1f} mm: {solved.messages()[number]} Change "
            "palm, gap, finger_radius or the diameters"
        )
    slopes = jax.jit(jax.vmap(jax.grad(lambda bend: touched(hand, bend).diameter)))
    touches = jax.jit(jax.vmap(touched, in_axes=(None, 0)))(hand, solved.value)
    return Records(
        {
            "diameter_mm": diameters,
            "bend_deg": np.rad2deg(solved.value),
            "contact_mm": touches.arc,
            "mm_per_deg": np.deg2rad(slopes(solved.value)),
        }
    )


def train_network(spec: ObjectSizeSpec, finger: SoftFinger, seed: int) -> PostureEstimator:
    """A network trained on the finger's own images, on those in which it is seen.

    Raises:
        UserError: there are none.
    """
    generator, size = np.random.default_rng([seed, TRAINING]), (spec.columns, spec.rows)
    postures = random_postures(finger, spec.samples, spec.largest_bend_deg, generator)
    seen = samples(finger, postures, (size,), seed=seed)
    kept = seen.usable
    if np.count_nonzero(kept) < 2:
        raise UserError(f"--set eta={spec.eta:g}: no picture of this chamber can be used")
    return posture.train(
        seen.images[size][kept], seen.markers[kept], posture.Training(epochs=spec.epochs, seed=seed)
    )


def _any_size(spec: ObjectSizeSpec, count: int, seed: int, stream: int) -> np.ndarray:
    return np.random.default_rng([seed, stream, 0]).uniform(spec.least, spec.largest, count)


def answer_bends(finger: SoftFinger, reader: Reader, frames: int, seed: int) -> Records:
    """Diameters from 0.01° to 120° of bend, in frames with all effects.

    Returns:
        A row for each frame: ``bend_deg``; ``held_mm``, what a finger so bent holds, NaN if
        nothing; ``estimate_mm``, NaN if undefined; ``failed``, as `is_other_answer` has it.
    """

    def look(_: int, image: ChamberImage) -> PostureEstimate:
        # Whatever is raised is a fault of perception, and fails as an unseen chamber does.
        try:
            return posture.find_posture(image.pixels, reader.estimator)
        except Exception:
            return PostureEstimate(ChamberStatus.NO_CHAMBER, None)

    seen = robustness.view_bends(finger, BENDS_DEG, frames, look, seed=seed)
    true = trials.diameters_of(reader.hands(len(BENDS_DEG)), jnp.deg2rad(jnp.asarray(BENDS_DEG)))
    held = np.repeat(np.where(true.ok, true.value, np.nan), frames)
    rows = estimate(seen, reader)
    usable = np.array([one.status in USABLE for one in seen])
    return rows | {
        "bend_deg": np.repeat(BENDS_DEG, frames),
        "held_mm": held,
        "failed": is_other_answer(usable, rows["known"], rows["estimate_mm"], held),
    }


def is_other_answer(
    usable: np.ndarray, known: np.ndarray, estimates: np.ndarray, held: np.ndarray
) -> np.ndarray:
    """Whether the answers to frames of a bent finger are other ones than the defined ones.

    All show the chamber. A finger that holds nothing has no diameter. One that holds a bottle has
    about that of the bottle, or none: the estimated bend may be off to where it holds nothing.
    """
    return ~usable | (known & ~(np.abs(estimates - held) <= WITHIN))


def answer_disturbed(finger: SoftFinger, reader: Reader, seed: int) -> Records:
    """Diameters from frames of every disturbance, at a few bends."""

    def answer(picture: Picture, kind: Disturbance, _: int) -> Answer:
        seen = posture.find_posture(picture, reader.estimator)
        own = estimate([seen], reader)
        known, diameter = bool(own["known"][0]), float(own["estimate_mm"][0])
        return judge_disturbed(kind, seen.status, known, diameter)

    postures = finger.postures(np.deg2rad(DISTURBED_DEG), DOWN)
    return robustness.answer_disturbances(finger, postures, seed, answer)


def judge_disturbed(
    kind: Disturbance, status: ChamberStatus, known: bool, diameter: float
) -> Answer:
    """The answer to one disturbed frame.

    Where the chamber is no longer seen there is no diameter. Where it is there is one, or the
    markers lie on no arc, or on one that holds nothing.
    """
    sound = kind.usable and math.isfinite(diameter) and diameter > 0
    return Answer(status, known, right=not known or sound)


def time_frame(finger: SoftFinger, reader: Reader, seed: int, first: int) -> float:
    """Median seconds from one picture to a diameter, one after the other."""
    bends = np.deg2rad(np.linspace(10, 100, TIMED))
    images = finger.renderer(seed).render(finger.postures(bends, DOWN), first)

    def measure(image: ChamberImage) -> Records:
        return estimate([posture.find_posture(image.pixels, reader.estimator)], reader)

    return median_seconds(measure, images)


def nearest_bottle(rows: Records, bottles: Sequence[float]) -> Int[np.ndarray, " grasps"]:
    """Number of the bottle with the nearest diameter; that of bottles if there is no answer."""
    off = np.abs(rows["estimate_mm"][:, None] - np.asarray(bottles))
    return np.where(rows["known"], np.argmin(off, axis=1), len(bottles))


def add_grasps(out: Report, rows: Records) -> None:
    """Diameters of all grasps, which bottles are identified by them, and where errors come from."""
    sets, bottles = rows.group("diameters"), out["bottles"]
    told, random, other = (sets[name] for name in ALL)
    own, taken = told["diameter_mm"], nearest_bottle(told, bottles)
    counts = np.array(
        [np.bincount(taken[own == one], minlength=len(bottles) + 1) for one in bottles]
    )
    usual, right = rows.where(diameters=ALL[:2]), int(np.trace(counts))
    known = {name: part.stat("sum known") for name, part in sets.items()}
    undefined = len(usual) - usual.stat("sum known")
    out.values(largest_error=ERROR_MM, trials=len(usual))
    out.values(bottle_grasps=len(told), all_grasps=len(rows))
    out.metrics(
        mean_absolute_error_mm=random.stat("mean_abs error_mm"),
        told_apart=right / len(told),
        bias_mm=random.stat("mean error_mm"),
        p95_mm=random.stat("p95_abs error_mm"),
        grasp_error_mm=random.stat("mean_abs grasp_error_mm"),
        image_error_mm=random.stat("mean_abs image_error_mm"),
        undefined=undefined,
        redrawn=rows.stat("sum redrawn"),
        other_lamp_error_mm=other.stat("mean_abs error_mm"),
        other_lamp_image_error_mm=other.stat("mean_abs image_error_mm"),
        other_lamp_undefined=len(other) - known[ALL[2]],
        tip_error_mm=usual.stat("mean tip_error_mm"),
        bend_error_deg=usual.stat("rms bend_error_deg"),
        largest_bend_error_deg=usual.stat("max_abs bend_error_deg"),
        largest_residual_mm=usual.stat("max residual_mm"),
    )
    names = [f"{one:g}" for one in bottles]
    out.say("bottles", names=f"{', '.join(names[:-1])} and {names[-1]}", right=right)
    out.say("random", known=known[ALL[1]])
    out.say("budget")
    out.say("undefined" if undefined else "all-defined")
    out.say("other-lamp", known=known[ALL[2]])
    columns = {f"taken_for_{name}_mm": counts[:, i] for i, name in enumerate(names)}
    out.table("confusion", bottle_mm=bottles, **columns, undefined=counts[:, -1])
    out.table("bottles", tabulate_bottles(told))
    out.table("budget", tabulate_budget(sets))
    out.figure("estimates", draw_estimates(random, (out["least"], out["largest"])))
    out.figure("confusion", draw_confusion(told, bottles, counts))


def tabulate_bottles(told: Records) -> Records:
    """What was estimated of each bottle; means over the grasps with an answer."""
    names = ("bend_deg", "estimated_bend_deg", "bend_error_deg", "contact_mm", "residual_mm")
    known = {name: np.where(told["known"], told[name], np.nan) for name in names}
    return (told | known | {"bottle_mm": told["diameter_mm"]}).summary(
        "bottle_mm",
        answers="sum known",
        estimate_mm="mean estimate_mm",
        deviation_mm="sd estimate_mm",
        absolute_error_mm="mean_abs error_mm",
        bend_deg="mean bend_deg",
        estimated_bend_deg="mean estimated_bend_deg",
        bend_rms_error_deg="rms bend_error_deg",
        contact_mm="mean contact_mm",
        marker_residual_mm="mean residual_mm",
    )


def tabulate_budget(sets: dict[str, Records]) -> Records:
    """Errors of all sets of grasps, by what is off in them."""
    rows, kept = Records(), ("diameters", "redrawn", "known")
    for own in sets.values():
        for way, column in WAYS.items():
            rows.add(what_is_off=way, off_mm=own[column], **{name: own[name] for name in kept})
    return rows.summary(
        "diameters",
        "what_is_off",
        grasps="count off_mm",
        redrawn="sum redrawn",
        answers="sum known",
        absolute_error_mm="mean_abs off_mm",
        bias_mm="mean off_mm",
        deviation_mm="sd off_mm",
        p95_mm="p95_abs off_mm",
    )


def add_curve(out: Report, curve: Records, length: float) -> None:
    """Diameter over bend, and the resolution."""
    slopes = np.abs(curve["mm_per_deg"])
    out.metrics(least_mm_per_deg=slopes.min(), largest_mm_per_deg=slopes.max())
    tip = curve["contact_mm"] >= length
    values = {"sizes": curve["diameter_mm"][[0, -1]], "bends": curve["bend_deg"][[0, -1]]}
    if np.any(curve["mm_per_deg"] >= 0):
        out.say("not-unique", **values)
    elif tip.any() and not tip.all():
        out.say("curve-tip", **values, tip=curve["diameter_mm"][tip][-1])
    else:
        out.say("curve", **values)
    out.table("curve", curve.where(np.arange(PLACES) % LISTED == 0))
    out.figure("curve", draw_curve(curve, tip, out["bottles"]))


def add_robustness(out: Report, bends: Records, disturbed: Records) -> None:
    """Answers from nearly straight to far bent, and to frames that are no proper images."""
    frames = len(bends) + len(disturbed)
    failed = bends.stat("sum failed") + disturbed.stat("sum failed")
    out.metric("odd_failures", failed, frames=frames)
    wrong = f"{failed} answers not defined for them"
    answered = wrong if failed else "the answer defined for them, each"
    out.say("disturbed", frames=frames, answered=answered)
    table = bends.summary(
        "bend_deg",
        held_mm="mean held_mm",
        frames="count known",
        undefined=lambda own: len(own) - own.stat("sum known"),
        least_estimate_mm="min estimate_mm",
        largest_estimate_mm="max estimate_mm",
        failures="sum failed",
    )
    out.table("bends", table)
    kinds = robustness.summarize_disturbances(disturbed)
    expected = np.where(kinds["usable"], "a diameter, or a bend of none", "undefined")
    out.table("odd_frames", kinds | {"expected": expected, "with_diameter": kinds["given"]})


def draw_grasps(spec: ObjectSizeSpec, hand: Hand, bends: np.ndarray) -> Figure:
    """Finger, palm and bottle to scale."""
    columns = min(4, len(bends))
    rows = -(-len(bends) // columns)
    drawing, grid = new_figure(rows, columns, height=2.1 * rows + 0.5)
    reach = spec.palm + max(spec.bottles) / 2 + 4
    top = max(float(hand.length), spec.gap + max(spec.bottles)) + spec.finger_radius
    for axes in grid.flat[len(bends) :]:
        axes.set_axis_off()
    for axes, diameter, bend in zip(grid.flat, spec.bottles, bends, strict=False):
        draw_grasp(axes, spec, hand, diameter, bend)
        axes.plot([spec.finger_radius, reach], [spec.gap] * 2, color="0.35", lw=2.5, label="palm")
        axes.set(title=f"{diameter:g} mm: bend {np.rad2deg(bend):.0f}°", xlabel="x (mm)")
        axes.set(xlim=(-spec.finger_radius - 4, reach), ylim=(min(spec.gap, 0) - 12, top + 4))
        axes.set_aspect("equal")
        axes.grid(visible=False)
    for axes in grid[:, 0]:
        axes.set_ylabel("z (mm)")
    return drawing


def draw_grasp(axes: Axes, spec: ObjectSizeSpec, hand: Hand, diameter: float, bend: float) -> None:
    """The finger's skin and centre line, the bottle and where they touch."""
    arc = touched(hand, jnp.asarray(bend)).arc
    arcs = jnp.append(jnp.linspace(0, hand.length, 101), arc)
    line = bend_center_line(arcs, jnp.asarray(bend), hand.length)
    places, turned = np.array([line.across, line.along]), np.asarray(line.turned)
    normal = spec.finger_radius * np.array([np.cos(turned), -np.sin(turned)])
    inner, outer = ((places + sign * normal)[:, :-1] for sign in (1, -1))
    # About the tip, from the outer side over the way ahead to the inner side.
    around = np.linspace(np.pi, 0, 31)
    ahead = spec.finger_radius * np.array([[np.sin(turned[-2])], [np.cos(turned[-2])]])
    tip = places[:, -2:-1] + np.cos(around) * normal[:, -2:-1] + np.sin(around) * ahead
    skin = np.concatenate([outer, tip, inner[:, ::-1]], axis=1).T
    axes.add_patch(Polygon(skin, facecolor=SKIN, edgecolor=VERMILION, label="finger"))
    center = (spec.palm, spec.gap + diameter / 2)
    axes.add_patch(Circle(center, diameter / 2, facecolor=GLASS, edgecolor=BLUE, label="bottle"))
    axes.plot(*places[:, :-1], "--", color="black", linewidth=0.9, label="centre line")
    away = center - places[:, -1]
    contact = places[:, -1] + away / np.hypot(*away) * float(hand.radius)
    axes.plot(*contact, "x", color="black", markeredgewidth=1.5, label="contact")


def draw_pictures(spec: ObjectSizeSpec, images: Sequence[ChamberImage]) -> Figure:
    """The paper's Fig. 13, and what the network is given."""
    size = (spec.columns, spec.rows)
    drawing, grid = new_figure(2, len(images), height=3.3)
    for (above, below), diameter, image in zip(grid.T, spec.bottles, images, strict=True):
        [boundary], _ = boundaries(image, (size,))
        above.imshow(image.pixels)
        above.set_title(f"{diameter:g} mm")
        below.imshow(boundary, cmap="gray", interpolation="nearest")
        below.set_title("boundaries, {} × {} px".format(*size), fontsize=8)
        for axes in (above, below):
            axes.set(xticks=[], yticks=[])
            axes.grid(visible=False)
    return drawing


def draw_estimates(random: Records, sizes: tuple[float, float]) -> Figure:
    """Estimated over true diameters, and where errors come from."""
    drawing, [[left, right]] = new_figure(1, 2, height=3.9)
    known = random.where(random["known"])
    truth, estimates = known["diameter_mm"], known["estimate_mm"]
    shown = np.concatenate([truth, estimates, np.array(sizes)])
    ends = np.array([shown.min() - 3, shown.max() + 3])
    band = ends - ERROR_MM, ends + ERROR_MM
    left.fill_between(ends, *band, color="0.9", label=f"± {ERROR_MM:g} mm")
    left.plot(ends, ends, color="black", linewidth=0.9, label="as it is")
    left.plot(truth, estimates, "o", color=BLUE, markersize=3, label="a grasp")
    left.set(xlim=ends, ylim=ends, aspect="equal", title=f"{len(truth)} grasps")
    left.set(xlabel="diameter (mm)", ylabel="estimate (mm)")
    for (way, column), color, style in zip(WAYS.items(), PALETTE, ("-", "--", "-."), strict=False):
        size = np.sort(np.abs(known[column]))
        part = 100 * np.arange(1, len(size) + 1) / max(len(size), 1)
        right.plot(size, part, style, color=color, label=way.partition(" (")[0])
    right.axvline(ERROR_MM, color="0.6", linewidth=0.9, linestyle=":")
    right.set(xlabel="absolute error (mm)", ylabel="grasps with no larger error (%)")
    right.set(title="What is off", xlim=(0, None), ylim=(0, 101))
    right.set_box_aspect(1)
    return drawing


def draw_confusion(told: Records, bottles: Sequence[float], counts: np.ndarray) -> Figure:
    """Which bottle was taken for which."""
    names = [f"{diameter:g}" for diameter in bottles]
    drawing, [[left, right]] = new_figure(1, 2, height=3.4, width_ratios=(1, 1.25))
    plots.heat(left, counts, names, [*names, "none"])
    left.set(xlabel="taken for (mm)", ylabel="bottle (mm)", title="Grasps by answer")
    known = told.where(told["known"]).group("diameter_mm")
    for number, (diameter, own) in enumerate(known.items()):
        # Spread downwards by their order, so that points do not hide each other.
        height = number + np.linspace(-0.3, 0.3, len(own))
        style = {"color": PALETTE[number % len(PALETTE)], "markersize": 3}
        right.plot(own["estimate_mm"], height, MARKERS[number % len(MARKERS)], **style)
        right.plot([diameter] * 2, [number - 0.4, number + 0.4], color="black", linewidth=0.9)
    for low, high in itertools.pairwise(bottles):
        right.axvline((low + high) / 2, color="0.6", linewidth=0.9, linestyle=":")
    right.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.4, -0.6))
    right.set(xlabel="estimate (mm)", title="Estimates of each bottle")
    return drawing


def draw_curve(curve: Records, tip: np.ndarray, bottles: Sequence[float]) -> Figure:
    """Diameter over bend, and the resolution."""
    diameters, bends = curve["diameter_mm"], curve["bend_deg"]
    touching = np.where(tip, "touches the tip", "touches before the tip")
    curve |= {"touching": touching, "mm_per_deg": np.abs(curve["mm_per_deg"])}
    columns, names = ("diameter_mm", "mm_per_deg"), {"mm_per_deg": "diameter per bend (mm/°)"}
    drawn = curve.where(np.arange(PLACES) % DRAWN == 0)
    drawing = plots.lines(drawn, "bend_deg", columns, by="touching", names=names)
    at = np.interp(bottles, diameters, bends)
    for axes, column in zip(drawing.axes, columns, strict=True):
        own = np.interp(bottles, diameters, curve[column])
        axes.plot(at, own, "o", color="black", label="the bottles")
    for place, size in zip(at, bottles, strict=True):
        drawing.axes[0].annotate(f"{size:g} mm", (place, size), (6, 3), textcoords="offset points")
    drawing.axes[1].set_ylim(0, None)
    return drawing
