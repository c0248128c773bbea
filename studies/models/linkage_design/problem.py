"""The linkage as a design problem: the least transmission angle, in a body that can be built."""

from __future__ import annotations

import functools
from dataclasses import replace
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.optimize import Evaluation, Problem, Requirement
from designopt.vectors import Vector, rotation, vector
from studies.models.finger import Body, Finger, pins_of
from studies.models.linkage_design.postures import Postures, postures_at
from studies.models.linkage_design.spec import LimitsSpec
from studies.models.pins import Pins, pin_name

LENGTH = 5.0
"""Lengths are scaled by it, mm."""

ANGLE = 0.1
"""The level of the transmission angles is scaled by it, rad."""

SYMBOLS = {"D1": "μ_D1", "D2": "μ_D2", "C": "μ_C", "H": "μ_G'", "E": "μ_E", "P": "μ_P"}
"""The transmission angles as people know them; H is the paper's G'."""

HOSTS = {
    "F": "proximal",
    "E": "proximal",
    "D": "intermediate",
    "G": "intermediate",
    "H": "intermediate",
    "C": "distal",
}
"""The phalanx in whose section a pin lies and must stay. (An argument from their motions: F, G and
C are fixed there, E swings beside the proximal phalanx, D and G' beside the intermediate one.)"""

LINKS = {
    "proximal phalanx": "AF",
    "intermediate phalanx": "ABG",
    "distal phalanx": "BC",
    "plate": "CDH",
    "rod": "DE",
    "crank": "EF",
    "bar": "GH",
}
"""Pins on every link."""


def _coordinate(pin: str, index: tuple[int, ...]) -> str:
    return f"{'xy'[index[0]]} of pin {pin_name(pin)}"


COORDINATES = {pin: Requirement(functools.partial(_coordinate, pin), "mm") for pin in HOSTS}
"""The parameters as people know them."""

PAIRS = [
    (first, second)
    for pins in LINKS.values()
    for first, second in combinations(pins, 2)
    if (first, second) != ("A", "B")
]
"""Pins on one link whose distance the design decides."""


def pin_places(finger: Finger) -> dict[str, Float[np.ndarray, "2"]]:
    """Places of A, B and the six pins in the straight finger, plain numbers, mm."""
    axes = {"A": np.zeros(2), "B": np.array([finger.body.intermediate, 0.0])}
    return axes | {name: np.asarray(getattr(pins_of(finger), name)) for name in HOSTS}


def grid(body: Body, step_deg: float) -> Float[np.ndarray, " angles"]:
    """Flexion angles from straight to the end of the range, both included, rad."""
    range_deg = body.range_deg
    count = int(np.ceil(range_deg / step_deg - 1e-9)) + 1
    return np.deg2rad(np.linspace(0.0, range_deg, count))


def linkage_problem(
    finger: Finger,
    limits: LimitsSpec,
    pip: Float[np.ndarray, " pip"],
    dip: Float[np.ndarray, " dip"],
    allowance: float = 0.0,
) -> Problem:
    """Maximise the least of six transmission angles over a square of postures.

    Args:
        finger: its body; the pins are what is looked for.
        limits: what every posture must leave.
        pip: angles of PIP, rad; their combinations with those of DIP are the postures.
        dip: angles of DIP, rad.
        allowance: kept beyond every length that is required, mm.

    Returns:
        A problem in `Pins`, with ``least`` in rad by the symbols of the angles, inequalities by
        the requirements' names, and the turns of the postures as its data.
    """

    def terms(pins: Pins, knuckle: Vector, flexion: Vector) -> Evaluation:
        moved = replace(finger, pins=pins)
        postures = postures_at(moved, knuckle, flexion)
        return Evaluation(
            least={SYMBOLS[name]: values for name, values in postures.angles.items()},
            inequalities=inequalities(moved, postures, limits, allowance),
        )

    lower, upper = _box(finger.body, limits, allowance)
    scale = jax.tree.map(lambda leaf: jnp.full_like(leaf, LENGTH), lower)
    turns = (rotation(-jnp.asarray(angles)) for angles in (pip, dip))
    requirements = _requirements(np.rad2deg(pip), np.rad2deg(dip))
    return Problem(terms, lower, upper, scale, requirements, COORDINATES, tuple(turns))


