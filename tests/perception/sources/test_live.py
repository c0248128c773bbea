"""Live streams, from a camera that is served by this machine and fails in the ways cameras do."""

from __future__ import annotations

import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from designopt.errors import UserError
from perception.sources import Frame, Item, Loss, LostFrame, Notice, Source, live, open_source
from tests.perception.sources.served import Camera, number_of, serving

LIMIT = 20.0
"""Seconds after which a test has failed that waits for something."""


@pytest.fixture
def camera() -> Iterator[Camera]:
    with serving() as one:
        yield one


@pytest.fixture
def source(camera: Camera) -> Iterator[Source]:
    with open_source(camera.url) as one:
        yield one


def until(items: Iterator[Item], is_last: Callable[[Item], bool]) -> list[Item]:
    """What comes, up to something."""
    found, end = [], time.monotonic() + LIMIT
    for item in items:
        found.append(item)
        if is_last(item):
            return found
        assert time.monotonic() < end, f"it did not come; last came {found[-3:]}"
    raise AssertionError(f"the stream ended after {found[-3:]}")


def frames(count: int) -> Callable[[Item], bool]:
    """That so many frames have come."""
    numbers = iter(range(1, count + 1))
    return lambda item: isinstance(item, Frame) and next(numbers) == count


def texts(items: list[Item]) -> list[str]:
    return [item.text.partition("/: ")[2] for item in items if isinstance(item, Notice)]


def test_every_picture_is_a_frame_or_counted(camera: Camera, source: Source) -> None:
    """Numbers are those that the camera drew into its pictures, also if it is read slowly."""
    items = iter(source)
    found, sent = until(items, frames(5)), 0
    for _ in range(4):
        time.sleep(0.25)
        sent = camera.sent
        found += until(items, frames(1))
    number = 0
    for item in found:
        assert isinstance(item, Frame | LostFrame)
        assert item.number == number
        if isinstance(item, Frame):
            assert number_of(item.image) == number
            number += 1
        else:
            assert item.loss is Loss.SKIPPED
            number += item.count
    newest = found[-1]
    assert isinstance(newest, Frame)
    assert newest.time is not None
    assert len(found) < 20 < number
    assert sent - number < 20  # read one by one, it would be some eighty behind
    assert 0.5 < newest.time < LIMIT


