"""Linkages written and read again."""

from __future__ import annotations

import tomllib

import equinox as eqx
import jax
import numpy as np
import pytest

from designopt import UserError
from kinematics import format_linkage, parse_linkage, read_linkage, write_linkage
from tests.kinematics.gallery import NAMES, gallery


def assert_same(one, other):
    assert one.structure == other.structure
    assert one.assembly == other.assembly
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for first, second in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(first, second, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_gallery_is_read_back(name, tmp_path):
    linkage = gallery(name)
    write_linkage(linkage, tmp_path / "again.toml")
    assert_same(linkage, read_linkage(tmp_path / "again.toml"))


def test_other_lengths_are_written():
    linkage = gallery("four-bar")
    longer = eqx.tree_at(lambda one: one.links["coupler"].length, linkage, 121.5)
    again = parse_linkage(tomllib.loads(format_linkage(longer)), "again")
    assert float(again.links["coupler"].length) == pytest.approx(121.5, abs=1e-12)


def test_a_linkage_that_cannot_be_assembled_is_not_written(tmp_path):
    linkage = gallery("four-bar")
    short = eqx.tree_at(lambda one: one.links["coupler"].length, linkage, 1.0)
    with pytest.raises(UserError, match=r"^four-bar: it cannot be written: "):
        write_linkage(short, tmp_path / "short.toml")
    assert not (tmp_path / "short.toml").exists()
