"""The study's figures."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from designopt.plot.figures import (
    MARKERS,
    PALETTE,
    angle_ticks,
    label_plainly,
    legend_below,
    new_figure,
    share_limits,
)
from designopt.study.results import Figure
from studies.models.grasp.analysis import CLOSED, Analysis, radius_of
from studies.models.grasp.closing import Path
from studies.models.grasp.free_body import pin_places
from studies.models.grasp.pinch import APPROACH, least_place

BLUE, VERMILION, GREEN, PINK = PALETTE[:4]


def figures(found: Analysis) -> list[Figure]:
    """Every figure of the study."""
    return [
        sequences(found),
        paths(found),
        stability_map(found),
        over_diameter(found),
        *([] if all(pinch.holds for pinch, _, _ in found.pinches) else [pinches(found)]),
    ]


def sequences(found: Analysis) -> Figure:
    """The finger in section: pinching, closing on a circle and on a square."""
    pinch = next((path for one, path, _ in found.pinches if one.holds), None)
    shown: list[tuple[str, Path, tuple[int, ...]]] = [
        ("Free closing", found.free, (0, 20, 34, 45, 56))
    ]
    if pinch is not None:
        shown.append(("Pinch: DIP stays straight", pinch, (0, 8, 16, APPROACH, 120)))
    touching = found.adaptive.gaps[: CLOSED + 1] < 1e-7
    first, both = (
        int(np.argmax(pads)) if pads.any() else CLOSED
        for pads in (touching[:, 0], touching.all(axis=1))
    )
    shown.append(
        (
            f"Adaptive: a circle of {2 * radius_of(found.adaptive):.3g} mm",
            found.adaptive,
            (0, first, both),
        )
    )
    if found.box is not None:
        shown.append(("A square of 24 mm", found.box, (0, 26, 38, CLOSED)))
    rows = -(-len(shown) // 2)
    drawing, axes = new_figure(rows, 2, height=3.6 * rows)
    for axis, (title, path, states) in zip(axes.flat, shown, strict=False):
        if path.problem.thing is not None:
            outline = np.asarray(path.problem.thing.outline())
            axis.fill(*outline.T, facecolor="0.85", edgecolor="0.5", zorder=0, label="object")
        usable = [state for state in states if path.ok[state]]
        for rank, state in enumerate(usable):
            last = rank == len(usable) - 1
            _finger(axis, path, state, 1.0 if last else 0.25 + 0.3 * rank / len(usable))
        if usable:
            _pushes(axis, path, usable[-1])
        axis.set(title=title, xlabel="x (mm)", aspect="equal")
    for axis in axes[:, 0]:
        axis.set_ylabel("y (mm)")
    share_limits(axes.flat[: len(shown)])
    # Every name once, by what is drawn full: the last of its name.
    named = {
        label: handle
        for axis in axes.flat[: len(shown)]
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    for axis in axes.flat[len(shown) :]:  # where no drawing stands the legend does
        axis.set_axis_off()
        axis.legend(named.values(), named.keys(), loc="center")
    if axes.size == len(shown):
        legend_below(drawing, named.values(), named.keys())
    return Figure(
        "closing",
        "Closing sequences in section",
        "The last state is drawn full, those before it fainter. Arrows are contact forces on the "
        "finger in the last state, 1 mm for 1 N. The object is fixed beside the proximal phalanx.",
        drawing,
    )


def _finger(axis: Axes, path: Path, state: int, strength: float) -> None:
    finger = path.problem.finger
    body, joints = finger.body, path.joints[state]
    straight = {name: np.asarray(getattr(finger.pins, name)) for name in "FEDCGH"}
    at = pin_places(straight, float(body.intermediate), joints)
    tilts = (0.0, -joints[0], -joints[0] - joints[1])
    for start, length, tilt, origin in (
        (-body.proximal, body.proximal, tilts[0], at["A"]),
        (0.0, body.intermediate, tilts[1], at["A"]),
        (0.0, body.distal, tilts[2], at["B"]),
    ):
        corners = np.array(
            [
                [start, body.palmar],
                [start + length, body.palmar],
                [start + length, body.dorsal],
                [start, body.dorsal],
                [start, body.palmar],
            ]
        )
        axis.plot(*_placed(corners, tilt, origin).T, color="0.35", linewidth=0.7, alpha=strength,
                  label="phalanges")  # fmt: skip
    h = body.axis_height
    for low, high, tilt, origin in (
        (-body.proximal + body.rim, -h, tilts[0], at["A"]),
        (h, body.intermediate - h, tilts[1], at["A"]),
        (h, body.distal - body.rim, tilts[2], at["B"]),
    ):
        pad = np.array([[low, body.palmar], [high, body.palmar]])
        axis.plot(*_placed(pad, tilt, origin).T, color=BLUE, linewidth=2.5, alpha=strength,
                  label="pads")  # fmt: skip
    for chain in ("FED", "DCHD", "GH", "AB"):
        line = np.array([at[name] for name in chain])
        color, label = ("0.2", "joints") if chain == "AB" else (VERMILION, "linkage")
        axis.plot(*line.T, "-o", color=color, linewidth=1.1, markersize=2.2, alpha=strength,
                  label=label)  # fmt: skip


def _placed(points: np.ndarray, tilt: float, origin: np.ndarray) -> np.ndarray:
    c, s = math.cos(tilt), math.sin(tilt)
    return origin + points @ np.array([[c, s], [-s, c]])


def _pushes(axis: Axes, path: Path, state: int) -> None:
    body, joints = path.problem.finger.body, path.joints[state]
    origin, tilt = np.zeros(2), -joints[0]
    for pad in (0, 1):
        for j in range(pad * path.per_pad, (pad + 1) * path.per_pad):
            force = path.forces[state, j]
            if force > 1e-3:
                foot = np.array([[path.along[state, j], body.palmar]])
                place = _placed(foot, tilt, origin)[0]
                # Drawn along the pad's normal, which it is but for contacts at a pad's end.
                push = force * np.array([-math.sin(tilt), math.cos(tilt)])
                axis.annotate(
                    "",
                    place,
                    place - push,
                    arrowprops={"arrowstyle": "-|>", "color": GREEN, "linewidth": 1.6},
                )
                axis.update_datalim([place - push])
                # An arrow has no entry in a legend of its own.
                axis.plot([], [], color=GREEN, marker=">", linewidth=1.6, label="contact force")
        origin = _placed(np.array([[body.intermediate, 0.0]]), tilt, origin)[0]
        tilt -= joints[1]


def paths(found: Analysis) -> Figure:
    """Joints and forces over the motor's angle: free, blocked, and against a load."""
    drawing, axes = new_figure(2, 2, height=6.0)
    last = 1.03 * found.finger.body.range_deg
    shown = (("free", found.free, "-"), ("circle", found.adaptive, "-"))
    shown += (("circle, loaded", found.loaded, "--"),)
    for index, (name, path, style) in enumerate(shown):
        closing = np.flatnonzero(path.ok[: CLOSED + 1])
        angle = np.degrees(path.commands[closing])
        color = PALETTE[index]
        for column, joint in enumerate(("PIP", "DIP")):
            axes[0, column].plot(
                angle, np.degrees(path.joints[closing, column]), style, color=color, label=name
            )
            axes[0, column].set(
                ylabel=f"{joint} flexion (°)", title=joint, ylim=(-0.03 * last, last)
            )
        axes[1, 0].plot(angle, path.motor[closing], style, color=color)
        if path.per_pad:
            for pad, mark in ((0, "s"), (1, "o")):
                axes[1, 1].plot(
                    angle,
                    path.push(pad)[closing],
                    style,
                    color=color,
                    marker=mark,
                    markevery=8,
                    markersize=4,
                    label=f"{name}, {('intermediate', 'distal')[pad]}",
                )
    axes[1, 0].set(ylabel="motor moment (N mm)", title="Motor")
    axes[1, 1].set(ylabel="contact force (N)", title="Contact forces")
    axes[1, 1].legend(loc="upper left", fontsize=8)
    for axis in axes.flat:
        axis.set(xlabel="motor angle α (°)")
    legend_below(drawing, *axes[0, 0].get_legend_handles_labels())
    return Figure(
        "paths",
        "Equilibria over the motor's angle",
        "Free closing, and closing on a circle that blocks the intermediate phalanx. Dashed: the "
        "same against moments that pull the joints open.",
        drawing,
    )


