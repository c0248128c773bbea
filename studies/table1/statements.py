"""What the study says: its findings in sentences and its metrics with their targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from designopt.solution import Solution
from designopt.study.results import Metric, StabilityRow, Target
from studies.models.soft_finger import paper
from studies.models.soft_finger.chamber_spec import ChamberSpec
from studies.models.soft_finger.imaging import Constants, Imaging
from studies.table1.analysis import Analysis, RealLens
from studies.table1.spec import Table1Spec

CELLS = 3 * len(paper.ETA)


def findings(spec: Table1Spec, analysis: Analysis) -> list[str]:
    """Plain sentences, most important first."""
    imaging = analysis.imaging
    found = [_constants(spec, imaging), _meaning(imaging)]
    if analysis.other_reading is not None:
        found.append(_readings(imaging, analysis.other_reading))
    return [*found, _choice(spec, imaging), _lens(spec, analysis.lens)]


def metrics(
    spec: Table1Spec, analysis: Analysis, stability: Sequence[StabilityRow]
) -> list[Metric]:
    """The study's numbers; the targets hold for the paper's chamber only."""
    paper_chamber = spec.chamber == ChamberSpec()

    def target(value: float, tolerance: float = 0.0) -> Target | None:
        return Target("=", value, tolerance) if paper_chamber else None

    printed, identified = analysis.imaging.printed, analysis.imaging.identified
    fit = analysis.imaging.fit
    height, offset = fit.solution.value.tolist()
    deviations = np.sqrt(np.diag(np.asarray(fit.covariance)))
    worst = printed.table.deviations()
    cases = sum(row.cases for row in stability)
    return [
        Metric(
            "cells_matched_identified",
            identified.table.matched(),
            "",
            f"cells of Table I (of {CELLS}) met to the last printed digit, identified constants",
            CELLS,
            target(CELLS),
        ),
        Metric(
            "cells_matched_printed",
            printed.table.matched(),
            "",
            f"the same with the paper's printed constants (of {CELLS})",
            CELLS,
        ),
        Metric(
            "worst_delta_l_d_printed_mm",
            10 * float(np.max(np.abs(worst.delta_l_d_cm))),
            "mm",
            "largest deviation from the paper's Δl_D, printed constants",
        ),
        Metric(
            "worst_theta_cd_printed_deg",
            float(np.max(np.abs(worst.theta_cd_deg))),
            "°",
            "largest deviation from the paper's θ_CD, printed constants",
        ),
        Metric(
            "identified_reference_height_mm",
            height,
            "mm",
            f"h that the table follows (± {deviations[0]:.4f} from the printed rounding)",
            None,
            target(8.616, 0.005),
        ),
        Metric(
            "identified_pinhole_offset_mm",
            offset,
            "mm",
            f"δ that the table follows (± {deviations[1]:.4f} from the printed rounding)",
            None,
            target(0.844, 0.005),
        ),
        Metric(
            "chi_squared",
            float(fit.chi_squared),
            "",
            f"sum of squared residuals of {2 * len(paper.ETA)} cells over the printed rounding "
            f"({2 * len(paper.ETA) - 2} expected)",
        ),
        Metric(
            "line_slope_mm",
            float(identified.slope),
            "mm",
            "slope of Δl_D over η, identified constants",
        ),
        Metric(
            "line_intercept_mm",
            float(identified.intercept),
            "mm",
            "Δl_D at η = 0, identified constants",
        ),
        Metric("line_slope_printed_mm", float(printed.slope), "mm", "slope, printed constants"),
        Metric(
            "line_intercept_printed_mm",
            float(printed.intercept),
            "mm",
            "intercept, printed constants",
        ),
        Metric(
            "largest_ratio",
            _where_ok(analysis.imaging.choice),
            "",
            f"largest η that leaves {spec.clearance:g} mm inside Δl_A",
            paper.CHOSEN_ETA,
        ),
        Metric(
            "clearance_at_paper_ratio_mm",
            float(analysis.imaging.paper_clearance),
            "mm",
            f"clearance at which the paper's η = {paper.CHOSEN_ETA} is the largest",
        ),
        Metric(
            "gradient_error",
            max(row.worst_gradient_error for row in stability),
            "",
            f"largest deviation of a gradient from central differences over {cases} cases, on the "
            "scale of the value",
            None,
            Target("<=", 1e-6),
        ),
        Metric(
            "gradient_relative_error_float64",
            max(
                (row.worst_gradient_relative_error for row in stability if row.dtype == "float64"),
                default=math.nan,
            ),
            "",
            "the same in float64, each entry on its own scale, however little it matters",
        ),
        Metric(
            "non_finite",
            sum(row.non_finite for row in stability),
            "",
            f"values, margins, residuals and gradients of {cases} cases that are not finite",
            None,
            Target("=", 0),
        ),
        Metric(
            "stability_failures",
            sum(row.failures for row in stability),
            "",
            f"cases answered wrongly, of {cases}",
            None,
            Target("=", 0),
        ),
    ]


def _where_ok(solution: Solution[Any]) -> float:
    # A failed solve has a number, but it means nothing: a metric shows that there is none.
    return float(solution.value) if bool(solution.ok) else math.nan


def _constants(spec: Table1Spec, imaging: Imaging) -> str:
    whose = "The paper's printed camera constants"
    if spec.chamber != ChamberSpec():
        whose = "For this chamber, which is not the paper's, the printed camera constants"
    chamber, table = imaging.printed.chamber, imaging.printed.table
    worst = table.deviations()
    height, offset = imaging.fit.solution.value.tolist()
    return (
        f"{whose} {'give' if table.matched() == CELLS else 'do not give'} the paper's table: with "
        f"h = Δl_A = {float(chamber.offset_a):g} mm and δ = f = {float(chamber.focal_length):g} "
        f"mm, {table.matched()} of {CELLS} cells agree, Δl_D is off by up to "
        f"{10 * np.max(np.abs(worst.delta_l_d_cm)):.2f} mm and θ_CD by up to "
        f"{np.max(np.abs(worst.theta_cd_deg)):.2f}°; two effective constants identified from the "
        f"table itself, a reference height h = {height:.3f} mm and a pinhole offset "
        f"δ = {offset:.3f} mm, give {imaging.identified.table.matched()} of {CELLS} cells to the "
        "last printed digit, and are this study's, not the paper's."
    )


def _meaning(imaging: Imaging) -> str:
    return (
        "Δl_D is exactly linear in η, and two constants fit any line: the identified ones give "
        f"Δl_D = {_line(imaging.identified)} mm, the printed ones "
        f"Δl_D = {_line(imaging.printed)} mm. Cells that are met say that the table is consistent "
        "with Eqs. 1-3, not that a camera with these constants existed."
    )


def _line(constants: Constants) -> str:
    intercept = float(constants.intercept)
    sign = "−" if intercept < 0 else "+"
    return f"{float(constants.slope):.3f} η {sign} {abs(intercept):.3f}"


def _readings(text: Imaging, other: Imaging) -> str:
    chamber = other.identified.chamber
    difference = abs(float(text.chosen.offset_c - chamber.offset_c))
    return (
        "The table cannot tell (a, b, c) = (40, 30, 30) mm with θ_BC = 2° from (30, 40, 30) mm "
        f"with 1.5°: their Δl_C differ by {difference:.1g} mm, and the second gives "
        f"{other.identified.table.matched()} of {CELLS} cells with h = "
        f"{float(chamber.reference_height):.2f} mm and δ = {float(chamber.pinhole_offset):.2f} mm, "
        "so the identified constants depend on the reading; the text's order of lengths is used."
    )


def _choice(spec: Table1Spec, imaging: Imaging) -> str:
    left = float(imaging.paper_clearance)
    if not bool(imaging.choice.ok):
        return f"No η could be chosen: {imaging.choice.messages()[0]}"
    return (
        f"The largest η that keeps |Δl_D| inside Δl_A by {spec.clearance:g} mm is "
        f"{float(imaging.choice.value):.3f}; "
        + (
            f"the paper's {paper.CHOSEN_ETA} comes out for a clearance of {left:.2f} mm."
            if left > 0
            else f"the paper's {paper.CHOSEN_ETA} leaves none, as |Δl_D| exceeds Δl_A by "
            f"{-left:.2f} mm."
        )
    )


def _lens(spec: Table1Spec, real: RealLens) -> str:
    sharp = 1 / np.asarray(real.images.vergence)
    near, far = real.depth_of_field.tolist()
    limit = f"{1 / far:.1f} mm" if far > 0 else "infinity"
    hyperfocal = float(real.hyperfocal_distance)
    return (
        f"Eq. 1 is a pinhole relation: a real thin lens of f = {float(real.lens.focal_length):g} "
        f"mm focuses B, C and D at {sharp[0]:.2f}, {sharp[1]:.2f} and {sharp[2]:.2f} mm, while "
        f"the printed v is {float(real.lens.sensor_distance):g} mm, where at f/{spec.f_number:g} "
        f"each blurs to {float(jnp.min(real.images.blur_diameter)):.2f} mm or more; focused on C "
        f"it is sharp to {1e3 * spec.blur:g} µm from {1 / near:.1f} mm to {limit}, and its "
        f"hyperfocal distance is {hyperfocal / 1e3:.2f} m."
    )
