"""The one shape of every answer: a value, its margin, its residual and a result code."""

from __future__ import annotations

from collections import Counter
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

Value = TypeVar("Value")


class Solution(eqx.Module, Generic[Value]):
    """The answer of a solve, batched or not. Failure is data: nothing raises, nothing is NaN.

    Attributes:
        value: the answer; where ``ok`` is false it is finite but means nothing.
        margin: signed distance to the edge of feasibility, positive inside; unit and meaning are
            the solver's and stand in its docstring.
        residual: what is left of the equation that was solved, scaled to order one.
        result: member of an ``eqx.Enumeration`` that has ``successful``; the members are the
            messages a person reads.
    """

    value: Value
    margin: Float[Array, "*batch"]
    residual: Float[Array, "*batch"]
    result: Any  # at run time a member is no instance of its enumeration's base

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """Which elements succeeded."""
        # An item does not expose its enumeration publicly, and items of two cannot be compared.
        return self.result == self.result._enumeration.successful

    def messages(self) -> list[str]:
        """The message of each element, in row-major order; empty where it succeeded.

        Not for use under ``jax.jit``: a message is for people.
        """
        texts, which, _ = self._texts()
        return [texts[number] for number in which.tolist()]

    def failures(self) -> Counter[str]:
        """How many elements failed, by their messages; not for use under ``jax.jit`` either."""
        texts, _, counts = self._texts()
        return Counter({text: n for text, n in zip(texts, counts.tolist(), strict=True) if text})

    def _texts(self) -> tuple[list[str], np.ndarray, np.ndarray]:
        """The different messages, which of them each element has, and how many have each."""
        enumeration = self.result._enumeration
        # In NumPy, as each operation of JAX outside of a program takes as long as all of this.
        shape = self.margin.shape
        flat = jax.tree.map(lambda code: np.broadcast_to(code, shape).reshape(-1), self.result)
        codes = np.asarray(jax.tree.leaves(flat)[0])
        _, first, which, counts = np.unique(
            codes, return_index=True, return_inverse=True, return_counts=True
        )
        # Of a number that is no array, an item has no message.
        texts = [enumeration[jax.tree.map(lambda code, i=i: code[i, ...], flat)] for i in first]
        return texts, which, counts


def combine_checks(
    successful: Any, *checks: tuple[Float[Array, ""], Any]
) -> tuple[Float[Array, ""], Any]:
    """The least of several margins, and the code of the first that is not positive.

    Args:
        successful: the code where all are positive.
        checks: margins in one unit, each with its code, a member of the same enumeration.

    Example:
        >>> class Result(eqx.Enumeration):
        ...     successful = ""
        ...     short = "The link is too short."
        >>> margin, code = combine_checks(Result.successful, (jnp.array(-0.1), Result.short))
        >>> round(float(margin), 3), Result[code]
        (-0.1, 'The link is too short.')
    """
    enumeration = successful._enumeration
    result = successful
    for margin, code in reversed(checks):
        result = enumeration.where(margin > 0, result, code)
    return jnp.min(jnp.stack([margin for margin, _ in checks])), result
