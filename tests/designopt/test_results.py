"""Targets, metrics and tables."""

import numpy as np
import pytest

from designopt import Metric, Results, Table, Target
from tests.designopt.tables import cases


@pytest.mark.parametrize(("written", "met", "missed", "text"), cases("targets"))
def test_targets(written, met, missed, text):
    target = Target.parse(written)
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
    assert (table.columns, table.rows) == (["a", "b"], [(1, "x"), (2, None)])
    with pytest.raises(ValueError, match="shorter"):
        Table.of_columns("t", "title", {"a": [1, 2], "b": [1]})
