"""Who is joined to whom: the part of a linkage that holds no numbers."""

from __future__ import annotations

import functools
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, replace

WORLD = "world"
"""Stands for all fixed bodies, and for the fixed axes in ``relative_to``."""


@dataclass(frozen=True)
class BodyPart:
    """A rigid body: its joints in order, the first being its origin."""

    name: str
    joints: tuple[str, ...]
    fixed: bool = False


@dataclass(frozen=True)
class SliderPart:
    """A joint on a line of a body; ``keeps`` names a body of the joint that does not turn."""

    joint: str
    on: str
    keeps: str | None = None


@dataclass(frozen=True)
class InputPart:
    """A driven quantity: the angle of ``body`` relative to another, or a slider by its index."""

    name: str
    body: str | None
    slider: int | None
    relative_to: str = WORLD


@dataclass(frozen=True)
class Incidence:
    """That a joint lies on a body: at a place of its own (a pin), or on slider number ``slider``.

    The body of a fixed part is `WORLD`.
    """

    joint: str
    body: str
    slider: int | None = None


@dataclass(frozen=True)
class Structure:
    """Joints, bodies, sliders, inputs and springs by name, without any dimension."""

    name: str
    joints: tuple[str, ...]
    bodies: tuple[BodyPart, ...]
    sliders: tuple[SliderPart, ...]
    inputs: tuple[InputPart, ...]
    springs: tuple[tuple[str, str], ...]

    @functools.cached_property
    def untitled(self) -> Structure:
        """The same without the linkage's name, on which no plan depends."""
        return replace(self, name="")

    @functools.cached_property
    def moving(self) -> tuple[BodyPart, ...]:
        """The bodies that are not fixed."""
        return tuple(body for body in self.bodies if not body.fixed)

    @functools.cached_property
    def fixed_joints(self) -> tuple[str, ...]:
        """Joints of fixed bodies, each once."""
        return tuple(
            dict.fromkeys(joint for body in self.bodies if body.fixed for joint in body.joints)
        )

    @functools.cached_property
    def incidences(self) -> tuple[Incidence, ...]:
        """Which joint lies on which body; a joint that is on the fixed body is so once."""
        pins = [Incidence(joint, WORLD) for joint in self.fixed_joints]
        pins += [Incidence(joint, body.name) for body in self.moving for joint in body.joints]
        slides = [
            Incidence(slider.joint, self.node(slider.on), index)
            for index, slider in enumerate(self.sliders)
        ]
        return (*pins, *slides)

    def body(self, name: str) -> BodyPart:
        """The body of that name."""
        return next(body for body in self.bodies if body.name == name)

    def node(self, body: str) -> str:
        """`WORLD` for a fixed body (or for `WORLD`), the body's own name otherwise."""
        return WORLD if body == WORLD or self.body(body).fixed else body

    def driven_slider(self, index: int) -> int | None:
        """Which input drives slider number ``index``; none if it is free."""
        return next((i for i, part in enumerate(self.inputs) if part.slider == index), None)


def connected_parts(pairs: Iterable[tuple[Hashable, Hashable]]) -> list[set[Hashable]]:
    """Sets of what is connected by pairs, directly or not, in the order in which they appear.

    Example:
        >>> [sorted(part) for part in connected_parts([(1, 2), (5, 6), (3, 2)])]
        [[1, 2, 3], [5, 6]]
    """
    parts: list[set[Hashable]] = []
    for pair in pairs:
        touched = [part for part in parts if not part.isdisjoint(pair)]
        first, *rest = touched or [set[Hashable]()]
        first.update(pair, *rest)
        parts = [*(part for part in parts if part not in rest), *([] if touched else [first])]
    return parts
