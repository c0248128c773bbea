"""The study ``finger-linkage``: its postures, its judgement and its search, by independent code."""

import cmath
import functools
import math
import tomllib
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.optimize import EpigraphVariables, Evolution, Optimum, OptimumResult
from designopt.optimize.augmented_lagrangian import Trace
from designopt.plot.figures import trim
from designopt.solution import Solution
from designopt.study.results import Table
from kinematics import parse_linkage, solve_poses
from studies.finger_linkage import comparisons
from studies.finger_linkage.comparing import Comparison, Run, precision_study
from studies.finger_linkage.statements import _yardstick
from studies.models.body import BodySpec
from studies.models.linkage_design import tables
from studies.models.linkage_design.analysis import sensor_room
from studies.models.linkage_design.figures import sequence_figure
from studies.models.linkage_design.judging import judged
from studies.models.linkage_design.postures import find_postures
from studies.models.linkage_design.problem import SYMBOLS, grid, inequalities, linkage_problem
from studies.models.linkage_design.searching import least_angles_deg, over, rounded, search
from studies.models.linkage_design.spec import FingerLinkageSpec, LimitsSpec, SearchSpec, SensorSpec
from studies.models.linkage_design.tolerance import least_angles
from studies.models.linkage_design.transmission import finger_transmission
from studies.models.pins import Pins, reference_pins
from studies.models.spec_files import linkage_file
from tests.readable import assert_readable
from tests.studies.fingers import finger_of

REFERENCE, LIMITS = finger_of(), LimitsSpec()
BODY = REFERENCE.body
COARSE = grid(BODY, 15.0)

OTHER = Pins(
    F=np.array([-7.77, -1.98]),
    E=np.array([-4.72, 18.98]),
    D=np.array([3.0, 12.11]),
    C=np.array([22.43, 5.99]),
    G=np.array([13.13, -1.98]),
    H=np.array([12.66, 10.95]),
)
"""A design of another kind: its crank stands upright."""


@jax.jit
def postures(pins, pip, dip):
    return find_postures(replace(REFERENCE, pins=pins), pip, dip)


def meeting(p, u, q, v):
    """Where the lines p + s u and q + t v meet, in complex numbers."""
    cross = (u.conjugate() * v).imag
    return p + u * ((q - p).conjugate() * v).imag / cross


def circles(center, radius, other, radius_other, near):
    """The point of both circles that is nearer to a given one."""
    step = other - center
    along = (abs(step) ** 2 + radius**2 - radius_other**2) / (2 * abs(step))
    across = math.sqrt(radius**2 - along**2)
    unit = step / abs(step)
    return min(
        (center + unit * complex(along, s * across) for s in (1, -1)), key=lambda z: abs(z - near)
    )


def folded(u, v):
    """The angle between two lines, degrees."""
    angle = abs(math.degrees(cmath.phase(u / v))) % 180
    return min(angle, 180 - angle)


@functools.cache
def walked(kind):
    return walk({"reference": reference_pins(), "other": OTHER}[kind], COARSE)


def walk(pins, flexion):
    """Angles (degrees), crank turn (rad), and places over all postures, walked from the straight
    finger posture by posture with circles that meet: no code of the library."""
    at = {n: complex(*np.asarray(getattr(pins, n))) for n in "FEDCGH"}
    length = float(BODY.intermediate)
    angles = {name: np.zeros((len(flexion),) * 2) for name in SYMBOLS}
    crank, places = np.zeros((len(flexion),) * 2), {}

    def moved(dip):
        return length + (at["C"] - length) * cmath.exp(-1j * dip)

    inner, h, before = [], at["H"], 0.0
    for dip in flexion:
        # In small steps, so that of both points where circles meet the nearer one is the right one.
        for way in np.linspace(before, dip, 20):
            h = circles(moved(way), abs(at["H"] - at["C"]), at["G"], abs(at["H"] - at["G"]), h)
        c, before = moved(dip), dip
        inner.append((c, c + (at["D"] - at["C"]) * (h - c) / (at["H"] - at["C"]), h))
    for j in range(len(flexion)):
        e = at["E"] if j == 0 else places[0, j - 1]["E"]
        for i, pip in enumerate(flexion):
            turn = cmath.exp(-1j * pip)
            c, d, h = (place * turn for place in inner[j])
            b, g = length * turn, at["G"] * turn
            e = circles(at["F"], abs(at["E"] - at["F"]), d, abs(at["E"] - at["D"]), e)
            rod, bar, phalanx = d - e, h - g, c - b
            center, point = meeting(b, phalanx, g, bar), meeting(e, rod, g, bar)
            found = {
                "D1": folded(rod, d),
                "D2": folded(rod, d - center),
                "C": folded(phalanx, h - c),
                "H": folded(h - c, bar),
                "E": folded(rod, e - at["F"]),
                "P": folded(c - point, phalanx),
            }
            for name, value in found.items():
                angles[name][i, j] = value
            crank[i, j] = -cmath.phase((e - at["F"]) / (at["E"] - at["F"]))
            places[i, j] = dict(zip("ECDH", (e, *inner[j]), strict=True))
    return angles, crank, places