def stability_map(found: Analysis) -> Figure:
    """φ₂/φ₁ over all postures, and where a contact must lie for the grasp to hold both pads."""
    body = found.finger.body
    drawing, axes = new_figure(1, 2, height=3.6)
    angles = np.degrees(found.angles)
    ratio = found.ratios[..., 1] / found.ratios[..., 0]
    place = least_place(ratio, found.angles[None, :], float(body.intermediate))
    for axis, values, title, unit in (
        (axes[0, 0], ratio, "φ₂/φ₁", ""),
        (axes[0, 1], place, "least k₂ with f₁ > 0", " (mm)"),
    ):
        filled = axis.contourf(angles, angles, values.T, levels=12, cmap="cividis", alpha=0.75)
        lines = axis.contour(angles, angles, values.T, levels=6, colors="black", linewidths=0.6)
        axis.clabel(lines, fontsize=7, fmt="%.2g")
        drawing.colorbar(filled, ax=axis, label=title + unit, shrink=0.72)
        axis.set(xlabel="PIP flexion (°)", ylabel="DIP flexion (°)", title=title)
        axis.set(xticks=angle_ticks(angles[-1]), yticks=angle_ticks(angles[-1]), aspect="equal")
        axis.grid(visible=False)
    return Figure(
        "stability_map",
        "Where a grasp holds both pads",
        "Left: the ratio of what the motor gives DIP to what it gives PIP. Right: the contact on "
        "the distal pad must lie beyond this distance from the DIP axis, or the intermediate "
        f"phalanx leaves the object, once the spring counts for nothing; the pad reaches from "
        f"{body.axis_height:g} to {body.distal - body.rim:g} mm.",
        drawing,
    )


