"""Linkages as named distances: measures against closed forms and the library, and a search."""

import functools
import math
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError
from designopt.optimize.design_search import DesignSearch
from designopt.optimize.parametric import free_parameters, shortfalls
from kinematics import compute_spring_energy, find_limits, parse_linkage
from kinematics.export.drawing import linkage_quantities
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from kinematics.parametric.linkage_design import LinkageDesign
from kinematics.solve.transmission import solve_poses_and_angles
from tests.helpers import assert_same, check_gradients, marked, nightly
from tests.kinematics.gallery import (
    FOLDER,
    each_linkage,
    ends,
    four_bar,
    gallery,
    poses_of,
    tables_of,
    transmission_of,
)

NAMES: tuple[str, ...] = (
    "bodies.crank.O2-A",
    "bodies.coupler.A-B",
    "bodies.rocker.O4-B",
    "bodies.ground.O2-O4",
)
LENGTHS = 40.0, 120.0, 80.0, 100.0
SHORT: dict[str, float] = dict(zip(NAMES, (40.0, 100.0, 90.0, 170.0), strict=True))
"""A four-bar whose crank locks."""


@functools.cache
def designed(name):
    return DesignedLinkage.read(FOLDER / f"{name}.toml")


@functools.cache
def design_of(name):
    return LinkageDesign(designed(name))


def made(tables, **over):
    return LinkageDesign(DesignedLinkage.of(parse_sketch(tables, "x"), "x"), over)


@functools.cache
def evaluated(name):
    """Every measure of a gallery's linkage, compiled once."""
    design = design_of(name)
    return jax.jit(lambda values: design.evaluate(values, tuple(m.name for m in design.measures)))


def least_of_four_bar(lengths, crank):
    """Its transmission angle by the law of cosines, degrees."""
    a, b, c, d = lengths
    diagonal = a * a + d * d - 2 * a * d * np.cos(crank)
    return math.degrees(np.arccos(np.max(np.abs(b * b + c * c - diagonal) / (2 * b * c))))


@pytest.mark.parametrize("lengths", [LENGTHS, (30.0, 110.0, 90.0, 120.0)])
def test_a_four_bar_by_the_law_of_cosines(lengths):
    """Transmission is worst, and the margin least, where the crank lies along the ground."""
    a, b, c, d = lengths
    design, values = design_of("four-bar"), dict(zip(NAMES, lengths, strict=True))
    judged = design.judge(values)
    arrays = evaluated("four-bar")(design.vector(values))
    least = least_of_four_bar(lengths, np.array([0.0, math.pi]))
    margin = min(b + c - (a + d), abs(d - a) - abs(b - c))
    for measure in ("mu.B", "min_transmission"):
        np.testing.assert_allclose([judged[measure], arrays[measure].min()], least, atol=1e-9)
    np.testing.assert_allclose([judged["margin"], arrays["margin"].min()], margin, atol=1e-9)
    np.testing.assert_allclose([judged["size"], arrays["size"].max()], max(lengths))
    assert judged.keys() == {measure.name for measure in design.measures}
    # Each element of its array, at the crank angle that its words name.
    where = {measure.name: measure.where for measure in design.measures}["min_transmission"]
    cranks = [math.radians(float(where((n, 0)).split()[-1].rstrip("°"))) for n in range(41)]
    wanted = [least_of_four_bar(lengths, crank) for crank in cranks]
    np.testing.assert_allclose(arrays["min_transmission"][:, 0], wanted, atol=1e-9)
    assert where((3, 0)) == "of B at crank 27.00°"


def test_a_slider_crank_by_its_triangle():
    """The rod is steepest, by asin((a + e) / l), where the crank is square to the slide."""
    design = design_of("slider-crank")
    values = {"bodies.crank.O2-A": 50.0, "bodies.rod.A-C": 130.0}
    judged = design.judge(values)
    least = 90 - math.degrees(math.asin((50 + 20) / 130))
    np.testing.assert_allclose(judged["mu.C"], least, atol=1e-3)  # of the grid
    np.testing.assert_allclose(judged["margin"], 130 - 70, atol=1e-3)


