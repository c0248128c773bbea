"""`designopt see` on frames of a finger whose errors and joint angles are known."""

import csv
import dataclasses
import http.client
import json
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from contextlib import closing

import cv2
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError
from optics.rendering import Effects, Imprint, make_height_map
from optics.rendering.pads import ELEVATION, FAR
from perception import Quality, View, map_to_image
from perception.contacts import Lamp
from perception.proprioception import FingerErrors
from perception.sources import Frame, Source, open_source
from perception.unwarping import least_scale
from studies.commands.arriving import arriving
from studies.commands.detectors import detectors
from studies.commands.live_page import live_page
from studies.commands.overlay import difference_picture, draw_overlay, draw_pad
from studies.commands.records import Records, Seen
from studies.commands.see import see
from studies.commands.seen import Asked, Session
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.light import LampTable, LightTable
from studies.models.sensor.reading import Reader
from studies.models.sensor.sensor_folder import (
    Sensor,
    finger_sensor,
    read_sensor,
    write_sensor,
)
from studies.models.sensor.spec import FingerImagesSpec, MadeSpec
from tests.perception.sources import served
from tests.perception.sources.clips import damaged
from tests.studies.test_calibrate_finger import lens_as_designed

ROWS = 360
CALIBRATED_DEG = np.array([[15, 15], [45, 25], [30, 60], [70, 70], [60, 45.0]])
ANGLES_DEG = np.array([[20, 40], [52, 31], [44, 66.0]])
HEIGHT = FAR * np.tan(ELEVATION)
"""Of the rendered lights above their pads, mm."""

KNOWN = 0.05
"""Standard deviation of the sensor's errors, in those of fabrication."""


@pytest.fixture(scope="module")
def camera():
    """A camera in front of a made finger, and the finger's true errors."""
    designed = FingerSensor.of(FingerImagesSpec(), rows=ROWS)
    lens = lens_as_designed(designed)
    finger = finger_sensor(designed.scene, lens, designed.width, MadeSpec(), 1.0)
    made, errors = finger.made(3, 0)
    effects = dataclasses.replace(Effects(), noise=0.01, blur=0.6)
    return finger, finger.renderer(effects, made, 3), errors


@pytest.fixture(scope="module")
def reader(camera):
    finger, renderer, errors = camera
    poses = np.radians(CALIBRATED_DEG)
    frames = np.array([renderer.render(pose, frame=i).pixels for i, pose in enumerate(poses)])
    known = FingerErrors.of(finger.model, errors, KNOWN**2 * np.eye(len(errors)))
    lens = lens_as_designed(finger)
    return Reader(
        Sensor("trial", finger, finger.scene, lens, MadeSpec(), 1.0, known, 1.0, poses, frames)
    )


@pytest.fixture(scope="module")
def frames(camera):
    """Frames at `ANGLES_DEG`, red, green and blue."""
    _, renderer, _ = camera
    poses = np.radians(ANGLES_DEG)
    return [renderer.render(pose, frame=50 + i).pixels for i, pose in enumerate(poses)]


def write(path, image):
    assert cv2.imwrite(str(path), image[..., ::-1])


def at_once(reader):
    """Views found in this process, whenever they are asked for."""

    def start(image):
        found = Future()
        found.set_result(reader.finger.detect(image))
        return found

    return start


def run(reader, name, out, page=None, **asked):
    """What `designopt see` does once a sensor is loaded, and its counts."""
    columns, rows = reader.sensor.lens.size
    with open_source(str(name), size=(columns, rows)) as source:
        session = Session(source, reader, out, Asked(**asked), page, lambda: None)
        session.follow(at_once(reader), 2)
        session.finish(out)
    return session.counts


def picture_in(path):
    picture = cv2.imread(str(path))
    assert picture is not None
    return picture


def rows_of(folder):
    with (folder / "readings.csv").open(newline="") as stream:
        return list(csv.DictReader(stream, strict=True))


