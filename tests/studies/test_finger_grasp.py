"""The study ``finger-grasp`` against geometry, SciPy, many digits and the balance of every link."""

import json
import math
from dataclasses import replace
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pydantic
import pytest
import scipy.optimize

from designopt import cli
from studies.finger_grasp.judging import judge, setting_of
from studies.finger_grasp.second_opinion import reference as slsqp
from studies.finger_grasp.stability import families
from studies.models.finger import FingerSpring, spring_of
from studies.models.grasp import cases
from studies.models.grasp.analysis import CLOSED, formula_error, retrace_error, touching_dip
from studies.models.grasp.closing import LARGEST_MOVE, STEPS, close_all, there_and_back
from studies.models.grasp.comparing import compare
from studies.models.grasp.conditions import Unknowns, conditions, energy, gaps_of, touches
from studies.models.grasp.equilibrium import GRASP, solve
from studies.models.grasp.free_body import pin_places
from studies.models.grasp.objects import Circle, Polygon
from studies.models.grasp.pinch import bracket, least_place, loading, predict, ratio_map
from studies.models.grasp.spec import GraspSpec, PinsSpec
from studies.models.grasp.transfer import pads, transfer, transfers
from studies.models.pins import reference_pins
from studies.oracles import grasp as exact
from tests.studies.fingers import finger_of

SPEC = GraspSpec()
FINGER = cases.finger_of(SPEC)
BODY = FINGER.body
FREE = cases.problem_of(FINGER, None)
CHECK = cases.touching(BODY, math.radians(30.0), 11.5, 12.0)
END = math.radians(SPEC.motor_end_deg)


@cache
def closings():
    """The check's circle, the same under load, circles, and pinches, by one compiled program."""
    problems = [cases.problem_of(FINGER, CHECK), cases.problem_of(FINGER, CHECK, (15, 5))]
    problems += [
        cases.problem_of(FINGER, cases.circle_on_pad(BODY, d, 11.5)) for d in (10.0, 30.0, 90.0)
    ]
    found = predict(FINGER, [(0.5, 4.0), (0.5, 14.0), (1.0, 8.0), (1.0, 25.0)])
    motions = [there_and_back(END)] * 5 + [loading(FINGER, pinch) for pinch in found]
    for pinch in found:
        thing = cases.touching(BODY, pinch.pip, 23.0 + pinch.place, 8.0)
        problems.append(cases.problem_of(FINGER, thing))
    # Last the one that snaps.
    slipping = list(families(FINGER, END, 0))[4]
    problems.append(slipping.problems[0])
    motions.append(slipping.commands[0])
    return close_all(problems, np.array(motions)), found


def test_default_pins_are_design_b():
    for name in "FEDCGH":
        np.testing.assert_array_equal(
            getattr(PinsSpec().design(), name), getattr(reference_pins(), name)
        )


def test_transfer_is_the_linkages():
    """Pins placed by intersecting circles in NumPy, and central differences."""
    joints = jnp.asarray(np.random.default_rng(0).uniform(0, 1.57, (20, 2)))
    found = transfers(FINGER, joints)
    straight = {name: np.asarray(getattr(FINGER.pins, name)) for name in "FEDCGH"}
    for i, posture in enumerate(np.asarray(joints)):
        at = pin_places(straight, 23.0, posture)
        turns = {}
        for one, two in ("FE", "CD"):
            now, was = at[two] - at[one], straight[two] - straight[one]
            turns[one] = np.angle(complex(*now) / complex(*was))
        np.testing.assert_allclose(found.crank[i], -turns["F"], atol=1e-12)
        wound = np.angle(np.exp(1j * (turns["C"] + posture.sum())))
        np.testing.assert_allclose(found.winding[i], wound, atol=1e-12)
    step = 1e-6
    for j in range(2):
        move = jnp.zeros((1, 2)).at[0, j].set(step)
        ends = [transfers(FINGER, joints + s * jnp.tile(move, (20, 1))) for s in (1, -1)]
        slope = (ends[0].crank - ends[1].crank) / (2 * step)
        np.testing.assert_allclose(found.ratios[:, j], slope, atol=1e-8)
        if j:
            slope = (ends[0].winding - ends[1].winding) / (2 * step)
            np.testing.assert_allclose(found.slope, slope, atol=1e-8)


