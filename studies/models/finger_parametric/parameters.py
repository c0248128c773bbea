"""Every dimension of a finger that may change, as a named number between bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.interpreter import interpret
from designopt.optimize.parametric import Parameter
from studies.models.finger import Finger
from studies.models.finger_parts import PHALANGES
from studies.models.mirror_design.placement import bounds
from studies.models.mirror_design.spec import MirrorSpec
from studies.models.pins import pin_name

SHORTEST, LONGEST = 0.6, 1.6
"""Range of the body's dimensions and of the spring, as parts of what they are."""

FREE = ("pins.", "camera.", "mirrors.")
"""What an optimization may change unless others are named: a body is given, and so is a spring."""

Leaf = Callable[[Any], Any]
"""From a finger, or from a pytree of its structure, to one array of it."""


class _Part(NamedTuple):
    """One array of a finger, and how each of its elements is written.

    Attributes:
        leaf: the array.
        names: of its elements, in their order; the labels follow from them.
        low: their least values, in the array's units.
        high: their greatest values.
        unit: in which they are written; an angle in rad is written in degrees where it is ``"°"``.
    """

    leaf: Leaf
    names: tuple[str, ...]
    low: Float[np.ndarray, "..."]
    high: Float[np.ndarray, "..."]
    unit: str = "mm"

    @property
    def factor(self) -> float:
        """Of what is written over what is computed with."""
        return float(np.rad2deg(1.0)) if self.unit == "°" else 1.0


class FingerParameters:
    """The dimensions of one finger.

    Attributes:
        parameters: all of them, in the units in which people read them.
    """

    def __init__(self, finger: Finger, mirrors: MirrorSpec) -> None:
        """The parameters of a finger, whose values are inside their bounds.

        Args:
            finger: with pins, a camera or both.
            mirrors: the room in which its mirrors and its camera may be.
        """
        self._finger = finger
        self._parts = [*_of_pins(finger), *_of_optics(finger, mirrors), *_of_body(finger)]
        parameters = []
        for part in self._parts:
            found = np.broadcast_arrays(np.asarray(part.leaf(finger)), part.low, part.high)
            columns = (np.ravel(one) * part.factor for one in found)
            for name, value, low, high in zip(part.names, *columns, strict=True):
                least, most = float(min(low, value)), float(max(high, value))
                parameters.append(Parameter(name, float(value), least, most, part.unit))
        self.parameters = tuple(
            Parameter(one.name, one.value, one.low, one.high, one.unit, _label(one.name))
            for one in parameters
        )

    def finger(self, values: Float[Array, " parameters"]) -> Finger:
        """The finger of other values, assembled as this one; traced by JAX.

        Args:
            values: of `parameters`, in their order and units.
        """
        leaves, at = [], 0
        for part in self._parts:
            count = len(part.names)
            shape = np.shape(part.leaf(self._finger))
            leaves.append(jnp.reshape(values[at : at + count] / part.factor, shape))
            at += count
        return eqx.tree_at(
            lambda one: [part.leaf(one) for part in self._parts], self._finger, leaves
        )


def _label(name: str) -> str:
    """Such as "pin F x", "distal mirror from depth"."""
    group, *rest = name.split(".")
    words = {"pins": ["pin", *rest], "mirrors": [*rest[:1], "mirror", *rest[1:]], "body": rest}
    return " ".join(words.get(group, [group, *rest])).replace("_", " ")


def _of_pins(finger: Finger) -> list[_Part]:
    """Places of all pins: anywhere between the faces, beside their phalanges or near them."""
    if finger.pins is None:
        return []
    body = finger.body
    low, high, middle = float(body.palmar), float(body.dorsal), float(body.intermediate)
    spans = {
        "proximal": (-float(body.proximal), middle / 2),
        "intermediate": (-middle, 1.5 * middle),
        "distal": (middle / 2, middle + float(body.distal)),
    }
    return [
        _Part(
            lambda one, pin=pin: getattr(one.pins, pin),
            tuple(f"pins.{pin_name(pin)}.{axis}" for axis in "xy"),
            np.array([spans[host][0], low]),
            np.array([spans[host][1], high]),
        )
        for pin, host in finger.pins.kind.hosts.items()
        if pin in finger.pins.names
    ]


def _of_optics(finger: Finger, spec: MirrorSpec) -> list[_Part]:
    """Places of camera and mirrors, between the bounds of their own search."""
    if finger.camera is None:
        return []
    low, high = interpret(partial(bounds, spec=spec), finger)

    def part(leaf: Leaf, names: Sequence[str], unit: str = "mm") -> _Part:
        return _Part(leaf, tuple(names), np.asarray(leaf(low)), np.asarray(leaf(high)), unit)

    found = [
        part(lambda one: one.camera.along, ["camera.along"]),
        part(lambda one: one.camera.depth, ["camera.depth"]),
        part(lambda one: one.camera.tilt, ["camera.tilt"], "°"),
    ]
    for number, name in enumerate(finger.mirror_names):
        ends = [f"mirrors.{name}.{end}" for end in ("from", "to")]
        names = [f"{end}.{axis}" for end in ends for axis in ("along", "depth")]
        found.append(part(lambda one, number=number: one.mirrors[number].ends, names))
    return found


def _of_body(finger: Finger) -> list[_Part]:
    """The body's dimensions and the spring."""
    leaves: list[tuple[str, Leaf, str]] = [
        (f"body.{name}", lambda one, name=name: getattr(one.body, name), "mm")
        for name in (*PHALANGES, "thickness", "axis_height")
    ]
    if finger.spring is not None:
        leaves.append(("spring.stiffness", lambda one: one.spring.stiffness, "N mm/rad"))
        leaves.append(("spring.preload", lambda one: one.spring.preload, "rad"))
    found = []
    for name, leaf, unit in leaves:
        value = np.asarray(leaf(finger))
        low, high = (SHORTEST * value, LONGEST * value) if value > 0 else (value, value + 1.0)
        found.append(_Part(leaf, (name,), low, high, unit))
    return found
