"""The coupled finger: its motion, forces and files, and its design, by independent code."""

import cmath
import math
import re
import tomllib
from contextlib import nullcontext
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from scipy.optimize import differential_evolution

from designopt import UserError, cli
from designopt.study.runner import run_study
from designopt.study.study import Context
from kinematics.solve.poses import solve_poses
from studies.finger.designing import Designer, degrees_of_freedom
from studies.finger.spec import FingerSpec
from studies.models.body import BodySpec
from studies.models.finger import Finger, coupling_pins_of, links_of
from studies.models.finger_file import format_finger, packaged_finger, parse_finger, write_finger
from studies.models.finger_parts import PHALANGES, Body, FingerMotor
from studies.models.link_layers import Links, find_meetings
from studies.models.linkage_design.clearances import find_clearances, find_face_meetings, name_of
from studies.models.linkage_design.coupling.forces import find_loads, find_moment
from studies.models.linkage_design.coupling.judging import judge_coupled
from studies.models.linkage_design.coupling.postures import find_coupled_postures, with_motor_arm
from studies.models.linkage_design.coupling.problem import TRANSMISSION, coupling_problem
from studies.models.linkage_design.coupling.searching import pip_angles, search_coupling
from studies.models.linkage_design.coupling.walls import WALLS, find_wall_gap
from studies.models.linkage_design.postures import find_postures
from studies.models.linkage_design.problem import TIP
from studies.models.linkage_design.spec import FingerLinkageSpec, LimitsSpec, MotorSpec
from studies.models.links import LinksTable
from studies.models.manufacture.phalanges import side_wall
from studies.models.manufacture.section import Section
from studies.models.pins import CouplingPins
from studies.models.spec_files import linkage_file
from studies.oracles import clearances as oracle
from tests.studies.fingers import coupled_finger

PINS = CouplingPins(np.array([7.93, -2.13]), np.array([25.16, -6.3]))
"""Near the best ones of `BODY`."""

BODY = {"axis_height": 10.0}

SETTINGS = {"kind": "coupled", "body": BODY, "motor": {"arm": 11.0}}
"""With the axes so high over the palmar face that there is room below them for the bar."""

LAYERS = FingerLinkageSpec.model_validate(SETTINGS).links.layers

PIP = np.linspace(0.0, math.pi / 2, 7)


def coupled(pins=PINS, **body):
    made = Body.of(BodySpec(**BODY | body))
    links = Links.of(LinksTable(layers=LAYERS))
    bare = Finger.of(made, pins, links=links)
    arm = with_motor_arm(replace(bare, motor=FingerMotor(8.0, 1.0)), 11.0)
    return Finger.of(made, coupling_pins_of(arm), links=links, motor=arm.motor)


def circles_meet(pins, pip, side, length=23.0):
    """Flexion of DIP and transmission angle, degrees, by the circles about B and P that hold Q."""
    p, q = (complex(*np.asarray(place)) for place in (pins.P, pins.Q))
    arm, bar = abs(q - length), abs(p - q)
    b = length * cmath.exp(-1j * pip)
    along = p - b
    x = (arm**2 - bar**2 + abs(along) ** 2) / (2 * abs(along))
    y = math.sqrt(arm**2 - x**2)
    found = b + along / abs(along) * (x + side * 1j * y)
    turn = cmath.phase((found - b) / (q - length))
    angle = abs(cmath.phase((p - found) / (found - b)))
    return math.degrees(-turn - pip), math.degrees(min(angle, math.pi - angle))


def side_of(pins, length=23.0):
    """On which side of B-P pin Q lies in the straight finger."""
    p, q = (complex(*np.asarray(place)) for place in (pins.P, pins.Q))
    return math.copysign(1.0, ((q - length) / (p - length)).imag)


@pytest.mark.parametrize(
    "pins", [PINS, CouplingPins(np.array([-6.0, 9.0]), np.array([20.0, -6.0]))]
)
def test_dip_and_transmission_are_those_of_circles_that_meet(pins):
    found = find_coupled_postures(coupled(pins), jnp.asarray(PIP))
    wanted = np.array([circles_meet(pins, pip, side_of(pins)) for pip in PIP])
    assert np.all(np.asarray(found.reach) > 0)
    np.testing.assert_allclose(np.rad2deg(found.dip), wanted[:, 0], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(found.transmission), wanted[:, 1], atol=1e-9)


