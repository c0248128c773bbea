"""How the spread of dimensions spreads an output, to first order, by derivatives."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float, safe_sqrt
from kinematics.model.linkage import Linkage
from kinematics.solve.solver import Solver, each_pose
from kinematics.solve.statics import Output


class Spread(eqx.Module):
    """Spread of an output.

    Attributes:
        value: the output as designed.
        deviation: its standard deviation.
        variances: what each dimension adds to its variance, in the shape of the linkage.
    """

    value: Float[Array, "*batch"]
    deviation: Float[Array, "*batch"]
    variances: Linkage


def make_zero_deviations(linkage: Linkage) -> Linkage:
    """A linkage of zeros, to be filled with the standard deviations of dimensions.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> float(make_zero_deviations(linkage).links["crank"].length)
        0.0
    """
    return jax.tree.map(jnp.zeros_like, linkage)


def propagate_deviations(
    linkage: Linkage,
    inputs: Float[Array, "*batch inputs"],
    output: Output,
    deviations: Linkage,
) -> Spread:
    """Standard deviation of an output when dimensions deviate independently.

    σ² = Σ (∂output/∂dimension · σ_dimension)² (first-order propagation of uncertainty, JCGM
    100:2008, 5.1.2), in the linkage's own assembly.

    Args:
        linkage: the design.
        inputs: values of the inputs, rad or mm; exact.
        output: from one pose to a number, such as ``lambda pose: pose.joints["B"].x``.
        deviations: standard deviation of every dimension, mm or rad, in the shape of the linkage
            (`make_zero_deviations`, then `equinox.tree_at`).

    Returns:
        The spread at each pose. Without meaning where `solve_poses` is not ok.

    Example:
        >>> from importlib.resources import files
        >>> import equinox as eqx
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> crank = lambda linkage: linkage.links["crank"].length
        >>> deviations = eqx.tree_at(crank, make_zero_deviations(linkage), jnp.array(0.1))
        >>> spread = jax.jit(propagate_deviations, static_argnums=2)(
        ...     linkage, jnp.array([0.7]), lambda pose: pose.angle("rocker"), deviations
        ... )
        >>> round(float(spread.deviation), 5)  # rad, for a crank known to 0.1 mm
        0.00195
    """
    inputs = as_float(inputs)

    def one(values: Float[Array, " inputs"]) -> Spread:
        def value(design: Linkage) -> Float[Array, ""]:
            solver = Solver.of(design, inputs.dtype)
            drive = solver.drive(values)
            return output(solver.pose(solver.state_near(drive, solver.followed(drive))))

        nominal, slopes = jax.value_and_grad(value)(linkage)
        variances = jax.tree.map(lambda slope, sigma: (slope * sigma) ** 2, slopes, deviations)
        total = jnp.zeros_like(nominal)
        for part in jax.tree.leaves(variances):
            total = total + jnp.sum(part)
        return Spread(nominal, safe_sqrt(total), variances)

    return each_pose(one, inputs)
