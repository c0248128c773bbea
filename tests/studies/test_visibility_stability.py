"""The study ``visibility-stability``: its oracles by other means, and faults that it must catch."""

import dataclasses
import json

import mpmath
import numpy as np
import pytest

from designopt import cli
from optics.visibility.coverage import find_views
from studies.oracles import rays
from studies.oracles.rays import Fans, Structure
from studies.stability.visibility import STUDY, comparing, degenerate, judging
from studies.stability.visibility.answers import Asked, ask
from studies.stability.visibility.cases import families as all_families
from studies.stability.visibility.comparing import Gaps, gaps, gradients, landings, wrong_verdicts
from studies.stability.visibility.exact import ExactScene, judged_numbers, slopes
from studies.stability.visibility.scenes import (
    CAMERA,
    MIRRORS,
    PADS,
    STRUCTURE,
    fans_of,
    random_rows,
)
from studies.stability.visibility.spec import StabilitySpec
from studies.stability.visibility.statements import findings, metrics

ASKED = Asked(find_views, 1)
"""All tests share one compiled program."""

# Closed forms for the brute force: one mirror, pad and blocker.
MIRROR, POST = [[1, 0], [2, 0]], [[1, 0], [1, 0.25]]
WALL, HIGH_WALL = [[2, -1], [2, 1]], [[3, 0], [3, 4]]
NONE = [[9, 9], [9, 9]]
SHOWN = {
    "a post hides a quarter": ((0, 0), NONE, WALL, POST, (1, 1, 0), [0.75, 0]),
    "a pad senses on its side": ((4, 0), NONE, WALL, NONE, (1, 1, 0), [0, 0]),
    "a post hides from its side alone": ((0, 0), NONE, WALL, POST, (1, 1, -1), [1, 0]),
    "a mirror shows from 0.5 to 2": ((0, 1), MIRROR, HIGH_WALL, NONE, (1, 1, 0), [1, 1.5 / 4]),
    "a mirror reflects on its side": ((0, 1), MIRROR, HIGH_WALL, NONE, (-1, 1, 0), [1, 0]),
}


@pytest.mark.parametrize("name", SHOWN)
def test_rays_show_what_closed_forms_say(name):
    camera, mirror, pad, blocker, sides, expected = SHOWN[name]
    fans = Fans(
        np.array([[mirror, pad, blocker]], float),
        np.array([camera], float),
        *(np.full(shape, value) for shape, value in ((1, 0.0), (1, 3.0), ((1, 1), 0.0))),
    )
    found = rays.bounds(Structure(1, 1, sides), fans, rays=30_000, bounces=1)
    inner, outer = found.seen[:, 0, :, 0]
    assert np.all(inner <= expected)
    assert np.all(expected <= outer)
    assert np.max(outer - inner) < 1e-3
    union = max(expected)  # what the mirror shows is seen directly as well
    assert found.coverage[0, 0, 0, 0] <= union <= found.coverage[1, 0, 0, 0]


def test_limits_of_fans_and_of_pads_bound_what_rays_show():
    """A field of view of 45°, and a pad at a height of 1 that no ray below 45° shows."""
    ends = np.array([[NONE, WALL, NONE], [NONE, [[4, 1], [-4, 1]], NONE]], float)
    fans = Fans(
        ends,
        np.zeros((2, 2)),
        direction=np.array([0.0, np.pi / 2]),
        width=np.array([np.pi / 4, 3.0]),
        grazing=np.array([[0.0], [np.pi / 4]]),
    )
    found = rays.bounds(Structure(1, 1, (1, 1, 0)), fans, rays=30_000, bounces=1)
    expected = np.array([2 * np.tan(np.pi / 8), 2 / 8])
    # The fan's own limits are known exactly.
    assert np.all(found.seen[0, :, 0, 0] <= expected)
    assert np.all(expected <= found.seen[1, :, 0, 0] + 1e-15)
    assert np.max(found.step) < 1e-3


def test_followed_rays_land_where_geometry_says():
    fans = Fans(
        np.array([[MIRROR, HIGH_WALL]], float),
        np.array([[0.0, 1.0]]),
        direction=np.array([-0.5]),
        width=np.array([1.0]),
        grazing=np.zeros((1, 1)),
    )
    turn = np.array([np.arctan2(-1, 1.5) + 0.5])  # to the mirror's middle, then up again
    hit, length, mirrors = rays.follow(Structure(1, 1, (1, 1)), fans, turn, (0,), 0)
    np.testing.assert_allclose(hit, 0.25)
    np.testing.assert_allclose(mirrors, [[0.5]])
    np.testing.assert_allclose(length, 2 * np.hypot(1, 1.5))


def test_more_rays_tighten_the_bounds_and_stay_inside():
    fans = fans_of(random_rows(20, seed=5))
    coarse, fine = (rays.bounds(STRUCTURE, fans, count, bounces=2) for count in (3000, 90_000))
    # A shadow that falls between two rays opens at most their step.
    slack = coarse.step[:, None] + 1e-9
    for side, sign in ((0, 1), (1, -1)):
        narrower = sign * (fine.coverage[side] - coarse.coverage[side])
        assert np.all(narrower >= -slack)
    assert np.mean(fine.step) < np.mean(coarse.step) / 20