@each_linkage(quick=("quick-return",))
def test_parameters_are_numbers_of_the_export_and_files_meet_what_they_ask(name):
    design = design_of(name)
    quantities = {one.name: one.value for one in linkage_quantities(designed(name))}
    for parameter in design.parameters:
        assert parameter.low < parameter.value < parameter.high
        np.testing.assert_allclose(quantities[parameter.name], parameter.value, rtol=1e-12)
    judged = design.judge(design.values())
    assert shortfalls(design.measures, judged, design.requirements) == []
    for measure, array in evaluated(name)(design.vector(design.values())).items():
        worst = np.max(array) if measure == "size" else np.min(array)
        # What is judged on a finer grid is not better; where cells are left out, nor the same.
        slack = 1e-9 if measure == "size" else np.inf
        assert worst - slack <= judged[measure] <= worst + 1e-9, measure


def test_the_working_range_is_2_percent_short_of_the_limits():
    """Of a Watt six-bar by `find_limits`, of a four-bar by the law of cosines."""
    low, high = (limit.value for limit in ends(find_limits(gallery("watt"), "crank")))
    inset = 0.02 * (high - low)
    ((first, last),) = design_of("watt").ranges
    np.testing.assert_allclose((first, last), (low + inset, high - inset), atol=1e-6)
    cranks = np.linspace(first, last, 2001)[:, None]
    angles = transmission_of(gallery("watt"), cranks).angles
    judged = design_of("watt").judge(design_of("watt").values())
    for pin, angle in angles.items():
        np.testing.assert_allclose(judged[f"mu.{pin}"], np.degrees(angle.min()), atol=0.01)
    limit = math.acos((40**2 + 170**2 - 190**2) / (2 * 40 * 170))
    for sketch in (15, 345):  # wherever its range is cut
        design = made(four_bar(40, 100, 90, 170, sketch_deg=sketch))
        ((first, last),) = design.ranges
        np.testing.assert_allclose((first, last), (-0.96 * limit, 0.96 * limit), atol=1e-6)
        least = least_of_four_bar((40, 100, 90, 170), 0.96 * limit)
        np.testing.assert_allclose(design.judge(design.values())["mu.B"], least, atol=1e-4)


def test_the_working_range_around_half_a_turn():
    """The same four-bar, assembled where the crank points away: it goes beyond 180°."""
    limit = math.acos((70**2 + 100**2 - 40**2) / (2 * 70 * 100))  # nearer, the rest cannot fold
    design = made(four_bar(70, 110, 70, 100, sketch_deg=90))
    ((first, last),) = design.ranges
    inset = 0.02 * 2 * (math.pi - limit)
    np.testing.assert_allclose(first, limit + inset, atol=1e-6)
    np.testing.assert_allclose(last, 2 * math.pi - limit - inset, atol=1e-6)


def test_several_inputs_are_judged_where_the_file_has_poses():
    """A five-bar assembles where its cranks' ends are no farther apart than both arms."""
    design = design_of("five-bar")
    left, right = design.cases.T
    ends = 12 + 4 * np.exp(1j * right) - 4 * np.exp(1j * left)
    margins = np.minimum(20 - abs(ends), abs(ends))
    assert 60 < len(margins) < 81
    assert margins.min() > 0.02 * 10
    judged = design.judge(design.values())
    angles = np.degrees(np.arccos(np.abs(1 - abs(ends) ** 2 / 200)))
    assert judged["min_transmission"] <= angles.min() + 1e-9
    assert 0.5 * margins.min() < judged["margin"] <= margins.min() + 1e-9


def test_a_given_range_is_asked_for_from_end_to_end():
    design = made(four_bar(40, 100, 90, 170, sketch_deg=15), crank=(0.0, 90.0))
    np.testing.assert_allclose(np.degrees(design.cases[[0, -1], 0]), (0, 90))
    judged = design.judge(design.values())
    margin = 190 - math.hypot(40, 170)
    np.testing.assert_allclose(judged["margin"], margin, atol=1e-9)
    beyond = made(four_bar(40, 100, 90, 170, sketch_deg=15), crank=(0.0, 180.0))
    judged = beyond.judge(beyond.values())
    np.testing.assert_allclose(judged["margin"], 190 - 210, atol=1e-9)
    assert judged["min_transmission"] == 0
    ((bound, missed),) = shortfalls(beyond.measures, judged, beyond.requirements)
    assert bound.label == "every pose of the range assembles"
    np.testing.assert_allclose(missed, -20 - 0.17, atol=1e-9)


