"""Searches over a design of which everything is known in closed form."""

import math

import jax.numpy as jnp
import pytest

from designopt.errors import UserError
from designopt.optimize import MeasureBound, Parameter
from designopt.optimize.design_search import DesignSearch, search
from designopt.optimize.parametric import check_bounds, free_parameters
from tests.designopt.box import Box

BOX = Box()


def result(objective, keep=(), free=(), bounds=None, start=None, **settings):
    free = free_parameters(BOX, free, bounds)
    finder = DesignSearch(BOX, objective, free, [MeasureBound.parse(text) for text in keep])
    *steps, last = finder.steps({**BOX.values(), **(start or {})}, **settings)
    assert last.done
    assert last.result is not None
    assert not any(step.done for step in steps)
    return last.result, steps, last


def test_largest_area_of_an_outline_is_a_square_and_its_price_the_derivative():
    found, steps, last = result("area")
    # A = P²/16, so that dA/dP = P/8.
    assert found.values["width"] == pytest.approx(5.0, abs=1e-3)
    assert found.judged["area"] == pytest.approx(25.0, abs=1e-3)
    assert found.judged_before["area"] == 8.0
    assert found.values["depth"] == 3.0
    [active] = found.active
    assert active.words == "outline <= 20"
    assert active.price == pytest.approx(2.5, abs=1e-2)
    assert found.slopes["area"] == pytest.approx({"width": 5.0, "sides.left": 5.0}, abs=1e-2)
    assert found.is_optimum
    assert last.report == ("held by outline <= 20: to ease it by 1 mm gives 2.5 mm²",)
    assert last.message.startswith("area 25 mm² instead of 8 mm²")
    assert steps


def test_what_is_greatest_is_made_small():
    found, *_ = result("outline", keep=["area>=16"])
    assert found.judged["outline"] == pytest.approx(16.0, abs=1e-3)  # of a square of side 4
    [active] = found.active
    assert active.price == pytest.approx(4 / (2 * 4), abs=1e-2)  # P = 4 √A


def test_bounds_hold_and_are_named_by_their_labels():
    found, *_ = result("area", free=["width"], bounds={"width": (2.0, 6.0)})
    assert found.values["sides.left"] == 1.0
    assert found.values["width"] == pytest.approx(6.0, abs=1e-6)
    assert [one.words for one in found.active] == ["width of the box at its upper bound"]
    assert found.active[0].price == pytest.approx(1.0, abs=1e-6)


def test_what_the_judge_misses_is_asked_for_again():
    # On the grid the greatest extent of a 6 × 4 box is that at 45°, 7.071; in truth √(6² + 4²).
    found, *_ = result("area", keep=["reach<=6"])
    assert math.hypot(found.values["width"], found.values["sides.left"]) <= 6 + 1e-5
    assert found.missed == ()
    # Of all boxes with that diagonal the square is the largest.
    assert found.judged["area"] == pytest.approx(18.0, rel=0.01)


def test_a_start_that_fails_is_mended_first():
    found, *_ = result("area", start={"width": 18.0, "sides.left": 12.0})
    assert found.judged["area"] == pytest.approx(25.0, abs=1e-2)
    assert found.judged["outline"] <= 20.0 + 1e-4


def test_a_start_that_is_no_design_is_left():
    found, *_ = result("area", start={"width": 20.0, "sides.left": 20.0})
    assert found.judged_before == {}
    assert found.judged["area"] == pytest.approx(25.0, abs=1e-2)


def test_requirements_that_conflict_are_named_with_amounts_and_nothing_is_changed():
    found, _, last = result("extent", keep=["area>=36"])
    # A square of side a that is short of both by 10 s: 4 a = 20 + 10 s and a² = 36 − 10 s.
    assert found.values == BOX.values()
    assert len(found.conflict) == 2
    side = math.sqrt(60) - 2
    short = {
        line.split(" by ")[0]: float(line.split(" by ")[1].split()[0]) for line in found.conflict
    }
    assert short["outline <= 20"] == pytest.approx(4 * side - 20, abs=0.02)
    assert short["area >= 36"] == pytest.approx(36 - side**2, abs=0.02)
    assert "conflict" in last.message


def test_it_never_ends_worse():
    best = {"width": 5.0, "sides.left": 5.0}
    found, *_ = result("area", start=best)
    assert found.judged["area"] >= 25.0 - 1e-9


