"""The design itself: where six pins are in the straight finger, and the linkage they make."""

from __future__ import annotations

from typing import Any, Literal

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from designopt.io.spec_files import FORMAT
from designopt.numerics import as_float
from designopt.vectors import Vector, vector
from kinematics.io.reading import linkage_from
from kinematics.model.linkage import Linkage
from studies.models.body import BodySpec

Drive = Literal["joints", "crank"]


class Pins(eqx.Module):
    """Pins of the linkage in the straight finger, mm, by paper B's names (Fig. 3.3); H is its G'.

    Attributes:
        F: axis of the crank, on the proximal phalanx.
        E: crank and rod.
        D: rod and plate.
        C: plate and distal phalanx.
        G: bar and intermediate phalanx.
        H: bar and plate.
    """

    F: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    E: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    D: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    C: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    G: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    H: Float[Array, "*batch 2"] = eqx.field(converter=as_float)

    def places(self) -> dict[str, Vector]:
        """The six places by the names of their pins."""
        return {name: vector(getattr(self, name)) for name in "FEDCGH"}


def reference_pins() -> Pins:
    """A feasible design for a finger 25 mm thick, the one that checks are made with (design B)."""
    return Pins(
        F=np.array([-7.75, -2.0]),
        E=np.array([-21.27, 14.06]),
        D=np.array([-2.49, 13.73]),
        C=np.array([25.88, 5.27]),
        G=np.array([11.13, 2.01]),
        H=np.array([15.0, 19.0]),
    )


def told(pin: str) -> str:
    """A pin's name in files and for people: the paper's."""
    return "G'" if pin == "H" else pin


def linkage_table(
    pins: Pins, body: BodySpec, drive: Drive, spring: tuple[float, float] | None = None
) -> dict[str, Any]:
    """The tables of a linkage file.

    Args:
        pins: one design.
        body: the finger's section.
        drive: inputs are the joints ``pip`` and ``dip``, or ``theta`` of the crank and ``gamma``
            of the plate relative to the distal phalanx. Flexion is negative.
        spring: stiffness (N mm/rad) and preload (rad) of the torsion spring between distal
            phalanx and plate.
    """
    moving = {told(name): [float(x) for x in getattr(pins, name)] for name in "FEDCGH"}
    fixed = {
        "O": [-body.proximal, 0.0],
        "A": [0.0, 0.0],
        "B": [body.intermediate, 0.0],
        "T": [body.intermediate + body.distal, 0.0],
    }
    inputs = {
        "joints": [
            {"name": "pip", "body": "intermediate", "relative_to": "proximal"},
            {"name": "dip", "body": "distal", "relative_to": "intermediate"},
        ],
        "crank": [
            {"name": "theta", "body": "crank"},
            {"name": "gamma", "body": "plate", "relative_to": "distal"},
        ],
    }
    table: dict[str, Any] = {
        "linkage": {
            "name": "finger" if drive == "joints" else "finger, driven by its crank",
            "format": FORMAT,
        },
        "joints": fixed | moving,
        "bodies": {
            "proximal": {"joints": ["O", "A", "F"], "fixed": True},
            "intermediate": {"joints": ["A", "B", "G"]},
            "distal": {"joints": ["B", "T", "C"]},
            "plate": {"joints": ["C", "D", told("H")]},
            "rod": {"joints": ["D", "E"]},
            "crank": {"joints": ["F", "E"]},
            "bar": {"joints": ["G", told("H")]},
        },
        "inputs": inputs[drive],
    }
    if spring is not None:
        stiffness, preload = spring
        table["springs"] = [
            {"between": ["distal", "plate"], "stiffness": stiffness, "preload": preload}
        ]
    return table


def linkage_of(
    pins: Pins, body: BodySpec, drive: Drive, spring: tuple[float, float] | None = None
) -> Linkage:
    """The linkage of `linkage_table`, for `kinematics` to solve."""
    return linkage_from(linkage_table(pins, body, drive, spring), "finger")
