"""The soft finger's chamber, bent and pressed, as its endoscope sees it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
