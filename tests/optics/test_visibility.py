"""Exact visibility against closed forms, and what it says where nothing is seen."""

from collections.abc import Iterable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics.scene.reading import parse_scene
from optics.scene.scene import Scene
from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import label_of
from optics.visibility.coverage import find_coverage, find_views
from optics.visibility.views import ViewResult
from tests.optics.scenes import (
    BOTH,
    DIRECT,
    LAYOUT,
    PADS,
    PIXELS,
    WORDS,
    Answers,
    Case,
    answers,
    batch_of,
    case_of,
    item,
    random_cases,
    scene_of,
)

ROUNDING = 1e-13
"""A few units of rounding of what is of order one."""

OPEN, AWAY = 2 * np.pi, np.pi / 2
DOWN = -np.pi / 2


def answer_of(case: Case) -> Answers:
    return item(answers(batch_of([case])), 0)


def pieces(answer: Answers, path: Iterable[int] = (), pad: int = BOTH) -> list[int]:
    """Indices of the pieces of a pad that are seen by a path."""
    found = answer.pieces
    here = found.present[pad] & (found.path[pad] == WORDS.index(tuple(path)))
    return np.flatnonzero(here).tolist()


def extent(answer: Answers, path: Iterable[int] = (), pad: int = BOTH) -> list[float]:
    """Where the pieces of a pad begin and end."""
    found = answer.pieces
    return [
        float(end[pad, i]) for i in pieces(answer, path, pad) for end in (found.start, found.end)
    ]


def labels(answer: Answers, path: Iterable[int] = (), pad: int = BOTH) -> list[int]:
    found = answer.pieces
    return [
        int(label[pad, i])
        for i in pieces(answer, path, pad)
        for label in (found.start_label, found.end_label)
    ]


def message(answer: Answers, path: Iterable[int] = (), pad: int = BOTH) -> str:
    return answer.messages[WORDS.index(tuple(path)) * PADS + pad]


def test_one_sees_nothing_of_a_plane_that_one_is_in():
    answer = answer_of(case_of((-100, 1.6), pads={"both": [[-100, 0], [-100, 1.7]]}))
    assert not extent(answer)
    assert message(answer) == ViewResult[ViewResult.behind_pad]


def test_a_mirror_is_a_window():
    # From (0, 5) over a mirror from (−1, 0) to (1, 0) one sees −3 … 3 of a wall at y = 10.
    answer = answer_of(
        case_of(
            (0, 5), DOWN, mirrors={"both": [[-1, 0], [1, 0]]}, pads={"both": [[-10, 10], [10, 10]]}
        )
    )
    np.testing.assert_allclose(extent(answer, [BOTH]), [0.35, 0.65], rtol=ROUNDING)
    assert labels(answer, [BOTH]) == [
        label_of(0, BOTH, codes.FIRST_END),
        label_of(0, BOTH, codes.SECOND_END),
    ]
    (i,) = pieces(answer, [BOTH])
    np.testing.assert_allclose(answer.pieces.distance[BOTH, i], np.hypot(3, 15), rtol=ROUNDING)
    np.testing.assert_allclose(answer.pieces.spans[BOTH, i], [[0, 1], [0, 0]], atol=ROUNDING)
    # Looking down at the mirror, x = −1 is clockwise from the axis.
    angle = np.arctan2(3, 15) * PIXELS / np.pi
    np.testing.assert_allclose(
        answer.pieces.pixels[BOTH, i], PIXELS / 2 + np.array([angle, -angle]), rtol=ROUNDING
    )
    sharpness = PIXELS / np.pi * 15 / (3**2 + 15**2)
    np.testing.assert_allclose(answer.pieces.px_per_mm[BOTH, i], sharpness, rtol=ROUNDING)


DEGREES = np.array([1, 5, 30, 90, 150, 157.5, 179, 180, 181, 200, 202.5, 210, 270, 300, 359, 360])


