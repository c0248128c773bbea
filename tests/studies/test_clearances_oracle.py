"""The oracle of clearances against closed forms, and the library's clearances against it."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.io.toml_writing import format_toml
from designopt.vectors import rotation
from kinematics.solve.poses import solve_poses
from studies.models import bare_finger, packaged_finger
from studies.models.finger import Finger, pins_of
from studies.models.finger_file import read_finger, write_finger
from studies.models.linkage_design.clearances import (
    FACES,
    clearances_at,
    find_clearances,
    find_face_meetings,
    find_free_meetings,
    name_of,
)
from studies.models.linkage_design.judging import judged
from studies.models.linkage_design.postures import postures_at
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec
from studies.models.linkage_kinds import SIX_BAR
from studies.models.mirror_design.problem import dorsal_room
from studies.models.pins import pin_name
from studies.oracles.clearances import BARS, PolygonClearances, polygon_clearances

SHELL = 0.7
"""Of the packaged fingers, mm."""


def written(folder: Path, **changes: Any) -> Path:
    """The bare finger's file with some keys of its tables replaced, or with other mirrors."""
    tables = tomllib.loads((files("studies.models") / "bare_finger.toml").read_text())
    for name, change in changes.items():
        tables[name] = change if isinstance(change, list) else tables.get(name, {}) | change
    path = folder / "finger.toml"
    path.write_text(format_toml(tables, "A finger."))
    return path


def measured(folder: Path, **changes: Any) -> PolygonClearances:
    return polygon_clearances(written(folder, **changes), steps=7)


def mirror(phalanx: str, start: list[float], end: list[float], **more: float) -> dict[str, Any]:
    return {"phalanx": phalanx, "from": start, "to": end} | more


def test_neighbours_pads_and_faces_keep_what_the_formula_has(tmp_path):
    """2 (g cos r/2 − y sin r/2) of ends g from an axis and y below it, by one joint alone."""
    given = {"range_deg": [80.0, 95.0], "protrusion": 0.4, "pad_clearance": 0.5}
    found = measured(tmp_path, body=given)
    phalanges = ("proximal", "intermediate", "distal")
    for i, degrees in enumerate(found.degrees):
        half = np.deg2rad(degrees) / 2
        gap = 4.4 * math.tan(half[-1]) + 0.25 / math.cos(half[-1])
        one, other = phalanges[i : i + 2]
        for parts, y in (
            ((f"{one} pad", f"{other} pad"), 4.4),
            (
                (f"palmar face of the {one} phalanx", f"palmar face of the {other} phalanx"),
                4.0,
            ),
        ):
            apart = 2 * (gap * np.cos(half) - y * np.sin(half))
            assert found.apart[parts].shape == ((7, 1), (1, 7))[i]
            np.testing.assert_allclose(found.apart[parts].ravel(), apart, atol=1e-12)
        assert found.apart[f"{one} pad", f"{other} pad"].min() == pytest.approx(0.5)
    # Both joints bent, the outer pads face each other: three sides of a rectangle.
    square = measured(tmp_path).apart["proximal pad", "distal pad"]
    assert square[-1, -1] == pytest.approx(23 - 2 * 4)


def test_a_square_camera_at_a_known_place(tmp_path):
    """6 × 6 mm, 2.5 to 8.5 mm below the dorsal face, between mirrors that are level."""
    camera = {"along": 11.0, "depth": 9.0, "tilt_deg": 0.0, "width": 6.0, "back": 6.5}
    mirrors = [
        mirror("distal", [-1.0, 6.0], [20.0, 6.0], mount=2.0),
        mirror("proximal", [1.0, 9.3], [-25.0, 9.3]),
    ]
    found = measured(tmp_path, camera=camera, mirrors=mirrors)
    np.testing.assert_allclose(found.inside["camera"], 2.5 - SHELL, atol=1e-6)
    straight = {parts: least.flat[0] for parts, least in found.apart.items()}
    assert straight["camera", "distal mirror"] == pytest.approx(23 - 1 - (11 + 3))
    # The mounts, above the glass, reach from 4 to 6 mm and from 8.3 to 9.3 mm below the face.
    assert straight["camera", "proximal mirror"] == pytest.approx(11 - 3 - 1)
    assert straight["distal mirror", "proximal mirror"] == pytest.approx(math.hypot(21, 2.3))
    assert straight["camera", "intermediate pad"] == pytest.approx(25 - 8.5)
    assert straight["proximal mirror", "proximal pad"] == pytest.approx(25 - 9.3)
    # Bent by 90° about PIP, the camera's nearest corner is as far ahead of the axis as it was high.
    bent = found.apart["camera", "proximal mirror"][-1, 0]
    assert bent == pytest.approx(abs(complex(21 - 8.5, -8) - complex(1, 21 - 9.3)))


