"""The parts of a finger: by the CAD kernel, by polygons, and by a path tracer's rays."""

from __future__ import annotations

import dataclasses
import math
import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from ezdxf.entities.arc import Arc
from ezdxf.entities.lwpolyline import LWPolyline

from designopt import UserError
from designopt.export.drawing import Polyline
from designopt.export.parts import Part, Prism, around
from studies.finger.drawing import make_finger_drawing
from studies.models.finger_file import write_finger
from studies.models.finger_parts import FingerMirror
from studies.models.linkage_kinds import KINDS
from studies.models.manufacture.parts import make_assembly, make_parts
from studies.models.manufacture.plates import make_plates
from studies.models.manufacture.section import Section
from studies.oracles.clearances import postures
from tests.designopt.export.reading import opened
from tests.studies.fingers import finger_of_kind


@pytest.fixture(scope="module", params=[*KINDS])
def finger(request):
    return finger_of_kind(request.param)


@pytest.fixture(scope="module")
def parts(finger):
    return make_parts(finger)


@pytest.fixture(scope="module")
def written(finger, parts, tmp_path_factory):
    """The STEP file as the kernel reads it back, and the files themselves."""
    pytest.importorskip("OCP")
    from designopt.export.solids import step_text
    from studies.oracles.solids import read_solids

    folder = tmp_path_factory.mktemp("parts")
    (folder / "finger.step").write_text(step_text("finger", parts), encoding="utf-8")
    write_finger(finger, folder / "finger.toml")
    return read_solids(folder / "finger.step"), folder


def polygon(outline):
    return shapely.Polygon(outline.line(1e-4))


def test_bars_are_what_lies_within_half_their_width_of_their_pins(finger):
    plates, pins = {plate.name: plate for plate in make_plates(finger)}, Section.of(finger).pins
    half = float(finger.links.bar_width) / 2
    for bar, names in finger.links.kind.outlines.items():
        places = [pins[name] for name in names]
        wanted = shapely.MultiPoint(places).convex_hull.buffer(half, quad_segs=1000)
        assert polygon(plates[bar].outline).symmetric_difference(wanted).area < 1e-3
        assert [hole.center for hole in plates[bar].holes] == places
        assert {hole.radius for hole in plates[bar].holes} == {float(finger.links.pin_diameter) / 2}


def test_walls_have_room_for_their_holes(finger):
    for plate in make_plates(finger):
        inside = polygon(plate.outline)
        for hole in plate.holes:
            ring = float(finger.links.shell) if "wall" in plate.name else 1.25
            assert inside.buffer(1e-3).contains(
                shapely.Point(hole.center).buffer(hole.radius + ring)
            )


def test_every_outline_of_the_drawing_is_closed_with_its_holes(finger):
    space = opened(make_finger_drawing(finger)).modelspace()
    section = Section.of(finger)
    for plate in make_plates(finger):
        (line,) = space.query(f"LWPOLYLINE[layer=='{plate.name}']")
        assert isinstance(line, LWPolyline)
        assert line.closed
        circles = space.query(f"CIRCLE[layer=='{plate.name}']")
        found = sorted((*map(float, one.dxf.center.vec2), one.dxf.radius) for one in circles)
        wanted = sorted((*hole.center, hole.radius) for hole in plate.holes)
        np.testing.assert_allclose(np.reshape(found, (-1, 3)), np.reshape(wanted, (-1, 3)))
        # The area that ezdxf's own arcs enclose.
        edges = [
            [*edge.flattening(1e-4)] if isinstance(edge, Arc) else [edge.dxf.start, edge.dxf.end]
            for edge in line.virtual_entities()
        ]
        drawn = shapely.MultiLineString([[(at.x, at.y) for at in edge] for edge in edges])
        (area,) = shapely.polygonize([shapely.set_precision(drawn, 1e-6)]).geoms
        assert area.area == pytest.approx(plate.outline.area, rel=1e-4)
    assert {*finger.links.kind.outlines} < {plate.name for plate in make_plates(finger)}
    assert section.axle == float(finger.links.axle_diameter) / 2


def test_the_bill_counts_pieces_that_are_there(finger, parts):
    assembly = make_assembly(finger)
    rows = {row.item: row for row in assembly.bill()}
    assert sum(row.pieces for row in rows.values()) == len(parts) + sum(
        row.pieces for row in assembly.others
    )
    assert all(rows[bar].pieces == 2 for bar in finger.links.kind.outlines)
    pins = {"six-bar": 18, "coupled": 10}[finger.links.kind.name]
    assert sum(row.pieces for item, row in rows.items() if item.startswith("pins")) == pins
    assert assembly.spans[-1].high == float(finger.links.width) / 2
    springs = [row.size for row in assembly.others if "spring" in row.item]
    assert len(springs) == len(finger.links.kind.springs)
    assert all(f"{float(finger.spring.stiffness):g} N mm/rad" in size for size in springs)
    direct = dataclasses.replace(finger, motor=None)
    motor = next(row for row in make_assembly(direct).others if "motor" in row.item)
    shaft = {"six-bar": "crank on its shaft F", "coupled": "intermediate phalanx on its shaft A"}
    assert motor.size == shaft[finger.links.kind.name]


