"""A design small enough to compute by hand: a box, its area, its outline and what fits into it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.spec import SpecFile
from designopt.optimize import Measure, MeasureBound, Parameter, ParametricDesign, Values

DEGREES = (0.0, 45.0, 90.0)
"""In which a width is evaluated; it is judged in every degree."""


class Box(ParametricDesign):
    """Width w and height h. Its extent in a direction θ, w cos θ + h sin θ, is evaluated in three
    directions only."""

    title = "box"
    parameters = (
        Parameter("width", 8.0, 1.0, 20.0, label="width of the box"),
        Parameter("sides.left", 1.0, 1.0, 20.0),
        Parameter("depth", 3.0, 1.0, 5.0, limits=(0.0, math.inf)),
    )
    measures = (
        Measure("area", "mm²", "the area", scale=10.0, limits=(0.0, 400.0)),
        Measure("outline", "mm", "the outline", worst="greatest", scale=10.0),
        Measure("extent", "mm", "the extent", scale=5.0, where=lambda i: f"at {DEGREES[i[0]]:g}°"),
        Measure("reach", "mm", "the reach", worst="greatest", scale=5.0),
    )
    requirements = (MeasureBound("outline", "<=", 20.0),)
    free = ("width", "sides.left")

    def evaluate(
        self, values: Float[Array, " parameters"], of: tuple[str, ...]
    ) -> dict[str, Float[Array, "..."]]:
        return self._measured(values, np.deg2rad(np.array(DEGREES)), of)

    def judge(self, values: Values) -> dict[str, float]:
        if values["width"] * values["sides.left"] > 300.0:
            raise UserError("box: such a box is no box")
        fine = np.deg2rad(np.linspace(0.0, 90.0, 91))
        found = self._measured(self.vector(values), fine, tuple(m.name for m in self.measures))
        return {
            m.name: float((np.min if m.worst == "least" else np.max)(np.asarray(found[m.name])))
            for m in self.measures
        }

    def _measured(
        self, values: Array, directions: np.ndarray, of: tuple[str, ...]
    ) -> dict[str, Float[Array, "..."]]:
        w, h = values[0], values[1]
        along = w * jnp.cos(directions) + h * jnp.sin(directions)
        found = {"area": w * h, "outline": 2 * (w + h), "extent": along, "reach": along}
        return {name: found[name] for name in of}

    def files(self, values: Values) -> Sequence[SpecFile]:
        text = "".join(f'"{name}" = {value!r}\n' for name, value in values.items())
        return [SpecFile("box.toml", "the box", text)]
