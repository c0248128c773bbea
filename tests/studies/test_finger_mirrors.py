"""The study ``finger-mirrors``: its parts against independent means, and the study itself."""

import cmath
import csv
import json
import math
import tomllib
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from jax.flatten_util import ravel_pytree

from designopt import cli
from designopt.optimize import draw_sobol_starts
from optics import Pieces, find_coverage, find_views, parse_scene, read_scene
from studies.finger_mirrors import solvers, statements
from studies.finger_mirrors.solvers import Run
from studies.models.finger import camera_of
from studies.models.mirror_design import design as designing
from studies.models.mirror_design import problem, seeing, yields
from studies.models.mirror_design.errors import (
    NAMES,
    Errors,
    deviations,
    perturb,
    sample_errors,
    spread_evenly,
)
from studies.models.mirror_design.judging import coverage_grid, judged, seen_by_rays
from studies.models.mirror_design.placement import (
    PROXIMAL,
    bounds,
    free_part,
    poor_layout,
    scale,
)
from studies.models.mirror_design.searching import Stage, lagrangian
from studies.models.mirror_design.spec import FingerMirrorsSpec, MirrorSpec
from studies.models.spec_files import scene_file
from tests.studies.fingers import LENS, finger_of, seeing_finger

SPEC = MirrorSpec()
SMALL = MirrorSpec.model_validate({"search": {"copies": 2, "poses": 2, "starts": 1}})
GALLERY = Path(__file__).parents[2] / "studies" / "gallery" / "scenes" / "finger.toml"
GIVEN, POOR = seeing_finger(), poor_layout(finger_of(), LENS)


@pytest.fixture(scope="module")
def given():
    return GIVEN.scene()


@pytest.fixture(scope="module")
def verdict():
    return judged(GIVEN)


def random_fingers(count):
    task = problem.Task.of(POOR, SMALL, 0)
    points = draw_sobol_starts(problem.problem_of(SMALL, task), count, 3)
    placements = [jax.tree.map(lambda leaf, i=i: leaf[i], points) for i in range(count)]
    return [eqx.combine(placement, POOR) for placement in placements]


def mirrors_of(finger):
    """Ends as complex numbers, y upwards, each in its phalanx's frame."""
    dorsal = float(finger.body.dorsal)
    ends = np.stack([np.asarray(mirror.ends) for mirror in finger.mirrors])
    return ends[..., 0] + 1j * (dorsal - ends[..., 1])


def test_the_given_layout_is_the_gallerys_finger(given):
    gallery = read_scene(GALLERY)
    np.testing.assert_allclose(given.mirrors, gallery.mirrors, atol=1e-12)
    np.testing.assert_allclose(given.pads, gallery.pads, atol=1e-12)
    np.testing.assert_allclose(given.camera.direction, gallery.camera.direction)
    np.testing.assert_allclose(given.blockers[1:], gallery.blockers[1:], atol=1e-12)
    # The gallery gives the camera's body with one decimal.
    np.testing.assert_allclose(given.blockers[0], gallery.blockers[0], atol=0.1)
    assert given.layout == eqx.tree_at(lambda one: one.mirrors, gallery, given.mirrors).layout


@pytest.mark.parametrize("thickness", [25.0, 20.0])
def test_a_finger_written_to_a_file_is_the_scene(thickness):
    finger = poor_layout(finger_of(thickness=thickness), LENS)
    read = parse_scene(tomllib.loads(str(scene_file(finger).content)), "finger")
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-12), read, finger.scene())


def test_the_given_layout_meets_the_bounds():
    least, greatest = bounds(GIVEN, SPEC)
    for low, value, high in zip(
        *map(jax.tree.leaves, (least, free_part(GIVEN), greatest)), strict=True
    ):
        assert bool(jnp.all((low <= value) & (value <= high)))
    assert float(jnp.min(problem.clearances(GIVEN))) >= SPEC.room.clearance


def distance(one, other):
    """Least distance of two segments that do not cross; 0 if they do."""

    def cross(a, b):
        return a.real * b.imag - a.imag * b.real

    (a, b), (c, d) = one, other
    if (
        cross(b - a, c - a) * cross(b - a, d - a) < 0
        and cross(d - c, a - c) * cross(d - c, b - c) < 0
    ):
        return 0.0

    def to_segment(p, a, b):
        along = ((p - a) * (b - a).conjugate()).real / abs(b - a) ** 2
        return abs(p - a - min(max(along, 0.0), 1.0) * (b - a))

    return min(to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b))


