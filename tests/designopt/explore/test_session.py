"""What tabs share: values, locks, bounds, history, requirements, files."""

import asyncio
import math
import os
import sys
import threading
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import pytest

from designopt.errors import UserError
from designopt.explore import session as sessions
from designopt.explore.explorer import ExplorerState, number_text
from designopt.explore.messages import MessageError, read_message
from designopt.explore.saving import save_specs
from designopt.explore.session import History, Session, Settings
from designopt.explore.wire import encode_panels
from designopt.io.spec import SpecFile
from designopt.programs import Program
from tests.designopt.explore import slider_crank
from tests.designopt.explore.slider_crank import LOCKED, SliderCrank
from tests.designopt.explore.whole import show


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a coroutine that is given a session, a way to talk to it and a way to wait."""
    module = type(sys)("designopt.optimize.design_search")
    module.search = slider_crank.search  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(sessions, "REST", 0.02)

    def run(guest, explorer=None):
        async def main():
            session = Session(explorer or SliderCrank(), tmp_path, lambda *_: None)

            def say(text, tab="tab"):
                session.take(tab, read_message(text.replace("'", '"')))

            async def until(condition):
                for _ in range(2000):
                    if condition(session.model):
                        return
                    await asyncio.sleep(0.01)
                raise AssertionError(f"it never came: {session.model}")

            await until(lambda model: model["readouts"] and not model["judging"])
            await guest(session, say, until)
            for worker in session.end():
                worker.join()

        asyncio.run(main())

    return run


def set_(name, value, gesture=0, seq=1):
    return f"{{'type':'set','values':{{'{name}':{value}}},'seq':{seq},'gesture':{gesture}}}"


def settings(value):
    return Settings({"x": value}, frozenset(), {"x": (0.0, 9.0)})


def test_changes_of_one_gesture_are_undone_together():
    history = History(settings(0.0))
    for value, gesture in ((1.0, "a"), (2.0, "a"), (3.0, "b"), (4.0, None), (5.0, None)):
        history.change(settings(value), gesture)
    found = [history.now.values["x"]]
    for _ in range(5):
        history.undo()
        found.append(history.now.values["x"])
    assert found == [5.0, 4.0, 3.0, 2.0, 0.0, 0.0]
    assert history.lengths == (0, 4)
    history.redo()
    history.change(settings(7.0), "a")  # another gesture than before undoing
    assert history.lengths == (2, 0)
    history.undo()
    assert history.now.values["x"] == 2.0


def test_values_stay_within_bounds_and_locks_hold(run):
    async def guest(session, say, until):
        say("{'type':'bounds','name':'radius','low':20,'high':40}")
        say(set_("radius", 99))
        assert session.model["note"] == "radius stays within 20 and 40 mm"
        await until(lambda model: model["values"]["radius"] == 40.0)
        say("{'type':'bounds','name':'radius','low':50,'high':1e9}")
        await until(lambda model: model["bounds"]["radius"] == [40.0, 80.0])
        assert "hold its value, 40" in session.model["note"]
        say("{'type':'lock','name':'radius','locked':true}")
        say(set_("radius", 50))
        say("{'type':'preset','name':'as designed'}")
        say("{'type':'preset','name':'upright'}")
        await until(lambda model: model["values"]["crank"] == 90.0)
        assert session.model["values"]["radius"] == 40.0
        say("{'type':'drag','handle':'tip','x':10,'y':10,'seq':1,'gesture':1}")
        assert session.model["note"] == "tip stays where it is: radius is locked"

    run(guest)


def test_a_dragged_handle_changes_what_its_explorer_computes_within_bounds(run):
    async def guest(session, say, until):
        say("{'type':'bounds','name':'radius','low':20,'high':40}")
        say("{'type':'drag','handle':'tip','x':0,'y':60,'seq':7,'gesture':1}")
        await until(lambda model: model["values"]["crank"] == 90.0)
        assert session.model["values"]["radius"] == 40.0
        say("{'type':'drag','handle':'gone','x':0,'y':60,'seq':8,'gesture':1}")
        say("{'type':'undo'}")
        await until(lambda model: model["values"]["crank"] == 40.0)

    run(guest)


def test_a_drag_under_way_does_not_overwrite_what_is_undone(run):
    async def guest(session, say, until):
        say(set_("rod", 90))
        say("{'type':'drag','handle':'tip','x':0,'y':60,'seq':7,'gesture':1}")
        say("{'type':'undo'}")
        await asyncio.sleep(0.2)
        assert session.model["values"] == SliderCrank().values()

    run(guest)


def test_handles_dragged_at_once_keep_what_each_has_changed(run, monkeypatch):
    explorer = SliderCrank()
    drag, may_go_on = explorer.drag, threading.Event()

    def wait(*given):
        assert may_go_on.wait(20)
        return drag(*given)

    async def guest(session, say, until):
        monkeypatch.setattr(explorer, "drag", wait)
        say("{'type':'drag','handle':'tip','x':0,'y':60,'seq':1,'gesture':1}")
        say("{'type':'drag','handle':'slider','x':99,'y':0,'seq':2,'gesture':2}", "other")
        may_go_on.set()
        await until(lambda model: model["values"]["crank"] == 90.0)
        await until(lambda model: model["values"]["rod"] != 70.0)
        values = session.model["values"]
        assert (values["crank"], values["radius"]) == (90.0, 60.0)
        wanted = encode_panels(show(SliderCrank(), values).panels)
        await until(lambda model: model["panels"] == wanted)
        assert session.seqs == {"tab": 1, "other": 2}

    run(guest, explorer)


def test_a_drag_under_way_does_not_stop_what_is_begun_after_it(run):
    async def guest(session, say, until):
        say("{'type':'drag','handle':'slider','x':99,'y':0,'seq':1,'gesture':1}")
        say("{'type':'optimise','measure':'stroke'}")
        await until(lambda model: model["report"])
        assert session.model["step"] == "done"

    run(guest)


def test_a_drag_that_leads_nowhere_changes_nothing(run, monkeypatch):
    explorer = SliderCrank()
    dragged = {"crank": math.nan, "radius": 33.0}
    monkeypatch.setattr(explorer, "drag", lambda values, *_: {**values, **dragged})

    async def guest(session, say, until):
        say("{'type':'drag','handle':'tip','x':0,'y':60,'seq':1,'gesture':1}")
        await until(lambda model: model["values"]["radius"] == 33.0)
        assert session.model["values"]["crank"] == 40.0

    run(guest, explorer)


def test_a_pose_is_not_judged_and_a_design_judged_before_not_again(run):
    explorer = SliderCrank()
    judge, judged = explorer.design.judge, []
    explorer.design.judge = lambda values: judged.append(values) or judge(values)

    async def guest(session, say, until):
        say(set_("crank", 50))
        assert not session.model["judging"]
        say(set_("rod", 71))
        say("{'type':'undo'}")
        assert session.model["judging"]
        await until(lambda model: not model["judging"])
        assert judged == [SliderCrank().design.values()]

    run(guest, explorer)


def test_requirements_are_judged_after_rest_with_their_margins(run):
    async def guest(session, say, until):
        assert session.model["measured"]["stroke"] == "62.74 mm"
        say(set_("radius", 60))
        assert session.model["judging"]
        await until(lambda model: not model["judging"])
        [[asked, value, margin, met]] = session.model["requirements"]
        angle = math.degrees(math.asin(60 / 70))
        assert (asked, met) == ("rod within 45° of the guide", False)
        assert float(value.split()[0]) == pytest.approx(angle, abs=1e-3)
        assert margin == "−14 °"
        say(set_("rod", 25))
        await until(lambda model: "the crank cannot turn" in model["note"])
        assert session.model["requirements"][0][1:] == [None, None, False]
        say("{'type':'save','although_failing':true}")
        await until(lambda model: "cannot turn" in model["note"])

    run(guest)


def test_what_a_pose_lacks_is_a_message_beside_the_picture(run):
    async def guest(session, say, until):
        say(set_("rod", 20))
        say(set_("crank", 90, 1))
        await until(lambda model: model["message"] == LOCKED)
        assert session.model["readouts"][0] == ["slider's place", "–", "mm"]

    run(guest)


def test_the_newest_values_are_shown_and_those_between_left_out(run):
    explorer = SliderCrank()

    async def guest(session, say, until):
        shows = explorer.shows
        for number in range(200):
            say(set_("crank", number / 2, seq=number))
        await until(lambda model: model["panels"][1]["at"] == 99.5)
        assert explorer.shows - shows < 200

    run(guest, explorer)


class Slow(SliderCrank):
    """Its numbers wait for their turn; its drawing does not."""

    def __init__(self):
        super().__init__()
        self.turns_taken: Any = threading.Semaphore(1000)

    def show(self, values):
        turns, (views, numbers) = self.turns_taken, super().show(values)
        return ExplorerState(views, lambda: (turns.acquire(), numbers())[1])


def drawn(crank):
    """A test of whether the drawing of a crank's angle is shown, whatever the numbers are."""
    [wanted] = encode_panels([SliderCrank().view({**SliderCrank().values(), "crank": crank})])
    return lambda model: model["panels"][0]["shapes"] == wanted["shapes"]