def test_several_starts_find_what_one_does():
    found, steps, _ = result("area", starts=3, seed=1)
    assert found.judged["area"] == pytest.approx(25.0, abs=1e-3)
    assert any(step.phase == "search 3 of 3" for step in steps)


def test_search_is_the_search_from_these_values():
    *_, last = search(BOX, BOX.values(), "area", {"width": (1.0, 20.0)})
    assert last.values["width"] == pytest.approx(9.0, abs=1e-4)  # 2 (9 + 1) = 20


def test_what_the_judge_refuses_is_not_taken_and_nothing_is_claimed_of_it():
    # Without the outline the search ends at 20 × 20, which is judged to be no box.
    free = free_parameters(BOX, ["width", "sides.left"])
    finder = DesignSearch(Loose(), "area", free)
    *_, last = finder.steps({**BOX.values(), "depth": 2.0})
    found = last.result
    assert found is not None
    assert found.values == {**BOX.values(), "depth": 2.0}
    assert (found.active, found.slopes, found.is_optimum) == ((), {}, False)
    assert "judged to be no better" in last.message


class Loose(Box):
    requirements = ()


class Undefined(Box):
    """Its extent is no number for narrow boxes."""

    def evaluate(self, values, of):
        found = super().evaluate(values, of)
        if "extent" in found:
            found["extent"] = jnp.where(values[0] < 3.0, jnp.nan, found["extent"])
        return found


def test_what_is_no_number_is_no_design():
    design = Undefined()
    keep = [MeasureBound("extent", ">=", 0.5)]
    free = free_parameters(design, ["width"])
    *_, last = DesignSearch(design, "area", free, keep).steps(BOX.values())
    assert last.result is not None
    assert last.result.values["width"] == pytest.approx(9.0, abs=1e-3)
    *_, last = DesignSearch(design, "area", free, keep).steps({**BOX.values(), "width": 2.0})
    assert last.result is not None
    assert last.result.conflict == ()
    assert all(math.isfinite(value) for value in last.result.values.values())


def test_a_start_that_is_judged_to_meet_everything_conflicts_with_nothing():
    class Careful(Box):
        """Its search finds the outline larger than it is judged to be."""

        def evaluate(self, values, of):
            found = super().evaluate(values, of)
            return {k: v + 30.0 * (k == "outline") for k, v in found.items()}

    *_, last = DesignSearch(Careful(), "area", free_parameters(BOX)).steps(BOX.values())
    assert last.result is not None
    assert (last.result.conflict, last.result.missed) == ((), ())
    assert last.result.values == BOX.values()


def test_a_name_has_its_own_bounds_beside_its_beginning():
    bounds = {"sides.left": (2.0, 3.0)}
    for names in (["sides.left", "sides"], ["sides", "sides.left"]):
        assert free_parameters(BOX, names, bounds) == {"sides.left": (2.0, 3.0)}


def test_names_may_be_beginnings():
    assert free_parameters(BOX, ["sides"]) == {"sides.left": (1.0, 20.0)}
    assert [*free_parameters(BOX)] == ["width", "sides.left"]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: free_parameters(BOX, ["widht"]), "--free widht: box has no such parameter; did"),
        (lambda: free_parameters(BOX, ["width"], {"width": (3.0, 3.0)}), "low < high"),
        (lambda: free_parameters(BOX, ["depth"], {"depth": (-1.0, 3.0)}), "ends not included"),
        (lambda: DesignSearch(BOX, "volume", {"width": (1.0, 2.0)}), "no measure 'volume'"),
        (lambda: DesignSearch(BOX, "area", {}), "nothing is free"),
        (lambda: check_bounds(BOX, [MeasureBound("area", ">=", 500.0)]), "is at most 400 mm²"),
        (lambda: check_bounds(BOX, [MeasureBound("area", "<=", 5.0)]), "write >="),
        (lambda: MeasureBound.parse("area > 3"), "write a measure, >= or <=, and a number"),
        (lambda: MeasureBound.parse("area>=nan"), "finite"),
    ],
)
def test_refusals(call, words):
    with pytest.raises(UserError, match=words):
        call()


def test_labels_default_to_names():
    assert Parameter("a.b", 1.0, 0.0, 2.0).label == ""
    assert str(MeasureBound("a", ">=", 2.5)) == "a >= 2.5"
    assert str(MeasureBound("a", ">=", 2.5, "height")) == "height"
