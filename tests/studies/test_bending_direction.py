"""The study ``bending-direction``: a quick run end to end, and its pieces."""

import dataclasses
import json
import math
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.cli import run as command
from designopt.errors import UserError
from perception.chamber import ChamberStatus, Direction, Points
from studies.bending_direction import paper
from studies.bending_direction.design import Design, Knobs, best, clearance, problem, rates
from studies.bending_direction.found import Found
from studies.bending_direction.frames import TOWARDS, Look, Series
from studies.bending_direction.rules import Tally
from studies.bending_direction.spec import BendingDirectionSpec
from studies.bending_direction.statements import gone_at, metrics
from studies.bending_direction.tables import flipped, paper_tally
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.spec import ChamberImagesSpec, MadeSpec

PRINTED = tomllib.loads(
    (Path(__file__).parent.parent / "data" / "table2.toml").read_text(encoding="utf-8")
)
QUICK = ["images=12", "small_images=12", "stability_images=1"]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    sets = [part for setting in QUICK for part in ("--set", setting)]
    code = command(["run", "bending-direction", *sets, "--out", str(out)])
    return code, json.loads((out / "results.json").read_text(encoding="utf-8")), out


@pytest.fixture(scope="module")
def finger():
    return SoftFinger.of(ChamberImagesSpec())


