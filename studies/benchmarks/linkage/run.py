"""The study itself: from its spec to its results."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from designopt.study import plots
from designopt.study.benchmark import find_undominated
from designopt.study.left_out import count_operations
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Claim, LeftOutRow, PrecisionStudy, Results
from designopt.study.study import Context
from kinematics import Linkage, read_linkage, solve_poses
from studies.benchmarks.linkage import LinkagePrecisionSpec
from studies.benchmarks.linkage import methods as by
from studies.benchmarks.linkage.cases import CASES, GALLERY, linkage_of
from studies.benchmarks.measuring import (
    in_fresh_processes,
    key,
    listed,
    measure,
    ratio,
    say_cores,
    spans,
)

ERROR = "worst error over the linkage's size"
REFERENCE = (
    f"trigonometry in {by.DIGITS} digits for dimensions and angles in double precision, on evenly "
    "spaced poses; a gradient's error is that of its worst entry over its largest one"
)
SHORT_SWEEPS = (1, 360, 10_000)
"""Sweeps beside the longest one."""

CLOSE = 1e-9
"""An answer with a larger error does not compete for being the fastest."""

LEAST_RATIOS = {
    ("four-bar", by.MECHANISM): ("over_mechanism", 1500.0),
    ("four-bar", by.FSOLVE): ("over_fsolve", 300.0),
    ("four-bar", by.PYLINKAGE_FAST): ("over_pylinkage", 2.0),
    ("four-bar", by.FLOOR): ("of_sin_cos", 0.35),
    ("six-bar", by.PYLINKAGE_FAST): ("over_pylinkage", 2.0),
}
"""By linkage and method the metric's name and the least run time over that of the closed form."""

MOST_PACKED_RATIO = 1.5
MOST_GRADIENT = 4.0
FIRST_CALLS = {"four-bar": ("0, 360", 1.5), "finger": ("0, -90", 3.0)}
"""By file of the gallery the range of each input, degrees, and the target in seconds."""


def run(spec: LinkagePrecisionSpec, context: Context) -> Results:
    """Time and check every method on one core, and compare their run times."""
    out, rows = Report(spec, package=__package__), Records()
    for work in context.each(workloads(spec), lambda work: work.panel):
        with jax.enable_x64(work.dtype == "float64"):
            entered = by.methods(work, peers=spec.peers, optimistix=spec.optimistix)
            asked = "gradient" if work.gradient else "poses"
            columns = {"linkage": work.case.name, "poses": work.poses, "dtype": work.dtype}
            columns |= {"asked": asked, "longest": work.longest}
            rows.add(**measure(entered, spec.repeats, **columns))
    main = rows.where(dtype="float64", longest=True)
    ratios = compare_times(main)
    claims = add_speed(out, main, ratios)
    add_short_sweeps(out, rows.where(longest=False))
    claims += add_packed(out, rows.where(dtype="float64", asked="poses"))
    claims += add_gradients(out, ratios.where(asked="gradient"))
    with context.step("First calls in fresh processes"):
        claims += add_first_calls(out, spec.first_call)
    ours = rows.where(method=by.OURS, dtype="float64")
    out.metrics(closed_form_worst_error=ours.stat("max error"))
    if not np.isin(rows["method"], (by.MECHANISM, by.PYLINKAGE_FAST)).any():
        out.say("no-peers")
    say_cores(out)
    out.precision(list(main["row"]), ERROR, REFERENCE, *claims)
    out.table("all_rows", rows)
    out.table("ratios", ratios)
    add_figures(out, rows)
    with context.step("Operations left out"):
        out.left_out(operations())
    return out.results()


def workloads(spec: LinkagePrecisionSpec) -> list[by.Workload]:
    """The sweeps that a spec asks for: all lengths for the poses, the longest for the rest."""
    works = []
    for case in (case for case in CASES if spec.linkage in ("all", case.name)):
        short = [poses for poses in SHORT_SWEEPS if poses < spec.poses]
        works += [by.Workload(case, poses, longest=False) for poses in short]
        for dtype in ("float64", "float32") if spec.float32 else ("float64",):
            for gradient in (False, True) if spec.gradients else (False,):
                works.append(by.Workload(case, spec.poses, dtype, gradient))
    return works


