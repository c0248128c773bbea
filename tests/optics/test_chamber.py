"""The chamber's imaging against Eq. 1 as printed, the paper's table, and central differences.

A failure in the first group means that the factored forms no longer are Eqs. 1-3; in the second
that the readings of the paper have changed.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optics import ChamberResult
from studies.oracles.chamber import image_heights
from tests.helpers import central_differences, load_toml
from tests.optics.chambers import chamber as make

ROUNDING = 1e-12  # relative; Eq. 1 as printed loses up to three digits by its differences
GRADIENT = 1e-6
DIFFERENCES = 1e-9  # of the largest entry: what central differences themselves can tell

TABLE = load_toml("table1.toml")

lengths = st.floats(1.0, 100.0)
offsets = st.floats(-3.0, 3.0)


@given(a=lengths, b=lengths, c=lengths, offset_b=offsets, offset_d=offsets, angle=st.floats(0, 1.4))
def test_images_are_those_of_eq_1(a, b, c, offset_b, offset_d, angle):
    chamber = make(
        length_ab=a, length_bc=b, length_cd=c, offset_b=offset_b, offset_d=offset_d,
        wall_angle_bc=angle,
    )  # fmt: skip
    plain = {name: float(value) for name, value in vars(chamber).items()}
    gap = plain["focal_length"] - plain["image_distance"]
    expected = [float(gap * height) for height in image_heights(**plain)]
    scale = max(map(abs, expected))
    heights, widths = chamber.image_heights(), chamber.ring_widths()
    np.testing.assert_allclose(heights.value, expected, rtol=ROUNDING)
    rings = [expected[0] - expected[1], expected[1] - expected[2], expected[2]]
    np.testing.assert_allclose(widths.value, rings, atol=ROUNDING * scale)
    ratio = chamber.imaging_ratio()
    np.testing.assert_allclose(
        ratio.value * widths.value[0], widths.value[1], atol=ROUNDING * scale
    )
    assert all(bool(image.ok) for image in (ratio, widths, heights))


def test_printed_chamber_is_eq_1_with_its_own_constants():
    chamber = make().as_printed()
    image_b = chamber.image_heights().value[0]
    # (a + f) / (f − v) = (Δl_A + Δl_B) / (Δd_b + Δd_c + Δd_d), Eq. 1
    np.testing.assert_allclose((40 + 4) / (4 - 3.5), (4.1 + 2) / image_b, rtol=ROUNDING)
    np.testing.assert_allclose(chamber.ring_widths().value.sum(), image_b, rtol=ROUNDING)


def test_eq_2_continued_to_d_holds_for_every_row_of_the_table():
    for offset_d_cm, angle_deg in zip(
        TABLE["paper"]["delta_l_d_cm"], TABLE["paper"]["theta_cd_deg"], strict=True
    ):
        found = make().with_wall_angle_cd(np.deg2rad(angle_deg)).offset_d
        assert abs(float(found) / 10 - offset_d_cm) < 4.5e-4  # cm; the printed rounding is 5e-4


def test_ratio_is_defined_where_f_equals_v():
    chamber = make(image_distance=4.0)
    np.testing.assert_allclose(chamber.imaging_ratio().value, make().imaging_ratio().value)
    np.testing.assert_array_equal(chamber.ring_widths().value, 0.0)


def quantities(chamber):
    """All public quantities; weights tell the parts of arrays apart."""
    weights = jnp.asarray([1.0, 2.0, 3.0])
    return jnp.stack(
        [
            chamber.imaging_ratio().value,
            chamber.imaging_ratio().margin,
            chamber.wall_angle_cd,
            chamber.as_printed().imaging_ratio().value,
            jnp.vdot(chamber.ring_widths().value, weights),
            jnp.vdot(chamber.image_heights().value, weights),
            chamber.with_wall_angle_cd(0.2).imaging_ratio().value,
        ]
    )


def test_compiled_batched_gradients_are_central_differences():
    """With jnp.cumsum of the lengths, jaxlib 0.10.2 compiles the batched gradient wrongly."""
    chambers = [make(), make(length_cd=17.0), make(offset_b=1.0)]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *chambers)
    found = jax.tree.leaves(jax.jit(jax.vmap(jax.jacrev(quantities)))(batch))
    compiled = jax.jit(quantities)
    for row, chamber in enumerate(chambers):
        for number in range(7):
            expected = central_differences(lambda c, i=number: compiled(c)[i], chamber)
            mine = [float(leaf[row, number]) for leaf in found]
            scale = np.max(np.abs(expected))
            np.testing.assert_allclose(mine, expected, rtol=GRADIENT, atol=DIFFERENCES * scale)


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"pinhole_offset": -40.0}, ChamberResult.behind_pinhole),
        ({"pinhole_offset": -85.0}, ChamberResult.behind_pinhole),
        ({"length_ab": -0.5}, ChamberResult.no_length),
        ({"length_bc": 0.0}, ChamberResult.no_length),
        ({"length_cd": 0.0}, ChamberResult.no_length),
        ({"wall_angle_bc": np.deg2rad(-80.0)}, ChamberResult.blue_edge_on),
    ],
)
def test_what_has_no_image_is_reported_and_stays_finite(changes, code):
    chamber = make(**changes)
    ratio = chamber.imaging_ratio()
    assert bool(ratio.result == code)
    assert float(ratio.margin) <= 0
    assert ratio.messages() == [ChamberResult[code]]
    gradient = jax.grad(lambda c: c.imaging_ratio().value)(chamber)
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves((ratio.value, gradient)))


def test_images_fail_only_behind_the_pinhole():
    assert bool(make(length_bc=0.0).image_heights().ok)
    behind = make(pinhole_offset=-40.0)
    for image in (behind.image_heights(), behind.ring_widths()):
        assert bool(image.result == ChamberResult.behind_pinhole)
        assert np.all(np.isfinite(image.value))


def test_numbers_beyond_the_float_type_are_reported():
    with jax.enable_x64(False):
        tiny = make(length_bc=1e-25)
        assert bool(tiny.imaging_ratio().result == ChamberResult.out_of_range)
        heights = make(pinhole_offset=-40.0 + 4e-6, reference_height=3e38).image_heights()
        assert bool(heights.result == ChamberResult.out_of_range)
