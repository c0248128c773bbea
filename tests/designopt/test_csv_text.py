"""Cells of CSV: what a spreadsheet would run is text, and numbers keep every digit."""

import csv
import io

import numpy as np
import pytest

from designopt.io.csv_text import csv_text, numbers_text


@pytest.mark.parametrize(
    "cell", ["=1+1", "+cmd", "-a", "@SUM(A1)", "\tx", "\rx", "-", "=", "-1-1", "+inf", "-nan"]
)
def test_what_a_spreadsheet_would_run_is_text(cell):
    # Python 3.13 puts a carriage return between quotes, those before do not.
    assert csv_text([[cell]]).replace('"', "") == f"'{cell}\n"


@pytest.mark.parametrize("cell", ["a=b", "-1.5", "+2e-3", "'=1", "η", -1.5, -3, True])
def test_what_is_a_number_or_a_plain_text_stays(cell):
    assert csv_text([[cell]]) == f"{cell}\n"


def test_a_table_with_names_that_are_formulas():
    text = csv_text([["=A1", "x,y", "z"], ["@b", -1.5, ""], [None, '"q"\n', -0.0]])
    assert text == '\'=A1,"x,y",z\n\'@b,-1.5,\n,"""q""\n",-0.0\n'


def test_numbers_are_read_back_to_the_last_digit():
    rng = np.random.default_rng(0)
    wide = rng.standard_normal(999) * 10.0 ** rng.uniform(-300, 300, 999)
    wide[::7] = np.nan
    special = np.resize([0.0, -0.0, 1e22, 5e-324, 1.7976931348623157e308, 0.1, 123456789.0], 999)
    whole = np.arange(999) - 500
    text = numbers_text([wide, special, whole])
    rows = list(csv.reader(io.StringIO(text)))
    for column, cells in zip((wide, special, whole), zip(*rows, strict=True), strict=True):
        read = np.array([float(cell or "nan") for cell in cells])
        np.testing.assert_array_equal(read, column)
        np.testing.assert_array_equal(np.signbit(read), np.signbit(column))
    assert all(cell.lstrip("-").isdigit() for _, _, cell in rows)


def test_no_rows_are_no_text():
    assert numbers_text([np.zeros(0), np.zeros(0, int)]) == ""
