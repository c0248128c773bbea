"""Compare random scenes with brute force, and judge extreme scenes by formulas in 50 digits.

Inputs of extreme scenes count from the camera and in units of the scene's size, so that an origin
far away excuses nothing, and y is what is exact for the inputs as they were rounded. Parts of a pad
and angles are judged relative to 1 + Σ|x_j ∂y/∂x_j|, what rounding the inputs and one end of a
piece would do (`designopt.study.stability`); entries of a gradient relative to its largest entry,
or by what they would do to y. Where surfaces or views just touch there is no derivative.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import mpmath
import numpy as np
from matplotlib.figure import Figure

from designopt.plot.figures import PALETTE, legend_below, new_figure
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.stability import DIGITS
from designopt.study.study import Context
from studies.oracles.extreme_scenes import STRUCTURE, Family, families
from studies.oracles.visibility import Views, views
from studies.stability import judging
from studies.stability.visibility import StabilitySpec
from studies.stability.visibility.comparison import compare
from studies.stability.visibility.scenes import PADS, Answers, ask, uneven

UNDECIDED = 64
"""How near to a change of its views, in units of rounding of its size, a scene is not judged."""

FLOOR = 1e-10
"""Deviations from the rays below it are drawn there."""


def run(spec: StabilitySpec, context: Context) -> Results:
    """Compare random scenes, then judge every family in both float types."""
    table, scenes = compare(spec, context)
    judged = Records()
    for dtype in judging.DTYPES[: 1 + spec.float32]:
        with context.step(f"Extreme scenes, {dtype}"):
            found = list(families(dtype, spec.family_cases))
            judged.add(**judge_families(found, dtype, spec.bounces))
    out = Report(spec, package=__package__)
    report(out, table, scenes, judged)
    out.figure("rays", draw_rays(spec, scenes))
    out.figure("approach", draw_approach(judged))
    return out.results()


def judge_families(found: Sequence[Family], dtype: str, bounces: int) -> Records:
    """Ask for all families at once, twice: for all gradients, and for the one that is judged.

    Args:
        found: the families.
        dtype: float type.
        bounces: most reflections of a path.

    Returns:
        Columns of `studies.stability.judging`, and ``clear``, how far each scene is from where its
        views change, of its size.
    """
    rows = [family.rows.astype(dtype) for family in found]
    with mpmath.workdps(DIGITS):
        exact = [
            [views(STRUCTURE, row, family.formula, bounces, family.smooth) for row in some]
            for family, some in zip(found, rows, strict=True)
        ]
    seen = np.array([case.views for cases in exact for case in cases])
    everything = ask(bounces, np.concatenate(rows))
    weights = {"coverage": 1.0, "seen": 1.0, "margin": seen}
    answers = ask(bounces, np.concatenate(rows), weights)
    judged, start = Records(), 0
    for family, cases in zip(found, exact, strict=True):
        part = slice(start, start := start + len(cases))
        columns = _judge(family, dtype, cases, answers.part(part))
        columns["non_finite"] = everything.part(part).non_finite + answers.part(part).non_finite
        columns["failed"] = judging.failed(columns, dtype)
        judged.add(case=family.case, dtype=dtype, **columns)
    return judged


def _judge(
    family: Family, dtype: str, exact: list[Views], answers: Answers
) -> dict[str, np.ndarray]:
    count, near = len(exact), UNDECIDED * judging.rounding(dtype)
    parts = [answers.numbers[name].reshape(count, -1) for name in ("coverage", "seen", "margin")]
    found = np.concatenate(parts, axis=1)
    seen, margin = np.array([case.views for case in exact]), answers.numbers["margin"]
    wrong = (answers.ok != seen) | np.where(seen, margin <= 0, margin > near)
    clear = np.broadcast_to(family.clear, count)
    errors = np.full((3, count), np.nan)
    shapes = {"coverage": (PADS,), "seen": seen.shape[1:], "margin": seen.shape[1:]}
    weights = np.concatenate([uneven(*item).reshape(-1) for item in shapes.items()])
    with mpmath.workdps(DIGITS):
        for index in np.flatnonzero(clear > near):
            answer = found[index], answers.gradient[index]
            errors[:, index] = exact[index].errors(*answer, weights)
    return {
        "infeasible": ~np.any(seen, axis=(1, 2)),
        "clear": clear,
        "value_error": errors[0],
        "gradient_error": errors[1] / family.steepness,
        "gradient_relative_error": errors[2],
        "wrong_verdict": (clear > near) & np.any(wrong, axis=(1, 2)),
    }


def report(out: Report, table: Records, scenes: Records, judged: Records) -> None:
    """Put down metrics, findings and tables."""
    fine = scenes.where(fine=True)
    coarse = scenes.where(fine=False)
    slopes = [table[name] for name in list(table.keys()) if name.startswith("worst_gradient")]
    out.values(
        extreme=len(judged),
        shot_again=table["shot_again"][0],
        most=" and ".join(map(str, table["bounces"])),
        differ=len(set(coarse["scene"][coarse["differ"]])),
        derivatives=table.stat("sum derivatives"),
        left_out=table.stat("sum left_out"),
        landings=table.stat("sum landings"),
    )
    out.metrics(
        random_disagreements=len(set(fine["scene"][fine["disagree"]])),
        worst_coverage_error=judging.largest(fine["off"]),
        wrong_verdicts=table.stat("sum wrong_verdicts") + judged.stat("sum wrong_verdict"),
        non_finite=scenes.stat("sum non_finite") + judged.stat("sum non_finite"),
        worst_gradient_error=judging.largest(np.array(slopes)),
        worst_landing=judging.largest(table["worst_landing_rad"]),
    )
    if out["float32"]:
        out.metrics(worst_float32_error=judging.largest(coarse["single"]))
    judging.report_cases(out, judged)
    out.say("rays")
    out.say("wrong" if out["bad"] else "sound")
    out.say("gradients")
    if out["float32"]:
        median, rare = np.quantile(coarse["single"], [0.5, 0.999])
        out.say("float32", median=median, rare=rare)
    judging.say_failures(out, judged, _verdict_faults)
    out.table("random", table)
    verdicts = judged.summary(
        *("case", "dtype"),
        scenes="count failed",
        show_nothing="sum infeasible",
        judged=lambda own: int(np.sum(~np.isnan(own["value_error"]))),
        wrong_verdicts="sum wrong_verdict",
        non_finite="sum non_finite",
    )
    out.table("verdicts", verdicts)


def _verdict_faults(own: Records) -> Iterator[str]:
    if count := own.stat("sum wrong_verdict"):
        yield f"{count} verdicts or signs of margins are wrong"


def draw_rays(spec: StabilitySpec, scenes: Records) -> Figure:
    """Deviations of coverages from the rays' beside what these leave open, and in float32."""
    drawing, [axes] = new_figure(1, 1 + spec.float32, height=3.6)
    most = scenes.where(bounces=spec.bounces)
    series = [
        (_deviations(most.where(fine=fine)[name]), f"{what} {rays:,} rays", PALETTE[fine], style)
        for fine, rays in enumerate((spec.rays, spec.fine_rays))
        for name, what, style in (("off", "off", "-"), ("step", "step of", ":"))
    ]
    judging.draw_counts(axes[0], "the part of a pad", "scenes", series)
    if spec.float32:
        groups = scenes.where(fine=False).group("bounces").items()
        series = [
            (_deviations(own["single"]), f"{count} bounce{'s' * (count > 1)}", color, "-")
            for (count, own), color in zip(groups, PALETTE, strict=False)
        ]
        judging.draw_counts(axes[1], "the error in float32", "scenes", series)
    return drawing


def _deviations(values: np.ndarray) -> np.ndarray:
    return np.maximum(values[values > 0], FLOOR)


def draw_approach(judged: Records) -> Figure:
    """Errors of single scenes over how far they are from degenerate."""
    drawing, [axes] = new_figure(1, 2, height=3.6)
    titles = {"value_error": "coverage, parts and margins", "gradient_error": "gradients"}
    for axis, (name, title) in zip(axes, titles.items(), strict=True):
        judging.draw_errors(axis, judged, "clear", name)
        axis.set(title=title, xlabel="distance from a change of views")
        axis.invert_xaxis()
    axes[0].set(ylabel="scaled error")
    legend_below(drawing, *axes[0].get_legend_handles_labels(), most=2)
    return drawing
