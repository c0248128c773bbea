"""Rates, transmission, statics and tolerance against formulas, differences and Monte Carlo."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kinematics import (
    compute_spring_energy,
    make_zero_deviations,
    parse_linkage,
    propagate_deviations,
    solve_input_efforts,
    solve_input_slopes,
    solve_mechanical_advantage,
    solve_poses,
)
from tests.helpers import check_gradients, marked, nightly
from tests.kinematics.gallery import (
    gallery,
    gallery_tables,
    poses_of,
    rates_of,
    transmission_of,
)


@pytest.mark.parametrize(
    "name",
    ["quick-return", "scotch-yoke", *nightly("stephenson"), *marked("slow", "finger-crank")],
)
def test_rates_are_the_derivatives_of_poses(name):
    """Velocity, acceleration and jerk against central differences in time."""
    linkage = gallery(name)
    count = len(linkage.input_names)
    start = np.asarray(linkage.reference.inputs) + 0.05
    first, second, third = (np.array(v[:count]) for v in ([0.7, -0.4], [0.3, 0.2], [-0.5, 0.6]))
    motion = rates_of(linkage, start, first, second, third)
    if name == "scotch-yoke":  # orders that are left out are zero
        short, zeros = rates_of(linkage, start, first), np.zeros(count)
        full = rates_of(linkage, start, first, zeros, zeros)
        assert jax.tree.all(jax.tree.map(lambda a, b: bool(jnp.all(a == b)), short, full))
    step = 2e-3
    times = step * np.arange(-3, 4)[:, None]
    inputs = start + times * first + times**2 / 2 * second + times**3 / 6 * third
    pose = poses_of(linkage, inputs).value
    joint = linkage.structure.joints[-1]
    body = linkage.structure.moving[-1].name
    places = np.concatenate(
        [np.asarray(pose.position(joint)), np.unwrap(pose.angle(body))[:, None]], axis=1
    )
    # Differences of sixth and fourth order.
    weights = {
        "velocity": np.array([-1, 9, -45, 0, 45, -9, 1]) / 60 / step,
        "acceleration": np.array([2, -27, 270, -490, 270, -27, 2]) / 180 / step**2,
        "jerk": np.array([1, -8, 13, 0, -13, 8, -1]) / 8 / step**3,
    }
    for order, weight in weights.items():
        rates = getattr(motion, order)
        found = [rates.joints[joint].x, rates.joints[joint].y, rates.bodies[body]]
        np.testing.assert_allclose(found, weight @ places, rtol=1e-5, atol=2e-5)


def test_transmission_angle_of_a_four_bar():
    """Law of cosines: coupler² + rocker² − diagonal² over their product, folded to 90°."""
    angles = np.linspace(0, 6, 50)
    diagonal = 40**2 + 100**2 - 2 * 40 * 100 * np.cos(angles)
    cosine = (120**2 + 80**2 - diagonal) / (2 * 120 * 80)
    found = transmission_of(gallery("four-bar"), angles[:, None])
    np.testing.assert_allclose(found.angles["B"], np.arccos(abs(cosine)), atol=1e-12)
    # Two unit columns at an angle μ have the singular values √(1 ± cos μ).
    np.testing.assert_allclose(found.indices[0], np.sqrt(1 - abs(cosine)), atol=1e-12)


def test_transmission_angle_at_a_slider():
    """Between the rod and the normal of its line: its cosine is the offset over the rod."""
    angles = np.linspace(0, 6, 50)
    found = transmission_of(gallery("slider-crank"), angles[:, None])
    wanted = np.arccos(abs(40 * np.sin(angles) + 20) / 120)
    np.testing.assert_allclose(found.angles["C"], wanted, atol=1e-12)


@pytest.mark.slow
def test_the_index_of_a_triad_has_slopes():
    linkage = gallery("stephenson")
    home = np.asarray(linkage.reference.inputs)
    index = transmission_of(linkage, jnp.asarray(home)[None]).indices[0]
    assert 0 < float(index[0]) < 1

    def index_at(crank):
        return transmission_of(linkage, crank[None, None]).indices[0][0]

    check_gradients(index_at, jnp.asarray(home), rtol=1e-5)


def test_slider_crank_statics():
    """A force F on the slider is held by the moment that equilibrium of the rod asks for."""
    linkage, force = gallery("slider-crank"), 7.0
    angles = np.linspace(0.2, 6.0, 12)[:, None]
    efforts = jax.jit(solve_input_efforts)(linkage, angles, forces={"C": np.array([force, 0.0])})
    pose = poses_of(linkage, angles).value
    rod = np.asarray(pose.position("C") - pose.position("A"))
    tension = force * np.hypot(*rod.T) / rod[:, 0]  # along the rod, so that its x part is F
    pull = tension[:, None] * rod / np.hypot(*rod.T)[:, None]
    a = np.asarray(pose.position("A"))
    moment = a[:, 0] * pull[:, 1] - a[:, 1] * pull[:, 0]
    np.testing.assert_allclose(efforts[:, 0], -moment, rtol=1e-9)


def test_mechanical_advantage_is_the_ratio_of_speeds():
    """ω₄ / ω₂ = a sin(θ₃ − θ₂) / (c sin(θ₃ − θ₄)): Norton, Design of Machinery, section 6.7."""
    linkage = gallery("four-bar")
    angles = np.linspace(0.1, 6.0, 9)

    @jax.jit
    def transmitted(design, inputs):
        pose = solve_poses(design, inputs).value
        return (
            [pose.angle(body) for body in ("coupler", "rocker")],
            solve_mechanical_advantage(design, inputs, lambda pose: pose.angle("rocker")),
            solve_input_efforts(design, inputs, moments={"rocker": jnp.asarray(3.0)}),
        )

    (coupler, rocker), advantage, moment = transmitted(linkage, angles[:, None])
    omega = 40 * np.sin(coupler - angles) / (80 * np.sin(coupler - rocker))
    np.testing.assert_allclose(advantage[:, 0], 1 / omega, rtol=1e-9)
    np.testing.assert_allclose(moment[:, 0], -3 * omega, rtol=1e-9)


def test_at_a_toggle_of_the_output_the_advantage_is_the_largest_number():
    in_line = {"sliders/0/line": [[0, 0], [1, 0]]}
    linkage = parse_linkage(gallery_tables("slider-crank", in_line))

    @jax.jit
    def advantage(inputs):
        return solve_mechanical_advantage(linkage, inputs, lambda pose: pose.joints["C"].x)

    assert float(advantage(np.zeros((1, 1)))[0, 0]) == np.finfo(float).max


def test_springs_hold_the_finger():
    """Moment of the plate's spring: k (Δγ + preload) ∂γ/∂input, by differences of its energy."""
    linkage = gallery("finger")
    inputs = np.radians([[-20.0, -30.0], [-5.0, -80.0], [0.0, 0.0]])
    inputs = np.vstack([inputs, linkage.reference.inputs])

    def relative(pose):
        turned = pose.bodies["plate"].turned(pose.bodies["distal"].conjugate())
        return turned.angle()

    @jax.jit
    def held(design, inputs):
        poses = jax.vmap(lambda u: solve_poses(design, u).value)(inputs)
        energies = jax.vmap(lambda pose: compute_spring_energy(design, pose))(poses)
        slopes = solve_input_slopes(design, inputs, relative)
        return relative(poses), slopes, solve_input_efforts(design, inputs), energies

    gamma, slope, efforts, energy = held(linkage, inputs)
    # The file has 30 N mm/rad and a preload of 0.3 rad.
    change = np.angle(np.exp(1j * np.asarray(gamma - gamma[-1])))
    wanted = 30 * (change + 0.3)[:, None] * slope
    np.testing.assert_allclose(efforts, wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(energy, 15 * (change + 0.3) ** 2, rtol=1e-9)


def test_spread_agrees_with_monte_carlo():
    linkage = gallery("four-bar")
    at = jnp.array([1.0])
    sigma = {"crank": 0.02, "coupler": 0.05, "rocker": 0.03}

    def lengths_of(design):
        return [design.links[body].length for body in sigma]

    sizes = [jnp.asarray(value) for value in sigma.values()]
    deviations = eqx.tree_at(lengths_of, make_zero_deviations(linkage), sizes)

    @jax.jit
    def spread(design, deviations):
        return propagate_deviations(design, at, lambda pose: pose.angle("rocker"), deviations)

    found = spread(linkage, deviations)
    random = np.random.default_rng(0)
    draws = 20_000
    off = [value * random.standard_normal(draws) for value in sigma.values()]
    drawn = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (draws, *leaf.shape)), linkage)
    drawn = eqx.tree_at(lengths_of, drawn, list(map(np.add, lengths_of(linkage), off)))
    angles = jax.jit(jax.vmap(solve_poses, (0, None)))(drawn, at).value.angle("rocker")
    # 20,000 draws know a standard deviation to 0.5 %; four of these are 2 %.
    assert float(found.deviation) == pytest.approx(float(np.std(angles)), rel=0.02)
    shares = [float(share) for share in lengths_of(found.variances)]
    assert sum(shares) == pytest.approx(float(found.deviation) ** 2, rel=1e-12)
    assert min(shares) > 0
    assert float(found.value) == pytest.approx(float(np.mean(angles)), abs=1e-3)
