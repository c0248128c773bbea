"""The study's figures."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Polygon

from designopt.plot.figures import PALETTE, legend_below, new_figure
from designopt.plot.typesetting import drawn_name
from designopt.study.results import Figure
from perception.lens import Lens, TangentPlane
from perception.masks import adaptive_mask, brightness, combined_mask, global_mask
from perception.paper_route import PaperRoute
from perception.quality import Quality
from perception.unwarping import PER_MM
from studies.models.sensor.finger_sensor import FingerSensor
from studies.tactile_images.found import OURS, PAPER, Found
from studies.tactile_images.frames import Frame
from studies.tactile_images.pictures import Shown, Touch
from studies.tactile_images.spec import TactileImagesSpec
from studies.tactile_images.tables import all_views, of, paper_found, share

GRAY = 0.5
"""No difference, in a picture of differences."""

MARGIN = 0.02
"""Of an image's width, beside the pads that are seen in it."""

WIDE = 0.7
"""Width over length of pads that have room for their names above them."""

NARROWEST = 0.8
"""Width of what is shown of an image, as a part of its height: titles have room above it."""

OF_QUALITY = {Quality.COMPLETE: PALETTE[5], Quality.CLIPPED: PALETTE[6], Quality.MERGED: PALETTE[3],
              Quality.FLAT: PALETTE[0], Quality.AMBIGUOUS: PALETTE[2], Quality.BLURRED: PALETTE[1],
              Quality.LOW_CONTRAST: "0.6"}  # fmt: skip


def figures(spec: TactileImagesSpec, found: Found) -> list[Figure]:
    """Every figure of the study."""
    return [
        views_figure(found.finger, found.shown),
        masks_figure(found.shown),
        imprints_figure(found.finger, found.shown),
        errors_figure(spec, found.frames),
        success_figure(found.frames),
    ]


def _picture(axes: Axes, pixels: np.ndarray, title: str) -> None:
    axes.imshow(pixels, cmap="gray", vmin=0, vmax=255)
    axes.grid(visible=False)
    axes.set_axis_off()
    axes.set_title(title)


def _brighter(pixels: np.ndarray) -> np.ndarray:
    """For the eye: square root of the light."""
    return (255 * np.sqrt(pixels / 255)).astype(np.uint8)


def _outline(axes: Axes, lens: Lens, rays: np.ndarray, color: str, style: str) -> None:
    """The outline between four corners, its sides straight in space."""
    plane = TangentPlane(float(rays[:, 0].mean()))
    corners = plane.flat(rays)
    parts = np.linspace(0, 1, 25)[:, None]
    sides = [corners[i - 1] + parts * (corners[i] - corners[i - 1]) for i in range(4)]
    places = lens.project(plane.rays(np.concatenate(sides)))
    axes.add_patch(Polygon(places, fill=False, color=color, linestyle=style, linewidth=1.2))


def _seen_columns(shown: Shown) -> tuple[float, float]:
    """From where to where pads are seen in any of the frames, with a margin, px."""
    seen = np.any([image.labels > 0 for image, _ in shown.frames], axis=(0, 1))
    first, *_, last = np.flatnonzero(seen)
    rows = len(shown.frames[0][0].labels)
    half = max((last - first) / 2 + MARGIN * len(seen), NARROWEST * rows / 2)
    middle = (first + last) / 2
    return max(middle - half, 0), min(middle + half, len(seen))


