"""The study ``finger-mirrors``: its parts against independent means, and the study itself."""

import math
import tomllib
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from designopt.optimize import Evaluation, Problem, draw_sobol_starts
from designopt.optimize.flat import Flat
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.runner import run_study
from optics import Pieces, find_coverage, find_views, parse_scene, read_scene
from studies.finger_mirrors import solvers
from studies.models.finger import camera_of
from studies.models.mirror_design import design as designing
from studies.models.mirror_design import judging, problem, seeing, yields
from studies.models.mirror_design.design import Stage, lagrangian
from studies.models.mirror_design.errors import deviations, perturb, sample_errors, spread_evenly
from studies.models.mirror_design.judging import judged, percent_at_least, seen_by_rays
from studies.models.mirror_design.placement import bounds, free_part, poor_layout, scale
from studies.models.mirror_design.spec import MirrorSpec
from studies.models.spec_files import scene_file
from tests.studies.fingers import BARE, LENS, finger_of, seeing_finger

SPEC = MirrorSpec.model_validate(BARE)
SMALL = MirrorSpec.model_validate(BARE | {"search": {"copies": 2, "poses": 2, "starts": 1}})
GALLERY = Path(__file__).parents[2] / "studies" / "gallery" / "scenes" / "finger.toml"
least_resolution = jax.jit(seeing.least_resolution)
GIVEN, POOR = seeing_finger(), poor_layout(finger_of(), LENS)


@pytest.fixture(scope="module")
def given():
    return GIVEN.scene()


@pytest.fixture(scope="module")
def verdict():
    return judged(GIVEN)


def ends_of(finger):
    """Ends of the mirrors, y upwards, each in its phalanx's frame."""
    ends = jnp.stack([mirror.ends for mirror in finger.mirrors])
    return jnp.stack([ends[..., 0], finger.body.dorsal - ends[..., 1]], axis=-1)


def mirrors_of(finger):
    """The same as complex numbers."""
    return np.asarray(ends_of(finger)) @ [1, 1j]


def test_the_given_layout_is_the_gallerys_finger(given):
    gallery = read_scene(GALLERY)
    np.testing.assert_allclose(given.mirrors, gallery.mirrors, atol=1e-12)
    np.testing.assert_allclose(given.pads, gallery.pads, atol=1e-12)
    np.testing.assert_allclose(given.camera.direction, gallery.camera.direction)
    np.testing.assert_allclose(given.blockers[1:], gallery.blockers[1:], atol=1e-12)
    # The gallery gives the camera's body with one decimal.
    np.testing.assert_allclose(given.blockers[0], gallery.blockers[0], atol=0.1)
    assert given.layout == eqx.tree_at(lambda one: one.mirrors, gallery, given.mirrors).layout


def test_the_given_layout_meets_the_bounds():
    room = SPEC.room.model_copy(update={"clearance": 1.0})
    least, greatest = bounds(GIVEN, SPEC.model_copy(update={"room": room}))
    for low, value, high in zip(
        *map(jax.tree.leaves, (least, free_part(GIVEN), greatest)), strict=True
    ):
        assert bool(jnp.all((low <= value) & (value <= high)))
    expected = [math.hypot(30.57, 18.70), math.hypot(32.51, 9.20)]
    np.testing.assert_allclose([mirror.length for mirror in GIVEN.mirrors], expected)


def test_errors_are_put_in_as_complex_numbers_say():
    entries = np.array([0.3, -0.2, 0.03, 0.02, -0.01, 0.25, -0.4])
    found = perturb(GIVEN, jnp.asarray(entries))
    before, after = GIVEN.scene().camera, found.scene().camera
    np.testing.assert_allclose(after.position, np.asarray(before.position) + entries[:2])
    np.testing.assert_allclose(after.direction, before.direction + entries[2])
    start, end = mirrors_of(GIVEN).T
    arm = (end - start) / 2 * np.exp(1j * entries[3:5])
    middle = (start + end) / 2 + entries[5:] * 1j * arm / abs(arm)
    np.testing.assert_allclose(mirrors_of(found).T, [middle - arm, middle + arm])


