"""A finger that a person turns: its linkage beside what its camera sees, in one pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from designopt.explore.explorer import (
    Chart,
    Explorer,
    ExplorerState,
    Handle,
    Numbers,
    Readout,
    Series,
    View,
    inside_ranges,
)
from designopt.export.drawing import Place
from designopt.optimize.parametric import Parameter, Values
from designopt.programs import Program
from designopt.vectors import fold_angle
from kinematics.export.drawing import draw_linkage, sketched_scene
from kinematics.model.linkage import Linkage
from kinematics.plot.scene import Scene as LinkageScene
from kinematics.solve.poses import solve_poses
from optics.explore.scene import (
    AXIS,
    ENDS,
    Picture,
    look_at,
    pad_notes,
    picture_of,
    scene_view,
    seen_readouts,
    unbent,
)
from optics.plot.section import Section, place_parts
from optics.scene.scene import Scene
from optics.visibility.coverage import find_coverage
from studies.models.finger import Finger
from studies.models.finger_parametric.design import FingerParametric
from studies.models.finger_parts import PHALANGES
from studies.models.linkage_design.coupling.problem import TRANSMISSION
from studies.models.linkage_design.problem import SYMBOLS
from studies.models.linkage_design.transmission import finger_transmission
from studies.models.linkage_kinds import LinkageKind
from studies.models.pins import pin_name

LINKAGE, SEEN = "linkage", "what the camera sees"
"""Names of the views."""

ANGLES, COVERAGE = "transmission angles", "coverage"
"""Names of the charts."""

PLACES = 19
"""Angles of a joint for which a chart has values: 5° apart over 90°."""

PIN = "pin "
"""What the handle of a pin begins with."""

ORIGINS = {"E": "F", "D": "C", pin_name("H"): "C", "C": "B", "G": "A", "Q": "B"}
"""The pin or axis of its body about which each pin has turned from the straight finger; K is on the
crank."""

Rows = Float[Array | np.ndarray, "poses 2"]
"""Flexion of both joints, rad."""

ParameterValues = Float[np.ndarray, " parameters"]
"""Numbers of a finger, in the order and the units of its parameters."""


class Swept(NamedTuple):
    """A linkage in the pose that is shown, and then over the range of one joint.

    Attributes:
        linkage: itself.
        size: its largest dimension, mm.
        ok: whether it can be assembled.
        margin: from lock-up, mm.
        joints: their places by their names, mm.
        turns: angles of the bodies, rad.
        slides: of its sliders, mm.
        angles: transmission angles by their symbols, rad.
        dip: flexion of DIP, rad.
    """

    linkage: Linkage
    size: Float[Array, ""]
    ok: Bool[Array, " poses"]
    margin: Float[Array, " poses"]
    joints: dict[str, Float[Array, "poses 2"]]
    turns: dict[str, Float[Array, " poses"]]
    slides: dict[int, Float[Array, " poses"]]
    angles: dict[str, Float[Array, " poses"]]
    dip: Float[Array, " poses"]


class Posture(NamedTuple):
    """A finger as it is shown, its linkage also over the range of one joint.

    Attributes:
        rows: flexion as shown, and then over that range.
        swept: the linkage, if there is one.
        seen: camera, mirrors and pads, if there is a camera, and what is drawn of them.
    """

    rows: Rows
    swept: Swept | None
    seen: tuple[Scene, Picture] | None


class FingerExplorer(Explorer):
    """Linkage, camera and mirrors of one finger, turned by its joints; flexion is positive.

    A coupled finger has no DIP of its own.
    """

    def __init__(self, design: FingerParametric) -> None:
        """Nothing is compiled yet.

        Args:
            design: a finger with pins, a camera or both.
        """
        self.design = design  # pyright: ignore[reportIncompatibleVariableOverride]
        self._designed = finger = design.designed
        ends = dict(zip(("pip", "dip"), finger.body.ranges_deg, strict=True))
        self._coupled = finger.pins is not None and finger.kind.freedoms == 1
        if self._coupled:
            del ends["dip"]
        self.joints = tuple(Parameter(name, 0.0, 0.0, end, "°") for name, end in ends.items())
        self.presets = {
            name: {joint: part * end for joint, end in ends.items()}
            for name, part in (("straight", 0.0), ("half closed", 0.5), ("closed", 1.0))
        }
        self._last, self._column = tuple(0.0 for _ in ends), 0
        self._shown: list[tuple[Values, Posture]] = []
        self._curve_of: list[bytes] = []
        self._curve = np.full((PLACES, len(PHALANGES)), np.nan)
        self._straight = Program(lambda numbers: self._sketched(design.traced(numbers)))
        self._bent = Program(lambda numbers, rows: self._posture(design.traced(numbers), rows))
        self._cover = Program(_coverage)

    def sketch(self) -> Sequence[View]:
        """See `Explorer`."""
        linkage, scene, picture = self._straight(self._numbers(self.values()))
        views = [] if linkage is None else [self._linkage_view(sketched_scene(linkage))]
        if scene is not None:
            views.append(scene_view(SEEN, self.design.title, scene, picture, _part_parameters))
        return views

    def show(self, values: Values) -> ExplorerState:
        """See `Explorer`; the joint that was moved last is the abscissa of the charts."""
        degrees = tuple(values[joint.name] for joint in self.joints)
        moved = [i for i, now in enumerate(degrees) if now != self._last[i]]
        self._column, self._last = (moved[0] if moved else self._column), degrees
        rows = np.tile(np.radians(degrees), (PLACES + 1, 1))
        turned = replace(self.joints[self._column], value=degrees[self._column])
        rows[1:, self._column] = np.linspace(0.0, np.radians(turned.high), PLACES)
        posture = self._bent(self._numbers(values), rows)
        # Two: what drags a handle may still begin from the one before.
        self._shown = [*self._shown[-1:], (dict(values), posture)]
        _, swept, seen = posture
        views = [] if swept is None else [self._linkage_view(_now(swept))]
        if seen is not None:
            scene, picture = seen
            views.append(scene_view(SEEN, self.design.title, scene, picture, _part_parameters))
        return ExplorerState(views, lambda: self._beside(turned, posture))

    def _beside(self, turned: Parameter, posture: Posture) -> Numbers:
        """What is shown beside the drawings.

        Args:
            turned: the joint over whose range charts are, as shown.
            posture: what is drawn.
        """
        rows, swept, pictured = posture
        pip, dip = np.degrees(rows[0]).tolist()
        readouts = [Readout("pip", pip, "°"), Readout("dip", dip, "°")]
        charts, messages, notes = [], [], {}

        def chart(title: str, label: str, curves: Mapping[str, np.ndarray], top: float) -> Chart:
            places = np.linspace(0.0, turned.high, PLACES).tolist()
            series = [Series(one, places, values.tolist()) for one, values in curves.items()]
            return Chart(title, f"{turned.name} (°)", label, series, turned.value, (0.0, top))

        if swept is not None:
            readouts += _linkage_readouts(swept)
            curves = {
                name: np.where(swept.ok, np.degrees(each), np.nan)[1:]
                for name, each in swept.angles.items()
            }
            charts.append(chart(ANGLES, "transmission angle (°)", curves, 90.0))
            if not swept.ok[0]:
                messages.append(
                    f"the linkage cannot be assembled at PIP {pip:.3g}°, DIP {dip:.3g}°: bend it "
                    "less, or take back what was changed last"
                )
        if pictured is not None:
            scene, picture = pictured
            seen = look_at(scene, rows[0], picture)
            notes[SEEN] = pad_notes(scene, seen)
            readouts += seen_readouts(scene.layout, seen)
            curve = self._coverage_over(scene, rows[1:])
            curves = {str(pad): 100 * curve[:, i] for i, pad in enumerate(PHALANGES)}
            charts.append(chart(COVERAGE, "coverage (%)", curves, 100.0))
            messages += [part for pair in seen.remarks[:1] for part in pair]
        return Numbers(readouts, charts, "; ".join(messages), notes)

    def drag(self, values: Values, handle: str, place: Place) -> dict[str, float]:
        """See `Explorer`; what carries the part stays in its pose."""
        if not any(shown == values for shown, _ in self._shown):
            self.show(values)
        at, posture = complex(*place), next(one for shown, one in self._shown if shown == values)
        if handle.startswith(PIN):
            pin = handle.removeprefix(PIN)
            assert posture.swept is not None  # as there are pins
            moved = _straightened(self._designed.kind, posture.swept, pin, at)
            found = dict(zip(_pin_parameters(pin), (moved.real, moved.imag), strict=True))
        else:
            found = self._moved_part(values, posture, handle, at)
        return {**values, **inside_ranges(self.design.parameters, found)}

    def _numbers(self, values: Values) -> ParameterValues:
        return np.array([values[one.name] for one in self.design.parameters], float)

    def _made(self, finger: Finger) -> tuple[Linkage | None, Scene | None]:
        """The linkage and the scene, as far as there are any."""
        linkage = None if self._designed.pins is None else finger.linkage()
        return linkage, None if self._designed.camera is None else finger.scene()

    def _sketched(self, finger: Finger) -> tuple[Linkage | None, Scene | None, Picture | None]:
        """What there is, and where it is in the straight finger."""
        linkage, scene = self._made(finger)
        straight = None if scene is None else Picture(place_parts(scene, jnp.zeros(2)))
        return linkage, scene, straight

    def _posture(self, finger: Finger, rows: Float[Array, "poses joints"]) -> Posture:
        """All that a picture needs; one program, because a move waits for it.

        Args:
            finger: straight.
            rows: flexion of its joints, rad: as shown, and then over the range of one of them.
        """
        linkage, scene = self._made(finger)
        swept = None if linkage is None else _swept(finger, linkage, rows)
        if self._coupled:
            assert swept is not None  # as it has pins
            dip = jnp.where(swept.ok, swept.dip, 0.0)
            rows = jnp.stack([rows[:, 0], dip], axis=1)
        seen = None if scene is None else (scene, picture_of(scene, rows[0]))
        return Posture(rows, swept, seen)

    def _coverage_over(self, scene: Scene, rows: Rows) -> Float[np.ndarray, "poses pads"]:
        """Coverage in postures; that of the same ones is kept, for when a joint is turned."""
        rest = [np.asarray(one).tobytes() for one in (rows, *jax.tree.leaves(scene))]
        if rest != self._curve_of:
            curve = self._cover.when_compiled(scene, rows)
            self._curve = np.full((PLACES, len(PHALANGES)), np.nan)
            if curve is not None:
                self._curve, self._curve_of = curve, rest
        return self._curve

    def _linkage_view(self, scene: LinkageScene) -> View:
        drawing = draw_linkage(scene, title=self.design.title)
        pins, handles, notes = self._designed.pins, [], {}
        assert pins is not None  # of a linkage
        for pin in pins.names:
            joint = pin_name(pin)
            x, y = (float(one) for one in scene.joints[joint])
            handles.append(Handle(f"{PIN}{joint}", (x, y), _pin_parameters(joint)))
            notes[joint] = f"at ({x:.4g}, {y:.4g}) mm"
        return View(LINKAGE, drawing, handles, notes)

    def _moved_part(
        self, values: Values, posture: Posture, handle: str, at: complex
    ) -> dict[str, float]:
        """Coordinates of camera or mirror end in its phalanx, or the tilt, after a drag."""
        finger, names = self._designed, _part_parameters(handle)
        assert finger.camera is not None  # of an optical handle
        assert posture.seen is not None  # likewise
        scene, picture = posture.seen
        section = Section.made_of(scene, picture.parts)
        straight = unbent(scene, section, posture.rows[0], handle, at)
        mirrors = dict(zip(finger.mirror_names, finger.mirrors, strict=True))
        host = mirrors.get(handle.rpartition(ENDS)[0], finger.camera).phalanx
        along = straight.real - (values["body.intermediate"] if host == "distal" else 0.0)
        depth = values["body.thickness"] - values["body.axis_height"] - straight.imag
        if handle != AXIS:
            return dict(zip(names, (along, depth), strict=True))
        across = along - values["camera.along"], depth - values["camera.depth"]
        return {names[0]: float(np.degrees(np.arctan2(*across)))}


def _coverage(scene: Scene, rows: Float[Array, "poses 2"]) -> Float[Array, "poses pads"]:
    # One posture after the other: all together would leave the cache.
    return jax.lax.map(lambda row: find_coverage(scene, row).value, rows)


def _swept(finger: Finger, linkage: Linkage, flexion: Float[Array, "poses joints"]) -> Swept:
    poses = solve_poses(linkage, -flexion)
    pose, structure = poses.value, linkage.structure
    at, bodies = pose.joints, pose.bodies
    if finger.kind.freedoms > 1:
        angles = finger_transmission(pose)
        named = {SYMBOLS[name]: one for name, one in angles.items()}
    else:
        named = {TRANSMISSION: fold_angle(at["Q"] - at["B"], at["P"] - at["Q"])}
    dip = -bodies["distal"].turned(bodies["intermediate"].conjugate()).angle()
    return Swept(
        linkage,
        linkage.size(),
        poses.ok,
        poses.margin,
        {name: at[name].stacked() for name in structure.joints},
        {part.name: bodies[part.name].angle() for part in structure.bodies},
        {index: pose.slides[index] for index in range(len(structure.sliders))},
        named,
        dip,
    )


def _now(swept: Swept) -> LinkageScene:
    """The pose that is shown; the straight finger where there is none."""
    linkage = swept.linkage
    if not swept.ok[0]:
        return sketched_scene(linkage)
    return LinkageScene.at(
        linkage.structure,
        float(swept.size),
        {name: np.asarray(places[0]) for name, places in swept.joints.items()},
        {name: float(turns[0]) for name, turns in swept.turns.items()},
        [
            (float(line.angle), float(swept.slides[index][0]))
            for index, line in enumerate(linkage.lines)
        ],
    )


def _linkage_readouts(swept: Swept) -> list[Readout]:
    ok = bool(swept.ok[0])
    found = {f"{name}": (np.degrees(each[0]), "°") for name, each in swept.angles.items()}
    found["from lock-up"] = (np.asarray(swept.margin[0]), "mm")
    return [Readout(name, float(one) if ok else None, unit) for name, (one, unit) in found.items()]


def _straightened(kind: LinkageKind, swept: Swept, pin: str, at: complex) -> complex:
    """Where a pin that is at a place would be in the straight finger, its body as it is turned."""
    origin = ORIGINS.get(pin) if pin != "K" else kind.shaft
    if origin is None:
        return at  # on the proximal phalanx, which does not move
    (axis, arm), (first, before) = (
        [complex(*map(float, scene.joints[name])) for name in (origin, pin)]
        for scene in (_now(swept), sketched_scene(swept.linkage))
    )
    turn = (arm - axis) / (before - first) if before != first else 1.0
    return first + (at - axis) / turn * abs(turn)


def _pin_parameters(pin: str) -> tuple[str, ...]:
    return f"pins.{pin}.x", f"pins.{pin}.y"


def _part_parameters(handle: str) -> tuple[str, ...]:
    """Of the camera, of its axis, or of an end of a mirror."""
    if handle == AXIS:
        return ("camera.tilt",)
    name, _, end = handle.rpartition(ENDS)
    stem = f"mirrors.{name}.{end}" if name else "camera"
    return f"{stem}.along", f"{stem}.depth"