def test_the_map_has_the_range_that_was_read():
    ratios = ratio_map(FINGER, np.linspace(0, np.pi / 2, 31))
    ratio = ratios[..., 1] / ratios[..., 0]
    assert round(float(ratio.min()), 2) == 0.23
    assert round(float(ratio.max()), 2) == 0.46
    place = least_place(ratio, np.linspace(0, np.pi / 2, 31)[None], 23.0)
    reach = place + 23 * np.cos(np.linspace(0, np.pi / 2, 31))[None]
    np.testing.assert_allclose(place / reach, ratio)


def _from_segment(point, ends):
    along = ends[1] - ends[0]
    share = np.clip((point - ends[0]) @ along / (along @ along), 0, 1)
    return float(np.linalg.norm(point - ends[0] - share * along))


def _apart(ends, corners):
    """Distance of a segment from a convex polygon, 0 where they overlap, by trying every pair."""
    sides = list(zip(corners, np.roll(corners, -1, axis=0), strict=True))
    steps = np.linspace(0, 1, 2001)[:, None] * (ends[1] - ends[0]) + ends[0]
    inside = np.ones(len(steps), bool)
    for a, b in sides:
        inside &= (b - a)[0] * (steps - a)[:, 1] - (b - a)[1] * (steps - a)[:, 0] > 0
    if inside.any():
        return 0.0
    corner = min(_from_segment(c, ends) for c in corners)
    return min(corner, *(_from_segment(end, side) for end in ends for side in sides))


def test_gaps_are_distances():
    """Circles everywhere, polygons where a face is nearest; slopes by central differences."""
    corners = np.array([[-20.0, -40.0], [5.0, -45.0], [12.0, -25.0], [-8.0, -18.0]])
    center, shapes = np.array([3.0, -30.0]), {1: corners, 2: corners[:3]}
    things = (Circle(center, 7.0), Polygon(corners), Polygon(corners[:3]))
    problems = [cases.problem_of(FINGER, thing) for thing in things]
    gaps = [jax.jit(lambda q, p=p: (gaps_of(p, q), touches(p, q).slopes)) for p in problems]
    faced = 0
    for joints in np.random.default_rng(1).uniform(0, 1.2, (12, 2)):
        segments = []
        for pad in pads(BODY, jnp.asarray(joints)):
            start = np.array([float(pad.start.x), float(pad.start.y)])
            along = np.array([float(pad.along.x), float(pad.along.y)])
            segments.append((start, start + float(pad.length) * along))
        found, slopes = (np.asarray(part) for part in gaps[0](jnp.asarray(joints)))
        wanted = [_from_segment(center, segment) - 7 for segment in segments]
        np.testing.assert_allclose(found, wanted, atol=1e-12)
        for j in range(2):
            move = np.eye(2)[j] * 1e-6
            ends = [np.asarray(gaps[0](jnp.asarray(joints + s * move))[0]) for s in (1, -1)]
            np.testing.assert_allclose(slopes[:, j] * 23, (ends[0] - ends[1]) / 2e-6, atol=1e-6)
        for which, shape in shapes.items():
            found = np.asarray(gaps[which](jnp.asarray(joints))[0]).reshape(2, 2).min(axis=1)
            for gap, segment in zip(found, segments, strict=True):
                distance = _apart(segment, shape)
                if abs(gap) > 0.05:  # overlaps are looked for at points 0.01 mm apart
                    assert (gap > 0) == (distance > 0)
                assert gap <= distance + 1e-12
                faced += distance > 0 and abs(gap - distance) < 1e-12
    assert faced >= 10


def test_the_circle_of_the_check_is_wrapped_at_71_4_degrees():
    paths, _ = closings()
    dip = math.degrees(touching_dip(paths[0]))
    assert abs(dip - 71.4) <= 0.05
    assert abs(dip - math.degrees(2 * math.atan(11.5 / 16))) < 1e-9
    np.testing.assert_allclose(math.degrees(cases.wrapped_dip(BODY, 11.5, 12.0)), dip, atol=1e-9)
    first = int(np.argmax(paths[0].gaps[:, 0] < 1e-7))
    np.testing.assert_allclose(np.degrees(paths[0].joints[first, 0]), 30.0, atol=1e-9)
    np.testing.assert_allclose(paths[0].along[first, 0], 11.5, atol=1e-9)


