from .board import Board, read_board
from .detection import BoardCorners, detect_board
from .drawing import draw_board

__all__ = ["Board", "BoardCorners", "detect_board", "draw_board", "read_board"]
