"""Drawings show the poses that are, where they are, and never one that is not."""

import functools

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from PIL.GifImagePlugin import GifImageFile

from designopt import UserError
from designopt.solution import Solution
from designopt.vectors import rotation, vector
from kinematics import Pose, PoseResult
from kinematics.model.assembled import assembled_joints
from kinematics.plot import animation
from kinematics.plot.animation import save_animation
from kinematics.plot.drawing import draw_pose
from kinematics.plot.label_layout import label_offsets
from kinematics.plot.motion_figures import motion_figure, pose_at
from kinematics.plot.scene import hull, traced_joints
from tests.kinematics.gallery import NAMES, gallery, poses_of


@functools.cache
def solved(name, turn, count=13):
    """Inputs from the sketch's on, the first one in the end ``turn`` farther, and their poses."""
    linkage = gallery(name)
    inputs = np.tile(np.array(linkage.reference.inputs), (count, 1))
    inputs[:, 0] += np.linspace(0, turn, count)
    return linkage, inputs, poses_of(linkage, jnp.asarray(inputs))


def gapped():
    """The inversor over a whole turn: it locks on the way, and comes out again."""
    return solved("peaucellier", 2 * np.pi)


def picked(motion, chosen):
    linkage, inputs, poses = motion
    return linkage, inputs[chosen], jax.tree.map(lambda leaf: leaf[chosen], poses)


def sketched(name, count=3):
    """Poses as sketched: nothing has to be solved for them."""
    linkage = gallery(name)
    structure = linkage.structure
    every, still = np.ones(count), jnp.zeros(count)
    joints = {
        joint: vector(jnp.asarray(np.outer(every, (place.real, place.imag))))
        for joint, place in assembled_joints(linkage).items()
    }
    bodies = {part.name: rotation(still) for part in structure.bodies}
    bodies |= {
        part.name: rotation(still + linkage.home_angle(part.name)) for part in structure.moving
    }
    slides = {index: still + slide for index, slide in enumerate(linkage.reference.slides)}
    good = jax.tree.map(lambda code: jnp.full(count, code), PoseResult.successful)
    inputs = np.outer(every, linkage.reference.inputs)
    return linkage, inputs, Solution(Pose(joints, bodies, slides, {}), still + 1.0, still, good)


def drawn(name, **options):
    linkage, _, poses = sketched(name)
    pose = pose_at(poses, 0)
    axes = Figure().subplots()
    draw_pose(axes, linkage, pose, **options)
    return linkage, pose, axes


def lines(axes, gid):
    return [np.asarray(line.get_xydata()) for line in axes.lines if line.get_gid() == gid]


def position(pose, joint):
    return np.array([float(pose.joints[joint].x), float(pose.joints[joint].y)])


@pytest.mark.parametrize("name", NAMES)
def test_bodies_and_pins_are_at_their_joints(name):
    linkage, pose, axes = drawn(name)
    for body in linkage.structure.moving:
        places = np.array([position(pose, joint) for joint in body.joints])
        line = lines(axes, f"body:{body.name}")[0]
        if len(body.joints) == 2:
            np.testing.assert_array_equal(line, places)
        else:
            # A closed line through joints, around all of them.
            assert all(np.any(np.all(corner == places, axis=1)) for corner in line)
            np.testing.assert_array_equal(line[0], line[-1])
            np.testing.assert_array_equal(np.min(line, axis=0), np.min(places, axis=0))
            np.testing.assert_array_equal(np.max(line, axis=0), np.max(places, axis=0))
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for joint in linkage.structure.joints:
        (place,) = lines(axes, f"joint:{joint}")
        np.testing.assert_array_equal(place[0], position(pose, joint))
        assert left < place[0, 0] < right
        assert low < place[0, 1] < high
    assert axes.get_aspect() == 1
    assert {text.get_text() for text in axes.texts} == set(linkage.structure.joints)


def test_every_sign_has_its_place():
    def count(name, gid):
        axes = drawn(name, labels=False)[2]
        return sum(child.get_gid() == gid for child in axes.get_children())

    assert count("four-bar", "ground") == 2
    assert count("finger", "ground") == 2  # its third fixed joint carries nothing
    assert count("finger", "spring") == 1
    assert count("slider-crank", "track") == count("slider-crank", "block") == 1
    assert count("quick-return", "track") == 1
    assert count("quick-return", "block") == 2
    assert count("quick-return", "slot:lever") == 2


def test_a_slot_covers_the_travel_of_its_pin():
    linkage, _, poses = solved("quick-return", 1.0, 2)
    pose, axes = pose_at(poses, 1), Figure().subplots()
    draw_pose(axes, linkage, pose, travel={0: (10.0, 40.0)})
    slot = lines(axes, "slot:lever")[0]
    pivot, end = position(pose, "O4"), position(pose, "T")
    along = (end - pivot) / np.hypot(*(end - pivot))
    slides = (slot - pivot) @ along
    np.testing.assert_allclose(slot, pivot + slides[:, None] * along, atol=1e-9)
    beyond = 0.04 * float(linkage.size())
    np.testing.assert_allclose(slides, [10 - beyond, 40 + beyond])


