"""Poses: gradients, invariants, batches, failures as data."""

import dataclasses

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest

from kinematics import parse_linkage, solve_poses
from kinematics.solve.continuation import newton_correct, split
from kinematics.solve.evaluation import evaluate
from kinematics.solve.plan import make_plan
from kinematics.solve.solver import Solver
from kinematics.solve.steps import Plan
from tests.helpers import check_gradients, marked
from tests.kinematics.gallery import each_linkage, gallery, gallery_tables, poses_of

GROUPS = ("slider-crank", "quick-return", "scotch-yoke", "finger-crank")  # one of each kind
CLOSED = 1e-12  # what the project promises, in units of the linkage's size


def near_home(name, count, spread=0.3):
    """Inputs around the sketch, all within the linkage's limits."""
    random = np.random.default_rng(0)
    home = np.asarray(gallery(name).reference.inputs)
    return home + random.uniform(-spread, spread, (count, len(home)))


@each_linkage(quick=("jansen", "stephenson"))
def test_every_gallery_linkage_closes(name):
    poses = poses_of(gallery(name), near_home(name, 4, 0.05))
    assert bool(jnp.all(poses.ok))
    assert float(jnp.max(poses.residual)) <= CLOSED


def leaves_of(linkage):
    """The linkage as a vector of its dimensions, and the way back."""
    flat, back = jax.flatten_util.ravel_pytree((linkage.anchors, linkage.links, linkage.lines))

    def rebuilt(vector):
        parts = back(vector)
        return eqx.tree_at(
            lambda design: (design.anchors, design.links, design.lines), linkage, parts
        )

    return flat, rebuilt


@pytest.mark.parametrize(
    "name",
    [*GROUPS, *marked("as_users", "stephenson")],
)
def test_compiled_batched_gradients(name):
    """Of every dimension and input, under jit(vmap(grad)), against central differences."""
    linkage = gallery(name)
    flat, rebuilt = leaves_of(linkage)

    def value(design):
        """A number to which the last joint and the last body contribute."""
        dimensions, inputs = jnp.split(jnp.stack(design), [len(flat)])
        pose = solve_poses(rebuilt(dimensions), inputs).value
        last = pose.joints[linkage.structure.joints[-1]]
        return last.x + 0.3 * last.y + 20 * pose.bodies[linkage.structure.moving[-1].name].x

    designs = np.array([np.concatenate([flat, row]) for row in near_home(name, 3, 0.1)])
    check_gradients(value, [*jnp.asarray(designs.T)], rtol=1e-6, atol=2e-7)


@pytest.mark.parametrize("name", ["slider-crank", "quick-return", "jansen"])
def test_closed_form_and_newton_agree(name):
    """The same loops, solved by Newton's method from a disturbed start."""
    linkage = gallery(name)
    plan = make_plan(linkage.structure)
    steps = tuple(
        dataclasses.replace(step, kind="iterated") if step in plan.groups else step
        for step in plan.steps
    )
    newton = Plan(plan.orientations, steps)
    solver = Solver.of(linkage, jnp.float64)

    @jax.jit
    @jax.vmap
    def both(inputs):
        drive = solver.drive(inputs)
        state = solver.state(drive)
        guess = [
            value + 1e-3
            for group in plan.groups
            for value in (
                *(state.rotations[body].angle() for body in group.angles),
                *(state.slides[slider] for slider in group.sliders),
            )
        ]
        found = newton_correct(solver.unit, newton, drive.values, solver.signs, jnp.stack(guess))
        parts = {index: (part, ()) for index, part in split(newton, found).items()}
        again = evaluate(solver.unit, newton, drive, solver.signs, parts)
        return state.places, again.places

    closed, iterated = both(near_home(name, 50, 0.5))
    for joint in closed:
        gap = closed[joint] - iterated[joint]
        assert float(jnp.max(gap.length())) <= CLOSED, joint