def test_draws_have_the_stated_size_and_differ_from_the_copies():
    tolerances = SPEC.tolerances
    sizes = deviations(tolerances, 2)
    np.testing.assert_allclose(sizes[:2], 0.3)
    np.testing.assert_allclose(np.rad2deg(sizes[2:5]), [2, 1, 1])
    random, even = sample_errors(tolerances, 2, 4000, 0), spread_evenly(tolerances, 2, 256, 0)
    # Four standard errors of a standard deviation.
    np.testing.assert_allclose(np.std(random, axis=0) / sizes, 1, atol=4 / math.sqrt(8000))
    np.testing.assert_allclose(np.std(even, axis=0) / sizes, 1, atol=0.03)
    assert np.abs(random[:256] - even).min() > 0


def test_copies_look_at_many_angles():
    angles = 90 * problem.spread_angles(24, 8)
    assert angles.min() == 0
    assert angles.max() == 90
    assert np.max(np.diff(np.unique(angles))) < 2


def test_looks_are_at_all_pairs():
    """Each angle of PIP beside every distance of DIP's in the row, and no angle is left out."""
    row = np.tile(np.arange(8.0), (8, 1))
    pairs = problem.in_pairs(row)
    assert {tuple(pair) for pair in pairs.reshape(-1, 2).tolist()} == {
        (float(a), float(b)) for a in range(8) for b in range(8)
    }


def test_resolution_agrees_with_the_library(given, verdict):
    """`find_sharpness` looks every place up by its own ray."""
    views = jax.tree.map(jnp.asarray, verdict.views.value)
    lengths = seeing.pad_lengths(given)
    # Rounding may leave a pad's very end out of a view.
    places = jnp.asarray(np.linspace(1e-12, 1 - 1e-12, 401))
    best = np.asarray(jax.jit(seeing.best_resolution)(views, lengths, places))
    assert best.min() > 0
    np.testing.assert_allclose(best.min(axis=-1), verdict.px_per_mm, rtol=0.02)
    # The search's own, without looking places up, misses nothing.
    least = least_resolution(views, lengths)
    np.testing.assert_allclose(least, verdict.px_per_mm, rtol=1e-9)


def test_the_verdict_on_the_given_layout(verdict):
    """It was found by an independent search: all of every pad in one view each, 2.5 px/mm.

    That is so on whole degrees; where views hand over between two of them there is less.
    """
    assert verdict.worst_coverage == 1.0
    assert float(np.min(verdict.single)) >= 1 - 1e-9
    assert np.min(verdict.px_per_mm) >= 2.5
    assert 2.48 <= verdict.worst_px_per_mm < 2.49


def test_rays_see_the_same():
    """In postures in which the poor start shows parts only."""
    scene = POOR.scene()
    degrees = np.array([[0.0, 21.0], [75.0, 80.0]])
    exact = find_coverage(scene, jnp.deg2rad(degrees)).value
    assert 0.1 < float(jnp.min(exact)) < float(jnp.max(exact[:, [0, 2]])) < 0.95
    np.testing.assert_allclose(seen_by_rays(scene, degrees, 40_000), exact, atol=2e-3)


def test_what_is_hidden_shows_the_way_out():
    """Against coverage and margins, and the slope where coverage has none."""
    pose = jnp.asarray(np.deg2rad([[10.0, 10.0], [45.0, 45.0]]))

    def hidden(ends):
        scene = eqx.tree_at(lambda one: one.mirrors[1].ends, POOR, ends).scene()
        views = find_views(scene, pose)
        penalty = seeing.hidden_penalty(views)
        return jnp.sum(penalty), (penalty, views.value.coverage(), views.margin)

    run = jax.jit(jax.value_and_grad(hidden, has_aux=True))
    (_, shown), slope = run(POOR.mirrors[1].ends)
    found, coverage, margins = map(np.asarray, shown)
    np.testing.assert_allclose(found[0], 0, atol=1e-12)
    nearest = margins[1, :, 0]
    np.testing.assert_allclose(found[1, 0], 1 - nearest[nearest < 0].max())
    assert coverage[1, 0] == 0
    assert np.isfinite(slope).all()


