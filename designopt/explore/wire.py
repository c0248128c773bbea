"""Panels as the page is sent them: plain shapes with the coordinates of the exporters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from designopt.explore.explorer import Chart, View
from designopt.export.drawing import Drawing
from designopt.export.line_styles import line_styles_of
from designopt.export.svg import path_data

Wire = dict[str, Any]


def encode_panels(panels: Sequence[View | Chart]) -> list[Wire]:
    """Panels as JSON; y of views downwards, as in SVG."""
    return [_view(panel) if isinstance(panel, View) else _chart(panel) for panel in panels]


def panel_change(new: Wire, old: Wire | None) -> Wire:
    """What of a panel differs from what was sent of it before, and its name.

    Shapes that have changed come as ``[[index, shape], …]`` under ``"changed"`` while their number
    stays the same.
    """
    if old is None or old["kind"] != new["kind"]:
        return new
    change = {key: value for key, value in new.items() if value != old[key]}
    if "shapes" in change and len(new["shapes"]) == len(old["shapes"]):
        pairs = zip(new["shapes"], old["shapes"], strict=True)
        change["changed"] = [[n, one] for n, (one, before) in enumerate(pairs) if one != before]
        del change["shapes"]
    return {"name": new["name"], **change}


def changed_fields(new: Mapping[str, Any], old: Mapping[str, Any]) -> Wire:
    """Fields with another value than before; of each panel what `panel_change` leaves."""
    fields = {key: value for key, value in new.items() if key != "panels" and value != old[key]}
    if "panels" in new:
        before = {panel["name"]: panel for panel in old["panels"]}
        fields["panels"] = [panel_change(one, before.get(one["name"])) for one in new["panels"]]
    return fields


def _view(view: View) -> Wire:
    drawing = view.drawing
    styles = line_styles_of(drawing.layers)
    order = {layer.name: number for number, layer in enumerate(drawing.layers)}
    lines = [[order[one.layer], one.name, path_data(one)] for one in drawing.polylines]
    circles = [
        [order[layer], name, x, 0.0 - y, radius] for layer, name, (x, y), radius in drawing.circles
    ]
    return {
        "kind": "view",
        "name": view.name,
        "box": _box(drawing),
        "layers": [[layer.name, layer.kind, *styles[layer.name]] for layer in drawing.layers],
        "shapes": lines + circles,
        "labels": [[text, order[layer], x, 0.0 - y] for layer, (x, y), text in drawing.labels],
        "handles": [[name, x, 0.0 - y, list(of)] for name, (x, y), of in view.handles],
        "notes": dict(view.notes),
    }


def _box(drawing: Drawing) -> list[float] | None:
    """Left, top, right and bottom of what is framed, y downwards; ``None`` if nothing is."""
    framed = {layer.name for layer in drawing.layers if layer.framed}
    if not framed & {one.layer for one in (*drawing.polylines, *drawing.circles)}:
        return None
    (left, low), (right, high) = drawing.box()
    return [left, -high, right, -low]


def _chart(chart: Chart) -> Wire:
    return {
        "kind": "chart",
        "name": chart.name,
        "x_label": chart.x_label,
        "y_label": chart.y_label,
        "series": [
            [one.name, [*map(finite, one.x)], [*map(finite, one.y)]] for one in chart.series
        ],
        "at": finite(chart.at),
        "y_range": chart.y_range,
    }


def finite(value: float | None) -> float | None:
    """A number that JSON can hold; ``None`` for NaN, which it lacks."""
    return float(value) if value is not None and math.isfinite(value) else None
