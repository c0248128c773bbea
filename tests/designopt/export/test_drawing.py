"""What drawings of every format share: the frame, and numbers that begin with 1, 2 or 5."""

import math

import pytest

from designopt.export.drawing import Circle, Drawing, Layer, Polyline, round_down


@pytest.mark.parametrize("value", [3e-7, 0.1, 0.2, 0.3, 0.999, 1.0, 4.999, 5.0, 9.0, 10.0, 7.3e9])
def test_round_down_is_the_largest_of_the_series(value):
    series = [figure * 10.0**decade for decade in range(-9, 12) for figure in (1, 2, 5)]
    wanted = max(number for number in series if number <= value * (1 + 1e-12))
    assert round_down(value) == pytest.approx(wanted, rel=1e-12)


def test_numbers_of_the_series_stay_though_they_were_rounded():
    for number in (float(f"{figure}e{decade}") for decade in range(-6, 7) for figure in (1, 2, 5)):
        assert round_down(math.nextafter(number, 0)) == number
        assert round_down(math.nextafter(number, math.inf)) == number


def test_the_frame_holds_lines_and_whole_circles_of_framed_layers():
    sheet = Drawing(
        "s",
        [Layer("in", "body"), Layer("out", "camera", framed=False)],
        polylines=[
            Polyline("in", [(-1.0, 2.0), (3.0, 4.0)]),
            Polyline("out", [(0.0, 0.0), (99.0, 9.0)]),
        ],
        circles=[Circle("in", "A", (3.0, 4.0), 0.5), Circle("out", "B", (-50.0, 0.0), 1.0)],
    )
    assert sheet.box() == ((-1.0, 2.0), (3.5, 4.5))
