from .chroma import has_fine_colors
from .contact import Contact, fuse_contacts
from .finding import find_contacts
from .lamps import Lamp

__all__ = [
    "Contact",
    "Lamp",
    "find_contacts",
    "fuse_contacts",
    "has_fine_colors",
]
