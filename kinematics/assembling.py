"""Put a sketch together: its equations with nothing driven, their closest solution, their rank.

Plain NumPy: this runs once, when a file is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from kinematics.structure import WORLD, Incidence, Structure

CLOSED = 1e-9
"""Largest gap, in units of the linkage's size, of an assembled linkage."""

ATTEMPTS = 12
"""Starts of the assembly: the sketch itself, then the sketch with ever more disorder."""

INDEPENDENT = 1e-7
"""Singular values below this part of the largest count as zero."""


@dataclass(frozen=True)
class Dimensions:
    """What the equations need to know of a linkage, in mm and radians.

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
        """The configuration of a vector of unknowns."""
        joints = {
            joint: self.dimensions.places[WORLD, joint]
            for joint in self.dimensions.structure.fixed_joints
        }
        start = 3 * len(self.moving)
        for i, joint in enumerate(self.free):
            joints[joint] = self.origin + self.size * vector[start + 2 * i : start + 2 * i + 2]
        angles = {name: float(vector[3 * i + 2]) for i, name in enumerate(self.moving)}
        slides = vector[start + 2 * len(self.free) :] * self.size
        return Configuration(joints, angles, tuple(float(slide) for slide in slides))

    def residual_and_jacobian(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is missing in every equation, and its derivatives."""
        residual = np.zeros(self.count)
        jacobian = np.zeros((self.count, self.unknowns))
        for n, incidence in enumerate(self.rows):
            rows = slice(2 * n, 2 * n + 2)
            place, column, along = self._on_body(incidence, vector)
            if incidence.body != WORLD:
                at = 3 * self.moving.index(incidence.body)
                turn = _rotation(vector[at + 2])
                residual[rows] = vector[at : at + 2] + turn @ place
                jacobian[rows, at : at + 2] = np.eye(2)
                jacobian[rows, at + 2] = _rotation(vector[at + 2] + np.pi / 2) @ place
                along = turn @ along
            else:
                residual[rows] = place - self.origin / self.size
            if column is not None:
                jacobian[rows, column] = along
            if incidence.joint in self.free:
                at = 3 * len(self.moving) + 2 * self.free.index(incidence.joint)
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
                    at = 3 * self.moving.index(name) + 2
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
        column = 3 * len(self.moving) + 2 * len(self.free) + incidence.slider
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
                rows[n, 3 * len(self.moving) + 2 * len(self.free) + part.slider] = 1.0
                continue
            assert part.body is not None
            for name, sign in ((part.body, 1.0), (self._node(part.relative_to), -1.0)):
                if name != WORLD:
                    rows[n, 3 * self.moving.index(name) + 2] += sign
        return rows

    def assemble(self, sketch: Configuration) -> tuple[Configuration, float]:
        """The assembled configuration near a sketch, and its largest gap (mm)."""
        start = self.pack(sketch)
        random = np.random.default_rng(0)
        best, gap = start, np.inf
        for attempt in range(ATTEMPTS):
            disorder = attempt / ATTEMPTS * random.standard_normal(start.shape)
            found = scipy.optimize.least_squares(
                lambda vector: self.residual_and_jacobian(vector)[0],
                start + disorder,
                jac=lambda vector: self.residual_and_jacobian(vector)[1],
                xtol=1e-15,
                ftol=1e-15,
                gtol=1e-15,
                max_nfev=200,
            )
            largest = float(np.max(np.abs(found.fun)))
            if largest < gap:
                best, gap = found.x, largest
            if gap <= CLOSED:
                break
        return self.unpack(best), gap * self.size

    def mobility(self, configuration: Configuration) -> int:
        """Mobility by rank: dimension of the motions that keep every equation, to first order."""
        _, jacobian = self.residual_and_jacobian(self.pack(configuration))
        return self.unknowns - rank(jacobian)

    def driven_rank(self, configuration: Configuration) -> int:
        """Rank of the equations with the inputs held."""
        _, jacobian = self.residual_and_jacobian(self.pack(configuration))
        return rank(np.vstack([jacobian, self.input_rows()]))


def rank(matrix: np.ndarray) -> int:
    """Numerical rank; `INDEPENDENT` is the threshold."""
    if 0 in matrix.shape:
        return 0
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > INDEPENDENT * values[0]))


def _rotation(angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])
