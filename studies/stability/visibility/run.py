"""Compare random scenes with brute force, and judge extreme scenes by formulas in 50 digits.

Inputs of extreme scenes count from the camera and in units of the scene's size, so that an origin
far away excuses nothing, and y is what is exact for the inputs as they were rounded. Parts of a pad
and angles are judged relative to 1 + Σ|x_j ∂y/∂x_j|, what rounding the inputs and one end of a
piece would do (`designopt.study.stability`); entries of a gradient relative to its largest entry,
or by what they would do to y. Where surfaces or views just touch there is no derivative.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import mpmath
import numpy as np
from matplotlib.figure import Figure

from designopt.study.plots import ecdf
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.stability import DIGITS
from designopt.study.study import Context
from studies.oracles.extreme_scenes import STRUCTURE, Family, families
from studies.oracles.visibility import views
from studies.stability import judging
from studies.stability.visibility import StabilitySpec
from studies.stability.visibility.comparison import compare
from studies.stability.visibility.scenes import ask, uneven

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
            views(STRUCTURE, row, family.formula, bounces, family.smooth)
            for family, some in zip(found, rows, strict=True)
            for row in some
        ]

    def of_scenes(parts: Iterable[Any]) -> np.ndarray:
        """What families have one of, or one for each scene, for all scenes."""
        pairs = zip(parts, rows, strict=True)
        return np.concatenate([np.broadcast_to(part, len(some)) for part, some in pairs])

    seen, inputs = np.array([case.views for case in exact]), np.concatenate(rows)
    everything = ask(bounces, inputs)
    answers = ask(bounces, inputs, {"coverage": 1.0, "seen": 1.0, "margin": seen})
    numbers = {name: answers.numbers[name] for name in ("coverage", "seen", "margin")}
    values = np.concatenate([part.reshape(len(inputs), -1) for part in numbers.values()], axis=1)
    weights = [uneven(name, part.shape[1:]).reshape(-1) for name, part in numbers.items()]
    near, clear = UNDECIDED * judging.rounding(dtype), of_scenes(one.clear for one in found)
    errors = np.full((3, len(inputs)), np.nan)
    with mpmath.workdps(DIGITS):
        for index in np.flatnonzero(clear > near):
            answer = values[index], answers.gradient[index]
            errors[:, index] = exact[index].errors(*answer, np.concatenate(weights))
    margin = numbers["margin"]
    wrong = (answers.ok != seen) | np.where(seen, margin <= 0, margin > near)
    columns = {
        "infeasible": ~np.any(seen, axis=(1, 2)),
        "clear": clear,
        "value_error": errors[0],
        "gradient_error": errors[1] / of_scenes(one.steepness for one in found),
        "gradient_relative_error": errors[2],
        "wrong_verdict": (clear > near) & np.any(wrong, axis=(1, 2)),
        "non_finite": everything.non_finite + answers.non_finite,
    }
    columns["failed"] = judging.failed(columns, dtype)
    return Records({"case": of_scenes(one.case for one in found), "dtype": dtype, **columns})


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
    judging.say_failures(out, judged)
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


def draw_rays(spec: StabilitySpec, scenes: Records) -> Figure:
    """Deviations of coverages from the rays' beside what these leave open, and in float32."""
    shown, beside, single = Records(), "coverage beside rays", "coverage and parts in float32"
    most = scenes.where(bounces=spec.bounces)
    for fine, rays in enumerate((spec.rays, spec.fine_rays)):
        own = most.where(fine=fine)
        shown.add(what=beside, group=f"off {rays:,} rays", part_of_pad=own["off"])
        shown.add(what=beside, group=f"step of {rays:,} rays", part_of_pad=own["step"])
    if spec.float32:
        for count, own in scenes.where(fine=False).group("bounces").items():
            group = f"{count} bounce{'s' * (count > 1)}"
            shown.add(what=single, group=group, part_of_pad=own["single"])
    return ecdf(shown, "part_of_pad", by="group", panel="what", log="x", least=FLOOR, height=3.6)


def draw_approach(judged: Records) -> Figure:
    """Errors of single scenes over how far they are from degenerate."""
    titles = {"value_error": "coverage, parts and margins", "gradient_error": "gradients"}
    drawing = judging.draw_approach(judged, "clear", titles)
    for axis in drawing.axes:
        axis.set(xlabel="distance from a change of views", ylabel="scaled error")
    return drawing
