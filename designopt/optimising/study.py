"""An optimisation as a study: its settings are what was asked for, its result a folder."""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import Circle

from designopt.design_kind import Design
from designopt.designs import load_design
from designopt.export.drawing import Drawing
from designopt.export.line_styles import line_styles_of
from designopt.io.spec import Spec, SpecFile
from designopt.optimising.asked import Asked, parse_over
from designopt.optimize.parametric import ParametricDesign, amount_text, find_measure
from designopt.optimize.search_result import SearchResult
from designopt.plot.figures import new_figure
from designopt.plot.typesetting import drawn_name
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.settings import setting
from designopt.study.study import Context, Study

POINTS_PER_MM = 72 / 25.4


class OptimiseSpec(Spec):
    """What was asked for, as on the command line."""

    design: str = setting("", "file, study or folder of a result", free=True)
    settings: list[str] = setting([], "settings of a study", free=True)
    config: list[Path] = setting([], "files with settings of a study", free=True)
    maximise: str = setting("", "measure whose least value counts", free=True)
    minimise: str = setting("", "measure whose greatest value counts", free=True)
    free: list[str] = setting([], "NAME or NAME=low:high of parameters that may change", free=True)
    keep: list[str] = setting([], "requirements beyond the design's own", free=True)
    over: list[str] = setting([], "NAME=low:high of joints or inputs", free=True)
    starts: int = setting(
        1, "searches: from the design as it is, and from random ones", ge=1, free=True
    )


def run(spec: OptimiseSpec, context: Context) -> Results:
    """Search, judge, and report what was found with its file.

    Raises:
        UserError: the design cannot be read, or what is asked for makes no sense for it.
    """
    context.require_float64("requirements are kept to 1e-6")
    loaded = load_design(spec.design, spec.settings, spec.config)
    design = loaded.parametric(parse_over(spec.over))
    asked = Asked.of(spec.maximise, spec.minimise, spec.free, spec.keep)
    direction = None if not (spec.maximise or spec.minimise) else bool(spec.maximise)
    search = asked.search(design, direction)
    steps, last = search.steps(design.values(), spec.starts, context.seed), None
    for phase, own in itertools.groupby(steps, lambda step: step.phase):
        with context.step(phase.capitalize()):
            *_, last = own
    assert last is not None  # as the last step has the result
    assert last.result is not None
    result = last.result
    return report(spec, loaded, design, result)


def report(
    spec: OptimiseSpec, loaded: Design, design: ParametricDesign, result: SearchResult
) -> Results:
    """What was found: numbers, what holds it, both drawings, and the file.

    Args:
        spec: what was asked for.
        loaded: the design as it was read.
        design: it as numbers.
        result: of the search.
    """
    out = Report(spec, package=__package__)
    objective = find_measure(design, result.objective)
    unit, was = objective.unit, result.judged_before.get(objective.name)
    out.values(
        requirements=len(result.keep),
        summary=result.summary(design),
        objective=objective.name,
        unit=unit or "1",
        why=result.why,
        begun="start" if spec.starts == 1 else "starts",
    )
    out.metric(
        objective.name,
        result.judged.get(objective.name),
        "reached",
        unit=unit,
        description=objective.description,
        worst=objective.worst,
        was="no design" if was is None else amount_text(was, unit),
    )
    # What is no design meets nothing.
    out.metrics(requirements_missed=len(result.missed if result.judged else result.keep))
    _add_findings(out, design, result)
    _add_tables(out, design, result)
    out.figure("before", draw(loaded.drawing()))
    if result.judged:
        files = design.files(result.values)
        out.figure("after", draw(_read_again(files).drawing()))
        for file in files:
            out.file(file)
    return out.results()


def _add_findings(out: Report, design: ParametricDesign, result: SearchResult) -> None:
    unit = find_measure(design, result.objective).unit
    out.say("reached")
    if result.conflict:
        out.say("conflict", words="; ".join(result.conflict))
    for bound, margin in result.missed:
        measure = find_measure(design, bound.measure)
        out.say("missed", words=str(bound), amount=amount_text(-margin, measure.unit))
    if not result.slopes:  # nothing was found that is better than the start
        return
    for one in result.active:
        gain = amount_text(one.price, unit)
        out.say("held", words=one.words, amount=amount_text(1.0, one.unit), gain=gain)
    if not result.active:
        out.say("waiting")
    out.say("local" if result.is_optimum else "not_optimum")


def _add_tables(out: Report, design: ParametricDesign, result: SearchResult) -> None:
    parameters, measures, kept = Records(), Records(), Records()
    units = {one.name: one.unit for one in design.parameters}
    for name, (low, high) in result.free.items():
        before, after = result.before[name], result.values[name]
        row = {"parameter": name, "before": before, "after": after, "unit": units[name]}
        parameters.add(**row, low=low, high=high)
    for one in design.measures:
        before, after = (
            judged.get(one.name, math.nan) for judged in (result.judged_before, result.judged)
        )
        row = {"measure": one.name, "before": before, "after": after, "unit": one.unit}
        measures.add(**row, meaning=f"{one.description}, {one.worst} value")
    prices = dict.fromkeys(result.keep, 0.0)
    for one in result.active:
        if one.name in result.labels:
            prices[result.labels[one.name]] += one.price
    for bound, price in prices.items():
        measure = find_measure(design, bound.measure)
        before, after = (
            bound.margin(judged.get(bound.measure, math.nan))
            for judged in (result.judged_before, result.judged)
        )
        row = {"requirement": str(bound), "margin_before": before, "margin_after": after}
        kept.add(**row, unit=measure.unit, price=price)
    out.table("parameters", parameters)
    out.table("measures", measures)
    if result.keep:
        out.table("requirements", kept)
    slopes = Records()
    for name in result.free if result.slopes else ():
        own = {measure: row[name] for measure, row in result.slopes.items()}
        slopes.add(parameter=name, unit=units[name], **own)
    if result.slopes:
        out.table("sensitivities", slopes)


def _read_again(files: Sequence[SpecFile]) -> Design:
    """The design of files that were written: what other commands will read of it."""
    with tempfile.TemporaryDirectory() as folder:
        for file in files:
            (Path(folder) / file.name).write_bytes(file.data)
        return load_design(str(Path(folder) / files[0].name))


def draw(drawing: Drawing) -> Figure:
    """A drawing to scale, by Matplotlib, as reports have it."""
    figure, [[axes]] = new_figure(height=3.6)
    styles = line_styles_of(drawing.layers)
    for line in drawing.polylines:
        style, places = styles[line.layer], line.line()
        if line.closed:
            places = [*places, places[0]]
        axes.plot(
            *zip(*places, strict=True),
            color=style.color,
            linewidth=2 * style.width * POINTS_PER_MM,
            linestyle="--" if style.dashed else "-",
        )
    for circle in drawing.circles:
        axes.add_patch(
            Circle(circle.center, circle.radius, fill=False, edgecolor=styles[circle.layer].color)
        )
    for label in drawing.labels:
        axes.annotate(drawn_name(label.text), label.place, (3, 3), textcoords="offset points")
    (left, low), (right, high) = drawing.box()
    room = 0.08 * max(right - left, high - low)
    axes.set(xlim=(left - room, right + room), ylim=(low - room, high + room))
    axes.set(aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
    return figure


STUDY = Study("optimise", "One measure of a design improved", OptimiseSpec, run)
