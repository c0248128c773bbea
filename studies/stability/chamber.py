"""Stiff and extreme chambers and lenses, judged against Eqs. 1-3 in 50 digits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Array, ArrayLike

from designopt.solution import Solution
from designopt.study.stability import Family
from optics.chamber.chamber import Chamber
from optics.chamber.ratio import Dimension, solve_dimension_for_ratio
from optics.scene.thin_lens import ThinLens
from studies.oracles import chamber as exact

NOMINAL = {
    "length_ab": 40.0,
    "length_bc": 30.0,
    "length_cd": 30.0,
    "offset_b": 2.0,
    "wall_angle_bc": np.deg2rad(2.0),
    "offset_d": 2.55,
    "reference_height": 8.616,
    "pinhole_offset": 0.844,
}
"""Table I's chamber at η = 0.6 with the identified constants, rounded: what is not extreme."""

LENS = {"focal_length": 4.0, "aperture": 1.4, "sensor_distance": 4.3}

CASES = 40
"""Cases in every family; even, and the same for all, so that they share compiled programs."""

Inputs = dict[str, np.ndarray]


def nominal() -> Family:
    """Table I's own chamber: nothing is extreme, and its gradients are checked all the same."""
    return _of_ratio(
        "η, Δl_D over the range of Table I", {"offset_d": np.linspace(1.29, 7.59, CASES)}
    )


def families(seed: int) -> Iterator[Family]:
    """Every extreme family; ``seed`` draws the mixed magnitudes."""
    small = 10.0 ** np.linspace(0, -12, CASES)
    steep = np.deg2rad(90 - 10.0 ** np.linspace(1.9, -3, CASES))
    ratios = 10.0 ** np.linspace(-6, 6, CASES)

    # η itself does not depend on f and v; the ring widths do.
    yield Family(
        "Δd_c, f − v from 1 to 1e-12 mm",
        _inputs({"focal_length": 4.0, "image_distance": 4.0 - small}),
        _yellow_width,
        exact.yellow_width,
        lambda focal_length, image_distance, **chamber: exact.margin(**chamber),
    )
    yield _of_ratio("η, θ_BC from 11° to 89.999°", {"wall_angle_bc": steep})
    yield _of_ratio("η, θ_BC from −89.999° to −11°", {"wall_angle_bc": -steep})
    yield _of_angle("η from θ_CD of 11° to 89.999°", steep)
    yield _of_ratio("η, lengths and offsets from 1e-6 to 1e6 mm", _mixed_lengths(seed))
    yield _inverse("Δl_D from η of 1e-6 to 1e6", "offset_d", ratios)
    yield _inverse("δ from η of 1e-6 to 1e6", "pinhole_offset", ratios)
    half = 10.0 ** np.linspace(0, -12, CASES // 2)
    steps = np.concatenate([half, -half[:-1], [0.0]])
    for name, depth in (("s_B", 40.0), ("s_C", 70.0), ("s_D", 100.0)):
        yield _of_ratio(f"η, δ → −{name} from both sides", {"pinhole_offset": steps - depth})
    distances = np.concatenate([10.0 ** np.linspace(-6, 12, CASES - 1), [LENS["focal_length"]]])
    yield Family(
        "lens blur, u from 1e-6 to 1e12 mm",
        _broadcast(LENS | {"distance": distances}),
        _lens_blur,
        lambda distance, focal_length, aperture, sensor_distance: (
            aperture * abs(sensor_distance * (1 / focal_length - 1 / distance) - 1)
        ),
        lambda distance, **lens: distance,
    )


def _chamber(**given: ArrayLike) -> Chamber:
    # η depends neither on Δl_A nor, where they are not given, on f and v.
    return Chamber(**({"offset_a": 4.1, "focal_length": 4.0, "image_distance": 3.5} | given))


def _of_ratio(case: str, varied: dict[str, Any]) -> Family:
    return Family(case, _inputs(varied), _imaging_ratio, exact.imaging_ratio, exact.margin)


def _of_angle(case: str, angles: np.ndarray) -> Family:
    def solve(wall_angle_cd: Array, **given: Array) -> Solution[Array]:
        return _chamber(offset_d=0.0, **given).with_wall_angle_cd(wall_angle_cd).imaging_ratio()

    def value(wall_angle_cd: Any, **given: Any) -> Any:
        offset_d = exact.offset_d_from_angle(wall_angle_cd, **given)
        return exact.imaging_ratio(offset_d=offset_d, **given)

    inputs = _inputs({"wall_angle_cd": angles}, without="offset_d")
    return Family(case, inputs, solve, value, lambda wall_angle_cd, **given: exact.margin(**given))


def _inverse(case: str, dimension: Dimension, ratios: np.ndarray) -> Family:
    # The dimension's own value only chooses between two answers: it is no input.
    def solve(ratio: Array, **given: Array) -> Solution[Array]:
        sketch = _chamber(**given, **{dimension: NOMINAL[dimension]})
        return solve_dimension_for_ratio(sketch, dimension, ratio)

    def roots(given: dict[str, Any]) -> list[Any]:
        return exact.dimension_roots(dimension, sketch=NOMINAL[dimension], **given)

    def margin(ratio: Any, **given: Any) -> Any:
        found = roots({"ratio": ratio, **given})
        return exact.margin(**given, **{dimension: found[0]}) if found else -1

    inputs = _inputs({"ratio": ratios}, without=dimension)
    return Family(case, inputs, solve, lambda **given: roots(given)[0], margin)


def _imaging_ratio(**given: Array) -> Solution[Array]:
    return _chamber(**given).imaging_ratio()


def _yellow_width(**given: Array) -> Solution[Array]:
    rings = _chamber(**given).ring_widths()
    return Solution(rings.value[1], rings.margin, rings.residual, rings.result)


def _lens_blur(distance: Array, **lens: Array) -> Solution[Array]:
    image = ThinLens(**lens).image(distance)
    return Solution(image.value.blur_diameter, image.margin, image.residual, image.result)


def _mixed_lengths(seed: int) -> dict[str, Any]:
    names = [name for name in NOMINAL if name != "wall_angle_bc"]
    random = np.random.default_rng(seed)
    drawn = random.uniform(-6, 6, size=(CASES - 2, len(names)))
    ends = np.repeat([[-6.0], [6.0]], len(names), axis=1)
    inputs = dict(zip(names, 10.0 ** np.concatenate([drawn, ends]).T, strict=True))
    for name in ("offset_b", "offset_d", "reference_height"):
        inputs[name] *= random.choice([-1, 1], CASES)
    return inputs


def _inputs(varied: dict[str, Any], *, without: str = "") -> Inputs:
    given = {name: value for name, value in NOMINAL.items() if name != without}
    return _broadcast(given | varied)


def _broadcast(inputs: dict[str, Any]) -> Inputs:
    return dict(zip(inputs, np.broadcast_arrays(*inputs.values()), strict=True))
