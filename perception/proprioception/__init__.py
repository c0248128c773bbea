"""Joint angles from views: by the gap between two views, by one edge, by all corners."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
