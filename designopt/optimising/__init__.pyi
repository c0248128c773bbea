from .optimise import optimise

__all__ = ["optimise"]