def inequalities(
    finger: Finger, postures: Postures, limits: LimitsSpec, allowance: float = 0.0
) -> dict[str, Float[Array, "..."]]:
    """What the limits ask of a design in given postures; negative where it fails, scaled."""
    body, pins = finger.body, pins_of(finger)
    keep = limits.clearance + allowance
    # The turn, in rad, by which that moves the shortest link.
    turned = allowance / limits.spacing
    places = postures.inner | postures.outer | {"C": postures.distal_c}
    found = {
        "assembly of B-C-G'-G": (postures.reach[0] - limits.assembly - allowance) / LENGTH,
        "assembly of A-D-E-F": (postures.reach[1] - limits.assembly - allowance) / LENGTH,
        "crank closing with PIP": postures.pip_ratio - limits.turn,
        "crank closing with DIP": postures.dip_ratio - limits.turn,
        "plate turning with DIP": postures.gamma_slope - limits.turn,
        # Closing all the way, it is straight at one end of its range: no maximum, which a compiled
        # program would compute anew for every element beside it.
        "range of the crank": jnp.deg2rad(limits.crank_range_deg) - turned - postures.crank,
        "pins apart": (_distances(pins, body) - limits.spacing - allowance) / LENGTH,
        "|AF|": (vector(pins.F).length() - limits.crank_offset - allowance) / LENGTH,
        "|EF|": (limits.crank_length - allowance - vector(pins.E - pins.F).length()) / LENGTH,
    }
    for name, host in HOSTS.items():
        for side, distance in sides(places[name], host, body).items():
            found[f"pin {pin_name(name)} inside the {side}"] = (distance - keep) / LENGTH
    if limits.force_ratio is not None:
        bound = limits.force_ratio * (1 - turned)
        found["φ₂/φ₁"] = bound * postures.pip_ratio - postures.dip_ratio
    return found


def _distances(pins: Pins, body: Body) -> Float[Array, " pairs"]:
    zero = jnp.zeros_like(body.intermediate)
    at = pins.places() | {"A": Vector(zero, zero), "B": Vector(body.intermediate, zero)}
    return jnp.stack([(at[first] - at[second]).length() for first, second in PAIRS])


def sides(place: Vector, host: str, body: Body) -> dict[str, Float[Array, "..."]]:
    """Distances of a pin from the faces of its phalanx, and from the end that is the finger's.

    Apart, not in one array: compiled into one, each element would trace the pin anew, and the
    derivatives take a hundred times as long.
    """
    found = {"palmar face": place.y - body.palmar, "dorsal face": body.dorsal - place.y}
    if host == "proximal":
        found["rear end"] = place.x + body.proximal
    if host == "distal":
        found["tip"] = body.distal - place.x
    return found


def _box(body: Body, limits: LimitsSpec, allowance: float) -> tuple[Pins, Pins]:
    """Where the pins may be in the straight finger.

    Over the height of their phalanx, and along it so far that designs of many kinds fit.
    """
    keep = limits.clearance + allowance
    low, high = body.palmar + keep, body.dorsal - keep
    rear, tip = -body.proximal + keep, body.intermediate + body.distal - keep
    length = body.intermediate
    spans = {
        "F": (rear * 0.6, 0.35 * length),
        "E": (rear, 0.25 * length),
        "D": (-0.65 * length, 0.65 * length),
        "C": (0.8 * length, (length + tip) / 2),
        "G": (-0.2 * length, length),
        "H": (0.0, 1.2 * length),
    }
    lower = Pins(**{name: jnp.array([span[0], low]) for name, span in spans.items()})
    upper = Pins(**{name: jnp.array([span[1], high]) for name, span in spans.items()})
    return lower, upper


def _requirements(
    pip_deg: Float[np.ndarray, " pip"], dip_deg: Float[np.ndarray, " dip"]
) -> dict[str, Requirement]:
    lengths = ["assembly of B-C-G'-G", "assembly of A-D-E-F", "|AF|", "|EF|"]
    for name in HOSTS:
        for side in ("palmar face", "dorsal face", "rear end", "tip"):
            lengths.append(f"pin {pin_name(name)} inside the {side}")
    ratios = ["crank closing with PIP", "crank closing with DIP", "plate turning with DIP", "φ₂/φ₁"]
    amounts = dict.fromkeys(lengths, ("mm", LENGTH)) | dict.fromkeys(ratios, ("", 1.0))
    amounts |= dict.fromkeys(SYMBOLS.values(), ("°", float(np.rad2deg(ANGLE))))
    amounts["range of the crank"] = ("°", float(np.rad2deg(1.0)))

    def words(name: str, index: tuple[int, ...]) -> str:
        # What one angle decides is a row over DIP.
        axes = (("PIP", pip_deg), ("DIP", dip_deg))[2 - len(index) :]
        at = [f"{axis} {angles[i]:.3g}°" for (axis, angles), i in zip(axes, index, strict=True)]
        return f"{name} at {', '.join(at)}" if at else name

    def pair(index: tuple[int, ...]) -> str:
        first, second = PAIRS[index[0]]
        return f"distance of pins {pin_name(first)} and {pin_name(second)}"

    found = {
        name: Requirement(functools.partial(words, name), *amount)
        for name, amount in amounts.items()
    }
    return found | {"pins apart": Requirement(pair, "mm", LENGTH)}
