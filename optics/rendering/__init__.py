"""Synthetic tactile images: the section scene extruded across the pads' width, with its faults."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
