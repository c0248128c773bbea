"""Whole designs as pytrees, and their methods, which several studies share."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
