"""The study ``bending-direction``: a quick run end to end, and its pieces."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import Records, Report, UserError
from designopt.optimize.minimizer import Minimizer
from perception.chamber import Direction, Points
from studies.benchmarks import rings
from studies.bending_direction import BendingDirectionSpec, run
from studies.bending_direction.frames import TOWARDS, Frame, Series, judge
from studies.models.soft_finger import best_chamber
from studies.models.soft_finger.best_chamber import Design, Dimensions
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.spec import ChamberImagesSpec, MadeSpec
from tests.helpers import central_differences, load_toml
from tests.studies.quick import quick_run


@pytest.fixture(scope="module")
def finger():
    return SoftFinger.of(ChamberImagesSpec())


@pytest.fixture(scope="module")
def search(finger):
    """One compiled search for the chambers of all cameras, which differ in numbers alone."""
    compiled = Minimizer(best_chamber.problem(finger), best_chamber.STARTS)

    def minimize(posed, starts):
        return compiled.solve(starts, posed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(best_chamber, "minimize", minimize)
        yield best_chamber.find_best_chamber


@pytest.fixture(scope="module")
def found(finger, search):
    return search(finger, seed=0)


@pytest.mark.slow
def test_a_quick_run_estimates_directions(tmp_path, monkeypatch, search):
    monkeypatch.setattr(run, "CURVE_DEG", np.arange(0.0, 121.0, 10))
    monkeypatch.setattr(run, "TIMED", 8)
    monkeypatch.setattr(rings, "PER_REGION", (5, 10, 20))
    _, document, measured = quick_run("bending-direction", tmp_path)
    for direction in run.TABLE_II:
        assert measured[f"decided_{direction}_percent"] == 100
        assert measured[f"right_{direction}_percent"] >= 80  # 2 of 12 may be bent by hardly any
    assert measured["odd_failures"] == measured["wrong_with_threshold"] == 0
    assert measured["rate_best_px_per_deg"] > measured["rate_spec_px_per_deg"]
    assert measured["wrong_small"] == 0
    assert measured["undecided_small_best_blue"] <= measured["undecided_small_spec_blue"]
    [stages] = [line for line in document["findings"] if "Yellow shrinks until it is gone" in line]
    assert "and then blue shrinks" in stages


def answers_of(direction: str, answers: list[str], threshold: float = 0.0) -> Records:
    columns = {"points": "all", "threshold_px": threshold, "bend_deg": 1.0}
    return judge(Records({"direction": direction, "answer": answers, **columns}))


def test_table_2_is_as_printed_and_follows_the_rule_that_initial_is_correct():
    none = answers_of("up", ["up"]).where(direction="down")
    table = run.tabulate_rules(none, threshold=4.0)
    assert len(table) == 8
    for row in load_toml("table2.toml")["rows"]:
        key = {"direction": row["direction"], "threshold": "yes" if row["threshold"] else "no"}
        own = table.where(**key)
        assert [own[answer][0] for answer in run.ANSWERS] == [*row["counts"], 0]
        assert sum(row["counts"]) == 300
        assert f"{own['paper_percent'][0]:.2f}" == f"{row['accuracy_percent']:.2f}"


def test_rules_on_answers_counted_by_hand():
    answers = ["up"] * 6 + ["left"] + ["initial"] * 2 + ["undefined"]
    percents = [rule(answers_of("up", answers)) for rule in run.RULES.values()]
    np.testing.assert_allclose(percents, [80, 60, 600 / 7, 30])
    assert math.isnan(run.RULES["decided_percent"](answers_of("up", ["initial"])))


@pytest.mark.slow
def test_the_best_chamber_beats_every_one_of_a_grid(finger, found):
    posed = best_chamber.problem(finger)
    (*_, best), held_by = found
    lower, upper = (np.stack(jax.tree.leaves(one)) for one in (posed.lower, posed.upper))
    steps = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3, indexing="ij"), axis=-1)
    grid = lower + steps.reshape(-1, 3) * (upper - lower)

    def evaluate(values):
        terms = posed.terms(Dimensions(*values), *posed.data)
        return terms.objective, terms.inequalities["room"], terms.inequalities["image"]

    objectives, *rooms = jax.jit(jax.vmap(evaluate))(grid)
    allowed = np.all(np.asarray(rooms) >= 0, axis=0)
    assert 0 < np.sum(allowed) < len(allowed)
    assert -best.rates.mean() <= np.asarray(objectives)[allowed].min() + 1e-9
    own_clearance = float(best_chamber.clearance(finger.chamber))
    assert float(best_chamber.clearance(best.finger.chamber)) >= own_clearance - 1e-6
    bounds = {"Δl_B": "upper", "η": "lower", "θ_BC": "lower"}
    assert held_by == [f"{name} at its {bound} bound" for name, bound in bounds.items()]


@pytest.mark.slow
def test_designs_between_differ_in_one_dimension(found):
    designs, _ = found
    values = np.array([jax.tree.leaves(design.dimensions) for design in designs])
    changed = ~np.isclose(values, values[0], rtol=1e-9)
    np.testing.assert_array_equal(changed.sum(axis=1), [0, 1, 1, 1, 3])
    np.testing.assert_allclose(values[1:4].T[changed[1:4].T], values[-1])


@pytest.mark.slow
def test_a_camera_that_cannot_show_blue_whole_is_refused(search):
    narrow = {"endoscope": {"field_of_view_deg": 30.0}}
    finger = SoftFinger.of(ChamberImagesSpec.model_validate(narrow))
    with pytest.raises(UserError, match="field of view"):
        search(finger, seed=0)


def series_of(moves: str) -> Series:
    """Frames whose blue has moved by so many px to the right; '.' shows no chamber."""
    initial = Points(np.zeros((7, 2)), np.ones(7, bool))
    frames = []
    for move in moves:
        xy, seen = np.zeros((7, 2)), np.full(7, move != ".")
        xy[:, 0] = 0 if move == "." else int(move)
        frames.append(Frame(Points(xy, seen), (1, 1)))
    return Series(Direction.RIGHT, np.arange(float(len(moves))), frames, initial)


def test_answers_follow_from_the_largest_displacement():
    rows = series_of("135.").estimate([0.0, 4.0], ["blue"])
    assert [own["answer"].tolist() for own in rows.group("threshold_px").values()] == [
        ["right", "right", "right", "undefined"],
        ["initial", "initial", "right", "undefined"],
    ]
    np.testing.assert_array_equal(rows["undecided"], ~rows["right"])
    assert not rows["wrong"].any()


def test_flips_are_counted_image_by_image_and_tested_by_the_binomial():
    small = series_of("1355.5").estimate([4.0], ["blue"]) | {"chamber": best_chamber.OWN}
    small.add(**(series_of("555.55").estimate([4.0], ["blue"]) | {"chamber": "other"}))
    table = run.compare_chambers(small)
    # Decided with the second only: the first two and the fifth; with the first only: the fourth.
    np.testing.assert_array_equal(table["gained"], [0, 3])
    np.testing.assert_array_equal(table["lost"], [0, 1])
    np.testing.assert_allclose(table["p_value"], [1, (4 + 1) / 16])  # three or more of four


@pytest.mark.parametrize("right", [True, False])
def test_targets_are_missed_where_the_numbers_are_worse(right):
    answers, opposite = Records(), {"up": "down", "down": "up", "left": "right", "right": "left"}
    for direction in run.TABLE_II:
        given = direction if right else opposite[direction]
        for threshold in run.THRESHOLDS:
            for points in ("blue", "all", "centre"):
                own = answers_of(direction, [given] * 9, threshold)
                answers.add(**(own | {"points": points}))
    out = Report(BendingDirectionSpec(), package="studies.bending_direction")
    run.add_directions(out, answers)
    met = {metric.name: metric.met for metric in out.results().metrics if metric.target}
    for name, value in met.items():
        assert value is (right or name.startswith("abstained"))
    assert len(met) == 12


def test_slopes_of_a_design_are_differences(finger):
    design, rates = Design.of("as it is", finger), jax.jit(best_chamber.rates)
    for outline, slopes in enumerate(design.slopes):
        wanted = central_differences(
            lambda own, i=outline: rates(own, finger.chamber, finger.endoscope)[i],
            design.dimensions,
        )
        per_radian = [1, 1, 180 / math.pi]
        np.testing.assert_allclose(slopes * per_radian, wanted, rtol=1e-5, atol=1e-7)


def test_dimensions_come_back_from_the_chamber_they_were_applied_to(finger):
    own = Dimensions(jnp.asarray(0.8), jnp.asarray(3.0), jnp.deg2rad(jnp.asarray(1.5)))
    again = Dimensions.of(own.applied_to(finger.chamber))
    np.testing.assert_allclose(jax.tree.leaves(again), jax.tree.leaves(own), rtol=1e-10)


def test_directions_point_where_their_names_say():
    ways = {"UP": (0, -1), "DOWN": (0, 1), "LEFT": (-1, 0), "RIGHT": (1, 0)}
    for truth, angle in TOWARDS.items():
        assert (round(math.cos(angle)), round(math.sin(angle))) == ways[truth.name]


@pytest.mark.parametrize(
    ("areas", "gone"),
    [([5, 3, 0, 0], 2.0), ([5, 0, 3, 0], 3.0), ([5, 3, 2, 1], None), ([0, 0, 0, 0], 0.0)],
)
def test_a_region_is_gone_from_where_it_does_not_come_back(areas, gone):
    assert run.gone_at(np.array(areas), np.arange(4.0)) == gone


def test_a_made_finger_differs_by_its_deviations(finger):
    made = [finger.made(MadeSpec(), np.random.default_rng(seed)) for seed in range(200)]
    lengths, offsets = (
        np.std([float(getattr(one.chamber, name)) for one in made])
        for name in ("length_bc", "offset_b")
    )
    views = np.std([math.degrees(one.endoscope.field_of_view) for one in made])
    # 200 numbers: a standard deviation is known to 5 %.
    np.testing.assert_allclose([lengths, offsets, views], [0.3, 0.15, 0.5], rtol=0.2)
