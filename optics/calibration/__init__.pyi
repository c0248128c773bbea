from .fisheye import Fisheye

__all__ = ["Fisheye"]
