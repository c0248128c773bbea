"""The study's tables: only states that are equilibria are in them."""

from __future__ import annotations

import math

import numpy as np

from designopt.study.results import Table
from studies.models.grasp.analysis import CLOSED, Analysis, radius_of
from studies.models.grasp.closing import Path

EVERY = 4
"""Every so many states are tabulated."""


def tables(found: Analysis) -> list[Table]:
    """Every table of the study."""
    return [sequences(found), circles(found), pinches(found), solved(found)]


def contact_state(path: Path, state: int) -> str:
    """In words, which pads press."""
    pads = [
        name for pad, name in enumerate(("intermediate", "distal")) if path.push(pad)[state] > 1e-9
    ]
    return " and ".join(pads) or "none"


def sequences(found: Analysis) -> Table:
    """Joints, moments and forces along the closings."""
    rows = []
    shown = {name: path for name, path in found.paths().items() if not name.startswith("pinch")}
    for name, path in shown.items():
        for state in np.flatnonzero(path.ok)[::EVERY].tolist():
            rows.append(
                (
                    name,
                    math.degrees(path.commands[state]),
                    *np.degrees(path.joints[state]).tolist(),
                    float(path.motor[state]),
                    contact_state(path, state),
                    float(path.push(0)[state]),
                    float(path.push(1)[state]),
                    *path.stops[state].tolist(),
                    float(path.residual[state]),
                    float(path.margin[state]),
                )
            )
    columns = [
        "closing",
        "motor_deg",
        "pip_deg",
        "dip_deg",
        "motor_n_mm",
        "contacts",
        "f1_n",
        "f2_n",
    ]
    columns += ["stop_pip_n_mm", "stop_dip_n_mm", "residual", "margin"]
    return Table("sequences", "Closing and opening, every fourth state", columns, rows)


def circles(found: Analysis) -> Table:
    """What the circles end with."""
    rows = []
    for path in found.circles:
        if path.ok[CLOSED]:
            pip, dip = np.degrees(path.joints[CLOSED]).tolist()
            k1, k2 = path.along[CLOSED].tolist()
            rows.append(
                (
                    2 * radius_of(path),
                    pip,
                    dip,
                    contact_state(path, CLOSED),
                    k1,
                    k2,
                    float(path.push(0)[CLOSED]),
                    float(path.push(1)[CLOSED]),
                    float(path.motor[CLOSED]),
                )
            )
    columns = ["diameter_mm", "pip_deg", "dip_deg", "contacts", "k1_mm", "k2_mm", "f1_n", "f2_n"]
    return Table("circles", "Circles with the motor at its end", [*columns, "motor_n_mm"], rows)


def pinches(found: Analysis) -> Table:
    """Limits of the pinches by the formula and by loading; empty where a pinch holds."""
    rows = []
    for one, _, shown in found.pinches:
        limit = None if one.holds else one.limit
        high = shown.high if math.isfinite(shown.high) else None
        rows.append(
            (
                math.degrees(one.pip),
                one.place,
                one.ratio,
                one.threshold,
                limit,
                shown.low,
                high,
                shown.agrees,
            )
        )
    columns = ["pip_deg", "k2_mm", "ratio", "threshold", "limit_n_mm", "held_n_mm", "gave_way_n_mm"]
    return Table("pinches", "Limits of the pinches", [*columns, "agrees"], rows)


def solved(found: Analysis) -> Table:
    """How every closing was solved, and the comparison of its forces."""
    rows = []
    for (name, path), compared in zip(found.paths().items(), found.compared, strict=True):
        bad = np.flatnonzero(~path.ok)
        rows.append(
            (
                name,
                len(path.ok),
                int(path.ok.sum()),
                path.messages[int(bad[0])] if bad.size else "",
                float(path.residual[path.ok].max(initial=0.0)),
                float(path.margin[path.ok].min(initial=1.0)),
                compared.error,
                compared.states,
                compared.undetermined,
            )
        )
    columns = ["closing", "states", "solved", "first_message", "worst_residual", "least_margin"]
    columns += ["virtual_work_error", "compared", "undetermined"]
    return Table("solved", "How every closing was solved", columns, rows)
