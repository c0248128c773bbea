from .bench import Bench, Knob, Reading, Shown, Step
from .design import Design, DesignFile, Quantity, load_design, read_tables
from .sheet import Circle, Label, Layer, Measure, Sheet, Stroke

__all__ = [
    "Bench",
    "Circle",
    "Design",
    "DesignFile",
    "Knob",
    "Label",
    "Layer",
    "Measure",
    "Quantity",
    "Reading",
    "Sheet",
    "Shown",
    "Step",
    "Stroke",
    "load_design",
    "read_tables",
]
