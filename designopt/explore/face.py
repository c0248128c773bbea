"""The parts of a window and where they lie: drawing, sliders, readings, buttons, message."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.transforms import Bbox, ScaledTranslation, Transform, TransformedBbox
from matplotlib.widgets import Button, Slider

from designopt.explore.bench import Knob, Reading, number_text
from designopt.explore.painting import Painter, Patch
from designopt.plot.figures import PALETTE
from designopt.plot.quick_text import QuickText

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.text import Text

DPI = 100
WIDTH, HEIGHT = 1280, 760
"""Pixels, as are all places here; they are counted from the lower left corner."""

COLUMN = 868
"""Left of it the drawing and the readings, right of it the knobs."""
STRIP = 170
"""Below it the readings, above it the drawing."""
BUTTONS_TOP = 128
FOOT = 38
"""Below it the message."""
MARGIN = 12
HEADING = 24
TALLEST_ROW = 26
TRACK = (1030, 1180)
"""Left and right end of the sliders; names left of them, values right of them."""
LETTERS, WORDS = 8.5, 9.0
"""Sizes of a knob's name and value and of the message, points."""
PITCH = 10.0
"""From one line of the message to the next, points."""
HALF = 0.36
"""Half the height of capitals, as a part of a text's size."""
GAP = 6
"""Between buttons."""
ROWS_OF_READINGS = (7, 10)
"""What looks best, and the most of a column."""

INK, SOFT, LINE, TINT, HOVER = "#1b2530", "#55636f", "#d5dce2", "#f3f6f8", "#dfe7ee"
KIND = {"joint": ("Joints", PALETTE[0]), "dimension": ("Dimensions", PALETTE[2])}


def draw_rules(figure: Figure) -> None:
    """Thin lines between the parts."""
    axes = _axes(figure, 0, 0, WIDTH, HEIGHT)
    for x, y in (((0, WIDTH), (FOOT, FOOT)), ((COLUMN, COLUMN), (FOOT, HEIGHT))):
        axes.plot(x, y, color=LINE, linewidth=0.8)
    axes.plot((MARGIN, COLUMN - MARGIN), (STRIP, STRIP), color=LINE, linewidth=0.8)
    axes.set(xlim=(0, WIDTH), ylim=(0, HEIGHT), zorder=-1)


def drawing_area(figure: Figure) -> SubFigure:
    """Where the bench draws."""
    grid = figure.add_gridspec(
        2, 2, width_ratios=(COLUMN, WIDTH - COLUMN), height_ratios=(HEIGHT - STRIP, STRIP)
    )
    return figure.add_subfigure(grid[0, 0], facecolor="white")


class KnobRow:
    """A knob's slider.

    Attributes:
        knob: the knob.
        slider: it; the mouse moves it in round steps, and to the knob's ends and first value.
        patch: its row, with what moves in it.
    """

    def __init__(self, knob: Knob, painter: Painter, figure: Figure, y: float, tall: float) -> None:
        self.knob = knob
        thick = min(9.0, tall / 2)
        axes = _axes(figure, TRACK[0], y + (tall - thick) / 2, TRACK[1] - TRACK[0], thick)
        color = KIND[knob.kind][1]
        step = round_step(knob.high - knob.low, TRACK[1] - TRACK[0])
        self.slider = Slider(
            axes,
            knob.name,
            knob.low,
            knob.high,
            valinit=knob.value,
            valfmt=lambda value: with_unit(f"{value:.5g}", knob.unit),  # pyright: ignore[reportArgumentType]
            initcolor=SOFT,
            track_color=LINE,
            handle_style={"edgecolor": color, "facecolor": "white", "size": min(9.0, thick)},
            facecolor=color,
            alpha=0.55,
        )
        self.slider.valstep = stops(knob, step)
        self.slider.drawon = False
        middle = (y + tall / 2) / HEIGHT
        style: dict[str, Any] = {"size": LETTERS, "color": INK, "va": "baseline"}
        style["transform"] = _raised(figure, -HALF * LETTERS)
        self.slider.label.set(position=((COLUMN + MARGIN) / WIDTH, middle), ha="left", **style)
        words = self.slider.valtext.get_text()
        style |= {"ha": "right", "clip_on": False}
        number = QuickText((WIDTH - MARGIN) / WIDTH, middle, words, **style)
        self.slider.valtext.remove()
        axes.add_artist(number)
        self.slider.valtext = number
        fit(self.slider.label, TRACK[0] - COLUMN - 2 * MARGIN)
        moving = [self.slider.poly, *axes.lines, self.slider.valtext]
        self.patch = painter.patch(_box(figure, TRACK[0] - 9, y, WIDTH, y + tall), moving)

    @property
    def value(self) -> float:
        """Where it stands."""
        return float(self.slider.val)

    def put(self, value: float) -> None:
        """Move the slider and tell nobody."""
        self.slider.eventson = False
        self.slider.set_val(value)
        self.slider.eventson = True


