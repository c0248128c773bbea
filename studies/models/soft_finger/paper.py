"""Table I as printed in paper A (*Vision-Based Tactile Perception for Soft Robotic Hand*)."""

from __future__ import annotations

import math

ETA = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
DELTA_L_D_CM = (0.759, 0.633, 0.507, 0.381, 0.255, 0.129)
THETA_CD_DEG = (15.888, 13.640, 11.348, 9.019, 6.659, 4.277)

PLACES = (1, 3, 3)
"""Printed decimals of η, Δl_D and θ_CD."""

ROUNDING_DEVIATION = 1e-3 / math.sqrt(12)
"""Standard deviation of a number rounded to three decimals, uniform over the last digit."""

CHOSEN_ETA = 0.6
"""The paper's recommendation: |Δl_D| inside Δl_A with room to spare."""
