"""Everything the study computes before it says anything: one design, closed on everything."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from studies.models.finger import Finger
from studies.models.grasp import cases
from studies.models.grasp.closing import Path, close_all, there_and_back
from studies.models.grasp.comparing import Comparison, compare
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
        ratios: φ₁ and φ₂ on their square, PIP in rows.
        compared: forces both ways, by path, in `paths`' order.
    """

    finger: Finger
    free: Path
    adaptive: Path
    loaded: Path
    circles: list[Path]
    pinches: list[tuple[Pinch, Path, Bracket]]
    box: Path | None
    angles: np.ndarray
    ratios: np.ndarray
    compared: list[Comparison]

    def paths(self) -> dict[str, Path]:
        """Every closing by a name for people."""
        return _named(self.free, self.adaptive, self.loaded, self.circles, self.pinches, self.box)


def analyze(finger: Finger, spec: GraspSpec, *, polygon: bool = True) -> Analysis:
    """Close one finger on everything.

    Args:
        finger: its body, pins and spring.
        spec: motion and objects.
        polygon: whether to close on a square as well, a program of its own.
    """
    body = finger.body
    motion = there_and_back(math.radians(spec.motor_end_deg))
    check = cases.touching(body, *cases.check_touch(body))
    problems = [cases.problem_of(finger, check), cases.problem_of(finger, check, spec.opening_load)]
    problems += [
        cases.problem_of(finger, cases.circle_on_pad(body, d, spec.grip_at)) for d in spec.diameters
    ]
    predicted = predict(
        finger,
        [(math.radians(pip), place) for pip in spec.pinch_pip_deg for place in spec.pinch_at],
    )
    motions = [motion] * len(problems) + [loading(finger, pinch) for pinch in predicted]
    for pinch in predicted:
        place = float(body.intermediate) + pinch.place
        held = cases.touching(body, pinch.pip, place, cases.PINCH_RADIUS)
        problems.append(cases.problem_of(finger, held))
    paths = close_all(problems, np.array(motions))
    first, count = paths[: len(problems)], 2 + len(spec.diameters)
    pinches = [
        (pinch, path, bracket(finger, pinch, path))
        for pinch, path in zip(predicted, first[count:], strict=True)
    ]
    free = close_all([cases.problem_of(finger, None)], motion[None])[0]
    box = None
    if polygon:
        box = close_all([cases.problem_of(finger, cases.box(body))], motion[None])[0]
    angles = np.linspace(0, float(body.flexion), 46)
    everything = _named(free, first[0], first[1], first[2:count], pinches, box)
    return Analysis(
        finger=finger,
        free=free,
        adaptive=first[0],
        loaded=first[1],
        circles=first[2:count],
        pinches=pinches,
        box=box,
        angles=angles,
        ratios=ratio_map(finger, angles),
        compared=[compare(path) for path in everything.values()],
    )


def _named(
    free: Path,
    adaptive: Path,
    loaded: Path,
    circles: list[Path],
    pinches: list[tuple[Pinch, Path, Bracket]],
    box: Path | None,
) -> dict[str, Path]:
    named = {"free": free, "circle of the check": adaptive, "the same, loaded": loaded}
    for path in circles:
        named[f"circle {2 * radius_of(path):g} mm"] = path
    for pinch, path, _ in pinches:
        named[f"pinch at PIP {math.degrees(pinch.pip):.0f}°, k₂ {pinch.place:g} mm"] = path
    return named if box is None else named | {"square 24 mm": box}


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
    limit, edge = body.flexion, body.axis_height + 1e-6
    inside = path.ok & np.all((path.joints > 1e-6) & (path.joints < limit - 1e-6), axis=1)
    inside &= np.all(path.gaps < 1e-7, axis=1) & np.all(path.along > edge, axis=1)
    inside &= path.along[:, 0] < body.intermediate - edge
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