def test_every_state_is_an_equilibrium_and_opening_retraces_closing():
    paths, _ = closings()
    for path in paths:
        assert path.ok.all(), set(path.messages)
        assert path.residual.max() < 1e-12
        assert (path.margin > 0).all()
        assert (path.forces >= -1e-9).all()
        assert (path.gaps >= -1e-9).all()
    for path in paths[:5]:
        assert retrace_error(path) < 1e-9


def test_a_circle_on_the_proximal_pad_is_touched_at_its_mirrored_place():
    for path, diameter in zip(closings()[0][2:5], (10.0, 30.0, 90.0), strict=True):
        first = int(np.argmax(path.gaps[:, 0] < 1e-7))
        thing = path.problem.thing
        assert isinstance(thing, Circle)
        place = -float(thing.center[0])
        np.testing.assert_allclose(path.along[first, 0], place, atol=1e-9)
        pip = 2 * math.atan(place / (diameter / 2 + 4))
        np.testing.assert_allclose(path.joints[first, 0], pip, atol=1e-9)


def test_virtual_work_and_free_body_agree():
    paths, _ = closings()
    for path in paths[:-1]:
        compared = compare(path)
        assert compared.states + compared.undetermined == STEPS
        assert compared.states > 100
        assert compared.error < 1e-8
    assert formula_error(paths[0]) < 1e-8


def test_the_circle_of_the_check_is_the_reference_values_and_fits_any_body():
    assert cases.check_touch(BODY) == pytest.approx((math.radians(30.0), 11.5, 12.0))
    for body in (finger_of(range_deg=40).body, finger_of(intermediate=40, range_deg=70).body):
        found = cases.check_touch(body)
        wrapped = math.degrees(cases.wrapped_dip(body, found.place, found.radius))
        assert wrapped <= 0.8 * body.range_deg + 1e-9
        assert math.degrees(found.pip) < body.range_deg


def test_a_pinch_that_the_motor_cannot_load_is_not_judged():
    paths, pinches = closings()
    pinch = replace(pinches[0], limit=1e6)
    weak = replace(
        paths[5],
        ok=np.ones(STEPS, bool),
        joints=np.zeros((STEPS, 2)),
        motor=np.linspace(0, 50, STEPS),
    )
    assert bracket(FINGER, pinch, weak).agrees is None
    assert bracket(FINGER, replace(pinch, limit=20.0), weak).agrees is False
    assert bracket(FINGER, replace(pinch, limit=math.inf), weak).agrees is True


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"pinch_at": [40.0]}, "pinch_at"), ({"body": {"range_deg": 45.0}}, "beyond body.range_deg")],
)
def test_pinches_out_of_reach_are_refused(settings, words):
    with pytest.raises(pydantic.ValidationError, match=words):
        GraspSpec.model_validate(settings)


def test_where_nothing_assembles_there_is_no_ratio():
    pins = eqx.tree_at(lambda pins: pins.E, reference_pins(), jnp.array([-8.0, 1.0]))
    found = ratio_map(finger_of(pins), np.radians([0.0, 45.0, 90.0]))
    assert np.isnan(found).any()
    whole = ratio_map(FINGER, np.radians([0.0, 45.0, 90.0]))
    assert np.isfinite(whole).all()


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.run(["run", "finger-grasp", "--out", str(out)]) == 0, capsys.readouterr().err
    document = json.loads((out / "results.json").read_text(encoding="utf-8"))
    metrics = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert metrics["unconverged"] == 0
    assert metrics["pinch_violations"] == 0
    assert metrics["adaptive_dip_deg"] == pytest.approx(71.4, abs=0.05)
    assert len(document["precision"]) > 10
    assert len(document["stability"]) > 5


