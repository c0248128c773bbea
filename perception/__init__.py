"""OpenCV on images: views of pads found, unwarped and compared; joint angles from them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