def test_clearance_in_the_straight_finger_holds_in_every_posture():
    """Mirrors turned by complex numbers, with the camera's body and with each other."""
    clear = [one for one in random_fingers(64) if float(jnp.min(problem.clearances(one))) >= 1.0]
    assert len(clear) > 10
    for finger in clear:
        behind = np.asarray(finger.camera_body()) @ [1, 1j]
        distal, proximal = mirrors_of(finger)
        for degrees in np.linspace(0, 90, 19):
            turn = cmath.exp(1j * math.radians(degrees))
            outer, inner = 23 + distal / turn, proximal * turn
            assert distance(inner, behind) >= 1.0 - 1e-9
            assert distance(outer, behind) >= 1.0 - 1e-9
            assert distance(inner, 23 + distal) > 1.0
            assert distance(outer, proximal) > 1.0


def test_errors_are_put_in_as_complex_numbers_say():
    entries = np.array([0.3, -0.2, 0.03, 0.02, -0.01, 0.25, -0.4])
    found = perturb(GIVEN, Errors.of(jnp.asarray(entries)))
    before, after = GIVEN.scene().camera, found.scene().camera
    np.testing.assert_allclose(after.position, np.asarray(before.position) + entries[:2])
    np.testing.assert_allclose(after.direction, before.direction + entries[2])
    for mirror in (0, 1):
        start, end = mirrors_of(GIVEN)[mirror]
        arm = (end - start) / 2 * cmath.exp(1j * entries[3 + mirror])
        middle = (start + end) / 2 + entries[5 + mirror] * 1j * arm / abs(arm)
        expected = np.array([middle - arm, middle + arm])
        np.testing.assert_allclose(mirrors_of(found)[mirror], expected)


def test_draws_have_the_stated_size_and_differ_from_the_copies():
    tolerances = SPEC.tolerances
    sizes = deviations(tolerances)
    np.testing.assert_allclose(sizes[:2], 0.3)
    np.testing.assert_allclose(np.rad2deg(sizes[2:5]), [2, 1, 1])
    random, even = sample_errors(tolerances, 4000, 0), spread_evenly(tolerances, 256, 0)
    # Four standard errors of a standard deviation.
    np.testing.assert_allclose(np.std(random, axis=0) / sizes, 1, atol=4 / math.sqrt(8000))
    np.testing.assert_allclose(np.std(even, axis=0) / sizes, 1, atol=0.03)
    assert np.abs(random[:256] - even).min() > 0
    assert len(NAMES) == random.shape[1]


def test_copies_look_at_many_angles():
    angles = problem.copies_angles_deg(90.0, 24, 8)
    assert angles.min() == 0
    assert angles.max() == 90
    assert np.max(np.diff(np.unique(angles))) < 2


@pytest.mark.parametrize(("good", "count"), [(0, 10), (5, 10), (1951, 2000), (2000, 2000)])
def test_the_interval_is_scipys(good, count):
    expected = scipy.stats.binomtest(good, count).proportion_ci(method="wilson")
    np.testing.assert_allclose(yields.wilson(good, count), expected, atol=1e-12)


def test_resolution_agrees_with_the_library(given, verdict):
    """`find_sharpness` looks every place up by its own ray."""
    views = jax.tree.map(jnp.asarray, verdict.views.value)
    lengths = seeing.pad_lengths(given)
    # Rounding may leave a pad's very end out of a view.
    best = seeing.best_resolution(views, lengths, jnp.linspace(1e-12, 1 - 1e-12, 401))
    assert bool(jnp.all(best > 0))
    np.testing.assert_allclose(jnp.min(best, axis=-1), verdict.px_per_mm, rtol=0.02)
    # The search's own, without looking places up, misses nothing.
    least = seeing.least_resolution(views, lengths)
    np.testing.assert_allclose(least, verdict.px_per_mm, rtol=1e-9)


def test_the_verdict_on_the_given_layout(verdict):
    """It was found by an independent search: all of every pad in one view each, 2.5 px/mm."""
    assert verdict.worst_coverage == 1.0
    assert float(np.min(verdict.single)) >= 1 - 1e-9
    assert verdict.worst_px_per_mm >= 2.5


@pytest.mark.slow
def test_the_row_stands_for_the_square():
    for finger in (seeing_finger(range_deg=30.0), poor_layout(finger_of(range_deg=30.0), LENS)):
        square = coverage_grid(finger)
        assert square.coverage.shape == (31, 31, 3)
        assert square.disagreement < 1e-12


