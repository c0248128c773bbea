"""The coordinates of a tree's joints, and angles between bodies as sums of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from kinematics.export.mjcf_tree import Tree
from kinematics.export.mjcf_xml import MM
from kinematics.model.assembled import zeroed
from kinematics.model.linkage import Linkage
from kinematics.model.topology import InputPart


@dataclass(frozen=True)
class Reading:
    """A quantity that is constant + Σ factor · coordinate, by the outer bodies of the joints."""

    constant: float
    factors: Mapping[str, int]

    @property
    def single(self) -> tuple[str, int] | None:
        """The only joint that changes it and its factor; none if there are several."""
        return next(iter(self.factors.items())) if len(self.factors) == 1 else None


@dataclass(frozen=True)
class Coordinates:
    """What the coordinates of the joints mean, rad or m.

    A hinge that an input drives alone has the input's value for its coordinate, any other hinge
    the turn of its outer body from the assembled sketch; a slide has the place of its slider.

    Attributes:
        tree: whose joints.
        inputs: the inputs' values in the assembled sketch, by name.
        home: the coordinates there.
        signs: −1 where a coordinate grows as the outer body turns clockwise.
    """

    tree: Tree
    inputs: Mapping[str, float]
    home: Mapping[str, float]
    signs: Mapping[str, int]

    @classmethod
    def of(cls, linkage: Linkage, tree: Tree) -> Coordinates:
        """The coordinates of a linkage that was cut open."""
        values = [zeroed(float(value)) for value in linkage.reference.inputs]
        inputs = dict(zip(linkage.input_names, values, strict=True))
        slides = [zeroed(float(slide)) * MM for slide in linkage.reference.slides]
        home = {
            branch.body: 0.0 if branch.slider is None else slides[branch.slider]
            for branch in tree.branches
        }
        signs = dict.fromkeys(home, 1)
        for part in linkage.structure.inputs:
            turn = {} if part.body is None else tree.turn(part.body, part.relative_to)
            if len(turn) == 1:
                ((body, sign),) = turn.items()
                home[body], signs[body] = inputs[part.name], sign
        return cls(tree, inputs, home, signs)

    def angle(self, body: str, reference: str, home: float = 0.0) -> Reading:
        """The angle of a body relative to another one, with its value in the assembled sketch."""
        turn = self.tree.turn(body, reference)
        factors = {name: sign * self.signs[name] for name, sign in turn.items()}
        constant = home - sum(f * self.home[name] for name, f in factors.items())
        return Reading(zeroed(constant), factors)

    def input(self, part: InputPart) -> Reading:
        """The value of an input."""
        if part.body is None:
            sliding = next(b.body for b in self.tree.branches if b.slider == part.slider)
            return Reading(0.0, {sliding: 1})
        return self.angle(part.body, part.relative_to, self.inputs[part.name])