def test_every_pin_is_where_the_general_solver_has_it():
    finger = coupled()
    found = find_coupled_postures(finger, jnp.asarray(PIP))
    poses = solve_poses(finger.linkage(), -jnp.asarray(PIP)[:, None])
    assert bool(jnp.all(poses.ok))
    assert {*found.places} == {*poses.value.joints} == {*"OABTPQKMN"}
    for name, place in found.places.items():
        other = poses.value.joints[name].stacked()
        np.testing.assert_allclose(place.stacked(), np.broadcast_to(other, (7, 2)), atol=1e-9)


def test_ratio_is_the_slope_of_dip():
    finger, step = coupled(), 1e-6
    ends = [find_coupled_postures(finger, jnp.asarray(PIP + one)).dip for one in (-step, step)]
    found = find_coupled_postures(finger, jnp.asarray(PIP)).ratio
    np.testing.assert_allclose(found, (ends[1] - ends[0]) / (2 * step), atol=1e-8)


def test_gradients_of_pins_are_central_differences():
    finger, weights = coupled(), jnp.asarray(np.linspace(1.0, 2.0, PIP.size))

    def summed(pins):
        found = find_coupled_postures(replace(finger, pins=pins), jnp.asarray(PIP))
        return jnp.sum(weights * (found.dip + found.transmission + found.ratio))

    def by_solver(pins):
        pose = solve_poses(replace(finger, pins=pins).linkage(), -jnp.asarray(PIP)[:, None]).value
        return jnp.sum(weights * pose.bodies["distal"].angle())

    for scalar in (summed, by_solver):
        pins, step = coupling_pins_of(finger), 1e-5
        slopes = jax.grad(scalar)(pins)
        for pin in "PQ":
            for axis in (0, 1):
                moved = np.zeros(2)
                moved[axis] = step
                one, other = (
                    scalar(replace(pins, **{pin: getattr(pins, pin) + sign * moved}))
                    for sign in (1, -1)
                )
                assert getattr(slopes, pin)[axis] == pytest.approx(
                    float(one - other) / (2 * step), abs=2e-7
                )


def test_the_pads_work_is_the_motors():
    """The balance of every part against virtual work, and that against moved points."""
    finger, place, step = coupled(), 30.5, 1e-6
    pip = jnp.asarray(PIP)
    moment, loads = find_loads(finger, pip, 2.0, place)
    by_work = find_moment(finger.body, find_coupled_postures(finger, pip), 2.0, place)
    np.testing.assert_allclose(moment, by_work, rtol=1e-9)

    def touched(at):
        found = find_coupled_postures(finger, at)
        turn = np.exp(-1j * (np.asarray(at) + np.asarray(found.dip)))
        b = np.asarray(found.places["B"].x) + 1j * np.asarray(found.places["B"].y)
        return b + turn * (place + 1j * float(finger.body.palmar)), turn

    (ahead, _), (back, _), (_, turn) = (touched(pip + one) for one in (step, -step, 0.0))
    speed = (ahead - back) / (2 * step)
    np.testing.assert_allclose(-2.0 * (np.conj(1j * turn) * speed).real, moment, rtol=1e-7)
    # The motor's moment comes through the coupler, on an arm of the parallelogram's height.
    at = find_coupled_postures(finger, pip).places
    arm = np.abs(np.asarray(at["K"].cross(at["M"]) / at["M"].length()))
    np.testing.assert_allclose(np.asarray(loads.axial["coupler"]) * arm, moment, rtol=1e-9)
    assert {*loads.pins} == {*finger.joined()}


def test_file_has_the_finger():
    finger = coupled()
    again = parse_finger(tomllib.loads(format_finger(finger)), "copy")
    assert jax.tree.structure(finger) == jax.tree.structure(again)
    for one, other in zip(jax.tree.leaves(finger), jax.tree.leaves(again), strict=True):
        assert np.array_equal(one, other)


def test_file_of_another_kind_is_refused():
    tables = tomllib.loads(format_finger(coupled()))
    tables["pins"]["G"] = [1.0, 2.0]
    with pytest.raises(UserError, match=r"copy: pins\.G: no such key"):
        parse_finger(tables, "copy")
    tables = tomllib.loads(format_finger(coupled()))
    del tables["links"]["layers"]
    del tables["links"]["thickness"]
    with pytest.raises(UserError, match=r"\[pins\] are of a coupled linkage"):
        parse_finger(tables, "copy")
    with pytest.raises(
        UserError, match="its linkage is coupled, and this needs one that is six-bar"
    ):
        find_postures(coupled(), jnp.zeros(1), jnp.zeros(1))
    with pytest.raises(UserError, match="its linkage is six-bar"):
        find_coupled_postures(packaged_finger(), jnp.zeros(1))


