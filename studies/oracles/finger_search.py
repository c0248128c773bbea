"""The finger's linkage by a global search of its own, from nothing but plain numbers.

Everything is written out a second time, in the frame of the intermediate phalanx: pins by circles
that meet, velocities and the crank's turns by central differences of places, transmission angles by
their definition (H. Alt, 1932: 90° less the angle between the force on a link and the velocity of
the pin on which it acts), clearances by distances of segments. Differential evolution looks for the
largest least angle, feasible designs before others (K. Deb, *Comput. Methods Appl. Mech. Eng.* 186,
2000); what it ends with is improved by linear programs in a trust region, with slopes by
differences (R. Fletcher, *Practical Methods of Optimization*, 2nd ed., 1987, ch. 14).

Palmar faces are not among the parts that bars keep from: the axles cross all layers of bars, and
between them and the faces is no room for one.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

PINS = "FEDCGH"
"""In the order of a design's coordinates, x and y of each in the straight finger; H is G'."""

ON_LINKS = ("AF", "ABG", "BC", "FEK", "ED", "CDH", "GH")
"""Pins of every link. Those of one link keep a distance."""

LAYERS = (
    {"crank": "FEK", "plate": "CDH", "driver": "MN"},
    {"rod": "ED", "bar": "GH", "coupler": "NK"},
)
"""Bars by the layer in which they lie, with their pins. Both axles cross both layers."""

STEP = 1e-5
"""Of the joints' angles for differences, rad."""

Complex = NDArray[np.complexfloating]
Places = dict[str, Complex]


@dataclass(frozen=True)
class Asked:
    """What is asked of the linkage, lengths in mm; defaults are those of the study.

    Attributes:
        proximal, intermediate, distal, thickness, axis_height: of the body.
        range_deg: flexion of either joint.
        bar_width, axle_diameter, shell: of bars, of the axles A and B, of faces and ends.
        clearance: between parts, and from them to faces and ends.
        spacing: least distance of pins on a link.
        crank_offset, crank_length: least |AF|, greatest |EF|.
        crank_range_deg: greatest turn of the crank.
        assembly: least distance of a pair of links from stretching and folding.
        turn: least turn of crank and plate per turn of a joint.
        ratio: greatest φ₂/φ₁; any if none.
        motor: its axis behind the finger and above the crank's, the crank's arm; none if it is at
            the crank.
        pinch: force, its place k₂, moment of the wound spring, N, mm, N mm; none if any will do.
        tip: force, its place from PIP, the motor's moment, N, mm, N mm; none if any will do.
        allowance: kept beyond every length; a turn keeps what it is of the least spacing, in rad,
            the ratio that share of itself, and the pinch's force ten times that.
    """

    proximal: float = 35.0
    intermediate: float = 23.0
    distal: float = 32.0
    thickness: float = 25.0
    axis_height: float = 4.0
    range_deg: float = 90.0
    bar_width: float = 4.0
    axle_diameter: float = 4.0
    shell: float = 1.2
    clearance: float = 0.5
    spacing: float = 6.0
    crank_offset: float = 8.0
    crank_length: float = 22.0
    crank_range_deg: float = 100.0
    assembly: float = 1.0
    turn: float = 0.01
    ratio: float | None = None
    motor: tuple[float, float, float] | None = None
    pinch: tuple[float, float, float] | None = None
    tip: tuple[float, float, float] | None = None
    allowance: float = 0.0

    def grid(self, count: int) -> NDArray[np.float64]:
        """So many angles of a joint from straight to the end of its range, rad."""
        return np.linspace(0.0, math.radians(self.range_deg), count)


class Measured(NamedTuple):
    """Designs in the postures of a grid; arrays begin with the design, then PIP and DIP.

    Attributes:
        angles_deg: transmission angles by name (``H`` at G'), degrees.
        ratio: φ₂/φ₁.
        crank_deg: turn of the crank from straight in the closing direction, degrees.
        apart: what pairs of parts keep, mm; where the middle lines of bars cross, that of lines
            that touch.
        inside: what axes of pins keep from faces and ends, mm, by pin and side.
        margins: every requirement by name, what is left of it: mm, degrees for the crank's range,
            N mm for a pinch, N at the tip, else turns per turn; negative where it is not met.
    """

    angles_deg: dict[str, NDArray[np.float64]]
    ratio: NDArray[np.float64]
    crank_deg: NDArray[np.float64]
    apart: dict[tuple[str, str], NDArray[np.float64]]
    inside: dict[tuple[str, str], NDArray[np.float64]]
    margins: dict[str, NDArray[np.float64]]

    @property
    def least_deg(self) -> NDArray[np.float64]:
        """Least transmission angle of every design, degrees."""
        return np.min([each.min(axis=(1, 2)) for each in self.angles_deg.values()], axis=0)

    @property
    def worst(self) -> NDArray[np.float64]:
        """By how much the requirement that is met least is missed, or less than 0."""
        return np.max([-each.min(axis=(1, 2)) for each in self.margins.values()], axis=0)