def first_call(name: str) -> list[float]:
    """Seconds of tracing, compiling and solving 361 poses of a gallery's file, in processes."""
    prepare = (
        "import jax.numpy as jnp\nfrom kinematics import read_linkage, solve_poses\n"
        f"linkage = read_linkage({str(GALLERY / (name + '.toml'))!r})\n"
        f"sweep = jnp.deg2rad(jnp.linspace({FIRST_CALLS[name][0]}, 361))\n"
        "inputs = jnp.stack([sweep] * len(linkage.input_names), axis=-1)\n"
        "jax.block_until_ready(inputs)"
    )
    return in_fresh_processes(
        prepare, "jax.block_until_ready(jax.jit(solve_poses)(linkage, inputs))"
    )


def operations() -> list[LeftOutRow]:
    """Operation counts of programs that leave something out beside the general ones."""
    dtype = str(jax.dtypes.canonicalize_dtype(float))

    def count(linkage: Linkage, of: Sequence[str] | None = None) -> int:
        inputs = jnp.zeros((360, len(linkage.input_names)), dtype)
        return count_operations(lambda *args: solve_poses(*args, of=of), linkage, inputs)

    six_bar = linkage_of(CASES[-1], dtype)
    # The same finger twice: what is asked of one is what drives the other.
    fingers = [read_linkage(GALLERY / f"{name}.toml") for name in ("finger", "finger-crank")]
    loop = "the second loop: B does not depend on it"
    iteration = "the iteration: the same finger driven by its crank has no closed form"
    return [
        LeftOutRow("place of B on the six-bar", loop, count(six_bar, ["B"]), count(six_bar)),
        LeftOutRow(
            "all poses of the finger, driven at its joints", iteration, *map(count, fingers)
        ),
    ]


def compare_times(rows: Records) -> Records:
    """Ratios of run times: of methods over the closed form, of its gradient over its value."""
    ratios, rivals = Records(), (by.FLOOR, by.FSOLVE, by.MECHANISM, by.PYLINKAGE_FAST)
    for (name, asked), own in rows.group("linkage", "asked").items():
        timed = {method: list(part["row"]) for method, part in own.group("method").items()}
        base, methods = (by.VALUE, (by.OURS,)) if asked == "gradient" else (by.OURS, rivals)
        for method in (method for method in methods if method in timed):
            row = timed[method][method == by.FSOLVE]  # SciPy's own tolerance is the second one
            both = ratio(row, timed[base][0])
            ratios.add(linkage=name, method=method, asked=asked, pair=f"{name}, {method}", **both)
    return ratios


def add_speed(out: Report, rows: Records, ratios: Records) -> list[Claim]:
    """How fast the closed form is, beside other methods."""
    judged, holds = [], True
    for (case, method), (end, least) in LEAST_RATIOS.items():
        found = ratios.where(linkage=case, method=method)
        value = found["ratio"][0] if len(found) else None
        name, words = f"{key(case)}_{end}", {"case": case, "method": method, "least": least}
        out.metric(name, value, "over_closed_form", **words)
        out.values(**{f"least_{name}": least})
        judged += spans(found, "pair")
        holds &= value is None or value >= least
    for case, own in rows.where(method=by.OURS, asked="poses").group("linkage").items():
        others = ratios.where(linkage=case, asked="poses")
        floor, *rivals = zip(others["method"], others["ratio"], strict=True)
        parts = listed([f"{value:.3g} times as fast as {method}" for method, value in rivals])
        [seconds], [error] = own["seconds"], own["error"]
        words = {"ms": 1e3 * seconds, "rate": out["poses"] / seconds / 1e6, "error": error}
        out.say("speed", case=case, others=parts, floor=floor[1], **words)
    compared = rows.where(~np.isin(rows["method"], (by.FLOOR, by.VALUE, by.PACKED)))
    closest = find_undominated(list(compared["row"]), by.OURS)
    fast = [out.claim("speed", judged, bool(holds))] if judged else []
    return [*fast, out.claim("closed-form", *closest)]


def add_short_sweeps(out: Report, rows: Records) -> None:
    """The fastest method of each short sweep."""
    for poses, own in rows.group("poses").items():
        winners = [name_fastest(case, part) for case, part in own.group("linkage").items()]
        out.say("fastest", sweep=words_for(poses), winners="; ".join(winners))


