"""How a sensor's pads are lit, as a person states it: ``--light``, ``[light]`` of a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pydantic

from designopt.errors import UserError
from designopt.io.files import read_toml
from designopt.io.spec import Spec
from designopt.io.spec_files import Number, validated
from perception.contacts import Lamp


class LampTable(Spec):
    """A line lamp as long as the side of each pad that it is beside.

    Sides are those of the unwarped pad: rows go from its end "from" to "to", columns to the right.
    """

    beside: Literal["from", "to", "left", "right"]
    """The edge of the unwarped pad beside which it lies."""
    gap: Annotated[Number, pydantic.Field(ge=0)] = 0.0
    """From the pad's edge, mm."""
    low: Annotated[Number, pydantic.Field(ge=0)] = 0.0
    """Height of its lower edge above the membrane, mm."""
    high: Annotated[Number, pydantic.Field(gt=0)]
    """Height of its upper edge above the membrane, mm."""

    @pydantic.model_validator(mode="after")
    def _has_a_height(self) -> LampTable:
        if self.low >= self.high:
            raise ValueError(
                "its edges' heights are the wrong way round; make 'low' less than 'high'"
            )
        return self

    def lamp(self, length: float, width: float) -> Lamp:
        """The lamp of a pad of a size, mm."""
        half, first, last = width / 2, -self.gap, length + self.gap
        left, right = -half - self.gap, half + self.gap
        start, end = {
            "from": ((first, -half), (first, half)),
            "to": ((last, -half), (last, half)),
            "left": ((0.0, left), (length, left)),
            "right": ((0.0, right), (length, right)),
        }[self.beside]
        return Lamp(start, end, self.low, self.high)


class LightTable(Spec):
    """``[light]``: the lamp of each color; without any, light comes evenly from all sides."""

    red: LampTable | None = None
    """Lamp of the red light."""
    green: LampTable | None = None
    """Lamp of the green light."""
    blue: LampTable | None = None
    """Lamp of the blue light."""

    def lamps(self, length: float, width: float) -> list[Lamp | None]:
        """Those of a pad of a size, mm: red, green and blue; none in even light."""
        tables = self.red, self.green, self.blue
        if not any(tables):
            return []
        return [None if one is None else one.lamp(length, width) for one in tables]


EVEN = "even"
"""Light that comes from all sides, as ``--light`` names it."""


class LightFile(Spec):
    """The whole file that ``--light`` names."""

    light: LightTable
    """How every pad is lit."""


def read_light(given: str) -> LightTable:
    """The light that ``--light`` states: ``even``, or the ``[light]`` of a file.

    Raises:
        UserError: it is neither, or the file is wrong.

    Example:
        >>> read_light("even").lamps(20.0, 10.0)
        []
    """
    if given == EVEN:
        return LightTable()
    if not Path(given).is_file():
        raise UserError(
            f"--light {given}: there is no such file; write [light.red], [light.green] and "
            f"[light.blue] into one, or give '{EVEN}'"
        )
    return validated(LightFile, read_toml(given, "light"), given).light
