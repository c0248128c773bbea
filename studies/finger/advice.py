"""What would help where a finger cannot meet its requirements: one setting at a time.

Of every setting the smallest change is looked for with which all requirements are met. Designs that
begin with the one that was found bracket it, and show early where the largest change brings it no
nearer; then the finger is designed as a run designs it, with that change, which must meet
everything, and with half of it, which is to miss something.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from typing import Any, NamedTuple

from pydantic import ValidationError

from designopt.compilation_cache import forget_programs_if_many
from designopt.study.records import Records
from designopt.study.settings import fields
from studies.finger.designing import Designer
from studies.finger.spec import FingerSpec
from studies.models.linkage_kinds import KindName


class Lever(NamedTuple):
    """A setting that may be changed.

    Attributes:
        setting: its name, as after ``--set``.
        step: changes are multiples of it; its sign is the direction that helps. Of a list it is a
            part of every entry.
        most: steps of the largest change.
        kind: of the linkages that it concerns; ``None``: every one.
    """

    setting: str
    step: float
    most: int
    kind: KindName | None = None


LEAST = 1 / 8
"""Smaller changes than so much of a step are none."""

LEVERS = (
    Lever("body.thickness", 0.5, 16),
    Lever("body.proximal", 1.0, 16),
    Lever("body.intermediate", 1.0, 16),
    Lever("body.distal", 1.0, 16),
    Lever("body.axis_height", 0.5, 16, "coupled"),
    Lever("body.range_deg", -5.0, 8),
    Lever("body.dip_range_deg", -5.0, 8),
    Lever("linkage.limits.width", 0.5, 16),
    Lever("linkage.limits.transmission_deg", -1.0, 16),
    Lever("linkage.limits.crank_range_deg", 5.0, 8),
    Lever("linkage.limits.pinch_force", -0.5, 16, "six-bar"),
    Lever("linkage.limits.dip_error_deg", 1.0, 8, "coupled"),
    Lever("linkage.limits.clearance", -0.1, 4),
    Lever("linkage.links.bar_width", -0.25, 8),
    Lever("linkage.motor.moment", 50.0, 16),
    Lever("linkage.motor.arm", -0.5, 8, "coupled"),
    Lever("spring.preload", 0.05, 16, "six-bar"),
    Lever("mirrors.camera.fov_deg", 5.0, 16),
    Lever("mirrors.floor", -0.1, 16),
    Lever("mirrors.pads.thickness", -0.05, 16),
    Lever("mirrors.room.mount", -0.25, 4),
    Lever("mirrors.least_yield", -0.02, 16),
)
"""Those that are tried, as far as people may think of changing them."""

MIRRORS = "mirrors.phalanges"
"""The setting of what carries the mirrors, of which one more is tried."""

UNTRIED = "nothing; smaller changes were not tried"
"""What half of the smallest change that is tried misses if it meets everything, too."""


class Advice(NamedTuple):
    """A change that meets everything.

    Attributes:
        setting: its name.
        unit: its unit.
        now: its value in the settings.
        needed: the value that meets everything.
        half: the value half-way; if there is none, that of now.
        fails: what fails there.
    """

    setting: str
    unit: str
    now: Any
    needed: Any
    half: Any
    fails: str

    @property
    def words(self) -> str:
        """The change as part of a sentence."""
        unit = f" {self.unit}".rstrip().replace(" °", "°")
        return f"{self.setting} = {shown(self.needed)}{unit} instead of {shown(self.now)}{unit}"

    @property
    def row(self) -> dict[str, str]:
        """Of a table, its values as after ``--set``."""
        values = {name: shown(getattr(self, name)) for name in ("now", "needed", "half")}
        return self._asdict() | values


def advise(spec: FingerSpec, designer: Designer) -> list[Advice]:
    """For every lever that helps, its smallest change with which a run meets every requirement.

    A mirror more is tried on each phalanx besides the camera's, too.

    Args:
        spec: settings whose requirements are not all met.
        designer: what designs fingers; what it has designed for these settings is not done again.
    """
    units = {name: _unit(words) for name, _, words in fields(FingerSpec)}
    found = []
    for lever in LEVERS:
        if lever.kind not in (None, spec.linkage.kind):
            continue
        name = lever.setting
        if (now := value_of(spec, name)) in (None, []):
            continue  # as of the field of view of a lens that is sold, or of bare pads
        if (steps := _smallest(spec, lever, designer)) is not None:
            half, designed = changed(spec, lever, steps / 2), designer.with_own_linkages()
            fails = "; ".join(["refused"] if half is None else designed.missed(half)) or UNTRIED
            needed, middle = (_value(spec, lever, part) for part in (steps, steps / 2))
            found.append(Advice(name, units[name], now, needed, middle, fails))
    now = value_of(spec, MIRRORS)
    host = spec.mirrors.camera.phalanx
    phalanges = [one for one in ("distal", "proximal", "intermediate") if one != host]
    for needed in ([*now, phalanx] for phalanx in phalanges):
        other = with_value(spec, MIRRORS, needed)
        if other is not None and _met(other, designer):
            fails = "; ".join(designer.missed(spec))
            found.append(Advice(MIRRORS, "", now, needed, now, fails))
    return found


def _smallest(spec: FingerSpec, lever: Lever, designer: Designer) -> float | None:
    """Steps of the smallest change that meets everything; none if no change of it was found to."""
    most = lever.most
    while (greatest := changed(spec, lever, most)) is None:
        most -= 1  # to 0 at the most, where they are as they were
    forget_programs_if_many()
    if not designer.could_help(spec, greatest):
        return None

    def near(steps: int) -> bool:
        """Whether a design near the one that was found meets everything."""
        forget_programs_if_many()
        other = changed(spec, lever, steps)
        return other is not None and designer.meets_near(other, spec)

    def met(steps: float, designer: Designer = designer) -> bool:
        other = changed(spec, lever, steps)
        return other is not None and _met(other, designer)

    if near(most):
        low, high = 0, most
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if near(middle) else (middle, high)
        while not met(high):
            high += 1
            if high > most:
                return None
        steps = float(high)
    elif met(most):
        steps = float(most)
    else:
        return None
    while steps > LEAST and met(steps / 2):
        steps /= 2
    return steps if met(steps, designer.with_own_linkages()) else None


def _met(spec: FingerSpec, designer: Designer) -> bool:
    """Whether a run meets everything."""
    forget_programs_if_many()
    return not designer.missed(spec)


def changed(spec: FingerSpec, lever: Lever, steps: float) -> FingerSpec | None:
    """The settings with one changed by so many steps; none where they are refused."""
    return with_value(spec, lever.setting, _value(spec, lever, steps))


def _value(spec: FingerSpec, lever: Lever, steps: float) -> Any:
    """What a setting is after so many steps."""
    now, change = value_of(spec, lever.setting), steps * lever.step
    if isinstance(now, list):
        return [round(one * (1 + change), 9) for one in now]
    return round(now + change, 9)


def with_value(spec: FingerSpec, setting: str, value: Any) -> FingerSpec | None:
    """The settings with another value of one; none where they are refused."""
    tables = spec.model_dump()
    *path, last = setting.split(".")
    table = tables
    for name in path:
        table = table[name]
    table[last] = value
    try:
        return FingerSpec.model_validate(tables)
    except ValidationError:
        return None


def value_of(spec: FingerSpec, setting: str) -> Any:
    """The value of a setting by its name."""
    return functools.reduce(getattr, setting.split("."), spec)


def shown(value: Any) -> str:
    """A value as after ``--set``."""
    return json.dumps(value) if isinstance(value, list) else f"{value:.12g}"


def _unit(words: str) -> str:
    """The unit at the end of a setting's description; empty if it has none."""
    unit = words.rsplit("(", 1)[-1].split(")")[0] if words.endswith(")") else ""
    return {"degrees": "°"}.get(unit, unit)


def advice_rows(advice: Sequence[Advice]) -> Records:
    """The table of the changes, each with the value half-way and what fails there."""
    rows = Records()
    for one in advice:
        rows.add(**one.row)
    return rows
