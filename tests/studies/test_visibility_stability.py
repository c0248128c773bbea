"""The study ``visibility-stability``: its oracles by other means, and faults that it must catch."""

import mpmath
import numpy as np
import pytest

from designopt import Records
from designopt.study.report import Report
from designopt.study.runner import run_study
from studies.oracles import rays
from studies.oracles.extreme_scenes import degenerate, families
from studies.oracles.rays import Fans, Structure
from studies.oracles.visibility import ExactScene, digits, shown, slopes
from studies.stability.visibility import StabilitySpec, comparison, run, scenes
from studies.stability.visibility.comparison import gaps, gradients, landings, wrong_verdicts
from studies.stability.visibility.scenes import CAMERA, MIRRORS, PADS, STRUCTURE, ask, random_rows

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


def fans(*ends, camera=(0.0, 0.0), direction=0.0, width=3.0, grazing=0.0):
    angles = np.array([direction]), np.array([width]), np.array([[grazing]])
    return Fans(np.array([ends], float), np.array([camera], float), *angles)


@pytest.mark.parametrize("name", SHOWN)
def test_rays_show_what_closed_forms_give(name):
    camera, mirror, pad, blocker, sides, expected = SHOWN[name]
    scene = fans(mirror, pad, blocker, camera=camera)
    found = rays.bounds(Structure(1, 1, sides), scene, rays=30_000, bounces=1)
    inner, outer = found.seen[:, 0, :, 0]
    assert np.all(inner <= expected)
    assert np.all(expected <= outer)
    assert np.max(outer - inner) < 1e-3
    union = max(expected)  # what the mirror shows is seen directly as well
    assert found.coverage[0, 0, 0, 0] <= union <= found.coverage[1, 0, 0, 0]


@pytest.mark.parametrize(
    ("pad", "limits", "expected"),
    [
        (WALL, {"width": np.pi / 4}, 2 * np.tan(np.pi / 8)),
        # A height of 1 that no ray below 45° shows.
        ([[4, 1], [-4, 1]], {"direction": np.pi / 2, "grazing": np.pi / 4}, 2 / 8),
    ],
)
def test_limits_of_fans_and_of_pads_bound_what_rays_show(pad, limits, expected):
    scene = fans(NONE, pad, NONE, **limits)
    found = rays.bounds(Structure(1, 1, (1, 1, 0)), scene, rays=30_000, bounces=1)
    # The fan's own limits are known exactly.
    assert found.seen[0, 0, 0, 0] <= expected <= found.seen[1, 0, 0, 0] + 1e-15
    assert np.max(found.step) < 1e-3


def test_followed_rays_land_where_geometry_puts_them():
    scene = fans(MIRROR, HIGH_WALL, camera=(0.0, 1.0), direction=-0.5, width=1.0)
    turn = np.array([np.arctan2(-1, 1.5) + 0.5])  # to the mirror's middle, then up again
    hit, length, mirrors = rays.follow(Structure(1, 1, (1, 1)), scene, turn, (0,), 0)
    np.testing.assert_allclose(hit, 0.25)
    np.testing.assert_allclose(mirrors, [[0.5]])
    np.testing.assert_allclose(length, 2 * np.hypot(1, 1.5))


def test_more_rays_tighten_the_bounds_and_stay_inside():
    scenes = Fans.of_rows(STRUCTURE, random_rows(20, seed=5))
    coarse, fine = (rays.bounds(STRUCTURE, scenes, count, bounces=2) for count in (3000, 90_000))
    # A shadow that falls between two rays opens at most their step.
    slack = coarse.step[:, None] + 1e-9
    for side, sign in ((0, 1), (1, -1)):
        narrower = sign * (fine.coverage[side] - coarse.coverage[side])
        assert np.all(narrower >= -slack)
    assert np.mean(fine.step) < np.mean(coarse.step) / 20


