"""Paper B's finger from its requirements: linkage, mirrors, grasp.

The study loads when it is asked for: reading a design's file, of any kind, loads this package.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"spec": ["STUDY"]})