def test_moved_and_turned_linkages_move_and_turn():
    linkage, inputs = gallery("jansen"), near_home("jansen", 4)
    angle, shift = 0.7, np.array([123.0, -45.0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    anchors = jnp.asarray(np.asarray(linkage.anchors) @ turn.T + shift)
    moved = eqx.tree_at(lambda design: design.anchors, linkage, anchors)
    # Its crank is driven against the fixed axes, so it has to turn as well.
    before, after = poses_of(linkage, inputs), poses_of(moved, inputs + angle)
    for joint in linkage.structure.joints:
        wanted = np.asarray(before.value.position(joint)) @ turn.T + shift
        np.testing.assert_allclose(after.value.position(joint), wanted, atol=1e-11)
    np.testing.assert_allclose(after.margin, before.margin, atol=1e-11)


def test_what_is_not_asked_for_is_not_there():
    linkage, inputs = gallery("jansen"), near_home("jansen", 4)
    whole, part = (poses_of(linkage, inputs, of=of).value for of in (None, ("J3",)))
    assert "J7" not in part.joints
    np.testing.assert_array_equal(part.position("J3"), whole.position("J3"))


@pytest.mark.parametrize("name", ["slider-crank", "stephenson"])
def test_scaled_linkages_scale_and_impossible_inputs_are_data(name):
    linkage, inputs = gallery(name), near_home(name, 4)
    flat, rebuilt = leaves_of(linkage)
    large = rebuilt(1e6 * flat)
    if linkage.lines:
        angle = linkage.lines[0].angle
        large = eqx.tree_at(lambda design: design.lines[0].angle, large, angle)
    small, big = poses_of(linkage, inputs), poses_of(large, inputs)
    joint = linkage.structure.joints[-1]
    np.testing.assert_allclose(big.value.position(joint), 1e6 * small.value.position(joint))
    np.testing.assert_allclose(big.margin, 1e6 * small.margin, rtol=1e-9)
    none = poses_of(linkage, np.array([[np.nan], [np.inf], [-np.inf], [1e300]]))
    assert not np.any(none.ok[:3])
    assert all("not a finite number" in message for message in none.messages()[:3])
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((none.value, none.margin)))


def test_mirrored_inputs_give_the_mirrored_linkage():
    linkage, inputs = gallery("slider-crank"), near_home("slider-crank", 4)
    point = linkage.lines[0].point * np.array([1.0, -1.0])
    mirrored = eqx.tree_at(lambda design: design.lines[0].point, linkage, point)
    one, other = poses_of(linkage, inputs), poses_of(mirrored, -inputs)
    np.testing.assert_allclose(one.value.joints["C"].x, other.value.joints["C"].x, atol=1e-12)
    np.testing.assert_allclose(one.value.joints["C"].y, -other.value.joints["C"].y, atol=1e-12)


def test_many_poses_and_their_gradients_are_those_of_few():
    """Large batches run in blocks, whose size need not divide their number."""
    linkage = gallery("four-bar")
    inputs = np.linspace(0.0, 6.0, 20_011)[:, None]

    @jax.jit
    def outputs(design, inputs):
        poses = solve_poses(design, inputs)
        return poses.value.joints["B"].x, poses.margin

    # Compiled for another number of poses, the last digits may be other ones.
    for many, few in zip(outputs(linkage, inputs), outputs(linkage, inputs[::4000]), strict=True):
        assert many.shape == (20_011,)
        np.testing.assert_allclose(many[::4000], few, rtol=1e-14, atol=1e-12)

    @jax.jit
    @jax.grad
    def slope(design, inputs, weights):
        return jnp.sum(weights * solve_poses(design, inputs).value.joints["B"].y)

    whole = slope(linkage, inputs, np.ones(20_011))
    weights = np.pad(np.ones(20_011), (0, 189)).reshape(-1, 200)
    few = np.pad(inputs, ((0, 189), (0, 0)), mode="edge").reshape(-1, 200, 1)
    parts = [slope(linkage, *part) for part in zip(few, weights, strict=True)]
    for leaf, *pieces in zip(*map(jax.tree.leaves, (whole, *parts)), strict=True):
        np.testing.assert_allclose(leaf, np.sum(pieces, axis=0), rtol=1e-9, atol=1e-9)


def test_any_shape_of_batch_and_batches_of_designs():
    linkage, inputs = gallery("four-bar"), near_home("four-bar", 6)
    grid = poses_of(linkage, inputs.reshape(2, 3, 1))
    flat = poses_of(linkage, inputs)
    assert grid.value.position("B").shape == (2, 3, 2)
    np.testing.assert_array_equal(grid.margin.reshape(-1), flat.margin)
    diagonal = np.sqrt(40**2 + 100**2 - 2 * 40 * 100 * np.cos(inputs[:, 0]))  # law of cosines
    margin = np.minimum(120 + 80 - diagonal, diagonal - abs(120 - 80))
    np.testing.assert_allclose(flat.margin, margin, rtol=0, atol=1e-11)
    longer = jax.tree.map(lambda leaf: np.stack([leaf, 1.01 * leaf]), linkage)
    designs = jax.jit(jax.vmap(solve_poses, (0, None)))(longer, inputs)
    np.testing.assert_allclose(designs.value.joints["B"].x[0], flat.value.joints["B"].x, atol=1e-13)


def test_failures_are_data():
    linkage = gallery("watt")
    poses = poses_of(linkage, np.radians([[90.0], [180.0], [270.0]]))
    assert poses.ok.tolist() == [True, False, False]
    assert poses.margin[0] > 0 > poses.margin[1]
    assert poses.messages()[0] == ""
    assert "farther apart than the links between them reach" in poses.messages()[1]
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(poses.value))


def test_float32_without_and_with_64_bit_floats():
    inputs = np.deg2rad([[40.0], [200.0]])
    exact = poses_of(gallery("four-bar"), inputs).value.position("B")
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), gallery("four-bar"))
    for wide in (True, False):
        with jax.enable_x64(wide):
            poses = jax.jit(solve_poses)(single, jnp.asarray(inputs, jnp.float32))
            assert poses.margin.dtype == jnp.float32
            np.testing.assert_allclose(poses.value.position("B"), exact, rtol=1e-5)


def test_a_slide_as_input():
    """The slider-crank driven at its slider: the crank angle comes back."""
    angles = near_home("slider-crank", 4)
    slides = poses_of(gallery("slider-crank"), angles).value.slides[0]
    for far in (0.0, 1e7):  # the line's first point may lie anywhere along it
        line = [[far, -20], [far + 1, -20]]
        changes = {"inputs": [{"name": "ram", "slider": "C"}], "sliders/0/line": line}
        driven = parse_linkage(gallery_tables("slider-crank", changes))
        back = poses_of(driven, slides[:, None] - far)
        assert bool(jnp.all(back.ok))
        np.testing.assert_allclose(back.value.angle("crank"), angles[:, 0], atol=1e-9)