def test_formulas_agree_with_rays():
    """At distances that rays resolve."""
    with mpmath.workdps(50):
        for family in families("float64", 8):
            rows = family.rows[np.broadcast_to(family.clear, len(family.rows)) > 0.01]
            if not len(rows):  # where surfaces lie on one another, nothing is claimed
                continue
            found = rays.bounds(STRUCTURE, Fans.of_rows(STRUCTURE, rows), 20_000, 2)
            scenes = [ExactScene(STRUCTURE, digits(row)) for row in rows]
            exact = [shown(scene, family.formula, 2) for scene in scenes]
            numbers = np.array(exact).astype(float)
            coverage, seen = numbers[:, :PADS], np.split(numbers[:, PADS:], 2, axis=1)[0]
            seen = seen.reshape(len(rows), -1, PADS)
            for (inner, outer), own in ((found.coverage[:, 1], coverage), (found.seen, seen)):
                assert np.all(inner <= own + 1e-9), family.case
                assert np.all(own <= outer + 1e-9), family.case


def family_of(start):
    (family,) = (one for one in families("float64", 8) if one.case.startswith(start))
    return family


def test_slopes_of_a_slit_are_those_of_similar_triangles():
    """A slit of width w halfway to a pad of length 2 shows w of it, under twice atan(w / 2)."""
    family, width = family_of("a slit of"), 0.1
    row = family.rows[0]
    with mpmath.workdps(50):
        scene = ExactScene(STRUCTURE, digits(row))
        numbers = shown(scene, family.formula, 1).astype(float)
        unit = np.array([mpmath.mpf(1)] * len(row))
        found = slopes(scene, family.formula, 1, unit).astype(float)
    margin = (1 + MIRRORS + 1) * PADS  # after the coverages and what the paths show
    np.testing.assert_allclose(numbers[[0, PADS, margin]], [width, width, 2 * np.arctan(width / 2)])
    upper = 4 * (MIRRORS + PADS + 3) + 1  # y of the first end of the last blocker
    slope = 1 / (1 + (width / 2) ** 2)
    np.testing.assert_allclose(found[[0, PADS, margin], upper], [1, 1, slope])


def test_places_of_degenerate_scenes_are_exactly_on_lines():
    """In whole numbers: the camera's cross product with what it is in line with is 0."""
    for family in degenerate(12):
        if not family.case.startswith("camera on a"):
            continue
        for row in family.rows:
            places = row[: CAMERA.stop].reshape(-1, 2)
            arrows = (places[:-1] - places[-1]).reshape(-1, 2, 2)
            cross = arrows[:, 0, 0] * arrows[:, 1, 1] - arrows[:, 0, 1] * arrows[:, 1, 0]
            long = np.any(arrows[:, 0] != arrows[:, 1], axis=1)
            assert np.any((cross == 0) & long), family.case