def lines_of(folder):
    return [json.loads(line) for line in (folder / "readings.jsonl").read_text().splitlines()]


def seen_of(reader, image, number=0):
    reading = reader.read(image)
    frame = Frame(number, None, f"{number}.png", image)
    return Seen(frame, reading, reader.read_pads(image, reading), None, False, 0.01)


# One frame ---------------------------------------------------------------------------------------


def test_angles_and_corners_are_those_of_the_render(reader, camera, frames):
    finger, _, errors = camera
    for image, truth in zip(frames, np.radians(ANGLES_DEG), strict=True):
        reading = reader.read(image)
        assert reading.verdicts == ("", "")
        assert not reading.is_refused
        off = np.abs(reading.angles - truth)
        assert (off < 4 * reading.deviations).all()
        assert (np.degrees(reading.deviations) < 0.6).all()
        predicted = np.asarray(finger.model.predict(jnp.asarray(errors), jnp.asarray(truth)))
        for (pad, path), corners in zip(finger.model.views, predicted, strict=True):
            view = reading.sighting.view(pad, path)
            if view is not None and view.quality is Quality.COMPLETE and all(view.ends):
                np.testing.assert_allclose(view.corners, corners, atol=1.5)
        assert len(reading.sighting.complete()) >= 3


def other_pictures(frames):
    generator = np.random.default_rng(4)
    shape = frames[0].shape
    yield "dark", np.zeros(shape, np.uint8)
    yield "noise", generator.integers(0, 256, shape, np.uint8)
    yield "upside down", frames[0][::-1].copy()
    yield "moved", np.roll(frames[0], 25, axis=0)
    smaller = cv2.resize(frames[1], None, fx=0.85, fy=0.85)
    framed = np.zeros(shape, np.uint8)
    framed[: smaller.shape[0], : smaller.shape[1]] = smaller
    yield "smaller", framed
    for number in range(2):
        pads = np.zeros(shape, np.uint8)
        for _ in range(5):
            left, top = generator.integers(20, (shape[1] - 120, shape[0] - 90)).tolist()
            wide, high = generator.integers(30, (100, 70)).tolist()
            cv2.rectangle(pads, (left, top), (left + wide, top + high), (180, 170, 190), -1)
        yield f"other pads {number}", pads


def test_a_picture_of_something_else_has_no_angle(reader, frames):
    for name, image in other_pictures(frames):
        reading = reader.read(image)
        assert reading.is_refused, name
        assert np.isnan(reading.deviations).all(), name
        assert all(reading.verdicts), name


def test_what_is_pressed_in_is_the_greatest_change(reader, camera, frames):
    _, renderer, _ = camera
    pose = np.radians(ANGLES_DEG[0])
    pads = reader.read_pads(frames[0], reader.read(frames[0]))
    pad = max(pads, key=lambda one: pads[one].view.area)
    ball = Imprint.of_contact(9.0, 3.0, 5.0, 0.6)
    pressed = renderer.render(pose, {pad: [ball]}, frame=50).pixels
    shown = reader.read_pads(pressed, reader.read(pressed))
    assert shown[pad].change > 2 * pads[pad].change
    change = np.abs(cv2.blur(shown[pad].difference.mean(axis=2), (10, 10)))[15:-15, 15:-15]
    assert shown[pad].change == pytest.approx(change.max())
    along, across = np.add(np.unravel_index(change.argmax(), change.shape), 15) / 10
    width = shown[pad].picture.shape[1] / 10
    assert np.hypot(along - 9.0, across - width / 2 - 3.0) < 3.5
    others = [one for one in pads if one != pad and one in shown]
    for one in others:
        assert shown[one].change == pytest.approx(pads[one].change, abs=0.02)


