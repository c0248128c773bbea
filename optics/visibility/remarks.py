"""Remarks on a trace: which pads are not all seen, where, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from optics.scene.camera import Camera
from optics.scene.catalogue import assumed_of
from optics.scene.scene import Layout
from optics.scene.sold import fields_of_view
from optics.visibility.scene_trace import SceneTrace, Views
from optics.visibility.second_images import clear_walls
from optics.visibility.tracing import NOTHING
from optics.visibility.views import REASONS, ViewResult, describe_end

ROUNDING = 1e-9
"""A smaller part of a pad that is not seen is rounding."""


def remarks_on(trace: SceneTrace) -> list[str]:
    """Two lines for every pad that is not all seen in every pose, one for what is left out.

    And one for every pad with a second image in a clear wall, for every view that is blurred too
    much, and on rays that end at layers.
    """
    layout, views = trace.scene.layout, trace.views
    if views is None:
        hint = "" if len(trace.rays) else "; --ray X,Y,DEG follows a ray"
        return [f"{layout.name}: there are no pads to be seen{hint}"]
    crowded = views.codes == jax.tree.leaves(ViewResult.too_many)[0]
    lines = []
    for pad, part in enumerate(layout.pads):
        hidden = 1 - views.coverage[:, pad]
        worst, short = int(np.argmax(hidden)), int(np.sum(hidden > ROUNDING))
        if short:
            of_it = _part(views.coverage[worst, pad])
            if len(hidden) > 1:
                of_it = (
                    f"not all of it is seen at {short:,} of {len(hidden):,} poses; worst at "
                    f"{_pose(trace, worst)}: {of_it}"
                )
            view = jax.tree.map(lambda leaf, worst=worst: leaf[worst], views)
            lines += [f"pad '{part.name}': {of_it}", f"  {_why(trace, view, pad)}"]
        if crowded[..., pad].any():
            count = int(np.sum(crowded[..., pad].any(axis=1)))
            lines.append(
                f"pad '{part.name}': at {count:,} poses it is seen in more pieces than there is "
                "room for; some of them are left out"
            )
        lines += _second_images(trace, pad)
    return lines + _too_blurred(trace, views) + _rays_at_layers(trace)


def _rays_at_layers(trace: SceneTrace) -> list[str]:
    """One line if a ray that was asked for meets layers, which it is not followed into."""
    if trace.hits is None or trace.scene.layers is None:
        return []
    layout, surfaces = trace.scene.layout, np.unique(trace.hits.surface)
    met = dict.fromkeys(layout.behind_face[surfaces[surfaces != NOTHING]].tolist())
    names = [f"'{layout.pads[pad].name}'" for pad in met if pad >= 0 and layout.layers[pad]]
    if not names:
        return []
    return [f"--ray: rays end where they meet layers (of {', '.join(names)}), not at the membrane"]


def _second_images(trace: SceneTrace, pad: int) -> list[str]:
    """A line for a pad that clear ends of its layers show once more, whether seen or not."""
    if trace.layers is None or trace.layers.second is None:
        return []
    second, walls = trace.layers.second, clear_walls(trace.scene.layout)
    own = np.array([wall.pad == pad for wall in walls])
    widths = np.where(second.present, np.abs(np.diff(second.pixels)[..., 0]), 0.0).max(axis=(0, 2))
    if not widths[own].any():
        return []
    widest = int(np.argmax(np.where(own, widths, 0.0)))
    return [
        f"pad '{trace.scene.layout.pads[pad].name}': a second image of it appears in "
        f"{walls[widest].name}, {widths[widest]:.3g} px wide; it does not count as seen"
    ]


def _too_blurred(trace: SceneTrace, views: Views) -> list[str]:
    """A line for every view that is blurred more than the camera's limit in any pose."""
    limit, blur = trace.scene.camera.max_blur, views.working_blur
    if limit is None or blur is None:
        return []
    lines, found, sharpness = [], views.found.value, views.sharpness
    kind = "" if sharpness.apparent is None else "an apparent "
    for pad, part in enumerate(trace.scene.layout.pads):
        for path, name in enumerate(trace.paths):
            there = found.present[:, pad] & (found.path[:, pad] == path)
            here = np.where(there[..., None], blur[:, pad], 0.0)
            worst = np.unravel_index(int(np.argmax(here)), here.shape)
            if here[worst] > float(limit):
                poses = ""
                if len(here) > 1:
                    count = int(np.sum(here.max(axis=(1, 2)) > float(limit)))
                    at = _pose(trace, int(worst[0]))
                    poses = f", at {count:,} of {len(here):,} poses; worst at {at}"
                distance = f"{kind}{sharpness.object_distance[:, pad][worst]:.4g} mm"
                lines.append(
                    f"pad '{part.name}' by {name}: a blur of {here[worst]:.3g} px at {distance} is "
                    f"more than max_blur_px = {float(limit):g}{poses}"
                )
    return lines


