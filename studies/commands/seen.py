"""The loop of ``designopt see``: frames of a source are read in their order, kept and shown."""

from __future__ import annotations

import logging
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import jax
import numpy as np

from designopt.cli.verbosity import is_quiet
from designopt.errors import Interrupted, UserError
from designopt.io.files import check_new_folder, printable
from designopt.io.spec_files import FORMAT
from designopt.progress import step_display
from designopt.study.result_folders import (
    cannot_write,
    check_replaceable,
    remove_result,
    write_document,
)
from perception import Sighting
from perception.sources import (
    Frame,
    Item,
    Light,
    LightWatch,
    Loss,
    LostFrame,
    Notice,
    Source,
    open_source,
)
from perception.sources.light import BACK
from perception.sources.live import LiveStream
from perception.sources.pictures import PictureFiles
from studies.commands.arriving import Arrival, arriving
from studies.commands.detectors import detectors
from studies.commands.live_page import LivePage, live_page
from studies.commands.overlay import contact_text, lines_of
from studies.commands.records import Records, Seen
from studies.commands.writing import OverlayPictures, OverlayVideo, PadPictures, Writer
from studies.models.sensor.reading import Reader
from studies.models.sensor.sensor_folder import read_image_size, read_sensor

LOG = logging.getLogger("designopt.see")

LATEST = 10_000
"""Frames whose latency is kept for the summary."""

ENOUGH = 5
"""Where the first so many pictures have another size than the sensor's, all have."""

NO_LIGHT = "contacts are not looked for: sensor.toml has no [light]"

MOST_PENDING = 4
"""Pictures that wait to be written."""


@dataclass(frozen=True)
class Asked:
    """What is asked for; see the options of ``designopt see``.

    Attributes:
        overlay: whether pictures, or a video, of what is found are written.
        pads: whether unwarped pads and their differences are.
        frames: number of frames after which a source is left; ``None`` for all.
        json: whether a line of JSON is printed for each frame.
        port: of the live page; ``None`` for no page.
        force: whether an earlier result may be replaced.
    """

    overlay: bool = False
    pads: bool = False
    frames: int | None = None
    json: bool = False
    port: int | None = None
    force: bool = False


@dataclass
class Counts:
    """What has become of the frames so far.

    Attributes:
        read: frames that were read.
        lost: frames that were lost.
        refused: frames that were read and have no joint angle.
        latencies: of the latest frames, s.
        first: when the first one came, s.
        last: when the last one was read, s.
    """

    read: int = 0
    lost: int = 0
    refused: int = 0
    latencies: deque[float] = field(default_factory=lambda: deque(maxlen=LATEST))
    first: float = 0.0
    last: float = 0.0

    def add(self, seen: Seen, arrived: float) -> None:
        """Count a frame that was read."""
        self.first = self.first or arrived
        self.last = arrived + seen.latency
        self.read += 1
        self.refused += seen.reading.is_refused
        self.latencies.append(seen.latency)

    @property
    def brief(self) -> str:
        """How many there are."""
        return f"{self.read} frames read, {self.lost} lost, {self.refused} without joint angles"

    def __str__(self) -> str:
        if self.read < 2:
            return self.brief
        rate = self.read / max(self.last - self.first, 1e-9)
        median, most = 1000 * np.quantile(self.latencies, [0.5, 0.95])
        latency = f"latency {median:.0f} ms (median), {most:.0f} ms (95 %)"
        return f"{self.brief}; {rate:.1f} frames/s, {latency}"