def test_a_drawing_is_shown_before_its_numbers(run):
    explorer = Slow()

    async def guest(session, say, until):
        before = session.model["readouts"], session.model["panels"][1]
        explorer.turns_taken = threading.Semaphore(0)
        say(set_("crank", 99.0))
        await until(drawn(99.0))
        assert (session.model["readouts"], session.model["panels"][1]) == before
        explorer.turns_taken.release()
        await until(lambda model: model["panels"][1]["at"] == 99.0)
        assert session.model["readouts"] != before[0]

    run(guest, explorer)


def test_numbers_that_come_late_leave_the_newer_drawing(run):
    explorer = Slow()

    async def guest(session, say, until):
        explorer.turns_taken = threading.Semaphore(0)
        say(set_("crank", 99.0))
        await until(drawn(99.0))
        say(set_("crank", 120.0, 1))
        explorer.turns_taken.release()
        await until(lambda model: drawn(120.0)(model) and model["panels"][1]["at"] == 99.0)
        assert "crank pin" not in session.model["panels"][0]["notes"]
        explorer.turns_taken.release()
        await until(lambda model: model["panels"][1]["at"] == 120.0)
        assert drawn(120.0)(session.model)
        assert session.model["panels"][0]["notes"]["crank pin"] == "at 120°"

    run(guest, explorer)


