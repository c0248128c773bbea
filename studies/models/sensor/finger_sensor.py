"""A finger as a sensor: its scene, the calibration-free models of its images, its errors."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.files import read_toml
from optics import (
    Equidistant,
    Fabrication,
    Imaging,
    KannalaBrandt,
    Scene,
    read_scene,
    scale_errors,
)
from optics.rendering import Effects, Imprint, Renderer, TactileImage
from optics.scene.sold import projection_entry
from perception import Lens, Sighting, View, ViewCatalog, detect_views, select_view, unwarp
from perception.places import find_places_in_air
from perception.proprioception import CornerModel
from perception.unwarping import PlacesOf
from studies.models.finger_file import bare_finger, read_finger
from studies.models.one_thread import one_thread
from studies.models.sensor.catalog import catalog_of
from studies.models.sensor.estimators import Predictor, corner_model, lens_of
from studies.models.sensor.places import PlaceFinder
from studies.models.sensor.spec import LEAST_ROWS, MOST_ROWS, FingerImagesSpec, MadeSpec

BODY = "camera body"
"""Name of the blocker that moves with the camera."""

CURE = "give the scene of a finger with --set scene=FILE"
"""What to do about a scene of which no images can be analysed."""


@dataclass(frozen=True)
class FingerSensor:
    """A finger as designed, and the models by which its images are analysed.

    Attributes:
        scene: as designed.
        imaging: its camera's image.
        lens: the camera's rays.
        catalog: the views it can show.
        model: what predicts corners from errors and joint angles.
        deviations: standard deviation of every error of fabrication.
        carried: blockers that move with the camera.
        width: of the pads, mm.
    """

    scene: Scene
    imaging: Imaging
    lens: Lens
    catalog: ViewCatalog
    model: CornerModel
    deviations: Fabrication
    carried: tuple[int, ...]
    width: float

    @classmethod
    def of(cls, spec: FingerImagesSpec, rows: int | None = None) -> FingerSensor:
        """The finger of a study, its image ``rows`` high.

        Raises:
            UserError: images of the scene cannot be analyzed.
        """
        scene = designed(spec.scene)
        if rows is not None:
            pixels = jnp.full_like(scene.camera.pixels, rows)
            scene = eqx.tree_at(lambda s: s.camera.pixels, scene, pixels)
        return cls.of_scene(scene, spec.width, deviations_of(spec.tolerances, scene))

    @classmethod
    def of_scene(cls, scene: Scene, width: float, deviations: Fabrication) -> FingerSensor:
        """The finger of a scene, its pads so wide (mm), made with errors of such deviations.

        Raises:
            UserError: images of the scene cannot be analyzed.
        """
        carried = carried_by_camera(scene)
        imaging = Imaging.of(scene.camera)
        if fault := _fault(scene, imaging):
            raise UserError(f"scene: {fault}; {CURE}")
        lens = lens_of(imaging)
        try:
            catalog = catalog_of(scene, imaging, lens, width, deviations, carried)
        except ValueError as error:
            raise UserError(f"scene: {error}; {CURE}") from error
        model = corner_model(scene, imaging, catalog, deviations, carried)
        return cls(scene, imaging, lens, catalog, model, deviations, carried, width)

    def with_response(self, gamma: float) -> FingerSensor:
        """The same with a camera whose codes are light^(1/gamma)."""
        codes = np.arange(256) / 255
        response = None if gamma == 1 else 255 * codes**gamma
        return replace(self, lens=replace(self.lens, response=response))

    def renderer(self, effects: Effects, errors: Fabrication | None, seed: int) -> Renderer:
        """A camera in front of a finger that was made with errors."""
        return Renderer(
            self.scene,
            self.width,
            effects,
            errors=errors,
            carried=self.carried,
            rows=self.imaging.shape[0],
            seed=seed,
        )

    @property
    def image_size(self) -> str:
        """Columns and rows of its image."""
        return "{1} × {0} px".format(*self.imaging.shape)

    def detect(self, pixels: object) -> Sighting:
        """The views in an image.

        Raises:
            UserError: it is no image of this finger's camera.
        """
        return detect_views(pixels, self.lens, self.catalog)

    def best_view(
        self, sighting: Sighting, pad: str, by: Literal["scale", "area"] = "scale"
    ) -> View | None:
        """The complete view that shows a pad best, by its least scale or by its area."""
        views = [view for view in sighting.views if view.pad == pad]
        return select_view(views, self.lens, self.catalog.lengths[pad], self.width, by=by)

    def unwarp(
        self, pixels: np.ndarray, view: View, places_of: PlacesOf | None = None
    ) -> np.ndarray:
        """The pad of a view, as seen from straight above; see `perception.unwarp`."""
        size = self.catalog.lengths[view.pad], self.width
        return unwarp(pixels, view, self.lens, *size, places_of)

    def find_places(
        self, sighting: Sighting, angles: Float[np.ndarray, " joints"] | None = None
    ) -> dict[tuple[str, str], PlacesOf]:
        """Where places of pads are imaged, by pad and path of every complete view.

        Args:
            sighting: what was found in a frame.
            angles: joint angles, rad, where they are known better than as the rough ones of the
                sighting.
        """
        found = {(view.pad, view.path): view for view in sighting.complete()}
        if self.scene.layers is None and self.scene.camera.pupil_shift is None:
            sizes = {name: (self.catalog.lengths[name[0]], self.width) for name in found}
            return {
                name: find_places_in_air(view, self.lens, *sizes[name])
                for name, view in found.items()
            }
        rough = np.where(np.isfinite(sighting.angles), sighting.angles, 0.0)
        given = rough if angles is None else angles
        corners = self._designed_corners(jnp.asarray(given))
        views = [found.get(name) for name in self.model.views]
        places = self._place_finder.find(views, np.asarray(corners), given)
        named = zip(self.model.views, places, strict=True)
        return {name: places_of for name, places_of in named if places_of is not None}

    @cached_property
    def _place_finder(self) -> PlaceFinder:
        lengths = [self.catalog.lengths[pad] for pad, _ in self.model.views]
        views = self._predictor.views
        return PlaceFinder(self.scene, self.imaging, self.lens, views, lengths, self.width)

    @cached_property
    def _predictor(self) -> Predictor:
        assert isinstance(self.model.predict, Predictor)
        return self.model.predict

    def _designed_corners(self, angles: Float[Array, " joints"]) -> Float[Array, "views 4 2"]:
        return _predict_corners(self._predictor, jnp.zeros(self.model.errors), angles)

    def film(
        self,
        renderer: Renderer,
        poses: Float[np.ndarray, "frames joints"],
        press: Callable[[int], Mapping[str, list[Imprint]]] = lambda _: {},
    ) -> Iterator[tuple[TactileImage, Sighting, float]]:
        """Frames, the views found in each, and the seconds of finding them on one core.

        Args:
            renderer: of this finger.
            poses: joint angles of the frames, rad.
            press: from a frame's number to what is pressed into its pads.
        """
        # What is compiled on the way is no part of a frame's time.
        self.detect(renderer.render(poses[0]).pixels)
        for frame, pose in enumerate(poses):
            image = renderer.render(pose, press(frame), frame=frame)
            with one_thread():
                start = time.perf_counter()
                sighting = self.detect(image.pixels)
                seconds = time.perf_counter() - start
            yield image, sighting, seconds

    def made_renderer(self, effects: Effects, seed: int, number: int = 0) -> Renderer:
        """A camera in front of one of many fingers with sampled errors."""
        return self.renderer(effects, self.made(seed, number)[0], seed + number)

    def made(self, seed: int, number: int) -> tuple[Fabrication, Float[np.ndarray, " errors"]]:
        """Normal errors of one of many fingers, and the same in units of their deviations."""
        generator = np.random.default_rng([seed, 4, number])
        errors = generator.standard_normal(self.model.errors)
        return scale_errors(self.deviations, jnp.asarray(errors)), errors


_predict_corners = eqx.filter_jit(Predictor.__call__)


def _fault(scene: Scene, imaging: Imaging) -> str:
    """What makes a scene none of a finger whose images can be analysed; empty if nothing."""
    if not scene.angle_names:
        return "it has no joint whose angle an image could tell"
    if not isinstance(scene.camera.projection, Equidistant | KannalaBrandt):
        name = projection_entry(scene.camera.projection)
        return f'its lens is {name}; errors of the lens need projection = "equidistant"'
    rows = imaging.shape[0]
    if not LEAST_ROWS <= rows <= MOST_ROWS:
        return f"its image is {rows} px high; between {LEAST_ROWS} and {MOST_ROWS} can be analysed"
    return ""


def designed(path: str) -> Scene:
    """The scene in a file of a scene or of a finger; that of the bare finger if none is named.

    Raises:
        UserError: the file describes neither.
    """
    if path and "finger" not in read_toml(path, "scene"):
        return read_scene(Path(path))
    return (read_finger(path) if path else bare_finger()).scene()


def carried_by_camera(scene: Scene) -> tuple[int, ...]:
    """Indices of the blockers that move with the camera: its body."""
    return tuple(i for i, part in enumerate(scene.layout.blockers) if part.name == BODY)


OUT_OF_SECTION = ("yaw", "roll", "mirror_lean", "mirror_bow", "pad_lean", "lateral_color")


def in_section(errors: Fabrication) -> Fabrication:
    """The same errors but for those that turn parts out of the section, or concern colors."""
    return replace(errors, **dict.fromkeys(OUT_OF_SECTION))


def deviations_of(tolerances: MadeSpec, scene: Scene) -> Fabrication:
    """Standard deviation of every error of fabrication that a scene can have."""
    mirrors, pads, layers = len(scene.mirrors), len(scene.pads), scene.layers
    moves = scene.camera.pupil_shift is not None
    of_layers = (0, 0) if layers is None else layers.thickness.shape

    def angles(degrees: float, count: int) -> Float[Array, " parts"]:
        return jnp.full(count, math.radians(degrees))

    return Fabrication(
        camera=jnp.full(2, tolerances.camera_position),
        lateral=tolerances.camera_position,
        tilt=math.radians(tolerances.camera_tilt_deg),
        mirror_tilt=angles(tolerances.mirror_tilt_deg, mirrors),
        mirror_offset=jnp.full(mirrors, tolerances.mirror_offset),
        pad_tilt=angles(tolerances.pad_tilt_deg, pads),
        pad_offset=jnp.full(pads, tolerances.pad_position),
        pad_shift=jnp.full(pads, tolerances.pad_position),
        distortion=tolerances.lens_k1,
        yaw=math.radians(tolerances.camera_yaw_deg),
        roll=math.radians(tolerances.camera_roll_deg),
        mirror_lean=angles(tolerances.mirror_lean_deg, mirrors),
        mirror_bow=jnp.full(mirrors, tolerances.mirror_bow),
        pad_lean=angles(tolerances.pad_lean_deg, pads),
        thickness=None if layers is None else jnp.full(of_layers, tolerances.layer_thickness),
        index=None if layers is None else jnp.full(of_layers, tolerances.layer_index),
        pupil=tolerances.pupil_shift if moves else None,
        lateral_color=jnp.full(2, tolerances.lateral_color),
    )
