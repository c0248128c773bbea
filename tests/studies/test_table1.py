"""The study ``table1`` against the paper's table, and its parts against independent means."""

import math
from contextlib import nullcontext
from typing import get_args

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.optimize

from designopt import Report, assess
from designopt.roots import RootMethod
from designopt.study.study import Context
from studies.benchmarks import chamber as benchmark
from studies.models.soft_finger import imaging, paper
from studies.models.soft_finger.spec import ChamberSpec
from studies.oracles import chamber as exact
from studies.stability import chamber as stability
from studies.table1 import Table1Spec
from studies.table1.analysis import OTHER_READING, analyze, real_lens
from studies.table1.run import add_operations, run
from tests.helpers import load_toml, marked, nightly

TABLE = load_toml("table1.toml")
PRINTED = imaging.printed_chamber(ChamberSpec())


METHODS = {"closed form", "SciPy brentq", *map(benchmark.method_name, get_args(RootMethod))}


@pytest.fixture(scope="module")
def solved():
    return imaging.solve(PRINTED, jnp.asarray(1.5))


def test_the_paper_is_copied_correctly():
    copied = {"eta": paper.ETA, "delta_l_d_cm": paper.DELTA_L_D_CM}
    copied["theta_cd_deg"] = paper.THETA_CD_DEG
    assert {name: tuple(cells) for name, cells in TABLE["paper"].items()} == copied


def test_the_identified_constants_give_all_18_cells_and_the_printed_ones_none(solved):
    table = solved.identified.table
    for name, digits in (("eta", 1), ("delta_l_d_cm", 3), ("theta_cd_deg", 3)):
        cells = [round(cell, digits) for cell in getattr(table, name).tolist()]
        assert cells == TABLE["paper"][name]
    assert (table.matched(), solved.printed.table.matched()) == (18, 0)


def test_the_lines_are_those_found_when_the_paper_was_read(solved):
    tolerance = TABLE["lines"]["tolerance"]
    for constants, line in ((solved.printed, "printed"), (solved.identified, "table")):
        assert abs(float(constants.slope) - TABLE["lines"][line]["slope"]) < tolerance
        assert abs(float(constants.intercept) - TABLE["lines"][line]["intercept"]) < tolerance


