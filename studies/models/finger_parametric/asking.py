"""What is measured of a finger, and what is required of it, under the names of its requirements."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.optimize.parametric import Measure, MeasureBound
from studies.models.checks import Check
from studies.models.finger import Finger

Arrays = dict[str, Float[Array, "..."]]
Where = Callable[[tuple[int, ...]], str]


@dataclass(frozen=True)
class Asked:
    """A measure of a finger, and the limit that it must keep.

    Attributes:
        measure: what is measured.
        limit: the least or greatest value that is required; ``None``: none is.
        label: of the requirement, as its study's report names it.
    """

    measure: Measure
    limit: float | None
    label: str

    @property
    def bound(self) -> MeasureBound | None:
        """The requirement; ``None`` where there is no limit."""
        if self.limit is None:
            return None
        relation = ">=" if self.measure.worst == "least" else "<="
        return MeasureBound(self.measure.name, relation, self.limit, self.label)


@runtime_checkable
class Aspect(Protocol):
    """Linkage or optics of a finger."""

    asked: list[Asked]
    """All measures of it."""

    concerned: tuple[str, ...]
    """What the names of the parameters begin with on which it depends."""

    gaps: dict[str, float]
    """Names of its clearances, and what parts take of each, mm."""

    def evaluate(self, finger: Finger, of: frozenset[str]) -> Arrays:
        """Measures of a finger, differentiable: at least those that are asked for."""
        ...

    def judge(self, finger: Finger) -> Mapping[str, float]:
        """Every measure of a finger, computed apart from `evaluate`."""
        ...


def measure_name(label: str, known: Mapping[str, str]) -> str:
    """A requirement's name as one word.

    Args:
        label: the requirement, for people.
        known: names of those that have a shorter one.

    Example:
        >>> measure_name("pin G' inside the tip", {})
        "pin_G'_inside_the_tip"
    """
    return known.get(label) or re.sub(r"\s+", "_", label)


def asking(
    label: str,
    limit: float | None,
    unit: str = "mm",
    worst: Literal["least", "greatest"] = "least",
    *,
    scale: float,
    known: Mapping[str, str],
    where: Where = lambda index: "",
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> Asked:
    """A measure by the label of its requirement; arguments as the attributes of both."""
    name = measure_name(label, known)
    return Asked(Measure(name, unit, label, worst, scale, limits, where), limit, label)


def joined(arrays: Iterable[Float[Array, "..."]]) -> Float[Array, " values"]:
    """All elements of arrays in one."""
    return jnp.concatenate([jnp.ravel(one) for one in arrays])


def achieved(checks: Iterable[Check], known: Mapping[str, str]) -> dict[str, float]:
    """What requirements come to, by the names of their measures."""
    return {measure_name(check.name, known): check.achieved for check in checks}
