"""``designopt render``: pictures against places that are projected by hand, and what is refused."""

import csv
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from designopt.cli import run
from designopt.errors import UserError
from optics import Fabrication, Imaging, find_corners_in_space, perturb, read_scene
from optics.rendering import Renderer
from optics.rendering.imprints import SMOOTHING
from studies.commands.trial_pictures import Asked, poses_of, shots_of
from studies.models import packaged_finger, write_finger
from studies.models.sensor.imaged import Imaged, read_imaged, width_of
from studies.models.sensor.made import carried_by_camera, deviations_of, sample_finger
from studies.models.sensor.spec import MadeSpec
from tests.commands import check_command_refused, refused_cases
from tests.helpers import SCENES

ROWS, COLUMNS = 480, 640
CLEAN = ("--light", "even", "--noise", "0", "--blur", "0", "--rows", str(ROWS))

CAMERA, AHEAD, FIELD = 15.75 + 16.99j, np.exp(1j * np.deg2rad(-96.3)), np.deg2rad(160)
"""Of the gallery's finger, as its file has them."""

BALLS = {"distal": (13.0, 4.0, 6.0), "intermediate": (5.0, -3.0, 5.0)}
"""Along, across and diameter of what is pressed in, mm."""

STARTS = {"distal": 27 - 4j, "intermediate": 4 - 4j}
"""First ends of these pads, which go on along x in the reference pose; DIP's axis is at 23."""

CHANGED = 4
"""Codes by which a pixel in an imprint differs at least."""

PLACED = 0.8
"""Between the middle of the pixels that an imprint changes and that of its outline, px."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where all commands of these tests run."""
    made = tmp_path_factory.mktemp("render")
    shutil.copy(SCENES / "finger.toml", made)
    return made


@pytest.fixture(autouse=True)
def _there(folder, monkeypatch):
    monkeypatch.chdir(folder)


def rendered(name: str, *words: str, scene: str = "finger.toml") -> Path:
    """The folder that a command makes; one that was made before is taken as it is."""
    if not Path(name).exists():
        assert run(["render", scene, *words, "--out", name]) == 0
    return Path(name)


def pixels(path: Path) -> np.ndarray:
    """Red, green and blue of a picture, as numbers that may be subtracted."""
    image = cv2.imread(str(path))
    assert image is not None
    return image[..., ::-1].astype(float)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def imaged(pad: str, along: np.ndarray, across: np.ndarray, dip: float) -> np.ndarray:
    """Columns and rows of places on a pad, seen directly by an equidistant lens."""
    place = STARTS[pad] + along
    if pad == "distal":
        place = 23 + (place - 23) * np.exp(-1j * np.deg2rad(dip))
    arrow = (place - CAMERA) / AHEAD
    off = np.hypot(arrow.imag, across)
    radius = ROWS / FIELD * np.arctan2(off, arrow.real) / off
    return np.stack([COLUMNS / 2 + radius * across, ROWS / 2 - radius * arrow.imag], -1) - 0.5


def circle(pad: str, dip: float, more: float = 0.0) -> np.ndarray:
    """The edge of a contact in the picture, with a radius that is larger by so many mm."""
    along, across, diameter = BALLS[pad]
    turn, radius = np.linspace(0, 2 * np.pi, 90, endpoint=False), diameter / 2 + more
    return imaged(pad, along + radius * np.cos(turn), across + radius * np.sin(turn), dip)


def area(outline: np.ndarray) -> float:
    return float(cv2.contourArea(outline.astype(np.float32)))


def middle(outline: np.ndarray) -> np.ndarray:
    """Of the box about it."""
    return (outline.min(axis=0) + outline.max(axis=0)) / 2


