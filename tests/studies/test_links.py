"""Bars with width: their layers, their clearances and their forces, by independent code."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from pydantic import ValidationError

from studies.models import packaged_finger
from studies.models.finger import Finger, links_of, pins_of
from studies.models.finger_file import write_finger
from studies.models.grasp.pinch import predict
from studies.models.link_layers import Links, find_meetings
from studies.models.linkage_design.forces import (
    find_held_force,
    find_pinch_forces,
    find_stresses,
)
from studies.models.linkage_design.judging import judged
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec
from studies.models.linkage_kinds import SIX_BAR
from studies.models.links import LinksTable
from studies.models.pins import pin_name
from studies.oracles.clearances import CARRIERS, polygon_clearances
from studies.oracles.grasp import Push, Setting, balance
from studies.oracles.grasp import pin_places as oracle_places
from tests.studies.fingers import finger_of

TIP = 30.5
"""Place of a force at the far end of the distal pad, mm."""


def driven(shift: float = 0.0) -> Finger:
    """The packaged finger with its pins moved by up to a shift, mm."""
    finger, generator = packaged_finger(), np.random.default_rng(7)
    moved = jax.tree.map(lambda place: place + shift * generator.uniform(-1, 1, 2), pins_of(finger))
    return finger.with_pins(moved)


@pytest.mark.parametrize("shift", [0.0, 1.5])
def test_clearances_are_those_of_polygons(tmp_path, shift):
    """Of a finger that is clear, and of one whose parts run into each other."""
    finger = driven(shift)
    write_finger(finger, tmp_path / "finger.toml")
    found = polygon_clearances(tmp_path / "finger.toml", steps=91)
    checks = {check.name: check for check in judged(finger, LimitsSpec(), MotorSpec()).checks}
    assert found.assembled.all()
    # Faces from which a bar's pins keep it away by themselves are not among the requirements.
    judged_pairs = {
        (bar, other): checks[f"{bar} from {of}"].achieved
        for bar, other in found.apart
        for of in [{"A": "the PIP axle", "B": "the DIP axle"}.get(other, f"the {other}")]
        if f"{bar} from {of}" in checks
    }
    assert len(judged_pairs) == 18 + 2 * 3
    for (bar, other), achieved in judged_pairs.items():
        least, floor = found.apart[bar, other], -links_floor(finger, other)
        # Shapely has no way out of what overlaps: 0 there.
        assert max(achieved, floor) == pytest.approx(max(least.min(), floor), abs=1e-9)
    keep = float(links_of(finger).bar_width / 2 + links_of(finger).shell)
    pins = [check for name, check in checks.items() if name.startswith("pin ")]
    inside = min(check.achieved for check in pins if " inside " in check.name) - keep
    # Ours takes the worst of all angles of the joint beyond which a pin may lie.
    assert inside <= found.bars_inside + 1e-3
    if shift == 0:
        assert inside == pytest.approx(found.bars_inside, abs=1e-3)


BUT_CRANK = [*SIX_BAR.outlines][1:]


def links_floor(finger: Finger, other: str) -> float:
    links = links_of(finger)
    roundings = {"A": links.axle_diameter, "B": links.axle_diameter}
    roundings |= dict.fromkeys(SIX_BAR.outlines, links.bar_width)
    return float(links.bar_width + roundings.get(other, 0.0)) / 2


def test_a_pin_of_a_thin_finger_stands_out_of_its_back(tmp_path):
    """Design B in 14 mm: at 90/90 pin E is beyond the arc about the PIP axis."""
    finger = finger_of(thickness=14.0)
    write_finger(finger, tmp_path / "finger.toml")
    found = polygon_clearances(tmp_path / "finger.toml", steps=4)
    assert found.inside["crank"].min() < -7
    checks = {check.name: check for check in judged(finger, LimitsSpec(), MotorSpec()).checks}
    assert not checks["pin E inside the dorsal face"].met


def test_bars_that_can_meet_lie_in_one_layer_or_are_crossed():
    finger = packaged_finger()
    pairs = {frozenset(pair) for pair in find_meetings(links_of(finger), finger.joined())}
    first, second = ("crank", "plate", "driver"), ("rod", "bar", "coupler")
    wanted = {
        frozenset(pair) for bars in (first, second) for pair in itertools.combinations(bars, 2)
    }
    wanted |= {frozenset((bar, axle)) for bar in SIX_BAR.outlines for axle in "AB"}
    assert pairs == wanted
    joined = {pin_name(pin): set(bodies) for pin, bodies in finger.joined().items()}
    assert joined == {pin: set(bodies) for pin, bodies in CARRIERS.items()}


def test_no_other_order_of_layers_joins_neighbours_only():
    """Walls of the outer phalanges, bars in two layers, wall of the intermediate phalanx."""
    parts = [("proximal", "distal"), *SIX_BAR.layers[2:]]
    good = []
    for order in itertools.permutations(parts):
        layer = {part: number for number, of in enumerate(order) for part in of}
        steps = [abs(layer[a] - layer[b]) for pin, (a, b) in CARRIERS.items() if pin not in "AB"]
        if all(step == 1 for step in steps):
            good.append(order)
    assert good == [tuple(parts), tuple(reversed(parts))]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"thickness": [12.0]}, "thickness has 1 entries and layers 5"),
        ({"layers": [["crank"], *map(list, SIX_BAR.layers[1:])]}, "'crank' lies in 2 layers"),
        ({"layers": [list(SIX_BAR.walls), list(SIX_BAR.outlines), [], [], []]}, None),
        ({"layers": [["proximal", "crank"], ["intermediate", "distal"], BUT_CRANK, [], []]},
         "crank would move through the wall of proximal"),
        ({"pin_diameter": 4.0}, "leaves nothing of a bar 4 mm wide"),
    ],
)  # fmt: skip
def test_layers_that_cannot_be_are_refused(change, message):
    if message is None:
        with pytest.raises(ValueError, match="share pin A and lie in one layer"):
            find_meetings(Links.of(LinksTable(**change)), packaged_finger().joined())
        return
    with pytest.raises(ValidationError, match=message):
        LinksTable(**change)


def setting_of(finger: Finger) -> Setting:
    pins = {name: complex(*np.asarray(getattr(finger.pins, name)).tolist()) for name in "CDEFGH"}
    given = {"depth": 4.0, "starts": (4.0, 4.0), "rim": 1.5, "limits": (math.pi / 2,) * 2}
    given |= {"spring": 30.0, "servo": 300.0}
    return Setting(pins, (23.0, 32.0), **given, preload=0.3, command=0.0, circle=None)


@pytest.mark.parametrize("finger", [driven(), finger_of()], ids=["driven", "design B"])
@pytest.mark.parametrize("place", [12.0, TIP])
def test_a_pinch_is_in_balance(finger, place):
    """The oracle solves for the push that balances our crank moment, and for the stop."""
    pip, force = jnp.deg2rad(jnp.array([0.0, 35.0, 90.0])), 5.0
    found = find_pinch_forces(finger, pip, force, place)
    setting = setting_of(finger)
    for i, angle in enumerate(pip.tolist()):
        turn = complex(math.cos(angle), -math.sin(angle))
        push = Push("distal", (23.0 + place - 4j) * turn, 1j * turn)
        moment = float(found.crank_moment[i])
        other = balance(setting, (angle, 0.0), [push], (False, True), moment, (0.0, 0.0))
        np.testing.assert_allclose(other.forces, [force], rtol=1e-9)
        np.testing.assert_allclose(found.stop[i], other.stops[1], atol=1e-8)
        # The rod's force turns the crank as the motor does.
        at = oracle_places(setting, angle, 0.0, mpmath.fp)
        rod = at["D"] - at["E"]
        lever = abs(((at["E"] - at["F"]).conjugate() * rod).imag) / abs(rod)
        assert float(found.pins["E"][i]) * lever == pytest.approx(moment)


def test_the_coupler_pulls_with_what_the_crank_needs():
    """At right angles to its arm the force is moment over arm; at 40° it is 1.56 times that."""
    finger = driven()
    found = find_pinch_forces(finger, jnp.deg2rad(jnp.linspace(0, 90, 91)), 5.0, TIP)
    at = pins_of(finger).places()
    arm = (at["K"] - at["F"]).length()
    ratio = np.asarray(found.pins["K"] * arm / found.crank_moment)
    assert ratio.min() >= 1
    assert ratio.max() <= 1 / math.sin(math.radians(40.0))
    np.testing.assert_allclose(found.pins["M"], found.pins["K"])


@pytest.mark.parametrize("place", [8.0, 16.0, 20.0, 25.0])
def test_what_a_pinch_holds_is_what_the_grasp_gives(place):
    """`grasp.pinch` has the motor's moment at which it gives way, checked by closing on a disc."""
    finger, angles = driven(), np.deg2rad([0.0, 30.0, 90.0])
    held = np.asarray(find_held_force(finger, jnp.asarray(angles), jnp.asarray(place)))
    for one, force in zip(predict(finger, [(pip, place) for pip in angles]), held, strict=True):
        loaded = find_pinch_forces(finger, jnp.asarray([one.pip]), 1.0, place)
        moment = float(loaded.crank_moment[0])
        assert force == pytest.approx(one.limit / moment, rel=1e-9)
        if math.isfinite(force):
            at_limit = find_pinch_forces(finger, jnp.asarray([one.pip]), force, place)
            assert float(at_limit.stop[0]) == pytest.approx(0.0, abs=1e-8)


