"""Contacts of several views against weighted means."""

from __future__ import annotations

import numpy as np
import pytest

from perception.contacts import Contact, fuse_contacts


def contact(measured, variances, *, pad="tip", path="direct", strength=50.0):
    center, diameter = np.array(measured[:2], float), float(measured[2])
    return Contact(pad, (path,), center, diameter, np.diag(variances), 0.5, strength)


def test_views_that_agree_give_the_weighted_mean():
    one = contact([8.0, 1.0, 4.0], [0.01, 0.04, 0.02])
    other = contact([8.1, 0.9, 4.1], [0.04, 0.01, 0.02], path="mirror", strength=30.0)
    [fused] = fuse_contacts([[one], [other]])
    assert fused.measured == pytest.approx([8.02, 0.92, 4.05])
    assert np.diag(fused.covariance) == pytest.approx([0.008, 0.008, 0.01])
    assert fused.paths == ("direct", "mirror")
    assert fused.strength == pytest.approx(np.hypot(50, 30))


def test_correlations_count():
    rng = np.random.default_rng(0)
    first, second = (a @ a.T / 100 + 0.01 * np.eye(3) for a in rng.standard_normal((2, 3, 3)))
    own = Contact("tip", ("a",), np.array([8.0, 1.0]), 4.0, first, 0.5, 50.0)
    other = Contact("tip", ("b",), np.array([8.05, 1.0]), 4.0, second, 0.5, 40.0)
    [fused] = fuse_contacts([[own], [other]])
    # Kalman's form of the same.
    gain = first @ np.linalg.inv(first + second)
    assert fused.measured == pytest.approx(own.measured + gain @ (other.measured - own.measured))
    assert fused.covariance == pytest.approx((np.eye(3) - gain) @ first)


@pytest.mark.parametrize("off", [0.5, 1.0, 1.9])
def test_views_that_disagree_make_a_contact_less_sure_than_either(off):
    variances = np.full(3, 0.01)
    one = contact([8.0, 1.0, 4.0], variances)
    other = contact([8.0 + off, 1.0, 4.0], variances, path="mirror")
    [fused] = fuse_contacts([[one], [other]])
    assert fused.center[0] == pytest.approx(8 + off / 2)
    # Two deviations of 0.1 mm from each other by off: chi² is off² / 0.02, of three degrees.
    growth = max(1.0, off**2 / 0.02 / 3)
    assert np.diag(fused.covariance) == pytest.approx(variances / 2 * growth)
    assert fused.deviations[0] > 0.1


def test_what_one_view_has_stays_and_pads_are_apart():
    views = [
        [contact([8.0, 1.0, 4.0], [0.01] * 3), contact([15.0, 1.0, 3.0], [0.01] * 3, strength=9.0)],
        [contact([8.0, 1.0, 4.0], [0.01] * 3, path="mirror")],
        [contact([15.0, 1.0, 3.0], [0.01] * 3, pad="root", strength=70.0)],
    ]
    fused = fuse_contacts(views)
    assert [(one.pad, one.paths) for one in fused] == [
        ("tip", ("direct", "mirror")),
        ("root", ("direct",)),
        ("tip", ("direct",)),
    ]
    assert fused[2].measured == pytest.approx([15.0, 1.0, 3.0])


def test_contacts_of_one_view_are_never_one():
    near = [contact([8.0, 1.0, 4.0], [0.04] * 3), contact([9.0, 1.0, 4.0], [0.04] * 3)]
    assert len(fuse_contacts([near])) == 2
    assert fuse_contacts([]) == []
    assert fuse_contacts([[], []]) == []