def test_numbers_of_another_drawing_do_not_stay(run, capfd):
    explorer = Slow()

    async def guest(session, say, until):
        explorer.turns_taken = None  # its numbers fail
        say(set_("crank", 99.0))
        await until(lambda model: "AttributeError" in model["note"])
        assert drawn(99.0)(session.model)
        assert session.model["readouts"] == [
            ["slider's place", "–", "mm"],
            ["rod to crank", "–", ""],
        ]

    run(guest, explorer)
    assert "Traceback" in capfd.readouterr().err


def test_values_are_sent_with_their_picture_or_before_it_where_that_takes_long(run):
    explorer, sent = SliderCrank(), []

    async def guest(session, say, until):
        session._send = lambda fields, shown: sent.append((fields, shown, dict(session.seqs)))
        say(set_("crank", 99.0, seq=7))
        await until(lambda model: model["values"]["crank"] == 99.0)
        [(fields, shown, _)] = [one for one in sent if "values" in one[0]]
        assert fields["panels"]
        assert shown == {"tab": 7}
        await until(lambda model: model["panels"][1]["at"] == 99.0)
        entered, go_on = threading.Event(), threading.Event()
        session._picture.submit(None, lambda: (entered.set(), go_on.wait()), lambda _: None)
        entered.wait()
        sent.clear()
        say(set_("crank", 120.0, seq=8))
        await until(lambda model: model["values"]["crank"] == 120.0)
        assert not any("panels" in fields for fields, _, _ in sent)
        say(set_("radius", 99.0, seq=9))
        assert session.whole()["values"]["radius"] == 80.0
        go_on.set()
        await until(lambda model: model["values"]["radius"] == 80.0)
        # A tab that reads of its change as taken is sent its values at the same time.
        first = next(fields for fields, _, seqs in sent if fields and seqs == {"tab": 9})
        assert first["values"]["radius"] == 80.0

    run(guest, explorer)


def test_files_are_numbered_and_marked_where_the_design_fails(run, tmp_path):
    async def guest(session, say, until):
        (tmp_path / "raw-1.bin").touch()
        say("{'type':'save','although_failing':true}")
        await until(lambda model: model["note"].startswith("saved crank-2.toml and raw-2.bin in"))
        text = (tmp_path / "crank-2.toml").read_text()
        assert text == "crank = 40.0\nradius = 31.37\nrod = 70.0\noffset = 0.0\n"
        say(set_("radius", 60))
        say("{'type':'save','although_failing':false}")
        await until(lambda model: model["note_is_fault"])
        assert "not saved, for it fails 1 of 1 requirements: rod within" in session.model["note"]
        say("{'type':'save','although_failing':true}")
        await until(lambda model: model["note"].startswith("saved crank-3-failing.toml"))
        assert (tmp_path / "raw-3-failing.bin").read_bytes() == b"\x00"
        say("{'type':'undo'}")
        say("{'type':'save','although_failing':false}")
        await until(lambda model: model["note"].startswith("saved crank-4.toml"))
        assert len(list(tmp_path.iterdir())) == 7

    run(guest)