def test_linkage_file_is_solved_with_one_input():
    text = str(linkage_file(coupled()).content)
    assert "--sweep dip" not in text
    assert [one["name"] for one in tomllib.loads(text)["inputs"]] == ["pip"]
    assert degrees_of_freedom(coupled()) == 1
    assert degrees_of_freedom(packaged_finger()) == 2


def test_layers_follow_the_kind():
    assert "coupling" in LAYERS[2]
    usual = FingerLinkageSpec().links.layers
    # As in a file of settings in which the kind was changed.
    changed = FingerLinkageSpec.model_validate(SETTINGS | {"links": {"layers": usual}})
    assert changed.links.layers == LAYERS
    with pytest.raises(ValueError, match=r"links\.layers are of a six-bar linkage"):
        FingerLinkageSpec.model_validate(SETTINGS | {"links": {"layers": usual[::-1]}})
    reverse = SETTINGS | {"links": {"layers": LAYERS[::-1]}}
    assert FingerLinkageSpec.model_validate(reverse).links.layers == LAYERS[::-1]


@pytest.fixture(scope="module")
def designed():
    spec = FingerLinkageSpec.model_validate(
        SETTINGS | {"search": {"starts": 8, "among": 4096, "finalists": 2}}
    )
    return spec, search_coupling(spec, 0)


def test_design_meets_what_is_asked(designed):
    spec, found = designed
    verdict = judge_coupled(found.finger, spec.limits, spec.motor)
    assert not [check.name for check in verdict.checks if not check.met]
    assert abs(verdict.dip_deg[-1] - 90.0) <= 1.0
    assert np.all(np.diff(verdict.dip_deg) > 0)
    assert found.held_by()
    # By circles, at other angles than those of the judgement.
    pins = coupling_pins_of(found.finger)
    angles = [circles_meet(pins, pip, side_of(pins))[1] for pip in np.linspace(0, np.pi / 2, 777)]
    assert min(angles) == pytest.approx(verdict.least_deg, abs=0.02)
    motor = verdict.angles_deg["μ_K"]
    assert np.min(motor) == pytest.approx(45.0, abs=0.1)


def plain_design(spec, place):
    """Least transmission angle of P, Q in degrees, and what is missing, by plain numbers alone.

    Missing are mm and degrees; the palmar faces are left out, so that the search is asked for more.
    """
    limits, body, links = spec.limits, spec.body, spec.links
    length, keep = body.intermediate, links.bar_width / 2 + links.shell + limits.clearance
    p, q = complex(*place[:2]), complex(*place[2:])
    low, high = -body.axis_height + keep, body.thickness - body.axis_height - keep
    missing = sum(max(0.0, low - y) + max(0.0, y - high) for y in (p.imag, q.imag))
    arm, bar, pip = q - length, p - q, np.linspace(0.0, math.pi / 2, 31)
    missing += sum(max(0.0, limits.spacing - abs(one)) for one in (arm, bar, p))
    b = length * np.exp(-1j * pip)
    along = p - b
    size = np.abs(along)
    x = (abs(arm) ** 2 - abs(bar) ** 2 + size**2) / (2 * size)
    beyond = max(0.0, float(np.max(np.abs(x))) - abs(arm) + 0.01)
    y = np.sqrt(np.maximum(abs(arm) ** 2 - x**2, 1e-9))
    at = b + along / size * (x + math.copysign(1.0, (arm / along[0]).imag) * 1j * y)
    dip = np.unwrap(-np.angle((at - b) / arm)) - pip
    dip -= 2 * math.pi * round(dip[0] / (2 * math.pi))
    missing += 10 * beyond + max(0.0, abs(math.degrees(dip[-1]) - 90.0) - limits.dip_error_deg)
    missing += 10 * max(0.0, limits.turn - float(np.min(np.diff(dip) / np.diff(pip))))
    axle = links.axle_diameter / 2 + links.bar_width / 2 + limits.clearance
    for pin in (0.0 * b, b):
        line = p - at
        part = np.clip(((pin - at) * np.conj(line)).real / np.abs(line) ** 2, 0.0, 1.0)
        missing += max(0.0, axle - float(np.min(np.abs(at + part * line - pin))))
    sine = np.abs((np.conj(at - b) * (p - at)).imag) / (abs(arm) * abs(bar))
    return math.degrees(math.asin(min(1.0, float(np.min(sine))))), missing


