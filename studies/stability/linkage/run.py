"""Solve extreme and random linkages in both float types, and judge every answer.

Values are judged as in `designopt.study.stability`, a position as one plane vector (its larger
coordinate), so that the direction of the axes plays no part. Coordinates count from the first
fixed joint: where the world's origin is conditions nothing. A column of the gradient passes if its
error is small on either of two scales: what it would do to the position, as there, or what
rounding the inputs does to the column itself. The second is needed near lock-up: at a margin m of
the linkage's size the gradient grows as m^(−1/2), and a relative change ε of an input changes it
by ε / m of itself, whatever computes it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure

from designopt.study.plots import ecdf
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.stability import DIGITS
from designopt.study.study import Context
from studies.oracles import linkages as exact
from studies.stability import judging
from studies.stability.linkage import StabilitySpec, cases, mechanisms
from studies.stability.linkage.cases import Cases
from studies.stability.linkage.mechanisms import Mechanism, Solved

UNDECIDED = {"float64": 1e-12, "float32": 32 * judging.rounding("float32")}
"""Margins, in units of the linkage's size, up to which either verdict is accepted.

float32 cannot resolve 1e-12: there it is 32 units of rounding (3.8e-6), twice the 16 that the
library itself counts as touching, as the margin it compares with them is rounded as well.
"""

CLOSURE = {"float64": 1e-12, "float32": 64 * judging.rounding("float32")}
"""Largest gap of a pose that is marked ok, in units of the linkage's size."""

LEAST = 1e-4
"""Margins and errors of random linkages below it are drawn there."""

APPROACHES = ("stretching: margin 1e-1", "folding: margin 1e-1", "slider-crank, margin 1e-1")
"""Parts of the names of families that approach lock-up from inside."""


def run(spec: StabilitySpec, context: Context) -> Results:
    """Solve and judge every family in both float types."""
    judged = Records()
    for dtype in judging.DTYPES:
        for mechanism, batches in _workload(spec, context.seed, dtype):
            with context.step(f"{mechanism.name}, {dtype}"):
                judged.add(**assess(mechanism, batches))
    out = Report(spec, package=__package__)
    report(out, judged)
    approaching = [any(part in case for part in APPROACHES) for case in judged["case"]]
    out.figure("approach", draw_approach(judged.where(approaching)))
    out.figure("random", draw_random(_random(judged)))
    return out.results()


def _workload(
    spec: StabilitySpec, seed: int, dtype: str
) -> Iterator[tuple[Mechanism, list[Cases]]]:
    """Every mechanism with its families; those of one mechanism are solved in one call."""
    count, random = spec.family_cases, (spec.random_cases, spec.decades, seed)
    four_bars = [*cases.four_bars(dtype, count), cases.random_four_bars(dtype, *random)]
    yield mechanisms.four_bar(), four_bars
    sliders = [*cases.slider_cranks(dtype, count), cases.random_slider_cranks(dtype, *random)]
    yield mechanisms.slider_crank(), sliders
    if spec.triad:
        yield mechanisms.six_bar()[0], list(cases.six_bars(dtype))


def assess(mechanism: Mechanism, batches: Sequence[Cases]) -> Records:
    """Solve families of one mechanism in one call, and judge every case (`judge`)."""
    inputs = np.concatenate([batch.inputs for batch in batches])
    sides = np.concatenate([batch.sides for batch in batches])
    names = np.repeat([batch.case for batch in batches], [len(batch.sides) for batch in batches])
    judged = judge(mechanism, inputs, sides, mechanisms.solve(mechanism, inputs, sides))
    return Records({"case": names.tolist(), **judged})


def judge(mechanism: Mechanism, inputs: np.ndarray, sides: np.ndarray, solved: Solved) -> Records:
    """Judge a batch of solved cases.

    Args:
        mechanism: which.
        inputs: shape (cases, inputs), as they were solved.
        sides: shape (cases,).
        solved: the library's answers.

    Returns:
        Columns of `studies.stability.judging`, but for the families' names; ``margin``, exact, and
        ``residual``, as the library has it, in units of the linkage's size; ``gap``, how far the
        pins miss the dimensions, in units of the largest length or coordinate; ``gradient_size``,
        the largest entry of the gradient, each times its input, in units of size; ``ok``,
        ``undecided`` where either verdict is accepted, and ``open`` where a pose marked ok does
        not close.
    """
    dtype, answers = str(inputs.dtype), (solved.value, solved.gradient)
    errors = exact.scaled_errors(mechanism.formula, inputs, sides, answers, DIGITS)
    margin, ok = errors.margin, solved.ok
    exists, decided = ok & (margin > 0), ok & (margin > UNDECIDED[dtype])
    size = np.max(abs(inputs[:, :-1]), axis=1)
    effect = np.max(abs(solved.gradient.astype(float)), axis=1) * abs(inputs.astype(float))
    residual = solved.residual.astype(float)
    wide = exact.extended(inputs)
    gap = mechanism.formula.gaps(wide, solved.crank_pin, solved.value).astype(float)
    columns = {
        "margin": margin,
        "ok": ok,
        "infeasible": margin < 0,
        "undecided": abs(margin) <= UNDECIDED[dtype],
        "wrong_verdict": (abs(margin) > UNDECIDED[dtype]) & (ok != (margin > 0)),
        "open": ok & ~((residual <= CLOSURE[dtype]) & (gap <= CLOSURE[dtype])),
        "value_error": np.where(exists, errors.value, np.nan),
        "gradient_error": np.where(decided, errors.gradient, np.nan),
        "gradient_relative_error": np.where(decided, errors.gradient_relative, np.nan),
        "gradient_size": np.max(effect, axis=1) / np.where(size > 0, size, 1),
        "residual": residual,
        "gap": gap,
        "non_finite": solved.non_finite,
    }
    return Records(
        {"dtype": dtype, **columns, "failed": judging.failed(columns, dtype) | columns["open"]}
    )


