"""A linkage as a function of its distances: how well it transmits, and where it assembles."""

from __future__ import annotations

import functools
import itertools
import math
import tomllib
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.spec import SpecFile
from designopt.optimize.parametric import Measure, MeasureBound, Parameter, ParametricDesign, Values
from kinematics.io.designed import DesignedLinkage
from kinematics.io.reading import parse_linkage
from kinematics.model.assembled import zeroed
from kinematics.parametric.dimensions import Dimensions
from kinematics.parametric.evaluator import PoseEvaluator
from kinematics.parametric.spec_text import spec_text
from kinematics.solve.plan import make_plan
from kinematics.solve.transmission import solve_poses_and_angles

SHORTEST, LONGEST = 0.5, 1.7
"""Range of a distance, as parts of what it is."""

INSIDE = 0.02
"""How far from where an input locks its working range ends, as a part of the range between: at the
limit itself no distances transmit anything."""

ALONG_ONE, ALONG_ONE_FOLLOWED = 41, 21
"""Poses over the range of a single input; fewer where every pose has to be followed. An odd number
has both 0° and 180° of a full turn among them."""

ALONG_EACH = {2: 9, 3: 5}
"""Poses over the range of each of several inputs; 3 of more than three."""

FINER_ONE, FINER_EACH = 16, 4
"""Steps of the grid on which a design is judged, per step of that on which it is searched."""

LEAST_MARGIN = 1e-3
"""Of every pose, as a part of the greatest distance."""

LEAST_SLACK = 1e-3
"""Of every triangle; see `Dimensions.slack`."""

TOUCHING = 1e-9
"""A margin of at most so many greatest distances is that of a change point."""

ANGLE_DEG, MARGIN = 17.0, 0.1
"""Degrees, and greatest distances, that matter as much as a distance's whole range."""


