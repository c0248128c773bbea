"""The coloured chamber: its imaging and choice, and the soft finger around it, bent and pressed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