@pytest.mark.parametrize("kind", ["reference", "other"])
def test_postures_are_those_walked_with_circles(kind):
    pins = {"reference": reference_pins(), "other": OTHER}[kind]
    angles, crank, places = walked(kind)
    flexion = jnp.asarray(COARSE)
    found = postures(pins, flexion, flexion)
    for name, values in found.angles.items():
        np.testing.assert_allclose(
            np.broadcast_to(np.rad2deg(values), crank.shape), angles[name], atol=1e-9, err_msg=name
        )
    np.testing.assert_allclose(found.crank, crank, atol=1e-12)
    outer = np.asarray(found.outer["E"].x) + 1j * np.asarray(found.outer["E"].y)
    plate = np.asarray(found.inner["D"].x) + 1j * np.asarray(found.inner["D"].y)
    for (i, j), at in places.items():
        assert abs(outer[i, j] - at["E"]) < 1e-10
        assert abs(plate[j] - at["D"]) < 1e-10
    assert float(jnp.min(found.reach[0])) > 0
    assert float(jnp.min(found.reach[1])) > 0


def test_postures_are_those_of_the_general_solver():
    angles = jnp.asarray(COARSE)
    found = postures(reference_pins(), angles, angles)
    square = jnp.stack(jnp.meshgrid(angles, angles, indexing="ij"), axis=-1)
    poses = jax.jit(solve_poses)(REFERENCE.linkage(), -square)
    assert bool(jnp.all(poses.ok))
    for name, values in finger_transmission(poses.value).items():
        np.testing.assert_allclose(
            np.broadcast_to(found.angles[name], values.shape), values, atol=1e-12
        )


def test_ratios_are_the_slopes_of_the_cranks_turn():
    step = 1e-5
    pip, dip = jnp.array([0.3, 0.3 + step, 0.3 - step]), jnp.array([0.9, 0.9 + step, 0.9 - step])
    found = postures(reference_pins(), pip, dip)
    by_pip = (found.crank[1, 0] - found.crank[2, 0]) / (2 * step)
    by_dip = (found.crank[0, 1] - found.crank[0, 2]) / (2 * step)
    np.testing.assert_allclose(found.pip_ratio[0, 0], by_pip, rtol=1e-8)
    np.testing.assert_allclose(found.dip_ratio[0, 0], by_dip, rtol=1e-8)
    inner = np.asarray(found.inner["D"].stacked()) - np.asarray(found.inner["C"].stacked())
    plate = np.arctan2(inner[:, 1], inner[:, 0]) + np.asarray(dip)  # to the distal phalanx
    np.testing.assert_allclose(found.gamma_slope[0], (plate[1] - plate[2]) / (2 * step), rtol=1e-7)


def test_ratio_of_design_b():
    """φ₂/φ₁ from 0.23 to 0.46, a figure of the independent search."""
    verdict = judged(REFERENCE, LIMITS)
    assert abs(verdict.ratio.min() - 0.23) < 0.005
    assert abs(verdict.ratio.max() - 0.46) < 0.005


def test_gradients_of_the_problem_compiled_and_batched():
    problem = linkage_problem(REFERENCE, LIMITS, COARSE[::3], COARSE[::3])

    def numbers(pins):
        terms = problem.terms(pins, *problem.data)
        parts = [*(terms.least or {}).values(), *terms.inequalities.values()]
        total = jnp.zeros(())
        for number, part in enumerate(parts):
            total = total + jnp.sum(jnp.sin(part * (1 + number)))
        return total

    batch = jax.tree.map(lambda a, b: jnp.stack([a, b]), reference_pins(), OTHER)
    slopes = jax.jit(jax.vmap(jax.grad(numbers)))(batch)
    compiled, step = jax.jit(numbers), 1e-5
    for index, pins in enumerate((reference_pins(), OTHER)):
        leaves, structure = jax.tree.flatten(pins)
        for which, slope in enumerate(jax.tree.leaves(slopes)):
            for axis in range(2):
                ends = []
                for sign in (1, -1):
                    moved = list(leaves)
                    moved[which] = leaves[which].at[axis].add(sign * step)
                    ends.append(float(compiled(jax.tree.unflatten(structure, moved))))
                difference = (ends[0] - ends[1]) / (2 * step)
                assert abs(float(slope[index, axis]) - difference) < 1e-5 * (1 + abs(difference))