def measure(designs: NDArray[np.float64], asked: Asked, count: int) -> Measured:
    """Designs over a square of postures.

    Args:
        designs: coordinates by `PINS`, shape (designs, 12), mm.
        asked: what is asked of them.
        count: angles of each joint.
    """
    given = np.asarray(designs, float).reshape(-1, 6, 2)
    at = given[..., 0] + 1j * given[..., 1]
    was: Places = {pin: at[:, i, None, None] for i, pin in enumerate(PINS)}
    was |= {"A": np.zeros((1, 1, 1), complex), "B": np.full((1, 1, 1), complex(asked.intermediate))}
    pip, dip = asked.grid(count)[:, None], asked.grid(count)[None, :]
    if asked.motor is not None:
        was |= _motor(was, asked)
    here, reach = _places(was, pip, dip)
    by_pip, by_dip = (
        [_places(was, pip + sign * one, dip + sign * other)[0] for sign in (1, -1)]
        for one, other in ((STEP, 0.0), (0.0, STEP))
    )
    angles = _angles(here, by_pip, by_dip, pip)
    swing = [
        _turn(_crank(ends[0], pip + one), _crank(ends[1], pip - one)) / (2 * STEP)
        for ends, one in ((by_pip, STEP), (by_dip, 0.0))
    ]
    first, second = swing
    plate = 1 - _turn(*(ends["D"] - ends["C"] for ends in by_dip)) / (2 * STEP)
    crank = np.rad2deg(_turn(_crank(here, pip), was["E"] - was["F"]))
    apart, inside = _apart(here, asked), _inside(here, was, pip, asked)
    extra = asked.allowance
    turned = extra / asked.spacing
    margins = {
        "assembly": reach - asked.assembly - extra,
        "crank closing with PIP": first - asked.turn,
        "crank closing with DIP": second - asked.turn,
        "plate turning with DIP": plate - asked.turn,
        "range of the crank": asked.crank_range_deg - math.degrees(turned) - crank,
        "|AF|": abs(was["F"]) - asked.crank_offset - extra,
        "|EF|": asked.crank_length - extra - abs(was["E"] - was["F"]),
    }
    if asked.ratio is not None:
        margins["φ₂/φ₁"] = asked.ratio * (1 - turned) * first - second
    if asked.pinch is not None:
        force, place, moment = asked.pinch
        arm = place + asked.intermediate
        margins["pinch held"] = (
            moment * plate * first + force * (1 + 10 * turned) * (place * first - arm * second)
        )[:, :, :1]
    if asked.tip is not None:
        force, place, moment = asked.tip
        margins["force at the tip"] = (moment * first / place - force)[:, :, :1]
    margins |= {
        f"{a}-{b} apart": abs(was[a] - was[b]) - asked.spacing - extra
        for link in ON_LINKS
        for a, b in combinations([pin for pin in link if pin in was], 2)
        if (a, b) != ("A", "B")
    }
    margins |= {f"{a} from {b}": each - asked.clearance - extra for (a, b), each in apart.items()}
    keep = asked.bar_width / 2 + asked.shell + asked.clearance + extra
    margins |= {f"{pin} inside the {side}": each - keep for (pin, side), each in inside.items()}
    return Measured(angles, second / first, crank, apart, inside, margins)


def _places(was: Places, pip: NDArray, dip: NDArray) -> tuple[Places, NDArray]:
    """Pins in the intermediate phalanx's frame, and how far the linkage is from lock-up, mm."""
    back, middle = np.exp(1j * pip), was["B"]
    at = {"A": was["A"], "B": middle, "C": middle + (was["C"] - middle) * np.exp(-1j * dip)}
    at |= {"G": was["G"], "F": was["F"] * back}
    at["H"], one = _meet(at["G"], at["C"], was["G"], was["C"], was["H"])
    at["D"] = at["C"] + (was["D"] - was["C"]) * (at["H"] - at["C"]) / (was["H"] - was["C"])
    at["E"], other = _meet(at["F"], at["D"], was["F"], was["D"], was["E"])
    if "K" in was:
        arm = (was["K"] - was["F"]) * (at["E"] - at["F"]) / (was["E"] - was["F"])
        at |= {"K": at["F"] + arm, "M": was["M"] * back, "N": was["M"] * back + arm}
    return at, np.minimum(one, other)