def test_ranges_that_are_none_are_refused():
    with pytest.raises(UserError, match="--over handle: linkage has no such input"):
        made(four_bar(*LENGTHS), handle=(0.0, 1.0))
    with pytest.raises(UserError, match="--over crank=90:0: give a range, low < high"):
        made(four_bar(*LENGTHS), crank=(90.0, 0.0))


@pytest.mark.parametrize("name", ["four-bar", *nightly("watt", "quick-return", "five-bar")])
def test_slopes_are_central_differences(name):
    """Also where the linkage locks within its range; there they lead back."""
    design = design_of(name)
    names = [m.name for m in design.measures]

    def weighed(leaves):
        values = jnp.stack(leaves)
        arrays = design.evaluate(values, tuple(names))
        flat = jnp.concatenate([jnp.ravel(arrays[measure]) for measure in names])
        return flat @ jnp.cos(jnp.arange(flat.size, dtype=flat.dtype))

    start = np.array([p.value for p in design.parameters])
    changes = np.random.default_rng(3).uniform(0.96, 1.04, (3, start.size))
    check_gradients(weighed, [*jnp.asarray(start * changes).T], of_largest=1e-5)


def test_beyond_lock_up_every_measure_leads_back():
    design = design_of("four-bar")
    values = design.vector(SHORT)
    measures = ("min_transmission", "margin")

    def worst(values):
        arrays = design.evaluate(values, measures)
        return jnp.stack([jnp.min(arrays[measure]) for measure in measures])

    at, slopes = worst(values), jax.jit(jax.jacrev(worst))(values)
    np.testing.assert_allclose(at[1], 190 - 210)
    np.testing.assert_allclose(at[0], np.degrees(-20 / 120))  # a radian for its greatest distance
    for now, slope in zip(at, slopes, strict=True):
        assert np.isfinite(slope).all()
        better = design.evaluate(values + slope / jnp.linalg.norm(slope), measures)
        assert min(better[measures[0]].min() - at[0], better[measures[1]].min() - at[1]) > 0, now


def test_a_triangle_that_is_open():
    """It is no design; its measure goes on below 0, with a slope that closes it again."""
    design = design_of("watt")
    name = "bodies.rocker.B-C"
    short = ("bodies.rocker.O4-B", "bodies.rocker.O4-C")
    values = design.values() | {one: 0.5 * design.values()[one] for one in short}
    values[name] *= 1.5
    with pytest.raises(UserError, match=r"rocker: .* make no triangle; change one"):
        design.judge(values)
    with pytest.raises(UserError, match="make no triangle"):
        design.files(values)
    index = [p.name for p in design.parameters].index(name)

    def least(values):
        return jnp.min(design.evaluate(values, ("triangles",))["triangles"])

    value, slope = jax.value_and_grad(least)(design.vector(values))
    assert value < 0
    assert slope[index] < 0
    # The sine of the angle at O4, squared, by the law of cosines.
    a, b, c = (design.values()[f"bodies.rocker.{ends}"] for ends in ("O4-B", "O4-C", "B-C"))
    cosine = (a * a + b * b - c * c) / (2 * a * b)
    judged = design.judge(design.values())["triangles"]
    np.testing.assert_allclose(judged, 1 - cosine**2, rtol=1e-9)


@pytest.mark.parametrize(
    "name", [*marked("slow", "four-bar"), *nightly("watt", "five-bar", "slider-crank", "finger")]
)
def test_a_search_finds_distances_that_transmit_better(name):
    design = design_of(name)
    *_, last = DesignSearch(design, "min_transmission", free_parameters(design)).steps(
        design.values()
    )
    before, after = design.judge(design.values()), design.judge(last.values)
    assert after["min_transmission"] > before["min_transmission"] + 5
    assert shortfalls(design.measures, after, design.requirements) == []
    for parameter in design.parameters:
        assert parameter.low - 1e-9 <= last.values[parameter.name] <= parameter.high + 1e-9
    if name == "four-bar":
        check_best_four_bar(*(last.values[name] for name in NAMES))