def test_a_camera_that_stands_out_of_the_back_is_found(tmp_path):
    """By 0.3 mm, and that of the bare finger by what the library has."""
    out = measured(tmp_path, camera={"tilt_deg": 0.0, "depth": 3.7})
    np.testing.assert_allclose(out.inside["camera"], -0.3 - SHELL, atol=1e-6)
    room = float(dorsal_room(bare_finger()))
    np.testing.assert_allclose(measured(tmp_path).inside["camera"], room, atol=1e-6)


def test_a_mirror_that_is_pushed_into_a_pad_is_found(tmp_path):
    """8 mm of it, 0.25 mm deep in a layer 2 mm thick, whose upper side is 23 mm below the back."""
    pads = {"layers": [{"thickness": 2.0, "index": 1.4}]}
    for depth, apart in ((23.25, -math.sqrt(8 * 0.25)), (22.6, 0.4)):
        mirrors = [mirror("distal", [10.0, depth], [18.0, depth])]
        found = measured(tmp_path, pads=pads, mirrors=mirrors)
        np.testing.assert_allclose(found.apart["distal mirror", "distal pad"], apart, rtol=1e-9)


def test_a_mirrors_mount_is_inside_the_section(tmp_path):
    """Level, 3 mm below the back: what a mount of 1 mm leaves, but for the end wall."""
    for far, inside in ((-20.0, 3 - 1 - SHELL), (-34.0, 1 - SHELL), (-35.5, -0.5 - SHELL)):
        found = measured(tmp_path, mirrors=[mirror("proximal", [-5.0, 3.0], [far, 3.0])])
        np.testing.assert_allclose(found.inside["proximal mirror"], inside, atol=1e-6)


BESIDE_BARS = [
    ["pads", "mirrors", "camera"],
    ["proximal", "distal"],
    ["intermediate"],
    ["crank", "plate", "driver"],
    ["rod", "bar", "coupler"],
]
"""Layers in which no axle crosses a bar."""

LOW = {
    "F": [-15.0, 12.7],
    "E": [-16.1, 1.6],
    "D": [13.6, 1.8],
    "C": [21.2, 4.3],
    "G": [7.7, -0.4],
    "G'": [1.9, 11.8],
}
"""Pins of a rod that comes below the axis of PIP, where no axle holds it up."""


def low_rod(folder: Path) -> Finger:
    return read_finger(written(folder, links={"layers": BESIDE_BARS}, pins=LOW))