def knob_rows(knobs: Sequence[Knob], painter: Painter, figure: Figure) -> list[KnobRow]:
    """Rows from the top, under a heading for each kind."""
    kinds = list(dict.fromkeys(knob.kind for knob in knobs))
    room = HEIGHT - MARGIN / 2 - BUTTONS_TOP - HEADING * len(kinds) - MARGIN / 2
    tall = min(TALLEST_ROW, room / max(1, len(knobs)))
    headings = _axes(figure, 0, 0, WIDTH, HEIGHT)
    y = HEIGHT - MARGIN / 2
    rows = []
    for kind in kinds:
        y -= HEADING
        title, color = KIND[kind]
        headings.text(
            (COLUMN + MARGIN) / WIDTH,
            (y + 6) / HEIGHT,
            title,
            color=color,
            weight="bold",
            size=9,
            transform=headings.transAxes,
        )
        for knob in knobs:
            if knob.kind == kind:
                y -= tall
                rows.append(KnobRow(knob, painter, figure, y, tall))
    return rows


def push_buttons(names: Sequence[str], painter: Painter, figure: Figure) -> dict[str, PushButton]:
    """A row of buttons below the knobs, by name."""
    wide = (WIDTH - COLUMN - 2 * MARGIN + GAP) // len(names) - GAP
    lefts = [COLUMN + MARGIN + i * (wide + GAP) for i in range(len(names))]
    return {
        name: PushButton(name, painter, figure, left, wide)
        for name, left in zip(names, lefts, strict=True)
    }


class PushButton:
    """A button.

    Attributes:
        button: it.
        patch: its place.
    """

    def __init__(
        self, name: str, painter: Painter, figure: Figure, left: float, wide: float
    ) -> None:
        bottom, tall = BUTTONS_TOP - 34, 28
        axes = _axes(figure, left, bottom, wide, tall)
        axes.set_axis_on()
        self.button = Button(axes, name, color=TINT, hovercolor=HOVER)
        self.button.drawon = False
        self.button.label.set(size=9, color=INK)
        for spine in axes.spines.values():
            spine.set(visible=True, color="#b8c4ce", linewidth=0.8)
        rim = GAP // 2  # its edge is as thick as a line
        box = _box(figure, left - rim, bottom - rim, left + wide + rim, bottom + tall + rim)
        self.patch = painter.patch(box, [axes])
        self._drawn = axes.get_facecolor()

    def has_changed_color(self) -> bool:
        """Whether the mouse has come over it or left it since the last time."""
        before, self._drawn = self._drawn, self.button.ax.get_facecolor()
        return before != self._drawn


def draw_hint(figure: Figure, words: str) -> None:
    """A few small lines under the buttons."""
    tall = BUTTONS_TOP - 38 - FOOT
    axes = _axes(figure, COLUMN, FOOT, WIDTH - COLUMN, tall)
    lines = textwrap.wrap(words, 80, max_lines=4, placeholder=" …")
    hint = axes.text(
        MARGIN / (WIDTH - COLUMN), 0.95, "\n".join(lines), size=7.5, color=SOFT, va="top"
    )
    # Small letters are a little wider where there are more pixels for them.
    fit(hint, 0.95 * (WIDTH - COLUMN - 2 * MARGIN))


