"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from designopt import Context, Records, Report, Results, StabilityRow, UserError, assess
from designopt.plot.figures import PALETTE, new_figure
from designopt.plot.typesetting import as_mathtext
from designopt.study.benchmark import find_undominated
from designopt.study.left_out import count_operations
from designopt.study.plots import lines
from optics.chamber.chamber import Chamber
from optics.chamber.ratio import SolveMethod, solve_dimension_for_ratio
from optics.scene.thin_lens import ThinLens
from studies.benchmarks import chamber as benchmark
from studies.models.soft_finger import paper
from studies.models.soft_finger.imaging import Columns, Constants, Imaging
from studies.stability import chamber as stability
from studies.table1 import Table1Spec
from studies.table1.analysis import Analysis, analyze, solve_batch

REGIONS = {"red AB": "#C0392B", "blue BC": PALETTE[0], "yellow CD": "#E0A800", "top DE": "#555555"}
"""Regions of the wall from the lens to the end, and their colours."""

CELLS = 3 * len(paper.ETA)


def run(spec: Table1Spec, context: Context) -> Results:
    """Table I with the printed and with identified constants, the choice of η, the measurements."""
    out = Report(spec, package=__package__)
    with context.step("Table I, identification and the choice of η"):
        analysis = analyze(spec)
    rows = assess(stability.nominal(), (context.dtype,))
    if spec.stability:
        with context.step("Stiff and extreme cases"):
            for family in stability.families(context.seed):
                rows += assess(family, ("float64", "float32"))
    out.stability(rows)
    if spec.precision:
        with context.step("Error against run time"):
            measure(out, analysis.imaging.identified.chamber, spec, context.seed)
    with context.step("Operations left out"):
        add_operations(out, analysis.imaging.chosen)
    add_metrics(out, analysis.imaging, rows)
    add_findings(out, spec, analysis)
    add_tables(out, analysis)
    out.figure("line", draw_lines(analysis.imaging, spec.clearance), most=2)
    chosen = analysis.imaging.chosen
    note = " The identified pinhole lies outside the chamber: its constants are effective ones."
    out.figure(
        "section",
        draw_section(chosen),
        ratio=float(chosen.imaging_ratio().value),
        outside=note if chosen.reference_height > chosen.offset_a else "",
    )
    return out.results()


def run_batch(specs: Sequence[Table1Spec], context: Context) -> list[Results | UserError]:
    """The metrics of every spec, and nothing else of its results.

    A spec that asks for measurements, or whose table follows no camera constants, is run by itself.
    """
    together = [spec for spec in specs if not (spec.precision or spec.stability)]
    solved: dict[int, Results] = {}
    if together:
        rows = assess(stability.nominal(), (context.dtype,))
        for spec, imaging in zip(together, solve_batch(together), strict=True):
            if bool(imaging.fit.solution.ok):
                out = Report(spec, package=__package__)
                add_metrics(out, imaging, rows)
                solved[id(spec)] = out.results()
    return [solved.get(id(spec)) or _run_alone(spec, context) for spec in specs]


def _run_alone(spec: Table1Spec, context: Context) -> Results | UserError:
    try:
        return run(spec, context)
    except UserError as error:
        return error


def measure(out: Report, chamber: Chamber, spec: Table1Spec, seed: int) -> None:
    """Error against run time of solving for η from θ_CD."""
    rows = benchmark.measure(chamber, spec.precision_problems, spec.precision_repeats, seed)
    claim = out.claim("closed-form", *find_undominated(rows, benchmark.CLOSED_FORM))
    reference = f"{benchmark.REFERENCE} (so float32 answers for the rounding of its inputs, too)"
    out.precision(rows, "worst relative error of η", reference, claim)


