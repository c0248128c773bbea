"""The body of a camera as it is sold: a lens barrel on a board, in the section."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float

NAME = "camera module"
"""Of each of the lines of its outline, which are blockers."""

LINES = 6
"""Lines of its outline."""


class CameraModule(eqx.Module):
    """A lens barrel that stands on a board, with a connector behind it; lengths in mm.

    Attributes:
        lens_diameter: of the barrel.
        lens_length: from the barrel's front to the board's front, along the optical axis.
        pupil_depth: from the barrel's front back to the entrance pupil; negative where the glass
            bulges so that the pupil lies before the barrel.
        board: length along the section and across it; the axis meets its middle.
        board_thickness: from the board's front to its back.
        connector_length: how far connector and cable stand out at the back, all along the board.
    """

    lens_diameter: Float[Array, ""] = eqx.field(converter=as_float)
    lens_length: Float[Array, ""] = eqx.field(converter=as_float)
    pupil_depth: Float[Array, ""] = eqx.field(converter=as_float)
    board: Float[Array, "2"] = eqx.field(converter=as_float)
    board_thickness: Float[Array, ""] = eqx.field(converter=as_float)
    connector_length: Float[Array, ""] = eqx.field(converter=as_float)

    def boxes(self) -> Float[Array, "2 2 2"]:
        """Barrel, and board with connector, in the camera's own axes from its entrance pupil.

        Returns:
            Of each box its front and back end along the optical axis, and its right and left side.
        """
        front = self.pupil_depth
        foot = front - self.lens_length
        back = foot - self.board_thickness - self.connector_length
        barrel, board = self.lens_diameter / 2, self.board[0] / 2
        return jnp.stack(
            [
                jnp.stack([jnp.stack([front, foot]), jnp.stack([-barrel, barrel])]),
                jnp.stack([jnp.stack([foot, back]), jnp.stack([-board, board])]),
            ]
        )

    def outline(
        self, position: Float[Array, "2"], direction: Float[Array, ""]
    ) -> Float[Array, "6 2 2"]:
        """Ends of the lines of its outline, mm: the barrel's sides, and the board all around.

        Args:
            position: of the entrance pupil, mm.
            direction: of the optical axis, rad.

        Example:
            >>> module = CameraModule(6.0, 5.0, 0.5, jnp.array([8.0, 8.0]), 1.0, 2.0)
            >>> ends = module.outline(jnp.zeros(2), jnp.zeros(()))
            >>> ends[0].tolist(), ends[-1].tolist()
            ([[0.5, -3.0], [-4.5, -3.0]], [[-7.5, -4.0], [-7.5, 4.0]])
        """
        ((front, foot), (right, left)), ((_, back), (low, high)) = self.boxes()
        lines = [
            (front, right, foot, right),
            (front, left, foot, left),
            (foot, low, foot, high),
            (foot, low, back, low),
            (foot, high, back, high),
            (back, low, back, high),
        ]
        ends = jnp.stack([jnp.stack(line).reshape(2, 2) for line in lines])
        cosine, sine, ahead, aside = (
            jnp.cos(direction),
            jnp.sin(direction),
            *jnp.moveaxis(ends, -1, 0),
        )
        x = position[0] + cosine * ahead - sine * aside
        return jnp.stack([x, position[1] + sine * ahead + cosine * aside], axis=-1)
