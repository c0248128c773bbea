"""The study's tables."""

from __future__ import annotations

import numpy as np

from designopt.study.results import Table
from studies.models.finger import Finger, pins_of
from studies.models.linkage_design.analysis import LinkageDesign
from studies.models.linkage_design.problem import ANGLE, HOSTS, LINKS, PAIRS
from studies.models.linkage_design.spec import FingerLinkageSpec, LimitsSpec
from studies.models.pins import pin_name


def dimensions(finger: Finger) -> list[Table]:
    """Where the pins are, and how long the links."""
    pins = pins_of(finger)
    at = {"A": np.zeros(2), "B": np.array([finger.body.intermediate, 0.0])}
    at |= {name: np.asarray(getattr(pins, name)) for name in HOSTS}
    joined = {
        name: ", ".join(link for link, others in LINKS.items() if name in others) for name in at
    }
    sides = [
        (link, f"{pin_name(a)}-{pin_name(b)}", float(np.hypot(*(at[a] - at[b]))))
        for link, names in LINKS.items()
        for a, b in PAIRS
        if a in names and b in names
    ]
    return [
        Table.of_columns(
            "pins",
            "Pins in the straight finger (x from the PIP axis to the tip, y to the back)",
            {
                "pin": [pin_name(name) for name in at],
                "x_mm": [float(place[0]) for place in at.values()],
                "y_mm": [float(place[1]) for place in at.values()],
                "links": list(joined.values()),
            },
            {"x_mm": 2, "y_mm": 2},
        ),
        Table(
            "lengths",
            "Distances of pins on a link",
            ["link", "pins", "length_mm"],
            sides,
            {"length_mm": 3},
        ),
    ]


def requirements(design: LinkageDesign, limits: LimitsSpec) -> Table:
    """Every requirement with what was achieved."""
    rows = [
        (
            "transmission angle",
            "at least",
            limits.transmission_deg,
            design.verdict.least_deg,
            "°",
            "yes" if design.verdict.least_deg > limits.transmission_deg else "no",
        )
    ]
    rows += [
        (
            check.name,
            "at least" if check.at_least else "at most",
            check.required,
            check.achieved,
            check.unit,
            "yes" if check.met else "no",
        )
        for check in (*design.verdict.checks, design.room)
    ]
    return Table(
        "requirements",
        "Requirements over all postures in steps of 1°, judged by the general linkage solver",
        ["requirement", "limit", "required", "achieved", "unit", "met"],
        rows,
    )


def holding(design: LinkageDesign) -> Table:
    """What holds the optimum."""
    rows = [
        (one.words, float(np.rad2deg(one.price * ANGLE)), f"° per {one.unit or '1'}", one.share)
        for one in design.search.held_by()
    ]
    return Table(
        "active",
        "What holds the optimum: how far the least angle would rise for one unit less asked",
        ["requirement", "price", "unit", "share"],
        rows,
    )


def starts(design: LinkageDesign) -> Table:
    """Where every start of every round led to."""
    rows = []
    for number, one in enumerate(design.search.rounds):
        for start, (optimum, least) in enumerate(zip(one.optima.found, one.least_deg, strict=True)):
            rows.append(
                (
                    number,
                    start,
                    least,
                    optimum.violation,
                    float(optimum.solution.residual),
                    int(optimum.history.steps[-1]),
                    optimum.solution.messages()[0],
                )
            )
    columns = ["round", "start", "least_deg", "violation", "stationarity", "steps", "message"]
    return Table("starts", "Where every start led to", columns, rows)


def trajectories(design: LinkageDesign) -> Table:
    """Pinch and adaptive closing: crank and transmission angles on the way."""
    verdict = design.verdict
    count = len(verdict.flexion_deg)
    rows = []
    for name, dip in (("pinch", lambda i: 0), ("adaptive", lambda i: i)):
        for i in range(0, count, 5):
            at = (i, dip(i))
            angles = [
                float(np.broadcast_to(values, (count, count))[at])
                for values in verdict.angles_deg.values()
            ]
            place = (float(verdict.flexion_deg[at[0]]), float(verdict.flexion_deg[at[1]]))
            rows.append(
                (name, *place, float(verdict.crank_deg[at]), float(verdict.ratio[at]), *angles)
            )
    columns = [
        "mode",
        "pip_deg",
        "dip_deg",
        "crank_deg",
        "force_ratio",
        *(f"{n}_deg" for n in verdict.angles_deg),
    ]
    return Table("trajectories", "Pinch and adaptive closing", columns, rows)


def design_tables(spec: FingerLinkageSpec, design: LinkageDesign) -> list:
    """Tables of a design."""
    return [
        *dimensions(design.finger),
        requirements(design, spec.limits),
        holding(design),
        trajectories(design),
        starts(design),
    ]