@pytest.mark.parametrize(("turn", "name"), [(DOWN, "to"), (0.0, "beside"), (AWAY, "away")])
def test_fields_of_view_from_one_degree_to_all_round(turn, name):
    # From a height of 1, a place s of the pad is seen at arctan s from straight down.
    pad, half = 5.0, np.radians(DEGREES) / 2
    views = [
        case_of((0, 1), turn, 2 * angle, pads={"both": [[-pad, 0], [pad, 0]]}) for angle in half
    ]
    answer, steepest = answers(batch_of(views)), np.arctan(pad)
    inward = np.clip(np.pi - half, 0, steepest)  # of what lies behind the camera
    seen = {
        "to": 2 * np.tan(np.clip(half, 0, steepest)),
        "beside": pad - np.tan(np.clip(np.pi / 2 - half, -steepest, steepest)),
        "away": 2 * (pad - np.tan(inward)),
    }[name]
    coverage = answer.numbers["coverage"][:, BOTH]
    np.testing.assert_allclose(coverage, seen / (2 * pad), atol=ROUNDING)
    known = seen > ROUNDING
    np.testing.assert_array_equal(answer.ok[:, DIRECT, BOTH], known)
    widest = {
        "to": 2 * np.minimum(half, steepest),
        "beside": steepest - np.maximum(np.pi / 2 - half, -steepest),
        "away": steepest - (np.pi - half),  # in two pieces
    }[name]
    margin = answer.views.margin[:, DIRECT, BOTH]
    np.testing.assert_allclose(margin[known], widest[known], atol=ROUNDING)
    assert (margin[~known] < ROUNDING).all()


def test_all_round_a_view_across_the_seam_is_one_piece():
    answer = answer_of(case_of((0, 1), AWAY, OPEN, pads={"both": [[-5, 0], [5, 0]]}))
    assert extent(answer) == [0, 1]
    (i,) = pieces(answer)
    first, last = answer.pieces.pixels[BOTH, i]
    angle = PIXELS * 2 * np.arctan(5) / OPEN
    np.testing.assert_allclose(first - last, angle, rtol=ROUNDING)


def test_ends_of_a_view_name_the_limits_of_the_field_of_view_and_of_grazing():
    narrow = case_of((0, 1), DOWN, 1.0, pads={"both": [[-4, 0], [4, 0]]})
    assert labels(answer_of(narrow)) == [codes.RIGHT_LIMIT, codes.LEFT_LIMIT]
    flat = case_of((0, 1), DOWN, OPEN, pads={"both": [[-4, 0], [4, 0]]}, grazing=np.pi / 6)
    assert labels(answer_of(flat)) == [codes.LOW_GRAZING, codes.HIGH_GRAZING]
    wide = case_of((0, 1), AWAY, 6.0, pads={"both": [[-4, 0], [4, 0]]})
    assert labels(answer_of(wide)) == [
        codes.FIRST_PAD_END,
        codes.LEFT_LIMIT,
        codes.RIGHT_LIMIT,
        codes.SECOND_PAD_END,
    ]


@pytest.mark.parametrize(
    ("side", "up", "works"),
    [
        ("left", 1, True),
        ("left", -1, False),
        ("right", 1, False),
        ("right", -1, True),
        ("both", 1, True),
        ("both", -1, True),
    ],
)
def test_surfaces_work_on_their_side(side, up, works):
    """Pads sense, mirrors reflect and blockers hide; from above or below a surface."""
    index, flat = ["left", "both", "right"].index(side), [[-3, 0], [3, 0]]
    beside, beyond = [[1, up], [2, up]], [[-1, -2 * up], [1, -2 * up]]
    blocker = {"wall" if side == "both" else side: flat}
    found = answers(
        batch_of(
            [
                case_of((0, up), 0.0, OPEN, pads={side: flat}),
                case_of((0, up), 0.0, OPEN, mirrors={side: flat}, pads={"both": beside}),
                case_of((0, 2 * up), 0.0, OPEN, pads={"both": beyond}, blockers=blocker),
            ]
        )
    )
    sensed, reflected, hidden = (item(found, i) for i in range(3))
    for answer, path, pad, seen, reason in (
        (sensed, (), index, works, ViewResult.behind_pad),
        (reflected, (index,), BOTH, works, ViewResult.behind_mirror),
        (hidden, (), BOTH, not works, ViewResult.blocked),
    ):
        np.testing.assert_allclose(extent(answer, path, pad), [0, 1] if seen else [], atol=ROUNDING)
        assert message(answer, path, pad) == ("" if seen else ViewResult[reason])
        assert (answer.views.margin[WORDS.index(path), pad] > 0) == seen


def test_a_view_that_nothing_lets_through_is_missed():
    answer = answer_of(case_of((0, 1), AWAY, 1.0, pads={"both": [[-1, 0], [1, 0]]}))
    assert message(answer) == ViewResult[ViewResult.missed]
    # The line of sight to the middle of the pad is half a turn from the axis.
    assert answer.views.margin[DIRECT, BOTH] < 0