@pytest.mark.nightly
def test_no_clearly_better_design_is_found_by_evolution(designed):
    spec, found = designed
    pins = coupling_pins_of(found.finger)
    own, missing = plain_design(spec, [*np.asarray(pins.P), *np.asarray(pins.Q)])
    assert missing == pytest.approx(0.0, abs=0.02)

    def short(place):
        angle, missing = plain_design(spec, place)
        return 20 * missing - angle

    box = [(-30.0, 20.0), (-6.3, 11.3), (5.0, 50.0), (-6.3, 11.3)]
    best = max(
        -differential_evolution(short, box, rng=seed, maxiter=150, popsize=20).fun
        for seed in range(2)
    )
    assert best > 40.0  # it finds designs at all
    assert own > best - 0.5


def plain_force(spec, place):
    """Least force at the tip that the motor's moment holds, N: virtual work, by plain numbers."""
    pip = np.linspace(0.0, math.pi / 2, 31)
    pins = CouplingPins(*np.reshape(place, (2, 2)))
    side, body = side_of(pins), spec.body
    before, dip, after = (
        np.deg2rad([circles_meet(pins, angle, side)[0] for angle in pip + step])
        for step in (-1e-5, 0.0, 1e-5)
    )
    reach, slope = body.distal - coupled().body.rim, (after - before) / 2e-5
    levers = body.intermediate * np.cos(dip) + reach * (1 + slope)
    return spec.motor.moment / float(np.max(levers))


def test_a_weak_motor_costs_nothing_but_force(designed):
    spec, strong = designed
    limits = spec.limits.model_copy(update={"tip_force": 8.0})
    spec = spec.model_copy(update={"limits": limits})
    found = search_coupling(spec, 0)
    verdict = judge_coupled(found.finger, spec.limits, spec.motor)
    assert [check.name for check in verdict.checks if not check.met] == [TIP]
    pins = coupling_pins_of(found.finger)
    force = plain_force(spec, np.ravel([pins.P, pins.Q]))
    assert verdict.check(TIP).achieved == pytest.approx(force, abs=0.01)
    # Asked for no force, it transmits at least as well as a finger that is asked for some.
    other = judge_coupled(strong.finger, spec.limits, spec.motor)
    assert verdict.least_deg > other.least_deg - 0.05
    assert any(line.startswith(TIP) for line in found.conflict())


def test_where_no_start_meets_the_requirements_there_is_no_figure_of_them():
    how = {"search": {"starts": 4, "among": 2048}, "draws": 10}
    strong, weak = (
        run_study("finger-linkage", SETTINGS | how | {"limits": {"tip_force": force}})
        for force in (5.0, 8.0)
    )
    names = ({figure.name for figure in results.figures} for results in (strong, weak))
    assert set.difference(*names) == {"starts"}


def test_problem_and_judgement_agree(designed):
    spec, found = designed
    finger = found.finger
    problem = coupling_problem(
        replace(finger, pins=None), spec.limits, pip_angles(finger.body), motor=spec.motor
    )
    pins = replace(coupling_pins_of(finger), K=None)
    terms = problem.terms(pins, *problem.data)
    verdict = judge_coupled(finger, spec.limits, spec.motor)
    assert terms.least is not None
    assert np.rad2deg(np.min(terms.least[TRANSMISSION])) == pytest.approx(
        verdict.least_deg, abs=1e-9
    )
    assert min(float(jnp.min(part)) for part in terms.inequalities.values()) > -1e-9


