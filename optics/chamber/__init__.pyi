from .bending import CentreLine, bent
from .endoscope import Endoscope
from .rings import Apertures, Posture, Rings, Spans, apertures, pressed_by, spans, wall_radii
from .sensitivity import extreme_points, image_rates

__all__ = [
    "Apertures",
    "CentreLine",
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
