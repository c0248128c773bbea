"""Rows with named columns, against NumPy on the plain columns."""

import numpy as np
import pytest

from designopt.study.records import Records

ERRORS = np.array([3.0, -4.0, np.nan, 0.5])


@pytest.fixture
def records():
    found = Records()
    found.add(way="a", trial=[1, 2], error_mm=ERRORS[:2])
    found.add(way=["a", "longer"], trial=[3, 4], error_mm=ERRORS[2:])
    return found


@pytest.mark.parametrize(
    ("what", "wanted"),
    [
        ("count error_mm", 4),
        ("sum trial", 10),
        ("defined error_mm", 0.75),
        ("mean error_mm", -0.5 / 3),
        ("mean_abs error_mm", 2.5),
        ("rms error_mm", np.sqrt(25.25 / 3)),
        ("sd error_mm", np.std([3.0, -4.0, 0.5])),
        ("median error_mm", 0.5),
        ("min error_mm", -4.0),
        ("max_abs error_mm", 4.0),
        ("p95_abs error_mm", 3.9),
    ],
)
def test_statistics_are_of_the_finite_values(records, what, wanted):
    assert records.stat(what) == pytest.approx(wanted, rel=1e-14)


def test_sums_keep_what_their_column_is(records):
    assert isinstance(records.stat("sum trial"), int)
    assert np.isnan(records.stat("sum error_mm"))
    records |= {"empty": np.array([1, 2, None, 4], object)}
    assert np.isnan(records.stat("sum empty"))
    small = Records({"x": np.array([1e8, 1.0, -1e8], np.float32)})
    assert small.stat("sum x") == 1.0  # not of the column's own float type


def test_rows_are_chosen_grouped_and_summarised_in_their_order(records):
    assert records.where(way="a")["trial"].tolist() == [1, 2, 3]
    assert records.where(records["error_mm"] > 0, way=["a", "b"])["trial"].tolist() == [1]
    grouped = records.group("way")
    assert {key: own["trial"].tolist() for key, own in grouped.items()} == {
        "a": [1, 2, 3],
        "longer": [4],
    }
    table = records.summary("way", trials="count trial", last=lambda own: own["trial"][-1])
    assert (table["way"].tolist(), table["last"].tolist()) == (["a", "longer"], [3, 4])


def test_without_rows_there_are_empty_columns_and_no_groups():
    empty = Records()
    assert (len(empty), len(empty["x"]), empty.group("x")) == (0, 0, {})
    assert (empty.stat("count x"), empty.stat("sum x")) == (0, 0)
    assert np.isnan(empty.stat("max x"))
    assert len(empty.where(x=1)) == 0


def test_wrong_use_is_refused(records):
    with pytest.raises(ValueError, match="beside earlier"):
        records.add(way="b")
    with pytest.raises(KeyError, match="no statistic"):
        records.stat("most error_mm")
    with pytest.raises(KeyError):
        records.stat("max other")