def test_saves_that_wait_are_all_written_even_at_the_end(run, tmp_path):
    explorer = SliderCrank()
    judge, may_go_on = explorer.design.judge, threading.Event()

    def wait(values):
        assert may_go_on.wait(20)
        return judge(values)

    async def guest(session, say, until):
        explorer.design.judge = wait
        for value in (41, 42, 43):
            say(set_("rod", 30 + value))
            say("{'type':'save','although_failing':true}")
            assert session.model["note"] == "saving …"
        session.end()
        may_go_on.set()

    run(guest, explorer)
    texts = [(tmp_path / f"crank-{number}.toml").read_text() for number in (1, 2, 3)]
    assert [text.splitlines()[2] for text in texts] == ["rod = 71.0", "rod = 72.0", "rod = 73.0"]


def test_numbers_begin_after_their_picture_and_the_last_ones_stay(run, monkeypatch):
    monkeypatch.setattr(sessions, "DRAWING", 0.05)
    explorer = SliderCrank()

    async def guest(session, say, until):
        def is_shown(model, crank):
            return model["values"]["crank"] == crank and not session._picture._jobs

        for crank in (50.0, 60.0):
            before = session.model["readouts"]
            say(set_("crank", crank))
            await until(lambda model, crank=crank: is_shown(model, crank))
            assert session.model["readouts"] == before
        values = explorer.values() | {"crank": 60.0}
        wanted = [number_text(one.value) for one in show(explorer, values).readouts]
        await until(lambda model: [row[1] for row in model["readouts"]] == wanted)
        say(set_("crank", 70.0))  # whose numbers are not begun before the session ends
        await until(lambda model: is_shown(model, 70.0))

    run(guest, explorer)


def test_a_file_that_appears_meanwhile_is_not_replaced(monkeypatch, tmp_path):
    touch = Path.touch

    def touch_late(path, **options):
        if path.name == "b-1.toml":
            monkeypatch.undo()
            path.write_text("another's")
        touch(path, **options)

    monkeypatch.setattr(Path, "touch", touch_late)
    specs = [SpecFile(name, "", "x = 1") for name in ("a.toml", "b.toml")]
    paths = save_specs(specs, tmp_path)
    assert [path.name for path in paths] == ["a-2.toml", "b-2.toml"]
    assert (tmp_path / "b-1.toml").read_text() == "another's"
    assert len(list(tmp_path.iterdir())) == 3


def test_no_half_of_a_set_is_left(monkeypatch, tmp_path):
    replace, replaced = os.replace, []

    def replace_once(*paths):
        if replaced:
            raise OSError(28, "No space left on device")
        replaced.append(paths)
        replace(*paths)

    monkeypatch.setattr(os, "replace", replace_once)
    specs = [SpecFile(name, "", "x = 1") for name in ("a.toml", "b.toml")]
    with pytest.raises(UserError, match="No space left"):
        save_specs(specs, tmp_path)
    assert replaced
    assert not list(tmp_path.iterdir())


def test_nothing_is_written_where_one_file_cannot_be(run, tmp_path):
    explorer = SliderCrank()
    names = ("a.toml", f"{300 * 'b'}.toml")
    explorer.design.files = lambda values: [SpecFile(name, "", "x = 1") for name in names]

    async def guest(session, say, until):
        say("{'type':'save','although_failing':true}")
        await until(lambda model: model["note_is_fault"])
        assert not list(tmp_path.iterdir())

    run(guest, explorer)


def test_an_optimisation_changes_what_is_free_within_its_bounds(run):
    async def guest(session, say, until):
        say("{'type':'bounds','name':'radius','low':10,'high':40}")
        say("{'type':'optimise','measure':'stroke'}")
        await until(lambda model: model["report"])
        assert session.model["values"]["radius"] == 40.0
        assert session.model["optimising"] == ""
        say(set_("crank", 50))
        assert session.model["step"] == "done"
        assert session.model["report"]
        say("{'type':'undo'}")
        say("{'type':'undo'}")
        assert session.model["values"]["radius"] == 31.37
        assert (session.model["step"], session.model["report"]) == ("", [])
        for name in ("radius", "rod", "offset"):
            say(f"{{'type':'lock','name':'{name}','locked':true}}")
        say("{'type':'optimise','measure':'stroke'}")
        assert "unlock one" in session.model["note"]
        say("{'type':'lock','name':'radius','locked':false}")
        say("{'type':'optimise','measure':'angle'}")
        await until(lambda model: "nothing to improve" in model["note"])
        assert session.model["optimising"] == ""

    run(guest)