def remark_on_fields(camera: Camera) -> str:
    """One line on the fields of view along the sides and the diagonal of the sensor.

    Example:
        >>> from optics import Camera, Equidistant
        >>> print(remark_on_fields(Camera(np.zeros(2), 0.0, np.deg2rad(90), 100, Equidistant())))
        camera: if its 90° are along the short side of a 4:3 sensor, the long side has 120° and the diagonal 150°; if along the long side, the short one has 67.5° and the diagonal 112.5°; 'format' tells
    """  # noqa: E501
    if camera.sensor is not None:
        fields = {axis: _degrees(field) for axis, field in fields_of_view(camera).items()}
        listed = ", ".join(f"{field} ({axis})" for axis, field in fields.items())
        return f"camera: fields of view {listed}; {_degrees(_own(camera))} in the section"
    short, long = (
        {axis: _degrees(field) for axis, field in fields_of_view(camera, across).items()}
        for across in (4 / 3, 3 / 4)
    )
    return (
        f"camera: if its {_degrees(_own(camera))} are along the short side of a 4:3 sensor, the "
        f"long side has {short['horizontal']} and the diagonal {short['diagonal']}; if along the "
        f"long side, the short one has {long['vertical']} and the diagonal {long['diagonal']}; "
        "'format' tells"
    )


def remarks_on_model(camera: Mapping[str, Any]) -> list[str]:
    """One line on what a file's ``[camera]`` takes from its model though it is only assumed there.

    Example:
        >>> remarks_on_model({"model": "ov5647-160"})
        ["camera: no source states of 'ov5647-160' its projection, equidistant is assumed; measure it, or state it in [camera]"]
    """  # noqa: E501
    assumed = [f"its {key}, {value} is assumed" for key, value in assumed_of(camera).items()]
    if not assumed:
        return []
    return [
        f"camera: no source states of '{camera['model']}' {' nor '.join(assumed)}; measure it, or "
        "state it in [camera]"
    ]


def _own(camera: Camera) -> float:
    return float(np.rad2deg(camera.field_of_view))


def _degrees(field: float | None) -> str:
    return "more than it images" if field is None else f"{field:.4g}°"


def _part(coverage: float) -> str:
    if coverage == 0:
        return "none of it is seen"
    if coverage < 0.5:
        return f"only {100 * coverage:.3g} % of it is seen"
    return f"{100 * (1 - coverage):.3g} % of it is not seen"


def _pose(trace: SceneTrace, index: int) -> str:
    named = zip(trace.scene.angle_names, trace.angles_deg[index].tolist(), strict=True)
    return ", ".join(f"{name} = {value:.6g}°" for name, value in named)


def _why(trace: SceneTrace, view: Views, pad: int) -> str:
    """Why some of a pad is not seen in a pose."""
    if view.coverage[pad] > 0:
        bounds = dict.fromkeys(_bounds(trace.scene.layout, view, pad))
        return f"what is seen ends at: {'; '.join(bounds)}"
    if np.any(view.found.value.present[pad]):
        return "all rays to it meet it in single points"
    nearest = int(np.argmax(view.found.margin[:, pad]))
    why = REASONS[int(view.codes[nearest, pad])]
    return f"nearest to showing any of it is {trace.paths[nearest]}: {why}"


def _bounds(layout: Layout, view: Views, pad: int) -> list[str]:
    """What bounds the parts of a pad that are not seen, along the pad."""
    found, labels = view.found.value, []
    reached, last = 0.0, None
    for piece in np.flatnonzero(found.present[pad]):
        if found.start[pad, piece] > reached + ROUNDING:
            labels += [last, found.start_label[pad, piece]]
        if found.end[pad, piece] > reached:
            reached, last = found.end[pad, piece], found.end_label[pad, piece]
    if reached < 1 - ROUNDING:
        labels.append(last)
    return [describe_end(layout, int(label)) for label in labels if label is not None]