def _meet(
    one: Complex, other: Complex, was_one: Complex, was_other: Complex, was: Complex
) -> tuple[Complex, NDArray]:
    """Where circles about two pins meet, on the side on which they did, and their reach, mm."""
    near, far, span = abs(was - was_one), abs(was - was_other), abs(other - one)
    side = np.sign(((was_other - was_one).conjugate() * (was - was_one)).imag)
    along = (span**2 + near**2 - far**2) / (2 * span)
    across = np.sqrt(np.maximum(near**2 - along**2, 0.0))
    reach = np.minimum(near + far - span, span - abs(near - far))
    return one + (other - one) / span * (along + 1j * side * across), reach


def _motor(was: Places, asked: Asked) -> Places:
    """K and the motor's axis M; F-K is at right angles to M-F amid the crank's range."""
    assert asked.motor is not None
    behind, above, length = asked.motor
    end = np.full((1, 1), math.radians(asked.range_deg))
    turned = _turn(_crank(_places(was, end, end)[0], end), was["E"] - was["F"])
    axis = -asked.proximal - behind + 1j * (was["F"].imag + above)
    towards = (axis - was["F"]) / abs(axis - was["F"])
    return {"M": axis, "K": was["F"] - 1j * length * towards * np.exp(0.5j * turned)}


def _crank(at: Places, pip: NDArray) -> Complex:
    """The crank in the proximal phalanx's frame."""
    return (at["E"] - at["F"]) * np.exp(-1j * pip)


def _turn(end: Complex, start: Complex) -> NDArray:
    """Clockwise turn from a line to another, rad."""
    return -np.angle(end * start.conjugate())


def _angles(
    here: Places, by_pip: list[Places], by_dip: list[Places], pip: NDArray
) -> dict[str, NDArray]:
    """Transmission angles, degrees."""

    def velocity(ends: list[Places], pin: str, turned: float) -> Complex:
        # Seen from the proximal phalanx, by how far PIP turned the frame between both ends.
        return ends[0][pin] * cmath.exp(-1j * turned) - ends[1][pin] * cmath.exp(1j * turned)

    rod, bar, arm = here["E"] - here["D"], here["G"] - here["H"], here["H"] - here["C"]
    # On the plate rod and bar balance about C; what they leave, the pin C gives the phalanx.
    lever_rod = ((here["D"] - here["C"]).conjugate() * rod).imag
    lever_bar = (arm.conjugate() * bar).imag
    at_c = lever_bar * rod - lever_rod * bar
    acting = {
        "D1": (rod, velocity(by_pip, "D", STEP)),
        "D2": (rod, velocity(by_dip, "D", 0.0)),
        "C": (arm, velocity(by_dip, "C", 0.0)),
        "H": (arm, velocity(by_dip, "H", 0.0)),
        "E": (rod, velocity(by_pip, "E", STEP)),
        "P": (at_c, velocity(by_dip, "C", 0.0)),
    }
    shape = np.broadcast_shapes(rod.shape, pip.shape)
    return {
        name: np.broadcast_to(_pressed(force, moved), shape)
        for name, (force, moved) in acting.items()
    }


def _pressed(force: Complex, moved: Complex) -> NDArray:
    """90° less the angle between the lines of a force and of a velocity, degrees."""
    product = force.conjugate() * moved
    return np.rad2deg(np.arctan2(abs(product.real), abs(product.imag)))


def _apart(at: Places, asked: Asked) -> dict[tuple[str, str], NDArray]:
    """Clearances of bars of one layer, and of bars from the axles, mm."""
    width, found = asked.bar_width, {}
    for layer in LAYERS:
        bars = {bar: [at[pin] for pin in pins if pin in at] for bar, pins in layer.items()}
        bars = {bar: corners for bar, corners in bars.items() if len(corners) > 1}
        for one, other in combinations(bars, 2):
            found[one, other] = _distance(bars[one], bars[other]) - width
        for bar, corners in bars.items():
            for axle in "AB":
                between = _distance(corners, [at[axle]])
                found[bar, axle] = between - (width + asked.axle_diameter) / 2
    return found


