"""Put a sketch together: its equations, and their solution near to what was drawn.

Plain NumPy: this runs once, when a file is read.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from kinematics.model.topology import WORLD, Incidence, Structure

MOST_STEPS = 100
"""Evaluations of one attempt."""

CLOSED = 1e-9
"""Largest gap, in units of the linkage's size, of an assembled linkage."""

ATTEMPTS = 24
"""Starts of the assembly: the sketch itself, then the sketch with ever more disorder."""

DISORDERED = 8
"""Attempt from which on the disorder is as large as the linkage."""

POLISH = 4
"""Newton steps that take an assembled linkage to rounding."""


@dataclass(frozen=True)
class Dimensions:
    """The dimensions that enter the equations of a linkage, in mm and radians.

    Attributes:
        structure: who is joined to whom.
        places: coordinates of a joint in the frame of its body, `WORLD` included.
        points: first point of each slider's line, in the frame of its body.
        angles: direction of each slider's line there.
        turns: for sliders with a kept body its angle relative to the line's; NaN otherwise.
    """

    structure: Structure
    places: Mapping[tuple[str, str], np.ndarray]
    points: np.ndarray
    angles: np.ndarray
    turns: np.ndarray

    @property
    def size(self) -> float:
        """The largest dimension, mm."""
        fixed = [self.places[WORLD, joint] for joint in self.structure.fixed_joints]
        own = [np.hypot(*p) for (body, _), p in self.places.items() if body != WORLD]
        return float(max([*own, *(np.hypot(*(p - fixed[0])) for p in fixed), 1e-300]))


@dataclass(frozen=True)
class Configuration:
    """Where everything is, assembled or not.

    Attributes:
        joints: positions, mm.
        angles: angles of the moving bodies, rad.
        slides: places of the sliders, mm.
    """

    joints: Mapping[str, np.ndarray]
    angles: Mapping[str, float]
    slides: tuple[float, ...]


@dataclass(frozen=True)
class Assembled:
    """What came of putting a sketch together.

    Attributes:
        configuration: where everything is.
        gap: the largest gap that is left, mm.
        closed: whether it is rounding.
        fits: whether it is closed and the assembly that was sketched.
        gaps: the largest gap at every joint, mm.
    """

    configuration: Configuration
    gap: float
    closed: bool
    fits: bool
    gaps: Mapping[str, float]


