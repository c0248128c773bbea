"""Targets, metrics and tables."""

import numpy as np
import pytest

from designopt import Metric, Results, Table, Target


@pytest.mark.parametrize(
    ("target", "met", "missed", "text"),
    [
        (Target("=", 18), 18, 17, "18"),
        (Target("=", 8.616, 0.005), 8.62, 8.63, "8.616 ± 0.005"),
        (Target("<=", 1e-6), 1e-6, 2e-6, "≤ 1e-06"),
        (Target(">=", 40), 40.0, 39.9, "≥ 40"),
    ],
)
def test_targets(target, met, missed, text):
    assert target.met_by(met)
    assert not target.met_by(missed)
    assert str(target) == text


@pytest.mark.parametrize("relation", ["=", "<=", ">="])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_meets_no_target(relation, value):
    assert not Target(relation, 0.0).met_by(value)


def test_unmet_metrics_are_listed():
    free = Metric("a", 1.0, "", "no target")
    met = Metric("b", 1.0, "", "met", target=Target("=", 1))
    missed = Metric("c", 1.0, "", "missed", target=Target(">=", 2))
    assert (free.met, met.met, missed.met) == (None, True, False)
    assert Results([], [free, met, missed]).unmet == [missed]


def test_table_from_columns():
    table = Table.of_columns("t", "title", {"a": [1, 2], "b": ["x", None]})
    assert table.columns == ["a", "b"]
    assert table.rows == [(1, "x"), (2, None)]
    with pytest.raises(ValueError, match="shorter"):
        Table.of_columns("t", "title", {"a": [1, 2], "b": [1]})
