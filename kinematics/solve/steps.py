"""What a plan consists of: angles that are tied together, groups, and placements."""

from __future__ import annotations

from dataclasses import dataclass

from kinematics.model.loops import Loop
from kinematics.model.topology import Incidence


@dataclass(frozen=True)
class Turn:
    """One step from a body's angle to that of another.

    Attributes:
        input: index of the input whose value is added; none for a kept body.
        slider: index of the slider whose ``turn`` is added; none for an input.
        sign: +1 or −1.
        relative_to: the fixed body whose angle is added as well; none otherwise.
        solved: number of the group, and of its angle, that is added; none for the above.
    """

    input: int | None = None
    slider: int | None = None
    sign: int = 1
    relative_to: str | None = None
    solved: tuple[int, int] | None = None


@dataclass(frozen=True)
class Orientation:
    """A body's angle: that of its root body (`WORLD`: 0) and known turns."""

    root: str
    turns: tuple[Turn, ...]


@dataclass(frozen=True)
class Placement:
    """A joint put in its place by a body whose pose is known, from a joint that is placed.

    Attributes:
        at: the incidence whose joint is placed.
        reference: an incidence of a placed joint on the same body.
    """

    at: Incidence
    reference: Incidence


@dataclass(frozen=True)
class Group:
    """Unknowns that are solved together.

    Attributes:
        index: its number among the groups of the whole plan.
        kind: ``"RRR"``, ``"RRP"``, ``"RPR"``, ``"PRP"``, ``"RPP"`` (closed form), or
            ``"iterated"``.
        angles: bodies whose angle is unknown, each the root of those that turn with it.
        turning: the bodies that turn with each of them.
        sliders: sliders whose place is unknown.
        loops: its loops; twice as many equations as loops, as many as unknowns.
        pin: the joint at which force is transmitted between its two parts; none if it has no
            such joint.
        bodies: its bodies, for messages.
        base: the root in whose frame it is solved, when that root's own angle is still unknown;
            none where the angles are those in the world.
    """

    index: int
    kind: str
    angles: tuple[str, ...]
    turning: tuple[tuple[str, ...], ...]
    sliders: tuple[int, ...]
    loops: tuple[Loop, ...]
    pin: str | None
    bodies: tuple[str, ...]
    base: str | None = None


@dataclass(frozen=True)
class Plan:
    """How the pose of a linkage is found: groups and placements in order.

    Attributes:
        orientations: angle of every moving body.
        steps: what to do, in order.
    """

    orientations: dict[str, Orientation]
    steps: tuple[Group | Placement, ...]

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups in the order in which they are solved."""
        return tuple(step for step in self.steps if isinstance(step, Group))

    @property
    def iterated(self) -> tuple[Group, ...]:
        """The groups without a closed form."""
        return tuple(group for group in self.groups if group.kind == "iterated")


class PlanError(ValueError):
    """The equations do not determine the pose, or a name in a plan's targets is unknown."""