def test_formulas_agree_with_rays():
    """At distances that rays resolve."""
    with mpmath.workdps(50):
        for family in all_families("float64", 8):
            rows = family.rows[np.broadcast_to(family.clear, len(family.rows)) > 0.01]
            if not len(rows):  # where surfaces lie on one another, nothing is claimed
                continue
            found = rays.bounds(STRUCTURE, fans_of(rows), 20_000, 2)
            scenes = [ExactScene(judging.digits(row)) for row in rows]
            exact = [judged_numbers(scene, family.formula, 2) for scene in scenes]
            numbers = np.array(exact).astype(float)
            coverage, seen = numbers[:, :PADS], np.split(numbers[:, PADS:], 2, axis=1)[0]
            seen = seen.reshape(len(rows), -1, PADS)
            for (inner, outer), said in ((found.coverage[:, 1], coverage), (found.seen, seen)):
                assert np.all(inner <= said + 1e-9), family.case
                assert np.all(said <= outer + 1e-9), family.case


def test_slopes_of_a_slit_are_those_of_similar_triangles():
    """A slit of width w halfway to a pad of length 2 shows w of it, under twice atan(w / 2)."""
    (family,) = (f for f in all_families("float64", 8) if f.case.startswith("a slit of"))
    row, width = family.rows[0], 0.1
    with mpmath.workdps(50):
        scene, unit = ExactScene(judging.digits(row)), np.array([mpmath.mpf(1)] * len(row))
        numbers = judged_numbers(scene, family.formula, 1).astype(float)
        found = slopes(scene, family.formula, 1, unit).astype(float)
    margin = (1 + MIRRORS + 1) * PADS  # after the coverages and what the paths show
    np.testing.assert_allclose(numbers[[0, PADS, margin]], [width, width, 2 * np.arctan(width / 2)])
    upper = 4 * (STRUCTURE.mirrors + PADS + 3) + 1  # y of the first end of the last blocker
    slope = 1 / (1 + (width / 2) ** 2)
    np.testing.assert_allclose(found[[0, PADS, margin], upper], [1, 1, slope])


@pytest.fixture(scope="module")
def random():
    """Random scenes that show something, the answers for them and their rays."""
    rows = random_rows(150, seed=3)
    answers = ask(ASKED, rows)
    return rows, answers, rays.bounds(STRUCTURE, fans_of(rows), 20_000, 1)


def test_sound_answers_agree(random):
    rows, answers, found = random
    assert not np.any(gaps(found, answers, 1).disagree)
    assert wrong_verdicts(found, answers) == 0
    assert not np.any(answers.non_finite)
    landed = landings(rows, answers, 1)
    assert landed.rays > 100
    assert landed.angle < 1e-10
    assert max(landed.distance, landed.reflection) < 1e-10
    assert landed.resolution < 1e-6  # of differences


def test_an_engine_that_sees_its_mirrors_aside_is_caught(random):
    rows, _, found = random
    moved = rows.copy()
    moved[:, : 4 * MIRRORS : 2] += 1e-3
    wrong = ask(ASKED, moved)
    compared = gaps(found, wrong, 1)
    assert np.sum(compared.disagree) >= 3
    assert np.max(compared.off) > 1e-5
    assert landings(rows, wrong, 1).angle > 1e-6


def changed(answers, **numbers):
    return dataclasses.replace(answers, numbers={**answers.numbers, **numbers})


def test_injected_faults_of_the_answers_are_counted(random):
    rows, answers, found = random
    numbers = answers.numbers
    more = changed(answers, coverage=numbers["coverage"] + 0.01)
    assert np.sum(gaps(found, more, 1).disagree) == len(rows)
    assert wrong_verdicts(found, dataclasses.replace(answers, ok=~answers.ok)) > 0
    assert wrong_verdicts(found, changed(answers, margin=-numbers["margin"])) > 0
    absent = changed(answers, margin=np.full_like(numbers["margin"], np.nan))
    assert np.sum(absent.non_finite) == numbers["margin"].size
    for name, field in (
        ("pixels", "angle"),
        ("distance", "distance"),
        ("spans", "reflection"),
        ("px_per_mm", "resolution"),
    ):
        landed = landings(rows, changed(answers, **{name: numbers[name] * (1 + 1e-4)}), 1)
        assert getattr(landed, field) > 1e-6


def test_gradients_meet_central_differences_and_wrong_ones_do_not(random, monkeypatch):
    rows, answers, _ = random
    rows = rows[np.any(answers.ok, axis=(1, 2))][:5]
    found = gradients(ASKED, rows)
    assert max(found.worst.values()) < 1e-6
    assert found.left_out < found.entries / 100

    def skewed(*args):
        right = ask(*args)
        return dataclasses.replace(right, gradient=right.gradient * (1 + 1e-5))

    monkeypatch.setattr(comparing, "ask", skewed)
    assert min(gradients(ASKED, rows).worst.values()) > 1e-6


