"""The study ``finger-grasp`` against geometry, SciPy, many digits and the balance of every link."""

import math
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.optimize

from designopt.study.study import Context, load_study
from studies.models.finger_parts import FingerSpring
from studies.models.grasp import cases
from studies.models.grasp.analysis import CLOSED, formula_error, retrace_error, touching_dip
from studies.models.grasp.closing import LARGEST_MOVE, STEPS, close_all, there_and_back
from studies.models.grasp.comparing import compare, compare_exactly, setting_of
from studies.models.grasp.conditions import Problem, Unknowns, conditions, energy, touches
from studies.models.grasp.equilibrium import GRASP, solve
from studies.models.grasp.objects import Circle, Polygon
from studies.models.grasp.pinch import bracket, least_place, loading, predict, ratio_map
from studies.models.grasp.spec import GraspSpec
from studies.models.grasp.transfer import pads, transfer, transfers
from studies.oracles import grasp as exact
from studies.stability.grasp import families
from tests.studies.fingers import finger_of, reference_pins

SPEC = GraspSpec()
FINGER = cases.finger_of(SPEC)
BODY = FINGER.body
FREE = cases.problem_of(FINGER, None)
CHECK = cases.touching(BODY, math.radians(30.0), 11.5, 12.0)
END = math.radians(SPEC.motor_end_deg)


@pytest.fixture(scope="module")
def pinches():
    return predict(FINGER, [(0.5, 4.0), (0.5, 14.0), (1.0, 8.0), (1.0, 25.0)])


@pytest.fixture(scope="module")
def paths(pinches):
    """The check's circle, the same under load, circles, and pinches, by one compiled program."""
    problems = [cases.problem_of(FINGER, CHECK), cases.problem_of(FINGER, CHECK, (15, 5))]
    problems += [
        cases.problem_of(FINGER, cases.circle_on_pad(BODY, d, 11.5)) for d in (10.0, 30.0, 90.0)
    ]
    motions = [there_and_back(END)] * 5 + [loading(FINGER, pinch) for pinch in pinches]
    for pinch in pinches:
        thing = cases.touching(BODY, pinch.pip, 23.0 + pinch.place, 8.0)
        problems.append(cases.problem_of(FINGER, thing))
    # Last the one that snaps.
    slipping = list(families(FINGER, END, 0))[4]
    problems.append(slipping.problems[0])
    motions.append(slipping.commands[0])
    return close_all(problems, np.array(motions))


def test_transfer_is_the_oracles():
    """Pins placed by intersecting circles, and central differences of their turns."""
    setting, step = setting_of(FREE, 0.0), 1e-9
    joints = np.random.default_rng(0).uniform(0, 1.57, (20, 2))
    found = transfers(FINGER, jnp.asarray(joints))
    with mpmath.workdps(30):

        def slope(turn, at):
            return float((turn(at + step) - turn(at - step)) / (2 * step))

        for i, (pip, dip) in enumerate(joints.tolist()):
            turns = [exact.crank(setting, pip, dip), exact.winding(setting, dip)]
            np.testing.assert_allclose(found.crank[i], float(turns[0]), atol=1e-13)
            np.testing.assert_allclose(found.winding[i], float(turns[1]), atol=1e-13)
            ratios = [
                slope(lambda q, d=dip: exact.crank(setting, q, d), mpmath.mpf(pip)),
                slope(lambda q, p=pip: exact.crank(setting, p, q), mpmath.mpf(dip)),
            ]
            np.testing.assert_allclose(found.ratios[i], ratios, rtol=1e-12, atol=1e-13)
            wound = slope(lambda q: exact.winding(setting, q), mpmath.mpf(dip))
            np.testing.assert_allclose(found.slope[i], wound, rtol=1e-12)


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

    def gaps_and_slopes(problem: Problem, q: jax.Array) -> tuple[jax.Array, jax.Array]:
        touch = touches(problem, q)
        return touch.gaps * problem.length_unit, touch.slopes

    gaps = [partial(jax.jit(gaps_and_slopes), problem) for problem in problems]
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
        pip, dip = joints.tolist()
        there = exact.gaps(setting_of(problems[0], 0.0), pip, dip, mpmath.fp)
        np.testing.assert_allclose(found, there, atol=1e-12)
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


def test_the_circle_of_the_check_is_wrapped_at_71_4_degrees(paths):
    dip = math.degrees(touching_dip(paths[0]))
    assert abs(dip - 71.4) <= 0.05
    assert abs(dip - math.degrees(2 * math.atan(11.5 / 16))) < 1e-9
    np.testing.assert_allclose(math.degrees(cases.wrapped_dip(BODY, 11.5, 12.0)), dip, atol=1e-9)
    first = int(np.argmax(paths[0].gaps[:, 0] < 1e-7))
    np.testing.assert_allclose(np.degrees(paths[0].joints[first, 0]), 30.0, atol=1e-9)
    np.testing.assert_allclose(paths[0].along[first, 0], 11.5, atol=1e-9)


