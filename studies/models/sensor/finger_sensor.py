"""A finger as a sensor: its scene, the calibration-free models of its images, its errors."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from optics import Fabrication, Imaging, Scene
from optics.rendering import Effects, Imprint, Renderer, TactileImage
from perception import Lens, Sighting, View, ViewCatalog, detect_views, select_view, unwarp
from perception.places import find_places_in_air
from perception.proprioception import CornerModel
from perception.unwarping import PlacesOf
from studies.models.one_thread import one_thread
from studies.models.sensor.catalog import catalog_of
from studies.models.sensor.estimators import Predictor, corner_model, lens_of
from studies.models.sensor.imaged import designed
from studies.models.sensor.made import carried_by_camera, deviations_of, lens_fault, sample_finger
from studies.models.sensor.places import PlaceFinder
from studies.models.sensor.spec import LEAST_ROWS, MOST_ROWS, FingerImagesSpec

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
                sighting; NaN for one that is not known at all.
        """
        found = {(view.pad, view.path): view for view in sighting.complete()}
        if self.scene.layers is None and self.scene.camera.pupil_shift is None:
            sizes = {name: (self.catalog.lengths[name[0]], self.width) for name in found}
            return {
                name: find_places_in_air(view, self.lens, *sizes[name])
                for name, view in found.items()
            }
        given = np.nan_to_num(sighting.angles if angles is None else angles)
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
        return sample_finger(self.deviations, seed, number)


_predict_corners = eqx.filter_jit(Predictor.__call__)


def _fault(scene: Scene, imaging: Imaging) -> str:
    """What makes a scene none of a finger whose images can be analysed; empty if nothing."""
    if not scene.angle_names:
        return "it has no joint whose angle an image could tell"
    if fault := lens_fault(scene):
        return fault
    rows = imaging.shape[0]
    if not LEAST_ROWS <= rows <= MOST_ROWS:
        return f"its image is {rows} px high; between {LEAST_ROWS} and {MOST_ROWS} can be analysed"
    return ""
