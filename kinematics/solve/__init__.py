"""Poses and what follows from them: rates, limits, transmission, statics, tolerances."""
