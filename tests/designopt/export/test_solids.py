"""Solids of the CAD kernel, and STEP files read back by it."""

from __future__ import annotations

import math

import pytest

from designopt import UserError
from designopt.export.parts import Hole, Part, Prism, around, circle, hull

pytest.importorskip("OCP")

from designopt.export.solids import make_solid, step_text
from studies.oracles.solids import (
    distance,
    is_watertight,
    least_wall,
    read_solids,
    shared_volume,
    volume_of,
)

BAR = Prism(hull((0, 0, 2), (10, 3, 2)), (0, 1.5), (Hole((0, 0), 1), Hole((10, 3), 1)))
TROUGH = (
    Prism(around((0, 0, 0), (20, 0, 0), (20, 10, 0), (0, 10, 0)), (0, 2)),
    Prism(around((0, 0, 0), (3, 0, 0), (3, 10, 0), (0, 10, 0)), (2, 8)),
)


def part(name, *prisms, cuts=()):
    return Part(name, name, name, "steel", "", prisms, cuts, "#336699")


@pytest.fixture(scope="module")
def solids(tmp_path_factory):
    """As the kernel reads them back."""
    parts = [
        part("bar", BAR),
        part("trough", *TROUGH, cuts=(Prism(circle(10, 5, 2), (-1, 3)),)),
        part("pin G', left", Prism(circle(0, 0, 1), (-1, 4))),
    ]
    path = tmp_path_factory.mktemp("step") / "things.step"
    path.write_text(step_text("a 'name' with µ", parts), encoding="utf-8")
    return read_solids(path)


def test_names_come_back(solids):
    assert [*solids] == ["bar", "trough", "pin G', left"]


def test_volumes_come_back(solids):
    assert volume_of(solids["bar"]) == pytest.approx(BAR.volume, rel=1e-9)
    trough = 20 * 10 * 2 + 3 * 10 * 6 - math.pi * 4 * 2
    assert volume_of(solids["trough"]) == pytest.approx(trough, rel=1e-9)
    assert volume_of(solids["pin G', left"]) == pytest.approx(5 * math.pi, rel=1e-9)


def test_all_are_watertight(solids):
    assert all(is_watertight(solid) for solid in solids.values())


def test_the_same_parts_give_the_same_text():
    parts = [part("bar", BAR)]
    assert step_text("one", parts) == step_text("one", parts)


def test_pieces_that_do_not_hang_together_are_no_part():
    apart = Prism(circle(50, 50, 1), (0, 1))
    with pytest.raises(UserError, match="bar: its prisms make 2 solids"):
        make_solid(part("bar", BAR, apart))


def test_the_least_wall_is_found(solids):
    # Of the bar between hole and edge, of the trough beside its hole of 2 mm at y = 5.
    assert least_wall(solids["bar"]).thickness == pytest.approx(1.0, abs=1e-3)
    assert least_wall(solids["trough"]).thickness == pytest.approx(2.0, abs=1e-6)
    thin = make_solid(part("thin", *TROUGH, Prism(circle(15, 5, 1), (1.9, 2.7))))
    assert least_wall(thin).thickness == pytest.approx(2.0, abs=1e-6)


def test_distances_and_what_is_shared(solids):
    pin = solids["pin G', left"]
    assert distance(solids["bar"], pin) == pytest.approx(0.0, abs=1e-9)
    assert shared_volume(solids["bar"], pin) == pytest.approx(0.0, abs=1e-9)
    thick = make_solid(part("thick", Prism(circle(0, 0, 1.1), (-1, 4))))
    wanted = math.pi * (1.1**2 - 1) * 1.5
    assert shared_volume(solids["bar"], thick) == pytest.approx(wanted, rel=1e-9)
    away = make_solid(part("away", Prism(circle(0, -5, 1), (0, 1))))
    assert distance(solids["bar"], away) == pytest.approx(2.0, abs=1e-9)