@pytest.mark.slow
def test_a_quick_run_tells_directions(done):
    _, document, out = done
    measured = {name: metric["value"] for name, metric in document["metrics"].items()}
    for direction in ("up", "down", "left", "right"):
        assert measured[f"decided_{direction}_percent"] == 100
        assert measured[f"right_{direction}_percent"] >= 80  # 2 of 12 may be bent by hardly any
    assert measured["odd_failures"] == 0
    assert measured["wrong_with_threshold"] == 0
    assert measured["rate_best_px_per_deg"] > measured["rate_spec_px_per_deg"]
    assert measured["undecided_small_best_blue"] <= measured["undecided_small_spec_blue"]
    for name in ("pictures", "curves", "rules", "thresholds", "small_bends", "precision"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000


@pytest.mark.slow
def test_the_quick_run_shows_both_stages(done):
    _, document, _ = done
    lines = [line for line in document["findings"] if "Yellow shrinks until it is gone" in line]
    assert len(lines) == 1
    assert "and then blue shrinks" in lines[0]


@pytest.mark.slow
def test_few_images_meet_no_target(done):
    code, document, _ = done
    assert code == 0
    assert all(metric["target"] is None for metric in document["metrics"].values())


def test_table_2_is_as_printed_and_follows_the_rule_that_initial_is_correct():
    for row in PRINTED["rows"]:
        truth, threshold = Direction[row["direction"].upper()], row["threshold"]
        assert paper.COUNTS[truth, threshold] == tuple(row["counts"])
        assert sum(row["counts"]) == 300
        tally = paper_tally(truth, threshold)
        assert f"{100 * tally.paper:.2f}" == f"{row['accuracy_percent']:.2f}"
        assert f"{row['accuracy_percent']:.2f}" == f"{paper.ACCURACY[truth, threshold]:.2f}"


def test_rules_on_answers_counted_by_hand():
    answers = [Direction.UP] * 6 + [Direction.LEFT] + [Direction.INITIAL] * 2
    tally = Tally(Direction.UP, (*answers, Direction.UNDEFINED))
    assert (tally.paper, tally.strict, tally.abstained) == (0.8, 0.6, 0.3)
    assert tally.decided == pytest.approx(6 / 7)
    assert math.isnan(Tally(Direction.UP, (Direction.INITIAL,)).decided)


@pytest.mark.slow
def test_the_best_chamber_beats_every_one_of_a_grid(finger):
    asked = problem(finger)
    designs, held_by = best(finger, seed=0)
    found = designs[-1]
    axes = [
        jnp.linspace(low, high, 9)
        for low, high in zip(
            jax.tree.leaves(asked.lower), jax.tree.leaves(asked.upper), strict=True
        )
    ]
    grid = jnp.stack(jnp.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def judged(values):
        terms = asked.terms(Knobs(*values), *asked.data)
        return terms.objective, terms.inequalities["room"], terms.inequalities["image"]

    objectives, *rooms = jax.jit(jax.vmap(judged))(grid)
    allowed = np.all(np.asarray(rooms) >= 0, axis=0)
    assert allowed.any()
    assert not allowed.all()
    assert -found.rates.mean() <= np.asarray(objectives)[allowed].min() + 1e-9
    assert float(clearance(found.finger.chamber)) >= float(clearance(finger.chamber)) - 1e-6
    assert held_by == [
        "Δl_B at its upper bound",
        "η at its lower bound",
        "θ_BC at its lower bound",
    ]


@pytest.mark.slow
def test_designs_between_differ_in_one_knob(finger):
    designs, _ = best(finger, seed=0)
    own, end = (np.array(jax.tree.leaves(designs[i].knobs)) for i in (0, -1))
    for design in designs[1:-1]:
        changed = ~np.isclose(jax.tree.leaves(design.knobs), own, rtol=1e-9)
        assert changed.sum() == 1
        np.testing.assert_allclose(np.array(jax.tree.leaves(design.knobs))[changed], end[changed])


@pytest.mark.slow
def test_a_camera_that_cannot_show_blue_whole_is_refused():
    narrow = {"endoscope": {"field_of_view_deg": 30.0}}
    finger = SoftFinger.of(ChamberImagesSpec.model_validate(narrow))
    with pytest.raises(UserError, match="field of view"):
        best(finger, seed=0)


def series_of(answers: str) -> Series:
    """Frames whose blue has moved by so many px to the right; '.' shows no chamber."""
    initial = Points(np.zeros((7, 2)), np.ones(7, bool))
    looks = []
    for answer in answers:
        xy, seen = np.zeros((7, 2)), np.full(7, answer != ".")
        xy[:, 0] = 0 if answer == "." else int(answer)
        looks.append(Look(ChamberStatus.CHAMBER, Points(xy, seen), (1, 1), 0.0))
    bends = np.arange(float(len(answers)))
    return Series(Direction.RIGHT, bends, tuple(looks), initial)


def test_flips_are_counted_image_by_image_and_tested_by_the_binomial():
    before, after = series_of("1355.5"), series_of("5553.3")
    one = flipped([before], [after], threshold=4.0, use="blue")
    # Decided with the second only: the first two; with the first only: the fourth and the last.
    assert (one.gained, one.lost) == (2, 2)
    assert one.p_value == pytest.approx((6 + 4 + 1) / 16)  # two or more of four tosses
    assert flipped([before], [before], threshold=4.0, use="blue").p_value == 1.0


def test_targets_are_missed_where_the_numbers_are_worse(finger):
    design = Design("any", finger, Knobs.of(finger.chamber), np.ones(3), np.ones((3, 3)))
    spec = BendingDirectionSpec()
    right, wrong = series_of("9" * 100), series_of("9" * 100)
    wrong = dataclasses.replace(wrong, truth=Direction.LEFT)
    for frames, met in ((right, True), (wrong, False)):
        found = Found(
            series=[frames], curves=[], designs=[design, design], held_by=[],
            small=[[frames], [frames]], bends=[], odd=[], rows=[], seconds=1e-3, shown=[],
        )  # fmt: skip
        judged = {metric.name: metric.met for metric in metrics(spec, found)}
        name = frames.truth.name.lower()
        assert judged[f"right_{name}_percent"] is met
        assert judged[f"decided_{name}_percent"] is met
        assert judged["frame_ms"] is True
        assert judged["undecided_small_best_all"] is False  # none fewer


def test_slopes_of_a_design_are_differences(finger):
    design = Design.of("as it is", finger)
    steps = (1e-5, 1e-5, math.radians(1e-4))
    units = (1e-5, 1e-5, 1e-4)
    for i, (step, unit) in enumerate(zip(steps, units, strict=True)):
        ends = []
        for sign in (1, -1):
            values = list(jax.tree.leaves(design.knobs))
            values[i] = values[i] + sign * step
            ends.append(np.asarray(rates(Knobs(*values), finger.chamber, finger.endoscope)))
        np.testing.assert_allclose(
            design.slopes[:, i], (ends[0] - ends[1]) / (2 * unit), rtol=1e-5, atol=1e-7
        )


def test_knobs_come_back_from_the_chamber_they_were_turned_to(finger):
    knobs = Knobs(jnp.asarray(0.8), jnp.asarray(3.0), jnp.deg2rad(jnp.asarray(1.5)))
    again = Knobs.of(knobs.turned(finger.chamber))
    np.testing.assert_allclose(jax.tree.leaves(again), jax.tree.leaves(knobs), rtol=1e-10)


def test_directions_point_where_their_names_say():
    pointing = {truth: (round(math.cos(a)), round(math.sin(a))) for truth, a in TOWARDS.items()}
    assert pointing == {
        Direction.UP: (0, -1),
        Direction.DOWN: (0, 1),
        Direction.LEFT: (-1, 0),
        Direction.RIGHT: (1, 0),
    }


@pytest.mark.parametrize(
    ("areas", "gone"),
    [([5, 3, 0, 0], 2.0), ([5, 0, 3, 0], 3.0), ([5, 3, 2, 1], None), ([0, 0, 0, 0], 0.0)],
)
def test_a_region_is_gone_from_where_it_does_not_come_back(areas, gone):
    assert gone_at(np.array(areas), np.arange(4.0)) == gone


def test_a_made_finger_differs_by_its_deviations(finger):
    made = [finger.made(MadeSpec(), np.random.default_rng(seed)) for seed in range(200)]
    lengths = [float(one.chamber.length_bc - finger.chamber.length_bc) for one in made]
    offsets = [float(one.chamber.offset_b - finger.chamber.offset_b) for one in made]
    views = [math.degrees(one.endoscope.field_of_view) - 60 for one in made]
    # 200 numbers: a standard deviation is known to 5 %.
    assert np.std(lengths) == pytest.approx(0.3, rel=0.2)
    assert np.std(offsets) == pytest.approx(0.15, rel=0.2)
    assert np.std(views) == pytest.approx(0.5, rel=0.2)


def test_a_chamber_that_cannot_be_is_refused():
    with pytest.raises(UserError, match="eta"):
        SoftFinger.of(
            ChamberImagesSpec.model_validate({"eta": 1.2, "chamber": {"wall_angle_bc_deg": 30.0}})
        )