def test_pinches_give_way_where_the_formula_says():
    paths, found = closings()
    shown = [bracket(FINGER, one, path) for one, path in zip(found, paths[5:9], strict=True)]
    assert [one.holds for one in found] == [False, False, False, True]
    assert all(one.agrees for one in shown)
    for one, seen in zip(found[:3], shown, strict=False):
        assert seen.low <= one.limit <= seen.high < 1.05 * seen.low
    # The formula written out once more from the transfer functions.
    at = transfer(FINGER, jnp.asarray([0.5, 0.0]))
    first, second = at.ratios.tolist()
    limit = 30 * 0.3 * float(at.slope) / (second - first * 4 / 27)
    np.testing.assert_allclose(found[0].limit, limit, rtol=1e-12)


def test_states_agree_with_many_digits_and_with_slsqp():
    paths, _ = closings()
    for path, state in ((paths[0], 20), (paths[0], 60), (paths[2], 80), (paths[5], 100)):
        verdict = judge(path, state)
        assert verdict.right
        assert verdict.joints < 1e-12
        assert verdict.forces < 1e-12
    problem = eqx.tree_at(lambda p: p.command, paths[0].problem, jnp.asarray(paths[0].commands[28]))
    found = slsqp(problem, paths[0].joints[27])
    np.testing.assert_allclose(found, paths[0].joints[28], atol=1e-6)
    found = slsqp(paths[0].problem, np.array([0.2, 0.1]))
    np.testing.assert_allclose(found, 0.0, atol=1e-6)  # the motor at 0: straight


def test_exact_kinematics_are_the_fingers():
    setting = setting_of(cases.problem_of(FINGER, CHECK), 0.0)
    found = transfer(FINGER, jnp.asarray([0.7, 0.4]))
    np.testing.assert_allclose(float(exact.crank(setting, 0.7, 0.4)), found.crank, atol=1e-13)
    np.testing.assert_allclose(float(exact.winding(setting, 0.4)), found.winding, atol=1e-13)
    gaps = gaps_of(cases.problem_of(FINGER, CHECK), jnp.asarray([0.7, 0.4]))
    np.testing.assert_allclose([float(g) for g in exact.gaps(setting, 0.7, 0.4)], gaps, atol=1e-12)


def logarithms():
    """Of the stiffnesses, so that a step of either is a part of it; and the preload."""
    spring = spring_of(FINGER)
    return jnp.stack([jnp.log(spring.stiffness), jnp.log(spring.servo), spring.preload])


def with_logarithms(parameters):
    return replace(
        FINGER, spring=FingerSpring(jnp.exp(parameters[0]), parameters[2], jnp.exp(parameters[1]))
    )


def test_implicit_gradients_of_free_closing_against_central_differences():
    """Compiled and batched: PIP moving, PIP at its stop and DIP moving, both at their stops."""
    joints = jnp.asarray([[0.4, 0.0], [1.57, 0.5], [1.57, 1.57]])
    commands, motors = jnp.asarray([0.5, 1.5, 2.6]), jnp.asarray([0.0, 0.5, 2.0])
    start = logarithms()

    def value(parameters, command, joints, motor):
        finger = with_logarithms(parameters)
        problem = eqx.tree_at(lambda p: p.command, cases.problem_of(finger, None), command)
        found = solve(problem, Unknowns(joints, motor, jnp.zeros(0)))
        return jnp.sum(found.value.joints) + 0.01 * found.value.motor, found.ok

    run = jax.jit(jax.vmap(jax.value_and_grad(value, has_aux=True), (None, 0, 0, 0)))
    (_, ok), slopes = run(start, commands, joints, motors)
    assert bool(ok.all())
    for j in range(3):
        ends = [run(start.at[j].add(s * 1e-6), commands, joints, motors)[0][0] for s in (1, -1)]
        np.testing.assert_allclose(slopes[:, j], (ends[0] - ends[1]) / 2e-6, atol=2e-6)
    assert float(jnp.abs(slopes).max()) > 0.01