def add_operations(out: Report, chamber: Chamber) -> None:
    """Operation counts of this scene's programs beside the general ones."""
    ratios = jnp.asarray(paper.ETA)

    def offsets(chamber: Chamber, ratios: jax.Array, method: SolveMethod) -> jax.Array:
        return jax.vmap(
            lambda ratio: solve_dimension_for_ratio(chamber, "offset_d", ratio, method=method).value
        )(ratios)

    def everything(chamber: Chamber, lens: ThinLens) -> tuple:
        images = chamber.image_heights(), jax.vmap(lens.image)(chamber.depths)
        return chamber.imaging_ratio(), chamber.ring_widths(), *images

    lens = ThinLens(chamber.focal_length, chamber.focal_length, chamber.image_distance)
    closed = count_operations(lambda c, r: offsets(c, r, "closed form"), chamber, ratios)
    newton = count_operations(lambda c, r: offsets(c, r, "newton"), chamber, ratios)
    out.operations("offsets", closed, newton)
    alone = count_operations(lambda c, _: c.imaging_ratio(), chamber, lens)
    out.operations("ratio", alone, count_operations(everything, chamber, lens))


def add_metrics(out: Report, imaging: Imaging, rows: Sequence[StabilityRow]) -> None:
    """The study's numbers."""
    printed, identified = imaging.printed, imaging.identified
    fit, choice = imaging.fit, imaging.choice
    height, offset = fit.solution.value.tolist()
    height_sd, offset_sd = np.sqrt(np.diag(np.asarray(fit.covariance)))
    worst = printed.table.deviations()
    relative = [row.worst_gradient_relative_error for row in rows if row.dtype == "float64"]
    out.values(height_sd=height_sd, offset_sd=offset_sd, cases=sum(row.cases for row in rows))
    out.metrics(
        cells_matched_identified=identified.table.matched(),
        cells_matched_printed=printed.table.matched(),
        worst_delta_l_d_printed_mm=10 * np.max(np.abs(worst.delta_l_d_cm)),
        worst_theta_cd_printed_deg=np.max(np.abs(worst.theta_cd_deg)),
        identified_reference_height_mm=height,
        identified_pinhole_offset_mm=offset,
        chi_squared=fit.chi_squared,
        line_slope_mm=identified.slope,
        line_intercept_mm=identified.intercept,
        line_slope_printed_mm=printed.slope,
        line_intercept_printed_mm=printed.intercept,
        largest_ratio=choice.value if bool(choice.ok) else math.nan,
        clearance_at_paper_ratio_mm=imaging.paper_clearance,
        gradient_error=max(row.worst_gradient_error for row in rows),
        gradient_relative_error_float64=max(relative, default=math.nan),
        non_finite=sum(row.non_finite for row in rows),
        stability_failures=sum(row.failures for row in rows),
    )


def add_findings(out: Report, spec: Table1Spec, analysis: Analysis) -> None:
    """Plain sentences, most important first."""
    imaging, other, real = analysis.imaging, analysis.other_reading, analysis.lens
    focal_length = float(real.lens.focal_length)
    out.say(
        "constants",
        whose="For this chamber, which is not the paper's, the" if out.waived else "The paper's",
        give="give" if out["cells_matched_printed"] == CELLS else "do not give",
        h=float(imaging.printed.chamber.offset_a),
        f=focal_length,
    )
    out.say("meaning", identified=_line(imaging.identified), printed=_line(imaging.printed))
    if other is not None:
        theirs = other.identified.chamber
        out.say(
            "readings",
            off=abs(float(imaging.chosen.offset_c - theirs.offset_c)),
            matched=other.identified.table.matched(),
            h=float(theirs.reference_height),
            delta=float(theirs.pinhole_offset),
        )
    left = out["clearance_at_paper_ratio_mm"]
    if not bool(imaging.choice.ok):
        out.say("no-choice", reason=imaging.choice.messages()[0])
    elif left > 0:
        out.say("choice", leaves=f"comes out for a clearance of {left:.2f} mm")
    else:
        out.say("choice", leaves=f"leaves none, as |Δl_D| exceeds Δl_A by {-left:.2f} mm")
    near, far = real.depth_of_field.tolist()
    out.say(
        "lens",
        f=focal_length,
        **dict(zip("bcd", 1 / np.asarray(real.images.vergence), strict=True)),
        v=float(real.lens.sensor_distance),
        spot=float(jnp.min(real.images.blur_diameter)),
        blur_um=1e3 * spec.blur,
        near=1 / near,
        far=f"{1 / far:.1f} mm" if far > 0 else "infinity",
        hyperfocal=float(real.hyperfocal_distance) / 1e3,
    )