def test_a_faint_pose_has_no_names_and_no_pins():
    _, _, axes = drawn("four-bar", faint=True)
    assert not axes.texts
    gids = {line.get_gid() for line in axes.lines}
    assert gids == {f"ghost:{body}" for body in ("crank", "coupler", "rocker")}


def test_what_is_traced_by_itself():
    assert traced_joints(gallery("jansen").structure) == ["J6", "J7"]
    assert traced_joints(gallery("peaucellier").structure) == ["C"]
    assert traced_joints(gallery("four-bar").structure) == ["A", "B"]
    assert traced_joints(gallery("slider-crank").structure) == ["A"]


def test_a_curve_has_a_gap_where_the_pose_fails():
    linkage, inputs, poses = gapped()
    ok = np.asarray(poses.ok)
    assert ok[0]
    assert 0 < ok.sum() < len(ok)
    figure = motion_figure(linkage, inputs, poses, ["C", "P"])
    for joint in ("C", "P"):
        (path,) = lines(figure.axes[0], f"path:{joint}")
        expected = np.asarray(poses.value.position(joint))
        np.testing.assert_array_equal(path[ok], expected[ok])
        assert np.all(np.isnan(path[~ok]))


def test_a_failed_pose_is_no_ghost():
    linkage, inputs, poses = gapped()
    good = np.asarray(poses.value.position("P"))[np.asarray(poses.ok)]
    axes = motion_figure(linkage, inputs, poses, ghosts=30).axes[0]
    ghosts = lines(axes, "ghost:upper-arm")
    assert len(ghosts) == len(good) - 1  # one of them is drawn strong
    assert all(np.any(np.all(ghost[1] == good, axis=1)) for ghost in ghosts)
    (strong, _) = lines(axes, "body:upper-arm")
    np.testing.assert_array_equal(strong[1], good[0])


def test_no_pose_at_all_is_one_clear_message(tmp_path):
    failed = np.flatnonzero(~np.asarray(gapped()[2].ok))
    linkage, inputs, none = picked(gapped(), failed)
    with pytest.raises(UserError, match="no pose of 'Peaucellier inversor' to draw: Two pins"):
        motion_figure(linkage, inputs, none)
    with pytest.raises(UserError, match=r"leg\.gif: no pose of"):
        save_animation(tmp_path / "leg.gif", linkage, inputs, none)
    assert not list(tmp_path.iterdir())


def test_a_gif_has_a_frame_for_every_pose_that_is(tmp_path):
    linkage, inputs, poses = gapped()
    path = tmp_path / "inversor.gif"
    save_animation(path, linkage, inputs, poses, fps=10)
    with Image.open(path) as film:
        assert isinstance(film, GifImageFile)
        assert film.n_frames == int(poses.ok.sum()) < len(inputs)
        assert film.info["duration"] == 100
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_animation_leaves_the_old_file(tmp_path, monkeypatch):
    linkage, inputs, poses = sketched("four-bar")
    path = tmp_path / "four-bar.gif"
    path.write_text("old", encoding="utf-8")
    calls = []

    def interrupted(self, index):
        calls.append(index)
        if len(calls) > 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(animation._Film, "show", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_animation(path, linkage, inputs, poses)
    assert [found.read_text(encoding="utf-8") for found in tmp_path.iterdir()] == ["old"]


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("four-bar.avi", r"ends with \.gif or \.mp4"),
        ("four-bar", r"ends with \.gif or \.mp4"),
        ("four-bar.mp4", "needs ffmpeg.*install it or write a .gif"),
        ("missing/four-bar.gif", "cannot be written"),
    ],
)
def test_what_cannot_be_written_is_said_and_leaves_nothing(tmp_path, file, message):
    linkage, inputs, poses = sketched("four-bar")
    with (
        matplotlib.rc_context({"animation.ffmpeg_path": "no-such-program"}),
        pytest.raises(UserError, match=message),
    ):
        save_animation(tmp_path / file, linkage, inputs, poses)
    assert not list(tmp_path.iterdir())


def test_a_hull_leaves_out_what_is_inside_or_between():
    square = np.array([[0, 0], [2, 0], [1, 1], [2, 2], [0, 2], [1, 0]], float)
    np.testing.assert_array_equal(hull(square), [[0, 0], [2, 0], [2, 2], [0, 2]])
    np.testing.assert_array_equal(hull(np.array([[0.0, 0], [2, 2], [1, 1]])), [[0, 0], [2, 2]])


def test_labels_stand_beside_what_is_drawn():
    places = {"A": np.zeros(2), "B": np.array([40.0, 0.0])}
    bar = np.stack([np.linspace(0, 40, 41), np.zeros(41)], axis=-1)
    offsets = label_offsets([places], [bar], 1.0)
    for name, offset in offsets.items():
        gaps = np.hypot(*(bar - places[name] - offset).T)
        assert gaps.min() > 6