class LinkageDesign(ParametricDesign):
    """A linkage as a function of the distances between its joints.

    It is judged over the working range of its file: of a single input from limit to limit, but for
    `INSIDE` of the way at each of them; of several inputs on a grid over such ranges, where the
    linkage of the file has poses with more than so much of the greatest margin. A range that is
    given is judged from end to end.
    """

    def __init__(
        self, design: DesignedLinkage, over: Mapping[str, tuple[float, float]] | None = None
    ) -> None:
        """Nothing is compiled yet.

        Args:
            design: the linkage.
            over: ends of some inputs' ranges by their names, degrees or mm.

        Raises:
            UserError: there is no such input, or its range is none.
        """
        self.title = design.name
        self.dimensions, self.designed = Dimensions.of(design)
        self.poses = PoseEvaluator(design.linkage, self.dimensions)
        self._over = dict(over or {})
        self._check_ranges()
        self._free = np.array(self.dimensions.free, int)
        self._greatest = float(np.max(self.designed))
        self.parameters = tuple(map(self._parameter, self.dimensions.free))
        self.measures = tuple(self._measures())

    # -- what it is made of ---------------------------------------------------------------------

    def distances(self, values: Values) -> Float[np.ndarray, " distances"]:
        """All distances of a design, mm, those that are no parameters among them."""
        distances = self.designed.copy()
        distances[self._free] = [values[parameter.name] for parameter in self.parameters]
        return distances

    def inside(self, column: int, shown: float) -> float:
        """The value of an input, rad or mm, of degrees or mm as people read it."""
        return math.radians(shown) if self.poses.turning[column] else float(shown)

    def shown(self, column: int, value: float) -> float:
        """The value of an input as people read it, degrees or mm, of rad or mm."""
        return zeroed(math.degrees(value) if self.poses.turning[column] else value)

    def shown_text(self, column: int, value: float) -> str:
        """The same in words, such as "161.60°"."""
        text = f"{self.shown(column, value):.2f}°" if self.poses.turning[column] else ""
        return text or f"{self.shown(column, value):.3f} mm"

    def _check_ranges(self) -> None:
        names = self.poses.linkage.input_names
        for name, (low, high) in self._over.items():
            if name not in names:
                raise UserError(
                    f"--over {name}: {self.title} has no such input; there are {', '.join(names)}"
                )
            if not (low < high and math.isfinite(high - low)):
                raise UserError(f"--over {name}={low:g}:{high:g}: give a range, low < high")

    def _parameter(self, number: int) -> Parameter:
        distance, value = self.dimensions.distances[number], float(self.designed[number])
        low, high = SHORTEST * value, LONGEST * value
        return Parameter(distance.name, value, low, high, "mm", distance.label, (0.0, math.inf))

    def _measures(self) -> list[Measure]:
        over = " and ".join(self.poses.linkage.input_names)
        angle = {"unit": "°", "scale": ANGLE_DEG, "limits": (0.0, 90.0)}
        found = []
        if self.poses.pins:
            words = f"least transmission angle over the range of {over}"
            found.append(
                Measure("min_transmission", description=words, where=self._where_pin, **angle)
            )
        for pin in self.poses.pins:
            words = f"transmission angle at {pin}"
            found.append(Measure(f"mu.{pin}", description=words, where=self._where, **angle))
        words = "distance from where the linkage cannot be assembled"
        scale = MARGIN * self._greatest
        found.append(Measure("margin", "mm", words, scale=scale, where=self._where))
        if self._triangles:
            words = "least sine of a body's angles, squared; negative where its triangle is open"
            found.append(
                Measure("triangles", "", words, limits=(-math.inf, 1.0), where=self._where_triangle)
            )
        words = "greatest distance between two joints"
        scale = 0.5 * self._greatest
        found.append(
            Measure("size", "mm", words, "greatest", scale, (0.0, math.inf), self._where_distance)
        )
        return found

    @functools.cached_property
    def requirements(self) -> tuple[MeasureBound, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Every pose of the range assembles, and every body's distances make triangles.

        Of a linkage whose file touches a change point, or almost does, half of its own margin is
        asked for.
        """
        least = LEAST_MARGIN * self._greatest
        own = self._judged_poses(self.designed)[1].min()
        if -TOUCHING * self._greatest < own < 2 * least:
            least = own / 2 if own > TOUCHING * self._greatest else -TOUCHING * self._greatest
        found = [MeasureBound("margin", ">=", least, "every pose of the range assembles")]
        if self._triangles:
            own = float(np.min(np.asarray(self.dimensions.slack(jnp.asarray(self.designed)))))
            least = min(LEAST_SLACK, own / 2)
            found.append(MeasureBound("triangles", ">=", least, "the distances of every body fit"))
        return tuple(found)

    # -- the range in which it works ------------------------------------------------------------

    @functools.cached_property
    def cases(self) -> Float[np.ndarray, "cases inputs"]:
        """Inputs of the poses by which a design is searched, rad or mm."""
        return self._grids[0]

    @functools.cached_property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """The working range of every input, rad or mm."""
        return tuple(self._range(column) for column in range(len(self.poses.home)))

    def _range(self, column: int) -> tuple[float, float]:
        name = self.poses.linkage.input_names[column]
        if name in self._over:
            low, high = (self.inside(column, end) for end in self._over[name])
            return low, high
        home = float(self.poses.home[column])
        below, above = self.poses.range_of(self.designed, column)
        if self.poses.turning[column] and below is None and above is None:
            return 0.0, 2 * math.pi
        far = self.poses.reach(self.designed, column)
        low = home - far if below is None else below
        high = home + far if above is None else above
        inset = INSIDE * (high - low)
        return low if below is None else low + inset, high if above is None else high - inset

    @functools.cached_property
    def _grids(self) -> tuple[np.ndarray, np.ndarray]:
        """Inputs by which a design is searched, and by which it is judged."""
        count = len(self.ranges)
        along = ALONG_EACH.get(count, 3)
        if count == 1:
            along = ALONG_ONE_FOLLOWED if self.poses.iterated else ALONG_ONE
        finer = FINER_EACH if count > 1 or self.poses.iterated else FINER_ONE
        coarse, fine = self._grid(along), self._grid(finer * (along - 1) + 1)
        if count == 1 or self._over:
            return coarse, fine
        # Only cells of the grid all of whose corners are poses, and not just so: what is judged
        # lies between them.
        margin = self.poses.solve(self.designed, coarse).margin.reshape((along,) * count)
        good = margin > INSIDE * np.max(margin)
        cells = np.ones((along - 1,) * count, bool)
        used = np.zeros_like(good)
        corners = list(itertools.product((0, 1), repeat=count))
        at = [tuple(slice(side, side + along - 1) for side in corner) for corner in corners]
        for part in at:
            cells &= good[part]
        if not np.any(cells):
            return self.poses.home[None], self.poses.home[None]
        for part in at:
            used[part] |= cells
        numbers = np.indices((finer * (along - 1) + 1,) * count).reshape(count, -1)
        within = cells[tuple(np.minimum(numbers // finer, along - 2))]
        return coarse[used.ravel()], fine[within]

    def _grid(self, along: int) -> Float[np.ndarray, "cases inputs"]:
        axes = [np.linspace(low, high, along) for low, high in self.ranges]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))

    # -- what follows from its distances --------------------------------------------------------

    def evaluate(
        self, values: Float[Array, " parameters"], of: tuple[str, ...]
    ) -> dict[str, Float[Array, "..."]]:
        """See `ParametricDesign`.

        Where a group cannot be assembled its transmission angle goes on below 0 as its margin does,
        a radian for a greatest distance.
        """
        distances = jnp.asarray(self.designed, values.dtype).at[self._free].set(values)
        found: dict[str, Array] = {}
        if "triangles" in of:
            found["triangles"] = self.dimensions.slack(distances)
        if "size" in of:
            found["size"] = distances
        if not {*of} - {*found}:
            return found
        linkage = self.dimensions.linkage(self.poses.linkage, distances)
        with jax.ensure_compile_time_eval():  # the first time they are computed, not traced
            cases = jnp.asarray(self.cases, values.dtype)
        poses, angles = solve_poses_and_angles(linkage, cases)
        found["margin"] = poses.margin
        for group in make_plan(linkage.structure).groups:
            if group.pin is not None:
                margins = jnp.stack(poses.value.margins[group.index])
                reach = jnp.min(margins, axis=0) / self._greatest
                pin = f"mu.{group.pin}"
                own = jnp.rad2deg(jnp.where(reach >= 0, angles[group.pin], reach))
                found[pin] = jnp.minimum(found.get(pin, own), own)
        if self.poses.pins:
            columns = [found[f"mu.{pin}"] for pin in self.poses.pins]
            found["min_transmission"] = jnp.stack(columns, axis=1)
        return {name: found[name] for name in of}

    def judge(self, values: Values) -> dict[str, float]:
        """See `ParametricDesign`: on a finer grid, by the poses themselves.

        Where there is no pose nothing is transmitted: the angle is 0.
        """
        distances = self._possible(values)
        ok, margin, angles = self._judged_poses(distances)
        least = np.degrees(np.where(ok[:, None], angles, 0.0)).min(axis=0).tolist()
        found = {f"mu.{pin}": angle for pin, angle in zip(self.poses.pins, least, strict=True)}
        found |= {"min_transmission": min(least)} if least else {}
        found |= {"margin": float(margin.min()), "size": float(distances.max())}
        if self._triangles:
            found["triangles"] = min(
                _sine_squared(*distances[[*triangle]].tolist()) for triangle in self._triangles
            )
        return found

    def files(self, values: Values) -> Sequence[SpecFile]:
        """See `ParametricDesign`: the linkage file.

        It is sketched in the pose of the inputs among ``values``, if there are any and they give
        one; otherwise in that of its own file, or in another one of its range.
        """
        distances = self._possible(values)
        linkage = self.dimensions.linkage(self.poses.linkage, jnp.asarray(distances))
        names = self.poses.linkage.input_names
        here = [values.get(name, math.nan) for name in names]
        tried = [] if np.isnan(here).any() else [[self.inside(*pair) for pair in enumerate(here)]]
        nearest = np.argsort(np.abs(self.cases - self.poses.home).sum(axis=1), kind="stable")
        inputs = np.vstack([*tried, self.poses.home, self.cases[nearest]])
        poses = self.poses.solve(distances, inputs)
        fault = poses.message()
        for row in np.flatnonzero(poses.ok)[:3]:
            text = spec_text(linkage, self.dimensions, inputs[row])
            try:
                parse_linkage(tomllib.loads(text), self.title)
            except UserError as error:  # such as a pose in which an assembly is not decided
                fault = str(error)
                continue
            poses_named = [*["as it stands"] * len(tried), "in its first pose"]
            pose = poses_named[row] if row < len(poses_named) else "in another pose"
            title = f"the linkage {pose}, for designopt solve, explore, optimise and export"
            return [SpecFile("linkage.toml", title, text)]
        raise UserError(f"'{self.title}' as it stands cannot be sketched in a file: {fault}")

    @functools.cached_property
    def _triangles(self) -> list[tuple[int, int, int]]:
        return [triangle for frame in self.dimensions.frames for triangle in frame.triangles()]

    def _possible(self, values: Values) -> Float[np.ndarray, " distances"]:
        distances = self.distances(values)
        broken = self.dimensions.broken(distances.tolist())
        if broken:
            raise UserError(broken)
        return distances

    def _judged_poses(self, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        poses = self.poses.solve(distances, self._grids[1])
        return poses.ok, poses.margin, poses.angles

    # -- in words -------------------------------------------------------------------------------

    def _where(self, index: tuple[int, ...]) -> str:
        inputs = enumerate(self.cases[index[0]].tolist())
        names = self.poses.linkage.input_names
        told = [f"{names[column]} {self.shown_text(column, value)}" for column, value in inputs]
        return f"at {' and '.join(told)}"

    def _where_pin(self, index: tuple[int, ...]) -> str:
        return f"of {self.poses.pins[index[1]]} {self._where(index)}"

    def _where_triangle(self, index: tuple[int, ...]) -> str:
        return f"of {self.dimensions.distances[self._triangles[index[0]][0]].body}"

    def _where_distance(self, index: tuple[int, ...]) -> str:
        return f"of {self.dimensions.distances[index[0]].label}"


def _sine_squared(base: float, first: float, second: float) -> float:
    """Of the angle between two sides of a triangle, by Heron's formula for its area."""
    half = (base + first + second) / 2
    area = half * (half - base) * (half - first) * (half - second)
    return 4 * area / (base * first) ** 2
