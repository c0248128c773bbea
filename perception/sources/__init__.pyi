from .frames import Frame, Item, Loss, LostFrame, Notice
from .light import Light, LightWatch
from .opening import open_source
from .source import Source
from .videos import VideoFile

__all__ = [
    "Frame",
    "Item",
    "Light",
    "LightWatch",
    "Loss",
    "LostFrame",
    "Notice",
    "Source",
    "VideoFile",
    "open_source",
]
