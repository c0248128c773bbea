"""`designopt calibrate finger` on frames of a finger whose errors and angles are known."""

import csv
import re
import shutil
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import cv2
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError, cli
from optics import Imaging
from optics.calibration import CalibratedLens, Fisheye, write_lens
from optics.rendering import Effects
from optics.scene.fabrication import name_fabrication_errors
from perception.proprioception import FingerErrors, find_pose, observe
from studies.commands.frame_lists import label_by_tags, read_frames
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.lens_in_scene import with_lens
from studies.models.sensor.light import LampTable, LightTable, read_light
from studies.models.sensor.made import OF_PADS, with_new_pads
from studies.models.sensor.sensor_folder import read_sensor
from studies.models.sensor.spec import FingerImagesSpec

ROWS = 540
ANGLES_DEG = np.array([[56, 27], [8, 6], [70, 78], [54, 63], [48, 80], [70, 5], [30, 40.0]])
LABELLED = 5


def lens_as_designed(finger, **changes):
    """The designed camera's lens, as a calibration has it."""
    rows, columns = finger.imaging.shape
    values = {
        "lens": Fisheye(
            finger.scene.camera.focal_pixels,
            np.array([(columns - 1) / 2, (rows - 1) / 2]),
            np.zeros(4),
            np.zeros(2),
        ),
        "size": (columns, rows),
        "covariance": 1e-8 * np.eye(9),
        "noise": 0.02,
        "held_out": 0.02,
        "widest": 1.5,
        "distances": (20.0, 50.0),
        "pictures": 12,
    }
    return CalibratedLens(**values | changes)


@pytest.fixture(scope="module")
def finger():
    return FingerSensor.of(FingerImagesSpec(), rows=ROWS)


@pytest.fixture(scope="module")
def folder(finger, tmp_path_factory):
    """A lens, a finger's file, frames with labels that are off by 0.1°, and their list."""
    folder = tmp_path_factory.mktemp("frames")
    write_lens(lens_as_designed(finger), folder / "lens.toml")
    shutil.copy(str(files("studies") / "models/bare_finger.toml"), folder / "finger.toml")
    write_frames(finger.made_renderer(Effects(), seed=3), folder / "frames.csv", LABELLED)
    with (folder / "frames.csv").open("a", newline="") as stream:
        stream.write("missing.png,,\n")
    return folder


def write_frames(camera, path, labelled):
    labels = ANGLES_DEG + np.random.default_rng(0).normal(0, 0.1, ANGLES_DEG.shape)
    with path.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["image", "pip_deg", "dip_deg"])
        for number, angles in enumerate(ANGLES_DEG):
            image = camera.render(np.radians(angles), frame=number).pixels
            name = f"{path.stem}-{number}.png"
            cv2.imwrite(str(path.parent / name), image[..., ::-1])
            known = labels[number].round(4).tolist() if number < labelled else ["", ""]
            rows.writerow([name, *known])


def test_a_scene_with_a_calibrated_lens_images_as_the_lens_does(finger):
    rows, columns = finger.imaging.shape
    lens = Fisheye(
        finger.scene.camera.focal_pixels * 1.02,
        np.array([columns / 2 + 3.0, rows / 2 - 5.0]),
        np.array([-0.03, 0.002, 0.0, 0.0]),
        np.array([0.4, 0.02]),
    )
    scene = with_lens(finger.scene, lens_as_designed(finger, lens=lens))
    camera = scene.camera
    generator = np.random.default_rng(0)
    angle, slope = generator.uniform(-1.2, 1.2, 20), generator.uniform(-0.8, 0.8, 20)
    placed = Imaging.of(camera).place(jnp.asarray(angle), jnp.asarray(slope))
    # The ray begins at its own pupil on the axis; what it meets 30 mm farther is imaged there.
    ways = np.stack([slope, -np.sin(angle), np.cos(angle)], axis=-1)
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    before = np.asarray(lens.shift(jnp.asarray(np.arccos(ways[:, 2]))))
    points = 30 * ways + before[:, None] * [0, 0, 1]
    np.testing.assert_allclose(placed, lens.places(jnp.asarray(points)), atol=1e-6)
    np.testing.assert_array_equal(camera.pupil_shift, [0.4, 0.02])
    for size, line in (((rows, columns), "turn the pictures by 90"), ((columns, 300), "cropped")):
        with pytest.raises(UserError, match=line):
            with_lens(finger.scene, lens_as_designed(finger, size=size))


