"""Where dimensions and names stand: where the CAD library draws them, and on nothing drawn."""

import numpy as np

from designopt.export.drawing import Drawing, Label, Layer, LinearDimension, Polyline
from designopt.export.placing import Clutter, readable
from tests.designopt.export.reading import dimensions, opened, words_of

ROOM = ((-200.0, -200.0), (200.0, 200.0))


def bars(*lines) -> Drawing:
    return Drawing(
        "bars", [Layer("bar", "body")], polylines=[Polyline("bar", line) for line in lines]
    )


def test_texts_are_read_from_below_or_from_the_right():
    for angle in np.radians(np.arange(0, 360, 15)):
        end = (float(30 * np.cos(angle)), float(30 * np.sin(angle)))
        found = readable(LinearDimension((0.0, 0.0), end))
        step = np.subtract(found.end, found.start)
        assert -90 + 1e-6 < np.degrees(np.arctan2(step[1], step[0])) < 90 + 1e-6
        assert {found.start, found.end} == {(0.0, 0.0), end}


def test_positive_offsets_are_to_the_left_as_in_the_cad_library():
    # Below the bar are further ones, so that its dimension stands above it.
    lines = [[(0.0, -float(y)), (60.0, -float(y))] for y in range(0, 60, 2)]
    sheet = bars(*lines)._replace(dimensions=[LinearDimension((0.0, 0.0), (60.0, 0.0))])
    offset = Clutter.of(sheet, 1.0, ROOM).place_dimension(sheet.dimensions[0], "60", 2.5)
    assert offset == 7.0
    (drawn,) = dimensions(opened(sheet))
    assert drawn.dxf.defpoint.y > 0
    assert words_of(drawn).dxf.insert.y > drawn.dxf.defpoint.y  # above its line, as reckoned with


def test_dimensions_of_one_distance_stand_beside_each_other():
    measure = LinearDimension((0.0, 0.0), (50.0, 0.0))
    clutter = Clutter.of(bars([measure.start, measure.end]), 2.0, ROOM)
    offsets = [clutter.place_dimension(measure, "50", 2.5) for _ in range(6)]
    assert np.diff(sorted(offsets)).min() >= 5  # a text and the room around it


def test_dimensions_keep_within_the_room():
    measure = LinearDimension((0.0, 0.0), (50.0, 0.0))
    narrow = ((-5.0, -30.0), (55.0, 6.0))
    clutter = Clutter.of(bars([measure.start, measure.end]), 1.0, narrow)
    assert clutter.place_dimension(measure, "50", 2.5) in (-7.0, -12.0)


def test_names_stand_near_their_places_and_not_on_each_other():
    star = [
        [(0.0, 0.0), (float(40 * np.cos(a)), float(40 * np.sin(a)))] for a in (0.0, 1.5, 3.1, 4.6)
    ]
    clutter = Clutter.of(bars(*star), 1.0, ROOM)
    middles = [clutter.place_label(Label("bar", (0.0, 0.0), "A1"), 2.5) for _ in range(3)]
    for index, middle in enumerate(middles):
        assert 1.5 < np.hypot(*middle) < 12
        for line in np.array(star):
            along = line[1] / np.hypot(*line[1])
            assert abs(middle[0] * along[1] - middle[1] * along[0]) > 1.25  # half its height
        for other in middles[:index]:
            assert np.any(np.abs(middle - other) > [3.75, 2.5])  # its width and height