def add_packed(out: Report, rows: Records) -> list[Claim]:
    """The packed call beside pylinkage's fast steps."""
    ratios = Records()
    for (poses, case), own in rows.group("poses", "linkage").items():
        packed, fast = (own.where(method=name)["row"] for name in (by.PACKED, by.PYLINKAGE_FAST))
        if not len(packed):
            continue
        both = ratio(packed[0], fast[0]) if len(fast) else None
        words = {"case": case, "sweep": words_for(poses), "most": MOST_PACKED_RATIO}
        name = f"{key(case)}_{poses}_packed_over_pylinkage"
        out.metric(name, both and both["ratio"], "packed_over_pylinkage", **words)
        if both:
            ratios.add(pair=f"{case}, {words_for(poses)}", **both)
    if not len(ratios):
        return []
    holds = ratios["ratio"].max() <= MOST_PACKED_RATIO
    return [out.claim("packed", spans(ratios, "pair"), bool(holds), most=MOST_PACKED_RATIO)]


def words_for(poses: int) -> str:
    """A sweep by its number of poses."""
    return "one pose" if poses == 1 else f"{poses:,} poses"


def name_fastest(case: str, rows: Records) -> str:
    """The fastest method with a small error, beside a closed form, or that beside the next."""
    closed = (by.OURS, by.PACKED)
    counts = (rows["error"] <= CLOSE) | np.isin(rows["method"], closed)
    close = rows.where(counts & (rows["method"] != by.FLOOR))
    first, *rest = sorted(close["row"], key=lambda row: row.seconds)
    ours = first.method in closed
    others = [row for row in rest if (row.method in closed) != ours]
    text = f"{case}, {first.method} ({1e6 * first.seconds:.3g} µs"
    if others:
        more = f"{others[0].seconds / first.seconds:.2g} times as long"
        text += f", next {others[0].method}, {more}" if ours else f"; the closed form takes {more}"
    return text + ")"


def add_gradients(out: Report, ratios: Records) -> list[Claim]:
    """What the closed form's gradient costs."""
    columns = list(zip(ratios["linkage"], ratios["ratio"], strict=True))
    for case, value in columns:
        words = {"case": case, "most": MOST_GRADIENT}
        out.metric(f"{key(case)}_gradient_over_value", value, "gradient_over_value", **words)
    if not columns:
        return []
    out.say("gradient", parts=listed([f"{value:.2f} for the {case}" for case, value in columns]))
    holds = ratios["ratio"].max() <= MOST_GRADIENT
    return [out.claim("gradient", spans(ratios, "linkage"), bool(holds), most=MOST_GRADIENT)]


def add_first_calls(out: Report, measured: bool) -> list[Claim]:
    """How long the first call of a fresh process takes."""
    calls, parts, evidence, holds = Records(), [], [], True
    for name, (_, most) in FIRST_CALLS.items():
        seconds = first_call(name) if measured else []
        calls.add(linkage=name, process=np.arange(len(seconds)) + 1, seconds=seconds)
        median = statistics.median(seconds) if seconds else None
        out.metric(f"{key(name)}_first_call_s", median, "first_call_s", case=name, most=most)
        out.values(**{f"most_{key(name)}_s": most})
        if median is not None:
            parts.append(f"{median:.2f} s for {name}")
            times = ", ".join(f"{one:.2f}" for one in seconds)
            evidence.append(f"{name}: {median:.2f} s (of {times})")
            holds &= median <= most
    out.table("first_calls", calls)
    if not measured:
        return []
    out.say("first-call", parts=listed(parts))
    return [out.claim("first-call", evidence, holds)]


def add_figures(out: Report, rows: Records) -> None:
    """Poses per second, and the rows for which the report's own figure has no room."""
    poses = rows.where(dtype="float64", asked="poses")
    close = poses.where(poses["error"] <= CLOSE)
    rates = close | {"rate": close["poses"] / close["seconds"]}
    columns: dict[str, Any] = {"by": "method", "panel": "linkage", "stat": "max"}
    names = {"poses": "poses of the sweep", "rate": "poses per second"}
    drawing = plots.lines(rates, "poses", "rate", **columns, log="xy", names=names, height=4.4)
    for axes in drawing.axes:
        axes.set(xscale="log", yscale="log")  # with powers of ten at their ticks
        for line in (line for line in axes.lines if line.get_label() == by.FLOOR):
            line.set(color="0.4", linestyle="--", marker="")
    out.figure("throughput", drawing)
    further = {
        "precision_float32": rows.where(dtype="float32"),
        "precision_short": rows.where(~rows["longest"] & (rows["poses"] < 1000)),
    }
    for name, part in further.items():
        if len(part):
            study = PrecisionStudy(list(part["row"]), ERROR, REFERENCE, [])
            out.figure(name, plots.precision(study))
