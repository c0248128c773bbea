"""Contact forces by the equilibrium of every link, which knows nothing of energy or of ratios.

Pins are placed by intersecting circles, then forces and moments are balanced on each of the six
moving links (R. L. Norton, *Design of Machinery*, ch. 11). Plain NumPy on purpose: nothing here
is shared with the equilibrium that it checks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LINKS = {
    "intermediate": "ABG",
    "distal": "BC",
    "plate": "CDH",
    "rod": "DE",
    "crank": "EF",
    "bar": "GH",
}
"""Moving links and their pins; A and F are on the proximal phalanx as well."""

CARRIER = {"A": "intermediate", "B": "distal", "C": "plate", "D": "rod", "E": "crank", "F": "crank"}
CARRIER |= {"G": "bar", "H": "plate"}
"""The link on which a pin's unknown force acts; on its other link it acts reversed."""


@dataclass(frozen=True)
class Push:
    """A contact: where it pushes, the unit vector in which, and on which link."""

    link: str
    place: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True)
class Balance:
    """What balances the links.

    Attributes:
        forces: of the pushes, N.
        stops: moments of the stops on PIP and DIP, N mm, positive in flexion; 0 where not held.
        pins: forces in the pins by name, N.
        residual: what is left of the balance over the largest force times length in it.
    """

    forces: np.ndarray
    stops: np.ndarray
    pins: dict[str, np.ndarray]
    residual: float


def pin_places(
    straight: dict[str, np.ndarray], intermediate: float, joints: np.ndarray
) -> dict[str, np.ndarray]:
    """Every pin in a posture, mm, in the proximal phalanx's frame.

    Args:
        straight: the pins C, D, E, F, G, H in the straight finger, mm.
        intermediate: from the PIP to the DIP axis, mm.
        joints: flexion of PIP and DIP, rad.
    """
    axis_b = np.array([intermediate, 0.0])
    pip, both = _turn(-joints[0]), _turn(-joints[0] - joints[1])
    at = {"A": np.zeros(2), "B": pip @ axis_b, "F": straight["F"], "G": pip @ straight["G"]}
    at["C"] = at["B"] + both @ (straight["C"] - axis_b)
    at["H"] = _meet(at["G"], at["C"], straight, "GCH")
    # D is rigid in the plate C-D-H.
    was, now = straight["H"] - straight["C"], at["H"] - at["C"]
    turn = np.arctan2(now[1], now[0]) - np.arctan2(was[1], was[0])
    at["D"] = at["C"] + _turn(turn) @ (straight["D"] - straight["C"])
    at["E"] = _meet(at["F"], at["D"], straight, "FDE")
    return at


def balance(
    at: dict[str, np.ndarray],
    pushes: list[Push],
    held: tuple[bool, bool],
    *,
    motor: float,
    spring: float,
    load: np.ndarray,
) -> Balance:
    """Pin forces, contact forces and stop moments that hold all links still.

    Args:
        at: the pins (`pin_places`).
        pushes: contacts that are closed.
        held: whether PIP and DIP rest on a stop.
        motor: T_a on the crank in the closing direction (clockwise), N mm.
        spring: moment of the torsion spring on the plate, N mm, clockwise; reversed on the distal
            phalanx.
        load: moments on PIP and DIP, N mm, positive in flexion (clockwise).
    """
    names, pins = list(LINKS), list(CARRIER)
    columns = 2 * len(pins) + len(pushes) + 2
    matrix, right = np.zeros((3 * len(names), columns)), np.zeros(3 * len(names))
    for j, pin in enumerate(pins):
        for link in (link for link, its in LINKS.items() if pin in its):
            row, sign = 3 * names.index(link), 1.0 if CARRIER[pin] == link else -1.0
            matrix[row, 2 * j] = matrix[row + 1, 2 * j + 1] = sign
            matrix[row + 2, 2 * j : 2 * j + 2] = sign * _moment_row(at[pin])
    for j, push in enumerate(pushes):
        row, column = 3 * names.index(push.link), 2 * len(pins) + j
        matrix[row : row + 2, column] = push.direction
        matrix[row + 2, column] = _moment_row(push.place) @ push.direction
    # A moment in flexion is clockwise: on PIP against the ground, on DIP between two phalanges.
    moments = {"intermediate": 2, "distal": 5, "plate": 8, "crank": 14}
    if held[0]:
        matrix[moments["intermediate"], -2] = -1.0
    if held[1]:
        matrix[moments["distal"], -1], matrix[moments["intermediate"], -1] = -1.0, 1.0
    for row, clockwise in (
        (moments["intermediate"], load[0] - load[1]),
        (moments["distal"], load[1]),
        (moments["crank"], motor),
        (moments["plate"], spring),
        (moments["distal"], -spring),
    ):
        right[row] += clockwise
    # Forces in N, moments over 10 mm: rows of like size.
    scale = np.tile([1.0, 1.0, 0.1], len(names))
    matrix, right = matrix * scale[:, None], right * scale
    found = np.linalg.lstsq(matrix, right, rcond=1e-13)[0]
    size = max(np.max(np.abs(found[: 2 * len(pins)])), np.max(np.abs(right)), 1e-300)
    left = matrix @ found - right
    count = len(pushes)
    return Balance(
        found[2 * len(pins) : 2 * len(pins) + count],
        found[2 * len(pins) + count :],
        {pin: found[2 * j : 2 * j + 2] for j, pin in enumerate(pins)},
        float(np.max(np.abs(left)) / size),
    )


def _turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _meet(
    first: np.ndarray, second: np.ndarray, straight: dict[str, np.ndarray], names: str
) -> np.ndarray:
    """The pin between two others, on the side of their line that it has in the straight finger."""
    a, b, c = (straight[name] for name in names)
    one, two = np.linalg.norm(c - a), np.linalg.norm(c - b)
    base = second - first
    distance = np.linalg.norm(base)
    along = (one**2 - two**2 + distance**2) / (2 * distance)
    across = np.sqrt(one**2 - along**2) * np.sign(_cross(b - a, c - a))
    unit = base / distance
    return first + along * unit + across * np.array([-unit[1], unit[0]])


def _cross(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _moment_row(place: np.ndarray) -> np.ndarray:
    """Row that takes a force to its moment about the PIP axis, counter-clockwise."""
    return np.array([-place[1], place[0]])