class Equations:
    """The equations of an undriven linkage, in units of its size.

    Unknowns: place and angle of every moving body, place of every joint that is not fixed, every
    slide. Equations: two for every joint on a body, one for every kept body.
    """

    def __init__(self, dimensions: Dimensions) -> None:
        self.dimensions = dimensions
        structure = dimensions.structure
        self.size = dimensions.size
        self.moving = [body.name for body in structure.moving]
        fixed = set(structure.fixed_joints)
        self.free = [joint for joint in structure.joints if joint not in fixed]
        self.rows = [i for i in structure.incidences if i.body != WORLD or i.slider is not None]
        self.kept = [i for i, slider in enumerate(structure.sliders) if slider.keeps is not None]
        self._body_column = {name: 3 * i for i, name in enumerate(self.moving)}
        start = 3 * len(self.moving)
        self._joint_column = {joint: start + 2 * i for i, joint in enumerate(self.free)}
        self._slide_column = start + 2 * len(self.free)
        self.unknowns = 3 * len(self.moving) + 2 * len(self.free) + len(structure.sliders)
        self.count = 2 * len(self.rows) + len(self.kept)
        self.origin = dimensions.places[WORLD, structure.fixed_joints[0]]

    @property
    def kutzbach(self) -> int:
        """Mobility by counting: unknowns less equations.

        For links and pins this is 3 (L − 1) − 2 J (K. Kutzbach, 1929).
        """
        return self.unknowns - self.count

    def pack(self, configuration: Configuration) -> np.ndarray:
        """The vector of unknowns of a configuration."""
        parts = []
        for name in self.moving:
            first = self.dimensions.structure.body(name).joints[0]
            place = (configuration.joints[first] - self.origin) / self.size
            parts += [*place, configuration.angles[name]]
        for joint in self.free:
            parts += [*((configuration.joints[joint] - self.origin) / self.size)]
        return np.array([*parts, *(np.array(configuration.slides) / self.size)])

    def unpack(self, vector: np.ndarray) -> Configuration:
        """The configuration of a vector of unknowns, with angles from −π to π."""
        joints = {
            joint: self.dimensions.places[WORLD, joint]
            for joint in self.dimensions.structure.fixed_joints
        }
        for joint, at in self._joint_column.items():
            joints[joint] = self.origin + self.size * vector[at : at + 2]
        angles = {
            name: math.remainder(vector[at + 2], 2 * math.pi)
            for name, at in self._body_column.items()
        }
        slides = vector[self._slide_column :] * self.size
        return Configuration(joints, angles, tuple(float(slide) for slide in slides))

    def columns_of_body(self, name: str) -> slice:
        """The unknowns of a moving body."""
        return slice(self._body_column[name], self._body_column[name] + 3)

    def columns_of_joint(self, name: str) -> slice:
        """The unknowns of a joint that is not fixed."""
        return slice(self._joint_column[name], self._joint_column[name] + 2)

    def column_of_slide(self, slider: int) -> int:
        """The unknown of a slider."""
        return self._slide_column + slider

    def residual_and_jacobian(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is missing in every equation, and its derivatives."""
        residual = np.zeros(self.count)
        jacobian = np.zeros((self.count, self.unknowns))
        for n, incidence in enumerate(self.rows):
            rows = slice(2 * n, 2 * n + 2)
            place, column, along = self._on_body(incidence, vector)
            if incidence.body != WORLD:
                at = self._body_column[incidence.body]
                turn = _rotation(vector[at + 2])
                residual[rows] = vector[at : at + 2] + turn @ place
                jacobian[rows, at : at + 2] = np.eye(2)
                jacobian[rows, at + 2] = _rotation(vector[at + 2] + np.pi / 2) @ place
                along = turn @ along
            else:
                residual[rows] = place - self.origin / self.size
            if column is not None:
                jacobian[rows, column] = along
            if incidence.joint in self._joint_column:
                at = self._joint_column[incidence.joint]
                residual[rows] -= vector[at : at + 2]
                jacobian[rows, at : at + 2] -= np.eye(2)
            else:
                fixed = self.dimensions.places[WORLD, incidence.joint]
                residual[rows] -= (fixed - self.origin) / self.size
        for n, slider in enumerate(self.kept, start=2 * len(self.rows)):
            part = self.dimensions.structure.sliders[slider]
            assert part.keeps is not None
            difference = -self.dimensions.turns[slider]
            for name, sign in ((part.keeps, 1.0), (self._node(part.on), -1.0)):
                if name != WORLD:
                    at = self._body_column[name] + 2
                    difference += sign * vector[at]
                    jacobian[n, at] = sign
            residual[n] = np.remainder(difference + np.pi, 2 * np.pi) - np.pi
        return residual, jacobian

    def _on_body(
        self, incidence: Incidence, vector: np.ndarray
    ) -> tuple[np.ndarray, int | None, np.ndarray]:
        """Place in the body's frame, and column and direction of its slide."""
        if incidence.slider is None:
            place = self.dimensions.places[incidence.body, incidence.joint]
            return place / self.size, None, np.zeros(2)
        column = self.column_of_slide(incidence.slider)
        angle = self.dimensions.angles[incidence.slider]
        along = np.array([np.cos(angle), np.sin(angle)])
        point = self.dimensions.points[incidence.slider] / self.size
        return point + vector[column] * along, column, along

    def _node(self, body: str) -> str:
        return self.dimensions.structure.node(body)

    def input_rows(self) -> np.ndarray:
        """Derivatives of the inputs with respect to the unknowns."""
        structure = self.dimensions.structure
        rows = np.zeros((len(structure.inputs), self.unknowns))
        for n, part in enumerate(structure.inputs):
            if part.slider is not None:
                rows[n, self.column_of_slide(part.slider)] = 1.0
                continue
            assert part.body is not None
            for name, sign in ((part.body, 1.0), (self._node(part.relative_to), -1.0)):
                if name != WORLD:
                    rows[n, self._body_column[name] + 2] += sign
        return rows

    def assemble(
        self, sketch: Configuration, fits: Callable[[Configuration], bool] = lambda _: True
    ) -> Assembled:
        """Assemble near a sketch, if that can be with its inputs as they are drawn.

        Args:
            sketch: where to start.
            fits: whether a configuration is the assembly that was sketched; others are taken
                only if no such one is found.
        """
        drawn = self.pack(sketch)
        held = self.input_rows()
        random = np.random.default_rng(0)
        best = None
        for attempt in range(ATTEMPTS):
            disorder = min(attempt / DISORDERED, 1)
            start = drawn + disorder * random.standard_normal(drawn.shape)
            for rows in (held, held[:0]):
                found = self._closest(start, rows, rows @ drawn)
                residual = self.residual_and_jacobian(found)[0]
                gap = float(np.max(np.abs(residual)))
                configuration = self.unpack(found)
                closed = gap <= CLOSED
                assembled = Assembled(
                    configuration,
                    gap * self.size,
                    closed,
                    closed and fits(configuration),
                    self._gaps(residual),
                )
                if assembled.fits:
                    return assembled
                if best is None or (not best.closed and assembled.gap < best.gap):
                    best = assembled
        assert best is not None
        return best

    def _closest(self, start: np.ndarray, held: np.ndarray, values: np.ndarray) -> np.ndarray:
        """A least-squares solution near the start, with some quantities held at values."""

        def both(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            residual, jacobian = self.residual_and_jacobian(vector)
            rest = np.concatenate([residual, held @ vector - values])
            return rest, np.vstack([jacobian, held])

        found = _halving_steps(both, start)
        if found is None:
            import scipy.optimize  # half a second, and most sketches are drawn near to closing

            found = scipy.optimize.least_squares(
                lambda vector: both(vector)[0],
                start,
                jac=lambda vector: both(vector)[1],  # pyright: ignore[reportArgumentType]
                xtol=1e-15,
                ftol=1e-15,
                gtol=1e-15,
                max_nfev=MOST_STEPS,
            ).x
        rest, jacobian = both(found)
        for _ in range(POLISH):
            moved = found - np.linalg.lstsq(jacobian, rest)[0]
            rest_there, jacobian_there = both(moved)
            if not np.max(np.abs(rest_there)) < np.max(np.abs(rest)):
                break
            found, rest, jacobian = moved, rest_there, jacobian_there
        return found

    def _gaps(self, residual: np.ndarray) -> dict[str, float]:
        """The largest gap at every joint, mm."""
        gaps: dict[str, float] = {}
        for n, incidence in enumerate(self.rows):
            gap = self.size * float(np.hypot(*residual[2 * n : 2 * n + 2]))
            gaps[incidence.joint] = max(gaps.get(incidence.joint, 0.0), gap)
        return gaps


def _halving_steps(
    equations: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], start: np.ndarray
) -> np.ndarray | None:
    """Where Gauss's and Newton's steps alone lead, if each at least halves the largest residual.

    A trust region takes the same steps, as long as they are not too long for it.
    """
    found = start
    rest, jacobian = equations(found)
    while (gap := np.max(np.abs(rest))) > CLOSED:
        found = found - np.linalg.lstsq(jacobian, rest)[0]
        rest, jacobian = equations(found)
        if not np.max(np.abs(rest)) <= gap / 2:
            return None
    return found


def _rotation(angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])
