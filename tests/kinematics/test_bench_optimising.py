"""Lengths that transmit best: found from the bench, checked by closed forms and dense sweeps."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from designopt import UserError
from kinematics.explore.bench import LinkageBench
from kinematics.explore.optimising import GAIN, PATIENCE, UPDATES
from kinematics.io.designed import DesignedLinkage
from tests.kinematics.gallery import FOLDER, poses_of, transmission_of


def bench_of(name):
    return LinkageBench(DesignedLinkage.read(FOLDER / f"{name}.toml"))


def start(bench, **changed):
    return {knob.name: knob.value for knob in bench.knobs} | changed


def dense(bench, values, inputs):
    """The least transmission angle over inputs, degrees; all of them are poses."""
    linkage = bench.linkage(values)
    assert np.all(np.asarray(poses_of(linkage, inputs).ok))
    angles = transmission_of(linkage, inputs).angles
    return math.degrees(min(float(jnp.min(angle)) for angle in angles.values()))


def solved(bench, values):
    steps = list(bench.optimise(values))
    for step in steps:
        assert step.values.keys() == values.keys()
        for knob in bench.knobs:
            if knob.kind == "joint":
                assert step.values[knob.name] == values[knob.name]
            else:
                assert knob.low - 1e-9 <= step.values[knob.name] <= knob.high + 1e-9
    assert [step.message.split(":")[0] for step in steps[:-1]] == [
        f"iteration {number}" for number in range(1, len(steps))
    ]
    return steps


def test_a_four_bar_transmits_better():
    """By the law of cosines, with every crank angle; the crank still turns all the way."""
    bench = bench_of("four-bar")
    assert "transmission angle" in bench.aim
    last = solved(bench, start(bench))[-1]
    names = ("crank O2-A", "coupler A-B", "rocker O4-B", "ground O2-O4")
    a, b, c, d = (last.values[name] for name in names)
    lengths = sorted((a, b, c, d))
    assert lengths[0] == a
    assert lengths[0] + lengths[3] < lengths[1] + lengths[2]  # Grashof's condition
    crank = np.linspace(0, 2 * np.pi, 3601)
    diagonal = a * a + d * d - 2 * a * d * np.cos(crank)
    cosine = np.abs(b * b + c * c - diagonal) / (2 * b * c)
    least = math.degrees(math.acos(float(np.max(cosine))))
    said = last.message.split("; ")[0]
    assert said == f"least transmission angle {least:.1f}° instead of 26.4°"
    # With equal deviations from 90° at both ends of the ground, sin of it is a d / (b c): least
    # at the shortest crank and the longest coupler and rocker that balance b² + c² = a² + d².
    np.testing.assert_allclose(b * b + c * c, a * a + d * d, rtol=1e-3)
    assert a == pytest.approx(20.0, rel=1e-3)
    np.testing.assert_allclose(least, 90 - math.degrees(math.asin(a * d / (b * c))), atol=0.1)
    assert least > 76.0


def reading(bench, values):
    found: Any
    (found,) = [one.value for one in bench.show(values).readings if one.name == "least μ"]
    return found


@pytest.mark.parametrize(
    "name",
    [
        "four-bar",
        pytest.param("watt", marks=pytest.mark.nightly),
        pytest.param("five-bar", marks=pytest.mark.slow),
        pytest.param("finger", marks=pytest.mark.nightly),
    ],
)
def test_what_is_told_is_what_is_read(name):
    """At the start, after every step and at the end, which is the best; there it stays."""
    bench = bench_of(name)
    area: Any = Figure(figsize=(8, 6)).subfigures(1, 1)
    bench.draw(area)
    values = start(bench)
    first = reading(bench, values)
    steps = solved(bench, values)
    for step in steps[:-1]:
        if "not all" not in step.message:
            assert step.message.endswith(f"least transmission angle {told(bench, step)}°")
    last = steps[-1]
    said = f"least transmission angle {told(bench, last)}° instead of {first:.1f}°; "
    assert last.message.startswith(said)
    assert reading(bench, last.values) > first + 5
    assert len(steps) <= UPDATES + 1
    *further, end = solved(bench, last.values)
    if len(steps) <= UPDATES:
        assert len(further) <= PATIENCE
        assert end.message.startswith("no better lengths found within the knobs: ")
        assert end.values == last.values
    why = end.message.split("; ", maxsplit=1)[1]
    assert why in (
        "nothing near is better",
        f"the last {PATIENCE} iterations gained less than {GAIN:g}°",
        f"stopped after {UPDATES} iterations; press again to go on",
    )


def told(bench, step):
    return f"{reading(bench, step.values):.1f}"


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        pytest.param("watt", -59.9, 157.0, marks=pytest.mark.nightly),
        pytest.param("slider-crank", 0, 360, marks=pytest.mark.slow),
    ],
)
def test_a_dense_sweep_confirms_it(name, low, high):
    """The whole range in which the first design works, but for its outermost fiftieths.

    The range that is told of is wider after it.
    """
    bench = bench_of(name)
    inputs = jnp.radians(jnp.linspace(low, high, 2001))[:, None]
    last = solved(bench, start(bench))[-1]
    before, after = (dense(bench, values, inputs) for values in (start(bench), last.values))
    assert after > before + 5
    said = float(last.message.removeprefix("least transmission angle ").split("°")[0])
    assert before + 5 < said < after + 0.3


@pytest.mark.nightly
def test_two_inputs_at_once():
    bench = bench_of("finger")
    steps = solved(bench, start(bench))
    said = [
        float(steps[-1].message.split(text)[1].split("°")[0]) for text in ("angle ", "instead of ")
    ]
    assert said[0] > said[1] + 10


def test_without_a_pose_there_is_nothing_to_start_from():
    bench = bench_of("four-bar")
    with pytest.raises(UserError, match="gives a pose"):
        next(
            bench.optimise(
                start(bench, **{"rocker O4-B": 40.0, "coupler A-B": 204.0, "crank O2-A": 20.0})
            )
        )


@pytest.mark.slow
def test_without_transmission_angles_there_is_no_aim():
    bench = bench_of("stephenson")
    assert bench.aim == ""
    with pytest.raises(UserError, match="no pin with a transmission angle"):
        bench.optimise(start(bench))