def see_source(name: str, sensor_folder: Path, out: Path, asked: Asked) -> int:
    """Read all frames of a source and write what is found to a folder as it goes.

    Args:
        name: of the source.
        sensor_folder: of the sensor.
        out: folder to make.
        asked: for what.

    Returns:
        0, or 1 where no frame could be read.

    Raises:
        UserError: there is no such source or sensor, their pictures differ in size, or the folder
            cannot be made.
        Interrupted: by Ctrl-C, where the source would have ended by itself.
    """
    check_new_folder(out, force=asked.force)
    if out.exists():
        check_replaceable(out)
    words = sys.stderr if asked.json else sys.stdout
    size = read_image_size(sensor_folder)
    source = open_source(name, size=size)
    is_live = isinstance(source, LiveStream)
    if is_live:  # opened again when all is loaded: until then it would count frames as skipped
        source.close()
    with jax.enable_x64(True), ExitStack() as stack:
        page = None if asked.port is None else stack.enter_context(live_page(asked.port))
        reader = Reader(read_sensor(sensor_folder))
        if page is not None:
            page.begin(reader)
            print(f"{reader.sensor.name}: {page.address} (Ctrl-C ends it)", file=words, flush=True)
        start, most, wait = stack.enter_context(_detection(source, reader))
        first = reader.sensor.frames[0]
        reading = reader.read(first)  # compiles what every frame needs
        if asked.pads:
            reader.read_pads(first, reading)
        wait()
        if is_live:
            source = open_source(name, size=size)
        steps = stack.enter_context(step_display())
        total = len(source.paths) if isinstance(source, PictureFiles) else asked.frames
        is_done = steps.count(total) if total and not asked.json else lambda: None
        session = Session(source, reader, out, asked, page, is_done)
        was_interrupted = False
        try:
            try:
                session.follow(start, most)
            except KeyboardInterrupt:
                was_interrupted = True
            session.finish(sensor_folder)
        except OSError as error:
            raise cannot_write(out, error) from error
        summary = f"{printable(str(out))}: {session.counts}"
        if was_interrupted and not is_live:
            raise Interrupted(summary)
        print(printable(str(out)) if is_quiet() else summary, file=words, flush=True)
        if page is not None and not is_live:
            page.stay()
    return 0 if session.counts.read else 1


Start = Callable[[np.ndarray], Future[Sighting]]
"""Begins to look for the views in an image."""


@contextmanager
def _detection(source: Source, reader: Reader) -> Iterator[tuple[Start, int, Callable[[], None]]]:
    """What begins to look for views, in how many frames at a time, and waits until it can."""

    def at_once(image: np.ndarray) -> Future[Sighting]:
        found = Future[Sighting]()
        with jax.enable_x64(True):
            found.set_result(reader.finger.detect(image))
        return found

    if _is_one_picture(source):
        yield at_once, 1, lambda: None
    else:
        with detectors(reader.finger) as pool:
            yield pool.start, pool.count + 1, pool.wait