def test_every_state_is_an_equilibrium_and_opening_retraces_closing(paths):
    for path in paths:
        assert path.ok.all(), set(path.messages)
        assert path.residual.max() < 1e-12
        assert (path.margin > 0).all()
        assert (path.forces >= -1e-9).all()
        assert (path.gaps >= -1e-9).all()
    for path in paths[:5]:
        assert retrace_error(path) < 1e-9


def test_a_circle_on_the_proximal_pad_is_touched_at_its_mirrored_place(paths):
    for path, diameter in zip(paths[2:5], (10.0, 30.0, 90.0), strict=True):
        first, thing = int(np.argmax(path.gaps[:, 0] < 1e-7)), path.problem.thing
        assert isinstance(thing, Circle)
        place = -float(thing.center[0])
        pip = 2 * math.atan(place / (diameter / 2 + 4))
        found = path.along[first, 0], path.joints[first, 0]
        np.testing.assert_allclose(found, (place, pip), atol=1e-9)


def test_virtual_work_and_free_body_agree(paths):
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


def test_a_pinch_that_the_motor_cannot_load_is_not_judged(paths, pinches):
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


def test_a_pinch_that_is_lost_beyond_its_limit_has_given_way(paths, pinches):
    """At the end of a pad it snaps away, and no equilibrium is near."""
    seen = bracket(FINGER, pinches[0], paths[5])
    lost = replace(paths[5], ok=paths[5].ok & (np.arange(STEPS) < seen.held))
    assert bracket(FINGER, pinches[0], lost) == seen
    early = replace(paths[5], ok=paths[5].ok & (np.arange(STEPS) < seen.held - 2))
    assert bracket(FINGER, pinches[0], early).agrees is False


def test_where_nothing_assembles_there_is_no_ratio():
    pins = eqx.tree_at(lambda pins: pins.E, reference_pins(), jnp.array([-8.0, 1.0]))
    angles = np.radians([0.0, 45.0, 90.0])
    assert np.isnan(ratio_map(finger_of(pins), angles)).any()
    whole = ratio_map(FINGER, angles)
    assert np.isfinite(whole).all()
    # The least place is where φ₂/φ₁ is k₂ / (k₂ + l cos q₂).
    ratio, arm = whole[..., 1] / whole[..., 0], 23 * np.cos(angles)[None]
    place = least_place(ratio, angles[None], 23.0)
    np.testing.assert_allclose(place / (place + arm), ratio)


@pytest.mark.slow
def test_the_study_meets_its_targets():
    spec = GraspSpec(precision=False, diameters=[10.0, 40.0])
    results = load_study("finger-grasp").run(spec, Context(0, "float64", lambda _: nullcontext()))
    metrics = {metric.name: metric for metric in results.metrics}
    assert not results.unmet
    assert sum(metric.target is not None for metric in metrics.values()) == 11
    assert metrics["adaptive_dip_deg"].value == pytest.approx(71.4, abs=0.05)
    assert sum(row.cases for row in results.stability) == 6 * 12 * STEPS


def test_pinches_give_way_where_the_formula_says(paths, pinches):
    shown = [bracket(FINGER, one, path) for one, path in zip(pinches, paths[5:9], strict=True)]
    assert [one.holds for one in pinches] == [False, False, False, True]
    assert all(one.agrees for one in shown)
    for one, seen in zip(pinches[:3], shown, strict=False):
        assert seen.low <= one.limit <= seen.high < 1.05 * seen.low
    # The formula written out once more from the transfer functions.
    at = transfer(FINGER, jnp.asarray([0.5, 0.0]))
    first, second = at.ratios.tolist()
    limit = 30 * 0.3 * float(at.slope) / (second - first * 4 / 27)
    np.testing.assert_allclose(pinches[0].limit, limit, rtol=1e-12)


def test_states_agree_with_many_digits_and_with_least_energy(paths):
    for path, state in ((paths[0], 20), (paths[0], 60), (paths[2], 80), (paths[5], 100)):
        found = compare_exactly(path, state)
        assert found.right
        assert found.joints < 1e-12
        assert found.forces < 1e-12
        setting = setting_of(path.problem, float(path.commands[state]))
        least = exact.minimize(setting, path.joints[state] + [0.02, -0.01])
        np.testing.assert_allclose(least, path.joints[state], atol=1e-6)
    least = exact.minimize(setting_of(paths[0].problem, 0.0), np.array([0.2, 0.1]))
    np.testing.assert_allclose(least, 0.0, atol=1e-6)  # the motor at 0: straight


