"""What was designed, as the commands around it take it: knobs to turn, a drawing, its numbers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