def test_identification_agrees_with_scipy_on_eq_1(solved):
    """SciPy's least squares over Δl_D written out from Eqs. 1-3 without any factoring."""

    def residuals(constants):
        height, offset = constants
        offset_c = 2 - 30 * math.tan(math.radians(2))
        eta = np.array(TABLE["paper"]["eta"])
        image_c, image_b = (height + offset_c) / (70 + offset), (height + 2) / (40 + offset)
        offset_d = height - (100 + offset) * ((1 + eta) * image_c - eta * image_b)
        angle = np.rad2deg(np.arctan((offset_c + offset_d) / 30))
        return np.concatenate(
            [offset_d / 10 - TABLE["paper"]["delta_l_d_cm"], angle - TABLE["paper"]["theta_cd_deg"]]
        ) / (1e-3 / math.sqrt(12))

    expected = scipy.optimize.least_squares(
        residuals, [4.1, 4.0], xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    assert bool(solved.fit.solution.ok)
    np.testing.assert_allclose(solved.fit.solution.value, expected.x, rtol=1e-6)
    np.testing.assert_allclose(solved.fit.residuals, expected.fun, atol=1e-4)
    covariance = np.linalg.inv(expected.jac.T @ expected.jac)
    np.testing.assert_allclose(solved.fit.covariance, covariance, rtol=1e-3)
    height, offset = solved.fit.solution.value.tolist()
    asked = TABLE["identified"]
    assert abs(height - asked["reference_height_mm"]) < asked["tolerance"]
    assert abs(offset - asked["pinhole_offset_mm"]) < asked["tolerance"]
    # Half a unit in the last place is √3 standard deviations of the rounding.
    assert np.abs(solved.fit.residuals).max() < math.sqrt(3)


def test_the_table_cannot_tell_the_two_readings_apart():
    other = imaging.solve(imaging.printed_chamber(OTHER_READING), jnp.asarray(1.5))
    assert abs(float(other.chosen.offset_c - PRINTED.offset_c)) < 2.5e-4
    assert other.identified.table.matched() == 18
    assert abs(float(other.identified.chamber.pinhole_offset) - 0.844) > 1


def test_the_largest_ratio_is_where_the_clearance_runs_out(solved):
    chamber, clearances = solved.identified.chamber, np.array([0.5, 1.5, 3.0])
    choices = jax.jit(jax.vmap(imaging.largest_ratio, in_axes=(None, 0)))(chamber, clearances).value
    left = jax.jit(jax.vmap(imaging.clearance_at, in_axes=(None, 0)))

    def spare(ratio, clearance):
        return float(left(chamber, np.full(50, ratio))[0]) - clearance

    for clearance, choice in zip(clearances, np.asarray(choices), strict=True):
        wanted = scipy.optimize.brentq(spare, 0.4, 1.0, args=(clearance,))
        assert choice == pytest.approx(wanted, rel=1e-9)
        # Nothing above it keeps the clearance.
        assert left(chamber, choice + np.linspace(1e-6, 3.0, 50)).max() < clearance
    assert float(solved.choice.value) == pytest.approx(float(choices[1]), rel=1e-12)


def test_the_largest_ratio_on_a_falling_line():
    falling = imaging.with_constants(PRINTED, jnp.asarray([-30.0, 0.844]))
    choice = imaging.largest_ratio(falling, jnp.asarray(1.5))
    slope = imaging.with_ratio(falling, jnp.asarray(1.0)).offset_d
    slope -= imaging.with_ratio(falling, jnp.asarray(0.0)).offset_d
    at_edge = imaging.with_ratio(falling, choice.value).offset_d
    np.testing.assert_allclose(jnp.abs(at_edge), 2.6, rtol=1e-9)
    np.testing.assert_array_equal(jnp.sign(at_edge), jnp.sign(slope))


def test_the_papers_ratio_is_the_largest_for_its_own_clearance(solved):
    again = imaging.solve(PRINTED, solved.paper_clearance)
    np.testing.assert_allclose(again.choice.value, paper.CHOSEN_ETA, rtol=1e-9)
    np.testing.assert_allclose(solved.paper_clearance, 4.1 - 2.55, atol=5e-3)  # Table I: 0.255 cm


def test_the_real_lens_is_gausss():
    lens = real_lens(PRINTED, jnp.asarray(2.0), jnp.asarray(0.01))
    np.testing.assert_allclose(1 / np.asarray(lens.distances) + lens.images.vergence, 1 / 4.0)
    np.testing.assert_allclose(lens.distances, [44.0, 74.0, 104.0])
    np.testing.assert_allclose(lens.lens.aperture, 2.0)
    np.testing.assert_allclose(lens.refocused.image(74.0).value.blur_diameter, 0, atol=1e-14)
    for vergence in lens.depth_of_field.tolist():
        blur = lens.refocused.image(1 / vergence).value.blur_diameter
        np.testing.assert_allclose(blur, 0.01, rtol=1e-9)
    np.testing.assert_allclose(lens.hyperfocal_distance, 4.0 * 2.0 / 0.01 + 4.0)


def test_the_other_reading_stands_only_beside_the_papers_chamber():
    assert analyze(Table1Spec()).other_reading is not None
    changed = Table1Spec.model_validate({"chamber": {"offset_b": 2.5}})
    assert analyze(changed).other_reading is None


def test_the_exact_forms_are_those_of_the_library():
    fields = {name: float(getattr(PRINTED, name)) for name in (*benchmark.FIELDS, "offset_d")}
    with mpmath.workdps(30):
        chamber = {name: mpmath.mpf(value) for name, value in fields.items()}
        found, ratio = PRINTED.imaging_ratio(), exact.imaging_ratio(**chamber)
        np.testing.assert_allclose(float(ratio), found.value, rtol=1e-13)
        np.testing.assert_allclose(float(exact.margin(**chamber)), found.margin)
        others = {name: value for name, value in chamber.items() if name != "pinhole_offset"}
        roots = exact.dimension_roots("pinhole_offset", ratio=ratio, sketch=3, **others)
        np.testing.assert_allclose(float(roots[0]), 4.0, rtol=1e-20)


@pytest.mark.parametrize("seed", [*marked("as_users", 1), *nightly(2, 3, 4, 5)])
def test_every_family_passes_for_other_seeds(seed):
    for family in stability.families(seed):
        for row in assess(family, ("float64", "float32")):
            assert (row.failures, row.non_finite) == (0, 0), row
            assert row.worst_gradient_error < 1e-6, row


def test_the_scene_needs_fewer_operations_than_the_general_program():
    out = Report(package="studies.table1")
    add_operations(out, PRINTED)
    for row in out.results().left_out:
        assert 0 < row.scene_operations < row.general_operations


def run_study(dtype="float64", **settings):
    settings = {"precision": False, "stability": False} | settings
    return run(Table1Spec.model_validate(settings), Context(0, dtype, lambda _: nullcontext()))


def test_the_study_meets_its_targets_and_its_table_has_the_papers_cells():
    results = run_study()
    metrics = {metric.name: metric.value for metric in results.metrics}
    assert not results.unmet
    assert metrics["cells_matched_identified"] == 18
    assert metrics["cells_matched_printed"] == 0
    assert metrics["worst_delta_l_d_printed_mm"] == pytest.approx(3.27, abs=0.005)
    assert metrics["worst_theta_cd_printed_deg"] == pytest.approx(5.93, abs=0.005)
    table, printed = results.tables[0], TABLE["paper"]["delta_l_d_cm"]
    cells = dict(zip(table.columns, zip(*table.rows, strict=True), strict=True))
    assert list(cells["paper_delta_l_d_cm"]) == printed
    np.testing.assert_allclose(cells["identified_delta_l_d_cm"], printed, atol=5e-4)


@pytest.mark.slow
def test_the_measurements_meet_their_targets():
    """Every method at its finest tolerance reaches the reference; a coarse one need not."""
    results = run_study(precision=True, stability=True, precision_problems=300, precision_repeats=3)
    assert not results.unmet
    assert results.precision is not None
    assert {row.method for row in results.precision.rows} == METHODS
    for row in results.precision.rows:
        if row.setting in ("", "tolerance 1e-14"):
            assert row.error < (2e-13 if "float64" in row.panel else 1e-5), row
        assert row.error < 0.2, row
    assert {row.dtype for row in results.stability} == {"float64", "float32"}


@pytest.mark.slow
def test_float32_meets_its_targets_too():
    with jax.enable_x64(False):
        assert not run_study("float32").unmet


def test_a_ratio_that_cannot_be_chosen_is_no_number():
    results = run_study(chamber={"wall_angle_bc_deg": 30}, clearance=0.0005)
    metrics = {metric.name: metric for metric in results.metrics}
    assert math.isnan(metrics["largest_ratio"].value)
    assert any(finding.startswith("No η could be chosen:") for finding in results.findings)
    assert "which is not the paper's" in results.findings[0]
    assert metrics["cells_matched_identified"].target is None
