"""A small study, as another package would offer it, and ways in which one can be broken."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pydantic

from designopt.io.spec import Spec
from designopt.study.results import Metric, Results, Table, Target
from designopt.study.study import STUDY_GROUP, Context, Study


class Inner(Spec):
    length: pydantic.PositiveFloat = pydantic.Field(default=2.0, description="a length (mm)")


class SquareSpec(Spec):
    side: float = pydantic.Field(description="side of the square (mm)")
    inner: Inner = Inner()
    label: str = pydantic.Field(default="", description="free text")
    asked: float = pydantic.Field(default=9.0, description="area asked for (mm²)")


def _run(spec: SquareSpec, context: Context) -> Results:
    with context.step("Squaring"):
        area = spec.side**2
    if spec.label == "break":
        raise RuntimeError("broken on purpose")
    if spec.label == "interrupt":
        raise KeyboardInterrupt
    sides = Table("sides", "Sides", ["side_mm", "note"], [(spec.side, "a,b"), (None, "")])
    return Results(
        findings=["A <square> & its area."],
        metrics=[
            Metric("area_mm2", area, "mm²", "area", 9.0, Target("=", spec.asked)),
            Metric("nothing", float("nan"), "", "not a number"),
        ],
        tables=[sides] * (2 if spec.label == "twice" else 1),
    )


SQUARE = Study("square", "The area of a square", SquareSpec, _run, needs=("peers",))
NOT_A_STUDY = "a string"


def points(*names: str) -> list[EntryPoint]:
    """Entry points for `SQUARE` and, by name, for what is broken."""
    values = {
        "square": "tests.designopt.plugin:SQUARE",
        "string": "tests.designopt.plugin:NOT_A_STUDY",
        "absent": "no_such_package:STUDY",
    }
    return [EntryPoint(name, values[name], STUDY_GROUP) for name in names]
