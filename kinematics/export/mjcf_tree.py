"""A linkage cut open: a tree of bodies, and the pins that close its loops again.

Simulators in joint coordinates describe a mechanism in this way. Blocks are bodies here: a joint
that slides along a line is pinned to a block, which slides on the body of the line. Where the
slider ``keeps`` a body from turning, that body is the block.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import networkx as nx
import numpy as np

from kinematics.model.assembled import assembled_joints, unit
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD, Structure

Pair = tuple[str, str]


@dataclass(frozen=True)
class Branch:
    """How a body hangs on another one of the tree.

    Attributes:
        body: the outer one.
        parent: the inner one, or `WORLD`.
        joint: in which they meet.
        slider: number of the slider that lets the body slide without turning; none for a hinge.
        forward: whether the body is the slider's block; it is the body of the line otherwise.
    """

    body: str
    parent: str
    joint: str
    slider: int | None = None
    forward: bool = True


@dataclass(frozen=True)
class Closure:
    """A pin in two bodies that was cut."""

    joint: str
    bodies: Pair


@dataclass(frozen=True)
class Tree:
    """A linkage cut open, in its assembled sketch.

    Attributes:
        structure: who is joined to whom.
        branches: one for every moving body and every block, parents first.
        closures: the pins that were cut.
        members: the joints of every moving body and every block.
        joints: their places, mm.
        directions: of the sliders' lines, unit vectors.
    """

    structure: Structure
    branches: tuple[Branch, ...]
    closures: tuple[Closure, ...]
    members: Mapping[str, tuple[str, ...]]
    joints: Mapping[str, np.ndarray]
    directions: tuple[np.ndarray, ...]

    def turn(self, body: str, reference: str) -> dict[str, int]:
        """The hinges that turn a body relative to another one; each may be fixed or `WORLD`.

        Returns:
            For the outer body of each of these hinges, +1 or −1: the angle is their sum.
        """
        node = self.structure.node
        turns = dict.fromkeys(self._hinges(node(body)), 1)
        for name in self._hinges(node(reference)):
            turns[name] = turns.get(name, 0) - 1
        return {name: sign for name, sign in turns.items() if sign}

    def _hinges(self, body: str) -> Iterator[str]:
        inward = {branch.body: branch for branch in self.branches}
        while body != WORLD:
            branch = inward[body]
            if branch.slider is None:
                yield body
            body = branch.parent


def block_of(structure: Structure, slider: int) -> str:
    """The body that slides: the one that is kept from turning, or a block of this number."""
    return structure.sliders[slider].keeps or f"block {slider}"


def cut_open(linkage: Linkage, hinged: Iterable[Pair] = ()) -> Tree:
    """A spanning tree of a linkage.

    Args:
        linkage: one that is not batched.
        hinged: pairs of bodies that should hang on each other if a pin joins them, the most
            important first.
    """
    structure = linkage.structure
    members = {part.name: part.joints for part in structure.moving}
    for index, part in enumerate(structure.sliders):
        members.setdefault(block_of(structure, index), (part.joint,))
    graph, closures = _spanning(structure, members, hinged)
    branches = []
    for parent, body in nx.bfs_edges(graph, WORLD):
        slider = graph.edges[parent, body]["slider"]
        forward = slider is None or body == block_of(structure, slider)
        branches.append(Branch(body, parent, graph.edges[parent, body]["joint"], slider, forward))
    directions = tuple(
        np.array([along.real, along.imag])
        for along in (
            unit(float(line.angle) + _angle(linkage, part.on))
            for line, part in zip(linkage.lines, structure.sliders, strict=True)
        )
    )
    joints = {
        name: np.array([place.real, place.imag])
        for name, place in assembled_joints(linkage).items()
    }
    return Tree(structure, tuple(branches), tuple(closures), members, joints, directions)


def _spanning(
    structure: Structure, members: Mapping[str, tuple[str, ...]], hinged: Iterable[Pair]
) -> tuple[nx.Graph, list[Closure]]:
    """The tree's edges and the pins that are left, by Kruskal's algorithm."""
    holders: dict[str, list[str]] = {joint: [] for joint in structure.joints}
    for body, joints in [(WORLD, structure.fixed_joints), *members.items()]:
        for joint in joints:
            holders[joint].append(body)
    wanted = [{structure.node(body) for body in pair} for pair in hinged]
    pins = [
        Closure(joint, pair)
        for joint, bodies in holders.items()
        for pair in itertools.combinations(bodies, 2)
    ]
    pins.sort(key=lambda pin: [*wanted, {*pin.bodies}].index({*pin.bodies}))

    graph = nx.Graph()
    graph.add_node(WORLD)
    # All slides belong to the tree: a loop of slides alone would prescribe an angle twice, which
    # no linkage does.
    for index, part in enumerate(structure.sliders):
        pair = structure.node(part.on), block_of(structure, index)
        graph.add_edge(*pair, joint=part.joint, slider=index)
    joined = nx.utils.UnionFind([WORLD, *members])
    for pair in graph.edges:
        joined.union(*pair)
    at = {joint: nx.utils.UnionFind(bodies) for joint, bodies in holders.items()}
    for pin in pins:
        if joined[pin.bodies[0]] != joined[pin.bodies[1]]:
            graph.add_edge(*pin.bodies, joint=pin.joint, slider=None)
            joined.union(*pin.bodies)
            at[pin.joint].union(*pin.bodies)
    closures = []
    for pin in pins:
        if at[pin.joint][pin.bodies[0]] != at[pin.joint][pin.bodies[1]]:
            at[pin.joint].union(*pin.bodies)
            closures.append(pin)
    return graph, closures


def _angle(linkage: Linkage, body: str) -> float:
    """Angle of a body's frame in the assembled sketch, rad; 0 for fixed ones."""
    return float(linkage.home_angle(body)) if body in linkage.links else 0.0
