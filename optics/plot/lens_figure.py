"""A lens's calibration in one figure: what is left, how sure the lens is, what to take next."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from designopt.plot.figures import PALETTE, new_figure
from optics.calibration.bundle import Parameters, lens_of, parameters_of
from optics.calibration.guidance import DeviationMap, Suggestion
from optics.calibration.lens import LensFit

ARROW = 0.08
"""Length of the largest mean residual's arrow, of the image's width."""

CELLS = (16, 12)
"""Of the image, in each of which residuals are averaged."""

LEAST = 5
"""Corners in a cell whose mean is drawn."""

BANDS = 24
"""Of angles from the axis, in each of which residuals are summarised."""


def draw_lens_fit(fit: LensFit, deviations: DeviationMap, suggestions: list[Suggestion]) -> Figure:
    """Residuals over the image and over the angle, deviations with pictures to take, the pupil.

    Args:
        fit: the lens and its pictures.
        deviations: of places, as predicted.
        suggestions: pictures to take next.
    """
    figure, axes = new_figure(2, 2, height=6.2)
    _residuals_over_image(axes[0, 0], fit)
    _residuals_over_angle(axes[0, 1], fit)
    _deviations(axes[1, 0], figure, fit, deviations, suggestions)
    _pupil(axes[1, 1], fit)
    return figure


def _residuals_over_image(axes: Axes, fit: LensFit) -> None:
    places, left = np.asarray(fit.sightings.places)[fit.used], fit.residuals[fit.used]
    size = np.array(fit.calibrated.size)
    cell = np.clip(((places + 0.5) / size * CELLS).astype(int), 0, np.array(CELLS) - 1)
    number = cell[:, 1] * CELLS[0] + cell[:, 0]
    counts = np.bincount(number, minlength=CELLS[0] * CELLS[1])

    def mean(values: Float[np.ndarray, " corners"]) -> Float[np.ndarray, " cells"]:
        sums = np.bincount(number, values, len(counts))
        return (sums / np.maximum(counts, 1))[counts >= LEAST]

    x, y, u, v = (mean(one) for one in (*places.T, *left.T))
    longest = max(float(np.hypot(u, v).max(initial=0.0)), 1e-6)
    scale = longest / (ARROW * size[0])
    axes.plot(*places.T, ".", color="0.85", markersize=1.5)
    axes.quiver(
        *(x, y, u, v), color=PALETTE[0], angles="xy", scale_units="xy", scale=scale, width=0.006
    )
    _as_image(axes, fit)
    axes.set_title(f"Mean residuals, longest {longest:.2g} px", loc="left")


def _residuals_over_angle(axes: Axes, fit: LensFit) -> None:
    lens, used = fit.calibrated.lens, fit.used
    away = np.asarray(fit.sightings.places)[used] - np.asarray(lens.principal)
    outwards = away / np.maximum(np.hypot(*away.T), 1e-9)[:, None]
    left, angles = fit.residuals[used], np.rad2deg(fit.angles()[used])
    across = left[:, 0] * outwards[:, 1] - left[:, 1] * outwards[:, 0]
    edges = np.linspace(0, angles.max() * (1 + 1e-9), BANDS + 1)
    for values, color, name in (
        (np.sum(left * outwards, axis=1), PALETTE[0], "radial"),
        (across, PALETTE[1], "tangential"),
    ):
        band = np.digitize(angles, edges) - 1
        groups = [values[band == i] for i in range(BANDS)]
        there = np.array([len(group) >= LEAST for group in groups])
        middle = ((edges[1:] + edges[:-1]) / 2)[there]
        means = np.array([np.mean(group) for group in groups if len(group) >= LEAST])
        sigmas = np.array([np.std(group) for group in groups if len(group) >= LEAST])
        axes.plot(middle, means, color=color, label=name)
        axes.fill_between(middle, means - sigmas, means + sigmas, color=color, alpha=0.18, lw=0)
    axes.set_xlabel("angle from the axis (°)")
    axes.set_ylabel("predicted − seen (px)")
    axes.set_title("Residuals: mean ± deviation", loc="left")
    axes.margins(y=0.25)  # room for the legend
    axes.legend(loc="upper center", ncols=2)


def _deviations(
    axes: Axes,
    figure: Figure,
    fit: LensFit,
    deviations: DeviationMap,
    suggestions: list[Suggestion],
) -> None:
    columns, rows = fit.calibrated.size
    shown = axes.imshow(
        deviations.deviations,
        extent=(-0.5, columns - 0.5, rows - 0.5, -0.5),
        cmap="cividis",
        aspect="equal",
    )
    label = "deviation of a place (px)"
    figure.colorbar(shown, ax=axes, label=label, orientation="horizontal", shrink=0.8)
    for number, one in enumerate(suggestions, 1):
        inside = one.outline[np.isfinite(one.outline[:, 0])]
        axes.plot(*inside.T, ".", color=PALETTE[number % len(PALETTE)], markersize=2)
        column, row = inside.mean(axis=0).tolist()
        axes.text(
            column, row, str(number), color="white", weight="bold", ha="center",
            va="center", bbox={"boxstyle": "circle", "fc": "black", "ec": "white", "alpha": 0.7},
        )  # fmt: skip
    _as_image(axes, fit)
    axes.grid(False)
    axes.set_title("Deviations; boards to take next" if suggestions else "Deviations", loc="left")


def _pupil(axes: Axes, fit: LensFit) -> None:
    calibrated = fit.calibrated
    angles = jnp.linspace(0, calibrated.widest, 100)
    parameters = jnp.asarray(parameters_of(calibrated.lens))

    def curve(values: Parameters) -> Float[jax.Array, " angles"]:
        return lens_of(values).shift(angles)

    shift = np.asarray(curve(parameters))
    slopes = np.asarray(jax.jacfwd(curve)(parameters))
    sigma = np.sqrt(np.einsum("ni,ij,nj->n", slopes, calibrated.covariance, slopes))
    degrees = np.rad2deg(np.asarray(angles))
    axes.plot(degrees, shift, color=PALETTE[2])
    axes.fill_between(
        degrees, shift - 2 * sigma, shift + 2 * sigma, color=PALETTE[2], alpha=0.25, lw=0
    )
    axes.set_xlabel("angle from the axis (°)")
    axes.set_ylabel("pupil before the axis's (mm)")
    axes.set_title(f"Pupil ({fit.pupil.value}), ± 2 deviations", loc="left")


def _as_image(axes: Axes, fit: LensFit) -> None:
    columns, rows = fit.calibrated.size
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), aspect="equal")
    axes.set_xlabel("column (px)")
    axes.set_ylabel("row (px)")