def small_scene(blockers: int = 1) -> Scene:
    """A camera above a pad whose middle is hidden; without mirrors and joints."""
    camera = {"position": [0, 5], "direction_deg": -90, "fov_deg": 180, "pixels": 1000}
    pad = {"name": "pad", "from": [-5, 0], "to": [5, 0]}
    walls = [{"name": f"wall {i}", "from": [-1, 3], "to": [1, 3]} for i in range(blockers)]
    scene = {"bounces": 2}
    return parse_scene({"camera": camera, "pads": [pad], "blockers": walls, "scene": scene})


def test_a_scene_without_mirrors_and_joints():
    views = find_views(small_scene(), jnp.zeros(0))
    assert views.margin.shape == (1, 1)
    np.testing.assert_allclose(views.value.coverage(), [0.5], rtol=ROUNDING)
    assert views.value.spans.shape[-2:] == (0, 2)


def test_more_pieces_than_room_are_reported():
    views = find_views(small_scene(), jnp.zeros(0), max_pieces=1)
    assert views.messages() == [ViewResult[ViewResult.too_many]]
    np.testing.assert_allclose(views.value.coverage(), [0.25], rtol=ROUNDING)
    enough = eqx.tree_at(lambda s: s.blockers, small_scene(), replace_fn=lambda ends: ends + 3.0)
    assert find_views(enough, jnp.zeros(0), max_pieces=1).messages() == [""]


@pytest.mark.parametrize(
    ("max_pieces", "covered", "free"), [(1, 0.25, 0), (2, 0.5, 1), (3, 0.5, 2)]
)
def test_coverage_alone_tells_how_many_more_pieces_it_could_hold(max_pieces, covered, free):
    found = find_coverage(small_scene(), jnp.zeros(0), max_pieces=max_pieces)
    np.testing.assert_allclose(found.value, [covered], rtol=ROUNDING)
    np.testing.assert_array_equal(found.margin, [free])
    assert found.messages() == ["" if free > 0 else ViewResult[ViewResult.too_many]]


@pytest.mark.parametrize("wrong", [{"bounces": -1}, {"max_pieces": 0}])
@pytest.mark.parametrize("find", [find_views, find_coverage])
def test_numbers_that_make_no_sense_are_refused(find, wrong):
    with pytest.raises(ValueError, match="bounces must be 0 or more, and max_pieces 1 or more"):
        find(small_scene(), jnp.zeros(0), **wrong)


def test_a_scene_without_blockers_has_views_of_all_shapes():
    views = jax.eval_shape(lambda: find_views(small_scene(blockers=0), jnp.zeros((2, 3, 0))))
    assert views.margin.shape == (2, 3, 1, 1)
    assert views.value.start.shape[:-1] == (2, 3, 1)


def test_curved_mirrors_are_refused_by_name():
    scene = scene_of(item(random_cases(0, 1), 0))
    curved = replace(scene, layout=replace(LAYOUT, curved=(0, 2)))
    for find, name in ((find_views, "find_views"), (find_coverage, "find_coverage")):
        said = f"{name}: mirrors left, right are curved; use trace_views"
        with pytest.raises(ValueError, match=said):
            find(curved, jnp.zeros(2))


@pytest.mark.parametrize("far", [10.0, 1e5])
def test_the_least_grazing_angle_in_single_precision(far):
    # Whatever else is in the scene, and however far: the pad is seen as far as h / tan(grazing)
    # from the foot of the camera's height h.
    height, grazing = 0.1, 1.0
    reach = height / np.tan(grazing)
    with jax.enable_x64(False):
        camera = {"position": [0, height], "direction_deg": -90, "fov_deg": 172, "pixels": 100}
        least = {"min_grazing_deg": np.degrees(grazing)}
        pad = {"name": "pad", "from": [-0.5, 0], "to": [0.5, 0], **least}
        wall = {"name": "far", "from": [-10, 3], "to": [-2 * far, 3]}
        scene = parse_scene({"camera": camera, "pads": [pad], "blockers": [wall]})
        pieces = find_views(scene, jnp.zeros(0)).value
        assert pieces.start.dtype == jnp.float32
        found = [float(pieces.start[0, 0]), float(pieces.end[0, 0])]
    assert found == pytest.approx([0.5 - reach, 0.5 + reach], abs=1e-5)