def test_the_reference_is_the_nearest_frame_that_shows_the_view(reader, frames):
    reading = reader.read(frames[0])
    view = reader.finger.best_view(reading.sighting, reader.pads[0])
    away = np.sum((reader.sensor.angles - reading.angles) ** 2, axis=1)
    sorted_frames = reader.sensor.frames[np.argsort(away)]
    own = [(one, reader.finger.detect(one).view(view.pad, view.path)) for one in sorted_frames]
    complete = [one for one in own if one[1] and one[1].quality is Quality.COMPLETE]
    found = reader._reference(view, reading.angles)
    places = reader.finger.find_places(reader.finger.detect(complete[0][0]))
    own = reader.finger.unwarp(*complete[0], places[view.pad, view.path])
    np.testing.assert_array_equal(found, own)
    elsewhere = dataclasses.replace(view, path="mirror:nowhere")
    assert isinstance(elsewhere, View)
    assert reader._reference(elsewhere, reading.angles) is None


# Contacts ----------------------------------------------------------------------------------------

SOFT = LightTable.model_validate(
    {
        color: {"beside": side, "gap": FAR, "low": HEIGHT - 1, "high": HEIGHT + 1}
        for color, side in (("red", "right"), ("green", "from"), ("blue", "left"))
    }
)
"""Of rendered pads: their lights are far away."""

BALL = Imprint.of_contact(9.0, 3.0, 5.0, 0.6)


@pytest.fixture(scope="module")
def lit(reader):
    """The same sensor, of which it is known how its pads are lit."""
    return Reader(dataclasses.replace(reader.sensor, light=SOFT))


@pytest.fixture(scope="module")
def touched(camera):
    """A frame with a ball pressed into the pad that is named."""
    _, renderer, _ = camera
    pose = np.radians(ANGLES_DEG[0])
    return "intermediate", renderer.render(pose, {"intermediate": [BALL]}, frame=60).pixels