def test_rays_see_the_same():
    """In postures in which the poor start shows parts only."""
    scene = POOR.scene()
    degrees = np.array([[0.0, 21.0], [75.0, 80.0]])
    exact = find_coverage(scene, jnp.deg2rad(degrees)).value
    assert 0.1 < float(jnp.min(exact)) < float(jnp.max(exact[:, [0, 2]])) < 0.95
    np.testing.assert_allclose(seen_by_rays(scene, degrees, 40_000), exact, atol=2e-3)


def test_what_is_hidden_shows_the_way_out():
    """Against coverage and margins, and the slope where coverage has none."""
    pose = seeing.together(jnp.deg2rad(jnp.asarray([10.0, 45.0])))

    def hidden(ends):
        scene = eqx.tree_at(lambda one: one.mirrors[PROXIMAL].ends, POOR, ends).scene()
        views = find_views(scene, pose)
        return jnp.sum(seeing.hidden_penalty(views)), views

    run = jax.jit(jax.value_and_grad(hidden, has_aux=True))
    (_, views), slope = run(POOR.mirrors[PROXIMAL].ends)
    found = np.asarray(seeing.hidden_penalty(views))
    np.testing.assert_allclose(found[0], 0, atol=1e-12)
    nearest = -np.max(np.where(views.margin[1, :, 0] < 0, views.margin[1, :, 0], -np.inf))
    np.testing.assert_allclose(found[1, 0], 1 + nearest)
    assert float(views.value.coverage()[1, 0]) == 0
    assert bool(jnp.all(jnp.isfinite(slope)))


def slopes_agree(value, placement):
    """Compiled and batched, against central differences from the same program."""
    units, build = ravel_pytree(scale(POOR))
    run = jax.jit(jax.vmap(jax.value_and_grad(lambda point: value(build(point)))))
    step = 1e-6
    # Off the round numbers, at which kinks lie.
    point = ravel_pytree(placement)[0] + 0.0211 * units
    steps = step * jnp.diag(units)
    points = jnp.concatenate([point[None], point[None] + steps, point[None] - steps])
    values, slopes = run(points)
    expected = (values[1:12] - values[12:]) / (2 * step * units)
    assert bool(jnp.all(jnp.isfinite(slopes)))
    assert float(jnp.max(jnp.abs(slopes[0]))) > 0.01
    # Rounding of values up to 200, over the step of 1e-7 rad and 1e-6 mm.
    np.testing.assert_allclose(slopes[0], expected, rtol=1e-5, atol=2e-6 / np.min(units))


@pytest.mark.slow
def test_the_searchs_function_is_the_problems():
    """Its value in NumPy from `terms_of`, its slope by central differences; fewer copies too."""
    task = problem.Task.of(POOR, SMALL, 0)
    units, build = ravel_pytree(scale(POOR))
    units = np.asarray(units)
    # Off the round numbers, at which kinks lie.
    point = np.asarray(ravel_pytree(free_part(POOR))[0]) / units + 0.0211
    placement = build(jnp.asarray(point * units))
    places = SMALL.search.poses * task.plain
    given = np.random.default_rng(0).uniform(0, 2, (places + 1, 3))
    multipliers = {
        "resolution": jnp.asarray(given[:places]),
        "clearance": jnp.asarray(given[places, :2]),
    }
    penalty = 10.0

    def found(point, copies):
        arguments = jnp.asarray(copies), jnp.asarray(penalty), multipliers
        (value, terms), slope = lagrangian(jnp.asarray(point), task, *arguments)
        return float(value), terms, np.asarray(slope)

    for copies in (1, 2):
        terms = problem.terms_of(placement, task.first(copies))
        expected = float(terms.value)
        for name, levels in terms.inequalities.items():
            m, g = np.asarray(multipliers[name]), np.asarray(levels)
            expected += np.sum(np.maximum(m - penalty * g, 0) ** 2 - m**2) / (2 * penalty)
        value, same, slope = found(point, copies)
        np.testing.assert_allclose(value, expected, rtol=1e-12)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-12), terms, same)
    step = 1e-6
    steps = step * np.eye(len(point))
    rise = [found(point + one, 2)[0] - found(point - one, 2)[0] for one in steps]
    # Rounding of values up to 1000, over the step.
    np.testing.assert_allclose(slope, np.array(rise) / (2 * step), rtol=1e-5, atol=1e-5)
    assert np.max(np.abs(slope)) > 1


