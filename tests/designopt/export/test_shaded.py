"""Pictures of parts: what they cover, and what hides what."""

from __future__ import annotations

import math

import numpy as np
import pytest

from designopt.export.parts import Hole, Part, Prism, around, circle
from designopt.export.shaded import draw_parts

WIDTH = 500


def block(low, high, color, name="block", size=10.0, holes=()):
    corners = (-size, -size, 0), (size, -size, 0), (size, size, 0), (-size, size, 0)
    return Part(name, name, name, "", "", (Prism(around(*corners), (low, high), holes),), (), color)


def share(picture, color):
    """Part of the pixels that have a colour's hue, edges apart."""
    wanted = np.array(color, float) / max(color)
    found = picture / np.maximum(picture.max(axis=2, keepdims=True), 1)
    return np.mean(np.abs(found - wanted).max(axis=2) < 0.02)


def test_a_silhouette_covers_its_projection():
    picture = draw_parts([block(0, 4, "#ff0000")], 0, 0, WIDTH)
    side = 20 / (20 * 1.06) * WIDTH
    assert np.sum(np.any(picture < 250, axis=2)) == pytest.approx(side**2, rel=0.01)
    # From 30° beside it, the side of 4 mm is seen as well.
    turned = draw_parts([block(0, 4, "#ff0000")], 30, 0, WIDTH)
    across = 20 * math.cos(math.radians(30)) + 4 * math.sin(math.radians(30))
    rows = np.sum(np.any(turned < 250, axis=(1, 2))) / np.sum(np.any(turned < 250, axis=(0, 2)))
    assert rows == pytest.approx(20 / across, rel=0.01)


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearer_part_hides_the_farther_one(order):
    far, near = block(0, 1, "#ff0000"), block(2, 3, "#0000ff", "near", size=5.0)
    front = draw_parts([far, near][::order], 0, 0, WIDTH)
    scale = 1 / 1.06**2
    assert share(front, (0, 0, 255)) == pytest.approx(scale / 4, rel=0.04)
    assert share(front, (255, 0, 0)) == pytest.approx(scale * 3 / 4, rel=0.04)
    # From behind the small one is hidden.
    assert share(draw_parts([far, near][::order], 180, 0, WIDTH), (0, 0, 255)) == 0


def test_one_sees_through_holes():
    holed = block(0, 1, "#ff0000", holes=(Hole((0.0, 0.0), 6.0),))
    behind = Part("b", "b", "b", "", "", (Prism(circle(0, 0, 7), (-3, -2)),), (), "#00ff00")
    picture = draw_parts([holed, behind], 0, 0, WIDTH)
    assert share(picture, (0, 255, 0)) == pytest.approx(36 * math.pi / 21.2**2, rel=0.04)