@pytest.mark.slow
def test_a_sensor_reads_angles_that_are_not_labelled(finger, folder, capsys):
    out = folder / "my.sensor"
    words = ["calibrate", "finger", str(folder / "frames.csv"), "--lens", str(folder / "lens.toml")]
    words += ["--finger", str(folder / "finger.toml"), "--out", str(out)]
    assert cli.run([*words, "--gamma", "1", "--light", "even"]) == 0
    captured = capsys.readouterr()
    assert f"frames: {len(ANGLES_DEG)}, {LABELLED} with known joint angles" in captured.out
    assert "missing.png" in captured.err
    sensor = read_sensor(out)
    # Labels are off by 0.1°, corners by tenths of a pixel.
    np.testing.assert_allclose(
        np.degrees(sensor.angles[LABELLED:]), ANGLES_DEG[LABELLED:], atol=0.2
    )
    assert sensor.frames.shape == (len(ANGLES_DEG), *sensor.finger.imaging.shape, 3)
    seen = observe(sensor.finger.detect(sensor.frames[-1]), sensor.finger.model.views)
    found = find_pose(sensor.finger.model, seen, np.radians([20.0, 50.0]), sensor.errors)
    assert bool(found.ok.all())
    np.testing.assert_allclose(np.degrees(found.value.angles), ANGLES_DEG[-1], atol=0.2)
    assert re.search(r"joint angles: ±0\.\d\d° over all poses", captured.out)
    assert cli.run([*words, "--gamma", "1"]) == 2
    assert "exists already" in capsys.readouterr().err

    # Other pads of the same finger: two labels are enough, as camera and mirrors are known.
    made, others = finger.made(3, 0)[0], finger.made(4, 0)[0]
    mixed = replace(made, **{name: getattr(others, name) for name in OF_PADS})
    write_frames(finger.renderer(Effects(), mixed, 3), folder / "again.csv", 2)
    again = folder / "again.sensor"
    words = ["calibrate", "finger", str(folder / "again.csv"), "--only", "pads"]
    assert cli.run([*words, "--sensor", str(out), "--out", str(again)]) == 0
    print(capsys.readouterr().out)
    found = read_sensor(again)
    np.testing.assert_allclose(np.degrees(found.angles[2:]), ANGLES_DEG[2:], atol=0.25)
    assert found.scatter < 1.3
    assert found.light == sensor.light == LightTable()
    (out / "arrays.npz").write_bytes(b"PK nothing")
    with pytest.raises(UserError, match=r"arrays.npz: cannot be read: it is damaged"):
        read_sensor(out)


def test_new_pads_are_known_by_their_tolerances(finger):
    generator = np.random.default_rng(0)
    count, offsets = finger.model.errors, (len(finger.model.views), 4, 2)
    causes = count + int(np.prod(offsets))
    root = generator.normal(size=(causes, causes))
    errors = FingerErrors(
        jnp.asarray(generator.normal(size=count)),
        jnp.asarray(generator.normal(size=offsets)),
        jnp.asarray(root @ root.T / causes),
        jnp.asarray(1.2),
    )
    new = with_new_pads(errors, finger.deviations)
    words = name_fabrication_errors(finger.scene.layout, finger.deviations)
    is_pad = np.array(["pad" in word for word in words])
    assert 0 < is_pad.sum() < len(is_pad) == count
    np.testing.assert_array_equal(new.mean, np.where(is_pad, 0.0, errors.mean))
    kept = np.append(~is_pad, np.zeros(causes - count, bool))
    np.testing.assert_array_equal(
        new.covariance[np.ix_(kept, kept)], errors.covariance[np.ix_(kept, kept)]
    )
    np.testing.assert_array_equal(new.covariance[np.ix_(~kept, ~kept)], np.eye((~kept).sum()))
    assert not np.any(new.covariance[np.ix_(kept, ~kept)])
    assert not np.any(new.offsets)


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ([], "--lens LENS.toml and --finger FINGER.toml are missing"),
        (["--only", "pads"], "--only pads goes with --sensor"),
        (["--only", "pads", "--sensor", "x", "--lens", "y"], "--lens is that of --sensor"),
        (["--light", "bright"], "--light bright: there is no such file; write [light.red]"),
    ],
)
def test_what_does_not_go_together_is_one_line(more, line, capsys):
    assert cli.run(["calibrate", "finger", "frames.csv", *more]) == 2
    assert line in capsys.readouterr().err


