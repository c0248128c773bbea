from .finger import Finger
from .finger_file import (
    bare_finger,
    format_finger,
    packaged_finger,
    parse_finger,
    read_finger,
    write_finger,
)
from .finger_parts import Body, FingerCamera, FingerMirror, FingerMotor, FingerSpring
from .link_layers import Links
from .linkage_design.forces import find_held_force, find_pinch_forces, find_stresses
from .pad_layers import PadLayers
from .pins import Pins
from .soft_finger.finger import SoftFinger

__all__ = [
    "Body",
    "Finger",
    "FingerCamera",
    "FingerMirror",
    "FingerMotor",
    "FingerSpring",
    "Links",
    "PadLayers",
    "Pins",
    "SoftFinger",
    "bare_finger",
    "find_held_force",
    "find_pinch_forces",
    "find_stresses",
    "format_finger",
    "packaged_finger",
    "parse_finger",
    "read_finger",
    "write_finger",
]
