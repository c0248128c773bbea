"""Where places of a finger's pads are imaged in the views of a frame, also behind layers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.interpolate
from jaxtyping import Float

from optics import Fabrication, Imaging, Scene, find_places_in_space
from perception import Lens, TangentPlane, View
from perception.unwarping import PlacesOf

NODES = 25
"""Places along a pad and across it that are computed; splines lie between."""

LIFT = 0.1
"""mm: the image of what is lifted is linear in its height; it is computed at this one."""

BEYOND = 0.5
"""mm: the nodes reach so far beyond a pad's edges."""

_find_places = eqx.filter_jit(find_places_in_space)


@dataclass(frozen=True)
class PlaceFinder:
    """Images of places by the finger as designed, moved so that they agree with a frame's corners.

    What a finger's errors of fabrication and its angles' errors do to a view is nearly a change of
    the camera's place, and so a homography of its rays; how layers bend these stays the same.

    Attributes:
        scene: as designed.
        imaging: its camera's image.
        lens: the camera's rays.
        views: mirrors along the path, and index of the pad, of every view.
        lengths: of these pads, mm.
        width: of the pads, mm.
    """

    scene: Scene
    imaging: Imaging
    lens: Lens
    views: tuple[tuple[tuple[int, ...], int], ...]
    lengths: Sequence[float]
    width: float

    def find(
        self,
        views: Sequence[View | None],
        corners: Float[np.ndarray, "views 4 2"],
        angles: Float[np.ndarray, " joints"],
    ) -> list[PlacesOf | None]:
        """Where places are imaged in the complete views of a frame.

        Args:
            views: what was found; ``None`` of those that are not complete.
            corners: where all views' corners are in the finger as designed.
            angles: joint angles, rad, to a degree or two.
        """
        flat = np.stack(
            [np.stack(np.meshgrid(*self._nodes(one), indexing="ij"), -1) for one in self.lengths]
        ).reshape(len(views), -1, 2)
        both = np.stack([np.insert(flat, 2, height, axis=-1) for height in (0.0, LIFT)], axis=1)
        none = Fabrication.none(self.scene.layout)
        given = jnp.asarray(angles), none, self.imaging, self.width, self.views
        places = jnp.asarray(both.reshape(len(flat), -1, 3))
        imaged = np.asarray(_find_places(self.scene, *given, places))
        imaged = imaged.reshape(len(flat), 2, NODES, NODES, 2)
        return [
            None if view is None else self._places_of(view, length, *rest)
            for view, length, *rest in zip(views, self.lengths, corners, imaged, strict=True)
        ]

    def _nodes(self, length: float) -> list[Float[np.ndarray, " nodes"]]:
        half = self.width / 2
        ends = (0, length), (-half, half)
        return [np.linspace(first - BEYOND, last + BEYOND, NODES) for first, last in ends]

    def _places_of(
        self,
        view: View,
        length: float,
        corners: Float[np.ndarray, "4 2"],
        imaged: Float[np.ndarray, "2 along across 2"],
    ) -> PlacesOf:
        plane = TangentPlane(float(view.rays[:, 0].min() + view.rays[:, 0].max()) / 2)

        def flat(places: Float[np.ndarray, "_ 2"]) -> Float[np.ndarray, "_ 2"]:
            angles, slopes = self.imaging.ray(jnp.asarray(places)).T
            return plane.flat(np.stack([angles, slopes], axis=-1))

        homography = cv2.getPerspectiveTransform(
            flat(corners).astype(np.float32), plane.flat(view.rays).astype(np.float32)
        )
        there = cv2.perspectiveTransform(flat(imaged.reshape(-1, 2))[None], homography)[0]
        there = there.reshape(imaged.shape)
        along, across = self._nodes(length)
        splines = [
            [scipy.interpolate.RectBivariateSpline(along, across, one[..., i]) for i in range(2)]
            for one in (there[0], (there[1] - there[0]) / LIFT)
        ]

        def places_of(points: Float[np.ndarray, "_ 3"]) -> Float[np.ndarray, "_ 2"]:
            at, rising = (
                np.stack([one.ev(points[:, 0], points[:, 1]) for one in pair], axis=-1)
                for pair in splines
            )
            return self.lens.project(plane.rays(at + points[:, 2:] * rising))

        return places_of