@pytest.mark.parametrize(
    "made", [lambda _: packaged_finger(), low_rod], ids=["packaged", "low rod"]
)
def test_the_librarys_clearances_are_those_of_polygons(tmp_path, made):
    """In random postures, by the general solver and by the search's; of parts that overlap too."""
    finger, generator = made(tmp_path), np.random.default_rng(3)
    write_finger(finger, tmp_path / "finger.toml")
    pip, dip = np.sort(generator.uniform(0, 90, (2, 9)), axis=1)
    found = polygon_clearances(tmp_path / "finger.toml", degrees=(pip, dip))
    assert found.assembled.all()
    meetings = tuple(dict.fromkeys([*find_free_meetings(finger), *find_face_meetings(finger)]))
    turns = [rotation(-jnp.deg2rad(part)) for part in (pip, dip)]
    postures = jax.jit(postures_at)(finger, *turns)
    by_search = jax.jit(clearances_at, static_argnums=3)(finger, postures, turns[0], meetings)
    square = -jnp.deg2rad(jnp.stack(jnp.meshgrid(pip, dip, indexing="ij"), axis=-1))
    pose = jax.jit(solve_poses)(finger.linkage(), square).value
    places = {name: pose.joints[pin_name(name)] for name in "OABTFEDCGHKMN"}
    by_solver = jax.jit(find_clearances, static_argnums=2)(finger, places, meetings)
    assert sum(one.second in FACES for one in meetings) == 3 * len(("rod", "plate"))
    for one in meetings:
        second = (
            f"palmar face of the {one.second} phalanx"
            if one.second in FACES
            else pin_name(one.second)
        )
        polygons = found.apart[one.first, second]
        # Shapely has no way out of what overlaps: the outlines' roundings there.
        floor = -2.0 - {"A": 2.0, "B": 2.0, "G": 1.0}.get(one.second, 2.0 * (one.second in BARS))
        for ours in (by_search[name_of(one)], by_solver[name_of(one)]):
            ours = np.maximum(np.broadcast_to(ours, polygons.shape), floor)
            np.testing.assert_allclose(ours, polygons, atol=1e-9)


def test_a_rod_that_cuts_the_corner_between_palmar_faces_is_found(tmp_path):
    """All of its pins keep away from the faces beside which they are, and yet it touches one."""
    finger = low_rod(tmp_path)
    asked = {one for one in find_free_meetings(finger) if one.second in FACES}
    assert asked == set(find_face_meetings(finger))
    checks = {check.name: check for check in judged(finger, LimitsSpec(), MotorSpec()).checks}
    assert checks["pin D inside the palmar face"].met
    assert checks["pin E inside the palmar face"].met
    assert not checks["rod from the palmar face of the proximal phalanx"].met
    # In the bare finger the axles hold rod and plate up, as long as they have no room below.
    plain = bare_finger()
    assert not [one for one in find_free_meetings(plain) if one.second in FACES]
    high = replace(plain, body=replace(plain.body, axis_height=jnp.asarray(7.0)))
    assert set(find_face_meetings(high)) < set(find_free_meetings(high))


def test_slopes_are_central_differences(tmp_path):
    """Of the clearances from palmar faces over a pin, and over the height of the axes."""
    finger, step = low_rod(tmp_path), 1e-5
    pins, body = pins_of(finger), finger.body
    meetings = tuple(find_face_meetings(finger))
    pip, dip = (rotation(-jnp.deg2rad(jnp.array(part))) for part in ([20.0, 77.0], [10.0, 64.0]))

    @jax.jit
    def found(at: jax.Array) -> jax.Array:
        moved = replace(pins, D=jnp.stack([at[0], pins.D[1]]))
        made = replace(finger, pins=moved, body=replace(body, axis_height=at[1]))
        clear = clearances_at(made, postures_at(made, pip, dip), pip, meetings)
        return jnp.concatenate([jnp.ravel(clear[name_of(one)]) for one in meetings])

    at = jnp.array([float(pins.D[0]), 4.0])
    slopes = jax.jacfwd(found)(at)
    for i, one in enumerate(step * jnp.eye(2)):
        difference = (found(at + one) - found(at - one)) / (2 * step)
        np.testing.assert_allclose(slopes[:, i], difference, atol=1e-7)


def test_every_bar_is_measured_from_every_palmar_face(tmp_path):
    found = measured(tmp_path)
    faces = [f"palmar face of the {phalanx} phalanx" for phalanx in FACES]
    assert {pair for pair in found.apart if pair[1] in faces and pair[0] in BARS} == {
        (bar, face) for bar in SIX_BAR.outlines for face in faces
    }
    # Beside the phalanges that carry all of their pins, bars keep as much as these pins.
    assert found.apart["crank", faces[0]].min() == pytest.approx(4 - 0.78 - 2 - SHELL)
    assert found.apart["bar", faces[1]].min() == pytest.approx(4 - 0.78 - 2 - SHELL)