def test_gradients_stay_finite_where_nothing_assembles():
    far = jax.tree.map(lambda leaf: leaf, reference_pins())
    broken = Pins(far.F, far.E, far.D, far.C, far.G, far.G)  # the bar has no length
    problem = linkage_problem(REFERENCE, LIMITS, COARSE[::3], COARSE[::3])

    def total(pins):
        terms = problem.terms(pins, *problem.data)
        value = jnp.zeros(())
        for part in [*(terms.least or {}).values(), *terms.inequalities.values()]:
            value = value + jnp.sum(part)
        return value

    value, slopes = jax.jit(jax.value_and_grad(total))(broken)
    assert np.isfinite(float(value))
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(slopes))


@pytest.mark.parametrize("kind", ["reference", "other"])
def test_judgement_is_that_of_walked_postures(kind):
    pins = {"reference": reference_pins(), "other": OTHER}[kind]
    verdict = judged(finger_of(pins), LIMITS)
    angles, crank, places = walked(kind)
    every = np.rint(np.rad2deg(COARSE)).astype(int)
    for name, values in angles.items():
        mine = verdict.angles_deg[SYMBOLS[name]][np.ix_(every, every)]
        np.testing.assert_allclose(mine, values, atol=1e-9)
    np.testing.assert_allclose(
        verdict.crank_deg[np.ix_(every, every)], np.rad2deg(crank), atol=1e-9
    )
    checks = {check.name: check for check in verdict.checks}
    inside = min(
        min(at["E"].imag - BODY.palmar, BODY.dorsal - at["E"].imag, at["E"].real + BODY.proximal)
        for at in places.values()
    )
    assert abs(checks["pin E inside the proximal phalanx"].achieved - inside) < 0.02
    assert checks["|AF|"].achieved == pytest.approx(abs(complex(*np.asarray(pins.F))))
    assert not verdict.unmet


def test_judgement_finds_what_is_not_met():
    tight = LimitsSpec(clearance=2.5, crank_length=20.0, force_ratio=0.4, crank_range_deg=80.0)
    unmet = {check.name for check in judged(REFERENCE, tight).unmet}
    assert {"|EF|", "φ₂/φ₁", "range of the crank", "pin F inside the proximal phalanx"} <= unmet


def test_inequalities_and_judgement_agree():
    other, flexion = finger_of(OTHER), jnp.asarray(grid(BODY, 1.0))
    found = inequalities(other, postures(OTHER, flexion, flexion), LIMITS)
    worst = {name: float(jnp.min(values)) for name, values in found.items()}
    checks = {check.name: check for check in judged(other, LIMITS).checks}
    assert min(worst.values()) >= 0
    assert worst["|EF|"] * 5 == pytest.approx(checks["|EF|"].slack)
    sides = [
        worst[f"pin E inside the {side}"] for side in ("palmar face", "dorsal face", "rear end")
    ]
    assert min(sides) * 5 == pytest.approx(checks["pin E inside the proximal phalanx"].slack)


def test_requirements_are_told_in_words():
    problem = linkage_problem(REFERENCE, LIMITS, COARSE, COARSE)
    told = problem.requirements
    assert told["μ_C"].words((6,)) == "μ_C at DIP 90°"
    assert told["μ_D1"].words((6, 0)) == "μ_D1 at PIP 90°, DIP 0°"
    assert told["pins apart"].words((0,)) == "distance of pins A and F"
    assert told["pin G' inside the palmar face"].words((2,)).endswith("palmar face at DIP 30°")
    names = problem.terms(reference_pins(), *problem.data).inequalities
    assert set(names) <= set(told)


