"""Section optics: camera, mirrors and pads; the coloured chamber and its imaging."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