def test_resolution_dips_beside_a_hand_over():
    """Two views of one pad: one sharp as far as 0.4, one blurred from 0.4 on."""

    def of(start, end, distance, px_per_mm):
        shape = (1, 2)
        whole = {name: jnp.zeros(shape, int) for name in ("path", "start_label", "end_label")}
        pair = {"distance": distance, "px_per_mm": px_per_mm}
        return Pieces(
            present=jnp.ones(shape, bool),
            start=jnp.asarray([start]),
            end=jnp.asarray([end]),
            pixels=jnp.zeros((*shape, 2)),
            spans=jnp.zeros((*shape, 1, 2)),
            **whole,
            **{name: jnp.asarray([value]) for name, value in pair.items()},
        )

    # A pad of 10 mm along x, seen from (0, 10) and from (-8, 10): 50 / distance² px/mm.
    squares = [[100.0, 116.0], [244.0, 424.0]]
    views = of([0.0, 0.4], [0.4, 1.0], np.sqrt(squares), 50 * 10 / np.array(squares))
    lengths = jnp.asarray([10.0])
    np.testing.assert_allclose(seeing.least_resolution(views, lengths), [500 / 424])
    # If the second gets sharper from there on, it is least where it takes over.
    squares[1] = [244.0, 164.0]
    views = of([0.0, 0.41], [0.41, 1.0], np.sqrt(squares), 50 * 10 / np.array(squares))
    np.testing.assert_allclose(seeing.least_resolution(views, lengths), [500 / 244])


@pytest.mark.parametrize(
    "finger",
    [
        pytest.param(GIVEN, marks=pytest.mark.as_users),
        pytest.param(POOR, marks=pytest.mark.nightly),
    ],
)
def test_gradients_of_the_whole_problem_are_central_differences(finger):
    task = problem.Task.of(POOR, SMALL, 0)
    weights = jax.random.uniform(jax.random.key(1), (task.plain * SMALL.search.poses, 3))

    def value(placement):
        terms = problem.terms_of(placement, task)
        # What is not seen has a resolution that stands for none.
        sharp = jnp.minimum(terms.inequalities["resolution"], 10.0)
        held = jnp.sum(weights * sharp) + jnp.sum(terms.inequalities["clearance"])
        return terms.value + held

    slopes_agree(value, free_part(finger))


def test_the_yield_is_that_of_fingers_built_one_by_one():
    errors = sample_errors(SPEC.tolerances, 6, 5)
    found = yields.coverages(GIVEN, errors)
    poses = seeing.together(jnp.deg2rad(jnp.arange(91.0)))
    for entries, coverage in zip(errors, found, strict=True):
        assembled = perturb(GIVEN, Errors.of(jnp.asarray(entries)))
        scene = parse_scene(tomllib.loads(str(scene_file(assembled).content)))
        np.testing.assert_allclose(coverage, find_coverage(scene, poses).value, atol=1e-12)
    share = yields.monte_carlo(GIVEN, SPEC.tolerances, draws=6, seed=5)
    whole = np.all(found >= 1 - 1e-9, axis=(1, 2))
    assert share.value == np.mean(whole)
    assert share.low < share.value <= share.high
    assert share.by_pose.shape == (91, 3)


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [([], (-5.0, 5.0)), ([50], (0.0, 0.0)), ([30, 60], (-1.9, 0.9)), ([0], (-4.9, 5.0))],
)
def test_limits_are_the_last_steps_before_something_hides(hidden, expected):
    whole = np.ones(len(yields.STEPS), bool)
    whole[hidden] = False
    np.testing.assert_allclose(yields._limits(whole), expected, atol=1e-12)


def run_of(method, objective, violation, seconds):
    return Run(method, "", objective, violation, seconds, 0.0)


def test_the_claim_can_be_proved_wrong():
    yardstick = run_of(solvers.EVOLUTION, 2.0, 0.0, 30.0)
    assert statements.claim([run_of(solvers.OURS, 1.0, 0.0, 10.0), yardstick]).holds
    assert not statements.claim([run_of(solvers.OURS, 1.0, 0.5, 10.0), yardstick]).holds
    assert not statements.claim([run_of(solvers.OURS, 1.0, 0.0, 40.0), yardstick]).holds
    assert not statements.claim([run_of(solvers.OURS, 2.5, 0.0, 10.0), yardstick]).holds


def test_gaps_are_to_the_best_that_holds_the_inequalities():
    runs = [run_of("a", 1.0, 0.5, 1.0), run_of("b", 3.0, 0.0, 1.0), run_of("c", 4.0, 0.0, 1.0)]
    assert solvers.best_objective(runs) == 3.0
    rows = solvers.rows(runs)
    gaps = [row.error for row in rows if row.panel == solvers.GAP]
    violations = [row.error for row in rows if row.panel == solvers.VIOLATION]
    np.testing.assert_array_equal(gaps, [np.nan, 0.0, 0.01])  # in pads, from % of one
    assert violations == [0.5, 0.0, 0.0]


