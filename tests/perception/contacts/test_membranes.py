"""Bulges against Hertz's closed form and quadrature; light of lamps against sums over a line."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate

from perception.contacts.lamps import Lamp, Pieces
from perception.contacts.membranes import STEP, heights, look_up, tables


def test_a_sphere_lifts_as_hertz_has_it():
    s = np.array([0.0, 0.3, 0.9999, 1.0001, 1.5, 3.0])
    outside = np.maximum(s, 1)
    # K. Johnson, Contact Mechanics (1985), (3.42a), over the depth.
    flank = (2 - outside**2) * np.arcsin(1 / outside) + np.sqrt(outside**2 - 1)
    wanted = np.where(s < 1, 1 - s**2 / 2, flank / np.pi)
    assert heights(s, 0.0) == pytest.approx(wanted, abs=1e-5)


@pytest.mark.parametrize("beta", [0.3, 0.7, 0.9])
def test_a_pin_lifts_as_sneddons_integral_has_it(beta):
    def sunk(t):
        if t <= beta:
            return 0.0
        return t * np.sqrt(t**2 - beta**2) - t * beta * np.arccos(beta / t)

    for s in (1.01, 1.4, 2.5):
        whole, _ = scipy.integrate.quad(
            lambda t, s=s: (1 - sunk(t) / sunk(1.0)) / np.sqrt(s**2 - t**2), 0, 1, limit=200
        )
        assert heights(np.array([s]), beta)[0] == pytest.approx(2 / np.pi * whole, abs=2e-4)
    on = heights(np.array([0.0, beta, 1.0]), beta)
    assert on[:2] == pytest.approx([1, 1])
    # It is steepest where the membrane leaves it.
    s = np.arange(0.0, 3.0, 0.002)
    assert s[np.argmin(np.gradient(heights(s, beta)))] == pytest.approx(1.0, abs=0.01)


def test_tables_have_heights_and_their_slopes():
    height, slope = tables(0.1)
    s = np.arange(10, 150) * STEP
    assert look_up(height, s[None], np.zeros((1, 1)))[0] == pytest.approx(heights(s, 0.0), abs=0.01)
    rise = np.gradient(look_up(height, s[None], np.full((1, 1), 0.5))[0], STEP)
    found = look_up(slope, s[None], np.full((1, 1), 0.5))[0]
    assert found[2:-2] == pytest.approx(rise[2:-2], abs=0.06)


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.3, 0.2), (-0.2, 0.4)])
@pytest.mark.parametrize("height", [0.0, 0.6])
def test_a_line_lamp_lights_as_a_sum_over_its_pieces(lean, height):
    lamp, places = Lamp((0.0, 15.0), (24.0, 15.0), 1.0, 2.5), np.array([[10.0, 1.0]])
    along, across = places.T
    upright = np.sqrt(1 - lean[0] ** 2 - lean[1] ** 2)
    given = (np.full((1, 1), one) for one in (*lean, upright, height))
    pieces = Pieces.of(lamp, places[0], along, across)
    [[found]] = pieces.light(*given)

    def light(normal, z):
        total = 0.0
        for x in (np.arange(400) + 0.5) / 400 * 24:
            for h in 1.0 + (np.arange(30) + 0.5) / 30 * 1.5:
                way = np.array([x - 10.0, 14.0, h - z])
                total += way[1] * max(way @ normal, 0) / (way @ way) ** 2 * (h > z)
        return total

    wanted = light(np.array([*lean, upright]), height) / light(np.array([0, 0, 1.0]), 0.0)
    assert found == pytest.approx(wanted, rel=0.08)
