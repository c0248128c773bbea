"""The ground floor: result types, safe numerics, measurement, study runner, report, command line.

The public names are listed in ``__init__.pyi`` and load on first use, so that
``import designopt`` stays light enough for the command line.
"""

from importlib.metadata import version

import lazy_loader

__version__ = version("designopt")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