def changed(one: np.ndarray, other: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Places of pixels that differ between two pictures, in the box about an outline."""
    rows, columns = np.nonzero(np.abs(one - other).max(axis=-1) >= CHANGED)
    places = np.stack([columns, rows], axis=-1)
    return places[((places > near.min(axis=0) - 6) & (places < near.max(axis=0) + 6)).all(axis=-1)]


def pressed() -> Path:
    words = [f"--press={pad}:{','.join(map(str, ball))}" for pad, ball in BALLS.items()]
    return rendered(
        "pressed", *CLEAN, "--sweep=dip=40:60:3", "--pose=pip=30", "--untouched", *words
    )


def test_every_pose_of_a_sweep_has_its_pictures_and_rows():
    out = pressed()
    names = [f"{number:03}.png" for number in range(6)]
    dips = ["40.0", "40.0", "50.0", "50.0", "60.0", "60.0"]
    wanted = [
        {"image": n, "pip_deg": "30.0", "dip_deg": d} for n, d in zip(names, dips, strict=True)
    ]
    assert rows_of(out / "frames.csv") == wanted
    assert {path.name for path in out.iterdir()} == {
        *names, "frames.csv", "contacts.csv", "results.json",
    }  # fmt: skip
    shown = [pixels(out / name) for name in names]
    assert {one.shape for one in shown} == {(ROWS, COLUMNS, 3)}
    assert all((one != other).any() for i, one in enumerate(shown) for other in shown[:i])


def test_contacts_are_listed_and_seen_where_they_are():
    out = pressed()
    touches = rows_of(out / "contacts.csv")
    assert [(one["image"], one["pad"]) for one in touches] == [
        (f"{number:03}.png", pad) for number in (1, 3, 5) for pad in BALLS
    ]
    for one in touches:
        places = [float(one[f"{key}_mm"]) for key in ("along", "across", "diameter")]
        assert tuple(places) == BALLS[one["pad"]]
    for number, dip in zip((1, 3, 5), (40.0, 50.0, 60.0), strict=True):
        before, after = (pixels(out / f"{n:03}.png") for n in (number - 1, number))
        for pad in BALLS:
            edge, found = circle(pad, dip), changed(before, after, circle(pad, dip))
            # The lowest place of a ball is flat, and as bright as before.
            hull = cv2.convexHull(found.astype(np.float32))[:, 0]
            least, most = (area(circle(pad, dip, more)) for more in (0.0, 3 * SMOOTHING))
            # It goes through the middles of pixels: half of one is outside.
            half = cv2.arcLength(hull, True) / 2
            assert least - half < area(hull) < most
            np.testing.assert_allclose(middle(hull), middle(edge), atol=PLACED)


def test_effects_are_those_that_are_asked_for():
    still = ["--pose=pip=30,dip=40", *CLEAN[:2], *CLEAN[6:]]
    exact = pixels(rendered("exact", *still, "--noise=0", "--blur=0") / "000.png")
    coded = pixels(rendered("coded", *still, "--noise=0", "--blur=0", "--gamma=2.2") / "000.png")
    low, high = (255 * (np.clip(exact + off, 0, 255) / 255) ** (1 / 2.2) for off in (-0.5, 0.5))
    assert (coded > low - 0.51).all()
    assert (coded < high + 0.51).all()
    blurred = pixels(rendered("blurred", *still, "--noise=0", "--blur=3") / "000.png")
    wanted = gaussian_filter(exact, (3, 3, 0), mode="mirror", truncate=5)
    # Both are rounded, the one before and the other after.
    np.testing.assert_allclose(blurred, wanted, atol=1.1)
    assert np.abs(blurred - exact).max() > 30
    twice = rendered("noisy", *still, "--noise=0.03", "--blur=0", "--pose=pip=30,dip=40")
    noise = [pixels(twice / f"00{n}.png") - exact for n in range(2)]
    for level in (exact > 150, (exact > 20) & (exact < 60)):
        light = exact[level].mean() / 255
        assert level.sum() > 10_000
        for one in noise:
            assert one[level].std() / 255 == pytest.approx(0.03 * np.sqrt(light + 0.04), rel=0.05)
    assert abs(np.mean(noise[0] * noise[1])) < 0.02 * np.mean(noise[0] ** 2)
    lossy = rendered("lossy", *still, "--noise=0", "--blur=0", "--jpeg=80")
    assert rows_of(lossy / "frames.csv")[0]["image"] == "000.jpg"
    _, kept = cv2.imencode(
        ".jpg", exact[..., ::-1].astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 80]
    )
    assert (lossy / "000.jpg").read_bytes() == kept.tobytes()


def test_light_is_even_soft_or_of_lamps():
    still = ["--pose=pip=30,dip=40", "--noise=0", "--blur=0", f"--rows={ROWS}"]
    pad = (
        imaged("intermediate", np.full(3, 7.5), np.array([-9.0, 0.0, 9.0]), 0.0).round().astype(int)
    )
    shown = {
        light: pixels(rendered(light, *still, f"--light={light}") / "000.png")[pad[:, 1], pad[:, 0]]
        for light in ("even", "soft", "lamps")
    }
    # Red comes from the side of greater columns, blue from the other.
    falloff = {
        light: (one[2, 0] / one[0, 0], one[0, 2] / one[2, 2]) for light, one in shown.items()
    }
    np.testing.assert_allclose(falloff["even"], 1, atol=0.03)
    # 0.4 of 24 mm is lost: 0.05 and 0.35 of the light 9 mm from the middle.
    np.testing.assert_allclose(falloff["soft"], 0.95 / 0.65, rtol=0.02)
    assert min(falloff["lamps"]) > 3


def errors_in(out: Path, scene_errors: Fabrication) -> Fabrication:
    """The errors that a ``truth.json`` lists."""
    values = [one["value"] for one in json.loads((out / "truth.json").read_text())["errors"]]
    leaves, structure = jax.tree.flatten(scene_errors)
    sizes = np.cumsum([leaf.size for leaf in leaves])
    assert sizes[-1] == len(values)
    parts = np.split(np.array(values), sizes[:-1])
    shaped = [jnp.asarray(p.reshape(leaf.shape)) for p, leaf in zip(parts, leaves, strict=True)]
    return jax.tree.unflatten(structure, shaped)


def test_errors_move_what_is_seen_as_the_truth_has_them():
    along, across, _ = BALLS["distal"]
    ball = f"--press=distal:{','.join(map(str, BALLS['distal']))}"
    made = rendered("made", "--pose=dip=40", *CLEAN, "--untouched", "--errors=2", ball)
    scene = read_scene(Path("finger.toml"))
    scene = eqx.tree_at(lambda one: one.camera.pixels, scene, jnp.asarray(float(ROWS)))
    truth = errors_in(made, deviations_of(MadeSpec(), scene))
    pad = [one.name for one in scene.layout.pads].index("distal")
    length = float(np.hypot(*np.ptp(np.asarray(scene.pads[pad]), axis=0)))
    flat = np.array([[0, -12], [length, -12], [length, 12], [0, 12]], np.float32)
    places = []
    for errors in (Fabrication.none(scene.layout), truth):
        finger = perturb(scene, errors, carried=carried_by_camera(scene))
        given = finger, jnp.deg2rad(jnp.array([0.0, 40.0])), errors, Imaging.of(finger.camera)
        corners = np.asarray(find_corners_in_space(*given, 24.0, [((), pad)]))[0]
        plane = cv2.getPerspectiveTransform(flat, corners.astype(np.float32))
        places.append(cv2.perspectiveTransform(np.array([[[along, across]]]), plane)[0, 0])
    before, after = (pixels(made / f"00{number}.png") for number in range(2))
    hull = changed(before, after, circle("distal", 40.0, 2.0))
    # Straight sides of the pad are a little bent in the image: with errors as much as without.
    shift = middle(hull) - middle(circle("distal", 40.0))
    assert np.hypot(*shift) > 3
    np.testing.assert_allclose(shift, places[1] - places[0], atol=PLACED)
    listed = json.loads((made / "truth.json").read_text())["errors"]
    assert listed[0]["error"] == "camera along x (mm)"
    assert listed[0]["deviation"] == MadeSpec().camera_position


def test_a_seed_is_a_finger_and_another_one_another():
    still = ["--pose=dip=40", *CLEAN]
    one, same, other = (
        rendered(name, *still, f"--errors={seed}")
        for name, seed in (("f1", 3), ("f2", 3), ("f3", 4))
    )
    assert (one / "truth.json").read_bytes() == (same / "truth.json").read_bytes()
    assert (one / "000.png").read_bytes() == (same / "000.png").read_bytes()
    assert (pixels(one / "000.png") != pixels(other / "000.png")).any()
    assert (one / "truth.json").read_bytes() != (other / "truth.json").read_bytes()


def test_errors_of_many_fingers_have_their_deviations():
    scene = read_scene(Path("finger.toml"))
    deviations = deviations_of(MadeSpec(), scene)
    fingers = [sample_finger(deviations, 5, number) for number in range(200)]
    numbers = np.stack([errors for _, errors in fingers])
    # Means and deviations of 200 normal numbers, within four of their own deviations.
    assert np.abs(numbers.mean(axis=0)).max() < 4 / np.sqrt(200)
    assert np.abs(numbers.std(axis=0) - 1).max() < 4 / np.sqrt(400)
    tilts = np.array([float(made.tilt) for made, _ in fingers])
    assert tilts.std() == pytest.approx(np.deg2rad(MadeSpec().camera_tilt_deg), rel=0.2)


@pytest.mark.parametrize("ranges", [None, (80.0, 50.0)])
def test_random_poses_fill_the_ranges_of_joints(ranges):
    finger = Imaged(read_scene(Path("finger.toml")), ranges)
    poses = poses_of(finger, Asked(random=500, seed=1))
    ends = np.array(ranges or (90.0, 90.0))
    assert poses.shape == (500, 2)
    assert (poses >= 0).all()
    assert (poses <= ends).all()
    np.testing.assert_allclose(poses.mean(axis=0), ends / 2, rtol=0.12)
    np.testing.assert_array_equal(np.round(poses, 3), poses)
    np.testing.assert_array_equal(poses_of(finger, Asked(random=500, seed=1)), poses)
    assert (poses_of(finger, Asked(random=500, seed=2)) != poses).any()


def test_each_pose_is_a_picture_and_those_of_a_finger_are_in_its_range():
    finger = Imaged(read_scene(Path("finger.toml")), (80.0, 50.0))
    asked = Asked(poses=["pip=80", "dip=50,pip=1", "dip=0"])
    assert poses_of(finger, asked).tolist() == [[80, 0], [1, 50], [0, 0]]
    assert poses_of(finger, Asked()).tolist() == [[0, 0]]
    for asked in (Asked(poses=["dip=50.1"]), Asked(sweeps=["dip=-1:50:3"])):
        with pytest.raises(
            UserError, match=r"--(pose dip=50\.1|sweep dip=-1): it bends from 0 to 50 degrees"
        ):
            poses_of(finger, asked)
        assert len(poses_of(finger._replace(ranges_deg=None), asked))
    with pytest.raises(UserError, match="pip=361: it bends from -360 to 360 degrees"):
        poses_of(finger._replace(ranges_deg=None), Asked(poses=["pip=361"]))
    with pytest.raises(UserError, match="these are 20,000 pictures, and at most 10,000"):
        shots_of(finger, 24.0, Asked(sweeps=["pip=0:80:200", "dip=0:50:100"]))


def test_a_fingers_file_has_ranges_and_a_scenes_has_widths(tmp_path):
    write_finger(packaged_finger(), tmp_path / "finger.toml")
    finger = read_imaged(tmp_path / "finger.toml")
    assert finger.ranges_deg == packaged_finger().body.ranges_deg == (90.0, 90.0)
    assert finger.scene.angle_names == ("pip", "dip")
    assert width_of(finger.scene) == 24
    for widths, wanted in (([math.nan] * 3, 24), ([20.0, math.nan, 20.0], 20)):
        assert width_of(replace(finger.scene, widths=jnp.array(widths))) == wanted
    with pytest.raises(UserError, match=r"its pads are 20 and 22 mm wide, .*--width"):
        width_of(replace(finger.scene, widths=jnp.array([20.0, 22.0, 20.0])))


def test_an_interrupt_leaves_nothing_or_what_was_there(tmp_path, monkeypatch, capsys):
    render, frames = Renderer.render, []

    def interrupted(self, *given, frame):
        if frame == 1:
            raise KeyboardInterrupt
        frames.append(frame)
        return render(self, *given, frame=frame)

    words = ["render", "finger.toml", *CLEAN, "--sweep=dip=40:60:3", "--out"]
    shutil.copytree(pressed(), tmp_path / "kept")
    before = {path.name: path.read_bytes() for path in (tmp_path / "kept").iterdir()}
    monkeypatch.setattr(Renderer, "render", interrupted)
    assert run([*words, str(tmp_path / "new")]) == 130
    assert run([*words, str(tmp_path / "kept"), "--force"]) == 130
    assert frames == [0, 0]
    assert "interrupted; no file is half-written" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    assert {path.name: path.read_bytes() for path in (tmp_path / "kept").iterdir()} == before


def test_force_replaces_pictures_and_nothing_of_anybody_else(tmp_path, capsys):
    shutil.copytree(pressed(), tmp_path / "out")
    words = f"render finger.toml {' '.join(CLEAN)} --pose dip=40 --out {tmp_path}/out"
    check_command_refused(capsys, words, ["exists already", "--force"])
    (tmp_path / "out" / "mine.png").touch()
    refused = ["mine.png is not of the earlier result", "move it away"]
    check_command_refused(capsys, f"{words} --force", refused)
    assert (tmp_path / "out" / "005.png").exists()
    (tmp_path / "out" / "mine.png").unlink()
    assert run([*words.split(), "--force"]) == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"000.png", "frames.csv", "results.json"}
    document = json.loads((tmp_path / "out" / "results.json").read_text())
    assert document["settings"]["poses"] == ["dip=40"]
    assert document["image"] == {"columns": COLUMNS, "rows": ROWS}
    assert document["effects"]["noise"] == 0


@pytest.mark.parametrize(("line", "words"), refused_cases("render"))
def test_faults_are_one_line_and_leave_nothing_behind(line, words, folder, capsys):
    for name in ("periscope.toml", "parabola.toml"):
        shutil.copy(SCENES / name, folder)
    Path("there").mkdir(exist_ok=True)
    before = set(folder.rglob("*"))
    check_command_refused(capsys, f"render {line}", words)
    assert set(folder.rglob("*")) == before
