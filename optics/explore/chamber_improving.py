"""Wider rings: the wall that shows its narrowest ring widest, from a given one on.

What is chosen is η (that is Δl_D), θ_BC and Δl_B. The wall's points B, C and D stay inside Δl_A
either way, which is paper A's requirement for D (|Δl_D| inside Δl_A, §II.A) asked of all three: a
reading. The camera's constants are bought, not designed. The lengths stay too: every ring widens
as its region nears the pinhole, without end, until the camera's field of view cuts it off, and of
that a chamber knows nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.optimize import (
    FEASIBLE,
    EpigraphVariables,
    Evaluation,
    Iteration,
    Problem,
    make_epigraph,
)
from optics.chamber.chamber import Chamber
from optics.chamber.ratio import solve_dimension_for_ratio

UPDATES = 60


class Walls(eqx.Module):
    """What is chosen.

    Attributes:
        ratio: η, which decides Δl_D.
        offset_b: Δl_B, mm.
        wall_angle_bc: θ_BC, radians.
    """

    ratio: Float[Array, "*starts"]
    offset_b: Float[Array, "*starts"]
    wall_angle_bc: Float[Array, "*starts"]

    def turned(self, chamber: Chamber) -> Chamber:
        """The chamber with these."""
        changed = dataclasses.replace(
            chamber, offset_b=self.offset_b, wall_angle_bc=self.wall_angle_bc
        )
        offset_d = solve_dimension_for_ratio(changed, "offset_d", self.ratio).value
        return dataclasses.replace(changed, offset_d=offset_d)


def narrowest(chamber: Chamber) -> Float[Array, ""]:
    """The least of the rings' widths, mm; negative where one hides itself."""
    return jnp.min(_widths(chamber))


def _widths(chamber: Chamber) -> Float[Array, "3"]:
    # Beyond f = v the image is turned over, and as wide.
    side = jnp.sign(chamber.focal_length - chamber.image_distance)
    return side * chamber.ring_widths().value


def rings_problem(
    chamber: Chamber,
    *,
    ratios: tuple[float, float],
    angles: tuple[float, float],
    offsets: tuple[float, float],
) -> Problem:
    """The largest narrowest ring with B, C and D inside Δl_A.

    Args:
        chamber: lengths, camera and Δl_A.
        ratios: range of η.
        angles: range of θ_BC, radians.
        offsets: range of Δl_B, mm.
    """
    low, high = (
        Walls(*map(jnp.asarray, ends)) for ends in zip(ratios, offsets, angles, strict=True)
    )
    return Problem(_terms, low, high, data=(chamber,))


def _terms(walls: Walls, chamber: Chamber) -> Evaluation:
    turned = walls.turned(chamber)
    offsets = jnp.stack([turned.offset_b, turned.offset_c, turned.offset_d]) / turned.offset_a
    return Evaluation(
        least={"rings": _widths(turned)},
        inequalities={"above": 1 - offsets, "below": 1 + offsets},
    )


class Improver:
    """Widens a chamber's narrowest ring from any start, by programs compiled once."""

    def __init__(self, problem: Problem, chamber: Chamber) -> None:
        """Nothing is compiled yet.

        Args:
            problem: a `rings_problem`.
            chamber: one with an image, by which widths are judged.
        """
        scale = float(jnp.max(jnp.abs(chamber.image_heights().value))) / 3
        self._iteration = Iteration(make_epigraph(problem, scale=scale))
        self._narrowest = jax.jit(lambda walls, chamber: narrowest(walls.turned(chamber)))

    def steps(self, chamber: Chamber, ratio: float) -> Iterator[tuple[Walls, str]]:
        """Iterations from a chamber on: where each has come to, and that in one line.

        Args:
            chamber: where to begin.
            ratio: its η.
        """
        start = Walls(jnp.asarray(ratio), chamber.offset_b, chamber.wall_angle_bc)
        level = self._narrowest(start, chamber)
        first = float(level)
        solve = self._iteration.run(EpigraphVariables(start, level), (chamber,), updates=UPDATES)
        for found in solve:
            walls = found.parameters.design
            width = float(self._narrowest(walls, chamber))
            message = f"narrowest ring {width:.4g} mm, from {first:.4g} mm"
            if found.done:
                if not found.converged:
                    message += f"; not converged after {UPDATES} iterations"
                if found.violation > FEASIBLE:
                    message += "; B, C and D do not all fit inside Δl_A"
            yield walls, message