def _distance(one: list[Complex], other: list[Complex]) -> NDArray:
    """Of two points, segments or triangles by their corners; 0 where they overlap."""
    found = [_to_edge(p, *edge) for p in one for edge in _edges(other)]
    found += [_to_edge(p, *edge) for p in other for edge in _edges(one)]
    between = _least(found)
    for a, b in _edges(one):
        for c, d in _edges(other):
            across = _side(a, b, c) * _side(a, b, d) < 0
            between = np.where(across & (_side(c, d, a) * _side(c, d, b) < 0), 0.0, between)
    for corners, point in ((one, other[0]), (other, one[0])):
        if len(corners) == 3:
            sides = [_side(*edge, point) for edge in _edges(corners)]
            within = (np.sign(sides[0]) == np.sign(sides[1])) & (
                np.sign(sides[1]) == np.sign(sides[2])
            )
            between = np.where(within, 0.0, between)
    return between


def _least(found: list[NDArray]) -> NDArray:
    least = found[0]
    for each in found[1:]:
        least = np.minimum(least, each)
    return least


def _edges(corners: list[Complex]) -> list[tuple[Complex, Complex]]:
    around = corners if len(corners) < 3 else [*corners, corners[0]]
    return list(pairwise(around))


def _side(a: Complex, b: Complex, p: Complex) -> NDArray:
    return ((b - a).conjugate() * (p - a)).imag


def _to_edge(p: Complex, a: Complex, b: Complex) -> NDArray:
    along, to = b - a, p - a
    part = (to * along.conjugate()).real / (along.real**2 + along.imag**2)
    return abs(to - np.clip(part, 0.0, 1.0) * along)


def _inside(at: Places, was: Places, pip: NDArray, asked: Asked) -> dict[tuple[str, str], NDArray]:
    """What axes of pins keep from faces and ends of their phalanx; the back is round at joints."""
    ahead, found = np.exp(-1j * pip), {}
    own = {pin: (at[pin] * ahead, -math.inf, 0.0) for pin in "FEK" if pin in at}
    own |= {pin: (at[pin], 0.0, asked.intermediate) for pin in "DGH"}
    own["C"] = was["C"] - was["B"], 0.0, math.inf
    for pin, (place, start, end) in own.items():
        # Heights are distances from the line of the phalanx between its axes.
        foot = np.clip(place.real, start, end)
        height = np.where(foot == place.real, place.imag, abs(place - foot))
        found[pin, "palmar face"] = place.imag + asked.axis_height
        found[pin, "dorsal face"] = asked.thickness - asked.axis_height - height
        if start == -math.inf:
            found[pin, "rear end"] = place.real + asked.proximal
        if end == math.inf:
            found[pin, "tip"] = asked.distal - place.real
    return found


class Found(NamedTuple):
    """What a search ended with.

    Attributes:
        design: coordinates by `PINS`, mm.
        least_deg: its least transmission angle over the finest postures, degrees.
        worst: by how much it misses a requirement there; 0 or less if it meets all.
        evolved_deg: least angles that differential evolution ended with on the coarse postures, by
            run, degrees; NaN where that met not all requirements.
        improved_deg: what linear programs made of each on the coarse postures, likewise.
    """

    design: NDArray[np.float64]
    least_deg: float
    worst: float
    evolved_deg: list[float]
    improved_deg: list[float]


def find_design(
    asked: Asked,
    seed: int,
    *,
    runs: int = 10,
    generations: int = 600,
    population: int = 12,
    kept: int = 2,
    counts: tuple[int, ...] = (7, 13, 31, 91),
) -> Found:
    """The design of the largest least transmission angle.

    Args:
        asked: what is asked.
        seed: of the random numbers.
        runs: of differential evolution, each from another population.
        generations: of each.
        population: designs per coordinate.
        kept: different designs of each last population that are improved.
        counts: angles of each joint, of the coarse postures and of those on which the best design
            is improved again, one after the other.
    """
    low, high = _box(asked)

    def objective(columns: NDArray[np.float64]) -> NDArray[np.float64]:
        found = measure(columns.T, asked, counts[0])
        missed = sum(
            np.sum(np.maximum(-each, 0.0), axis=(1, 2)) / each[0].size
            for each in found.margins.values()
        )
        return np.where(missed > 0, 1e3 + missed, -found.least_deg)

    evolved, improved = [], []
    for run in range(runs):
        result = scipy.optimize.differential_evolution(
            objective,
            list(zip(low, high, strict=True)),
            maxiter=generations,
            popsize=population,
            tol=0.0,
            mutation=(0.4, 0.9),
            rng=np.random.default_rng((seed, run)),
            polish=False,
            vectorized=True,
            updating="deferred",
        )
        evolved.append(-float(result.fun) if result.fun < 0 else math.nan)
        ends = [improve(start, asked, counts[0]) for start in _different(result, kept)]
        improved.append(max(ends, key=lambda one: _merit(one[None], asked, counts[0])[0]))
    merits = [_merit(one[None], asked, counts[0])[0] for one in improved]
    best = improved[int(np.argmax(merits))]
    for count in counts[1:]:
        best = improve(best, asked, count)
    last = measure(best[None], asked, counts[-1])
    coarse = measure(np.array(improved), asked, counts[0])
    reached = np.where(coarse.worst <= NEARLY, coarse.least_deg, math.nan)
    return Found(best, float(last.least_deg[0]), float(last.worst[0]), evolved, reached.tolist())


