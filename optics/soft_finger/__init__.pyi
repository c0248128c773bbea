from .bending import CentreLine, bent
from .effects import ChamberEffects
from .endoscope import Endoscope
from .renderer import COLOURS, ChamberImage, ChamberRenderer
from .rings import Apertures, Posture, Rings, Spans, apertures, pressed_by, spans, wall_radii
from .sensitivity import extreme_points, image_rates

__all__ = [
    "COLOURS",
    "Apertures",
    "CentreLine",
    "ChamberEffects",
    "ChamberImage",
    "ChamberRenderer",
    "Endoscope",
    "Posture",
    "Rings",
    "Spans",
    "apertures",
    "bent",
    "extreme_points",
    "image_rates",
    "pressed_by",
    "spans",
    "wall_radii",
]
