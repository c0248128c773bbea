"""Fingers that several tests are about."""

from __future__ import annotations

from pathlib import Path

from studies.models import Body, Finger, FingerSpring, Pins
from studies.models.body import BodySpec
from studies.models.grasp.spec import PinsSpec
from studies.models.link_layers import Links
from studies.models.links import LinksTable
from studies.models.mirror_design.placement import reference_layout
from studies.models.mirror_design.spec import MirrorSpec

LENS = MirrorSpec().camera
OLD = Path(__file__).parents[1] / "data" / "old_specs"
"""Of a result that was written before fingers had files."""


def reference_pins() -> Pins:
    """Design B, which settings have by default."""
    return Pins.of(PinsSpec())


def finger_of(pins: Pins | None = None, **body: float) -> Finger:
    """A finger with spring and links, by default design B with its default body; without motor."""
    made, links = Body.of(BodySpec(**body)), Links.of(LinksTable())
    return Finger.of(made, pins or reference_pins(), FingerSpring(30.0, 0.3, 300.0), links=links)


def seeing_finger(**body: float) -> Finger:
    """The same with camera and mirrors of the reference layout."""
    return reference_layout(finger_of(None, **body), LENS)
