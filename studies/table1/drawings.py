"""Figures of the study: the line of Δl_D over η, and the chamber's section with imaging rays."""

from __future__ import annotations

import numpy as np

from designopt.plot.figures import PALETTE, legend_below, new_figure
from designopt.plot.typesetting import as_mathtext
from designopt.study.results import Figure
from optics.chamber.chamber import Chamber
from optics.plot.chamber_drawing import REGIONS
from studies.models.soft_finger import paper
from studies.models.soft_finger.imaging import Imaging

BLUE, VERMILION, GREEN = PALETTE[:3]


def line_figure(imaging: Imaging, clearance: float) -> Figure:
    """Δl_D over η: both lines, the table's points, and the room that the chamber leaves.

    Args:
        imaging: the study's solution.
        clearance: what |Δl_D| is to leave inside Δl_A, in mm.
    """
    printed, identified = (
        (float(constants.slope), float(constants.intercept))
        for constants in (imaging.printed, imaging.identified)
    )
    offset_a, chosen = float(imaging.chosen.offset_a), float(imaging.choice.value)
    drawing, axes = new_figure(1, 2, height=3.9)
    axis, residual = axes[0]
    table = np.array(paper.ETA), 10 * np.array(paper.DELTA_L_D_CM)
    shown = [*paper.ETA, *([chosen] if bool(imaging.choice.ok) else [])]
    ratios = np.array([min(shown) - 0.12, max(shown) + 0.06])
    room = as_mathtext(f"left, grey: |Δl_D| ≤ Δl_A − {clearance:g} mm")
    axis.axhspan(-offset_a + clearance, offset_a - clearance, color="0.92", zorder=0, label=room)
    wall = as_mathtext("Δl_A, wall at the lens")
    axis.axhline(offset_a, color="0.4", linewidth=0.9, label=wall)
    for (slope, intercept), color, style, label in (
        (identified, BLUE, "-", "identified constants"),
        (printed, VERMILION, "--", "printed constants"),
    ):
        sign = "−" if intercept < 0 else "+"
        text = f"{label}: {slope:.3f} η {sign} {abs(intercept):.3f}"
        axis.plot(ratios, slope * ratios + intercept, style, color=color, label=text)
    axis.plot(*table, "o", color="black", markerfacecolor="white", label="Table I")
    if bool(imaging.choice.ok):
        axis.plot(chosen, offset_a - clearance, "D", color=GREEN, label=f"largest η: {chosen:.3f}")
    axis.set(xlabel="η, yellow ring over blue ring", ylabel=as_mathtext("Δl_D (mm)"))
    axis.set(title="Table I is a line")
    axis.set(xlim=ratios)

    half_unit = 5.0  # half a unit in the last printed digit of Δl_D, in µm
    rounding = "right, grey: rounding of the printed digits"
    residual.axhspan(-half_unit, half_unit, color="0.92", zorder=0, label=rounding)
    residual.axhline(0, color="0.4", linewidth=0.9)
    slope, intercept = identified
    left = 1e3 * (slope * table[0] + intercept - table[1])
    residual.plot(table[0], left, "o", color=BLUE)
    reach = max(1.6 * half_unit, 1.1 * float(np.max(np.abs(left))))
    residual.set(xlabel="η, yellow ring over blue ring")
    residual.set(ylabel=as_mathtext("Δl_D, identified − Table I (µm)"))
    residual.set(title="What the identified constants leave", ylim=(-reach, reach))
    legend_below(drawing, most=2)
    return Figure(
        "line",
        "Δl_D against η",
        "Left: the printed constants give another line than the table; the grey band is where "
        "|Δl_D| leaves the stated clearance inside Δl_A. Right: what the identified line leaves of "
        "every printed Δl_D, beside the rounding of its last digit.",
        drawing,
    )


def section_figure(chamber: Chamber) -> Figure:
    """The chamber's section with a ray from each wall point through the pinhole, and the image."""
    lengths = [float(x) for x in (chamber.length_ab, chamber.length_bc, chamber.length_cd)]
    s_b, s_c, s_d = np.cumsum(lengths)
    points = {
        "A": (0.0, float(chamber.offset_a)),
        "B": (s_b, float(chamber.offset_b)),
        "C": (s_c, float(chamber.offset_c)),
        "D": (s_d, -float(chamber.offset_d)),
    }
    height, offset = float(chamber.reference_height), float(chamber.pinhole_offset)
    images = chamber.image_heights().value.tolist()
    ratio = float(chamber.imaging_ratio().value)

    drawing, axes = new_figure(1, 2, height=3.6, width_ratios=(2.6, 1))
    section, sensor = axes[0]
    # Δd_d = T_D: the top reaches from D to the reference ray.
    corners = [*points.values(), (s_d, -height)]
    for start, end, (name, color) in zip(corners, corners[1:], REGIONS.items(), strict=False):
        section.plot(*zip(start, end, strict=True), color=color, linewidth=3.5, label=name)
    section.axhline(0, color="0.55", linewidth=0.8, linestyle="-.", label="centre line")
    section.axhline(-height, color="0.55", linewidth=0.8, linestyle=":", label="reference ray")
    for name in "BCD":
        section.plot(
            *zip((-offset, -height), points[name], strict=True), color="0.3", linewidth=0.9
        )
    for name, (s, y) in points.items():
        beside = (7, -2) if name == "D" else (0, 7)  # above it E may be
        section.annotate(name, (s, y), beside, textcoords="offset points", ha="center")
    section.annotate("E", (s_d, -height), (-7, -2), textcoords="offset points", ha="center")
    section.plot(-offset, -height, "o", color="black")
    section.annotate(
        "pinhole", (-offset, -height), (6, -11), textcoords="offset points", fontsize=8
    )
    section.set(xlabel="distance s along the centre line (mm)", ylabel="height (mm)")
    lowest = [-height, *(y for _, y in points.values())]
    section.set(
        title=f"Section at η = {ratio:.3f}", ylim=(min(lowest) - 2.2, float(chamber.offset_a) + 2)
    )

    lower = (*images[1:], 0.0)
    for low, high, color, name in zip(lower, images, [*REGIONS.values()][1:], "bcd", strict=True):
        sensor.bar(0, high - low, bottom=low, color=color, width=0.8)
        text = as_mathtext(f"Δd_{name} = {high - low:.4f} mm")
        sensor.text(0.5, (low + high) / 2, text, va="center", fontsize=8)
    sensor.set(title="Image", ylabel="image height T (mm)")
    sensor.set(xlim=(-0.5, 2.9), xticks=[])
    sensor.grid(visible=False)
    legend_below(drawing)
    caption = (
        f"The wall of the identified chamber at the chosen η = {ratio:.3f}, with a ray from B, C "
        "and D through the pinhole; heights are enlarged. Right, the rings on the sensor: yellow "
        "over blue is η. D is counted to the other side of the centre line from B and C."
    )
    if height > chamber.offset_a:
        caption += (
            " The identified pinhole lies outside the chamber: its constants are effective ones."
        )
    return Figure(
        "section",
        "The chamber and its image",
        caption,
        drawing,
    )
