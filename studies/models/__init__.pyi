from .finger import Body, Finger, FingerCamera, FingerMirror, FingerSpring
from .finger_file import format_finger, packaged_finger, parse_finger, read_finger, write_finger
from .pins import Pins

__all__ = [
    "Body",
    "Finger",
    "FingerCamera",
    "FingerMirror",
    "FingerSpring",
    "Pins",
    "format_finger",
    "packaged_finger",
    "parse_finger",
    "read_finger",
    "write_finger",
]