def test_a_broken_picture_is_lost_and_the_next_one_comes(camera: Camera, source: Source) -> None:
    camera.pause = 0.05
    items = iter(source)
    until(items, frames(1))
    for number, spoil in enumerate((lambda data: data[: len(data) // 2], lambda data: b"words")):
        camera.spoil[camera.sent + 5 + 3 * number] = spoil
    found = until(items, lambda item: isinstance(item, Frame) and item.number > camera.sent - 2)
    found += until(items, frames(15))
    lost = [item for item in found if isinstance(item, LostFrame) and item.loss is Loss.BROKEN]
    assert [item.number for item in lost] == list(camera.spoil)
    assert {item.reason for item in lost} == {"it is cut off or damaged"}
    assert not texts(found)


def test_damage_that_only_a_message_names_is_never_missed(camera: Camera, source: Source) -> None:
    """The decoder decodes one picture while it reads the next ones."""
    camera.pause, camera.size = 0.0, (640, 480)
    no_code = 40 * b"\xff\x00"
    for number in range(camera.sent + 10, 2**12, 2):
        camera.spoil[number] = lambda data: data[:2000] + no_code + data[2000:]
    found = until(iter(source), frames(60))
    shown = {number_of(item.image) for item in found if isinstance(item, Frame)}
    lost = [item for item in found if isinstance(item, LostFrame) and item.loss is Loss.BROKEN]
    assert not shown & set(camera.spoil)
    assert len(lost) > 10
    assert all("damaged: " in item.reason for item in lost)


def test_another_size_in_mid_stream_is_lost(camera: Camera) -> None:
    with open_source(camera.url, size=camera.size) as source:
        items = iter(source)
        until(items, frames(2))
        camera.size = (96, 64)
        *_, lost = until(
            items, lambda item: isinstance(item, LostFrame) and item.loss is Loss.OTHER_SIZE
        )
        assert "96x64" in str(lost)
        camera.size = (64, 48)
        until(items, frames(1))


def test_an_outage_is_two_lines(camera: Camera, source: Source) -> None:
    items = iter(source)
    until(items, frames(3))
    camera.is_on = False
    threading.Timer(0.7, lambda: setattr(camera, "is_on", True)).start()
    found = until(items, lambda item: isinstance(item, Notice))
    found += until(items, frames(3))
    broke_off, back = texts(found)
    assert broke_off == "the stream broke off; it is opened again until it is back"
    assert back.startswith("back after ")
    assert 0.5 < float(back.split()[2]) < LIMIT


def test_waits_grow(monkeypatch: pytest.MonkeyPatch, camera: Camera, source: Source) -> None:
    """0.2 s, 0.4 s, … up to 5 s: what is waited for is recorded, and not waited for."""
    items = iter(source)
    until(items, frames(1))
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        camera.is_on = len(waits) > 6

    assert isinstance(source, live.LiveStream)
    monkeypatch.setattr(source._closed, "wait", wait)
    camera.is_on = False
    until(items, lambda item: isinstance(item, Notice) and "back after" in str(item))
    assert waits[:7] == [0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0]


def test_a_decoder_that_is_killed_is_an_outage(source: Source) -> None:
    items = iter(source)
    until(items, frames(2))
    assert source._decoder is not None
    source._decoder._process.kill()
    found = until(items, lambda item: isinstance(item, Notice))
    found += until(items, frames(2))
    assert texts(found)[0].startswith("the decoder hung or crashed")


def test_pictures_that_stand_still_are_noticed(
    monkeypatch: pytest.MonkeyPatch, camera: Camera, source: Source
) -> None:
    monkeypatch.setattr(live, "STILL", 0.3)
    items = iter(source)
    until(items, frames(20))
    camera.still = 5
    found = until(items, lambda item: isinstance(item, Notice))
    camera.still = None
    found += until(items, lambda item: isinstance(item, Notice))
    assert [text[:24] for text in texts(found)] == [
        "the picture has not chan",
        "the picture changes agai",
    ]


@pytest.mark.parametrize("is_silent", [False, True])
def test_closing_ends_who_iterates_at_once(camera: Camera, *, is_silent: bool) -> None:
    with open_source(camera.url) as source:
        assert source._decoder is not None
        process = source._decoder._process
        thread = threading.Thread(target=lambda: list(source))
        thread.start()
        camera.is_silent = is_silent
        time.sleep(0.3)
        source.close()
        thread.join(1.0)
        assert not thread.is_alive()
    assert process.poll() is not None


@pytest.mark.slow
def test_silence_is_an_outage(camera: Camera, source: Source) -> None:
    items = iter(source)
    until(items, frames(2))
    camera.is_silent = True
    found = until(items, lambda item: isinstance(item, Notice))
    camera.is_silent = False
    found += until(items, frames(2))
    silent, back = texts(found)
    assert silent == "no picture came for 3 s; it is opened again until it is back"
    assert back.startswith("back after ")


@pytest.mark.slow
def test_memory_stays_the_same_over_thousands_of_pictures(camera: Camera, source: Source) -> None:
    camera.pause = 0.001
    items = iter(source)
    until(items, frames(500))
    assert source._decoder is not None
    process = source._decoder._process.pid
    before = resident(process)
    tracemalloc.start()
    until(items, lambda item: isinstance(item, Frame) and item.number > 1000)
    traced = tracemalloc.get_traced_memory()[0]
    until(items, lambda item: isinstance(item, Frame) and item.number > 4000)
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert after - traced < 1e5  # an image has 9 kB
    assert resident(process) - before < 5e6


def resident(process: int) -> float:
    """Bytes that a process has in memory."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))


def test_what_cannot_be_opened_is_one_line(
    camera: Camera, capfd: pytest.CaptureFixture[str]
) -> None:
    host = camera.url.split("/")[2]
    cases = {
        f"http://{host}/nothing": "nothing",
        f"http://someone:secret@{host}/nothing": f"http://{host}/nothing: cannot be opened",
        f"http://{host}/picture.jpg": "it is a file and no stream; download it and name the file",
        "http://127.0.0.1:1/": "Connection refused",
        "rtsp://127.0.0.1:1/": "Connection refused",
        "camera:99": "camera 99: cannot be opened: there is nothing to be read; look whether",
    }
    for text, expected in cases.items():
        with pytest.raises(UserError) as caught:
            open_source(text)
        line = str(caught.value)
        assert expected in line
        assert "look whether" in line
        assert "secret" not in line
        assert "\n" not in line
    assert capfd.readouterr() == ("", "")
