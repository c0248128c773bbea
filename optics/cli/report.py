"""The JSON of `designopt trace`: what is seen, by which path, how sharply, and where rays go."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from designopt.programs import Program
from optics.cli.layer_report import outline_of_view, second_images_of
from optics.scene.camera import Camera
from optics.scene.scene import Layout
from optics.scene.sold import fields_of_view
from optics.visibility.intervals import union
from optics.visibility.scene_trace import SceneTrace
from optics.visibility.tracing import NOTHING, Hits
from optics.visibility.views import REASONS, describe_end

WIDTH = 100
"""What fits in so many characters is written on one line."""

Entry = dict[str, Any]


def document_of(trace: SceneTrace) -> dict[str, Any]:
    """The document, in mm and degrees; poses and rays one after the other, on demand."""
    layout = trace.scene.layout
    return {
        "scene": layout.name,
        "engine": "traced" if layout.curved else "exact",
        "bounces": trace.bounces,
        "camera": _camera(trace.scene.camera),
        "lens": _lens(trace.scene.camera),
        "poses": (_pose(trace, index) for index in range(len(trace.angles_deg))),
        "rays": _rays(trace),
    }


def lines_of(document: Mapping[str, Any]) -> Iterator[str]:
    """A document as JSON, entry by entry, so that it is never in memory as a whole."""
    mark = "{\n"
    for key, value in document.items():
        yield f'{mark} "{key}": '
        mark = ",\n"
        if isinstance(value, Iterator):
            separator = "[\n  "
            for part in value:
                yield separator + _text(part, 2)
                separator = ",\n  "
            yield "[]" if separator == "[\n  " else "\n ]"
        else:
            yield _text(value, 1)
    yield "\n}\n"


def _text(value: Any, indent: int) -> str:
    text = json.dumps(value, allow_nan=False)
    if indent + len(text) <= WIDTH or not isinstance(value, dict | list):
        return text
    if isinstance(value, dict):
        parts = [f"{json.dumps(key)}: {_text(part, indent + 1)}" for key, part in value.items()]
    else:
        parts = [_text(part, indent + 1) for part in value]
    space = "\n" + " " * indent
    return text[0] + space + " " + f",{space} ".join(parts) + space + text[-1]


def _camera(camera: Camera) -> Entry:
    """Fields of view on the axes of the sensor, or of a 4:3 sensor that lies one way or another."""
    entry: Entry = {"focal_length_px": float(_focal_pixels(camera))}
    if camera.sensor is not None:
        return entry | {"field_of_view_deg": fields_of_view(camera)}
    sides = {"short": 4 / 3, "long": 3 / 4}
    fields = {side: fields_of_view(camera, across) for side, across in sides.items()}
    return entry | {"field_of_view_deg_if_section_has_side": fields}


def _lens(camera: Camera) -> Entry | None:
    lens = camera.lens
    if lens is None:
        return None
    focus = 1 / lens.focus_vergence().value
    pixel, focus, magnification, limits = _lens_numbers(camera)
    return {
        "focal_length_mm": float(lens.focal_length),
        "aperture_mm": float(lens.aperture),
        "sensor_distance_mm": float(lens.sensor_distance),
        "pixel_mm": float(pixel),
        # Infinity: null, as of what is sharp.
        "focus_mm": float(focus) if math.isfinite(focus) else None,
        "magnification": float(magnification),
        # Where a point is blurred by no more than a pixel.
        "sharp_mm": [1 / vergence if vergence > 0 else None for vergence in limits.tolist()],
    }


@Program
def _focal_pixels(camera: Camera) -> Array:
    return camera.focal_pixels


@Program
def _lens_numbers(camera: Camera) -> tuple[Array, Array, Array, Array]:
    """Size of a pixel, distance of focus, magnification there, and vergences that are sharp."""
    lens, pixel = camera.lens, camera.pixel_size
    assert lens is not None
    focus = 1 / lens.focus_vergence().value
    return pixel, focus, lens.image(focus).value.magnification, lens.depth_of_field(pixel).value


def _pose(trace: SceneTrace, index: int) -> Entry:
    angles = trace.angles_deg[index].tolist()
    entry: Entry = {"angles_deg": dict(zip(trace.scene.angle_names, angles, strict=True))}
    entry["pads"] = {}
    if trace.views is not None:
        view = jax.tree.map(lambda leaf: leaf[index].tolist(), trace.views)
        entry["pads"] = {
            part.name: _pad(trace, view, index, pad)
            for pad, part in enumerate(trace.scene.layout.pads)
        }
        entry["mirrors"] = _mirrors(trace, view)
    if trace.images is not None:
        positions, faces = trace.images.position[index].tolist(), trace.images.faces[index]
        entry["virtual_cameras"] = {
            name: position
            for name, word, position, there in zip(
                trace.paths, trace.words, positions, faces, strict=True
            )
            if word and there
        }
    return entry


def _pad(trace: SceneTrace, view: Any, pose: int, pad: int) -> Entry:
    """One pad in one pose, from `Views` of this pose as nested lists."""
    pieces: dict[int, list[int]] = {path: [] for path in range(len(trace.paths))}
    found = view.found.value
    for piece, there in enumerate(found.present[pad]):
        if there:
            pieces[found.path[pad][piece]].append(piece)
    entry = {
        "coverage": min(view.coverage[pad], 1.0),
        "redundancy": view.redundancy[pad],
        "px_per_mm": _spread(view.sharpness.px_per_mm[pad]),
        "views": {
            name: _view(trace, view, pad, path, pieces[path])
            for path, name in enumerate(trace.paths)
        },
    }
    for path, name in enumerate(trace.paths):
        outline = outline_of_view(trace, pose, path, pad) if pieces[path] else None
        if outline:
            entry["views"][name]["outline"] = outline
    second = second_images_of(trace, pose, pad)
    return entry | ({"second_images": second} if second else {})


def _view(trace: SceneTrace, view: Any, pad: int, path: int, pieces: Sequence[int]) -> Entry:
    """One pad by one path."""
    found, layout = view.found.value, trace.scene.layout
    margin = math.degrees(view.found.margin[path][pad])
    message = REASONS[view.codes[path][pad]]
    if not pieces:
        return {"intervals": [], "margin_deg": margin, "why_not": message}

    def of_pieces(values: Any) -> list[Any]:
        return [values[pad][piece] for piece in pieces]

    starts, ends = of_pieces(found.start), of_pieces(found.end)
    labels = zip(of_pieces(found.start_label), of_pieces(found.end_label), strict=True)
    nearest, farthest = zip(*of_pieces(view.sharpness.distance), strict=True)
    entry = {
        "intervals": [list(pair) for pair in zip(starts, ends, strict=True)],
        "ends": [[describe_end(layout, label) for label in pair] for pair in labels],
        "pixels": of_pieces(found.pixels),
        "px_per_mm": _spread(view.sharpness.by_path[pad][pieces[0]]),
        "distance_mm": [min(nearest), max(farthest)],
    }
    if view.sharpness.apparent is not None:
        nearest, farthest = zip(*of_pieces(view.sharpness.apparent), strict=True)
        entry["apparent_distance_mm"] = [min(nearest), max(farthest)]
    if view.focus is not None:
        entry["blur_px"] = of_pieces(view.focus.blur)
        if view.focus.sharp is not None:
            entry["sharp"] = of_pieces(view.focus.sharp)
        near, far = zip(*of_pieces(view.working_blur), strict=True)
        # At the two distances of the whole view.
        entry["blur_px_at_distance"] = [
            near[nearest.index(min(nearest))],
            far[farthest.index(max(farthest))],
        ]
    entry["margin_deg"] = margin
    if message:  # there are more pieces than there was room for
        entry["incomplete"] = message
    return entry


def _spread(values: Sequence[float]) -> Entry | None:
    """Nothing where nothing is seen, or single points only."""
    return dict(zip(("min", "median", "max"), values, strict=True)) if values[-1] else None


def _mirrors(trace: SceneTrace, view: Any) -> Entry:
    """Of every mirror the parts in which anything is seen."""
    used: list[list[tuple[float, float]]] = [[] for _ in trace.scene.layout.mirrors]
    found = view.found.value
    for pad, row in enumerate(found.present):
        for piece, there in enumerate(row):
            word = trace.words[found.path[pad][piece]] if there else ()
            for mirror, span in zip(word, found.spans[pad][piece], strict=False):
                used[mirror].append((min(span), max(span)))
    names = (part.name for part in trace.scene.layout.mirrors)
    return {name: {"used": union(parts)} for name, parts in zip(names, used, strict=True)}


def _rays(trace: SceneTrace) -> Iterator[Entry]:
    """Rays pose by pose."""
    if trace.hits is None:
        return
    for pose, ray in np.ndindex(trace.hits.length.shape[:2]):
        x, y, direction = trace.rays[ray].tolist()
        hits = jax.tree.map(lambda leaf, at=(pose, ray): leaf[at].tolist(), trace.hits)
        yield {
            "pose": pose,
            "start": [x, y],
            "direction_deg": direction,
            "hits": _hits(trace.scene.layout, hits),
            "end": _end(trace.scene.layout, hits),
        }


def _hits(layout: Layout, ray: Hits) -> list[Entry]:
    return [
        {
            "element": f"{layout.kind(surface)}:{layout.surfaces[surface].name}",
            "x": ray.place[leg][0],
            "y": ray.place[leg][1],
            "coordinate": ray.coordinate[leg],
            "direction_deg": math.degrees(math.atan2(ray.direction[leg][1], ray.direction[leg][0])),
            "path_length_mm": ray.length[leg],
            "grazing_deg": math.degrees(math.asin(min(ray.sine[leg], 1.0))),
            "reflected": ray.reflected[leg],
        }
        for leg, surface in enumerate(ray.surface)
        if surface != NOTHING
    ]


def _end(layout: Layout, ray: Hits) -> str:
    """Why a ray is followed no further."""
    met = [surface for surface in ray.surface if surface != NOTHING]
    last = len(met) - 1
    if not met or (ray.reflected[last] and len(met) < len(ray.surface)):
        return "it leaves the scene"
    if ray.reflected[last]:
        return f"{len(met)} reflections are one more than --bounces asks for"
    return f"it ends at {'' if ray.active[last] else 'the back of '}{layout.title(met[-1])}"
