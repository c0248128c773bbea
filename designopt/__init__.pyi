from .errors import UserError
from .solution import Solution

__all__ = ["Solution", "UserError"]
