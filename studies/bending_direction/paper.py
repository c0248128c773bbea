"""Table II as printed in paper A (*Vision-Based Tactile Perception for Soft Robotic Hand*)."""

from __future__ import annotations

from perception.chamber import Direction

ANSWERS = (
    Direction.INITIAL,
    Direction.UP,
    Direction.DOWN,
    Direction.LEFT,
    Direction.RIGHT,
)
"""The table's columns."""

COUNTS = {
    (Direction.UP, False): (3, 296, 0, 0, 1),
    (Direction.UP, True): (9, 291, 0, 0, 0),
    (Direction.DOWN, False): (0, 0, 292, 8, 0),
    (Direction.DOWN, True): (9, 0, 288, 3, 0),
    (Direction.LEFT, False): (0, 0, 7, 288, 5),
    (Direction.LEFT, True): (15, 0, 0, 285, 0),
    (Direction.RIGHT, False): (0, 0, 0, 0, 300),
    (Direction.RIGHT, True): (8, 0, 0, 0, 292),
}
"""Predicted directions of 300 images, by true direction and whether a threshold was set."""

ACCURACY = {
    (Direction.UP, False): 99.67,
    (Direction.UP, True): 100.0,
    (Direction.DOWN, False): 97.33,
    (Direction.DOWN, True): 99.0,
    (Direction.LEFT, False): 96.0,
    (Direction.LEFT, True): 100.0,
    (Direction.RIGHT, False): 100.0,
    (Direction.RIGHT, True): 100.0,
}
"""As printed, percent; all follow from the counts if "initial" counts as correct."""