def test_stresses_by_hand():
    """A rod of 1.2 × 4 mm with 1.5 mm holes, and the pin at its end, half of the force each."""
    finger = driven()
    forces = find_pinch_forces(finger, jnp.zeros(1), 5.0, TIP)
    found, force = find_stresses(finger, forces), float(forces.pins["E"][0]) / 2
    assert float(found.bars["rod"][0]) == pytest.approx(force / (1.2 * (4.0 - 1.5)))
    shear = force / (math.pi / 4 * 1.5**2)
    bending = force * 1.3 / 2 / (math.pi * 1.5**3 / 32)
    assert float(found.pins["E"][0]) == pytest.approx(math.hypot(bending, math.sqrt(3) * shear))
    moment = float(forces.crank_moment[0]) / 2
    section = 1.2 * (4.0 - 1.5)
    modulus = 1.2 * (4.0**3 - 1.5**3) / (6 * 4.0)
    driver = moment / modulus + float(forces.pins["K"][0]) / 2 / section
    assert float(found.bars["driver"][0]) == pytest.approx(driver)


def test_slopes_of_forces_are_central_differences():
    finger, step = driven(), 1e-5

    def figures(x: jax.Array) -> jax.Array:
        pins = replace(pins_of(finger), D=jnp.stack([x, pins_of(finger).D[1]]))
        moved = replace(finger, pins=pins)
        found = find_pinch_forces(moved, jnp.array([0.5]), 5.0, TIP)
        parts = [found.crank_moment, found.stop, *found.pins.values(), *found.bending.values()]
        held = find_held_force(moved, jnp.array([0.5]), jnp.array(16.0))
        return jnp.concatenate([*parts, held, *find_stresses(moved, found).pins.values()])

    x = pins_of(finger).D[0]
    slopes = jax.jit(jax.jacfwd(figures))(x)
    difference = (figures(x + step) - figures(x - step)) / (2 * step)
    np.testing.assert_allclose(slopes, difference, rtol=1e-6, atol=1e-6)
