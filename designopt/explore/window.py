"""A bench in a figure: its drawing, a slider per knob, its readings, buttons and a message."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.errors import UserError
from designopt.explore.bench import Bench, Reading, Step, Values
from designopt.explore.face import (
    KnobRow,
    MessageLine,
    PushButton,
    ReadingsTable,
    draw_hint,
    draw_rules,
    drawing_area,
    knob_rows,
    push_buttons,
)
from designopt.explore.painting import Painter, Patch
from designopt.explore.saving import save_picture, save_specs

if TYPE_CHECKING:
    from matplotlib.backend_bases import Event, TimerBase
    from matplotlib.figure import Figure

RESET, PICTURE, SPEC, OPTIMISE, STOP = "Reset", "Save picture", "Save spec", "Optimise", "Stop"

Listener = Callable[[Sequence[Reading], str], None]
"""Is told the readings and the message whenever they are shown."""


class Window:
    """A bench that a person turns.

    Attributes:
        rows: a row per knob, in the bench's order.
        buttons: by the name they have at first.
        readings: the numbers as they were last shown.
        message: the words that were last shown.
    """

    def __init__(
        self,
        bench: Bench,
        figure: Figure,
        name: str,
        folder: Path,
        listener: Listener = lambda readings, message: None,
    ) -> None:
        """Draw it.

        Args:
            bench: with its knobs.
            figure: empty, of `face.WIDTH` by `face.HEIGHT` pixels, on a canvas that draws by Agg.
            name: of the saved pictures.
            folder: where pictures and specs are saved.
            listener: is told what is shown, every time.
        """
        self._bench, self._figure = bench, figure
        self._name, self._folder, self._listener = name, folder, listener
        self._note, self._note_is_fault = "", False
        self._steps: Iterator[Step] | None = None
        self._taken = 0
        self._unpainted: dict[Patch, None] = {}
        self._scheduled, self._moved, self._told = False, True, False
        self._later = self._timer(self.present)
        self._next = self._timer(self._iterate)
        self._painter = Painter(figure)
        self._make()
        self._show()
        # Axes are placed once, and stay there: what is kept as pixels must not move.
        figure.set_layout_engine("constrained", w_pad=0.1, h_pad=0.1)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        self._show()  # in their places
        self._painter.draw()

    def _make(self) -> None:
        bench, figure, painter = self._bench, self._figure, self._painter
        draw_rules(figure)
        self._area = drawing_area(figure)
        self._picture = painter.patch(self._area.bbox)
        self.rows: list[KnobRow] = knob_rows(bench.knobs, painter, figure)
        for row in self.rows:
            row.slider.on_changed(lambda _, row=row: self._turned(row))
        self._readings = ReadingsTable(painter, figure)
        self._message = MessageLine(painter, figure)
        actions: dict[str, Callable[[], None]] = {
            RESET: self._reset,
            PICTURE: self._save_picture,
            SPEC: self._save_spec,
        }
        if bench.aim:
            actions[OPTIMISE] = self._start_or_stop
            draw_hint(figure, f"{OPTIMISE}: {bench.aim}")
        self.buttons: dict[str, PushButton] = push_buttons(list(actions), painter, figure)
        for name, push in self.buttons.items():
            push.button.on_clicked(lambda _, action=actions[name]: self._try(action))
        figure.canvas.mpl_connect("motion_notify_event", self._hover)
        figure.canvas.mpl_connect("resize_event", self._resized)
        bench.draw(self._area)

    def _timer(self, action: Callable[[], None]) -> TimerBase:
        timer = self._figure.canvas.new_timer(interval=1)
        timer.single_shot = True
        timer.add_callback(self._try, action)
        return timer

    def _try(self, action: Callable[[], object]) -> None:
        """Do something, and say what is the matter if it fails: the window goes on."""
        try:
            action()
        except UserError as error:
            self._end()
            self._say(str(error), fault=True)
        except Exception as error:  # a bench is anyone's code
            self._end()
            traceback.print_exc()
            self._say(f"This failed: {type(error).__name__}: {error}", fault=True)

    @property
    def values(self) -> dict[str, float]:
        """Where the knobs stand."""
        return {row.knob.name: row.value for row in self.rows}

    @property
    def optimising(self) -> bool:
        """Whether an optimisation is under way."""
        return self._steps is not None

    def present(self) -> None:
        """Compute and draw what has changed since the last time."""
        self._scheduled = False
        if self._moved:
            self._show()
        self._painter.paint(self._unpainted)
        self._unpainted.clear()

    def _soon(self, *patches: Patch) -> None:
        """Draw these, and what else has changed, when all events that have come are dealt with."""
        self._unpainted |= dict.fromkeys(patches)
        if not self._scheduled:
            self._scheduled = True
            self._later.start()

    def _show(self) -> None:
        self._moved = False
        self._shown = self._bench.show(self.values)
        self.readings = self._shown.readings
        self._picture.put(self._shown.artists)
        self._unpainted |= dict.fromkeys([self._picture, *self._readings.put(self.readings)])
        self._tell()

    def _tell(self) -> None:
        self.message = " ".join(filter(None, (self._note, self._shown.message)))
        fault = self._note_is_fault or bool(self._shown.message)
        self._unpainted |= dict.fromkeys(self._message.put(self.message, fault))
        self._listener(self.readings, self.message)

    def _say(self, note: str, fault: bool = False) -> None:
        self._note, self._note_is_fault = note, fault
        self._tell()
        self._soon()

    def _turned(self, row: KnobRow) -> None:
        """A person has moved a slider."""
        self._end()
        self._note, self._note_is_fault, self._moved = "", False, True
        self._soon(row.patch)

    def _resized(self, _: Event) -> None:
        """Show the bench anew, before it is drawn in axes of another shape."""
        self._try(self._show)

    def _hover(self, _: Event) -> None:
        for push in self.buttons.values():
            if push.has_changed_color():
                self._soon(push.patch)

    def _put(self, values: Values) -> None:
        for row in self.rows:
            row.put(values[row.knob.name])
            self._unpainted[row.patch] = None
        self._moved = True

    def _reset(self) -> None:
        self._end()
        self._put({row.knob.name: row.knob.value for row in self.rows})
        self._say("")

    def _save_picture(self) -> None:
        self.present()  # what is saved is what the sliders say
        try:
            paths = save_picture(self._figure, self._folder, self._name)
        finally:
            self._painter.draw()  # the canvas has drawn in another size meanwhile
        self._say(_saved(paths))

    def _save_spec(self) -> None:
        specs = self._bench.specs(self.values)
        titles = dict.fromkeys(spec.title for spec in specs if spec.title)
        self._say(_saved(save_specs(specs, self._folder), "; ".join(titles)))

    def _start_or_stop(self) -> None:
        if self._steps is not None:
            self._end()
            self._say(f"Stopped after {self._taken} iteration{'s' * (self._taken != 1)}.")
            return
        self._steps = self._bench.optimise(self.values)
        self._taken = 0
        self._label(STOP)
        self._say("Optimising … The first iteration takes longest.")
        self._next.start()

    def _iterate(self) -> None:
        if self._steps is None:
            return
        step = next(self._steps, None)
        if step is None:
            self._end()
            return
        self._taken += 1
        self._put(step.values)
        self._note, self._note_is_fault = step.message, False
        self.present()
        self._next.start()

    def _end(self) -> None:
        """Leave the optimisation where it is."""
        if self._steps is not None:
            self._steps = None
            self._label(OPTIMISE)

    def _label(self, words: str) -> None:
        push = self.buttons[OPTIMISE]
        push.button.label.set_text(words)
        self._soon(push.patch)


def _saved(paths: Sequence[Path], what: str = "") -> str:
    names = " and ".join(path.name for path in paths)
    return f"Saved {names} in {paths[0].parent.resolve()}{f': {what}' if what else ''}."