def test_a_finger_without_links_has_no_parts(finger):
    with pytest.raises(UserError, match=r"add \[links\]"):
        make_parts(dataclasses.replace(finger, links=None))
    layers = finger.links.layers
    turned = dataclasses.replace(finger.links, layers=(layers[1], layers[0], *layers[2:]))
    with pytest.raises(UserError, match="correct 'layers'"):
        make_parts(dataclasses.replace(finger, links=turned))


def test_bare_pads_and_few_mirrors_have_parts_too(finger):
    bare = dataclasses.replace(finger, layers=None, mirrors=finger.mirrors[:1])
    names = [part.name for part in make_parts(bare)]
    assert not [name for name in names if "layer" in name]
    assert [name for name in names if name.endswith("mirror")] == ["distal mirror"]
    blind = dataclasses.replace(finger, camera=None, mirrors=())
    assert "camera" not in [part.item for part in make_parts(blind)]


@pytest.mark.parametrize("phalanx", ["proximal", "distal"])
def test_the_camera_and_its_seat_are_where_it_is(finger, phalanx):
    pytest.importorskip("OCP")
    from designopt.export.solids import make_solid
    from studies.oracles.solids import shared_volume, volume_of

    along = jnp.asarray(16.0 if phalanx == "distal" else -16.0)
    camera = dataclasses.replace(finger.camera, phalanx=phalanx, along=along)
    middle = FingerMirror(jnp.array([[4.0, 4.0], [19.0, 6.0]]), "intermediate")
    moved = dataclasses.replace(finger, camera=camera, mirrors=(middle,))
    found = {part.name: part for part in make_parts(moved)}
    body = found[f"{phalanx} camera"]
    assert body.body == phalanx
    # It lies in its pocket: moved across it would run into its bridge, as deep as that is.
    host, camera_solid = make_solid(found[f"{phalanx} phalanx"]), make_solid(body)
    assert shared_volume(host, camera_solid) == pytest.approx(0.0, abs=1e-6)
    wide = Prism(body.prisms[0].outline, (-5.0, 5.0))
    wider = make_solid(body._replace(prisms=(wide,)))
    pocket = 2 * (5.0 - 4.0 - float(finger.links.play)) * body.prisms[0].outline.area
    assert shared_volume(host, wider) == pytest.approx(pocket, rel=1e-6)
    glass = make_solid(found["intermediate mirror"])
    ribs = make_solid(found["intermediate phalanx"])
    assert shared_volume(ribs, glass) == pytest.approx(0.0, abs=1e-6)
    with_out = make_parts(dataclasses.replace(moved, mirrors=()))
    bare = make_solid(next(part for part in with_out if part.name == "intermediate phalanx"))
    assert volume_of(ribs) > volume_of(bare) + 10


def test_solids_come_back_whole(parts, written):
    from designopt.export.solids import make_solid
    from studies.oracles.solids import is_watertight, volume_of

    solids, _ = written
    assert [*solids] == [part.name for part in parts]
    for part in parts:
        solid = solids[part.name]
        assert is_watertight(solid), part.name
        assert volume_of(solid) == pytest.approx(volume_of(make_solid(part)), rel=1e-6)
        if len(part.prisms) == 1 and not part.cuts:
            assert volume_of(solid) == pytest.approx(part.prisms[0].volume, rel=1e-6)


def test_shells_are_what_their_prisms_cover(parts, written):
    """Volumes by counting random points in the polygons of the prisms."""
    from studies.oracles.solids import volume_of

    solids, _ = written
    generator = np.random.default_rng(5)
    for part in parts[:3]:
        low = np.array([*np.min([p for q in part.prisms for p in q.outline.places], axis=0)])
        high = np.array([*np.max([p for q in part.prisms for p in q.outline.places], axis=0)])
        reach = max(prism.across[1] for prism in part.prisms)
        points = generator.uniform([*low, -reach], [*high, reach], (400_000, 3))

        def covered(prisms, points=points):
            inside = np.zeros(len(points), bool)
            for prism in prisms:
                holes = [shapely.Point(hole.center).buffer(hole.radius, 64) for hole in prism.holes]
                area = polygon(prism.outline).difference(shapely.unary_union(holes))
                between = (points[:, 2] > prism.across[0]) & (points[:, 2] < prism.across[1])
                inside |= between & shapely.contains_xy(area, *points[:, :2].T)
            return inside

        share = np.mean(covered(part.prisms) & ~covered(part.cuts))
        box = float(np.prod(high - low)) * 2 * reach
        error = 4 * box * math.sqrt(share * (1 - share) / len(points))
        assert volume_of(solids[part.name]) == pytest.approx(share * box, abs=error)