def off_kinks(finger):
    """A finger's free numbers, scaled, off the round ones at which kinks lie; and the way back.

    Each is moved by another amount: a mirror parallel to a face has two nearest corners.
    """
    units, build = ravel_pytree(scale(POOR))
    point = ravel_pytree(free_part(finger))[0] / units
    point = point + np.linspace(0.0211, 0.0321, len(point))
    return np.asarray(point), lambda point: build(jnp.asarray(point) * units)


@pytest.fixture
def few_looks(monkeypatch):
    """Two without errors, for every look runs the same program."""
    monkeypatch.setattr(problem, "PLAIN", 4)


@pytest.mark.slow
@pytest.mark.usefixtures("few_looks")
def test_the_searchs_function_is_the_problems():
    """Its value in NumPy from `terms_of`, its slope by central differences; fewer copies too."""
    task, penalties = problem.Task.of(POOR, SMALL, 0), Stage(1.0, 10.0, 3.0).penalties
    assert {name: float(one) for name, one in penalties.items()} == {
        "coverage": 10.0,
        "resolution": 10.0,
        "clearance": 30.0,
    }
    point, build = off_kinks(POOR)
    places = SMALL.search.poses * task.plain
    given = jnp.asarray(np.random.default_rng(0).uniform(0, 2, (2, places + 1, 3)))
    multipliers = {
        "coverage": given[0, 1:],
        "resolution": given[1, 1:],
        "clearance": jnp.linspace(0.0, 2.0, len(problem.clearance_names(POOR))),
    }

    def found(point, copies):
        arguments = jnp.asarray(copies), penalties, multipliers
        (value, terms), slope = lagrangian(jnp.asarray(point), task, *arguments)
        return float(value), terms, np.asarray(slope)

    for copies in (1, 2):
        terms = problem.terms_of(build(point), task.first(copies))
        expected = float(terms.value)
        for name, levels in terms.inequalities.items():
            m, g = np.asarray(multipliers[name]), np.asarray(levels)
            penalty = float(penalties[name])
            expected += np.sum(np.maximum(m - penalty * g, 0) ** 2 - m**2) / (2 * penalty)
        value, same, slope = found(point, copies)
        np.testing.assert_allclose(value, expected, rtol=1e-12)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-12), terms, same)
    steps = 1e-6 * np.eye(len(point))
    rise = np.array([found(point + one, 2)[0] - found(point - one, 2)[0] for one in steps])
    # Rounding of the value, over the step.
    rounding = 50 * np.finfo(float).eps * abs(value) / 2e-6
    np.testing.assert_allclose(slope, rise / 2e-6, rtol=1e-5, atol=max(rounding, 1e-5))
    assert np.max(np.abs(slope)) > 1


@pytest.mark.slow
@pytest.mark.usefixtures("few_looks")
def test_gradients_of_the_whole_problem_are_central_differences():
    """Compiled and batched, against differences from the same program."""
    task, (point, build) = problem.Task.of(POOR, SMALL, 0), off_kinks(GIVEN)
    weights = jax.random.uniform(jax.random.key(1), (task.plain * SMALL.search.poses, 3))

    def value(point):
        terms = problem.terms_of(build(point), task)
        # What is not seen has a resolution that stands for none.
        sharp = jnp.minimum(terms.inequalities["resolution"], 10.0)
        return terms.value + jnp.sum(weights * sharp) + jnp.sum(terms.inequalities["clearance"])

    steps = 1e-6 * np.eye(len(point))
    points = jnp.asarray(np.concatenate([point[None], point + steps, point - steps]))
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(value)))(points)
    expected = (values[1:12] - values[12:]) / 2e-6
    assert bool(jnp.all(jnp.isfinite(slopes)))
    assert float(jnp.max(jnp.abs(slopes[0]))) > 0.01
    # Rounding of values up to 200, over the step.
    np.testing.assert_allclose(slopes[0], expected, rtol=1e-5, atol=2e-6)


