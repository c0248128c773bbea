"""One design, closed on everything, and what is read off its closings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from studies.models.finger import Finger
from studies.models.grasp import cases
from studies.models.grasp.closing import Path, close_all, there_and_back
from studies.models.grasp.comparing import Comparison, compare
from studies.models.grasp.objects import Object
from studies.models.grasp.pinch import Bracket, Pinch, bracket, loading, predict, ratio_map
from studies.models.grasp.spec import GraspSpec
from studies.models.grasp.transfer import transfers

CLOSED = 80
"""Index of the state with the motor at its end."""


@dataclass(frozen=True)
class Analysis:
    """A design and all its closings.

    Attributes:
        finger: the design.
        free: closing on nothing.
        adaptive: on the circle of the reference value.
        loaded: the same against moments that pull the joints open.
        circles: on the circles of the settings.
        pinches: predictions, loadings and what they showed.
        box: on a square; ``None`` where it was not asked for.
        angles: of the stability map, rad.
        relative_pull: φ₂/φ₁ on their square, PIP in rows.
    """

    finger: Finger
    free: Path
    adaptive: Path
    loaded: Path
    circles: list[Path]
    pinches: list[tuple[Pinch, Path, Bracket]]
    box: Path | None
    angles: np.ndarray
    relative_pull: np.ndarray

    def paths(self) -> dict[str, Path]:
        """Every closing by a name for people."""
        named = {"free": self.free, "circle of the check": self.adaptive}
        named["the same, loaded"] = self.loaded
        for path in self.circles:
            named[f"circle {2 * radius_of(path):g} mm"] = path
        for pinch, path, _ in self.pinches:
            named[f"pinch at PIP {math.degrees(pinch.pip):.0f}°, k₂ {pinch.place:g} mm"] = path
        return named if self.box is None else named | {"square 24 mm": self.box}

    @property
    def unconverged(self) -> int:
        """States without an equilibrium, but for those after a pinch has given way."""
        lost = sum(int(np.sum(~path.ok)) for path in self.paths().values())
        return lost - sum(int(np.sum(~path.ok[shown.held :])) for _, path, shown in self.pinches)

    @cached_property
    def compared(self) -> dict[str, Comparison]:
        """Forces both ways, by the names of `paths`."""
        return {name: compare(path) for name, path in self.paths().items()}


def analyze(finger: Finger, spec: GraspSpec, *, polygon: bool = True) -> Analysis:
    """Close one finger on everything.

    Args:
        finger: its body, pins and spring.
        spec: motion and objects.
        polygon: whether to close on a square as well, a program of its own.
    """
    body, count = finger.body, 2 + len(spec.diameters)
    motion = there_and_back(math.radians(spec.motor_end_deg))
    check = cases.touching(body, *cases.check_touch(body))
    circles = [cases.circle_on_pad(body, d, spec.grip_at) for d in spec.diameters]
    predicted = predict(
        finger,
        [(math.radians(pip), place) for pip in spec.pinch_pip_deg for place in spec.pinch_at],
    )
    pinched = [
        cases.touching(body, one.pip, float(body.intermediate) + one.place, cases.PINCH_RADIUS)
        for one in predicted
    ]
    problems = [cases.problem_of(finger, thing) for thing in (check, check, *circles, *pinched)]
    problems[1] = cases.problem_of(finger, check, spec.opening_load)
    motions = [motion] * count + [loading(finger, pinch) for pinch in predicted]
    adaptive, loaded, *others = close_all(problems, np.array(motions))

    def close(thing: Object | None) -> Path:
        return close_all([cases.problem_of(finger, thing)], motion[None])[0]

    angles = np.linspace(0, math.radians(body.range_deg), 46)
    ratios = ratio_map(finger, angles)
    return Analysis(
        finger=finger,
        free=close(None),
        adaptive=adaptive,
        loaded=loaded,
        circles=others[: len(circles)],
        pinches=[
            (pinch, path, bracket(finger, pinch, path))
            for pinch, path in zip(predicted, others[len(circles) :], strict=True)
        ],
        box=close(cases.box(body)) if polygon else None,
        angles=angles,
        relative_pull=ratios[..., 1] / ratios[..., 0],
    )


def radius_of(path: Path) -> float:
    """Radius of the circle that a path closes on, mm."""
    return float(getattr(path.problem.thing, "radius", math.nan))


def straight_until(path: Path) -> float:
    """Largest PIP flexion up to which DIP rested on its stop in closing, rad."""
    closing = slice(0, CLOSED + 1)
    bent = ~path.ok[closing] | (path.joints[closing, 1] > 1e-7)
    stop = int(np.argmax(bent)) if bent.any() else CLOSED + 1
    return float(path.joints[:stop, 0].max()) if stop else math.nan


def touching_dip(path: Path) -> float:
    """DIP flexion when both pads first touch in closing, rad; NaN where they never do."""
    both = path.ok & (path.gaps[:, 0] < 1e-7) & (path.gaps[:, 1] < 1e-7)
    both[CLOSED + 1 :] = False
    return float(path.joints[int(np.argmax(both)), 1]) if both.any() else math.nan


def retrace_error(path: Path) -> float:
    """Largest difference of a joint between closing and opening at the same motor angle, rad."""
    there, back = path.joints[CLOSED::-2], path.joints[CLOSED:]
    ok = path.ok[CLOSED::-2] & path.ok[CLOSED:]
    return float(np.max(np.abs(there - back)[ok], initial=0.0))


def formula_error(path: Path) -> float:
    """Largest difference between the forces of a path and the two-phalanx formulas, relative.

    With both pads closed inside their ends and the joints off their stops, f₂ = (T_a φ₂ − t_s) / k₂
    and f₁ = (T_a φ₁ − f₂ (k₂ + l cos q₂)) / k₁ (Birglen & Gosselin 2004). NaN where a path has
    no such state.
    """
    if path.per_pad != 1 or np.any(path.problem.load):
        return math.nan
    finger, spring = path.problem.finger, path.problem.spring
    body = jax.tree.map(np.asarray, finger.body)
    limit, edge = np.asarray(path.problem.limit), np.stack(finger.body.gaps) + 1e-6
    inside = path.ok & np.all((path.joints > 1e-6) & (path.joints < limit - 1e-6), axis=1)
    inside &= np.all(path.gaps < 1e-7, axis=1) & np.all(path.along > edge, axis=1)
    inside &= path.along[:, 0] < body.intermediate - edge[1]
    inside &= path.along[:, 1] < body.distal - body.rim - 1e-6
    if not inside.any():
        return math.nan
    found = jax.tree.map(np.asarray, transfers(finger, jnp.asarray(path.joints)))
    moment = float(spring.stiffness) * (found.winding + float(spring.preload))
    reach = path.along[:, 1] + body.intermediate * np.cos(path.joints[:, 1])
    second = (path.motor * found.ratios[:, 1] - moment * found.slope) / path.along[:, 1]
    first = (path.motor * found.ratios[:, 0] - second * reach) / path.along[:, 0]
    error = np.abs(np.stack([first, second], axis=1) - path.forces)[inside]
    return float(np.max(error) / np.max(path.forces[inside]))


@dataclass(frozen=True)
class GraspCheck:
    """What a design does when it closes, for studies that look for designs.

    Attributes:
        pinches: how many were loaded as far as the formula says that they hold.
        free_closing_pip_deg: PIP flexion up to which free closing keeps DIP on its stop, degrees.
        adaptive_dip_deg: DIP when the distal pad touches the circle of the check, degrees; NaN
            where it never does.
        virtual_work_error: largest difference of forces by virtual work and by every link's
            balance, relative.
        formula_error: largest difference to the two-phalanx formulas, relative.
        pinch_violations: pinches whose limit is not where the formula puts it.
        states: equilibria that were solved.
        unconverged: states without an equilibrium, but for those after a pinch has given way; none
            enters the other numbers.
        worst_residual: largest residual of a state that does.
        retrace_error_deg: largest difference between closing and opening, degrees.
        least_f1_n: smallest force on the intermediate pad in the adaptive closing after both pads
            touch, N; NaN where they never do.
        ratio_low, ratio_high: range of φ₂/φ₁ over all postures.
    """

    pinches: int
    free_closing_pip_deg: float
    adaptive_dip_deg: float
    virtual_work_error: float
    formula_error: float
    pinch_violations: int
    states: int
    unconverged: int
    worst_residual: float
    retrace_error_deg: float
    least_f1_n: float
    ratio_low: float
    ratio_high: float


def summary(found: Analysis) -> GraspCheck:
    """The few numbers of an analysis."""
    paths = list(found.paths().values())
    there_and_back = [found.adaptive, found.loaded, *found.circles]
    ok = found.adaptive.ok & (found.adaptive.gaps < 1e-7).all(axis=1)
    errors = [formula_error(path) for path in (found.adaptive, *found.circles)]
    return GraspCheck(
        pinches=sum(shown.agrees is not None for _, _, shown in found.pinches),
        free_closing_pip_deg=math.degrees(straight_until(found.free)),
        adaptive_dip_deg=math.degrees(touching_dip(found.adaptive)),
        virtual_work_error=max(compared.error for compared in found.compared.values()),
        formula_error=max((e for e in errors if not math.isnan(e)), default=math.nan),
        pinch_violations=sum(shown.agrees is False for _, _, shown in found.pinches),
        states=sum(len(path.ok) for path in paths),
        unconverged=found.unconverged,
        worst_residual=max(float(path.residual[path.ok].max(initial=0.0)) for path in paths),
        retrace_error_deg=math.degrees(max(retrace_error(path) for path in there_and_back)),
        least_f1_n=float(found.adaptive.push(0)[ok].min()) if ok.any() else math.nan,
        ratio_low=float(np.nanmin(found.relative_pull)),
        ratio_high=float(np.nanmax(found.relative_pull)),
    )
