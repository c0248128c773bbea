"""What is photographed: fingers with errors, in several lights, with things pressed into pads."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from studies.image_check.cases import COUPLED, EVEN, GAMMA, GAP, Finger, nominal
from studies.models.sensor.poses import spread_angles
from studies.models.sensor.spec import WIDTH
from studies.oracles.judge.capture import Capture
from studies.oracles.judge.contacts import Contact
from studies.oracles.judge.fabrication import sample_errors
from studies.physical_check.contacts import ContactCheckSpec

CONDITIONS = (
    (EVEN, "none"),
    (GAP, "none"),
    (EVEN, "3 mm"),
    (COUPLED, "3 mm, lamps"),
    (GAP, "3 mm, polished"),
)
"""Light and layers of one finger after the other."""

RANGE_DEG = 90.0
"""Of both joints."""

MOST = 3
"""Things in a pad."""

RADII = {"sphere": (2.0, 8.0), "pin": (0.8, 2.5)}
"""Least and greatest, mm; of a pin of what is flat."""

DEPTHS = (0.3, 1.5)
"""Least and greatest, mm."""

ROOM, BETWEEN = 0.5, 1.5
"""mm between a contact's edge and the pad's, and between contacts' edges, at least."""

TRIES = 200
"""Places that are tried for things that are pressed in; fewer fit on a small pad."""

HEIGHTS = 12
"""On a lamp: the light of what is lifted by more than a millimeter has no steps to see."""


def fingers(spec: ContactCheckSpec, deviations: Mapping[str, Any], seed: int) -> Iterator[Finger]:
    """All fingers of a run."""
    for number in range(spec.fingers):
        light, layers = CONDITIONS[number % len(CONDITIONS)]
        generator = np.random.default_rng([seed, number])
        tables = nominal("3 mm, polished" if light == COUPLED else layers)
        has = {"pupil"} | ({"thickness", "index"} if layers == "none" else set())
        own = {name: value for name, value in deviations.items() if name not in has}
        errors = sample_errors(tables, own, generator)
        flat = spec.references + spec.untouched
        poses = np.concatenate(
            [
                spread_angles([(0.0, RANGE_DEG)] * 2, spec.references),
                generator.uniform(0, RANGE_DEG, (spec.untouched + spec.pressed, 2)),
            ]
        ).round(3)
        capture = _capture(light, generator)
        captures = [
            dataclasses.replace(
                capture,
                exposure=float(generator.uniform(0.6, 0.9)),
                contacts=press_pads(tables, generator) if frame >= flat else (),
            )
            for frame in range(len(poses))
        ]
        yield Finger(number, light, layers, tables, errors, poses, captures)


def _capture(light: str, generator: np.random.Generator) -> Capture:
    common = {
        "gamma": float(generator.choice([1.0, GAMMA])),
        "blur": float(generator.uniform(0.4, 0.8)),
        "jpeg": 90,
    }
    if light == EVEN:
        return Capture(**common)
    return Capture(
        light="lamps",
        coupling="coupled" if light == COUPLED else "air",
        walls=float(generator.uniform(0.02, 0.08)),
        heights=HEIGHTS,
        **common,
    )


def press_pads(tables: Mapping[str, Any], generator: np.random.Generator) -> tuple[Contact, ...]:
    """Spheres and pins pressed into every pad, apart from each other."""
    found: list[Contact] = []
    for pad in tables["pads"]:
        length, own = math.dist(pad["from"], pad["to"]), []
        count = int(generator.integers(1, MOST + 1))
        for _ in range(TRIES):
            kind = ("sphere", "pin")[int(generator.integers(2))]
            size, depth = (float(generator.uniform(*one)) for one in (RADII[kind], DEPTHS))
            one = Contact(pad["name"], kind, 0.0, 0.0, depth, size=size)
            room = one.edge + ROOM
            along = float(generator.uniform(room, length - room))
            across = float(generator.uniform(room - WIDTH / 2, WIDTH / 2 - room))
            if all(
                math.hypot(along - other.along, across - other.across)
                > one.edge + other.edge + BETWEEN
                for other in own
            ):
                own.append(one._replace(along=along, across=across))
            if len(own) == count:
                break
        found += own
    return tuple(found)