def views_figure(finger: FingerSensor, shown: Shown) -> Figure:
    """Frames with what was found in them."""
    drawing, grid = new_figure(1, len(shown.frames), height=3.3)
    for axes, (image, sighting) in zip(grid[0], shown.frames, strict=True):
        degrees = np.rad2deg(image.angles)
        _picture(axes, _brighter(image.pixels), " / ".join(f"{angle:.0f}°" for angle in degrees))
        for view in sighting.views:
            if view.quality is not Quality.MISSING:
                style = "--" if view.reflections else "-"
                _outline(axes, finger.lens, view.rays, OF_QUALITY[view.quality], style)
        for ghost in sighting.ghosts:
            _outline(axes, finger.lens, ghost.rays, "white", ":")
        axes.set(xlim=_seen_columns(shown), ylim=(len(image.labels), 0))
    handles = [
        *(
            Patch(edgecolor=color, fill=False, label=quality.name.lower().replace("_", " "))
            for quality, color in OF_QUALITY.items()
        ),
        Patch(edgecolor="grey", fill=False, linestyle="--", label="by a mirror"),
        Patch(edgecolor="grey", fill=False, linestyle=":", label="no view that is asked for"),
    ]
    legend_below(drawing, handles, [str(handle.get_label()) for handle in handles])
    return Figure(
        "views",
        "What the camera sees, and what was found",
        "Frames of one made finger with things pressed into its pads, at four pairs of "
        f"{' / '.join(name.upper() for name in finger.model.names)} "
        "(brightened for the eye). Outlines join the corners that were found by sides that are "
        "straight in space, which the lens bends.",
        drawing,
    )


def masks_figure(shown: Shown) -> Figure:
    """The paper's masks, and both kinds of corners at one corner of a pad."""
    image, sighting = shown.frames[1]
    route = PaperRoute()
    gray = brightness(image.pixels)
    masks = {
        "brightness": gray,
        "global": global_mask(gray, route.threshold),
        "adaptive": adaptive_mask(gray, route.block, route.share),
        "combined": combined_mask(gray, route.threshold, route.block, route.share),
    }
    drawing, grid = new_figure(1, len(masks) + 1, height=2.5)
    for axes, (name, mask) in zip(grid[0], masks.items(), strict=False):
        _picture(axes, mask, name)
        axes.set_xlim(_seen_columns(shown))
    axes = grid[0, -1]
    _picture(axes, _brighter(image.pixels), "one corner")
    whole = [view for view in image.views if view.complete] or list(image.views)
    view = max(whole, key=lambda view: np.ptp(view.corners, axis=0).min())
    corner = view.corners[1]
    axes.set(xlim=corner[0] + np.array([-14, 26]), ylim=corner[1] + np.array([30, -20]))
    ours = sighting.view(view.pad, view.path)
    polygons = np.concatenate([np.zeros((0, 2)), *route.corners(image.pixels)])
    marks = [(PAPER, polygons, "s", PALETTE[1]), ("true", view.corners, "o", "white")]
    if ours is not None:
        marks.append((OURS, ours.corners, "x", PALETTE[5]))
    for name, corners, marker, color in marks:
        filled = {"markerfacecolor": "none"} if marker != "x" else {}
        axes.plot(*corners.T, marker, color=color, markersize=8, label=name, **filled)
    legend = drawing.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=3)
    legend.get_frame().set(facecolor="0.45", visible=True)
    return Figure(
        "masks",
        "Thresholds, and a corner",
        "The paper's thresholds on the brightest channel (its Fig. 4.2), and one corner of the "
        "largest whole view: a polygon has its corner on the mask's outline, lines that are fitted "
        "to the sides meet where the pad's rectangle has its own.",
        drawing,
    )


