"""Tables of a designed linkage; their words are in ``report.md`` of this package."""

from __future__ import annotations

import numpy as np

from designopt.study.records import Records
from designopt.study.report import Report
from studies.models.checks import Check, requirement_rows
from studies.models.finger import Finger, linkage_pins, links_of
from studies.models.link_layers import Links
from studies.models.linkage_design.analysis import LinkageDesign
from studies.models.linkage_design.coupling.judging import CoupledVerdict
from studies.models.linkage_design.judging import Verdict
from studies.models.linkage_design.problem import ANGLE, pairs_on_links, pin_places, pins_on_links
from studies.models.linkage_design.spec import LimitsSpec
from studies.models.pins import pin_name

EVERY = 5
"""Of the verdict's angles every so many make a row of the trajectories."""


def add_tables(out: Report, limits: LimitsSpec, design: LinkageDesign) -> None:
    """Pins and lengths, requirements, what holds the optimum, trajectories and starts."""
    out.table("pins", pins(design.finger))
    out.table("lengths", lengths(design.finger))
    out.table("requirements", requirements(limits, design))
    out.table("layers", layers(links_of(design.finger)))
    held = design.search.held_by()
    out.table(
        "active",
        requirement=[one.words for one in held],
        price=[float(np.rad2deg(one.price * ANGLE)) for one in held],
        unit=[f"° per {one.unit or '1'}" for one in held],
        share=[one.share for one in held],
    )
    if isinstance(design.verdict, CoupledVerdict):
        out.table("curve", curve(design.verdict))
    else:
        out.table("trajectories", trajectories(design.verdict))
    starts = Records()
    for number, one in enumerate(design.search.rounds):
        starts.add(
            round=number,
            start=np.arange(len(one.optima.found)),
            least_deg=one.least_deg,
            violation=[optimum.violation for optimum in one.optima.found],
            stationarity=[float(optimum.solution.residual) for optimum in one.optima.found],
            steps=[int(optimum.history.steps[-1]) for optimum in one.optima.found],
            message=[optimum.solution.messages()[0] for optimum in one.optima.found],
        )
    out.table("starts", starts)


def pins(finger: Finger) -> Records:
    """Where the pins are, and the links that they join."""
    found, on_links = Records(), pins_on_links(finger)
    for name, (x, y) in pin_places(finger).items():
        links = ", ".join(link for link, pins in on_links.items() if name in pins)
        found.add(pin=pin_name(name), x_mm=x, y_mm=y, links=links)
    return found


def lengths(finger: Finger) -> Records:
    """Distances of the pins on every link."""
    at, found = pin_places(finger), Records()
    pairs = pairs_on_links(linkage_pins(finger).names, finger.kind)
    for link, names in pins_on_links(finger).items():
        for first, second in pairs:
            if first in names and second in names:
                pins = f"{pin_name(first)}-{pin_name(second)}"
                found.add(link=link, pins=pins, length_mm=np.hypot(*(at[first] - at[second])))
    return found


def layers(links: Links) -> Records:
    """What lies in every millimetre of the width, from the middle of the finger outwards."""
    found = Records()
    for number, (parts, (inner, outer)) in enumerate(
        zip(links.layers, np.asarray(links.edges).tolist(), strict=True)
    ):
        found.add(layer=number, parts=", ".join(parts), from_mm=inner, to_mm=outer)
    return found


def requirements(limits: LimitsSpec, design: LinkageDesign) -> Records:
    """Every requirement with what was achieved, how far it is inside, and its price.

    The price is by how much the least angle would rise, to first order, for one unit less asked.
    """
    prices: dict[str, tuple[float, str]] = {}
    for one in design.search.held_by():
        name = one.words if one.name == "pins apart" else one.name
        price = prices.get(name, (0.0, ""))[0] + float(np.rad2deg(one.price * ANGLE))
        prices[name] = price, f"° per {one.unit or '1'}"
    angle = Check("transmission angle", limits.transmission_deg, design.verdict.least_deg, "°")
    return requirement_rows((angle, *design.verdict.checks, design.width), prices)


def curve(verdict: CoupledVerdict) -> Records:
    """How DIP follows PIP in a coupled finger, and what is transmitted on the way."""
    angles = {f"{name}_deg": values[::EVERY] for name, values in verdict.angles_deg.items()}
    return Records(
        {
            "pip_deg": verdict.pip_deg[::EVERY],
            "dip_deg": verdict.dip_deg[::EVERY],
            "ratio": verdict.ratio[::EVERY],
            "moment_per_tip_force_mm": verdict.moment[::EVERY],
            **angles,
        }
    )


def trajectories(verdict: Verdict) -> Records:
    """Pinch and adaptive closing: crank and transmission angles on the way."""
    found = Records()
    shape = verdict.crank_deg.shape
    pip = np.arange(0, shape[0], EVERY)
    for mode, dip in (("pinch", np.zeros_like(pip)), ("adaptive", np.minimum(pip, shape[1] - 1))):
        angles = {
            f"{name}_deg": np.broadcast_to(values, shape)[pip, dip]
            for name, values in verdict.angles_deg.items()
        }
        found.add(
            mode=mode,
            pip_deg=verdict.pip_deg[pip],
            dip_deg=verdict.dip_deg[dip],
            crank_deg=verdict.crank_deg[pip, dip],
            force_ratio=verdict.ratio[pip, dip],
            **angles,
        )
    return found
