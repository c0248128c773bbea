"""TOML text, read back by the standard library."""

import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from designopt import format_toml

keys = st.text(min_size=1, max_size=8)
plain = st.one_of(
    st.booleans(),
    st.integers(-(2**53), 2**53),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=8),
)
values = st.one_of(plain, st.lists(plain, max_size=4))
tables = st.recursive(
    st.dictionaries(keys.filter(str.isprintable), values, max_size=3),
    lambda inner: st.dictionaries(
        keys.filter(str.isprintable),
        st.one_of(values, inner, st.lists(inner, min_size=1, max_size=3)),
        max_size=3,
    ),
    max_leaves=8,
)


@given(tables)
def test_what_is_written_is_read_back(table):
    assert tomllib.loads(format_toml(table)) == table


def test_a_file_as_a_person_would_write_it():
    text = format_toml(
        {
            "scene": {"name": "finger"},
            "pads": [{"name": "distal", "from": [27.0, -4.0]}, {"name": "tip", "from": [0.0, 1.0]}],
            "frames": {"distal": {"hinge": [23, 0]}},
        },
        "first line\nsecond line",
    )
    assert text == (
        '# first line\n# second line\n\n[scene]\nname = "finger"\n\n[[pads]]\nname = "distal"\n'
        'from = [27.0, -4.0]\n\n[[pads]]\nname = "tip"\nfrom = [0.0, 1.0]\n\n[frames.distal]\n'
        "hinge = [23, 0]\n"
    )


def test_numpys_floats_are_numbers():
    assert format_toml({"a": np.float64(1.5)}) == "a = 1.5\n"


def test_what_toml_has_no_form_for_is_refused():
    with pytest.raises(TypeError, match="no value of type NoneType"):
        format_toml({"a": None})