def test_light_is_even_or_that_of_a_file(tmp_path):
    path = tmp_path / "light.toml"
    path.write_text('[light.red]\nbeside = "right"\ngap = 1.5\nlow = 1.0\nhigh = 4.0\n')
    red = LampTable(beside="right", gap=1.5, low=1.0, high=4.0)
    assert read_light(str(path)) == LightTable(red=red)
    assert read_light("even") == LightTable()
    faults = {
        "[light.red]\nhigh = 2\n": "light.red.beside",
        "[red]\nhigh = 2\n": "red: no such key",
        "": "light: ",
    }
    for text, message in faults.items():
        path.write_text(text)
        with pytest.raises(UserError, match=re.escape(message)) as fault:
            read_light(str(path))
        assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("image,pip_deg\n0.png,3\n", "column 'dip_deg' is missing; its columns are image, pip_deg"),
        ("image,pip_deg,dip_deg,yaw\n0.png,3,4,5\n", "there is no column 'yaw'"),
        (
            "image,pip_deg,dip_deg\n0.png,three,4\n",
            "line 2, pip_deg: 'three' is no angle in degrees",
        ),
        ("image,pip_deg,dip_deg\n0.png,999,4\n", "line 2, pip_deg: '999' is no angle"),
        ("image,pip_deg,dip_deg\n", "it has no rows"),
        ("image,pip_deg,dip_deg\nnone.png,1,2\n", "none.png: there is no such file"),
    ],
)
def test_faults_of_a_list_of_frames_are_one_line(tmp_path, text, line):
    path = tmp_path / "frames.csv"
    path.write_text(text)
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((60, 80), np.uint8))
    with pytest.raises(UserError) as fault:
        read_frames(path, ("pip", "dip"), (80, 60))
    assert line in str(fault.value)
    assert "\n" not in str(fault.value)


TYPED = np.radians([[10.0, 20.0], [40.0, 5.0], [np.nan, np.nan], [np.nan, 33.0]])
TRUE = np.radians([[10.0, 20.0], [40.0, 5.0], [70.0, 61.0], [-15.0, 33.0]])


@pytest.mark.parametrize("sense", [1, -1])
def test_tags_label_what_is_not_typed(sense):
    """Stuck on at any angle, seen from either side, and at more than a half turn."""
    turns = sense * TRUE + np.radians([170.0, -40.0])
    turns = np.angle(np.exp(1j * turns))
    found = label_by_tags(Path("frames.csv"), TYPED, turns)
    np.testing.assert_allclose(found, TRUE, atol=1e-12)


def test_a_tag_that_is_not_seen_labels_nothing():
    turns = TRUE.copy()
    turns[2, 1] = np.nan
    found = label_by_tags(Path("frames.csv"), TYPED, turns)
    assert np.isnan(found[2, 1])
    assert np.isfinite(found[2, 0])


@pytest.mark.parametrize(
    ("typed", "turns", "line"),
    [
        (TYPED[[0, 2]], TRUE[[0, 2]], "how tags are stuck on is unknown; type every joint's angle"),
        (np.where([1, 0], TYPED, np.nan), TRUE, "how tags are stuck on is unknown"),
        (TYPED, TRUE[[3, 0, 1, 2]], "tags and typed angles differ by"),
    ],
)
def test_typed_angles_that_do_not_show_how_tags_are_stuck_on(typed, turns, line):
    with pytest.raises(UserError, match=line):
        label_by_tags(Path("frames.csv"), typed, turns)


def test_side_pictures_label_frames(tmp_path):
    """Two tags, of which one is turned in the picture."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    tags = [cv2.aruco.generateImageMarker(dictionary, number, 100) for number in range(2)]
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((60, 80), np.uint8))
    rows = ["image,pip_deg,side"]
    for number, (angle, typed) in enumerate([(5.0, "5"), (45.0, "45"), (25.0, ""), (0.0, "")]):
        side = np.full((300, 600), 255, np.uint8)
        side[100:200, 100:200] = tags[0]
        side[100:200, 400:500] = tags[1]
        if angle:  # about its middle, clockwise
            turn = cv2.getRotationMatrix2D((449.5, 149.5), -angle, 1.0)
            turned = cv2.warpAffine(side, turn, (600, 300), borderValue=255)
            side[:, 300:] = turned[:, 300:]
        cv2.imwrite(str(tmp_path / f"side{number}.png"), side if number < 3 else side[:, :300])
        rows.append(f"0.png,{typed},side{number}.png")
    path = tmp_path / "frames.csv"
    path.write_text("\n".join(rows))
    frames, lost = read_frames(path, ("pip",), (80, 60))
    degrees = np.degrees(frames.angles[:, 0])
    np.testing.assert_allclose(degrees[:3], [5, 45, 25], atol=0.2)
    assert np.isnan(degrees[3])
    assert lost == ["frames.csv, line 5: side3.png shows no tag 1, or no 0"]


def test_a_sensor_that_is_none_is_refused(tmp_path):
    with pytest.raises(UserError, match="there is no such folder; make a sensor with"):
        read_sensor(tmp_path / "none.sensor")
    (tmp_path / "empty.sensor").mkdir()
    with pytest.raises(UserError, match=r"sensor.toml: cannot be read"):
        read_sensor(tmp_path / "empty.sensor")
