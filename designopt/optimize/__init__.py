"""Design problems and their solvers: constraints, max–min, many starts, one kind of answer."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
