"""A scene as named numbers: camera and mirrors, what of the pads is seen, and how sharply."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.spec import SpecFile
from designopt.io.spec_files import validated
from designopt.io.toml_writing import format_toml
from designopt.numerics import safe_sqrt
from designopt.optimize.parametric import Measure, MeasureBound, Parameter, ParametricDesign, Values
from optics.parametric.scene_measures import (
    find_module_room,
    find_resolution,
    find_worst_blur,
    see,
    sharpness_of,
    signed_coverage,
)
from optics.scene.designed import DesignedScene
from optics.scene.fabrication import turned
from optics.scene.file import NARROW, SceneFile
from optics.scene.reading import refuse_faults
from optics.scene.scene import Layout, Scene, Surface
from optics.scene.writer import scene_tables
from optics.visibility.coverage import find_views
from optics.visibility.focus import find_blur

CAMERA_BODY = "camera body"
"""A blocker of this name in the camera's frame is the camera's own: it moves and turns with it."""

JOINT = (0.0, 90.0)
"""Range of a joint angle unless another is given, degrees."""

GRID = {0: (1, 1), 1: (9, 25), 2: (4, 10)}
"""How many angles of every joint a search and a judgement look at, by the number of joints."""

SCATTERED = (16, 64)
"""How many poses they look at if there are more joints: those of a Sobol sequence."""

TURN = 30.0
"""How far the camera is turned either way, degrees; not beyond the edge of what it sees."""

REACH = 0.09
"""How far places are moved either way, as a part of the larger side of the scene's surfaces."""

NARROWER, WIDER = 0.5, 1.5
"""Range of field of view and radii, as parts of themselves."""

SHORT = 10.0
"""Largest fields of view end so much before what a projection never reaches, degrees."""

FINE = 1e-4
"""A part of a pad that does not count where a search must see as much as the design."""


def scene_at(scene: Scene, numbers: Float[Array, " parameters"]) -> Scene:
    """A scene with other numbers; traced by JAX. See `CAMERA_BODY`.

    Args:
        scene: as designed.
        numbers: of `SceneParameters`, in their order and units.
    """
    camera, layout = scene.camera, scene.layout
    ends = len(numbers) - len(layout.curved)
    first = ends - scene.mirrors.size
    position, direction = numbers[:2], jnp.deg2rad(numbers[2])
    # A lens that is sold has the field of view that it has.
    field = jnp.deg2rad(numbers[3]) if first > 3 else camera.field_of_view
    own = np.array([_moves_with_camera(part, layout) for part in layout.blockers], bool)
    arms = turned(
        scene.blockers - camera.position[None, None],
        jnp.broadcast_to(direction - camera.direction, own.shape),
    )
    return eqx.tree_at(
        lambda scene: (
            scene.camera.position,
            scene.camera.direction,
            scene.camera.field_of_view,
            scene.mirrors,
            scene.radii,
            scene.blockers,
        ),
        scene,
        (
            position,
            direction,
            field,
            numbers[first:ends].reshape(scene.mirrors.shape),
            numbers[ends:],
            jnp.where(own[:, None, None], arms + position[None, None], scene.blockers),
        ),
    )


_arranged = jax.jit(scene_at)


def _moves_with_camera(part: Surface, layout: Layout) -> bool:
    return part.name == CAMERA_BODY and part.frame == layout.camera_frame


