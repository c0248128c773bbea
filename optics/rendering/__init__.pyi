from .chamber_effects import ChamberEffects
from .chamber_renderer import COLOURS, ChamberImage, ChamberRenderer
from .effects import Effects
from .imprints import Imprint, height_map, imprint_names
from .pads import PadLook, look_of_pad
from .renderer import Renderer, TactileImage, TrueView

__all__ = [
    "COLOURS",
    "ChamberEffects",
    "ChamberImage",
    "ChamberRenderer",
    "Effects",
    "Imprint",
    "PadLook",
    "Renderer",
    "TactileImage",
    "TrueView",
    "height_map",
    "imprint_names",
    "look_of_pad",
]
