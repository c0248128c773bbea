"""A linkage as a MuJoCo model (MJCF), for whoever simulates or controls what was designed.

MuJoCo has trees of bodies, so the linkage is cut open (`mjcf_tree`) and its loops are closed by
constraints, which are a little soft. As written, MuJoCo's ``discrete`` integrator computes with
them in steps of 1 ms: it takes springs, motors and constraints implicitly. How far a constraint
yields grows with the forces over the masses in play. So that strong springs do not pull a small
linkage apart, hinges have inertias, blocks masses, and motors and loops the stiffness, that follow
from the springs where these ask for more than the rods: whatever its size and its springs, a
linkage comes to rest within 1e-4 of its size of where it should.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from xml.etree.ElementTree import Comment, Element, indent, tostring

from designopt.errors import UserError
from designopt.io.files import printable
from kinematics.export.mjcf_bodies import (
    DENSITY,
    MM,
    RADIUS,
    SLIDE,
    Bodies,
    Coordinates,
    Disc,
    Pad,
    PinholeCamera,
    Reading,
    Volume,
    add,
    inertia,
    numbers,
    rods,
    site_name,
)
from kinematics.export.mjcf_tree import Pair, cut_open
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD, InputPart

UNITS = """ m, kg, s, N, N m, rad; the linkage moves in the plane x-y, without weight.
     Controls are the values of the inputs, m or rad: start from the keyframe 'sketch', for with
     controls of 0 the motors leave the sketched pose at once.
     Masses are those of rods of aluminium; more, at joints and of blocks, where springs are strong.
     Pads touch what has conaffinity="1": give it to the geoms of objects that you add.
     For MuJoCo 4 or later. The constraints are meant for its integrator 'discrete', which earlier
     ones lack: with another one take RK4 and steps of 1e-4 s at most, or softer constraints. """

KEY = "sketch"
"""Keyframe of the assembled sketch, with the controls that hold it there."""

TIMESTEP = 1e-3
"""s."""

LOOPS = {"solref": "-1e8 -2e4", "solimp": "0.9999 0.9999 0.001 0.5 2"}
"""Softness of the pins that close loops: critically damped, 10⁸/s², at the highest impedance."""

TOUCH = {"solref": "0.001 2", "solimp": "0.9999 0.9999 0.001 0.5 2"}
"""Softness of stops and contacts: 2.5·10⁵/s², and damped so much that nothing rebounds."""

DAMPING, ARMATURE = 100.0, 0.01
"""Of every joint, in inertia scales per s and in inertia scales; of a slide per size²."""

BLOCK = 0.1
"""Mass of a block, in inertia scales per size². Of a lone one MuJoCo takes the mass alone, without
the armature, which sets how soft a pin in it is."""

LOAD = 1e4
"""All stiffnesses together are at most so large, in inertia scales per s²; otherwise the scale is
made larger."""

STIFF = 1e9
"""Stiffness of a motor for which none is given, in inertia scales per s²."""

LEAST = 1e-14
"""Lower bound of masses (kg) and inertias (kg m²): MuJoCo refuses bodies with less than 1e-15."""

SMALLEST = 0.01
"""Size of the smallest linkage, mm, that moves with such masses as it should."""


@dataclass(frozen=True)
class Stop:
    """What keeps the angle between two bodies within a range.

    Attributes:
        between: the bodies; the angle is that of the second relative to the first, rad, measured
            from the assembled sketch.
        low: the least angle.
        high: the greatest.
    """

    between: Pair
    low: float
    high: float


def linkage_mjcf(
    linkage: Linkage,
    *,
    motors: Mapping[str, float] | None = None,
    stops: Sequence[Stop] = (),
    pads: Sequence[Pad] = (),
    discs: Sequence[Disc] = (),
    volumes: Sequence[Volume] = (),
    cameras: Sequence[PinholeCamera] = (),
    angles: Mapping[str, Pair] | None = None,
) -> str:
    """The text of a MuJoCo model of a linkage, in SI units.

    Its initial pose is the assembled sketch. Bodies are rods of aluminium, hinged or sliding on
    each other; there is a site ``JOINT on BODY`` at every joint of every body, and two of them are
    connected where a loop was cut. Inputs are position actuators of the same name whose control is
    the input's value, rad or m. The linkage's springs are those of its joints, or of tendons where
    the two bodies are not joined: an angle is a sum of hinge angles, so these are exact.

    Args:
        linkage: one that is not batched.
        motors: which inputs are driven, and the stiffness of each: N mm/rad, or N/mm for a slide.
            By default all are, so stiffly that they reach the angles they are given.
        stops: further limits of angles.
        pads: faces of bodies; a site and a geom each.
        discs: objects for them to touch.
        volumes: what bodies take up. Those of bodies that share a joint do not touch each other;
            ``<contact>`` lists these pairs.
        cameras: on any bodies.
        angles: sensors by name: the angle of the second body relative to the first, rad, 0 in the
            assembled sketch. The motors have sensors, too, of their places and forces.

    Raises:
        UserError: a motor, stop, pad or volume names what is not there or cannot be, or the
            linkage is too small for MuJoCo.
    """
    _check(linkage, motors or {}, stops, pads, volumes)
    structure = linkage.structure
    hinged = [(part.body, part.relative_to) for part in structure.inputs if part.body is not None]
    hinged += [*structure.springs, *(stop.between for stop in stops)]
    tree = cut_open(linkage, hinged)
    coordinates = Coordinates.of(linkage, tree)
    parts = rods(linkage, coordinates)
    size = float(linkage.size()) * MM
    scale = max(inertia(linkage, parts), _load(linkage, motors or {}) / LOAD, 10 * LEAST)

    root = Element("mujoco", model=printable(structure.name))
    root.append(Comment(UNITS))
    _settings(root, scale, size)
    bodies = Bodies(linkage, coordinates, parts)
    bodies.write(add(root, "worldbody"), pads, discs, volumes, cameras)
    if volumes:
        contact = add(root, "contact")
        for first, second in _joined_bodies(linkage, [volume.body for volume in volumes]):
            add(contact, "exclude", body1=first, body2=second)
    forces = _Forces(bodies, coordinates, scale, size)
    for index, (spring, pair) in enumerate(zip(linkage.springs, structure.springs, strict=True)):
        reading = coordinates.angle(pair[1], pair[0])
        if reading.factors:  # between bodies that never turn against each other it does no work
            forces.spring(index, reading, float(spring.stiffness), float(spring.preload))
    for index, stop in enumerate(stops):
        reading = coordinates.angle(stop.between[1], stop.between[0])
        if reading.factors:
            forces.stop(index, reading, stop)
    driven = [part for part in structure.inputs if motors is None or part.name in motors]
    for part in driven:
        forces.motor(part, None if motors is None else motors[part.name])
    sensors = Element("sensor")
    for name, pair in (angles or {}).items():
        forces.angle(sensors, name, coordinates.angle(pair[1], pair[0]))
    for part in driven if angles else ():
        for kind in ("pos", "frc"):
            add(sensors, f"actuator{kind}", name=f"{part.name} {kind}", actuator=part.name)
    equality = Element("equality")
    for pin in tree.closures:
        sites = [site_name(pin.joint, body) for body in pin.bodies]
        name = f"{pin.joint} of {' and '.join(pin.bodies)}"
        add(equality, "connect", name=name, site1=sites[0], site2=sites[1])
    root.extend(
        [group for group in (forces.tendons, equality, forces.actuators, sensors) if len(group)]
    )
    if driven:
        values = [
            coordinates.inputs[part.name] * (MM if part.body is None else 1) for part in driven
        ]
        add(add(root, "keyframe"), "key", name=KEY, ctrl=numbers(*values))
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def _joined_bodies(linkage: Linkage, bodies: Sequence[str]) -> list[Pair]:
    """Pairs of some bodies that share a joint."""
    structure = linkage.structure
    on_joints = (
        [part.name for part in structure.bodies if joint in part.joints and part.name in bodies]
        for joint in structure.joints
    )
    return list(dict.fromkeys(pair for names in on_joints for pair in combinations(names, 2)))


def _load(linkage: Linkage, motors: Mapping[str, float]) -> float:
    """How strong springs and motors are together, N m/rad."""
    size = float(linkage.size())
    strengths = [
        float(spring.stiffness) * max(1.0, abs(float(spring.preload))) for spring in linkage.springs
    ]
    for part in linkage.structure.inputs:
        strengths.append(motors.get(part.name, 0.0) * (size**2 if part.body is None else 1.0))
    return sum(strengths) * MM


def _settings(root: Element, scale: float, size: float) -> None:
    add(root, "compiler", angle="radian", boundmass=LEAST, boundinertia=LEAST)
    add(root, "option", timestep=TIMESTEP, integrator="discrete", gravity="0 0 0")
    add(add(root, "visual"), "global", azimuth=90, elevation=-90)
    sky = {"type": "skybox", "builtin": "flat", "rgb1": "1 1 1", "rgb2": "1 1 1"}
    add(add(root, "asset"), "texture", **sky, width=16, height=96)
    default = add(root, "default")
    limits = {f"{key}limit": value for key, value in TOUCH.items()}
    add(default, "geom", contype=0, conaffinity=0, condim=1, density=DENSITY, **TOUCH)
    add(default, "site", size=RADIUS * size)
    add(default, "joint", damping=DAMPING * scale, armature=ARMATURE * scale, **limits)
    add(default, "tendon", **limits)
    add(default, "equality", **LOOPS)
    mass = scale / size**2
    slides = add(default, "default", **{"class": SLIDE})
    add(slides, "geom", mass=BLOCK * mass)
    add(slides, "joint", damping=DAMPING * mass, armature=ARMATURE * mass, **limits)


class _Forces:
    """Springs, stops and motors: at a joint, or at a tendon where several joints take part."""

    def __init__(self, bodies: Bodies, coordinates: Coordinates, scale: float, size: float) -> None:
        self.tendons, self.actuators = Element("tendon"), Element("actuator")
        self._joints, self._coordinates = bodies.joints, coordinates
        self._scale, self._size = scale, size

    def spring(self, index: int, reading: Reading, stiffness: float, preload: float) -> None:
        """A torsion spring, with its stiffness in N mm/rad."""
        rest = -preload - reading.constant
        joint = self._free(reading, "stiffness")
        if joint is not None:
            element, factor = joint
            element.set("stiffness", numbers(stiffness * MM))
            element.set("springref", numbers(factor * rest))
            return
        # A length of −1 at rest would have another meaning.
        sign = -1 if rest < 0 else 1
        name = f"spring {index}"
        self._tendon(name, reading, sign=sign, stiffness=stiffness * MM, springlength=sign * rest)

    def stop(self, index: int, reading: Reading, stop: Stop) -> None:
        """Limits of an angle."""
        ends = [stop.low - reading.constant, stop.high - reading.constant]
        joint = self._free(reading, "range")
        if joint is not None:
            element, factor = joint
            element.set("range", numbers(*sorted(factor * end for end in ends)))
            return
        self._tendon(f"stop {index}", reading, range=numbers(*ends))

    def motor(self, part: InputPart, stiffness: float | None) -> None:
        """A position actuator, with its stiffness in N mm/rad or N/mm."""
        reading = self._coordinates.input(part)
        slides = part.body is None
        scale = self._scale / self._size**2 if slides else self._scale
        unit = 1 / MM if slides else MM
        gain = STIFF * scale if stiffness is None else stiffness * unit
        damping = 2 * math.sqrt(gain * scale)
        if reading.single is not None:
            joint = self._joints[reading.single[0]].attrib["name"]
            add(self.actuators, "position", name=part.name, joint=joint, kp=gain, kv=damping)
            return
        self._tendon(part.name, reading)
        add(
            self.actuators,
            "general",
            name=part.name,
            tendon=part.name,
            gainprm=gain,
            biastype="affine",
            biasprm=numbers(-gain * reading.constant, -gain, -damping),
        )

    def angle(self, sensors: Element, name: str, reading: Reading) -> None:
        """A sensor of an angle, which a tendon without stiffness sums up."""
        self._tendon(name, reading)
        add(sensors, "tendonpos", name=name, tendon=name)

    def _free(self, reading: Reading, key: str) -> tuple[Element, int] | None:
        """The only joint that a reading reads, unless it has such an attribute already."""
        if reading.single is None or key in self._joints[reading.single[0]].attrib:
            return None
        return self._joints[reading.single[0]], reading.single[1]

    def _tendon(
        self, name: str, reading: Reading, *, sign: int = 1, **attributes: str | float
    ) -> None:
        tendon = add(self.tendons, "fixed", name=name, **attributes)
        for body, factor in reading.factors.items():
            joint = self._joints[body].attrib["name"]
            add(tendon, "joint", joint=joint, coef=sign * factor)


def _check(
    linkage: Linkage,
    motors: Mapping[str, float],
    stops: Sequence[Stop],
    pads: Sequence[Pad],
    volumes: Sequence[Volume],
) -> None:
    bodies = [part.name for part in linkage.structure.bodies]
    faults = [
        f"motors.{name}: no input has this name; there are: {', '.join(linkage.input_names)}"
        for name in motors
        if name not in linkage.input_names
    ]
    for index, stop in enumerate(stops):
        for body in stop.between:
            if body not in [WORLD, *bodies]:
                faults.append(f"stops.{index}: {_unknown(body, bodies)}")
        if not stop.low <= 0 <= stop.high or stop.low == stop.high:
            faults.append(
                f"stops.{index}: the range from {stop.low:g} to {stop.high:g} rad does not hold "
                "the assembled sketch, which is 0; widen it"
            )
    for index, pad in enumerate(pads):
        if pad.body not in bodies:
            faults.append(f"pads.{index}: {_unknown(pad.body, bodies)}")
        if math.dist(pad.start, pad.end) == 0:
            faults.append(f"pads.{index}: its two ends coincide; move one of them")
    for index, volume in enumerate(volumes):
        if volume.body not in bodies:
            faults.append(f"volumes.{index}: {_unknown(volume.body, bodies)}")
    if (size := float(linkage.size())) < SMALLEST:
        faults.append(
            f"joints: MuJoCo moves no linkage whose largest dimension is {size:.2g} mm; "
            f"make it {SMALLEST:g} mm or more"
        )
    if faults:
        raise UserError(f"{linkage.structure.name}: " + "; ".join(faults))


def _unknown(body: str, bodies: Sequence[str]) -> str:
    return f"no body is named '{body}'; there are: {', '.join(bodies)}"
