"""What a scene did not need: operation counts of two compiled programs side by side."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import jax

# An instruction in XLA's text form: "%name = f64[6]{0} multiply(…".
_INSTRUCTION = re.compile(r"^\s*(?:ROOT )?%?[\w.-]+ = .*?[\]})] ([\w-]+)\(")
# These name, move or group data; what they group is counted where it stands.
_BOOKKEEPING = frozenset(
    [
        "bitcast",
        "broadcast",
        "call",
        "constant",
        "copy",
        "fusion",
        "get-tuple-element",
        "parameter",
        "tuple",
    ]
)


def count_operations(function: Callable[..., Any], *args: Any) -> int:
    """Operations in ``function`` compiled for arguments like ``args``, on the present device.

    An operation is an instruction of the optimised program that computes something, whatever
    the size of its arrays; the body of a loop counts once, however often it runs.

    Example:
        >>> import jax.numpy as jnp
        >>> x = jnp.ones(8)
        >>> count_operations(lambda x: jnp.sin(x) + x, x) < count_operations(
        ...     lambda x: x @ jnp.outer(jnp.sin(x), x), x
        ... )
        True
    """
    text = jax.jit(function).lower(*args).compile().as_text() or ""
    found = (_INSTRUCTION.match(line) for line in text.splitlines())
    return sum(match is not None and match[1] not in _BOOKKEEPING for match in found)
