"""What became of a point: its metrics, or why there are none."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from designopt.study.results import Metric, Target


class Outcome(NamedTuple):
    """A finished point.

    Attributes:
        metrics: what the study found; empty if it failed.
        failure: why there are none, in one line; empty if there are.
        final: whether a failure would only come again; others are tried again by the next sweep
            into the same folder.
        seconds: run time of the point.
        device: what it ran on, in words.
    """

    metrics: tuple[Metric, ...] = ()
    failure: str = ""
    final: bool = True
    seconds: float = 0.0
    device: str = ""


def found(metrics: Sequence[Metric], seconds: float, device: str) -> Outcome:
    """The outcome of a point that has metrics, as plain numbers that every file keeps exactly.

    A published figure to compare with is of the study's own design, and is left out.
    """
    plain = tuple(
        Metric(one.name, _plain(one.value), one.unit, one.description, target=one.target)
        for one in metrics
    )
    return Outcome(plain, seconds=seconds, device=device)


def failed(reason: str, *, final: bool, seconds: float = 0.0, device: str = "") -> Outcome:
    """The outcome of a point that has none."""
    words = " ".join(reason.split()) or "no reason is given"
    return Outcome(failure=words, final=final, seconds=seconds, device=device)


def to_json(outcome: Outcome) -> dict[str, Any]:
    """An outcome as plain data for a JSON file; numbers that are not finite become words."""
    if outcome.failure:
        found_or_not: dict[str, Any] = {"failure": outcome.failure, "final": outcome.final}
    else:
        found_or_not = {"metrics": [_metric(metric) for metric in outcome.metrics]}
    return found_or_not | {"seconds": outcome.seconds, "device": outcome.device}


def from_json(tables: Mapping[str, Any]) -> Outcome:
    """The outcome that `to_json` made these of.

    Raises:
        KeyError, TypeError, ValueError: they are none.
    """
    return Outcome(
        metrics=tuple(_metric_of(one) for one in tables.get("metrics", ())),
        failure=tables.get("failure", ""),
        final=tables.get("final", True),
        seconds=tables["seconds"],
        device=tables["device"],
    )


def _metric_of(one: Mapping[str, Any]) -> Metric:
    value = one["value"] if isinstance(one["value"], int | float) else float(one["value"])
    target = None if one["target"] is None else Target(*one["target"])
    return Metric(one["name"], value, one["unit"], one["description"], target=target)


def _metric(metric: Metric) -> dict[str, Any]:
    target = metric.target
    return {
        "name": metric.name,
        "value": metric.value if math.isfinite(metric.value) else str(metric.value),
        "unit": metric.unit,
        "description": metric.description,
        "target": None if target is None else [target.relation, target.value, target.tolerance],
    }


def _plain(value: Any) -> float:
    return int(value) if isinstance(value, numbers.Integral) else float(value)
