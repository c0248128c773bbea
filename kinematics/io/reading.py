"""From a linkage file to a linkage."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kinematics.io.assembled_sketch import assemble_sketch
from kinematics.io.sketch import Sketch, load_sketch, parse_sketch
from kinematics.model.linkage import Linkage


def read_linkage(path: str | Path) -> Linkage:
    """The linkage that a file describes.

    Args:
        path: a TOML file of joints, bodies, sliders, inputs and springs (see the README).

    Returns:
        The linkage, with exact lengths and the sketch's assembly. Arrays have JAX's default
        float type.

    Raises:
        UserError: the file cannot be read or describes no mechanism that these inputs drive; one
            line names the place and the cure.

    Example:
        >>> from importlib.resources import files
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> linkage.structure.name, float(linkage.links["crank"].length)
        ('four-bar', 40.0)
    """
    return build_linkage(load_sketch(path), str(path))


def parse_linkage(data: Mapping[str, Any], source: str = "sketch") -> Linkage:
    """The linkage that the tables of a linkage file describe; otherwise as `read_linkage`.

    Example:
        >>> import tomllib
        >>> from importlib.resources import files
        >>> text = (files("studies") / "gallery/linkages/four-bar.toml").read_text()
        >>> parse_linkage(tomllib.loads(text)).structure.name
        'four-bar'
    """
    return build_linkage(parse_sketch(dict(data), source), source)


def build_linkage(sketch: Sketch, source: str) -> Linkage:
    """The linkage of a sketch; otherwise as `read_linkage`.

    Args:
        sketch: the file's content.
        source: its name, for messages.
    """
    assembled = assemble_sketch(sketch, source)
    return Linkage.of(assembled.numbers, assembled.structure, assembled.assembly)
