"""A function with its slopes, compiled once for all programs that call it.

A search traces a design in several programs: where it stands, its steps, its steps towards what is
required, what holds the optimum. Views and clearances of a finger take JAX half a minute to trace
and to compile, once with their slopes; so that happens once, and those programs call the result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.batching import side_by_side
from designopt.programs import known_options

Arrays = dict[str, Float[Array, "..."]]

Computed = dict[str, Any]
"""Arrays of NumPy by name: a compiled program is called outside of JAX."""

KEPT = 8
"""Points whose values and slopes are kept: a search asks for both of a point, one by one."""


class CompiledFunctions:
    """Several functions of one vector, each with its slopes by some of the vector's elements.

    The call can be differentiated once, forwards and backwards, and batched one after the other.
    """

    def __init__(
        self,
        functions: Sequence[Callable[[Float[Array, " numbers"]], Arrays]],
        columns: Sequence[Sequence[int]],
        size: int,
    ) -> None:
        """Trace the functions; they are compiled beside each other when they are first needed.

        Args:
            functions: each from the vector to arrays by name; no name is that of two.
            columns: the elements of the vector on which each function depends.
            size: of the vector.
        """
        point = jax.ShapeDtypeStruct((size,), jnp.float64)
        pairs = zip(functions, columns, strict=True)
        programs = [jax.jit(partial(_with_slopes, *pair)) for pair in pairs]
        self._lowered = [program.lower(point) for program in programs]
        shapes = [
            jax.tree.map(lambda one: jax.ShapeDtypeStruct(one.shape, one.dtype), one.out_info)
            for one in self._lowered
        ]
        self._shapes = tuple(_merged(parts) for parts in zip(*shapes, strict=True))
        self._programs: list[Any] = []
        self._known: dict[bytes, tuple[Computed, Computed]] = {}

    def __call__(self, numbers: Float[Array, " numbers"]) -> Arrays:
        """All arrays by name."""
        return _call(self, numbers)

    def values(self, numbers: Float[Array, " numbers"]) -> Computed:
        """All arrays, computed now."""
        return self.both(numbers)[0]

    def both(self, numbers: Float[Array, " numbers"]) -> tuple[Computed, Computed]:
        """All arrays, and their slopes by the vector, computed now."""
        point = np.asarray(numbers, float)
        key = point.tobytes()
        if key not in self._known:
            # Whatever program calls may run in a thread of XLA's, which has its own float type.
            with jax.enable_x64(True):
                if not self._programs:
                    compiling = [partial(_compile, one) for one in self._lowered]
                    self._programs = side_by_side(compiling)
                found = side_by_side([partial(_run, one, point) for one in self._programs])
            self._known[key] = (
                _merged([one for one, _ in found]),
                _merged([one for _, one in found]),
            )
            while len(self._known) > KEPT:
                del self._known[next(iter(self._known))]
        return self._known[key]


def _compile(lowered: Any) -> Any:
    return lowered.compile(compiler_options=known_options())


def _run(program: Any, point: Float[np.ndarray, " numbers"]) -> Any:
    return jax.tree.map(np.asarray, program(point))


def _merged(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {name: value for part in parts for name, value in part.items()}


def _with_slopes(
    function: Callable[[Float[Array, " numbers"]], Arrays],
    columns: Sequence[int],
    numbers: Float[Array, " numbers"],
) -> tuple[Arrays, Arrays]:
    at = np.asarray(columns)

    def of(own: Float[Array, " own"]) -> Arrays:
        return function(numbers.at[at].set(own))

    def along(step: Float[Array, " own"]) -> tuple[Arrays, Arrays]:
        return jax.jvp(of, (numbers[at],), (step,))

    values, slopes = jax.vmap(along, out_axes=(None, -1))(jnp.eye(len(at)))
    whole = {
        name: jnp.zeros((*slope.shape[:-1], len(numbers))).at[..., at].set(slope)
        for name, slope in slopes.items()
    }
    return values, whole


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _call(functions: CompiledFunctions, numbers: Float[Array, " numbers"]) -> Arrays:
    shapes = functions._shapes[0]
    return jax.pure_callback(functions.values, shapes, numbers, vmap_method="sequential")


@_call.defjvp
def _call_jvp(functions: CompiledFunctions, primals: Any, tangents: Any) -> tuple[Arrays, Arrays]:
    shapes = functions._shapes
    values, slopes = jax.pure_callback(functions.both, shapes, *primals, vmap_method="sequential")
    return values, {name: slope @ tangents[0] for name, slope in slopes.items()}
