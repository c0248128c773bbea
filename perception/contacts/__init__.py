"""Contacts from pictures of a pad, touched and untouched: places, sizes, and how sure they are."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
