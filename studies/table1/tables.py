"""The study's tables."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from designopt.study.results import Table
from studies.models.soft_finger import paper
from studies.table1.analysis import Analysis

_CELLS = (
    *(
        f"{source}_{quantity}"
        for quantity in ("delta_l_d_cm", "theta_cd_deg", "eta_from_theta")
        for source in ("paper", "printed", "identified")
    ),
    "eta_from_theta",
)
"""Every column of cells in the first two tables."""


def tables(analysis: Analysis) -> list[Table]:
    """Every table of the study."""
    return [
        table1(analysis),
        deviations(analysis),
        identification(analysis),
        residuals(analysis),
        readings(analysis),
        real_lens(analysis),
    ]


def table1(analysis: Analysis) -> Table:
    """Table I: the paper's cells, those of the printed and those of the identified constants."""
    printed, identified = analysis.imaging.printed.table, analysis.imaging.identified.table
    return Table.of_columns(
        "table1",
        "Table I: the paper's, from the printed constants, and from the identified ones; the last "
        "column is η from the paper's θ_CD with the identified constants",
        {
            "eta": paper.ETA,
            "paper_delta_l_d_cm": paper.DELTA_L_D_CM,
            "printed_delta_l_d_cm": printed.delta_l_d_cm.tolist(),
            "identified_delta_l_d_cm": identified.delta_l_d_cm.tolist(),
            "paper_theta_cd_deg": paper.THETA_CD_DEG,
            "printed_theta_cd_deg": printed.theta_cd_deg.tolist(),
            "identified_theta_cd_deg": identified.theta_cd_deg.tolist(),
            "eta_from_theta": identified.eta.tolist(),
        },
        {"eta": 1, **dict.fromkeys(_CELLS, 4)},
    )


def deviations(analysis: Analysis) -> Table:
    """Every cell's deviation from the paper, for both sets of constants."""
    printed, identified = (
        constants.table.deviations()
        for constants in (analysis.imaging.printed, analysis.imaging.identified)
    )
    return Table.of_columns(
        "deviations",
        "Deviation of every cell from the paper's; a cell printed with three decimals is met "
        "within 0.0005",
        {
            "eta": paper.ETA,
            "printed_delta_l_d_cm": printed.delta_l_d_cm.tolist(),
            "identified_delta_l_d_cm": identified.delta_l_d_cm.tolist(),
            "printed_theta_cd_deg": printed.theta_cd_deg.tolist(),
            "identified_theta_cd_deg": identified.theta_cd_deg.tolist(),
            "printed_eta_from_theta": printed.eta.tolist(),
            "identified_eta_from_theta": identified.eta.tolist(),
        },
        {"eta": 1, **dict.fromkeys(_CELLS, 5)},
    )


def identification(analysis: Analysis) -> Table:
    """The identified constants with their covariance."""
    fit, as_printed = analysis.imaging.fit, analysis.imaging.printed.chamber
    values, covariance = np.asarray(fit.solution.value), np.asarray(fit.covariance)
    return Table(
        "identification",
        "Identified camera constants; deviations from the rounding of the printed digits alone",
        [
            "constant",
            "value_mm",
            "deviation_mm",
            "covariance_h_mm2",
            "covariance_delta_mm2",
            "as_printed_mm",
        ],
        [
            (
                name,
                float(values[i]),
                float(np.sqrt(covariance[i, i])),
                float(covariance[i, 0]),
                float(covariance[i, 1]),
                float(printed),
            )
            for i, (name, printed) in enumerate(
                (
                    ("h, reference height", as_printed.reference_height),
                    ("δ, pinhole offset", as_printed.pinhole_offset),
                )
            )
        ],
        {"value_mm": 4, "deviation_mm": 4, "as_printed_mm": 1},
    )


def residuals(analysis: Analysis) -> Table:
    """What the identified constants leave of each cell, in units of the rounding's deviation."""
    offsets, angles = np.split(np.asarray(analysis.imaging.fit.residuals), 2)
    return Table.of_columns(
        "residuals",
        "Residuals of the identification, in standard deviations of the printed rounding "
        "(no more than 1.73 if rounding explains them)",
        {"eta": paper.ETA, "delta_l_d": offsets.tolist(), "theta_cd": angles.tolist()},
        {"eta": 1, "delta_l_d": 2, "theta_cd": 2},
    )


def readings(analysis: Analysis) -> Table:
    """The readings of the chamber's lengths and the constants each asks for."""
    readings = {"as in the text": analysis.imaging}
    if analysis.other_reading is not None:
        readings["red and blue lengths exchanged"] = analysis.other_reading
    rows = []
    for name, reading in readings.items():
        chamber = reading.identified.chamber
        numbers = (
            chamber.length_ab,
            chamber.length_bc,
            chamber.length_cd,
            jnp.rad2deg(chamber.wall_angle_bc),
            chamber.offset_c,
            chamber.reference_height,
            chamber.pinhole_offset,
        )
        rows.append((name, *map(float, numbers), reading.identified.table.matched()))
    return Table(
        "readings",
        "Readings of the chamber's lengths, and the constants with which each gives Table I",
        [
            "reading",
            "a_mm",
            "b_mm",
            "c_mm",
            "theta_bc_deg",
            "delta_l_c_mm",
            "h_mm",
            "delta_mm",
            "cells_matched",
        ],
        rows,
        {"theta_bc_deg": 1, "delta_l_c_mm": 4, "h_mm": 3, "delta_mm": 3},
    )


def real_lens(analysis: Analysis) -> Table:
    """What a real thin lens makes of B, C and D, beside Eq. 1."""
    lens, images = analysis.lens, analysis.lens.images
    gap = float(lens.lens.focal_length - lens.lens.sensor_distance)
    distances = np.asarray(lens.distances)
    return Table(
        "real_lens",
        "The printed camera as a real thin lens, beside Eq. 1's pinhole at f − v",
        [
            "point",
            "distance_mm",
            "sharp_image_mm",
            "sensor_mm",
            "blur_mm",
            "size_over_object",
            "size_over_object_eq1",
        ],
        [
            (
                point,
                float(distance),
                float(1 / vergence),
                float(lens.lens.sensor_distance),
                float(blur),
                abs(float(size)),
                gap / float(distance),
            )
            for point, distance, vergence, blur, size in zip(
                "BCD",
                distances,
                images.vergence,
                images.blur_diameter,
                images.magnification,
                strict=True,
            )
        ],
        {"distance_mm": 1, "sharp_image_mm": 3, "sensor_mm": 2, "blur_mm": 3},
    )
