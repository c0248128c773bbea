"""A bench small enough to know by heart: a slider-crank, in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import SubFigure

from designopt.errors import UserError
from designopt.explore.bench import Bench, Knob, Reading, Shown, Step, Values
from designopt.io.spec import SpecFile
from designopt.plot.ruling import Ruling, hold

KNOBS = (
    Knob("crank", 40.0, 0.0, 360.0, "°", "joint"),
    Knob("radius", 31.37, 10.0, 80.0, "mm", "dimension"),
    Knob("rod", 70.0, 20.0, 120.0, "mm", "dimension"),
    Knob("offset", 0.0, -20.0, 20.0, "mm", "dimension"),
)
ASKED = 50.0
LOCKED = "The rod is too short for this pose; lengthen it."


def place(values: Values) -> float | None:
    """Where the slider stands, mm."""
    angle = math.radians(values["crank"])
    height = values["radius"] * math.sin(angle) - values["offset"]
    square = values["rod"] ** 2 - height**2
    return values["radius"] * math.cos(angle) + math.sqrt(square) if square >= 0 else None


class SliderCrank(Bench):
    title = "slider-crank"
    knobs = KNOBS
    aim = f"slider at {ASKED:g} mm, by the rod"
    shows = 0

    def draw(self, area: SubFigure) -> None:
        self.axes, traced = area.subplots(1, 2)
        self.axes.set_xlabel("x (mm)")
        self.rulings = [Ruling(self.axes, "x", 6, 9), Ruling(self.axes, "y", 6, 9)]
        traced.set(xlim=(0, 360), ylim=(-90, 210), xlabel="crank (°)", ylabel="slider (mm)")
        self.body = self.axes.plot([], [], "o-")[0]
        self.dot = traced.plot([], [], "o")[0]
        self.curve = traced.plot([], [])[0]
        self.words = self.axes.text(0, 100, "")

    def show(self, values: Values) -> Shown:
        self.shows += 1
        x = place(values)
        angle, radius = math.radians(values["crank"]), values["radius"]
        tip = (radius * math.cos(angle), radius * math.sin(angle))
        end = (math.nan, math.nan) if x is None else (x, values["offset"])
        self.body.set_data([0, tip[0], end[0]], [0, tip[1], end[1]])
        swept = np.linspace(0.0, 360.0, 73)
        places = [place({**values, "crank": float(each)}) for each in swept]
        self.curve.set_data(swept, [math.nan if each is None else each for each in places])
        self.dot.set_data([values["crank"]], [end[0]])
        self.words.set_text(f"radius {radius:.1f} mm")
        right = 260 if values["rod"] > 100 else 210
        hold(self.axes, np.array([-90.0, -110.0]), np.array([right, 110.0]))
        return Shown(
            [Reading("slider's place", x, "mm"), Reading("rod to crank", values["rod"] / radius)],
            [*self.rulings, self.body, self.curve, self.dot, self.words],
            "" if x is not None else LOCKED,
        )

    def specs(self, values: Values) -> Sequence[SpecFile]:
        if place(values) is None:
            raise UserError("slider-crank: a locked one is not saved; lengthen the rod")
        text = "".join(f"{name} = {value!r}\n" for name, value in values.items())
        return [SpecFile("crank.toml", "the slider-crank", text), SpecFile("raw.bin", "", b"\x00")]

    def optimise(self, values: Values) -> Iterator[Step]:
        if place(values) is None:
            raise UserError("optimise: it cannot start locked; lengthen the rod")
        low, high = 20.0, 120.0
        while high - low > 0.01:
            rod = (low + high) / 2
            x = place({**values, "rod": rod})
            low, high = (low, rod) if x is not None and x > ASKED else (rod, high)
            if values["offset"] == 20.0:
                raise ZeroDivisionError("on purpose")
            yield Step({**values, "rod": rod}, f"rod {rod:.2f} mm")
