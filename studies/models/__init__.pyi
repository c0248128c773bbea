from .finger import Body, Finger, FingerCamera, FingerMirror, Spring
from .finger_file import finger_from, finger_text, packaged_finger, read_finger, write_finger
from .pins import Pins

__all__ = [
    "Body",
    "Finger",
    "FingerCamera",
    "FingerMirror",
    "Pins",
    "Spring",
    "finger_from",
    "finger_text",
    "packaged_finger",
    "read_finger",
    "write_finger",
]
