"""Pictures of the finger: views, masks, unwarped pads, like paper B's Figs. 4.1 to 4.6."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

from designopt.plot.figures import PALETTE, legend_below, new_figure
from designopt.plot.typesetting import drawn_name
from optics.rendering import Imprint, Renderer, TactileImage
from perception.differences import References
from perception.lens import Lens, TangentPlane
from perception.masks import adaptive_mask, brightness, combined_mask, global_mask
from perception.matching import Sighting
from perception.paper_route import PaperRoute
from perception.quality import Quality
from studies.models.sensor.finger_sensor import FingerSensor

Shot = tuple[TactileImage, Sighting]
"""An image, and what was found in it."""

POSES_DEG = ((10.0, 35.0), (45.0, 50.0), (57.0, 20.0), (85.0, 80.0))
"""PIP and DIP of the frames that are shown; of a range of 90°."""

TOUCHED_DEG = (65.0, 70.0)
"""The same of the frames in which things are pressed into pads."""

WIDE = 0.7
"""Width over length of pads that have room for their names above them."""

MARGIN, NARROWEST = 0.02, 0.8
"""Beside the pads that are seen in an image, as a part of its width; and the least width of what is
shown of it, as a part of its height: titles have room above it."""

OF_QUALITY = {
    Quality.COMPLETE: PALETTE[5],
    Quality.CLIPPED: PALETTE[6],
    Quality.FLAT: PALETTE[0],
    Quality.GHOST: "white",
    Quality.MERGED: PALETTE[3],
    Quality.AMBIGUOUS: PALETTE[2],
    Quality.BLURRED: PALETTE[1],
    Quality.LOW_CONTRAST: "0.6",
}
"""Colors of views as they were found; those that were not found have none."""

IMPRINTS = ("sphere", "ball array", "studded brick", "edge", "screw thread")


def touch(finger: FingerSensor, index: int) -> dict[str, list[Imprint]]:
    """Something pressed into the middle of every pad, another thing from frame to frame."""
    return {
        pad: [Imprint(IMPRINTS[(index + number) % len(IMPRINTS)], along=length / 2)]
        for number, (pad, length) in enumerate(finger.catalog.lengths.items())
    }


def take_shots(finger: FingerSensor, renderer: Renderer, range_deg: float) -> list[Shot]:
    """Frames in which something is pressed into every pad."""
    poses = np.stack([_pose(finger, range_deg, pose) for pose in POSES_DEG])
    film = finger.film(renderer, poses, partial(touch, finger))
    return [(image, sighting) for image, sighting, _ in film]


def unwarp_touches(
    finger: FingerSensor, renderer: Renderer, range_deg: float
) -> dict[str, dict[str, np.ndarray]]:
    """Pads unwarped, untouched and with each thing pressed in: by pad, and what has changed."""
    references, unwarped, lengths = References(), {}, finger.catalog.lengths
    pose = _pose(finger, range_deg, TOUCHED_DEG)
    for number, kind in enumerate(("untouched", *IMPRINTS)):
        pressed = {pad: [Imprint(kind, length / 2)] for pad, length in lengths.items()}
        image = renderer.render(pose, pressed if number else None, frame=1000 + number)
        sighting, shown = finger.detect(image.pixels), {}
        for view in filter(None, (finger.best_view(sighting, pad) for pad in lengths)):
            picture = finger.unwarp(image.pixels, view)
            shown[view.pad] = np.sqrt(picture / 255)
            if number == 0:
                references.keep(view, picture)
            elif (change := references.compare(view, picture)) is not None:
                shown[f"{view.pad},\nchange"] = np.clip(0.5 + 0.5 * change, 0, 1)
        unwarped[kind] = shown
    return unwarped


def _pose(finger: FingerSensor, range_deg: float, degrees: Sequence[float]) -> np.ndarray:
    """A pose of as many joints as the finger has, rad."""
    return np.deg2rad(range_deg / 90 * np.resize(degrees, len(finger.model.names)))


def _picture(axes: Axes, pixels: np.ndarray, title: str) -> None:
    axes.imshow(pixels, cmap="gray", vmin=0, vmax=255)
    axes.set_axis_off()
    axes.set_title(title)


def _brighter(pixels: np.ndarray) -> np.ndarray:
    """For the eye: square root of the light."""
    return (255 * np.sqrt(pixels / 255)).astype(np.uint8)


def _outline(axes: Axes, lens: Lens, rays: np.ndarray, color: str, style: str) -> None:
    """The outline between four corners, its sides straight in space."""
    plane = TangentPlane(float(rays[:, 0].mean()))
    corners = plane.flat(rays)
    sides = [np.linspace(corners[i - 1], corners[i], 25) for i in range(4)]
    places = lens.project(plane.rays(np.concatenate(sides)))
    axes.add_patch(Polygon(places, fill=False, color=color, linestyle=style, linewidth=1.2))


def _seen_columns(shots: Sequence[Shot]) -> tuple[float, float]:
    """From where to where pads are seen in any of the frames, with a margin, px."""
    seen = np.any([image.labels > 0 for image, _ in shots], axis=(0, 1))
    first, *_, last = np.flatnonzero(seen)
    rows = len(shots[0][0].labels)
    half = max((last - first) / 2 + MARGIN * len(seen), NARROWEST * rows / 2)
    middle = (first + last) / 2
    return max(middle - half, 0), min(middle + half, len(seen))


def draw_views(finger: FingerSensor, shots: Sequence[Shot]) -> Figure:
    """Frames with what was found in them."""
    drawing, [row] = new_figure(1, len(shots), height=3.3)
    for axes, (image, sighting) in zip(row, shots, strict=True):
        title = " / ".join(f"{angle:.0f}°" for angle in np.rad2deg(image.angles))
        _picture(axes, _brighter(image.pixels), title)
        for view in sighting.views:
            if view.quality is not Quality.MISSING:
                style = "--" if view.reflections else "-"
                _outline(axes, finger.lens, view.rays, OF_QUALITY[view.quality], style)
        for ghost in sighting.ghosts:
            _outline(axes, finger.lens, ghost.rays, OF_QUALITY[Quality.GHOST], ":")
        axes.set(xlim=_seen_columns(shots), ylim=(len(image.labels), 0))
    kinds = {one.name.lower().replace("_", " "): (OF_QUALITY[one], "-") for one in OF_QUALITY}
    del kinds["ghost"]
    kinds |= {"by a mirror": ("grey", "--"), "no view that is asked for": ("grey", ":")}
    handles = [Patch(edgecolor=color, fill=False, ls=dash) for color, dash in kinds.values()]
    legend_below(drawing, handles, kinds)
    return drawing


def draw_masks(shots: Sequence[Shot], ours: str, paper: str) -> Figure:
    """The paper's masks, and both kinds of corners at one corner of a pad."""
    (image, sighting), route = shots[1], PaperRoute()
    gray = brightness(cv2.split(image.pixels))
    masks = {
        "brightness": gray,
        "global": global_mask(gray, route.threshold),
        "adaptive": adaptive_mask(gray, route.block, route.share),
        "combined": combined_mask(gray, route.threshold, route.block, route.share),
    }
    drawing, [[*parts, axes]] = new_figure(1, len(masks) + 1, height=2.5)
    for part, (name, mask) in zip(parts, masks.items(), strict=True):
        _picture(part, mask, name)
        part.set_xlim(_seen_columns(shots))
    _picture(axes, _brighter(image.pixels), "one corner")
    whole = [view for view in image.views if view.complete] or list(image.views)
    view = max(whole, key=lambda view: np.ptp(view.corners, axis=0).min())
    corner = view.corners[1]
    axes.set(xlim=corner[0] + np.array([-14, 26]), ylim=corner[1] + np.array([30, -20]))
    polygons = np.concatenate([np.zeros((0, 2)), *route.corners(image.pixels)])
    marks = [(paper, polygons, "s", PALETTE[1]), ("true", view.corners, "o", "white")]
    if (found := sighting.view(view.pad, view.path)) is not None:
        marks.append((ours, found.corners, "x", PALETTE[5]))
    for name, corners, marker, color in marks:
        axes.plot(*corners.T, marker, color=color, markersize=8, fillstyle="none", label=name)
    legend = drawing.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=3)
    legend.get_frame().set(facecolor="0.45", visible=True)
    return drawing


def draw_imprints(finger: FingerSensor, touches: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Pads unwarped, and what has changed on them, as `unwarp_touches` returns them."""
    lengths, longest = finger.catalog.lengths, max(finger.catalog.lengths.values())
    titles = lengths | {f"{pad},\nchange": length for pad, length in lengths.items()}
    drawing, grid = new_figure(len(touches), len(titles), height=1.25 * len(touches) + 0.4)
    # Names stand upright over pads that are narrower than they are.
    turn = 0 if finger.width > WIDE * longest else 90
    for axes, title in zip(grid[0], titles, strict=True):
        axes.set_title(drawn_name(title), fontsize=8, rotation=turn)
    for row, (kind, shown) in zip(grid, touches.items(), strict=True):
        row[0].set_ylabel(kind, fontsize=8)
        for axes, (title, length) in zip(row, titles.items(), strict=True):
            axes.spines[:].set_visible(False)
            axes.set(xticks=[], yticks=[])
            if title in shown:
                extent = (0, finger.width, length, 0)
                axes.imshow(shown[title], extent=extent, interpolation="nearest")
            axes.set(xlim=(0, finger.width), ylim=(longest, 0), aspect="equal")
    return drawing
