"""The axes of a linkage's picture, which follow what is in them."""

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from designopt.plot.figures import style
from kinematics.explore.bench import LinkageBench
from kinematics.io.designed import DesignedLinkage
from tests.kinematics.gallery import FOLDER


@pytest.fixture
def drawn():
    """A bench, the values it begins with, its axes, and their figure."""
    bench = LinkageBench(DesignedLinkage.read(FOLDER / "four-bar.toml"))
    figure = Figure(figsize=(12, 6))
    area: Any = figure.subfigures(1, 1)
    with style():
        bench.draw(area)
    values = {knob.name: knob.value for knob in bench.knobs}
    bench.show(values)
    return bench, values, area.axes, figure


def scales(axes):
    """Pixels per unit along both axes."""
    return np.diff(axes.transData.transform([(0, 0), (1, 1)]), axis=0)[0].tolist()


def test_axes_stay_until_the_picture_no_longer_fits(drawn):
    bench, values, axes, _ = drawn
    before = [each.axis() for each in axes]
    for crank in range(0, 360, 30):
        bench.show({**values, "crank": float(crank)})
        assert [each.axis() for each in axes] == before
    wide = {**values, "ground O2-O4": 170.0, "coupler A-B": 150.0}
    bench.show(wide)
    right = axes[0].get_xlim()[1]
    assert right > 170 > before[0][1]
    bench.show({**wide, "ground O2-O4": 171.0})
    assert axes[0].get_xlim()[1] == right


@pytest.mark.parametrize("ground", [100.0, 1.0])
def test_a_circle_is_round_in_a_window_of_any_shape(drawn, ground):
    bench, values, (pose, *_), figure = drawn
    shown = bench.show({**values, "ground O2-O4": ground})
    assert bool(shown.message) == (ground == 1.0)  # it does not assemble
    for size in ((12, 6), (14, 5), (6, 9)):
        figure.set_size_inches(*size)
        bench.show({**values, "ground O2-O4": ground})
        across, up = scales(pose)
        assert across == pytest.approx(up, rel=1e-9)