def test_tolerance_of_design_b():
    """±0.1 mm on every coordinate leave 45.2 ± 0.7°, a figure of the independent search."""
    least = least_angles(REFERENCE, 0.1, 600, 0)
    assert abs(least.mean() - 45.2) < 0.1
    assert abs(least.std() - 0.7) < 0.1
    exact = least_angles(REFERENCE, 0.0, 10, 0)
    np.testing.assert_allclose(exact, exact[0])
    assert abs(exact[0] - 46.3) < 0.1


def test_room_for_the_sensor():
    """The links' loops have six and four links, so that two layers are enough."""
    room = sensor_room(SensorSpec(finger_width=34, pad_width=24, link_thickness=2))
    assert room.achieved == 34 - 2 * 2 * 2
    assert room.met
    assert not sensor_room(SensorSpec(link_thickness=2.6)).met


def test_rounded_designs_are_multiples():
    off = jax.tree.map(lambda leaf: leaf + 0.00317, reference_pins())
    for leaf in jax.tree.leaves(rounded(off, 0.01)):
        assert all(float(f"{value:.2f}") == value for value in np.asarray(leaf).tolist())


def test_designs_are_rounded_to_any_step():
    found = rounded(jax.tree.map(lambda leaf: jnp.full_like(leaf, 0.4), reference_pins()), 0.125)
    assert all(leaf.tolist() == [0.375, 0.375] for leaf in jax.tree.leaves(found))


def test_a_comparison_without_a_feasible_run_has_no_best():
    run = Run("a", "1 start", 30.0, 0.5, 1.0, 0.0)
    lost = Run("b", "1 start", -math.inf, 0.0, 1.0, 0.0)
    rows = np.zeros(1)
    evolution = Evolution(rows + 1.0, rows - 0.5, rows, None)
    found = Comparison((run, lost), evolution)
    assert math.isnan(found.best_deg)
    assert len(comparisons.table(found).rows) == 2
    assert not precision_study(found).claims[0].holds
    assert all(math.isnan(metric.value) for metric in _yardstick(found))


def test_the_linkage_file_is_the_design():
    text = str(linkage_file(REFERENCE).content)
    linkage = parse_linkage(tomllib.loads(text))
    angles = -jnp.deg2rad(jnp.array([[0.0, 0.0], [40.0, 70.0]]))
    mine = solve_poses(linkage, angles).value
    other = solve_poses(REFERENCE.linkage(), angles).value
    np.testing.assert_allclose(mine.position("E"), other.position("E"), atol=1e-12)


@pytest.mark.parametrize("distal", [32.0, 80.0])
def test_the_sequences_show_all_of_a_finger_of_any_length(distal):
    drawing = sequence_figure(finger_of(distal=distal)).drawing
    trim(drawing)
    assert_readable(drawing)
    assert float(
        np.asarray(drawing.axes[0].patches[2].get_path().vertices)[:, 0].max()
    ) == pytest.approx(23 + distal)
    for axes in drawing.axes:
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        for phalanx in axes.patches:
            x, y = np.asarray(phalanx.get_path().vertices).T
            assert left < x.min() < x.max() < right
            assert low < y.min() < y.max() < high


def test_bounds_are_told_by_the_papers_pins():
    """A pin of the plate a millimetre too high: its distance from the bound, in mm."""
    problem = over(REFERENCE, FingerLinkageSpec(), *2 * (np.deg2rad([0.0, 12.0]),))
    told = problem.parameters["H"]
    assert told.words((1,)) == "y of pin G'"
    assert (told.unit, told.scale) == ("mm", 1.0)


def test_a_start_is_told_by_its_angle_and_not_by_the_level_it_was_left_at():
    """The level of the epigraph form may end below every angle, even below 0."""
    flexion = np.deg2rad([0.0, 45.0, 90.0])
    problem = over(REFERENCE, FingerLinkageSpec(), flexion, flexion)
    level, zero = jnp.asarray(-0.04), jnp.asarray(0.0)
    solution = Solution(
        EpigraphVariables(reference_pins(), level), zero, zero, OptimumResult.successful
    )
    trace = Trace(jnp.zeros(1), jnp.zeros(1), jnp.zeros(1, int))
    (least,) = least_angles_deg(problem, [Optimum(solution, 0.4, {}, {}, trace, {})])
    angles = walk(reference_pins(), flexion)[0]
    assert least == pytest.approx(min(values.min() for values in angles.values()), abs=1e-6)