def test_presets_are_stored_for_the_session(run, monkeypatch):
    monkeypatch.setattr(sessions, "MOST_PRESETS", 3)

    async def guest(session, say, until):
        say("{'type':'store','name':' mine '}")
        say(set_("rod", 90))
        await until(lambda model: model["values"]["rod"] == 90.0)
        say("{'type':'preset','name':'mine'}")
        await until(lambda model: model["values"]["rod"] == 70.0)
        say("{'type':'store','name':'upright'}")
        assert "choose another name" in session.model["note"]
        say("{'type':'store','name':'other'}")
        assert session.model["presets"] == ["as designed", "upright", "mine"]

    run(guest)


UNKNOWN = [
    set_("nose", 1),
    "{'type':'lock','name':'nose','locked':true}",
    "{'type':'bounds','name':'nose','low':1,'high':2}",
    "{'type':'preset','name':'nose'}",
    "{'type':'optimise','measure':'nose'}",
]


def test_names_that_a_design_has_not_are_refused(run):
    async def guest(session, say, until):
        for text in UNKNOWN:
            with pytest.raises(MessageError, match="no such name: nose"):
                say(text)

    run(guest)


def test_a_fault_of_a_design_is_shown(run, capfd):
    class Broken(SliderCrank):
        def sketch(self):
            raise UserError("box.toml: no drawing")

    async def guest(session, say, until):
        assert session.model["note"] == "box.toml: no drawing"
        session._design.judge = lambda values: 1 / 0
        say(set_("rod", 71))
        await until(
            lambda model: model["note"] == "this failed: ZeroDivisionError: division by zero"
        )

    run(guest, Broken())
    assert "division by zero" in capfd.readouterr().err


class Prompted(SliderCrank):
    """A slider-crank that computes what it shows and drags by programs."""

    def __init__(self, shown=jnp.sin):
        super().__init__()
        self.shown, self.dragged, self.shows = Program(shown), Program(jnp.cos), 0
        self.begun, self.go_on = threading.Event(), threading.Event()
        self.go_on.set()

    def show(self, values):
        self.shows += 1
        self.begun.set()
        self.go_on.wait(20)
        self.shown(values["crank"])
        return super().show(values)

    def drag(self, values, handle, place):
        self.dragged(values["crank"])
        return super().drag(values, handle, place)


def test_programs_are_compiled_after_the_first_picture_and_after_a_drag(run):
    explorer = Prompted()

    async def guest(session, say, until):
        await until(lambda _: not session._prompt.is_behind)
        assert explorer.shown.compiled.compiled_count == 1
        assert not explorer.dragged.compiled.compiled_count
        (handle, x, y, _), *_ = session.model["panels"][0]["handles"]
        say(f"{{'type':'drag','handle':'{handle}','x':{x - 1},'y':{-y},'seq':1,'gesture':1}}")
        await until(lambda _: explorer.dragged.compiled.compiled_count == 1)

    run(guest, explorer)


def test_a_program_that_cannot_be_compiled_is_named_once_and_answered_by_numpy(run, capfd):
    explorer = Prompted()

    def refused(*_):
        raise UserError("no such processor")

    explorer.shown.run = refused

    async def guest(session, say, until):
        await until(lambda model: model["note"] == "no such processor")
        shows = explorer.shows
        await asyncio.sleep(0.3)
        assert explorer.shows <= shows + 1
        say(set_("crank", 50.0))
        await until(lambda model: model["values"]["crank"] == 50.0 and explorer.shows > shows)

    run(guest, explorer)


def test_measures_are_listed_though_a_dimension_is_changed_before_the_first_picture(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(sessions, "REST", 0.02)
    explorer = Prompted()
    explorer.go_on.clear()

    async def main():
        session = Session(explorer, tmp_path, lambda *_: None)
        await asyncio.to_thread(explorer.begun.wait, 20)
        session.take("tab", read_message(set_("radius", 30.0).replace("'", '"')))
        explorer.go_on.set()
        for _ in range(1000):
            if session.model["measures"]:
                break
            await asyncio.sleep(0.01)
        assert [row[0] for row in session.model["measures"]] == ["stroke", "angle"]
        for worker in session.end():
            worker.join()

    asyncio.run(main())