def _line(constants: Constants) -> str:
    intercept = float(constants.intercept)
    sign = "−" if intercept < 0 else "+"
    return f"{float(constants.slope):.3f} η {sign} {abs(intercept):.3f}"


def _columns(name: str, **tables: Columns) -> dict[str, jax.Array]:
    """One column of several tables, under the tables' names."""
    return {f"{whose}_{name}": getattr(table, name) for whose, table in tables.items()}


def add_tables(out: Report, analysis: Analysis) -> None:
    """Table I three times, its deviations, the identification, the readings, the real lens."""
    printed, identified = analysis.imaging.printed, analysis.imaging.identified
    tables = {"printed": printed.table, "identified": identified.table}
    out.table(
        "table1",
        eta=paper.ETA,
        paper_delta_l_d_cm=paper.DELTA_L_D_CM,
        **_columns("delta_l_d_cm", **tables),
        paper_theta_cd_deg=paper.THETA_CD_DEG,
        **_columns("theta_cd_deg", **tables),
        eta_from_theta=identified.table.eta,
    )
    off = {whose: table.deviations() for whose, table in tables.items()}
    cells = _columns("delta_l_d_cm", **off) | _columns("theta_cd_deg", **off)
    ratios = {f"{name}_from_theta": column for name, column in _columns("eta", **off).items()}
    out.table("deviations", eta=paper.ETA, **cells, **ratios)
    fit, as_printed = analysis.imaging.fit, printed.chamber
    values, covariance = np.asarray(fit.solution.value), np.asarray(fit.covariance)
    out.table(
        "identification",
        constant=["h, reference height", "δ, pinhole offset"],
        value_mm=values,
        deviation_mm=np.sqrt(np.diag(covariance)),
        covariance_h_mm2=covariance[:, 0],
        covariance_delta_mm2=covariance[:, 1],
        as_printed_mm=[as_printed.reference_height, as_printed.pinhole_offset],
    )
    offsets, angles = np.split(np.asarray(fit.residuals), 2)
    out.table("residuals", eta=paper.ETA, delta_l_d=offsets, theta_cd=angles)
    readings = {"as in the text": analysis.imaging}
    if analysis.other_reading is not None:
        readings["red and blue lengths exchanged"] = analysis.other_reading
    chambers = [one.identified.chamber for one in readings.values()]

    def of(field: str) -> list[jax.Array]:
        return [getattr(chamber, field) for chamber in chambers]

    out.table(
        "readings",
        reading=list(readings),
        a_mm=of("length_ab"),
        b_mm=of("length_bc"),
        c_mm=of("length_cd"),
        theta_bc_deg=np.rad2deg(of("wall_angle_bc")),
        delta_l_c_mm=of("offset_c"),
        h_mm=of("reference_height"),
        delta_mm=of("pinhole_offset"),
        cells_matched=[one.identified.table.matched() for one in readings.values()],
    )
    real = analysis.lens
    distances, sensor = np.asarray(real.distances), float(real.lens.sensor_distance)
    out.table(
        "real_lens",
        point=list("BCD"),
        distance_mm=distances,
        sharp_image_mm=1 / np.asarray(real.images.vergence),
        sensor_mm=[sensor] * 3,
        blur_mm=real.images.blur_diameter,
        size_over_object=np.abs(real.images.magnification),
        size_over_object_eq1=(float(real.lens.focal_length) - sensor) / distances,
    )