def report(out: Report, judged: Records) -> None:
    """Put down metrics, findings and the table."""
    double = judged.where(dtype="float64")
    out.values(cases=len(judged), undecided=UNDECIDED, closure=CLOSURE)
    out.metrics(non_finite=judged.stat("sum non_finite"))
    for dtype in judging.DTYPES:
        wrong = judged.where(dtype=dtype).stat("sum wrong_verdict")
        out.metrics(**{f"wrong_verdicts_{dtype}": wrong})
    out.metrics(open_poses_float64=double.stat("sum open"), worst_closure_float64=_closure(double))
    judging.report_cases(out, judged)
    out.say("wrong" if out["bad"] else "sound")
    _say_random(out, _random(judged))
    judging.say_failures(out, judged, "open")
    verdicts = judged.summary(
        *("case", "dtype"),
        cases="count ok",
        infeasible="sum infeasible",
        marked_ok="sum ok",
        undecided="sum undecided",
        wrong_verdicts="sum wrong_verdict",
        open_poses="sum open",
        worst_residual=lambda own: judging.largest(own["residual"][own["ok"]]),
        worst_gap=lambda own: judging.largest(own["gap"][own["ok"]]),
        non_finite="sum non_finite",
    )
    out.table("verdicts", verdicts)


def _random(judged: Records) -> Records:
    return judged.where(np.char.endswith(judged["case"].astype(str), "random"))


def _closure(own: Records) -> float:
    """Largest gap of a pose marked ok, in units of size."""
    return judging.largest(np.maximum(own["residual"], own["gap"])[own["ok"]])


def _say_random(out: Report, random: Records) -> None:
    double = random.where(dtype="float64")
    shares = [
        f"{own.stat('share infeasible'):.0%} of {len(own)} {case.split(',')[0]}s"
        for case, own in double.group("case").items()
    ]
    out.say(
        "random",
        shares=" and ".join(shares),
        wrong=random.stat("sum wrong_verdict"),
        numbers=random.stat("sum non_finite"),
        gap=_closure(double),
    )
    worst = {
        f"{name}_{dtype}": judging.largest(own[name]) / judging.rounding(dtype)
        for dtype, own in random.group("dtype").items()
        for name in judging.LIMITS
    }
    out.say("accuracy", **worst)


def draw_approach(judged: Records) -> Figure:
    """Errors and gradient sizes of single cases over their exact margin."""
    titles = {"value_error": "errors of positions", "gradient_error": "errors of gradients"}
    titles["gradient_size"] = "largest gradient entry"
    drawing = judging.draw_approach(judged, "margin", titles)
    line = np.array([1e-16, 1e-1])
    sizes = drawing.axes[-1]
    sizes.plot(line, line**-0.5, color="0.35", linewidth=0.9, label="margin$^{-1/2}$")
    for axis in drawing.axes:
        axis.set(xlabel="exact margin, of the size")
    return drawing


def draw_random(random: Records) -> Figure:
    """Margins of the random linkages, and the errors of those that can be assembled."""
    shown = Records()
    for (case, dtype), own in random.group("case", "dtype").items():
        kind, margin = case.split(",")[0], own["margin"]
        if dtype == "float64":
            for word, which in (("can be assembled", margin > 0), ("cannot", margin < 0)):
                group = f"{kind}, {word}"
                shown.add(what="margin, of the size", group=group, magnitude=margin[which])
        errors = own["value_error"][own["ok"]] / judging.rounding(dtype)
        shown.add(what="error, units of rounding", group=f"{kind}, {dtype}", magnitude=errors)
    return ecdf(shown, "magnitude", by="group", panel="what", log="x", least=LEAST, height=3.4)