def test_resolution_dips_beside_a_hand_over():
    """Two views of one pad: one sharp as far as 0.4, one blurred from 0.4 on."""

    def of(start, end, squares):
        shape, distance = (1, 2), jnp.sqrt(jnp.asarray([squares]))
        labels = dict.fromkeys(("path", "start_label", "end_label"), jnp.zeros(shape, int))
        empty = {"pixels": jnp.zeros((*shape, 2)), "spans": jnp.zeros((*shape, 1, 2))}
        ends = {"start": jnp.asarray([start]), "end": jnp.asarray([end])}
        sharp = {"distance": distance, "px_per_mm": 500 / distance**2}
        return Pieces(present=jnp.ones(shape, bool), **labels, **empty, **ends, **sharp)

    # A pad of 10 mm along x, seen from (0, 10) and from (-8, 10): 50 / distance² px/mm.
    squares, lengths = [[100.0, 116.0], [244.0, 424.0]], jnp.asarray([10.0])
    views = of([0.0, 0.4], [0.4, 1.0], squares)
    np.testing.assert_allclose(least_resolution(views, lengths), [500 / 424])
    # If the second gets sharper from there on, it is least where it takes over.
    squares[1] = [244.0, 164.0]
    views = of([0.0, 0.41], [0.41, 1.0], squares)
    np.testing.assert_allclose(least_resolution(views, lengths), [500 / 244])


def test_the_yield_is_that_of_fingers_built_one_by_one(monkeypatch):
    monkeypatch.setattr(yields, "BLOCK", 4)
    errors = sample_errors(SPEC.tolerances, 2, 6, 5)
    found = yields.coverages(GIVEN, errors)
    whole = np.arange(91.0)
    others = yields.postures(GIVEN)[91:]
    assert set(others[:, 0]) == set(others[:, 1]) == set(whole)
    poses = jnp.asarray(np.deg2rad(np.concatenate([whole[:, None] * np.ones(2), others])))
    for entries, coverage in zip(errors, found, strict=True):
        assembled = perturb(GIVEN, jnp.asarray(entries))
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


def compared(*runs):
    """What the report has of runs: method, objective, violation and seconds."""
    out, columns = Report(package="studies.finger_mirrors"), zip(*runs, strict=True)
    names = ("method", "objective", "violation", "seconds")
    made = Records(dict(zip(names, map(list, columns), strict=True)))
    solvers.add_comparison(out, made | {"setting": "", "compile_seconds": 0.0})
    found = out.results().precision
    assert found is not None
    return found


@pytest.mark.parametrize("method", solvers.CHOICES["all"])
def test_every_solver_that_is_compared_solves(method):
    """The point of x + y ≥ 1 nearest to (1.2, −0.2), of which the first is at most 1: (1, 0).

    Few updates of the multipliers are left to it, as in the comparison.
    """

    def terms(point):
        missing = {"sum": point.sum()[None] - 1}
        return Evaluation(objective=jnp.sum((point - target) ** 2), inequalities=missing)

    target = jnp.array([1.2, -0.2])
    flat = Flat.of(Problem(terms, jnp.array([-5.0, -5.0]), jnp.array([1.0, 5.0])))
    found = solvers._solver(method, flat)(np.asarray(flat.point(jnp.array([0.3, 0.9]))))
    np.testing.assert_allclose(flat.parameters(jnp.asarray(found)), [1.0, 0.0], atol=0.05)


