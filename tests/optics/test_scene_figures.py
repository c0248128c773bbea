"""Figures of a scene show the numbers of its views, and the legend stands on nothing else."""

import jax
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from designopt import UserError
from designopt.plot.figures import style
from optics.plot.scene_figures import poses_figure, sweep_figure
from tests.optics.extruded import LAYOUT, POSES, WORDS, finned, views_at, views_at_poses

NAMES = [part.name for part in LAYOUT.pads]


def some(chosen):
    """Poses and what is seen in them."""
    return POSES[chosen], jax.tree.map(lambda leaf: leaf[chosen], views_at_poses(fin=True))


@pytest.mark.parametrize(("count", "shape"), [(3, (1, 3)), (4, (2, 2))])
def test_poses_stand_side_by_side_at_one_scale_with_one_legend(count, shape):
    poses, views = some(slice(count))
    with style():
        figure = poses_figure(finned(), poses, views)
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


def resolutions(poses):
    """Least, median and greatest of every pad, of which the distal one is not seen in pose 1."""
    found = 2 + np.arange(9.0 * len(poses)).reshape(-1, 3, 3)
    found[1, 2] = 0
    return found, np.where(found > 0, found, np.nan)


def test_curves_are_the_views_numbers():
    pip = np.array([40.0, 0.0, 75.0, 20.0, 60.0])
    poses = np.radians(np.stack([pip, np.full(5, 10.0)], axis=-1))
    views, (given, shown) = views_at(poses, finned()), resolutions(poses)
    figure = sweep_figure(finned(), poses, views, given)
    assert len(figure.axes) == 3
    assert figure.axes[-1].get_xlabel() == "PIP (°)"
    measures = {
        "coverage": 100 * np.asarray(views.value.coverage()),
        "views": np.asarray(views.value.redundancy()),
        "least": shown[..., 0],
        "greatest": shown[..., 2],
    }
    order = np.argsort(pip)
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
    views, (given, shown) = views_at(poses, finned()), resolutions(poses)
    covered = np.asarray(views.value.coverage())
    assert covered.min() < 1
    order = np.array([3, 0, 5, 1, 4, 2])
    shuffled = jax.tree.map(lambda leaf: leaf[order], views)
    figure = sweep_figure(finned(), poses[order], shuffled, given[order])
    meshes = {mesh.get_gid(): mesh for axes in figure.axes for mesh in axes.collections}
    least = shown[..., 0]
    for kind, values in (("coverage (%)", 100 * covered), ("least resolution (px/mm)", least)):
        for pad, name in enumerate(NAMES):
            # Rows of a map are its ordinates.
            found = meshes[f"{kind}:{name}"].get_array()
            assert found is not None
            found = np.ma.filled(found, np.nan)
            np.testing.assert_allclose(found, values[:, pad].reshape(3, 2).T)
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert len(panels) == 6
    assert (panels[3].get_xlabel(), panels[0].get_ylabel()) == ("PIP (°)", "DIP (°)")


def test_other_sets_of_poses_are_no_sweep():
    for chosen in ([0, 0, 0, 0], [0, 1, 1, 2], []):
        with pytest.raises(UserError, match="one joint angle or a grid of two"):
            sweep_figure(finned(), *some(np.array(chosen, int)), np.ones((len(chosen), 3, 3)))
