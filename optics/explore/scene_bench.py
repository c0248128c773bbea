"""A scene with its knobs: rays by path, coverage and resolution, in real time."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from designopt.errors import UserError
from designopt.explore.bench import Bench, Knob, Reading, Shown, Step, Values
from designopt.io.spec import SpecFile
from optics.explore.scene_knobs import JOINT, MOST, ParameterMap
from optics.explore.scene_optimising import Improver
from optics.explore.scene_picture import ScenePicture
from optics.explore.scene_seeing import Seen, coverage_over, look_at
from optics.plot.section import Section
from optics.scene.designed import DesignedScene

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure

PLACES = 61
"""Places over a knob's range at which coverage is computed."""

POSED = 4
"""Angles of every joint for which the picture has room from the beginning."""

AIM = (
    "move camera and mirrors, so that all of every pad is seen over the joints' range, and what "
    "is seen least sharply is seen sharper"
)


class SceneBench(Bench):
    """A scene of pads, with joint angles, camera and mirrors as knobs."""

    def __init__(
        self,
        design: DesignedScene,
        *,
        joint: tuple[float, float] = JOINT,
        most: int = MOST,
        floor: float | None = None,
        straight_deg: float | None = None,
    ) -> None:
        """Make the knobs.

        Args:
            design: the scene.
            joint: range of every joint angle, degrees.
            most: most knobs of dimensions.
            floor: resolution that is asked for, px/mm, if any is.
            straight_deg: direction of a camera that is not tilted, counter-clockwise from +x; the
                one in the scene's file by default.

        Raises:
            UserError: there is no pad.
        """
        if not design.scene.layout.pads:
            raise UserError(f"{design.name}: there is no pad to be seen; add one under [[pads]]")
        self._handles = ParameterMap.of(design, joint, most, straight_deg)
        self._design, self._floor = design, floor
        self._bent = bool(design.scene.layout.curved)
        self._before: dict[str, float] = {}
        self._curve_of: tuple[object, ...] = ()
        self.title = design.name
        self.knobs: tuple[Knob, ...] = self._handles.knobs
        self.aim = "" if self._bent else AIM
        self._swept = self.knobs[0]

    def draw(self, area: SubFigure) -> None:
        """The section above; below it coverage, resolution, and coverage over the last knob."""
        scene = self._design.scene
        posed = product(*(np.linspace(knob.low, knob.high, POSED) for knob in self._handles.joints))
        places = [Section.of(scene, np.radians(np.array(pose, float))).places() for pose in posed]
        self._picture = ScenePicture(
            area, scene, np.vstack(places), floor=self._floor, curves=not self._bent
        )

    def show(self, values: Values) -> Shown:
        """Rays by path, pads by coverage, and the numbers."""
        handles = self._handles
        try:
            handles.tables(values)
        except UserError as error:
            self._picture.fit()
            return Shown(self._readings(values, None), self._picture.artists, str(error))
        angles = handles.angles(values)
        scene = handles.scene(values)
        seen = look_at(scene, angles)
        self._picture.show(scene, angles, seen)
        self._notice(values)
        if not self._bent:
            self._sweep(values)
        return Shown(self._readings(values, seen), self._picture.artists, _message(seen))

    def specs(self, values: Values) -> Sequence[SpecFile]:
        """The scene file."""
        title = "camera, mirrors and pads; `designopt trace` and `designopt explore` read it"
        return [SpecFile("scene.toml", title, self._handles.text(values))]

    def optimise(self, values: Values) -> Iterator[Step]:
        """See `Improver`."""
        return self._improver.steps(values)

    @functools.cached_property
    def _improver(self) -> Improver:
        return Improver(self._handles)

    def _notice(self, values: Values) -> None:
        """Which knob was moved last, if it was one alone."""
        turned = [k for k in self.knobs if values[k.name] != self._before.get(k.name, k.value)]
        if len(turned) == 1:
            self._swept = turned[0]
        self._before = {knob.name: values[knob.name] for knob in self.knobs}

    def _sweep(self, values: Values) -> None:
        """Coverage over the range of the knob moved last; it changes with all others only."""
        knob = self._swept
        rest = (knob.name, *(values[k.name] for k in self.knobs if k.name != knob.name))
        if rest != self._curve_of:
            turned = np.linspace(knob.low, knob.high, PLACES).tolist()
            states = [{**values, knob.name: value} for value in turned]
            angles = np.stack([self._handles.angles(state) for state in states])
            scene, many = self._design.scene, self._handles.many(states)
            self._coverage: Float[np.ndarray, "places pads"] = coverage_over(scene, many, angles)
            self._curve_of = rest
        self._picture.show_curves(knob, values[knob.name], self._coverage)

    def _readings(self, values: Values, seen: Seen | None) -> list[Reading]:
        direction = float(np.degrees(self._handles.dimensions(values).direction))
        readings = [
            Reading("camera tilt", values["camera tilt"], "°"),
            Reading("camera direction", direction, "°"),
        ]
        for index, part in enumerate(self._design.scene.layout.pads):
            numbers: list[float | None] = [None] * 4
            if seen is not None:
                least, median, _ = seen.px_per_mm[index].tolist()
                missed = float(np.degrees(seen.missed_by[index]))
                numbers = [
                    100 * float(seen.coverage[index]),
                    least or None,
                    median or None,
                    missed if np.isfinite(missed) else None,
                ]
            words = ("coverage", "least resolution", "median resolution", "missed by")
            units = ("%", "px/mm", "px/mm", "°")
            for word, number, unit in zip(words, numbers, units, strict=True):
                readings.append(Reading(f"{part.name}: {word}", number, unit))
        return readings


def _message(seen: Seen) -> str:
    if not seen.remarks:
        return ""
    (what, why), *others = seen.remarks
    return "; ".join([what, why, *(more for more, _ in others)])
