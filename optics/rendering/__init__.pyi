from .chamber_effects import ChamberEffects
from .chamber_renderer import COLORS, ChamberImage, ChamberRenderer
from .effects import Effects
from .exposure import encode_picture
from .imprints import Imprint, list_imprints, make_height_map
from .pads import PadAppearance, make_pad_appearance
from .renderer import Renderer, TactileImage, TrueView

__all__ = [
    "COLORS",
    "ChamberEffects",
    "ChamberImage",
    "ChamberRenderer",
    "Effects",
    "Imprint",
    "PadAppearance",
    "Renderer",
    "TactileImage",
    "TrueView",
    "encode_picture",
    "list_imprints",
    "make_height_map",
    "make_pad_appearance",
]