class SceneParameters(ParametricDesign):
    """Camera and mirrors of a scene of pads.

    Measures are over all poses in the joints' ranges: at few poses where they are differentiated,
    and at more of them where they are judged.

    Attributes:
        joints: the joint angles in the order of ``Scene.angle_names``; straight at first.
    """

    def __init__(
        self, design: DesignedScene, over: Mapping[str, tuple[float, float]] | None = None
    ) -> None:
        """Nothing is compiled yet.

        Args:
            design: the scene.
            over: ranges of joint angles, degrees; of those not named it is `JOINT`.

        Raises:
            UserError: there is no pad, or a range is of no joint or empty.
        """
        scene = design.scene
        if not scene.layout.pads:
            raise UserError(f"{design.name}: there is no pad to be seen; add one under [[pads]]")
        self.title, self._design = design.name, design
        self.joints = _joints(scene.angle_names, over or {})
        self.parameters = (*_of_camera(design), *_of_mirrors(design))
        self.free = tuple(
            parameter.name
            for parameter in self.parameters
            if parameter.name != "camera.field_of_view"
        )
        self._nominal = _nominal_resolution(scene)
        self._poses, self._more_poses = (_poses_of(self.joints, which) for which in (0, 1))
        self.measures = tuple(self._measures())

    @functools.cached_property
    def requirements(self) -> tuple[MeasureBound, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """As much is seen of every pad as now, blur is within its limit, the module is free.

        Of a pad that the design misses altogether in some posture nothing is asked.
        """
        names = [f"coverage.{part.name}" for part in self._design.scene.layout.pads]
        covered = self._judged(self.values(), tuple(names))
        least = {name: math.floor(covered[name] / FINE - 0.5) * FINE for name in names}
        if len({*least.values()}) == 1:
            least = {"coverage": least[names[0]]}
        bounds = [
            MeasureBound(name, ">=", value, f"{name.replace('.', ' of ')} as now, {value:.4g}")
            for name, value in least.items()
            if value > 0
        ]
        camera = self._design.scene.camera
        if camera.lens is not None and camera.max_blur is not None:
            limit = float(camera.max_blur)
            bounds.append(MeasureBound("blur", "<=", limit, f"blur up to max_blur_px, {limit:g}"))
        if camera.module is not None:
            bounds.append(MeasureBound("module_room", ">=", 0.0, "nothing in the camera's module"))
        return tuple(bounds)

    def evaluate(
        self, values: Float[Array, " parameters"], of: tuple[str, ...]
    ) -> dict[str, Float[Array, "..."]]:
        """As `ParametricDesign.evaluate`.

        Raises:
            UserError: the scene has curved mirrors.
        """
        layout = self._design.scene.layout
        if layout.curved:
            names = ", ".join(layout.mirrors[index].name for index in layout.curved)
            raise UserError(
                f"{self.title}: mirror {names}: a search looks into straight mirrors only; "
                "turn these numbers by hand, with designopt explore"
            )
        scene = scene_at(self._design.scene, values)
        poses = jnp.asarray(self._poses)
        seen = functools.cache(lambda: find_views(scene, poses))
        found: dict[str, Callable[[], Float[Array, "..."]]] = {
            "coverage": lambda: signed_coverage(seen()),
            "px_per_mm": lambda: find_resolution(scene, seen(), self._nominal),
            "blur": lambda: find_worst_blur(scene, seen().value),
            "module_room": lambda: find_module_room(scene, poses),
            "mirror_length": lambda: _lengths(scene),
        }
        arrays = {kind: found[kind]() for kind in {name.partition(".")[0] for name in of}}
        return {name: self._part(name, arrays) for name in of}

    def judge(self, values: Values) -> dict[str, float]:
        """As `ParametricDesign.judge`: exactly, and at more poses than a search looks at.

        The requirements are found with it, which compiles nothing more.
        """
        _ = self.requirements
        self.tables(values)
        return self._judged(values, tuple(measure.name for measure in self.measures))

    def files(self, values: Values) -> Sequence[SpecFile]:
        """The scene file."""
        title = "camera, mirrors and pads; `designopt trace` and `designopt explore` read it"
        text = format_toml(self.tables(values), f"{self.title}, with other numbers")
        return [SpecFile("scene.toml", title, text)]

    def scene(self, values: Values) -> Scene:
        """The scene with these values."""
        numbers = np.array([values[parameter.name] for parameter in self.parameters])
        return _arranged(self._design.scene, numbers)

    def tables(self, values: Values) -> dict[str, Any]:
        """The tables of the scene file with these values.

        Raises:
            UserError: these values describe no scene, and why.
        """
        return self.tables_of(self.scene(values))

    def tables_of(self, scene: Scene) -> dict[str, Any]:
        """As `tables`, of a scene of these parameters."""
        tables = scene_tables(scene)
        lens = self._design.file.camera.lens
        if lens is not None:
            # No value turns it, and of the scene its numbers would come back with rounding.
            tables["camera"]["lens"] = lens.model_dump(exclude_none=True)
        refuse_faults(validated(SceneFile, tables, self.title), self.title)
        return tables

    def _part(self, name: str, arrays: Mapping[str, Any]) -> Any:
        """An array of all pads, or what of it is of the pad that is named after a dot."""
        kind, _, pad = name.partition(".")
        names = [part.name for part in self._design.scene.layout.pads]
        return arrays[kind][:, names.index(pad)] if pad else arrays[kind]

    def _judged(self, values: Values, of: tuple[str, ...]) -> dict[str, float]:
        """Measures over the poses of a judgement."""
        scene, poses = self.scene(values), self._more_poses
        found, coverage, _, missed = see(scene, poses)
        hidden = np.where(coverage > 0, coverage, -missed)
        arrays: dict[str, np.ndarray] = {"coverage": hidden}
        kinds = {name.partition(".")[0] for name in of}
        if kinds & {"px_per_mm", "blur"}:
            sharp = sharpness_of(scene, poses, found.value)
            least = sharp.px_per_mm[..., 0]
            arrays["px_per_mm"] = np.where(coverage > 0, least, self._nominal * hidden)
            if "blur" in kinds:
                distances = jnp.asarray(sharp.object_distance)
                there = found.value.present[:, :, : distances.shape[2], None]
                blur = np.asarray(find_blur(scene.camera, jnp.where(there, distances, 1.0)))
                arrays["blur"] = np.max(blur, axis=(2, 3), where=there, initial=0.0)
        if "module_room" in kinds:
            arrays["module_room"] = np.asarray(find_module_room(scene, jnp.asarray(poses)))
        if "mirror_length" in kinds:
            arrays["mirror_length"] = np.asarray(_lengths(scene))
        worst = {measure.name: measure.worst for measure in self.measures}
        pick = {"least": np.min, "greatest": np.max}
        return {name: float(pick[worst[name]](self._part(name, arrays))) for name in of}

    def _measures(self) -> Iterator[Measure]:
        design = self._design
        layout, camera = design.scene.layout, design.scene.camera
        pads = [part.name for part in layout.pads]

        def over(names: Sequence[str]) -> Callable[[tuple[int, ...]], str]:
            def where(index: tuple[int, ...]) -> str:
                pose = self._pose(index[0])
                name = names[index[1]] if len(index) > 1 and names else ""
                return ", ".join(part for part in (name, pose) if part)

            return where

        kinds = [("coverage", "", "part of a pad that is seen", 1.0, 1.0)]
        sharp = "resolution of what is seen of a pad"
        kinds += [("px_per_mm", "px/mm", sharp, self._nominal, math.inf)]
        for kind, unit, what, scale, most in kinds:
            words: dict[str, Any] = {"scale": scale, "limits": (-math.inf, most)}
            several = over([f"pad '{name}'" for name in pads])
            yield Measure(kind, unit, f"least {what}", where=several, **words)
            for name in pads:
                what_of = what.replace("a pad", f"pad '{name}'")
                yield Measure(f"{kind}.{name}", unit, what_of, where=over(()), **words)
        if camera.lens is not None:
            what = "diameter of the largest blur spot on what is seen"
            where = over([f"pad '{name}'" for name in pads])
            yield Measure("blur", "px", what, "greatest", limits=(0.0, math.inf), where=where)
        if camera.module is not None:
            parts = [
                layout.title(i) for i in range(len(layout.mirrors + layout.pads + layout.blockers))
            ]
            what = "room between the camera's module and what is nearest to it"
            yield Measure("module_room", "mm", what, scale=_reach(design), where=over(parts))
        if layout.mirrors:
            mirrors = [f"mirror '{part.name}'" for part in layout.mirrors]
            yield Measure(
                "mirror_length",
                "mm",
                "length of the longest mirror",
                "greatest",
                scale=_reach(design),
                limits=(0.0, math.inf),
                where=lambda index: mirrors[index[0]],
            )

    def _pose(self, index: int) -> str:
        """One of the poses of a search in words."""
        angles = np.degrees(self._poses[index]).tolist()
        named = zip(self.joints, angles, strict=True)
        return ", ".join(f"{joint.name} {angle:.4g}°" for joint, angle in named)


def _joints(names: Sequence[str], over: Mapping[str, tuple[float, float]]) -> tuple[Parameter, ...]:
    for name, (low, high) in over.items():
        if name not in names:
            known = ", ".join(names) or "none"
            raise UserError(f"no joint angle is named {name}; there are: {known}")
        if not low < high:
            raise UserError(f"{name}: the range from {low:g}° to {high:g}° is empty")
    ranges = [(name, *over.get(name, JOINT)) for name in names]
    return tuple(
        Parameter(name, min(max(0.0, low), high), low, high, "°") for name, low, high in ranges
    )


def _poses_of(joints: Sequence[Parameter], which: int) -> Float[np.ndarray, "poses joints"]:
    """Poses that stand for the ranges of all joints, rad: few, or many."""
    ranges = [(math.radians(joint.low), math.radians(joint.high)) for joint in joints]
    if len(ranges) in GRID:
        count = GRID[len(ranges)][which]
        grid = list(itertools.product(*(np.linspace(low, high, count) for low, high in ranges)))
        return np.array(grid).reshape(len(grid), len(ranges))
    low, high = np.transpose(ranges)
    from scipy.stats import qmc  # takes a second, of which a page has no use

    scattered = qmc.Sobol(len(ranges), scramble=False).random(SCATTERED[which])
    return low + scattered * (high - low)


def _of_camera(design: DesignedScene) -> Iterator[Parameter]:
    file, reach = design.file.camera, _reach(design)
    for axis, value in zip("xy", file.position, strict=True):
        yield _around(f"camera.position.{axis}", value, reach, f"camera {axis}")
    projection, field = file.section_projection, file.section_fov_deg
    turn, straight = min(TURN, field / 2), file.direction_deg
    yield Parameter(
        "camera.direction", straight, straight - turn, straight + turn, "°", "camera direction"
    )
    if file.format is None:
        widest = NARROW[projection] - SHORT if projection in NARROW else 360.0
        high = max(min(WIDER * field, widest), field)
        yield Parameter("camera.field_of_view", field, NARROWER * field, high, "°", "field of view")


def _of_mirrors(design: DesignedScene) -> Iterator[Parameter]:
    reach, mirrors = _reach(design), design.file.mirrors
    for mirror in mirrors:
        for end, place in (("from", mirror.start), ("to", mirror.end)):
            for axis, value in zip("xy", place, strict=True):
                label = f"{mirror.name} mirror, {end} {axis}"
                yield _around(f"mirrors.{mirror.name}.{end}.{axis}", value, reach, label)
    for mirror in mirrors:
        if mirror.radius is not None:
            low, high = sorted((NARROWER * mirror.radius, WIDER * mirror.radius))
            label = f"{mirror.name} mirror, radius"
            yield Parameter(f"mirrors.{mirror.name}.radius", mirror.radius, low, high, "mm", label)


def _around(name: str, value: float, reach: float, label: str) -> Parameter:
    return Parameter(name, value, value - reach, value + reach, "mm", label)


def _reach(design: DesignedScene) -> float:
    """How far places are moved, mm: a round number."""
    scene = design.scene
    ends = np.concatenate([np.asarray(s) for s in (scene.mirrors, scene.pads, scene.blockers)])
    return float(f"{REACH * float(np.max(np.ptp(ends.reshape(-1, 2), axis=0))):.0e}")


def _nominal_resolution(scene: Scene) -> float:
    """At the middle of the pads, if the camera looked straight at it, px/mm."""
    away = np.mean(np.asarray(scene.pads), axis=(0, 1)) - np.asarray(scene.camera.position)
    return float(scene.camera.focal_pixels) / max(math.hypot(*away), 1e-9)


def _lengths(scene: Scene) -> Float[Array, " mirrors"]:
    """Of the mirrors, from end to end, mm."""
    step = scene.mirrors[:, 1] - scene.mirrors[:, 0]
    return safe_sqrt(jnp.sum(step * step, axis=-1))
