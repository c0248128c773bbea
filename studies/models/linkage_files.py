"""Pins as the linkage file that ``designopt solve`` reads."""

from __future__ import annotations

from designopt.io.spec_file import SpecFile
from designopt.io.toml_writing import toml_text
from studies.models.body import BodySpec
from studies.models.pins import Pins, linkage_table


def spec_file(pins: Pins, body: BodySpec) -> SpecFile:
    """The linkage file of a design."""
    text = toml_text(
        linkage_table(pins, body, "joints"),
        "The finger's linkage, driven at its joints; flexion is negative.\n"
        "designopt solve linkage.toml --sweep pip=0:-90:91 --sweep dip=0",
    )
    return SpecFile("linkage.toml", "the linkage, for `designopt solve`", text)