def judged(family, monkeypatch, **numbers):
    """A family judged with answers that are changed: by name, what they are multiplied by."""

    def spoiled(*args):
        right = ask(*args)
        factors = {name: right.numbers.get(name) for name in numbers}
        wrong = {name: part * numbers[name] for name, part in factors.items() if part is not None}
        gradient = right.gradient * numbers.get("gradient", 1.0)
        ok = right.ok ^ bool(numbers.get("ok", 0))
        return dataclasses.replace(changed(right, **wrong), gradient=gradient, ok=ok)

    monkeypatch.setattr(judging, "families", lambda *_: [family])
    monkeypatch.setattr(judging, "ask", spoiled)
    (result,) = judging.judge_families(ASKED, "float64", len(family.rows))
    return result


@pytest.fixture(scope="module")
def low_mirror():
    (family,) = (f for f in all_families("float64", 8) if f.case.startswith("a mirror, seen"))
    return family


def test_faults_in_extreme_scenes_fail(low_mirror, monkeypatch):
    family = low_mirror
    sound = judged(family, monkeypatch)
    assert not np.any(sound.failed)
    assert (sound.row.failures, sound.row.non_finite, sound.row.infeasible) == (0, 0, 0)
    for fault, factor in (
        ("coverage", 1 + 1e-12),
        ("seen", 1 + 1e-12),
        ("margin", -1.0),
        ("gradient", 1 + 1e-9),
        ("gradient", np.nan),
        ("ok", 1),
    ):
        assert np.all(judged(family, monkeypatch, **{fault: factor}).failed), fault


def test_places_of_degenerate_scenes_are_exactly_on_lines():
    """In whole numbers: the camera's cross product with what it is in line with is 0."""
    for family in degenerate.families(12):
        if not family.case.startswith("camera on a"):
            continue
        for row in family.rows:
            places = row[: CAMERA.stop].reshape(-1, 2)
            arrows = (places[:-1] - places[-1]).reshape(-1, 2, 2)
            cross = arrows[:, 0, 0] * arrows[:, 1, 1] - arrows[:, 0, 1] * arrows[:, 1, 0]
            long = np.any(arrows[:, 0] != arrows[:, 1], axis=1)
            assert np.any((cross == 0) & long), family.case


def test_findings_name_what_failed(low_mirror, monkeypatch):
    family = dataclasses.replace(low_mirror, case="the bad one")
    bad = judged(family, monkeypatch, coverage=0.5)
    agreeing = Gaps(np.zeros(3), np.zeros(3), np.full(3, 1e-4))
    compared = comparing.Compared(
        bounces=1,
        coarse=agreeing,
        fine=dataclasses.replace(agreeing, excess=np.array([0, 0, 0.1])),
        wrong_verdicts=0,
        non_finite={"float64": 0},
        landings=comparing.Landings(4, 0.0, 0.0, 0.0, 0.0),
        single=np.zeros(0),
        gradients=comparing.Gradients(10, 0, {"coverage and parts": 1e-9}),
    )
    spec = StabilitySpec(float32=False)
    said = findings(spec, [compared], [bad])
    assert "1 disagree" in said[0]
    assert "targets that they miss stand as missed" in said[1]
    assert said[-1].startswith("the bad one (float64, 8 scenes): 8 values are off by up to 5.0e-01")
    missed = {metric.name for metric in metrics(spec, [compared], [bad]) if metric.met is False}
    assert missed == {"random_disagreements", "worst_value_error_float64", "stability_failures"}


def run(tmp_path, *settings):
    out = tmp_path / "out"
    arguments = [f"--set={setting}" for setting in settings]
    assert cli.run(["run", STUDY.name, "--out", str(out), *arguments]) == 0
    return out, json.loads((out / "results.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path):
    out, document = run(
        tmp_path,
        *("scenes=200", "bounces=1", "float32=false", "family_cases=8"),
        *("gradient_scenes=5", "reference_scenes=5", "fine_rays=400000"),
    )
    assert all(metric["met"] for metric in document["metrics"].values())
    for row in document["stability"]:
        assert (row["failures"], row["non_finite"]) == (0, 0), row
    assert "200 random scenes" in document["findings"][0]
    for name in ("stability", "rays", "approach"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 10_000
    assert {"tables/random.csv", "tables/verdicts.csv"} <= set(document["tables"])


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("scene=5", "did you mean 'scenes'"),
        ("scenes=5", "--set scenes=5"),
        ("bounces=3", "--set bounces=3"),
        ("fine_rays=10", "--set fine_rays=10"),
    ],
)
def test_faulty_settings_are_one_line(tmp_path, capsys, assignment, words):
    arguments = ["run", STUDY.name, "--out", str(tmp_path / "out"), "--set", assignment]
    assert cli.run(arguments) == 2
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1
