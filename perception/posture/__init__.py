"""Posture of a soft finger from the boundaries of its chamber's coloured regions, by a network."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