def draw_lines(imaging: Imaging, clearance: float) -> Figure:
    """Δl_D over η: both lines, the table's points, and the room that the chamber leaves.

    Args:
        imaging: the study's solution.
        clearance: what |Δl_D| is to leave inside Δl_A, in mm.
    """
    offset_a, chosen = float(imaging.chosen.offset_a), float(imaging.choice.value)
    eta, table = np.array(paper.ETA), 10 * np.array(paper.DELTA_L_D_CM)
    shown = Records()
    shown.add(of="Table I", eta=eta, offset_mm=table, left_um=math.nan)
    for name in ("printed", "identified"):
        constants = getattr(imaging, name)
        line = float(constants.slope) * eta + float(constants.intercept)
        left = 1e3 * (line - table) if name == "identified" else math.nan
        of = f"{name} constants: {_line(constants)}"
        shown.add(of=of, eta=eta, offset_mm=line, left_um=left)
    if bool(imaging.choice.ok):
        of = f"largest η: {chosen:.3f}"
        shown.add(of=of, eta=chosen, offset_mm=offset_a - clearance, left_um=math.nan)
    names = {"eta": "η, yellow ring over blue ring", "offset_mm": "Δl_D (mm)"}
    names["left_um"] = "Δl_D, identified − Table I (µm)"
    drawing = lines(shown, "eta", ["offset_mm", "left_um"], by="of", names=names, height=3.9)
    axis, residual = drawing.axes
    room = as_mathtext(f"left, grey: |Δl_D| ≤ Δl_A − {clearance:g} mm")
    axis.axhspan(-offset_a + clearance, offset_a - clearance, color="0.92", zorder=0, label=room)
    axis.axhline(offset_a, color="0.4", linewidth=0.9, label=as_mathtext("Δl_A, wall at the lens"))
    # Half a unit in the last printed digit of Δl_D.
    rounding = "right, grey: rounding of the printed digits"
    residual.axhspan(-5.0, 5.0, color="0.92", zorder=0, label=rounding)
    return drawing


def draw_section(chamber: Chamber) -> Figure:
    """The chamber's section with a ray from each wall point through the pinhole, and the image."""
    lengths = [float(x) for x in (chamber.length_ab, chamber.length_bc, chamber.length_cd)]
    offsets = [float(x) for x in (chamber.offset_b, chamber.offset_c, -chamber.offset_d)]
    points = {"A": (0.0, float(chamber.offset_a))}
    points |= dict(zip("BCD", zip(np.cumsum(lengths), offsets, strict=True), strict=True))
    height, offset = float(chamber.reference_height), float(chamber.pinhole_offset)
    images = chamber.image_heights().value.tolist()

    drawing, [[section, sensor]] = new_figure(1, 2, height=3.6, width_ratios=(2.6, 1))
    # Δd_d = T_D: the top reaches from D to the reference ray.
    end = (points["D"][0], -height)
    corners = [*points.values(), end]
    for start, stop, (name, color) in zip(corners, corners[1:], REGIONS.items(), strict=False):
        section.plot(*zip(start, stop, strict=True), color=color, linewidth=3.5, label=name)
    section.axhline(0, color="0.55", linewidth=0.8, linestyle="-.", label="centre line")
    section.axhline(-height, color="0.55", linewidth=0.8, linestyle=":", label="reference ray")
    section.plot(-offset, -height, "o", color="black")
    pinhole, off = (-offset, -height), {"textcoords": "offset points"}
    for name in "BCD":
        section.plot(*zip(pinhole, points[name], strict=True), color="0.3", linewidth=0.9)
    places = {"D": (7, -2), "E": (-7, -2)}  # above D E may be
    for name, place in (points | {"E": end}).items():
        section.annotate(name, place, places.get(name, (0, 7)), ha="center", **off)
    section.annotate("pinhole", pinhole, (6, -11), fontsize=8, **off)
    section.set(xlabel="distance s along the centre line (mm)", ylabel="height (mm)")
    lowest = min(-height, *offsets)
    section.set(title=f"Section at η = {float(chamber.imaging_ratio().value):.3f}")
    section.set(ylim=(lowest - 2.2, float(chamber.offset_a) + 2))

    lower, colors = (*images[1:], 0.0), [*REGIONS.values()][1:]
    for low, high, color, name in zip(lower, images, colors, "bcd", strict=True):
        sensor.bar(0, high - low, bottom=low, color=color, width=0.8)
        text = as_mathtext(f"Δd_{name} = {high - low:.4f} mm")
        sensor.text(0.5, (low + high) / 2, text, va="center", fontsize=8)
    sensor.set(title="Image", ylabel="image height T (mm)", xlim=(-0.5, 2.9), xticks=[])
    sensor.grid(visible=False)
    return drawing
