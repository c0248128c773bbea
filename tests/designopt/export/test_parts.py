"""Outlines against Shapely's polygons, and what is counted and drawn of parts."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest
import shapely

from designopt.export.arcs import arc_line, arc_middle, arc_radius
from designopt.export.parts import (
    Assembly,
    BillRow,
    Hole,
    Part,
    Prism,
    around,
    bill_text,
    circle,
    hull,
)


def random_discs(generator):
    count = generator.integers(1, 8)
    radii = generator.uniform(0.1, 4.0, count) * generator.integers(0, 2, count)
    return [*zip(*generator.uniform(-10, 10, (2, count)).tolist(), radii.tolist(), strict=True)]


def test_hulls_are_those_of_polygons():
    generator = np.random.default_rng(3)
    for _ in range(500):
        discs = random_discs(generator)
        if len(discs) < 2:
            continue
        round_ones = [shapely.Point(x, y).buffer(max(r, 1e-9), quad_segs=500) for x, y, r in discs]
        wanted = shapely.unary_union(round_ones).convex_hull
        found = hull(*discs)
        assert found.area == pytest.approx(wanted.area, rel=1e-5, abs=1e-6)
        line = shapely.Polygon(found.line(1e-4)) if len(found.line(1e-4)) > 2 else None
        if line is not None:
            assert line.symmetric_difference(wanted).area < 0.02 * max(wanted.length, 1.0) ** 0.5


@pytest.mark.parametrize("discs", [[(1.0, 2.0, 3.0)], [(0.0, 0.0, 3.0), (1.0, 0.0, 1.0)]])
def test_one_disc_is_a_circle(discs):
    assert hull(*discs).area == pytest.approx(9 * math.pi, rel=1e-12)


def test_an_outline_may_have_corners_that_are_not_convex():
    ell = around((0, 0, 0), (4, 0, 0), (4, 1, 0), (1, 1, 0), (1, 4, 0), (0, 4, 0))
    assert ell.area == pytest.approx(7.0, abs=1e-12)
    # An ear with a round end on a square.
    ear = around((0, 0, 0), (4, 0, 0), (4, 1, 0), (6, 2, 1), (4, 3, 0), (4, 4, 0), (0, 4, 0))
    square, end = shapely.box(0, 0, 4, 4), shapely.Point(6, 2).buffer(1, quad_segs=2000)
    wanted = square.union(
        shapely.union(shapely.Point(4, 1), shapely.Point(4, 3)).union(end).convex_hull
    )
    assert ear.area == pytest.approx(wanted.area, rel=1e-6)


def test_discs_inside_each_other_have_no_tangent():
    with pytest.raises(ValueError, match="no tangent"):
        around((0, 0, 3), (1, 0, 1), (9, 0, 0))


@pytest.mark.parametrize("bulge", [0.2, 1.0, 3.0, -0.4])
def test_arcs_lie_on_their_circle(bulge):
    start, end = (1.0, 2.0), (4.0, -1.0)
    line = np.array(arc_line([start, end], [bulge], closed=False, chord=1e-4))
    radius = arc_radius(start, end, bulge)
    # The circle through three of its places.
    a, b, c = line[0], line[len(line) // 3], line[-1]
    system = 2 * np.array([b - a, c - a])
    center = np.linalg.solve(system, [b @ b - a @ a, c @ c - a @ a])
    np.testing.assert_allclose(np.hypot(*(line - center).T), radius, rtol=1e-9)
    middle = np.array(arc_middle(start, end, bulge))
    assert np.hypot(*(middle - center)) == pytest.approx(radius)
    assert np.min(np.hypot(*(line - middle).T)) < 0.05
    # Counter-clockwise: the arc bulges to the right of the way from start to end.
    way, off = np.subtract(end, start), middle - start
    assert np.sign(way[0] * off[1] - way[1] * off[0]) == -np.sign(bulge)


def test_pieces_of_one_item_are_counted(assembly):
    assert assembly.bill() == [
        BillRow("bar", "steel", "1 mm", 2),
        BillRow("shell", "printed", "", 1),
        BillRow("=motor", "bought", "", 1),
    ]
    rows = [*csv.reader(io.StringIO(bill_text(assembly)))]
    assert rows[0] == ["item", "material", "size", "pieces"]
    # No spreadsheet takes a name for a formula.
    assert rows[-1][0] == "'=motor"


@pytest.fixture
def assembly():
    bar = Prism(hull((0, 0, 2), (10, 0, 2)), (0, 1), (Hole((0, 0), 1),))
    pieces = [
        Part(f"bar, {side}", "bar", "bar", "steel", "1 mm", (bar,)) for side in ("left", "right")
    ]
    shell = Part("shell", "shell", "base", "printed", "", (Prism(circle(0, 0, 3), (-2, 2)),))
    return Assembly("thing", [*pieces, shell], [BillRow("=motor", "bought", "", 1)], [], "")


def test_holes_are_no_part_of_a_volume(assembly):
    prism = assembly.parts[0].prisms[0]
    assert prism.volume == pytest.approx(40 + 4 * math.pi - math.pi, rel=1e-12)