@pytest.mark.parametrize(
    ("own", "holds"),
    [((1.0, 0.0, 10.0), True), ((1.0, 0.5, 10.0), False), ((1.0, 0.0, 40.0), False),
     ((2.5, 0.0, 10.0), False)],
)  # fmt: skip
def test_the_claim_can_be_proved_wrong(own, holds):
    (claim,) = compared((solvers.OURS, *own), (solvers.EVOLUTION, 2.0, 0.0, 30.0)).claims
    assert claim.holds == holds


def test_gaps_are_to_the_best_that_holds_the_inequalities():
    runs = [("a", 1.0, 0.5, 1.0), ("b", 3.0, 0.0, 1.0), (solvers.EVOLUTION, 4.0, 0.0, 1.0)]
    rows = compared(*runs).rows
    gaps = [row.error for row in rows if row.panel == solvers.GAP]
    violations = [row.error for row in rows if row.panel == solvers.VIOLATION]
    np.testing.assert_array_equal(gaps, [np.nan, 0.0, 0.01])  # in pads, from % of one
    assert violations == [0.5, 0.0, 0.0]


QUICK = {"draws": 12, "rays": 5000, "ray_poses": 2, "solvers": "none", "thin": 0}


@pytest.mark.slow
@pytest.mark.usefixtures("few_looks")
def test_the_study_end_to_end(monkeypatch):
    """All of it but the solvers, after a search that is cut short, at every tenth degree."""
    monkeypatch.setattr(designing, "STAGES", (Stage(2.0, 0.0), Stage(1.0, 100.0)))
    for module in (judging, yields):
        monkeypatch.setattr(module, "whole_degrees", lambda end: np.arange(0.0, end + 1, 10.0))
    how = {"starts": 1, "copies": 2, "poses": 2}
    given = {"camera": {"fov_deg": 160}, "pads": BARE["pads"]}
    results = run_study("finger-mirrors", {**QUICK, "search": how, "left_out": False, **given})
    metrics = {metric.name: metric for metric in results.metrics}
    assert metrics["start_coverage"].value < 0.6
    assert metrics["yield"].met is None  # of so few draws
    assert metrics["row_disagreement"].met
    # The optimum may show everything everywhere, the poor layout shows parts.
    assert judging.coverage_grid(POOR).disagreement < 1e-12
    assert metrics["mirror_given_layout_mm"].value == pytest.approx(69.62, abs=0.01)
    assert "worst_coverage_thin" not in metrics
    tables = {table.name: table for table in results.tables}
    assert [row[0] for row in tables["starts"].rows] == ["poor", "random 1"]
    (file,) = results.specs
    scene = parse_scene(tomllib.loads(str(file.content)))
    (place,) = [row for row in tables["arrangements"].rows if row[0] == "camera x (mm)"]
    assert float(scene.camera.position[0]) == pytest.approx(place[2])


def test_random_starts_are_drawn_by_their_heights():
    """The seed's Sobol points over heights above the axes, whatever a finger stores."""
    task = problem.Task.of(POOR, SMALL, 0)
    least, greatest = bounds(POOR, SMALL)
    _, start = designing.first_placements(POOR, SMALL, 0)
    points = draw_sobol_starts(problem.problem_of(SMALL, task), 1, 0)
    first, low, high, point = map(camera_of, (start, least, greatest, points))
    assert (first.along, first.tilt) == (point.along[0], point.tilt[0])
    np.testing.assert_allclose(first.depth, low.depth + high.depth - point.depth[0])
    for mirror, low, high, point in zip(
        start.mirrors, least.mirrors, greatest.mirrors, points.mirrors, strict=True
    ):
        np.testing.assert_array_equal(mirror.ends[:, 0], point.ends[0, :, 0])
        np.testing.assert_allclose(mirror.ends[:, 1], (low.ends + high.ends - point.ends[0])[:, 1])


def test_a_share_is_rounded_down():
    assert (percent_at_least(1.0), percent_at_least(0.99999)) == ("100 %", "99.99 %")