def test_tables_of_dimensions():
    pins, lengths = tables.dimensions(REFERENCE)
    assert isinstance(pins, Table)
    assert dict(zip([row[0] for row in pins.rows], pins.rows, strict=True))["G'"][1:3] == (
        15.0,
        19.0,
    )
    by_name = {(row[0], row[1]): row[2] for row in lengths.rows}
    assert by_name["crank", "E-F"] == pytest.approx(math.hypot(-21.27 + 7.75, 14.06 + 2))
    assert len(by_name) == 10


@pytest.mark.slow
def test_a_quick_search_beats_design_b():
    how = SearchSpec(starts=4, among=4096, exchanges=1, step_deg=30.0, finalists=1)
    spec = FingerLinkageSpec(search=how)
    found = search(spec, 0)
    verdict = judged(found.finger, LIMITS)
    assert verdict.least_deg > judged(REFERENCE, LIMITS).least_deg
    assert found.held_by()
    assert found.seconds > 0
    assert sum(one.share for one in found.held_by()) <= 1 + 1e-9


ASKED = [(25.0, None, 49.0), (22.0, None, 46.5), (20.0, None, 42.5), (25.0, 0.412, 43.5)]


@pytest.mark.nightly
@pytest.mark.parametrize(("thickness", "ratio", "asked"), ASKED)
def test_the_search_reaches_what_is_asked(thickness, ratio, asked):
    body, limits = BodySpec(thickness=thickness), LimitsSpec(force_ratio=ratio)
    found = search(FingerLinkageSpec(body=body, limits=limits), 0)
    verdict = judged(found.finger, limits)
    assert not verdict.unmet
    assert verdict.least_deg >= asked
    assert_walked(found.finger.pins, thickness, ratio, verdict.least_deg)


def assert_walked(pins, thickness, ratio, least_deg):
    """All requirements once more on the 1° grid, in plain complex numbers."""
    flexion = np.deg2rad(np.arange(91.0))
    # Circles meet everywhere, or there would be no walk.
    angles, crank, places = walk(pins, flexion)
    assert min(values.min() for values in angles.values()) == pytest.approx(least_deg, abs=1e-6)
    at = {name: complex(*np.asarray(getattr(pins, name))) for name in "FEDCGH"} | {"A": 0, "B": 23}
    assert (np.diff(crank, axis=0) > 0).all()
    assert (np.diff(crank, axis=1) > 0).all()
    assert np.ptp(crank) <= math.radians(150)
    row = [places[0, j] for j in range(len(flexion))]
    plate = [one["D"] - one["C"] for one in row] * np.exp(1j * flexion)
    assert len(set(np.sign(np.diff(np.unwrap(np.angle(plate)))))) == 1
    low, high = -4 + 2, thickness - 4 - 2

    def inside(z):
        return low <= z.imag <= high

    assert inside(at["F"])
    assert inside(at["G"])
    assert inside(at["C"])
    assert at["F"].real >= -35 + 2
    assert at["C"].real <= 23 + 32 - 2
    assert all(inside(z) for one in places.values() for z in (one["E"], one["D"], one["H"]))
    assert all(one["E"].real >= -35 + 2 for one in places.values())
    for pair in ("AF", "AG", "BG", "BC", "CD", "CH", "DH", "DE", "EF", "GH"):
        assert abs(at[pair[0]] - at[pair[1]]) >= 6
    assert abs(at["F"]) >= 8
    assert abs(at["E"] - at["F"]) <= 22
    if ratio is not None:
        by_pip, by_dip = np.gradient(crank, flexion, flexion, edge_order=2)
        # Differences over a degree.
        assert (by_dip / by_pip).max() <= ratio + 1e-3


@pytest.mark.slow
def test_requirements_that_conflict_are_named():
    """A crank no longer than 5 mm with pins 6 mm apart: half of what is missing goes to each."""
    how = SearchSpec(starts=4, among=4096, step_deg=30)
    found = search(FingerLinkageSpec(limits=LimitsSpec(crank_length=5.0), search=how), 0)
    assert not found.best.feasible
    assert not found.held_by()
    missing = (6.0 - 5.0 + 2 * how.allowance) / 2
    told = {f"|EF| by {missing:.3g} mm", f"distance of pins E and F by {missing:.3g} mm"}
    assert set(found.conflict()) == told


def test_the_problem_over_other_postures_has_their_words():
    flexion = np.deg2rad([0.0, 12.0])
    problem = over(REFERENCE, FingerLinkageSpec(), flexion, flexion)
    assert problem.requirements["μ_E"].words((1, 0)) == "μ_E at PIP 12°, DIP 0°"