def steepest_diameter(ball):
    """Of the circle along which the rendered membrane is steepest, mm."""
    step = 0.05
    places = np.arange(-5, 5, step)
    grid = np.meshgrid(places, places, indexing="ij")
    height = make_height_map(dataclasses.replace(ball, along=0.0, across=0.0), *grid, step)
    slopes = np.abs(np.gradient(height[:, len(places) // 2], step))
    return 2 * abs(float(places[slopes.argmax()]))


def test_a_ball_is_found_where_it_is_pressed_in(lit, touched):
    pad, image = touched
    shown = lit.read_pads(image, lit.read(image))
    (contact,) = shown[pad].contacts
    assert np.hypot(*(contact.center - [BALL.along, BALL.across])) < 0.3
    assert contact.diameter == pytest.approx(steepest_diameter(BALL), abs=0.4)
    assert (contact.deviations > 0).all()
    assert contact.paths == (shown[pad].view.path,)
    assert all(shown[one].contacts == [] for one in shown if one != pad)
    # Its outline in the frame lies about its image, by the view's corners.
    outline, view = shown[pad].outlines[0], shown[pad].view
    size = lit.finger.catalog.lengths[pad], lit.finger.width
    middle = map_to_image(view, lit.finger.lens, contact.center[None], *size)[0]
    assert np.hypot(*(outline.mean(axis=0) - middle)) < 4
    across = np.ptp(outline, axis=0)
    assert (across > 0.5 * least_scale(view, lit.finger.lens, *size) * contact.diameter).all()
    drawn = draw_overlay(seen_of(lit, image), lit.joints, lit.pads)
    assert np.any(drawn != draw_overlay(seen_of(lit, image)._replace(pads={}), *names(lit)))
    for column, row in outline:
        assert np.any(drawn[round(row), round(column)] != image[round(row), round(column)])
    marked = np.any(draw_pad(shown[pad]) != shown[pad].picture, axis=2)
    away = np.argwhere(marked) / 10 + 0.05 - contact.center - [0, lit.finger.width / 2]
    away = np.hypot(*away.T)
    assert away.mean() == pytest.approx(contact.diameter / 2, abs=0.1)
    assert np.ptp(away) < 1  # as broad as the line and its ground


def names(reader):
    return reader.joints, reader.pads


def test_untouched_pads_have_no_contact(lit, frames):
    for image in frames:
        shown = lit.read_pads(image, lit.read(image))
        assert len(shown) > 0
        assert all(one.contacts == [] for one in shown.values())


def test_contacts_are_written_and_printed(lit, touched, tmp_path, capsys):
    pad, image = touched
    write(tmp_path / "one.png", image)
    with live_page(0) as page:
        page.begin(lit)
        run(lit, tmp_path / "one.png", tmp_path / "out", page, pads=True)
        news = json.loads(read(page, "/reading.json")[1])
    text = capsys.readouterr().out
    (line,) = lines_of(tmp_path / "out")
    (contact,) = line["pads"][pad]["contacts"]
    assert news["record"]["pads"][pad]["contacts"] == [contact]
    assert contact["paths"] == [line["pads"][pad]["path"]]
    (row,) = rows_of(tmp_path / "out")
    assert row[f"{pad}_contacts"] == "1"
    for name, truth in (("along", BALL.along), ("across", BALL.across)):
        assert contact[f"{name}_mm"] == pytest.approx(truth, abs=0.3)
        assert float(row[f"{pad}_{name}_mm"]) == contact[f"{name}_mm"]
        assert float(row[f"{pad}_{name}_deviation_mm"]) == contact[f"{name}_deviation_mm"] > 0
        shown = f"{contact[f'{name}_mm']:.2f} ± {contact[f'{name}_deviation_mm']:.2f} mm {name}"
        assert shown in text
    for other in line["pads"].keys() - {pad}:
        assert line["pads"][other]["contacts"] == []
        assert (row[f"{other}_contacts"], row[f"{other}_along_mm"]) == ("0", "")
    assert f"contact on {pad}: " in text
    assert text.count("contact on ") == 1
    pads = tmp_path / "out/pads"
    assert [one.name for one in pads.glob("*-contacts.png")] == [f"000000-{pad}-contacts.png"]


def test_without_its_light_no_contact_is_looked_for(reader, touched, tmp_path, capsys):
    pad, image = touched
    write(tmp_path / "one.png", image)
    run(reader, tmp_path / "one.png", tmp_path / "out")
    assert "contacts are not looked for: sensor.toml has no [light]" in capsys.readouterr().out
    assert lines_of(tmp_path / "out")[0]["pads"][pad]["contacts"] is None
    assert rows_of(tmp_path / "out")[0][f"{pad}_contacts"] == ""


def test_light_is_read_from_the_sensors_file(lit, tmp_path):
    write_sensor(lit.sensor, tmp_path)
    assert read_sensor(tmp_path).light == SOFT
    text = (tmp_path / "sensor.toml").read_text()
    begin = text.rindex("[light.red]")  # a comment names it, too
    own = text[text.index("[", begin + 1) :]
    faults = {
        'beside = "above"\nhigh = 2': "light.red.beside",
        'beside = "left"\nlow = 3\nhigh = 2': "make 'low' less than 'high'",
        'beside = "left"\nhigh = 2\nbright = 1': "light.red.bright",
    }
    for table, message in faults.items():
        (tmp_path / "sensor.toml").write_text(f"{text[:begin]}[light.red]\n{table}\n\n{own}")
        with pytest.raises(UserError, match=message):
            read_sensor(tmp_path)


def test_lamps_are_beside_their_sides():
    tables = (LampTable(beside=side, gap=2, low=1, high=3) for side in ("right", "from", "left"))
    named = dict(zip(("red", "green", "blue"), tables, strict=True))
    red, green, blue = LightTable(**named).lamps(20.0, 10.0)
    assert red == Lamp((0.0, 7.0), (20.0, 7.0), 1, 3)
    assert green == Lamp((-2.0, -5.0), (-2.0, 5.0), 1, 3)
    assert blue == Lamp((0.0, -7.0), (20.0, -7.0), 1, 3)
    last = LightTable(blue=LampTable(beside="to", gap=1, high=2)).lamps(20.0, 10.0)
    assert last == [None, None, Lamp((21.0, -5.0), (21.0, 5.0), 0, 2)]
    assert LightTable().lamps(20.0, 10.0) == []


# A source ----------------------------------------------------------------------------------------


def test_a_folder_becomes_rows_and_lines(reader, frames, tmp_path):
    pictures, out = tmp_path / "pictures", tmp_path / "out"
    pictures.mkdir()
    write(pictures / "0=first.png", frames[0])
    (pictures / "1.png").write_bytes(b"\x89PNG nothing")
    write(pictures / "2.png", np.zeros((50, 60, 3), np.uint8))
    write(pictures / "3.png", np.zeros_like(frames[0]))
    write(pictures / "4.png", frames[1])
    counts = run(reader, pictures, out, pads=True, overlay=True)
    assert (counts.read, counts.lost, counts.refused) == (3, 2, 1)
    rows, lines = rows_of(out), lines_of(out)
    assert [row["frame"] for row in rows] == ["0", "3", "4"]
    assert rows[0]["name"] == "0=first.png"
    assert [line["frame"] for line in lines] == list(range(5))
    assert [line.get("loss") for line in lines] == [None, "broken", "other_size", None, None]
    for row, line in zip(rows, (lines[0], lines[3], lines[4]), strict=True):
        for joint in ("pip", "dip"):
            found = line["joints"][joint]
            if found["angle_deg"] is None:
                assert row[f"{joint}_deg"] == row[f"{joint}_deviation_deg"] == ""
                assert row[f"{joint}_verdict"] == found["verdict"] != ""
            else:
                assert float(row[f"{joint}_deg"]) == pytest.approx(found["angle_deg"], abs=1e-4)
                assert float(row[f"{joint}_deviation_deg"]) > 0
    for row, truth in ((rows[0], ANGLES_DEG[0]), (rows[2], ANGLES_DEG[1])):
        found = [float(row[f"{joint}_deg"]) for joint in ("pip", "dip")]
        assert np.abs(found - truth).max() < 1.0
    direct = [view for view in lines[0]["views"] if view["quality"] == "complete"]
    assert np.array([view["corners_px"] for view in direct]).shape[1:] == (4, 2)
    for number in (0, 3, 4):
        assert picture_in(out / f"overlay/{number:06d}.png").shape == frames[0].shape
    pad, shown = next(iter(lines[0]["pads"].items()))
    unwarped = picture_in(out / f"pads/000000-{pad}.png")
    assert unwarped.shape[0] == round(10 * reader.finger.catalog.lengths[pad])
    assert picture_in(out / f"pads/000000-{pad}-change.png").shape == unwarped.shape
    assert float(rows[0][f"{pad}_change"]) == shown["change"]
    document = json.loads((out / "results.json").read_text())
    assert document["frames"] == {"read": 3, "lost": 2, "refused": 1}
    assert {one["path"] for one in document["manifest"]} >= {"readings.csv", "readings.jsonl"}


def test_lines_are_whole_as_soon_as_they_are_written(reader, frames, tmp_path):
    records = Records(tmp_path, reader.joints, ())
    for number in range(3):
        line = records.add(seen_of(reader, frames[0], number))
        assert (tmp_path / "readings.jsonl").read_text().splitlines()[-1] == line
        text = (tmp_path / "readings.csv").read_text()
        assert text.endswith("\n")
        assert text.count("\n") == number + 2
    records.close()


def test_one_picture_is_read_out(reader, frames, tmp_path, capsys):
    write(tmp_path / "one.png", frames[0])
    run(reader, tmp_path / "one.png", tmp_path / "out")
    shown = capsys.readouterr().out
    assert "one.png\npip: " in shown
    assert "° ± " in shown
    assert "greatest change" in shown


def clip(path, frames, count, code="MJPG"):
    size = frames[0].shape[1::-1]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), 12.0, size)
    for number in range(count):
        writer.write(frames[number % len(frames)][..., ::-1])
    writer.release()
    return path.read_bytes()


def test_a_video_has_an_overlay_of_its_rate_and_length(reader, frames, tmp_path, capsys):
    clip(tmp_path / "clip.avi", frames, 7)
    counts = run(reader, tmp_path / "clip.avi", tmp_path / "out", overlay=True, json=True)
    assert counts.read == 7
    printed = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert printed == lines_of(tmp_path / "out")
    assert [round(line["time_s"], 3) for line in printed] == [round(i / 12, 3) for i in range(7)]
    video = cv2.VideoCapture(str(tmp_path / "out/overlay.avi"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(12, rel=1e-3)
    shown = 0
    while video.read()[0]:
        shown += 1
    assert shown == 7


def test_light_that_changes_is_a_line_and_a_flag(reader, frames, tmp_path, caplog):
    darker = (frames[0] * 0.6).astype(np.uint8)
    clip(tmp_path / "clip.avi", [frames[0]] * 3 + [darker] * 9, 12)
    run(reader, tmp_path / "clip.avi", tmp_path / "out")
    assert "the light is not the reference's: brightness ×0.6" in caplog.text
    moved = [row["light_moved"] for row in rows_of(tmp_path / "out")]
    assert moved[:3] == ["0"] * 3
    assert moved[-1] == "1"
    assert lines_of(tmp_path / "out")[-1]["light"]["gains"][1] == pytest.approx(0.6, abs=0.05)


def check_damaged(reader, frames, folder, count, seed):
    """Damaged pictures and clips: every frame is read or lost, and has its line."""
    generator = np.random.default_rng(seed)
    pictures = folder / "pictures"
    pictures.mkdir()
    endings = (".jpg", ".png", ".webp", ".bmp")
    for number in range(count):
        ending = endings[number % len(endings)]
        whole = cv2.imencode(ending, frames[number % len(frames)][..., ::-1])[1].tobytes()
        data = whole if number == 0 else damaged(whole, generator)
        (pictures / f"{number}{ending}").write_bytes(data)
    counts = run(reader, pictures, folder / "out")
    assert counts.read + counts.lost == count
    assert counts.lost > count / 4
    lines = lines_of(folder / "out")
    assert [line["frame"] for line in lines] == list(range(count))
    assert len(rows_of(folder / "out")) == counts.read
    kinds = (("avi", "MJPG"), ("mp4", "mp4v"))
    whole = [clip(folder / f"whole.{end}", frames, 6, code) for end, code in kinds]
    for number in range(count):
        end, _ = kinds[number % 2]
        path, out = folder / f"damaged{number}.{end}", folder / f"out{number}"
        path.write_bytes(damaged(whole[number % 2], generator))
        counts = run(reader, path, out)
        lines = lines_of(out)
        total = 0
        for line in lines:
            assert line["frame"] == total
            total += line.get("lost", 1)
        assert total == counts.read + counts.lost
        assert total >= 6 or "cannot be opened" in lines[0]["reason"]


def test_damaged_files_are_counted(reader, frames, tmp_path):
    check_damaged(reader, frames, tmp_path, 6, 1)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(5))
def test_many_damaged_files_are_counted(reader, frames, seed, tmp_path):
    """500 pictures and 500 clips in all."""
    check_damaged(reader, frames, tmp_path, 100, 100 + seed)


@pytest.fixture
def stream(frames, monkeypatch):
    """A served camera that shows the rendered frames."""
    monkeypatch.setattr(
        served, "picture", lambda number, _: frames[number % len(frames)][..., ::-1]
    )
    with served.serving() as camera:
        yield camera


def test_a_stream_is_read_until_enough(reader, stream, tmp_path):
    counts = run(reader, stream.url, tmp_path / "out", frames=4)
    assert counts.read == 4
    assert counts.refused == 0
    rows = rows_of(tmp_path / "out")
    assert len(rows) == 4
    for row in rows:
        found = np.array([float(row["pip_deg"]), float(row["dip_deg"])])
        assert np.abs(ANGLES_DEG - found).max(axis=1).min() < 1.0
    assert all(float(row["latency_s"]) > 0 for row in rows)
    assert "latency" in str(counts)


def test_items_come_in_order_and_no_more_than_are_asked_for(reader, stream):
    started = []

    def start(image):
        started.append(image)
        return Future()

    source = open_source(stream.url)
    with closing(arriving(source, start, 2)) as arrivals:
        items = [next(arrivals).item for _ in range(3)]
        time.sleep(0.3)
        assert len(started) <= 4
    numbers = [item.number for item in items if isinstance(item, Frame)]
    assert numbers == sorted(numbers)
    assert len(numbers) > 0
    assert next(arrivals, None) is None

    class Broken(Source):
        def _items(self):
            raise OSError("the cable is cut")

    with pytest.raises(OSError, match="the cable is cut"):
        next(arriving(Broken("broken", None), start, 1))


# What is shown -----------------------------------------------------------------------------------


def test_an_overlay_has_outlines_where_views_are(reader, frames):
    seen = seen_of(reader, frames[0])
    drawn = draw_overlay(seen, reader.joints, reader.pads)
    assert drawn.shape == frames[0].shape
    changed = np.any(drawn != frames[0], axis=2)
    for view in seen.reading.sighting.complete():
        for column, row in (view.corners + np.roll(view.corners, -1, axis=0)) / 2:
            assert changed[round(row), round(column)]
    rows = np.flatnonzero(changed.any(axis=1))
    assert rows[0] < 20  # the joint angles
    assert not np.shares_memory(drawn, frames[0])


def test_a_difference_is_white_blue_and_orange():
    change = np.array([[[0.0] * 3, [0.5] * 3, [-0.9] * 3]])
    np.testing.assert_array_equal(
        difference_picture(change), [[[255, 255, 255], [230, 159, 0], [0, 114, 178]]]
    )


def get(page, path, host=None):
    """The answer of a page."""
    place = page.address.removeprefix("http://").rstrip("/")
    connection = http.client.HTTPConnection(place, timeout=20)
    connection.request("GET", path, headers={"Host": host or place})
    return connection, connection.getresponse()


def read(page, path, host=None):
    connection, answer = get(page, path, host)
    with closing(connection):
        return answer.status, answer.read()


def test_the_live_page_shows_the_newest_frame(reader, frames):
    with live_page(0) as page:
        assert read(page, "/")[0] == 200
        assert b"<title>designopt see</title>" in read(page, "/")[1]
        assert json.loads(read(page, "/reading.json")[1])["record"] == {}
        assert read(page, "/pad/0")[0] == 404
        page.begin(reader)
        seen = seen_of(reader, frames[0], 7)._replace(pads={})
        page.show(seen, "1 frame")
        news = json.loads(read(page, "/reading.json")[1])
        assert (news["summary"], news["record"]["frame"]) == ("1 frame", 7)
        angle = news["record"]["joints"]["pip"]["angle_deg"]
        assert angle == pytest.approx(np.degrees(seen.reading.angles[0]), abs=1e-5)
        number = news["pads"].index(next(iter(news["record"]["pads"])))
        status, data = read(page, f"/pad/{number}?7")
        assert status == 200
        assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) is not None
        connection, answer = get(page, "/frames.mjpeg")
        with closing(connection):
            head = {answer.fp.readline().strip() for _ in range(4)}
            (length,) = [int(one.split()[1]) for one in head if one.startswith(b"Content-Length")]
            data = answer.fp.read(length)
        shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert shown is not None
        assert shown.shape == frames[0].shape
        assert read(page, "/", host="elsewhere.example:80")[0] == 403
        assert read(page, "/pad/99")[0] == read(page, "/etc/passwd")[0] == 404
        port = int(page.address.rpartition(":")[2].rstrip("/"))
        with pytest.raises(UserError, match=f"--port {port}: .*; choose another"), live_page(port):
            pass


def test_the_live_page_goes_with_the_loop(reader, stream, tmp_path):
    with live_page(0) as page:
        page.begin(reader)
        run(reader, stream.url, tmp_path / "out", page, frames=3)
        news = json.loads(read(page, "/reading.json")[1])
    assert news["record"]["joints"]["pip"]["angle_deg"] is not None
    assert news["summary"].startswith("3 frames read")


# What is refused ---------------------------------------------------------------------------------


def test_pictures_of_another_size_are_refused_before_a_folder_is_made(reader, tmp_path):
    write(tmp_path / "small.png", np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(UserError, match=r"small.png: .* has 64x48 px .*, not 480x360.*calibrate"):
        run(reader, tmp_path / "small.png", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    write(tmp_path / "whole.png", np.zeros_like(reader.sensor.frames[0]))
    counts = run(reader, tmp_path, tmp_path / "out")
    assert (counts.read, counts.lost) == (1, 1)
    assert [line["name"] for line in lines_of(tmp_path / "out")] == ["small.png", "whole.png"]


def test_what_is_not_there_is_refused(reader, frames, tmp_path):
    picture, sensor = tmp_path / "one.png", tmp_path / "my.sensor"
    write(picture, frames[0])
    out = tmp_path / "out"
    with pytest.raises(UserError, match="there is no such folder; make a sensor with"):
        see(str(picture), sensor, out)
    sensor.mkdir()
    write_sensor(reader.sensor, sensor)
    with pytest.raises(UserError, match=r"none\.png: there is no such file; name a picture"):
        see(str(tmp_path / "none.png"), sensor, out)
    with pytest.raises(UserError, match="--port 80: only a page has a port; add --live"):
        see(str(picture), sensor, out, port=80)
    out.mkdir()
    with pytest.raises(UserError, match=f"--out {out}: exists already"):
        see(str(picture), sensor, out)
    (out / "mine.txt").write_text("mine")
    with pytest.raises(UserError, match="it does not hold an earlier result"):
        see(str(picture), sensor, out, force=True)
    (sensor / "sensor.toml").write_text("nothing = 1")
    with pytest.raises(UserError, match=r"sensor\.toml"):
        see(str(picture), sensor, tmp_path / "other")


# Processes ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_other_processes_find_the_same_views(reader, frames):
    with detectors(reader.finger) as pool:
        waiting = [pool.start(image) for image in frames]
        for image, found in zip(frames, waiting, strict=True):
            there, here = found.result(), reader.finger.detect(image)
            assert [view.path for view in there.views] == [view.path for view in here.views]
            for one, other in zip(there.views, here.views, strict=True):
                np.testing.assert_allclose(one.corners, other.corners, atol=1e-6)


@pytest.mark.slow
def test_the_command_reads_a_stream_until_it_is_interrupted(reader, frames, stream, tmp_path):
    """From a sensor's folder, in a process of its own; then a picture, in place of that."""
    sensor, out = tmp_path / "my.sensor", tmp_path / "out"
    sensor.mkdir()
    write_sensor(reader.sensor, sensor)
    command = [sys.executable, "-c", "from designopt.cli import main; main()", "see"]
    words = ["--sensor", str(sensor), "--out", str(out)]
    process = subprocess.Popen(
        [*command, stream.url, *words, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    found = []
    for line in process.stdout:
        found.append(json.loads(line))
        if sum("joints" in one for one in found) == 5:
            process.send_signal(signal.SIGINT)
            break
    rest, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert "frames read" in errors
    printed, kept = [*found, *map(json.loads, rest.splitlines())], lines_of(out)
    assert kept[: len(printed)] == printed
    assert len(kept) - len(printed) in (0, 1)  # the interrupt may come between the two
    write(tmp_path / "one.png", frames[0])
    again = subprocess.run(
        [*command, str(tmp_path / "one.png"), *words, "--force"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "1 frames read, 0 lost, 0 without joint angles" in again.stdout
    (row,) = rows_of(out)
    assert abs(float(row["pip_deg"]) - ANGLES_DEG[0, 0]) < 1.0
