"""Figures of a scene show the numbers of its views."""

import dataclasses

import jax
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from designopt import UserError
from designopt.plot.figures import style
from optics.plot import scene_figures
from optics.plot.scene_figures import poses_figure, resolution, sweep_figure
from tests.optics.extruded import (
    LAYOUT,
    POSES,
    WORDS,
    finned,
    pieces_of,
    unfolded,
    views_at,
    views_at_poses,
)
from tests.optics.scenes import posed

NAMES = [part.name for part in LAYOUT.pads]


def some(chosen):
    """Poses and what is seen in them."""
    return POSES[chosen], jax.tree.map(lambda leaf: leaf[chosen], views_at_poses(fin=True))


@pytest.mark.parametrize(("count", "shape"), [(3, (1, 3)), (4, (2, 2))])
def test_poses_stand_side_by_side_at_one_scale_with_one_legend(count, shape):
    poses, views = some(slice(count))
    with style():
        figure = poses_figure(finned(), poses, views)
        FigureCanvasAgg(figure).draw()
    assert len(figure.axes) == count
    place = figure.axes[0].get_subplotspec()
    assert place is not None
    assert place.get_geometry()[:2] == shape
    scales = [np.diff(axes.transData.transform([(0, 0), (1, 1)]), axis=0) for axes in figure.axes]
    # Equal scales are set up to a rounding of the layout, far below a pixel over the whole width.
    np.testing.assert_allclose(scales, scales[0][0, 0], rtol=1e-3)
    (legend,) = figure.legends
    assert all(axes.get_legend() is None for axes in figure.axes)
    words = {text.get_text() for text in legend.get_texts()}
    seeing = np.unique(views.value.path[views.value.present])
    assert {*WORDS} & words == {[*WORDS][path] for path in seeing}


def test_a_figure_has_one_to_six_poses():
    for count in (0, 7):
        with pytest.raises(UserError, match=f"1 to 6 poses, not {count}"):
            poses_figure(finned(), *some(np.zeros(count, int)))


def curve(figure, gid):
    (line,) = (line for axes in figure.axes for line in axes.lines if line.get_gid() == gid)
    return np.asarray(line.get_xydata())


def test_curves_are_the_views_numbers():
    pip = np.array([40.0, 0.0, 75.0, 20.0, 60.0])
    poses = np.radians(np.stack([pip, np.full(5, 10.0)], axis=-1))
    views = views_at(poses, finned())
    figure = sweep_figure(finned(), poses, views)
    assert len(figure.axes) == 3
    assert figure.axes[-1].get_xlabel() == "PIP (°)"
    order, measured = np.argsort(pip), resolution(finned(), views.value)
    measures = {
        "coverage": 100 * np.asarray(views.value.coverage()),
        "views": np.asarray(views.value.redundancy()),
        "least": measured[0],
        "greatest": measured[1],
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
    views = views_at(poses, finned())
    coverage, least = np.asarray(views.value.coverage()), resolution(finned(), views.value)[0]
    assert coverage.min() < 1
    order = np.array([3, 0, 5, 1, 4, 2])
    shuffled = jax.tree.map(lambda leaf: leaf[order], views)
    figure = sweep_figure(finned(), poses[order], shuffled)
    meshes = {mesh.get_gid(): mesh for axes in figure.axes for mesh in axes.collections}
    for kind, values in (("coverage (%)", 100 * coverage), ("least resolution (px/mm)", least)):
        for pad, name in enumerate(NAMES):
            # Rows of a map are its ordinates.
            shown = np.asarray(meshes[f"{kind}:{name}"].get_array())
            np.testing.assert_allclose(shown, values[:, pad].reshape(3, 2).T)
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert len(panels) == 6
    assert (panels[3].get_xlabel(), panels[0].get_ylabel()) == ("PIP (°)", "DIP (°)")


def test_what_is_not_seen_has_no_resolution():
    poses = np.radians([(a, 0.0) for a in (0.0, 10.0)])
    views = views_at(poses, finned())
    none = jax.tree.map(lambda leaf: np.stack([np.zeros_like(leaf[0]), leaf[1]]), views.value)
    views = dataclasses.replace(views, value=none)
    least, greatest = resolution(finned(), views.value)
    assert np.isnan([least[0], greatest[0]]).all()
    assert np.isfinite([least[1], greatest[1]]).all()
    assert np.isnan(curve(sweep_figure(finned(), poses, views), "least:distal")[0, 1])


def test_other_sets_of_poses_are_no_sweep():
    for chosen in ([0, 0, 0, 0], [0, 1, 1, 2], []):
        with pytest.raises(UserError, match="one joint angle or a grid of two"):
            sweep_figure(finned(), *some(np.array(chosen, int)))


@pytest.mark.parametrize("pose", [0, 3])
def test_resolution_is_the_slope_of_the_image_in_the_best_view(pose):
    section, view = posed(finned(), POSES[pose]), some(pose)[1].value
    px_per_rad = float(finned().camera.pixels) / section.field_of_view
    least, greatest = resolution(finned(), view)
    places = (np.arange(20000) + 0.5) / 20000
    for pad, (start, end) in enumerate(section.complex_ends[2:5]):
        best = np.zeros(len(places))
        for index, word in enumerate(WORDS.values()):
            angles = np.unwrap(np.angle(unfolded(section, word, start + places * (end - start))))
            slopes = px_per_rad * np.abs(np.gradient(angles, places)) / abs(end - start)
            for low, high in pieces_of(view, pad, index):
                inside = (low < places) & (places < high)
                best[inside] = np.maximum(best[inside], slopes[inside])
        seen = best[best > 0]
        # Between neighbouring places it changes by less than this; curves may cross in between.
        assert least[pad] == pytest.approx(seen.min(), rel=2e-3)
        assert greatest[pad] == pytest.approx(seen.max(), rel=2e-3)


def test_resolution_is_the_same_in_blocks_and_for_any_batch(monkeypatch):
    view = some(slice(4))[1].value
    together = np.array(resolution(finned(), view))
    nested = jax.tree.map(lambda leaf: leaf.reshape(2, 2, *leaf.shape[1:]), view)
    np.testing.assert_array_equal(np.reshape(resolution(finned(), nested), (2, 4, 3)), together)
    monkeypatch.setattr(scene_figures, "BLOCK", 3)
    np.testing.assert_array_equal(resolution(finned(), view), together)
