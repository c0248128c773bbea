from .finger import Body, Finger, FingerCamera, FingerMirror, Spring
from .pins import Pins

__all__ = ["Body", "Finger", "FingerCamera", "FingerMirror", "Pins", "Spring"]