class Session:
    """One run of the command over a source.

    Attributes:
        counts: of its frames.
    """

    def __init__(
        self,
        source: Source,
        reader: Reader,
        out: Path,
        asked: Asked,
        page: LivePage | None,
        is_done: Callable[[], None],
    ) -> None:
        self.counts = Counts()
        self._is_done = is_done
        self._source, self._reader, self._out = source, reader, out
        self._asked, self._page = asked, page
        self._records: Records | None = None
        self._watch: LightWatch | None = None
        self._light_moved = False
        self._writers: list[Writer] = []
        self._pending: deque[Future[None]] = deque()
        self._other_size: deque[LostFrame] = deque()
        self._pool = ThreadPoolExecutor(1)
        self._reads_pads = asked.pads or _is_one_picture(source)

    def follow(self, start: Start, most: int) -> None:
        """Read the source to its end, or as many frames as are asked for.

        Args:
            start: begins to look for views.
            most: frames that are looked at in one go.

        Raises:
            UserError: the pictures have another size than the sensor's.
            OSError: something cannot be written.
        """
        with closing(arriving(self._source, start, most)) as arrivals:
            for arrival in arrivals:
                if self._is_of_other_size(arrival.item):
                    if len(self._other_size) == ENOUGH:
                        break
                    continue
                self._take(arrival)
                self._is_done()
                if self.counts.read == self._asked.frames:
                    break
        if self._other_size:
            self._refuse_other_size()

    def finish(self, sensor: Path) -> None:
        """Write what is left, and what the result is of."""
        while self._pending:
            self._pending.popleft().result()
        self._pool.shutdown()
        for writer in self._writers:
            writer.close()
        if self._records is None:
            return
        self._records.close()
        document = {
            "format": FORMAT,
            "command": "see",
            "source": self._source.name,
            "sensor": str(sensor),
            "frames": {
                "read": self.counts.read,
                "lost": self.counts.lost,
                "refused": self.counts.refused,
            },
        }
        write_document(self._out, document)

    def _take(self, arrival: Arrival) -> None:
        item = arrival.item
        while self._other_size:  # there are others, too
            self._print(self._note(self._other_size.popleft()))
        if isinstance(item, Frame):
            assert arrival.sighting is not None
            seen = self._seen(item, arrival)
            self.counts.add(seen, arrival.time)
            line = self._opened().add(seen)
            self._write(seen)
            if self._page is not None:
                self._page.show(seen, self.counts.brief)
            if _is_one_picture(self._source) and not self._asked.json:
                print("\n".join(reading_text(seen, self._reader.joints)))
        else:
            line = self._note(item)
        self._print(line)

    def _print(self, line: str) -> None:
        if self._asked.json:
            print(line, flush=True)

    def _note(self, item: LostFrame | Notice) -> str:
        if isinstance(item, LostFrame):
            self.counts.lost += item.count
        LOG.warning("%s", item)
        return self._opened().note(item)

    def _is_of_other_size(self, item: Item) -> bool:
        """Whether only pictures of another size have come so far, which are kept for later.

        One of them may be damaged; where they all are of that size, no folder is made.
        """
        if self._records is None and isinstance(item, LostFrame) and item.loss is Loss.OTHER_SIZE:
            self._other_size.append(item)
            return True
        return False

    def _refuse_other_size(self) -> NoReturn:
        raise UserError(
            f"{self._source.name}: {self._other_size[0]}, as the pictures of the sensor have; set "
            "the camera's resolution to that, or calibrate a sensor with such pictures"
        )

    def _seen(self, frame: Frame, arrival: Arrival) -> Seen:
        assert arrival.sighting is not None
        reading = self._reader.read(frame.image, arrival.sighting.result())
        pads = self._reader.read_pads(frame.image, reading) if self._reads_pads else {}
        light, moved = self._light(frame), self._light_moved
        return Seen(frame, reading, pads, light, moved, time.monotonic() - arrival.time)

    def _light(self, frame: Frame) -> Light | None:
        if isinstance(self._source, PictureFiles):
            return None
        if self._watch is None:
            self._watch = LightWatch(frame.image)
        light = self._watch.look(frame.image)
        if light.verdict:
            self._light_moved = light.verdict != BACK
            LOG.warning("%s: %s (its reference is the first)", frame.name, light.verdict)
        return light

    def _opened(self) -> Records:
        """The records, in a folder that is made for the first of them."""
        if self._records is None:
            if self._out.exists():
                remove_result(self._out.resolve())
            self._out.mkdir(parents=True)
            names = self._reader.joints, self._reader.pads
            self._records = Records(self._out, names[0], names[1] if self._reads_pads else ())
            if self._asked.overlay:
                is_files = isinstance(self._source, PictureFiles)
                kind = OverlayPictures if is_files else OverlayVideo
                self._writers.append(kind(self._out, *names))
            if self._asked.pads:
                self._writers.append(PadPictures(self._out, names[1]))
        return self._records

    def _write(self, seen: Seen) -> None:
        """Have pictures written in a thread, which is a few frames behind at most."""
        for writer in self._writers:
            self._pending.append(self._pool.submit(writer.add, seen))
        while len(self._pending) > MOST_PENDING:
            self._pending.popleft().result()


def _is_one_picture(source: Source) -> bool:
    return isinstance(source, PictureFiles) and len(source.paths) == 1


def reading_text(seen: Seen, joints: Sequence[str]) -> Iterator[str]:
    """A reading in words, line by line."""
    reading = seen.reading
    yield printable(seen.frame.name)
    yield from lines_of(seen, joints)
    yield f"misfit: {float(reading.misfit.rms):.2f} of the stated deviations of corners"
    for view in reading.sighting.views:
        quality = view.quality.name.lower().replace("_", " ")
        places = ", ".join(f"({column:.1f}, {row:.1f})" for column, row in view.corners.tolist())
        yield f"view of {view.pad}, {view.path}: {quality}; corners {places} px"
    for pad, shown in seen.pads.items():
        change = "no frame of the sensor shows it by that path"
        if shown.difference is not None:
            change = f"greatest change {100 * shown.change:.1f} %"
            if shown.contacts is None:
                change += f"; {NO_LIGHT}"
        yield f"pad {pad}, {shown.view.path}: {change}"
        yield from (contact_text(pad, one) for one in shown.contacts or [])
