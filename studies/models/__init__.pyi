from .finger import Body, Finger, FingerCamera, FingerMirror, FingerSpring
from .finger_file import format_finger, packaged_finger, parse_finger, read_finger, write_finger
from .pad_layers import PadLayers
from .pins import Pins
from .soft_finger.finger import SoftFinger

__all__ = [
    "Body",
    "Finger",
    "FingerCamera",
    "FingerMirror",
    "FingerSpring",
    "PadLayers",
    "Pins",
    "SoftFinger",
    "format_finger",
    "packaged_finger",
    "parse_finger",
    "read_finger",
    "write_finger",
]
