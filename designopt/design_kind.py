"""Kinds of designs, and what the commands around a design take of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from designopt.errors import UserError, load_plug_in
from designopt.io.files import read_toml

if TYPE_CHECKING:  # these load JAX and NumPy, and a command first lists names
    from designopt.explore.explorer import Explorer
    from designopt.export.drawing import Drawing
    from designopt.export.json import Quantity
    from designopt.export.parts import Assembly
    from designopt.optimize.parametric import ParametricDesign

DESIGN_GROUP = "designopt.designs"

Ranges = Mapping[str, tuple[float, float]]
"""Least and greatest values by the names of joints or inputs, degrees or mm."""

NO_RANGES: Ranges = MappingProxyType({})


@dataclass(frozen=True)
class DesignKind:
    """A kind of design; those in files are offered through the group ``designopt.designs``.

    The functions import what they need when they are called, so that a model does not depend on
    what explores, draws or exports it. All but ``read`` take what ``read`` returns, and are called
    with JAX in float64.

    Attributes:
        name: what such a file describes, such as ``"linkage"``.
        table: the table that files of this kind have, and of others only those that share it.
        read: from a file to the model; its ``name`` is used in titles and file names.
        explorer: what turns the model, for ``designopt explore``.
        drawing: it drawn to scale in its reference pose.
        quantities: every number of it.
        mjcf: the text of a MuJoCo model of it; ``None`` where nothing of it moves.
        assembly: it as parts to make; ``None`` where it has no width.
        parametric: it as named numbers that can be optimised, in postures between the given ends
            of its joints or inputs (degrees or mm; the others have their own); ``None`` where
            nothing of it can.
        command: what computes something of such a file, for messages.
        shared: tables of other kinds that files of this kind have as well.
    """

    name: str
    table: str
    read: Callable[[Path], Any]
    explorer: Callable[[Any], Explorer]
    drawing: Callable[[Any], Drawing]
    quantities: Callable[[Any], Sequence[Quantity]]
    mjcf: Callable[[Any], str] | None = None
    assembly: Callable[[Any], Assembly] | None = None
    parametric: Callable[[Any, Ranges], ParametricDesign] | None = None
    command: str = "designopt explore"
    shared: tuple[str, ...] = ()


@dataclass(frozen=True)
class Design:
    """A model with its kind."""

    kind: DesignKind
    model: Any

    @property
    def name(self) -> str:
        """In titles and file names."""
        return self.model.name

    def explorer(self) -> Explorer:
        """What turns it, for ``designopt explore``."""
        return self.kind.explorer(self.model)

    def parametric(self, over: Ranges = NO_RANGES) -> ParametricDesign:
        """It as named numbers that can be optimised.

        Args:
            over: ends of joints or inputs, as in `DesignKind`.

        Raises:
            UserError: nothing of it can, or there is no such joint.
        """
        if self.kind.parametric is None:
            raise UserError(f"{self.name}: a {self.kind.name} has nothing that can be optimised")
        return self.kind.parametric(self.model, over)

    def drawing(self) -> Drawing:
        """It drawn to scale in its reference pose."""
        return self.kind.drawing(self.model)

    def quantities(self) -> Sequence[Quantity]:
        """Every number of it."""
        return self.kind.quantities(self.model)

    def mjcf(self) -> str:
        """The text of a MuJoCo model of it.

        Raises:
            UserError: nothing of it moves, or it moves as no such model can.
        """
        if self.kind.mjcf is None:
            raise UserError(
                f"--to mjcf: {self.name} has no linkage that moves it; export a linkage file, or a "
                "study that designs a linkage, such as 'finger-linkage'"
            )
        return self.kind.mjcf(self.model)

    def assembly(self) -> Assembly:
        """It as parts to make and to buy.

        Raises:
            UserError: such a design is lines in a plane, or this one lacks what its parts need.
        """
        if self.kind.assembly is None:
            raise UserError(
                f"{self.name}: a {self.kind.name} has no thickness, so that there are no parts to "
                "make; export a finger, such as 'finger' or the folder of a result of it"
            )
        return self.kind.assembly(self.model)


def installed_kinds() -> list[DesignKind]:
    """Every installed kind of design files.

    Raises:
        UserError: one cannot be loaded.
    """
    return [load_plug_in(one, "the kind of file") for one in entry_points(group=DESIGN_GROUP)]


def kind_of_tables(tables: Mapping[str, Any]) -> DesignKind | None:
    """The kind of a design's file, by its tables; ``None`` if there is no such kind.

    Raises:
        UserError: a kind cannot be loaded.
    """
    kinds = [kind for kind in installed_kinds() if kind.table in tables]
    shared = {table for kind in kinds for table in kind.shared}
    return next((kind for kind in kinds if kind.table not in shared), None)


def read_tables(path: str | Path, what: str, table: str) -> dict[str, Any]:
    """The tables of a design's file of one kind; otherwise as `read_toml`.

    Args:
        path: the file.
        what: what such a file describes, as in `DesignKind`.
        table: the table that every such file has.

    Raises:
        UserError: also where the file is of another kind.
    """
    tables = read_toml(path, what)
    kind = kind_of_tables(tables)
    if kind is not None and (table not in tables or table in kind.shared):
        raise UserError(
            f"{path}: it describes a {kind.name} and no {what}; {kind.command} takes it"
        )
    return tables
