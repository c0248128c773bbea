"""Figures of a scene show the numbers of its views, and nothing stands on anything else."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from designopt import UserError
from designopt.plot.figures import style
from optics.plot import scene_figures
from optics.plot.scene_figures import poses_figure, resolution, sweep_figure
from tests.optics.drawn_finger import (
    LAYOUT,
    POSES,
    WORDS,
    at,
    finger,
    finger_views,
    intervals,
    surfaces,
    views_at,
)

NAMES = [part.name for part in LAYOUT.pads]


def first(count):
    return POSES[:count], jax.tree.map(lambda leaf: leaf[:count], finger_views())


@pytest.mark.parametrize(("count", "shape"), [(3, (1, 3)), (4, (2, 2))])
def test_poses_stand_side_by_side_at_one_scale_with_one_legend(count, shape):
    poses, views = first(count)
    with style():
        figure = poses_figure(finger(), poses, views)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    assert len(figure.axes) == count
    place = figure.axes[0].get_subplotspec()
    assert place is not None
    assert place.get_geometry()[:2] == shape
    scales = [np.diff(axes.transData.transform([(0, 0), (1, 1)]), axis=0) for axes in figure.axes]
    # Equal scales are set up to a rounding of the layout, far below a pixel over the whole width.
    np.testing.assert_allclose(scales, scales[0][0, 0], rtol=1e-3)
    (legend,) = figure.legends
    assert all(axes.get_legend() is None for axes in figure.axes)
    boxes = [axes.get_tightbbox(canvas.get_renderer()) for axes in figure.axes]
    frame = legend.get_window_extent()
    assert not any(box is None or frame.overlaps(box) for box in boxes)
    assert figure.bbox.x0 <= frame.x0
    assert frame.x1 <= figure.bbox.x1
    words = [text.get_text() for text in legend.get_texts()]
    assert {*WORDS} & {*words} == {
        path
        for index, path in enumerate(WORDS)
        if any(len(intervals(at(views, i), pad, index)) for i in range(count) for pad in range(3))
    }


def test_a_figure_has_one_to_six_poses():
    poses, views = first(2)
    for count in (0, 7):
        chosen = np.zeros(count, int)
        many = jax.tree.map(lambda leaf, chosen=chosen: leaf[chosen], views)
        with pytest.raises(UserError, match=f"1 to 6 poses, not {count}"):
            poses_figure(finger(), poses[chosen], many)


def curve(figure, gid):
    (line,) = (line for axes in figure.axes for line in axes.lines if line.get_gid() == gid)
    return np.asarray(line.get_xydata())


def test_curves_are_the_views_numbers():
    pip = np.array([40.0, 0.0, 75.0, 20.0, 60.0])
    poses = np.radians(np.stack([pip, np.full(5, 10.0)], axis=-1))
    views = views_at(poses)
    figure = sweep_figure(finger(), poses, views)
    assert len(figure.axes) == 3
    assert figure.axes[-1].get_xlabel() == "PIP (°)"
    order = np.argsort(pip)
    measures = {
        "coverage": 100 * np.asarray(views.value.coverage()),
        "views": np.asarray(views.value.redundancy()),
        "least": resolution(finger(), views.value)[0],
        "greatest": resolution(finger(), views.value)[1],
    }
    for kind, values in measures.items():
        for pad, name in enumerate(NAMES):
            x, y = curve(figure, f"{kind}:{name}").T
            np.testing.assert_allclose(x, pip[order])
            np.testing.assert_array_equal(y, values[order, pad])
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == NAMES


def test_maps_are_the_views_numbers():
    pip, dip = [0.0, 60.0, 90.0], [0.0, 45.0]
    poses = np.radians([(a, b) for a in pip for b in dip])
    views = views_at(poses)
    coverage = np.asarray(views.value.coverage()).reshape(3, 2, 3)
    least = resolution(finger(), views.value)[0].reshape(3, 2, 3)
    order = np.array([3, 0, 5, 1, 4, 2])
    shuffled = jax.tree.map(lambda leaf: leaf[order], views)
    figure = sweep_figure(finger(), poses[order], shuffled)
    meshes = {mesh.get_gid(): mesh for axes in figure.axes for mesh in axes.collections}
    for pad, name in enumerate(NAMES):
        maps = {"coverage (%)": 100 * coverage, "least resolution (px/mm)": least}
        for kind, values in maps.items():
            # Rows of a map are its ordinates.
            shown = np.asarray(meshes[f"{kind}:{name}"].get_array())
            np.testing.assert_allclose(shown, values[..., pad].T)
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert len(panels) == 6
    assert (panels[3].get_xlabel(), panels[0].get_ylabel()) == ("PIP (°)", "DIP (°)")
    assert coverage.min() < 1


def test_what_is_not_seen_has_no_resolution():
    poses = np.radians([(a, b) for a in (0.0, 10.0) for b in (0.0, 10.0)])
    views = views_at(poses)
    none = jax.tree.map(lambda leaf: leaf.at[0].set(jnp.zeros_like(leaf[0])), views.value)
    views = dataclasses.replace(views, value=none)
    least, greatest = resolution(finger(), views.value)
    assert np.all(np.isnan(least[0]))
    assert np.all(np.isnan(greatest[0]))
    assert np.all(np.isfinite(least[1:]))
    row = jax.tree.map(lambda leaf: leaf[:2], views)
    assert np.isnan(curve(sweep_figure(finger(), poses[:2], row), "least:distal")[0, 1])


def test_other_sets_of_poses_are_no_sweep():
    poses, _ = first(4)
    for chosen in (poses[[0, 0, 0, 0]], poses[[0, 1, 1, 2]], poses[:0]):
        _, some = first(len(chosen))
        with pytest.raises(UserError, match="one joint angle or a grid of two"):
            sweep_figure(finger(), chosen, some)


@pytest.mark.parametrize("pose", [0, 2])
def test_resolution_is_the_slope_of_the_image_in_the_best_view(pose):
    views = at(finger_views(), pose)
    ends = surfaces(*POSES[pose])
    px_per_rad = 1080 / np.radians(160)
    least, greatest = resolution(finger(), views.value)
    places = (np.arange(20000) + 0.5) / 20000
    for pad, (start, end) in enumerate(ends[2:]):
        best = np.zeros(len(places))
        for index, word in enumerate(WORDS.values()):
            source = 15.75 + 16.99j
            for surface in word:
                a, b = ends[surface]
                source = a + (b - a) * np.conj((source - a) / (b - a))
            angles = np.unwrap(np.angle(start + places * (end - start) - source))
            slopes = px_per_rad * np.abs(np.gradient(angles, places)) / abs(end - start)
            for low, high in intervals(views, pad, index):
                inside = (low < places) & (places < high)
                best[inside] = np.maximum(best[inside], slopes[inside])
        seen = best[best > 0]
        # Between neighbouring places it changes by less than this; curves may cross in between.
        assert least[pad] == pytest.approx(seen.min(), rel=2e-3)
        assert greatest[pad] == pytest.approx(seen.max(), rel=2e-3)


def test_resolution_is_the_same_in_blocks_and_for_any_batch(monkeypatch):
    view = finger_views().value
    together = np.array(resolution(finger(), view))
    nested = jax.tree.map(lambda leaf: leaf.reshape(2, 2, *leaf.shape[1:]), view)
    np.testing.assert_array_equal(np.reshape(resolution(finger(), nested), (2, 4, 3)), together)
    monkeypatch.setattr(scene_figures, "BLOCK", 3)
    np.testing.assert_array_equal(resolution(finger(), view), together)