@pytest.fixture(autouse=True, scope="module")
def _small_blocks():
    """Families of eight scenes are not filled up to hundreds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "BLOCK", 50)
        yield


@pytest.fixture(scope="module")
def random():
    """Random scenes that show something, the answers for them and their rays."""
    rows = random_rows(150, seed=3)
    fans = Fans.of_rows(STRUCTURE, rows)
    return rows, ask(1, rows), rays.bounds(STRUCTURE, fans, 20_000, 1)


def test_sound_answers_agree(random):
    rows, answers, found = random
    assert not np.any(gaps(found, answers, 1)["disagree"])
    assert wrong_verdicts(found, answers) == 0
    assert not np.any(answers.non_finite)
    landed = landings(rows, answers, 1)
    assert landed["landings"] > 100
    for name in ("worst_landing_rad", "worst_distance", "worst_reflection"):
        assert landed[name] < 1e-10
    assert landed["worst_resolution"] < 1e-6  # of differences
    assert landings(rows[:0], answers.part(slice(0)), 1)["landings"] == 0


def test_mirrors_that_are_seen_aside_are_caught(random):
    rows, _, found = random
    moved = rows.copy()
    moved[:, : 4 * MIRRORS : 2] += 1e-3
    wrong = ask(1, moved)
    compared = gaps(found, wrong, 1)
    assert np.sum(compared["disagree"]) >= 3
    assert np.max(compared["off"]) > 1e-5
    assert landings(rows, wrong, 1)["worst_landing_rad"] > 1e-6


def changed(answers, **numbers):
    return answers._replace(numbers={**answers.numbers, **numbers})


def test_injected_faults_of_the_answers_are_counted(random):
    rows, answers, found = random
    numbers = answers.numbers
    more = changed(answers, coverage=numbers["coverage"] + 0.01)
    assert np.sum(gaps(found, more, 1)["disagree"]) == len(rows)
    assert wrong_verdicts(found, answers._replace(ok=~answers.ok)) > 0
    assert wrong_verdicts(found, changed(answers, margin=-numbers["margin"])) > 0
    absent = changed(answers, margin=np.full_like(numbers["margin"], np.nan))
    assert np.sum(absent.non_finite) == numbers["margin"].size
    for name, field in (
        ("pixels", "worst_landing_rad"),
        ("distance", "worst_distance"),
        ("spans", "worst_reflection"),
        ("px_per_mm", "worst_resolution"),
    ):
        landed = landings(rows, changed(answers, **{name: numbers[name] * (1 + 1e-4)}), 1)
        assert landed[field] > 1e-6


def test_gradients_meet_central_differences_and_wrong_ones_do_not(random, monkeypatch):
    rows, answers, _ = random
    rows = rows[np.any(answers.ok, axis=(1, 2))][:5]
    found = gradients(1, rows)
    names = [name for name in found if name.startswith("worst")]
    assert max(found[name] for name in names) < 1e-6
    assert found["left_out"] < found["derivatives"] / 100

    def skewed(*args):
        right = ask(*args)
        return right._replace(gradient=right.gradient * (1 + 1e-5))

    monkeypatch.setattr(comparison, "ask", skewed)
    assert min(gradients(1, rows)[name] for name in names) > 1e-6


def judged(family, monkeypatch, **numbers):
    """A family judged with answers that are changed: by name, what they are multiplied by."""

    def spoiled(*args):
        right = ask(*args)
        factors = {name: right.numbers.get(name) for name in numbers}
        wrong = {name: part * numbers[name] for name, part in factors.items() if part is not None}
        gradient = right.gradient * numbers.get("gradient", 1.0)
        ok = right.ok ^ bool(numbers.get("ok", 0))
        return changed(right, **wrong)._replace(gradient=gradient, ok=ok)

    monkeypatch.setattr(run, "ask", spoiled)
    return run.judge_families([family], "float64", 1)


def test_faults_in_extreme_scenes_fail(monkeypatch):
    family = family_of("a mirror, seen")
    sound = judged(family, monkeypatch)
    assert not np.any(sound["failed"] | sound["infeasible"] | (sound["non_finite"] > 0))
    for fault, factor in (
        ("coverage", 1 + 1e-12),
        ("seen", 1 + 1e-12),
        ("margin", -1.0),
        ("gradient", 1 + 1e-9),
        ("gradient", np.nan),
        ("ok", 1),
    ):
        assert np.all(judged(family, monkeypatch, **{fault: factor})["failed"]), fault


def test_findings_name_what_failed(monkeypatch):
    family = family_of("a mirror, seen")._replace(case="the bad one")
    none = dict.fromkeys(("left_out", "wrong_verdicts", "worst_landing_rad"), 0)
    some = {"bounces": 1, "shot_again": 3, "derivatives": 10, "landings": 4}
    table = Records({**none, **some, "worst_gradient: a": 1e-9})
    sound = dict.fromkeys(("fine", "off", "differ", "disagree", "non_finite"), False)
    found = Records({"scene": [0, 1, 2], **sound})
    found.add(**(found | {"fine": [True] * 3, "disagree": [False, False, True]}))
    out = Report(StabilitySpec(float32=False), package="studies.stability.visibility")
    run.report(out, table, found, judged(family, monkeypatch, coverage=0.5))
    results = out.results()
    assert results.findings[-1].startswith("the bad one (float64, 8 scenes): 8 answered wrongly")
    missed = {metric.name for metric in results.metrics if metric.met is False}
    assert missed == {"random_disagreements", "worst_value_error_float64", "stability_failures"}


FEW = {
    "scenes": 40,
    "bounces": 1,
    "float32": False,
    "family_cases": 8,
    "gradient_scenes": 2,
    "reference_scenes": 2,
    "fine_rays": 100_000,
}


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path):
    results = run_study("visibility-stability", FEW, out=tmp_path / "out")
    assert all(metric.met for metric in results.metrics)
    for row in results.stability:
        assert (row.failures, row.non_finite) == (0, 0), row
