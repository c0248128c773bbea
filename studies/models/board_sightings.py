"""What perception finds of a board in pictures, in the form in which the optics take it."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from optics.calibration import Sightings
from perception.boards import Board, BoardCorners


def sightings_of(board: Board, found: Sequence[BoardCorners | None]) -> Sightings:
    """The corners of several pictures.

    Args:
        board: the board.
        found: its corners in each picture, if there are any.
    """
    places = np.full((len(found), *board.points.shape), np.nan)
    deviations = np.full(places.shape[:2], np.inf)
    for picture, corners in enumerate(found):
        if corners is not None:
            places[picture, corners.numbers] = corners.places
            deviations[picture, corners.numbers] = corners.errors
    points = jnp.broadcast_to(jnp.asarray(board.points), places.shape)
    return Sightings(points, jnp.asarray(places), jnp.asarray(deviations))