def check_best_four_bar(a, b, c, d):
    """By the law of cosines, with every crank angle; the crank still turns all the way."""
    lengths = sorted((a, b, c, d))
    assert lengths[0] == a
    assert lengths[0] + lengths[3] < lengths[1] + lengths[2]  # Grashof's condition
    least = least_of_four_bar((a, b, c, d), np.linspace(0, 2 * np.pi, 3601))
    # With equal deviations from 90° at both ends of the ground, sin of it is a d / (b c): least
    # at the shortest crank and the longest coupler and rocker that balance b² + c² = a² + d².
    np.testing.assert_allclose(b * b + c * c, a * a + d * d, rtol=1e-3)
    assert a == pytest.approx(20.0, rel=1e-3)
    np.testing.assert_allclose(least, 90 - math.degrees(math.asin(a * d / (b * c))), atol=0.1)
    assert least > 76.0


def saved(design, values):
    (file,) = design.files(values)
    assert file.name == "linkage.toml"
    return file, parse_linkage(tomllib.loads(file.content), file.name)


@each_linkage(quick=("quick-return",))
def test_the_file_is_the_linkage_with_these_distances(name):
    """In the pose of the inputs among the values, or in the sketched one."""
    design = design_of(name)
    values = {one: 1.01 * value for one, value in design.values().items()}
    linkage = design.dimensions.linkage(design.poses.linkage, jnp.asarray(design.distances(values)))
    turned = design.poses.home + 0.05
    pose = {
        part: design.shown(column, turned[column])
        for column, part in enumerate(linkage.input_names)
    }
    for inputs, given in ((design.poses.home, values), (turned, values | pose)):
        _, again = saved(design, given)
        assert_same(
            (again.anchors, again.links), (linkage.anchors, linkage.links), rtol=0, atol=1e-9
        )
        assert again.assembly == linkage.assembly
        np.testing.assert_allclose(np.cos(again.reference.inputs - inputs), 1.0, atol=1e-12)
        here, there = poses_of(linkage, inputs), poses_of(again, inputs)
        assert bool(there.ok)
        for joint in linkage.structure.joints:
            np.testing.assert_allclose(
                here.value.position(joint), there.value.position(joint), rtol=0, atol=1e-8
            )


def test_springs_of_the_file_are_as_taut_as_they_were():
    design = design_of("finger")
    _, again = saved(design, design.values() | {"pip": -40.0, "dip": -25.0})
    inputs = np.radians([-60.0, -10.0])
    linkages = gallery("finger"), again
    energies = [compute_spring_energy(one, poses_of(one, inputs).value) for one in linkages]
    np.testing.assert_allclose(*energies, rtol=1e-9)


def test_where_the_pose_locks_the_file_has_another_one():
    design = design_of("four-bar")
    file, _ = saved(design, {**SHORT, "crank": 180.0})
    assert "in its first pose" in file.title
    # With a ground as short as that the crank locks at its sketched 41°, but not at 180°.
    folded = {**SHORT, **dict(zip(NAMES, (68.0, 204.0, 60.0, 100.0), strict=True))}
    file, again = saved(design, folded)
    assert "in another pose" in file.title
    assert abs(float(again.reference.inputs[0])) > math.radians(41)
    with pytest.raises(UserError, match="cannot be sketched in a file: Two pins are nearer"):
        design.files(dict(zip(NAMES, (20.0, 204.0, 40.0, 100.0), strict=True)))


def test_without_transmission_angles_there_is_the_margin():
    design = made(tables_of({"O": [0, 0], "A": [30, 0]}, "O", {"crank": "O A"}))
    assert [measure.name for measure in design.measures] == ["margin", "size"]
    assert design.judge({"bodies.crank.O-A": 40.0})["size"] == 40.0


@pytest.mark.parametrize("name", ["watt", *nightly("stephenson", "finger-crank")])
def test_poses_and_angles_are_those_of_both_functions(name):
    linkage = gallery(name)
    inputs = np.asarray(linkage.reference.inputs) + np.linspace(-4, 4, 9)[:, None]
    poses, angles = jax.jit(solve_poses_and_angles)(linkage, inputs)
    wanted = poses_of(linkage, inputs)
    assert np.all(wanted.ok) == (name in ("stephenson", "finger-crank"))
    np.testing.assert_array_equal(poses.ok, wanted.ok)
    assert_same((poses.value, poses.margin), (wanted.value, wanted.margin), atol=1e-10)
    assert_same(angles, transmission_of(linkage, inputs).angles)