QUICK = ["search.starts=1", "search.copies=2", "search.poses=2", "thin=0", "draws=12"]
QUICK += ["rays=5000", "ray_poses=2", "solvers=none", "left_out=false"]


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path, monkeypatch, capsys):
    """All of it but the solvers, after a search that is cut short."""
    monkeypatch.setattr(designing, "STAGES", (Stage(2.0, 0.0), Stage(1.0, 100.0)))
    out = tmp_path / "out"
    settings = [part for one in QUICK for part in ("--set", one)]
    code = cli.run(["run", "finger-mirrors", "--out", str(out), *settings])
    assert code in (0, 1), capsys.readouterr().err
    document = json.loads((out / "results.json").read_text(encoding="utf-8"))
    metrics = document["metrics"]
    assert metrics["start_coverage"]["value"] < 0.6
    assert metrics["yield"]["target"] is None  # of so few draws
    assert metrics["row_disagreement"]["value"] < 1e-12
    assert metrics["mirror_given_layout_mm"]["value"] == pytest.approx(69.62, abs=0.01)
    assert "worst_coverage_thin" not in metrics
    with (out / "tables" / "starts.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["start"] for row in rows] == ["poor", "random 1"]
    assert document["specs"] == ["specs/scene.toml"]
    assert [one.name for one in read_scene(out / "specs" / "scene.toml").layout.pads] == [
        "proximal",
        "intermediate",
        "distal",
    ]
    for name in ("views", "views_before", "coverage", "resolution", "yield", "sensitivity"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 10_000


@pytest.mark.nightly
def test_the_search_leads_from_the_poor_start_to_everything(tmp_path, capsys):
    out = tmp_path / "out"
    settings = ["search.starts=1", "draws=300", "solvers=few", "evolution_seconds=2"]
    arguments = [part for one in settings for part in ("--set", one)]
    assert cli.run(["run", "finger-mirrors", "--out", str(out), *arguments]) == 0, (
        capsys.readouterr().err
    )
    document = json.loads((out / "results.json").read_text(encoding="utf-8"))
    metrics = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert metrics["worst_coverage"] == 1
    assert metrics["worst_coverage_thin"] == 1
    assert metrics["worst_px_per_mm"] >= 2.5
    assert metrics["yield"] >= 0.92
    assert {row["method"] for row in document["precision"]} >= {
        solvers.OURS,
        solvers.EVOLUTION,
        *(solvers.NAMES[name] for name in solvers.CHOICES["few"]),
    }


def test_the_poor_start_is_poor():
    assert judged(POOR).mean_coverage < 0.6


def test_mirrors_have_lengths():
    expected = [math.hypot(30.57, 18.70), math.hypot(32.51, 9.20)]
    np.testing.assert_allclose([mirror.length for mirror in GIVEN.mirrors], expected)


def test_random_starts_are_drawn_by_their_heights():
    """The seed's Sobol points over heights above the axes, whatever a finger stores."""
    task = problem.Task.of(POOR, SMALL, 0)
    least, greatest = bounds(POOR, SMALL)
    (start,) = designing._random(SMALL, task, 0)
    points = draw_sobol_starts(problem.problem_of(SMALL, task), 1, 0)
    first, low, high, point = map(camera_of, (start, least, greatest, points))
    assert (first.along, first.tilt) == (point.along[0], point.tilt[0])
    np.testing.assert_allclose(first.depth, low.depth + high.depth - point.depth[0])
    for mirror, low, high, point in zip(
        start.mirrors, least.mirrors, greatest.mirrors, points.mirrors, strict=True
    ):
        np.testing.assert_array_equal(mirror.ends[:, 0], point.ends[0, :, 0])
        np.testing.assert_allclose(mirror.ends[:, 1], (low.ends + high.ends - point.ends[0])[:, 1])


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("body.thickness=9", "has no room for the camera"),
        ("thin=9", "has no room for the camera"),
        ("camera.width=30", "must be smaller than body.intermediate"),
        ("search.spreed=2", "did you mean"),
    ],
)
def test_faulty_settings_are_one_line(tmp_path, capsys, assignment, words):
    arguments = ["run", "finger-mirrors", "--out", str(tmp_path / "out"), "--set", assignment]
    assert cli.run(arguments) == 2
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1


def test_default_settings_ask_for_what_is_stated():
    spec = FingerMirrorsSpec()
    assert (spec.search.starts, spec.draws, spec.rays, spec.ray_poses) == (8, 2000, 200_000, 20)
    assert (spec.thin, spec.floor) == (20.0, 2.5)
