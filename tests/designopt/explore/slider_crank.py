"""A design small enough to know by heart: a slider-crank, in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp

from designopt.errors import UserError
from designopt.explore.explorer import (
    Chart,
    Explorer,
    ExplorerState,
    Handle,
    Numbers,
    Readout,
    Series,
    View,
)
from designopt.export.drawing import Circle, Drawing, Label, Layer, Place, Polyline
from designopt.io.spec import SpecFile
from designopt.optimize.parametric import Measure, MeasureBound, Parameter, ParametricDesign, Values

MARKUP = "<img src=x onerror=alert(1)>&amp;"
LOCKED = "The rod is too short for this pose; lengthen it."
BEST = 80.0
"""The radius with the longest stroke that the transmission angle allows is this or less, mm."""


def place(values: Values) -> float | None:
    """Where the slider stands, mm."""
    angle = math.radians(values["crank"])
    height = values["radius"] * math.sin(angle) - values["offset"]
    square = values["rod"] ** 2 - height**2
    return values["radius"] * math.cos(angle) + math.sqrt(square) if square >= 0 else None


def draw(values: Values, name: str, turns: int = 1) -> Drawing:
    """The slider-crank, with its path and an arc of its rim."""
    angle, radius = math.radians(values["crank"]), values["radius"]
    tip = (radius * math.cos(angle), radius * math.sin(angle))
    x = place(values)
    end = tip if x is None else (x, values["offset"])
    rim = Polyline("rim", [(radius, 0.0), (-radius, 0.0)], closed=True, bulges=(1.0, 1.0))
    return Drawing(
        title=name,
        layers=[
            Layer("rim", "construction"),
            Layer("crank", "body"),
            Layer("rod", "body"),
            Layer(name, "pad"),
        ],
        polylines=[
            rim,
            *[Polyline("crank", [(0.0, 0.0), tip])] * turns,
            Polyline("rod", [tip, end], name="coupler"),
            Polyline(
                name,
                [(end[0] - 8, end[1] - 5), (end[0] + 8, end[1] - 5), (end[0] + 8, end[1] + 5)],
                closed=True,
            ),
        ],
        circles=[Circle("crank", "pin μ₁", tip, 2.0), Circle("rod", "pin S", end, 2.0)],
        labels=[Label("crank", tip, "μ₁"), Label(name, end, name)],
    )


@dataclass
class SliderCrankDesign(ParametricDesign):
    title: str = "slider-crank"
    parameters: tuple[Parameter, ...] = (
        Parameter("radius", 31.37, 10.0, 80.0),
        Parameter("rod", 70.0, 20.0, 120.0, label="rod length"),
        Parameter("offset", 0.0, -20.0, 20.0),
    )
    measures: tuple[Measure, ...] = (
        Measure("stroke", "mm", "stroke", scale=10.0),
        Measure("angle", "°", "angle between rod and guide", worst="greatest", scale=5.0),
    )
    requirements: tuple[MeasureBound, ...] = (
        MeasureBound("angle", "<=", 45.0, "rod within 45° of the guide"),
    )

    def evaluate(self, values, of):
        radius, rod, offset = values
        sine = (radius + jnp.abs(offset)) / rod
        found = {"stroke": 2 * radius, "angle": jnp.rad2deg(jnp.arcsin(jnp.clip(sine, 0.0, 1.0)))}
        return {name: found[name] for name in of}

    def judge(self, values: Values) -> dict[str, float]:
        sine = (values["radius"] + abs(values["offset"])) / values["rod"]
        if sine > 1:
            raise UserError("slider-crank: the crank cannot turn; lengthen the rod")
        return {"stroke": 2 * values["radius"], "angle": math.degrees(math.asin(sine))}

    def files(self, values: Values) -> Sequence[SpecFile]:
        text = "".join(f"{name} = {value!r}\n" for name, value in values.items())
        return [SpecFile("crank.toml", "the slider-crank", text), SpecFile("raw.bin", "", b"\x00")]


class SliderCrank(Explorer):
    """``name`` is drawn; a design with many ``turns`` has as many cranks on one another."""

    joints = (Parameter("crank", 40.0, 0.0, 360.0, "°"),)
    presets: Mapping[str, Values] = {"upright": {"crank": 90.0}}

    def __init__(self, name: str = "slider", turns: int = 1) -> None:
        self.design = SliderCrankDesign()
        self.name, self.turns = name, turns
        self.shows = 0

    def view(self, values: Values) -> View:
        x = place(values)
        tip = draw(values, self.name).polylines[1].places[1]
        handles = [Handle("tip", tip, ("crank", "radius"))]
        if x is not None:
            handles.append(Handle("slider", (x, values["offset"]), ("rod",)))
        notes = {"crank": f"radius {values['radius']:g} mm", "coupler": "turns about μ₁"}
        return View(self.name, draw(values, self.name, self.turns), handles, notes)

    def sketch(self) -> Sequence[View]:
        return [self.view(self.values())]

    def show(self, values: Values) -> ExplorerState:
        self.shows += 1
        if values["offset"] == 19.0:
            raise ZeroDivisionError("on purpose")
        x = place(values)
        swept = [5.0 * n for n in range(73)]
        places = [place({**values, "crank": each}) for each in swept]
        series = [
            Series("slider", swept, [math.nan if one is None else one for one in places]),
            Series("crank", swept, [values["radius"] * math.cos(math.radians(a)) for a in swept]),
        ]
        numbers = Numbers(
            [
                Readout("slider's place", x, "mm"),
                Readout("rod to crank", values["rod"] / values["radius"]),
            ],
            [Chart("motion", "crank (°)", "x (mm)", series, values["crank"])],
            "" if x is not None else LOCKED,
            {self.name: {"crank pin": f"at {values['crank']:g}°"}},
        )
        return ExplorerState([self.view(values)], lambda: numbers)

    def drag(self, values: Values, handle: str, place: Place) -> dict[str, float]:
        if handle == "slider":
            tip = draw(values, self.name).polylines[1].places[1]
            return {**values, "rod": math.hypot(place[0] - tip[0], values["offset"] - tip[1])}
        angle = math.degrees(math.atan2(place[1], place[0])) % 360
        return {**values, "crank": angle, "radius": min(max(math.hypot(*place), 10.0), 80.0)}


@dataclass(frozen=True)
class Step:
    values: dict[str, float]
    message: str
    done: bool
    report: tuple[str, ...] = ()


def search(design, values, objective, free, keep=()) -> Iterator[Step]:
    """A stand-in for the search: radius upwards by steps, as far as rod and bounds let it."""
    if objective != "stroke":
        raise UserError("optimise: nothing to improve")
    radius = values["radius"]
    most = values["rod"] * math.sin(math.radians(45)) - abs(values["offset"])
    most = min(most, free["radius"][1]) if "radius" in free else radius
    while radius < most - 1e-9:
        radius = min(radius + 0.25, most)
        yield Step({**values, "radius": radius}, f"stroke {2 * radius:.2f} mm", False)
    yield Step({**values, "radius": radius}, "done", True, ("active: rod within 45° of the guide",))