def over_diameter(found: Analysis) -> Figure:
    """Posture and forces on the circles, with the motor at its end."""
    drawing, axes = new_figure(1, 2, height=3.6)
    diameters = np.array([2 * radius_of(path) for path in found.circles])
    ok = np.array([path.ok[CLOSED] for path in found.circles])
    joints = np.degrees([path.joints[CLOSED] for path in found.circles])
    forces = np.array([[path.push(0)[CLOSED], path.push(1)[CLOSED]] for path in found.circles])
    for column, (joint, pad) in enumerate((("PIP", "intermediate"), ("DIP", "distal"))):
        mark, color = MARKERS[column], PALETTE[column]
        style = "-" if column else "--"
        axes[0, 0].plot(
            diameters[ok], joints[ok, column], style, marker=mark, color=color, label=joint
        )
        axes[0, 1].plot(
            diameters[ok], forces[ok, column], style, marker=mark, color=color, label=f"{pad} pad"
        )
    axes[0, 0].set(ylabel="flexion (°)", title="Posture")
    axes[0, 1].set(ylabel="contact force (N)", title="Forces")
    for axis in axes.flat:
        axis.set(xlabel="diameter of the circle (mm)", ylim=(0, None))
        axis.legend(loc="best")
    end = math.degrees(found.adaptive.commands[CLOSED])
    return Figure(
        "over_diameter",
        "Closing on circles",
        f"With the motor at {end:.0f}°. The circles lie on the proximal pad. A pad of force 0 "
        "does not touch.",
        drawing,
    )


def pinches(found: Analysis) -> Figure:
    """The limit of every pinch by the formula, between what loading showed."""
    drawing, axes = new_figure(1, 2, height=3.6)
    limit, loading = axes[0]
    pips = list(dict.fromkeys(pinch.pip for pinch, _, _ in found.pinches))
    for index, pip in enumerate(pips):
        color, mark = PALETTE[index % len(PALETTE)], MARKERS[index % len(MARKERS)]
        label = f"PIP {math.degrees(pip):.0f}°"
        mine = [(one, shown) for one, _, shown in found.pinches if one.pip == pip]
        yields = [(one, shown) for one, shown in mine if not one.holds]
        if yields:
            limit.plot(
                [one.place for one, _ in yields],
                [one.limit for one, _ in yields],
                mark,
                color=color,
                markerfacecolor="none",
                markersize=8,
                label=f"{label}, formula",
            )
            limit.errorbar(
                [one.place for one, _ in yields],
                [(shown.low + shown.high) / 2 for _, shown in yields],
                [(shown.high - shown.low) / 2 for _, shown in yields],
                fmt="none",
                color=color,
                capsize=4,
                label=f"{label}, loading",
            )
        for one, path, _ in found.pinches:
            if one.pip == pip and not one.holds:
                states = np.flatnonzero(path.ok)
                states = states[states >= APPROACH]
                loading.plot(
                    path.motor[states] / one.limit,
                    np.degrees(path.joints[states, 1]),
                    color=color,
                    linewidth=1,
                    linestyle=("-", "--", ":")[index % 3],
                )
    limit.set(xlabel="k₂ (mm)", ylabel="largest motor moment (N mm)", yscale="log")
    limit.set(title="Where a pinch gives way")
    label_plainly(limit.yaxis)
    limit.legend(loc="upper left", fontsize=8)
    loading.axvline(1.0, color="0.4", linewidth=0.8)
    loading.set(xlabel="motor moment over the formula's limit", ylabel="DIP flexion (°)")
    loading.set(title="DIP under load")
    return Figure(
        "pinches",
        "The limits of a pinch",
        "Left: the moment at which the straight distal pad gives way, by the formula and between "
        "the last state that held and the first that did not. Contacts that are not shown hold at "
        "any moment. Right: DIP while they are loaded.",
        drawing,
    )
