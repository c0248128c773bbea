"""Fingers that several tests are about."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.models import Body, Finger, FingerSpring, Pins, packaged_finger
from studies.models.body import BodySpec
from studies.models.finger_file import read_finger
from studies.models.grasp.spec import PinsSpec
from studies.models.link_layers import Links
from studies.models.linkage_kinds import KindName
from studies.models.links import LinksTable
from studies.models.mirror_design.placement import reference_layout
from studies.models.mirror_design.spec import CameraSpec

LENS = CameraSpec(fov_deg=160.0)
BARE: dict[str, Any] = {"camera": LENS, "pads": {"thickness": [], "index": []}}
"""Settings of mirrors for a finger with bare pads."""

DATA = Path(__file__).parents[1] / "data"

OLD = DATA / "old_specs"
"""Of a result that was written before fingers had files."""


def reference_pins() -> Pins:
    """Design B, which settings have by default."""
    return Pins.of(PinsSpec())


def bare_body(**body: Any) -> Body:
    """The default body with pads that meet at the end of the range."""
    return Body.of(BodySpec.model_validate({"pad_clearance": 0.0} | body))


def finger_of(pins: Pins | None = None, **body: float) -> Finger:
    """A finger with spring and links, by default design B with the body above; without motor."""
    made, links = bare_body(**body), Links.of(LinksTable())
    return Finger.of(made, pins or reference_pins(), FingerSpring(30.0, 0.3, 300.0), links=links)


def finger_of_kind(kind: KindName) -> Finger:
    """A designed finger with a linkage of a kind: the packaged one, or `coupled_finger`."""
    return {"six-bar": packaged_finger, "coupled": coupled_finger}[kind]()


def coupled_finger() -> Finger:
    """What ``designopt run finger`` designs with ``linkage.kind=coupled`` and higher axes.

    The others of its settings are in its study's README.
    """
    return read_finger(DATA / "coupled_finger.toml")


def seeing_finger(**body: float) -> Finger:
    """The same with camera and mirrors of the reference layout."""
    return reference_layout(finger_of(None, **body), LENS)