def test_walls_are_as_thick_as_they_should_be(finger, written):
    from studies.oracles.solids import least_wall

    solids, _ = written
    shell = float(finger.links.shell)
    for name in ("proximal phalanx", "intermediate phalanx", "distal phalanx"):
        assert least_wall(solids[name], 4.0).thickness >= shell - 1e-6
    ring = float(finger.links.bar_width - finger.links.pin_diameter) / 2
    bar = next(iter(finger.links.kind.outlines))
    layer = float(finger.links.thickness[finger.links.layer_of(bar)])
    assert least_wall(solids[f"{bar}, right"], 0.5).thickness == pytest.approx(
        min(ring, layer), abs=1e-3
    )


def test_nothing_meets_in_any_posture(finger, written):
    from studies.oracles.solids import find_meetings

    solids, folder = written
    steps, just = {"six-bar": (4, 0.6), "coupled": (7, 1.0)}[finger.links.kind.name]
    meetings = find_meetings(solids, folder / "finger.toml", steps=steps)
    assert max(one.shared for one in meetings) < 1e-3
    moving = {one.parts: one.distance for one in meetings if one.postures > 1}
    assert min(moving.values()) > 0.05
    # The linkage's clearances by the kernel are those that the design keeps.
    bars = [
        distance
        for (one, other), distance in moving.items()
        if any(part.split(",")[0] in finger.links.kind.outlines for part in (one, other))
        and not any(part.startswith("pin") for part in (one, other))
    ]
    assert 0.5 <= min(bars) < just


@pytest.mark.parametrize("axis_height", [3.0, 3.5, 4.0, 5.0])
def test_cheeks_leave_the_ledges_beside_them_room_at_any_height_of_the_axes(axis_height):
    """The lower the axes, the farther out the cheek's edge is as low as the ledge."""
    pytest.importorskip("OCP")
    from designopt.export.solids import make_solid
    from studies.oracles.solids import distance

    finger = finger_of_kind("six-bar")
    body = dataclasses.replace(finger.body, axis_height=jnp.asarray(axis_height))
    parts = make_assembly(dataclasses.replace(finger, body=body)).parts
    shells = {part.body: make_solid(part) for part in parts if part.shell}
    for outer in ("proximal", "distal"):
        assert distance(shells[outer], shells["intermediate"]) > 0.19


def test_a_part_in_the_way_is_found(finger, written, parts):
    from designopt.export.solids import make_solid
    from studies.oracles.solids import find_meetings

    solids, folder = written
    bar, pins = next(iter(finger.links.kind.outlines.items()))
    x, y = Section.of(finger).pins[pins[1]]
    corners = (x - 1, y - 1, 0), (x + 1, y - 1, 0), (x + 1, y + 1, 0), (x - 1, y + 1, 0)
    across = next(part for part in parts if part.name == f"{bar}, right").prisms[0].across
    brick = Part("intermediate brick", "b", "b", "", "", (Prism(around(*corners), across),))
    more = {**solids, brick.name: make_solid(brick)}
    (meeting,) = find_meetings(
        more, folder / "finger.toml", steps=3, pairs=[(f"{bar}, right", brick.name)]
    )
    assert meeting.distance == 0.0
    assert meeting.shared > 0.5


def test_coverage_among_the_solids_is_that_of_the_section(finger, written):
    pytest.importorskip("mitsuba")
    from designopt.export.solids import step_text
    from studies.oracles.solid_faces import solid_faces
    from studies.oracles.traced_coverage import traced_coverage

    _, folder = written
    path = folder / "finger.toml"
    degrees = np.array([[0.0, 0.0], [45.0, 20.0], [90.0, 90.0]])
    if finger.links.kind.freedoms == 1:
        degrees = np.array(postures(tomllib.loads(path.read_text(encoding="utf-8")), 3))
    section = traced_coverage(path, degrees)
    solids = traced_coverage(path, degrees, solid_faces(folder / "finger.step", path))
    np.testing.assert_allclose(solids, section, atol=1e-5)
    # A block before the camera hides something, so the solids are in light's way.
    camera = finger.camera.at(finger.body)
    x, y = (float(value) for value in camera.position)
    corners = (x - 1, y - 3, 0), (x + 1, y - 3, 0), (x + 1, y - 2, 0), (x - 1, y - 2, 0)
    block = Part("intermediate block", "b", "b", "", "", (Prism(around(*corners), (-5, 5)),))
    more = folder / "blocked.step"
    more.write_text(step_text("finger", [*make_parts(finger), block]), encoding="utf-8")
    blocked = traced_coverage(path, degrees[:1], solid_faces(more, path))
    assert np.min(blocked) < 0.9


def test_parts_follow_the_finger(finger):
    longer = dataclasses.replace(
        finger, body=dataclasses.replace(finger.body, thickness=jnp.asarray(27.0))
    )
    for one, wanted in ((finger, 25.0), (longer, 27.0)):
        places = [p for part in make_parts(one)[:3] for q in part.prisms for p in q.outline.places]
        assert max(y for _, y in places) - min(y for _, y in places) == pytest.approx(wanted)


def test_lines_with_arcs_are_as_large_as_their_arcs():
    line = Polyline("bar", [(0.0, 0.0), (0.0, 2.0)], True, [1.0, 0.0])
    across, up = zip(*line.line(), strict=True)
    assert (max(across), min(up)) == pytest.approx((1.0, 0.0))
