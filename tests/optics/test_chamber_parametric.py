"""A chamber's measures against Eqs. 1-3 written out, their slopes, Table I, the best rings."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.errors import UserError
from designopt.optimize import Evaluation, Problem, make_epigraph, make_epigraph_starts, minimize
from optics import ChamberResult
from optics.chamber.designed import DesignedChamber
from optics.chamber.file import read_chamber
from optics.parametric.chamber import NAMES, ChamberParameters, chamber_at
from tests.helpers import check_gradients, load_toml
from tests.optics.chambers import MOVES, PAPER, chamber, eq_1

ROUNDING = 1e-12
RINGS = ("ring_blue", "ring_yellow", "ring_top")


def parameters_of(chamber=PAPER):
    design = ChamberParameters(DesignedChamber("soft", chamber))
    return design, design.values()


@pytest.mark.parametrize("moves", MOVES)
def test_measures_are_those_of_eq_1(moves):
    design, values = parameters_of()
    values |= moves
    offset_c, offset_d, _, (image_b, image_c, image_d) = eq_1(values)
    offsets = (values["offset_b"], offset_c, offset_d)
    wanted = {
        "ring_blue": image_b - image_c,
        "ring_yellow": image_c - image_d,
        "ring_top": image_d,
        "imaging_ratio": values["imaging_ratio"],
        "room": values["offset_a"] - max(map(abs, offsets)),
    }
    wanted["ring"] = min(wanted[name] for name in RINGS)
    assert design.judge(values) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    arrays = design.evaluate(design.vector(values), tuple(wanted))
    least = {name: float(jnp.min(array)) for name, array in arrays.items()}
    assert least == pytest.approx(wanted, rel=1e-9, abs=1e-12)


def test_parameters_begin_at_the_design_and_measures_have_words():
    design, values = parameters_of()
    assert design.title == "soft"
    assert tuple(values) == NAMES
    assert all(one.low < one.value < one.high for one in design.parameters)
    assert values["wall_angle_bc"] == pytest.approx(2.0, rel=ROUNDING)
    assert eq_1(values)[1] == pytest.approx(2.55, rel=ROUNDING)
    assert set(design.free or ()) < set(NAMES)
    where = {one.name: [one.where((index,)) for index in range(3)] for one in design.measures[:1]}
    assert where == {"ring": ["blue ring", "yellow ring", "top"]}


def test_table_1_is_found_from_its_ratios():
    table = load_toml("table1.toml")
    found = table["identified"]
    camera = {"reference_height": found["reference_height_mm"]}
    design, values = parameters_of(chamber(**camera, pinhole_offset=found["pinhole_offset_mm"]))
    columns = zip(table["paper"]["eta"], table["paper"]["theta_cd_deg"], strict=True)
    for ratio, angle in columns:
        made, solved = chamber_at(design.vector(values | {"imaging_ratio": ratio}))
        assert bool(solved.ok)
        # Constants that were fitted to the printed angles leave a hundredth of a degree.
        assert math.degrees(float(made.wall_angle_cd)) == pytest.approx(angle, abs=0.02)
        line = table["lines"]["table"]
        wanted = line["slope"] * ratio + line["intercept"]
        assert float(made.offset_d) == pytest.approx(wanted, abs=0.01)


@pytest.mark.parametrize("name", ["ring", "ring_yellow", "room"])
def test_slopes_are_central_differences_also_where_there_is_no_image(name):
    design, values = parameters_of()
    turned = [
        values | {"offset_b": 1.7},
        values | {"wall_angle_bc": -3.0, "length_ab": 44.0},
        values | {"wall_angle_bc": -15.0},
        values | {"image_distance": 4.5},
    ]
    batch = jnp.stack([design.vector(one) for one in turned])

    def weighted(numbers):
        array = design.evaluate(jnp.stack(numbers), (name,))[name]
        return jnp.sum(array * jnp.arange(1.0, 1.0 + array.size).reshape(array.shape))

    check_gradients(weighted, [*batch.T], rtol=1e-6, atol=1e-8)
    hidden = design.evaluate(batch[2], ("ring",))["ring"]
    assert float(jnp.max(hidden)) < 0


@pytest.mark.parametrize(
    ("moves", "result"),
    [
        ({"wall_angle_bc": -15.0}, ChamberResult.blue_edge_on),
        ({"pinhole_offset": -41.0}, ChamberResult.behind_pinhole),
        ({"length_bc": -1.0}, ChamberResult.no_length),
    ],
)
def test_what_is_no_chamber_is_neither_judged_nor_written(moves, result):
    design, values = parameters_of()
    for refused in (design.judge, design.files):
        with pytest.raises(UserError) as caught:
            refused(values | moves)
        assert str(caught.value) == f"soft: {ChamberResult[result]}"


def test_the_file_is_the_chamber_of_the_values(tmp_path):
    design, values = parameters_of()
    values |= {
        "imaging_ratio": 0.71,
        "wall_angle_bc": -1.25,
        "offset_b": 2.5,
        "length_cd": 33.0,
        "pinhole_offset": 1.5,
        "focal_length": 4.2,
    }
    (file,) = design.files(values)
    path = tmp_path / file.name
    path.write_text(str(file.content), encoding="utf-8")
    name, chamber = read_chamber(path)
    assert name == "soft"
    assert float(chamber.offset_d) == pytest.approx(eq_1(values)[1], rel=1e-9)
    again = ChamberParameters(DesignedChamber.read(path))
    assert again.values() == pytest.approx(values, rel=ROUNDING)


def test_the_narrowest_ring_becomes_the_widest_there_is():
    """Against all walls on a grid, by Eq. 1 written out."""
    design, values = parameters_of()
    values["imaging_ratio"] = 0.5
    free = [NAMES.index(name) for name in design.free or ()]
    start = design.vector(values)
    low, high = (
        jnp.array([getattr(design.parameters[i], end) for i in free]) for end in ("low", "high")
    )

    def terms(chosen):
        found = design.evaluate(start.at[jnp.array(free)].set(chosen), ("ring", "room"))
        return Evaluation(least={"ring": found["ring"]}, inequalities={"room": found["room"]})

    problem = Problem(terms, low, high)
    form = make_epigraph(problem, scale=0.05)
    starts = make_epigraph_starts(problem, start[jnp.array(free)][None])
    best = minimize(form, starts).best
    assert best.feasible
    found = values | dict(zip(design.free or (), best.parameters.design.tolist(), strict=True))
    judged = design.judge(found)
    reach = np.linspace(-4.1, 4.1, 83)
    b, c, d = np.meshgrid(reach, reach, reach, indexing="ij")
    images = [
        0.5 * (8.616 + height) / (s + 0.844) for height, s in ((b, 40.0), (c, 70.0), (-d, 100.0))
    ]
    widths = np.min([images[0] - images[1], images[1] - images[2], images[2]], axis=0)
    assert judged["ring"] >= np.max(widths) * (1 - 1e-6)
    # Δl_C at Δl_A, and the top as wide as the yellow ring.
    assert judged["ring"] == pytest.approx(0.5 * (8.616 + 4.1) / 70.844 / 2, rel=1e-5)
    assert judged["room"] >= -1e-5


def test_rings_are_as_wide_whichever_way_up_the_image_is():
    turned = dataclasses.replace(PAPER, image_distance=jnp.asarray(4.5))
    upright, over = (parameters_of(one) for one in (PAPER, turned))
    widths = [design.judge(values)["ring"] for design, values in (upright, over)]
    assert widths[0] == pytest.approx(float(jnp.min(PAPER.ring_widths().value)), rel=1e-9)
    assert widths[1] == pytest.approx(widths[0], rel=1e-9)
    assert jax.tree.all(
        jax.tree.map(
            lambda one, other: bool(jnp.allclose(one, other)),
            *(design.evaluate(design.vector(v), RINGS) for design, v in (upright, over)),
        )
    )
