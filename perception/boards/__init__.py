"""Printed boards for calibrating a camera: described, drawn, and found in its pictures."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