PRICE = 1e4
"""Degrees that are given for a unit of a requirement that is missed."""

NEARLY = 1e-4
"""Largest miss of a design that counts as meeting its requirements."""

APART = 2.0
"""Designs are different if a coordinate differs by more than this, mm."""


STEPS = 100
"""Most linear programs of one improvement."""

LARGEST = 4.0
"""Of its trust region, mm."""


def _box(asked: Asked) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where pins may be in the straight finger, mm: far beyond the phalanx they belong to."""
    keep = asked.bar_width / 2 + asked.shell + asked.clearance
    rear, tip = keep - asked.proximal, asked.intermediate + asked.distal - keep
    spans = [(rear, asked.intermediate)] * 2 + [(rear, tip), (0.0, tip), (rear, tip), (rear, tip)]
    low, high = keep - asked.axis_height, asked.thickness - asked.axis_height - keep
    ends = np.array([[(left, low), (right, high)] for left, right in spans])
    return ends[:, 0].ravel(), ends[:, 1].ravel()


def _different(result: scipy.optimize.OptimizeResult, count: int) -> list[NDArray[np.float64]]:
    """The best designs of a population that differ from each other."""
    chosen: list[NDArray[np.float64]] = []
    for one in result.population[np.argsort(result.population_energies)]:
        if all(np.max(abs(one - other)) > APART for other in chosen):
            chosen.append(one)
    return chosen[:count]


def _merit(designs: NDArray[np.float64], asked: Asked, count: int) -> NDArray[np.float64]:
    found = measure(designs, asked, count)
    return found.least_deg - PRICE * np.maximum(found.worst, 0.0)


def improve(
    design: NDArray[np.float64], asked: Asked, count: int, radius: float = 0.5
) -> NDArray[np.float64]:
    """A local optimum near a design, by linear programs in a trust region of so many mm."""
    size, step, merit = len(design), 1e-6, _merit(design[None], asked, count)[0]
    moves = np.concatenate([np.zeros((1, size)), step * np.eye(size), -step * np.eye(size)])
    for _ in range(STEPS):
        found = measure(design + moves, asked, count)
        angles, margins = (
            np.concatenate([each.reshape(len(moves), -1) for each in of.values()], axis=1)
            for of in (found.angles_deg, found.margins)
        )
        # What is far from deciding within the region is left out.
        angles = angles[:, angles[0] < angles[0].min() + 40 * radius]
        margins = margins[:, margins[0] < 20 * radius]
        slopes = [(of[1 : size + 1] - of[size + 1 :]).T / (2 * step) for of in (angles, margins)]
        # Unknowns: the move, the level of the angles, and the greatest miss.
        rows = np.concatenate(
            [
                np.column_stack([-slopes[0], np.ones(len(slopes[0])), np.zeros(len(slopes[0]))]),
                np.column_stack([-slopes[1], np.zeros(len(slopes[1])), -np.ones(len(slopes[1]))]),
            ]
        )
        solved = scipy.optimize.linprog(
            np.concatenate([np.zeros(size), [-1.0, PRICE]]),
            rows,
            np.concatenate([angles[0], margins[0]]),
            bounds=[(-radius, radius)] * size + [(None, None), (0.0, None)],
        )
        if solved.x is None:
            break
        there = design + solved.x[:size]
        reached = _merit(there[None], asked, count)[0]
        expected = solved.x[size] - PRICE * solved.x[size + 1] - merit
        if expected < 1e-6 or radius < 1e-6:
            break
        if reached > merit:
            good = reached - merit > 0.5 * expected
            design, merit, radius = there, reached, min(radius * (2.0 if good else 0.7), LARGEST)
        else:
            radius /= 3
    return design
