"""MJCF's elements and numbers. Lengths are mm here and m in the file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from matplotlib.colors import to_rgb

from kinematics.model.assembled import zeroed

MM = 1e-3
"""In m; also N mm in N m."""

DIGITS = 12
"""Of every number."""


def add(parent: Element, tag: str, **attributes: str | float) -> Element:
    """A new element in another one."""
    texts = {
        key: value if isinstance(value, str) else numbers(value)
        for key, value in attributes.items()
    }
    return SubElement(parent, tag, texts)


def numbers(*values: float) -> str:
    """Numbers as an attribute."""
    return " ".join(f"{float(value) + 0.0:.{DIGITS}g}" for value in values)  # no −0


def place(point: Sequence[float] | np.ndarray) -> str:
    """A point of the plane, mm, as one of space."""
    x, y = (zeroed(float(value)) for value in point)
    return numbers(x * MM, y * MM, 0)


def color(name: Any) -> str:
    """One of Matplotlib's colours."""
    return " ".join(f"{part:.3f}" for part in (*to_rgb(name), 1.0))