class ReadingsTable:
    """Names, numbers and units below the drawing."""

    def __init__(self, painter: Painter, figure: Figure) -> None:
        self._axes = _axes(figure, 0, FOOT, COLUMN, STRIP - FOOT)
        self._numbers: list[QuickText] = []
        self._patch = painter.patch(_box(figure, 0, FOOT + 1, COLUMN - 1, STRIP - 1))

    def put(self, readings: Sequence[Reading]) -> list[Patch]:
        """Show these, and return what must be painted; names and places are the first ones'."""
        if not self._numbers:
            self._make(readings)
        words = [number_text(reading.value) for reading in readings]
        if words == [text.get_text() for text in self._numbers]:
            return []
        for text, number in zip(self._numbers, words, strict=True):
            text.set_text(number)
        return [self._patch]

    def _make(self, readings: Sequence[Reading]) -> None:
        few, most = ROWS_OF_READINGS
        columns = max(2, math.ceil(len(readings) / most))
        rows = max(few, math.ceil(len(readings) / columns))
        top, tall = STRIP - 6, (STRIP - FOOT - 8) / rows
        self._axes.set(xlim=(0, COLUMN), ylim=(FOOT, STRIP))
        wide = (COLUMN - MARGIN) / columns
        size = min(8.5, 0.64 * tall)
        unit, number = 6 * size, 10.5 * size
        for i, reading in enumerate(readings):
            left, y = MARGIN + wide * (i // rows), top - tall * (i % rows + 1)
            right, foot = left + wide - MARGIN - unit, y + tall / 2 - 0.5 * size
            name = self._axes.text(left, foot, reading.name, size=size, color=SOFT)
            fit(name, right - number - left)
            self._axes.text(right + 4, foot, reading.unit, size=size, color=SOFT, parse_math=False)
            style = {"color": INK, "ha": "right", "weight": "bold", "size": size}
            self._numbers.append(QuickText(right, foot, "", clip_on=False, **style))
            self._axes.add_artist(self._numbers[-1])
        self._patch.put(self._numbers)


class MessageLine:
    """One line at the foot of the window, or two."""

    def __init__(self, painter: Painter, figure: Figure) -> None:
        axes = _axes(figure, 0, 0, WIDTH, FOOT - 1)
        middle = (FOOT - 1) / 2 / HEIGHT
        self._figure = figure
        style = {"size": WORDS, "clip_on": False}
        self._lines = [QuickText(MARGIN / WIDTH, middle, "", **style) for _ in range(2)]
        for text in self._lines:
            axes.add_artist(text)
        self._shown: tuple[list[str], bool] = [], False
        self._patch = painter.patch(_box(figure, 0, 0, WIDTH, FOOT - 1), self._lines)

    def put(self, words: str, fault: bool) -> list[Patch]:
        """Show these words, and return what must be painted."""
        # A file's name can hold any of Unicode's line breaks.
        one = " ".join(words.split())
        lines = textwrap.wrap(one, 185, max_lines=len(self._lines), placeholder=" …")
        if (lines, fault) == self._shown:
            return []
        self._shown = lines, fault
        up = PITCH * (len(lines) - 1) / 2 - HALF * WORDS
        for text, line in zip(self._lines, (*lines, "", ""), strict=False):
            text.set(text=line, color="#a33c00" if fault else INK)
            text.set_transform(_raised(self._figure, up))
            up -= PITCH
        return [self._patch]


def round_step(span: float, stops: float) -> float:
    """The least of 1, 2 or 5 times a power of ten that divides a range into no more stops."""
    power = 10.0 ** math.floor(math.log10(span / stops))
    return next(power * digit for digit in (1, 2, 5, 10) if span <= power * digit * stops)


def stops(knob: Knob, step: float) -> Float[np.ndarray, "stops"]:
    """Where the mouse can put a knob: multiples of a step, its ends and its first value."""
    first, last = math.ceil(knob.low / step), math.floor(knob.high / step)
    places = max(0, -math.floor(math.log10(step)))
    multiples = np.round(np.arange(first, last + 1) * step, places)
    return np.unique(np.concatenate([multiples, [knob.low, knob.high, knob.value]]))


def with_unit(number: str, unit: str) -> str:
    """A number with its unit, as it is printed."""
    return number + ("" if unit == "°" else " ") + unit if unit else number


def fit(text: Text, wide: float) -> None:
    """Make a text smaller if it is wider than so many pixels."""
    text.set_parse_math(False)
    found = text.get_window_extent().width
    if found > wide:
        text.set_fontsize(float(text.get_fontsize()) * wide / found)


def _axes(figure: Figure, left: float, bottom: float, wide: float, tall: float) -> Axes:
    axes = figure.add_axes((left / WIDTH, bottom / HEIGHT, wide / WIDTH, tall / HEIGHT))
    axes.set_axis_off()
    axes.set_navigate(False)
    return axes


def _raised(figure: Figure, points: float) -> Transform:
    """From parts of the figure to the display, and so many points up."""
    up = ScaledTranslation(0.0, points / 72, figure.dpi_scale_trans)  # pyright: ignore[reportArgumentType]
    return figure.transFigure + up


def _box(figure: Figure, left: float, bottom: float, right: float, top: float) -> TransformedBbox:
    corners = Bbox([(left / WIDTH, bottom / HEIGHT), (right / WIDTH, top / HEIGHT)])
    return TransformedBbox(corners, figure.transFigure)