def test_implicit_gradients_against_central_differences(paths):
    """Of what seven equilibria sum to, compiled and batched, of both stiffnesses' logarithms, so
    that a step of either is a part of it, of the preload and of the circle's radius.

    Three with the circle out of reach: PIP moving, PIP at its stop and DIP moving, both at their
    stops. Then one with no contact yet, with one, with two, and one that is not found.
    """
    path, states, unit = paths[0], [10, 25, 60, 60], float(FREE.spring.moment_unit)
    forces = np.concatenate([np.zeros((3, 2)), path.forces[states] * 23 / unit])
    forces[-1] = 1e12
    guesses = Unknowns(
        jnp.asarray([[0.4, 0.0], [1.57, 0.5], [1.57, 1.57], *path.joints[states]]),
        jnp.asarray([0.0, 0.5, 2.0, *path.motor[states] / unit]),
        jnp.asarray(forces),
    )
    commands = jnp.asarray([0.5, 1.5, 2.6, *path.commands[states]])
    centers = jnp.asarray([[-500.0, -500.0]] * 3 + [CHECK.center.tolist()] * 4)

    def value(parameters, command, guess, center):
        stiffness, servo = jnp.exp(parameters[:2])
        finger = replace(FINGER, spring=FingerSpring(stiffness, parameters[2], servo))
        problem = cases.problem_of(finger, Circle(center, parameters[3]))
        found = solve(replace(problem, command=command), guess, max_steps=12)
        state = found.value
        total = jnp.sum(state.joints) + 0.01 * state.motor + jnp.sum(state.forces)
        return jnp.where(found.ok, total, 0.0), found

    batched = jax.vmap(jax.value_and_grad(value, has_aux=True), (None, 0, 0, 0))
    run = jax.jit(lambda parameters: batched(parameters, commands, guesses, centers))
    start = np.array([math.log(30.0), math.log(300.0), 0.3, 12.0])
    (_, found), slopes = run(start)
    ends = [[run(start + sign * step)[0][0] for sign in (1, -1)] for step in 1e-6 * np.eye(4)]
    differences = np.stack([np.subtract(*pair) / 2e-6 for pair in ends], axis=1)
    np.testing.assert_allclose(slopes[:6], differences[:6], atol=2e-6)
    assert np.abs(slopes[:3]).max() > 0.01
    # Failure is data: finite, with the residual that is left.
    assert np.asarray(found.ok).tolist() == [True] * 6 + [False]
    assert found.messages()[6] == GRASP[GRASP.unconverged]
    assert float(found.residual[6]) > 1e-6
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((found.value, slopes)))


def test_the_energys_slope_is_what_stops_and_contacts_bear(paths):
    path, state = paths[0], 60
    problem = eqx.tree_at(lambda p: p.command, path.problem, jnp.asarray(path.commands[state]))
    unit = float(FREE.spring.moment_unit)
    slope = scipy.optimize.approx_fprime(
        path.joints[state], lambda q: unit * float(energy(problem, jnp.asarray(q))), 1e-7
    )

    def gaps(q: np.ndarray) -> np.ndarray:
        return np.asarray(touches(problem, jnp.asarray(q)).gaps * problem.length_unit)

    lifts = scipy.optimize.approx_fprime(path.joints[state], gaps, 1e-7)
    np.testing.assert_allclose(
        np.asarray(slope), np.asarray(lifts).T @ path.forces[state], rtol=1e-4
    )
    assert path.forces[CLOSED].min() > 0


@pytest.mark.parametrize("size", [1e-12, 1e-6, 1.0])
def test_complementarity_keeps_the_digits_of_small_moments(size):
    """Beside a joint of 1 rad, and of either sign."""
    none, moments = jnp.zeros(0), np.array([size, -size])
    at = Unknowns(jnp.full(2, 0.5), jnp.zeros(()), none)
    found = conditions(FREE, at, jnp.zeros(()), jnp.asarray(moments), none).joints

    def either(a, b):
        return a + b - mpmath.sqrt(a * a + b * b)

    with mpmath.workdps(40):
        upper, weight = mpmath.mpf(math.pi / 2) - 0.5, mpmath.sqrt(float(FREE.spring.contrast))
        wanted = [either(mpmath.mpf(0.5), -either(upper, -m * weight)) for m in moments.tolist()]
    np.testing.assert_allclose(found, np.array(wanted, float), rtol=1e-14)


def test_a_finger_that_snaps_slides_around_the_object_and_not_through_it(paths):
    """A small circle under the DIP axis, pressed by both pads' ends until one of them slips."""
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
