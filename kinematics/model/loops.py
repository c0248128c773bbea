"""Vector loops: closed walks from joint to joint through bodies, found from the graph.

Source: J. J. Uicker, G. R. Pennock, J. E. Shigley, *Theory of Machines and Mechanisms*, ch. 2
(loop-closure equations); the independent ones are a basis of the graph's cycles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from designopt.kept import kept
from kinematics.model.topology import WORLD, Incidence, Structure


@dataclass(frozen=True)
class Leg:
    """One step of a loop, within a body: from one of its joints to another.

    Attributes:
        body: the body, or `WORLD`.
        start: where the step enters it.
        end: where the step leaves it.
    """

    body: str
    start: Incidence
    end: Incidence


@dataclass(frozen=True)
class Loop:
    """A closed walk: place of ``start`` + vectors of the legs = place of ``end``.

    Attributes:
        legs: its steps in order.
        start: a joint whose place is known; none if the walk ends where it began.
        end: likewise.
    """

    legs: tuple[Leg, ...]
    start: str | None = None
    end: str | None = None

    def __str__(self) -> str:
        names = ["fixed" if leg.body == WORLD else leg.body for leg in self.legs]
        steps = zip(self.legs, names, strict=True)
        walk = " ".join(f"{leg.start.joint} –[{name}]–" for leg, name in steps)
        return f"{walk} {self.legs[-1].end.joint}"


def find_vector_loops(structure: Structure) -> tuple[Loop, ...]:
    """Independent vector loops of a whole linkage.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> [str(loop) for loop in find_vector_loops(linkage.structure)]
        ['O4 –[fixed]– O2 –[crank]– A –[coupler]– B –[rocker]– O4']
    """
    return _vector_loops(structure.untitled)


@kept
def _vector_loops(structure: Structure) -> tuple[Loop, ...]:
    return tuple(find_loops(structure.incidences))


def find_loops(
    incidences: Sequence[Incidence],
    known_joints: Sequence[str] = (),
    known_bodies: Mapping[str, Incidence] | None = None,
) -> list[Loop]:
    """Independent loops of a graph of joints on bodies.

    Args:
        incidences: which joints lie on which bodies.
        known_joints: joints whose places are known.
        known_bodies: bodies whose poses are known, each with a joint on it whose place is known.
            All that is known counts as one body.
    """
    import networkx as nx  # a quarter of a second, and loops and plans are kept

    references = known_bodies or {}
    graph = nx.Graph()
    for index, incidence in enumerate(incidences):
        body, joint = ("body", incidence.body), ("joint", incidence.joint)
        # The incidence is a node of its own: a joint may slide on two lines of one body.
        graph.add_edge(_KNOWN if incidence.body in references else body, index)
        graph.add_edge(index, _KNOWN if incidence.joint in known_joints else joint)
    root = next((node for node in (_KNOWN, ("body", WORLD)) if node in graph), None)
    return [_loop(cycle, incidences, references) for cycle in nx.cycle_basis(graph, root)]


_KNOWN = ("known", "")


def _loop(
    cycle: list[Any], incidences: Sequence[Incidence], references: Mapping[str, Incidence]
) -> Loop:
    # Turn the cycle so that it starts with what is known, or with the fixed body, or any body.
    things = [i for i, node in enumerate(cycle) if not isinstance(node, int)]
    first = min(things, key=lambda i: (cycle[i] != _KNOWN, cycle[i][1] != WORLD, cycle[i][0]))
    turned = cycle[first:] + cycle[:first]
    legs = [
        Leg(node[1], incidences[turned[i - 1]], incidences[turned[(i + 1) % len(turned)]])
        for i, node in enumerate(turned)
        if not isinstance(node, int) and node[0] == "body"
    ]
    if turned[0] != _KNOWN:
        return Loop(tuple(legs))
    leave, arrive = incidences[turned[1]], incidences[turned[-1]]
    if leave.body in references:
        legs.insert(0, Leg(leave.body, references[leave.body], leave))
    if arrive.body in references:
        legs.append(Leg(arrive.body, arrive, references[arrive.body]))
    return Loop(tuple(legs), legs[0].start.joint, legs[-1].end.joint)