def test_oracle_has_the_same_curve_and_clearances(tmp_path):
    """Polygons and circles that meet against the judgement's closed forms, posture by posture."""
    finger = coupled_finger()
    write_finger(finger, tmp_path / "finger.toml")
    tables = tomllib.loads((tmp_path / "finger.toml").read_text(encoding="utf-8"))
    curve = np.array(oracle.postures(tables, 7))
    found = find_coupled_postures(finger, jnp.deg2rad(curve[:, 0]))
    np.testing.assert_allclose(curve[:, 1], np.rad2deg(found.dip), atol=1e-9)
    joined = {pin: {*bodies} for pin, bodies in finger.joined().items()}
    assert joined == {pin: {*bodies} for pin, bodies in oracle.carriers(tables).items()}
    meetings = find_meetings(links_of(finger), finger.joined()) + find_face_meetings(finger)
    clear = find_clearances(finger, found.places, meetings)
    known = {phalanx: f"palmar face of the {phalanx} phalanx" for phalanx in PHALANGES}
    for number, (pip, dip) in enumerate(curve):
        polygons = oracle.polygon_clearances(tmp_path / "finger.toml", degrees=([pip], [dip]))
        assert polygons.assembled.all()
        for one in meetings:
            wanted = polygons.apart[one.first, known.get(one.second, one.second)]
            own = clear[name_of(one)][number]
            assert float(own) == pytest.approx(float(np.ravel(wanted)[0]), abs=1e-6)
    assert len(meetings) == 10
    # Where the bar would be longer or shorter there is no such posture.
    off = oracle.polygon_clearances(tmp_path / "finger.toml", degrees=([30.0], [60.0]))
    assert not off.assembled.any()


@pytest.mark.parametrize(
    ("body", "pins"),
    [
        ({}, ([7.34, -1.63], [25.21, -5.78])),
        ({"range_deg": 60.0, "intermediate": 14.0}, ([5.32, -4.52], [8.04, 0.85])),
        ({"range_deg": 45.0, "intermediate": 12.0}, ([3.14, -5.21], [5.98, 0.1])),
    ],
)
def test_walls_are_apart_as_their_outlines_are(body, pins):
    """Polygons of the parts to make; those of the last finger run into each other.

    Hulls reach to the palmar face, too, as the posts at the ends of the pads do.
    """
    finger = coupled(CouplingPins(*map(np.array, pins)), **{"axis_height": 9.5} | body)
    pip = jnp.linspace(0.0, finger.body.flexion, 10)
    found = find_coupled_postures(finger, pip)
    own = np.asarray(find_wall_gap(finger, found.places))
    section, middle = Section.of(finger), float(finger.body.intermediate)
    proximal, distal = (
        np.array(side_wall(section, one).line()) @ [1, 1j] for one in ("proximal", "distal")
    )
    wanted = []
    for first, second in zip(np.asarray(pip), np.asarray(found.dip), strict=True):
        turned = (middle + (distal - middle) * np.exp(-1j * second)) * np.exp(-1j * first)
        one, other = (
            shapely.Polygon([(at.real, at.imag) for at in wall.tolist()])
            for wall in (proximal, turned)
        )
        wanted.append(one.distance(other) - math.sqrt(one.intersection(other).area))
    more = np.array(wanted) - own
    assert np.min(more) > -0.1
    assert np.max(more[np.array(wanted) < 2.0], initial=0.0) < 0.5
    assert (min(own) > 0) == (min(wanted) > 0)
    [check] = (
        one for one in judge_coupled(finger, LimitsSpec(), MotorSpec()).checks if one.name == WALLS
    )
    # At more angles of PIP.
    assert min(own) - 0.1 < check.achieved < min(own) + 1e-6


def test_a_motor_that_is_too_weak_is_no_want_of_room():
    search, motor = {"starts": 4, "among": 2048}, {"arm": 11.0, "moment": 300.0}
    linkage = {"kind": "coupled", "motor": motor, "search": search, "draws": 10}
    spec = FingerSpec.model_validate({"body": {"axis_height": 9.5}, "linkage": linkage})
    designer = Designer(Context(0, "float64", lambda _: nullcontext()))
    assert "force at the tip" in [check.name for check in designer.linkage(spec).unmet]
    designer.require_room(spec)


def test_without_room_the_study_names_the_cure(capsys, tmp_path):
    quick = ("linkage.search.starts=4", "linkage.search.among=2048", "linkage.draws=10")
    own = {"run": [], "export": ["--to", "bom"], "front": ["--objectives", "yield,thickness"]}
    for command, more in own.items():
        words = [command, "finger", "--out", str(tmp_path / command), *more]
        for one in ("linkage.kind=coupled", *quick):
            words += ["--set", one]
        assert cli.run(words) == 2
        error = capsys.readouterr().err
        assert re.search(
            r"no room for a coupling bar P-Q: the best one runs [\d.]+ mm into the", error
        )
        assert "raise body.axis_height from 4 mm (9.5 with linkage.motor.arm=11" in error
        assert not (tmp_path / command).exists()
