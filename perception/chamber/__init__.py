"""Views into a soft finger's chamber: regions, points, bending direction, touched profiles."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
