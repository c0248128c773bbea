"""What all tabs of a page share: values, locks, bounds and their history, and what they give."""

from __future__ import annotations

import asyncio
import math
import sys
import traceback
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from designopt.errors import UserError, reason_of
from designopt.explore.explorer import Explorer, Numbers, number_text
from designopt.explore.messages import (
    Drag,
    Limit,
    Lock,
    Message,
    MessageError,
    Optimise,
    Preset,
    Save,
    SetValues,
    Signal,
)
from designopt.explore.saving import save_specs
from designopt.explore.wire import Wire, changed_fields, encode_panels, finite
from designopt.explore.worker import Worker
from designopt.optimize.parametric import (
    TOLERANCE,
    Measure,
    MeasureBound,
    Parameter,
    Values,
    shortfalls,
)
from designopt.programs import Prompt

if TYPE_CHECKING:
    from designopt.optimize.search_result import SearchStep

REST = 0.3
"""Seconds without a change after which requirements are judged."""

ECHO = 0.03
"""Seconds after a change at which its values are sent, if its picture did not take them along."""

DRAWING = 0.008
"""Seconds after a picture at which its numbers are begun: a browser that draws it needs all cores.
Well below a frame, or they would be computed after the next picture as a rule."""

LONGEST_HISTORY = 1000
MOST_PRESETS = 100
AS_DESIGNED = "as designed"
CHANGED = "stopped, for the design was changed"


@dataclass(frozen=True)
class Settings:
    """What a person can change, and undo.

    Attributes:
        values: of all joints and dimensions.
        locked: names of those that stay as they are.
        bounds: lowest and highest value of each.
    """

    values: Mapping[str, float]
    locked: frozenset[str]
    bounds: Mapping[str, tuple[float, float]]


class Shown(NamedTuple):
    """A picture on its way to the tabs.

    Attributes:
        values: what it is of.
        views: encoded.
        numbers: computes what is shown beside them.
    """

    values: Values
    views: list[Wire]
    numbers: Callable[[], Numbers]


class History:
    """Settings that can be undone; all changes of one gesture together."""

    def __init__(self, first: Settings) -> None:
        self.now = first
        self._past: list[Settings] = []
        self._future: list[Settings] = []
        self._gesture: Hashable = None

    def change(self, settings: Settings, gesture: Hashable = None) -> None:
        """Take other settings; a gesture of ``None`` is one of its own."""
        if settings == self.now:
            return
        if gesture is None or gesture != self._gesture:
            self._past = [*self._past[-LONGEST_HISTORY:], self.now]
        self._gesture, self._future, self.now = gesture, [], settings

    def undo(self) -> None:
        """Take the settings before the last gesture, if there are any."""
        if self._past:
            self._future.append(self.now)
            self.now, self._gesture = self._past.pop(), None

    def redo(self) -> None:
        """Take the settings that were undone last, if there are any."""
        if self._future:
            self._past.append(self.now)
            self.now, self._gesture = self._future.pop(), None

    @property
    def lengths(self) -> tuple[int, int]:
        """How many gestures can be undone and redone."""
        return len(self._past), len(self._future)


Send = Callable[[Wire, Mapping[Hashable, int] | None], None]
"""Sends fields to all tabs, with each tab's ``seq`` that a picture shows where it is one."""