@pytest.mark.slow
def test_implicit_gradients_against_central_differences():
    """Compiled and batched: a state with two contacts, one with one, a free one, and a failure."""
    paths, _ = closings()
    path, states = paths[0], [10, 25, 60, 60]
    guesses = Unknowns(
        jnp.asarray(path.joints[states]),
        jnp.asarray(path.motor[states]) / FREE.moment_unit,
        jnp.asarray(path.forces[states]) * FREE.length_unit / FREE.moment_unit,
    )
    guesses = eqx.tree_at(lambda u: u.forces, guesses, guesses.forces.at[3].set(1e12))
    commands = jnp.asarray(path.commands[states])

    def value(parameters, command, guess):
        finger = with_logarithms(parameters)
        problem = cases.problem_of(finger, Circle(CHECK.center, parameters[3]))
        problem = eqx.tree_at(lambda p: p.command, problem, command)
        found = solve(problem, guess, max_steps=6)
        state = found.value
        total = jnp.sum(state.joints) + 0.01 * state.motor + jnp.sum(state.forces)
        return jnp.where(found.ok, total, 0.0), found

    start = jnp.append(logarithms(), CHECK.radius)
    run = jax.jit(jax.vmap(jax.value_and_grad(value, has_aux=True), (None, 0, 0)))
    (_, found), slopes = run(start, commands, guesses)
    assert bool(jnp.isfinite(slopes).all())
    for j in range(4):
        step = 1e-6
        ends = [run(start.at[j].add(s * step), commands, guesses)[0][0] for s in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(slopes[:3, j], difference[:3], atol=2e-6)
    # Failure is data: finite, said in words, and with the residual that is left.
    assert np.asarray(found.ok).tolist() == [True, True, True, False]
    assert found.messages()[3] == GRASP[GRASP.unconverged]
    assert float(found.residual[3]) > 1e-6
    assert all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(found.value))


def test_the_energys_slope_is_what_stops_and_contacts_bear():
    paths, _ = closings()
    path, state = paths[0], 60
    problem = eqx.tree_at(lambda p: p.command, path.problem, jnp.asarray(path.commands[state]))
    unit = float(FREE.moment_unit)
    slope = scipy.optimize.approx_fprime(
        path.joints[state], lambda q: unit * float(energy(problem, jnp.asarray(q))), 1e-7
    )
    lifts = scipy.optimize.approx_fprime(
        path.joints[state], lambda q: np.asarray(gaps_of(problem, jnp.asarray(q))), 1e-7
    )
    np.testing.assert_allclose(
        np.asarray(slope), np.asarray(lifts).T @ path.forces[state], rtol=1e-4
    )
    assert path.forces[CLOSED].min() > 0


@pytest.mark.parametrize("size", [1e-12, 1e-6, 1.0])
def test_complementarity_keeps_the_digits_of_small_moments(size):
    """Beside a joint of 1 rad, and of either sign."""
    problem = cases.problem_of(FINGER, None)
    for sign in (1, -1):
        found = conditions(
            problem,
            Unknowns(jnp.full(2, 0.5), jnp.zeros(()), jnp.zeros(0)),
            jnp.zeros(()),
            jnp.full(2, sign * size),
            jnp.zeros(0),
        ).joints
        kappa = float(FREE.contrast)
        with mpmath.workdps(40):

            def either(a, b):
                return a + b - mpmath.sqrt(a * a + b * b)

            for got, weight in zip(found, (1.0, 1.0), strict=True):
                moment = mpmath.mpf(sign * size) * mpmath.sqrt(kappa) * weight
                upper = mpmath.mpf(math.radians(90)) - 0.5
                wanted = either(mpmath.mpf(0.5), -either(upper, -moment))
                np.testing.assert_allclose(float(got), float(wanted), rtol=1e-14)


def test_a_finger_that_snaps_slides_around_the_object_and_not_through_it():
    """A small circle under the DIP axis, pressed by both pads' ends until one of them slips."""
    paths, _ = closings()
    path = paths[-1]
    assert path.ok.all(), set(path.messages)
    step = int(np.argmax(np.abs(np.diff(path.joints[: CLOSED + 1], axis=0)).max(axis=1)))
    assert np.abs(path.joints[step + 1] - path.joints[step]).max() > LARGEST_MOVE
    assert path.gaps[step].max() < 1e-9  # both touched
    assert path.forces[step + 1, 1] > 1  # and the distal one still does
    assert path.joints[step + 1, 1] > 0.3


@pytest.mark.slow
def test_a_square_is_closed_on_flat():
    path = close_all([cases.problem_of(FINGER, cases.box(BODY))], there_and_back(END)[None])[0]
    assert path.ok.all()
    assert compare(path).error < 1e-8
    assert retrace_error(path) < 1e-9