def imprints_figure(finger: FingerSensor, shown: Shown) -> Figure:
    """Unwarped pads and their differences, as in the paper's Figs. 4.4 to 4.6."""
    pads = list(finger.catalog.lengths)
    lengths = [finger.catalog.lengths[pad] for pad in pads]
    rows = len(shown.touches) + 1
    drawing, grid = new_figure(rows, 2 * len(pads), height=1.25 * rows + 0.4)
    for row, touch in enumerate([Touch("untouched", shown.untouched, {}), *shown.touches]):
        for column, pad in enumerate(pads):
            plain, changed = grid[row, column], grid[row, len(pads) + column]
            for axes, pictures in ((plain, touch.pictures), (changed, touch.differences)):
                axes.grid(visible=False)
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set_visible(False)
                extent = (0, finger.width, finger.catalog.lengths[pad], 0)
                if pad in pictures:
                    picture = pictures[pad]
                    seen = (
                        np.sqrt(picture / 255)
                        if picture.dtype == np.uint8
                        else np.clip(GRAY + GRAY * picture, 0, 1)
                    )
                    axes.imshow(seen, extent=extent, interpolation="nearest")
                axes.set(xlim=(0, finger.width), ylim=(max(lengths), 0), aspect="equal")
            if row == 0:
                # Names stand upright over pads that are narrower than they are.
                turn = 0 if finger.width > WIDE * max(lengths) else 90
                plain.set_title(drawn_name(pad), fontsize=8, rotation=turn)
                changed.set_title(drawn_name(f"{pad},\nchange"), fontsize=8, rotation=turn)
        grid[row, 0].set_ylabel(touch.kind, fontsize=8)
    return Figure(
        "imprints",
        "Unwarped pads and difference images",
        f"Every pad in its best view in one pose, straight from above to scale, {PER_MM:g} "
        "samples per mm, its first end on top (left, brightened for the eye); and the relative "
        "difference from the same view untouched (right).",
        drawing,
    )


def errors_figure(spec: TactileImagesSpec, frames: list[Frame]) -> Figure:
    """Distribution of corner errors and of unwarping errors."""
    at_severity = [frame for frame in frames if frame.severity == spec.severity]
    seen = all_views(at_severity)
    drawing, (axes,) = new_figure(1, 2, height=3.0)
    corner = {
        OURS: [view.errors for view in seen],
        PAPER: [view.paper_errors for view in seen],
    }
    pads = [one for frame in at_severity for one in frame.unwarped]
    place = {
        "rays and homography": [one.errors for one in pads],
        "affine map (paper)": [one.affine_errors for one in pads],
    }
    for one, curves, label in ((axes[0], corner, "corner error (px)"),
                               (axes[1], place, "place on the pad off by (mm)")):  # fmt: skip
        for index, (name, errors) in enumerate(curves.items()):
            numbers = np.sort(np.concatenate([*errors, np.zeros(0)]))
            numbers = numbers[np.isfinite(numbers)]
            if len(numbers):
                parts = 100 * (np.arange(len(numbers)) + 1) / len(numbers)
                one.plot(numbers, parts, color=PALETTE[index], linestyle=("-", "--")[index],
                         label=name)  # fmt: skip
        one.set(xscale="log", xlabel=label, ylabel="part below (%)", ylim=(0, 101))
        one.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return Figure(
        "errors",
        "How far off corners and places are",
        f"Left: corners of the views that were found, all exposures at severity {spec.severity:g}. "
        "Right: places on unwarped pads, each pad in its best view.",
        drawing,
    )


def success_figure(frames: list[Frame]) -> Figure:
    """Views found at every exposure and severity."""
    conditions = sorted({(frame.severity, frame.gain) for frame in frames})
    ours = [100 * share([v.found for v in all_views(of(frames, g, s))]) for s, g in conditions]
    paper = [
        100 * share([paper_found(view) for view in all_views(of(frames, g, s))])
        for s, g in conditions
    ]
    drawing, ((axes,),) = new_figure(1, 1, height=2.8)
    at = np.arange(len(conditions))
    axes.bar(at - 0.2, ours, 0.38, color=PALETTE[0], label="lines in ray space")
    axes.bar(at + 0.2, paper, 0.38, color=PALETTE[6], hatch="//", label="paper's route")
    axes.axhline(95, color="black", linestyle=":", linewidth=1, label="target at severity 1")
    axes.set(
        xticks=at,
        xticklabels=[f"severity {severity:g}\ngain {gain:g}" for severity, gain in conditions],
        ylabel="complete views found (%)",
        ylim=(0, 102),
    )
    axes.grid(visible=False, axis="x")
    legend_below(drawing)
    return Figure(
        "success",
        "Views found, by exposure and severity",
        "Of the complete views off the border. The paper's route has one fixed threshold.",
        drawing,
    )
