"""Calibrating a camera: its lens, pupil and principal point, from pictures of a plane board."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