class Session:
    """A design that is explored; everything is called in the event loop.

    The picture is computed in one thread, at once by NumPy; what compiles its programs, then
    requirements, optimisation and files, in a second one, for they may take seconds.

    Attributes:
        model: every field of what is shown, as it was sent.
        seqs: the last change taken of every tab.
    """

    def __init__(self, explorer: Explorer, folder: Path, send: Send) -> None:
        self._explorer, self._folder, self._send = explorer, folder, send
        self._design = design = explorer.design
        self._prompt, self._compiling, self._is_listed = Prompt(), False, False
        with self._prompt.answering():
            self.parameters = {one.name: one for one in (*explorer.joints, *design.parameters)}
        self._dimensions = [one.name for one in design.parameters]
        self._presets: dict[str, Values] = {AS_DESIGNED: explorer.values(), **explorer.presets}
        bounds = {name: (one.low, one.high) for name, one in self.parameters.items()}
        self._history = History(Settings(explorer.values(), frozenset(), bounds))
        self.seqs: dict[Hashable, int] = {}
        self._changes, self._pictured = 0, explorer.values()
        self._judged: tuple[Values, Mapping[str, float]] | None = None
        self._search: Iterator[SearchStep] | None = None
        self._rest: asyncio.TimerHandle | None = None
        self._echo: asyncio.TimerHandle | None = None
        self._picture, self._slow = Worker(), Worker()
        self.model: Wire = {
            "title": design.title,
            "parameters": [
                _parameter(one, joint=one in explorer.joints) for one in self.parameters.values()
            ],
            "measures": [],  # listed once they are known
            "panels": [],
            "readouts": None,
            "message": "",
            "note": "",
            "note_is_fault": False,
            "requirements": [],  # what a design asks for may follow from what it is judged to be
            "judging": True,
            "measured": {},
            "optimising": "",
            "step": "",
            "report": [],
            **self._settings(),
        }
        self._picture.submit("sketch", self._sketch, self._sketched)
        self._show()

    def whole(self) -> Wire:
        """Every field, with settings that wait to be sent."""
        return self.model | self._settings()

    def end(self) -> list[Worker]:
        """Begin no further computation, only save what was asked for; returns what still works."""
        for worker in (workers := [self._picture, self._slow]):
            worker.end()
        return workers

    def take(self, tab: Hashable, message: Message) -> None:
        """Do what a tab asks for.

        Raises:
            MessageError: a name in the message is none of the design's.
        """
        match message:
            case SetValues():
                self._known(message.values, self.parameters)
                self._set(message.values, (tab, message.gesture), {tab: message.seq})
            case Drag():
                self.seqs[tab] = message.seq
                self._drag(message, (tab, message.gesture))
            case Lock(name=name, locked=locked):
                self._known([name], self.parameters)
                held = self._now.locked
                self._change(replace(self._now, locked=held | {name} if locked else held - {name}))
            case Limit():
                self._limit(message)
            case Signal(type="undo"):
                self._change_history(self._history.undo)
            case Signal(type="redo"):
                self._change_history(self._history.redo)
            case Signal(type="stop"):
                self._stop("stopped; undo leads back to where it began")
            case Preset(type="store", name=name):
                self._store(name.strip())
            case Preset(name=name):
                self._known([name], self._presets)
                self._set(self._presets[name])
            case Optimise(measure=measure):
                self._known([measure], self._measures)
                self._optimise(measure)
            case Save(although_failing=although):
                values = self._now.values
                self._note("saving …")
                self._slow.submit(None, lambda: self._save(values, although), self._saved)

    def _known(self, names: Iterable[str], among: Iterable[str]) -> None:
        if unknown := set(names) - set(among):
            raise MessageError(f"no such name: {min(unknown)}")

    @cached_property
    def _measures(self) -> Mapping[str, Measure]:
        """By their names; a finger finds out which parts can meet before it has any."""
        return {one.name: one for one in self._design.measures}

    @property
    def _now(self) -> Settings:
        return self._history.now

    def _own(self, values: Values) -> dict[str, float]:
        """Those of the design, without the joints'."""
        return {name: values[name] for name in self._dimensions}

    def _design_values(self) -> dict[str, float]:
        return self._own(self._now.values)

    def _settings(self) -> Wire:
        past, future = self._history.lengths
        return {
            "values": dict(self._now.values),
            "locked": sorted(self._now.locked),
            "bounds": {name: list(both) for name, both in self._now.bounds.items()},
            "undo": past,
            "redo": future,
            "presets": list(self._presets),
        }

    # What a person changes.

    def _set(
        self, values: Values, gesture: Hashable = None, seqs: Mapping[Hashable, int] | None = None
    ) -> None:
        self._note("")
        allowed = self._allowed(values, note=True)
        self._change(replace(self._now, values={**self._now.values, **allowed}), gesture, seqs)

    def _allowed(self, values: Values, *, note: bool = False) -> dict[str, float]:
        """Values within their bounds, of those that are numbers and not locked."""
        allowed = {}
        for name, value in values.items():
            if not math.isfinite(value):  # of a drag that leads nowhere
                continue
            low, high = self._now.bounds[name]
            if name in self._now.locked:
                if note and value != self._now.values[name]:
                    self._note(f"{self._label(name)} is locked and stays as it is; unlock it first")
                continue
            allowed[name] = min(max(value, low), high)
            if note and allowed[name] != value:
                unit = f" {self.parameters[name].unit}".rstrip()
                self._note(f"{self._label(name)} stays within {low:g} and {high:g}{unit}")
        return allowed

    def _drag(self, message: Drag, gesture: Hashable) -> None:
        handles = {
            name: parameters
            for panel in self.model["panels"]
            for name, _, _, parameters in panel.get("handles", ())
        }
        if (locked := self._now.locked.intersection(handles.get(message.handle, ()))) or (
            message.handle not in handles
        ):
            for name in sorted(locked):
                self._note(f"{message.handle} stays where it is: {self._label(name)} is locked")
            return
        self._stop(CHANGED)
        before, place, seqs = self._now, (message.x, message.y), dict(self.seqs)

        def compute() -> tuple[dict[str, float], Shown]:
            with self._prompt.answering():
                dragged = self._explorer.drag(before.values, message.handle, place)
            own = {name: dragged[name] for name in handles[message.handle] if name in dragged}
            changed = self._allowed(own)
            return changed, self._shown({**before.values, **changed})

        def done(future: Future, changes: int = self._changes) -> None:
            found = self._result(future)
            if found is None:
                self._follow_up()
            if found is None or changes != self._changes:
                return
            changed, shown = found
            now = {**self._now.values, **changed}
            self._change(replace(self._now, values=now), gesture, is_shown=True)
            if now == {**before.values, **changed}:
                self._publish_shown(shown, seqs)
            else:  # another handle was dragged meanwhile
                self._show()

        self._picture.submit(f"drag {message.handle}", compute, done)

    def _limit(self, message: Limit) -> None:
        self._known([message.name], self.parameters)
        one, value = self.parameters[message.name], self._now.values[message.name]
        # Bounds hold what they bound, and stay where the design is known to exist.
        low = max(one.low, min(message.low, value))
        high = min(one.high, max(message.high, value))
        self._note("")
        if (low, high) != (message.low, message.high):
            self._note(
                f"bounds of {self._label(one.name)} lie between {one.low:g} and {one.high:g}, and "
                f"hold its value, {number_text(value)}"
            )
        self._change(replace(self._now, bounds={**self._now.bounds, one.name: (low, high)}))

    def _store(self, name: str) -> None:
        if name == AS_DESIGNED or name in self._explorer.presets:
            self._note(f"“{name}” is the design's own; choose another name", is_fault=True)
        elif len(self._presets) >= MOST_PRESETS:
            self._note(f"there are {MOST_PRESETS} already, which is the most", is_fault=True)
        else:
            self._presets[name] = dict(self._now.values)
            self._publish(presets=list(self._presets))
            self._note(f"stored as “{name}” until the command ends")

    def _change_history(self, action: Callable[[], None]) -> None:
        self._note("")
        self._stop("stopped")
        action()
        self._changed()

    def _change(
        self,
        settings: Settings,
        gesture: Hashable = None,
        seqs: Mapping[Hashable, int] | None = None,
        *,
        is_shown: bool = False,
    ) -> None:
        self._stop(CHANGED)
        self.seqs |= seqs or {}  # no earlier: values are sent with what they are the answer to
        self._history.change(settings, gesture)
        self._changed(is_shown=is_shown)

    def _changed(self, *, is_shown: bool = False) -> None:
        """Show what follows from other settings; a drag's picture is computed with its values.

        The settings are sent along with what is sent next, the picture as a rule: a browser takes
        long over a message.
        """
        values = self._own(self.model["values"])
        if not is_shown:
            self._changes += 1
            self._show()
        if self._echo is None:
            self._echo = asyncio.get_running_loop().call_later(ECHO, self._publish)
        if values == self._design_values():
            return
        self._judge_soon()
        if self._search is None and self.model["step"] not in ("", CHANGED):
            self._publish(step="", report=[])  # they are another design's

    # What is shown.

    def _show(self) -> None:
        values, seqs, changes = self._now.values, dict(self.seqs), self._changes

        def done(future: Future) -> None:
            shown = self._result(future)
            # Not after the picture of a drag that has ended meanwhile.
            is_old = changes == self._changes and values != self._now.values
            if shown is None or is_old:
                self._follow_up()
            else:
                self._publish_shown(shown, seqs)

        self._picture.submit("show", lambda: self._shown(values), done)

    def _shown(self, values: Values) -> Shown:
        with self._prompt.answering():
            views, numbers = self._explorer.show(values)
        return Shown(values, encode_panels(views), numbers)

    def _publish_shown(self, shown: Shown, seqs: Mapping[Hashable, int]) -> None:
        self._pictured = shown.values
        self._publish(seqs, panels=[*shown.views, *self._panels("chart")])

        def compute() -> tuple[Numbers, list[Wire]]:
            with self._prompt.answering():
                numbers = shown.numbers()
            return numbers, encode_panels(numbers.charts)

        def done(future: Future) -> None:
            if (found := self._result(future)) is not None:
                numbers, charts = found
                # Another picture may have come before these numbers.
                notes = numbers.notes if shown.values == self._pictured else {}
                views = [
                    {**one, "notes": {**one["notes"], **notes.get(one["name"], {})}}
                    for one in self._panels("view")
                ]
                readouts = [
                    [one.name, number_text(one.value), one.unit] for one in numbers.readouts
                ]
                self._publish(panels=[*views, *charts], readouts=readouts, message=numbers.message)
            elif known := self.model["readouts"]:  # they are another picture's
                self._publish(readouts=[[name, "–", unit] for name, _, unit in known], message="")
            self._follow_up()

        asyncio.get_running_loop().call_later(
            DRAWING, lambda: self._picture.submit("numbers", compute, done, first=True)
        )

    def _panels(self, kind: str) -> list[Wire]:
        return [one for one in self.model["panels"] if one["kind"] == kind]

    def _follow_up(self) -> None:
        """Begin in the second thread what can wait until something is shown."""
        if not self._is_listed:
            self._is_listed = True
            self._slow.submit("measures", self._list_measures, self._listed)
        if self._judged is None and self._rest is None:
            self._judge_soon()
        if self._prompt.is_behind and not self._compiling:
            self._compiling = True
            self._slow.submit("compile", self._prompt.compile, self._compiled)

    def _sketch(self) -> list[Wire]:
        with self._prompt.answering():
            return encode_panels(self._explorer.sketch())

    def _list_measures(self) -> list[list[str]]:
        measures = self._design.measures
        return [[one.name, one.description, one.unit, one.worst] for one in measures]

    def _listed(self, future: Future) -> None:
        if (measures := self._result(future)) is not None:
            self._publish(measures=measures)

    def _compiled(self, future: Future) -> None:
        """Show what is computed by compiled programs alone."""
        self._compiling = False
        self._result(future)
        self._show()

    def _sketched(self, future: Future) -> None:
        if (panels := self._result(future)) is not None:
            self._publish(panels=panels)

    def _publish(self, shown: Mapping[Hashable, int] | None = None, **fields: Any) -> None:
        """Send what has changed, with settings that wait to be sent.

        Args:
            shown: each tab's ``seq``, where a picture is sent.
            fields: of the model.
        """
        if self._echo is not None:
            self._echo.cancel()
            self._echo = None
            fields = {**self._settings(), **fields}
        changed = changed_fields(fields, self.model)
        if "values" in fields:  # a slider that was led back to its bound
            changed["values"] = fields["values"]
        self.model |= fields
        self._send(changed, shown)

    def _note(self, text: str, *, is_fault: bool = False) -> None:
        if (text, is_fault) != (self.model["note"], self.model["note_is_fault"]):
            self._publish(note=text, note_is_fault=is_fault)

    def _label(self, name: str) -> str:
        return self.parameters[name].label or name

    def _result(self, future: Future) -> Any:
        """What a job returned; ``None`` after its fault is shown."""
        try:
            return future.result()
        except UserError as error:
            self._note(str(error), is_fault=True)
        except Exception as error:  # a design is anyone's code
            traceback.print_exception(error, file=sys.stderr)
            self._note(f"this failed: {type(error).__name__}: {reason_of(error)}", is_fault=True)
        return None

    # What is asked for.

    def _judge_soon(self) -> None:
        if self._rest is not None:
            self._rest.cancel()
        self._rest = asyncio.get_running_loop().call_later(REST, self._judge)
        if not self.model["judging"]:
            self._publish(judging=True)

    def _judge(self) -> None:
        if self._search is not None:  # its last step is judged
            return
        values = self._design_values()
        if self._judged is not None and self._judged[0] == values:
            self._publish(judging=False)
            return

        def done(future: Future) -> None:
            if values != self._design_values():
                return
            try:
                self._judged = values, future.result()
            except UserError as error:
                self._judged = None
                rows = [[str(one), None, None, False] for one in self._design.requirements]
                self._publish(requirements=rows, measured={}, judging=False)
                self._note(str(error), is_fault=True)
                return
            except Exception:
                self._result(future)
                self._publish(judging=False)
                return
            self._publish(**self._rows(self._judged[1]), judging=False)

        self._slow.submit("judge", lambda: self._design.judge(values), done)

    def _rows(self, judged: Mapping[str, float]) -> Wire:
        """Requirements, those first that are missed or nearest to it; and all measures."""
        rows = []
        missed = [bound for bound, _ in self._missed(judged)]

        def nearness(bound: MeasureBound) -> float:
            measure = self._measures[bound.measure]
            return bound.margin(judged[bound.measure]) / measure.scale

        for bound in sorted(self._design.requirements, key=nearness):
            measure = self._measures[bound.measure]
            value, margin, unit = (
                judged[bound.measure],
                bound.margin(judged[bound.measure]),
                measure.unit,
            )
            if abs(margin) < TOLERANCE * measure.scale:  # rounding
                value, margin = bound.value, 0.0
            signed = f"{margin:+.4g}".replace("-", "−")
            rows.append(
                [str(bound), _with_unit(value, unit), f"{signed} {unit}", bound not in missed]
            )
        measured = {
            name: _with_unit(judged[name], one.unit) for name, one in self._measures.items()
        }
        return {"requirements": rows, "measured": measured}

    def _save(self, values: Values, although_failing: bool) -> list[Path]:
        """In the second thread: nothing is saved before it is judged."""
        known, own = self._judged, self._own(values)
        judged = known[1] if known and known[0] == own else self._design.judge(own)
        fails = [self._fault(bound, margin) for bound, margin in self._missed(judged)]
        if fails and not although_failing:
            raise UserError(
                f"not saved, for it fails {len(fails)} of {len(self._design.requirements)} "
                f"requirements: {'; '.join(fails)}; mark “although it fails” to save it as failing"
            )
        return save_specs(self._design.files(values), self._folder, fails)

    def _missed(self, judged: Mapping[str, float]) -> list[tuple[MeasureBound, float]]:
        return shortfalls(self._design.measures, judged, self._design.requirements)

    def _fault(self, bound: MeasureBound, margin: float) -> str:
        missed = _with_unit(abs(margin), self._measures[bound.measure].unit)
        return f"{bound} (missed by {missed})"

    def _saved(self, future: Future) -> None:
        if (paths := self._result(future)) is not None:
            names = " and ".join(path.name for path in paths)
            self._note(f"saved {names} in {self._folder.resolve()}")

    def _optimise(self, measure: str) -> None:
        self._stop("stopped")
        self._changes += 1  # a drag under way would stop it
        locked, bounds = self._now.locked, self._now.bounds
        free = {
            name: bounds[name]
            for name in self._design.free or self._dimensions
            if name not in locked and bounds[name][0] < bounds[name][1]
        }
        if not free:
            self._note(
                "every dimension that optimising may change is locked; unlock one", is_fault=True
            )
            return
        self._note("")
        self._search = self._steps(self._design_values(), measure, free)
        self._publish(optimising=measure, step="starting", report=[])
        self._next_step(("optimise", object()))

    def _steps(
        self, values: Values, measure: str, free: Mapping[str, tuple[float, float]]
    ) -> Iterator[SearchStep]:
        """In the second thread, which also loads what searches."""
        from designopt.optimize.design_search import search

        yield from search(self._design, values, measure, free, ())

    def _next_step(self, gesture: Hashable) -> None:
        """Compute one step, show it, go on."""
        steps = self._search
        assert steps is not None

        def done(future: Future) -> None:
            if steps is not self._search:  # stopped meanwhile
                return
            if (step := self._result(future)) is None:
                self._finish("")
                return
            values = {**self._now.values, **step.values}
            self._history.change(replace(self._now, values=values), gesture)
            self._changed()
            self._publish(step=step.message)
            if step.done:
                self._publish(report=list(step.report))
                self._finish(step.message)
            else:
                self._next_step(gesture)

        self._slow.submit("search", lambda: next(steps, None), done)

    def _stop(self, reason: str) -> None:
        if self._search is not None:
            self._finish(reason)

    def _finish(self, reason: str) -> None:
        self._search = None
        self._publish(optimising="", step=reason)
        self._judge_soon()


def _parameter(one: Parameter, *, joint: bool) -> Wire:
    fields = {"name": one.name, "label": one.label or one.name, "unit": one.unit}
    return fields | {"low": one.low, "high": one.high, "joint": joint}


def _with_unit(value: float, unit: str) -> str:
    text = number_text(finite(value)).replace("-", "−")
    return f"{text} {unit}".rstrip()
