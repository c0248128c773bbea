"""A finger's linkage as the file that ``designopt solve`` reads."""

from __future__ import annotations

from designopt.io.spec_file import SpecFile
from designopt.io.toml_writing import format_toml
from studies.models.finger import Finger


def linkage_file(finger: Finger) -> SpecFile:
    """The file of the linkage, driven at its joints."""
    text = format_toml(
        finger.linkage_tables(),
        "The finger's linkage, driven at its joints; flexion is negative.\n"
        "designopt solve linkage.toml --sweep pip=0:-90:91 --sweep dip=0",
    )
    return SpecFile("linkage.toml", "the linkage, for `designopt solve`", text)
