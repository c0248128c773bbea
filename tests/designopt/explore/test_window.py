"""A window's sliders and buttons under a mouse, with a bench known by heart."""

import tomllib
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
from matplotlib.backend_bases import ResizeEvent
from PIL import Image

from designopt.explore.bench import number_text
from designopt.explore.face import DPI, HEIGHT, WIDTH, round_step, stops, with_unit
from designopt.explore.window import OPTIMISE, PICTURE, RESET, SPEC, STOP
from designopt.plot.quick_text import QuickText
from designopt.plot.ruling import Ruling
from tests.designopt.explore import toy
from tests.designopt.explore.hands import Hands, on_button
from tests.designopt.explore.toy import ASKED, KNOBS, LOCKED, SliderCrank, place

ASIDE = 5.0, 755.0
"""Where there is nothing to press, pixels."""


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    return Hands(SliderCrank(), tmp_path_factory.mktemp("saved"))


@pytest.fixture
def hands(shared):
    """One window for all tests that leave its size as it is, with its sliders put back."""
    shared.press(RESET)
    shared.mouse("motion_notify", *ASIDE, None)
    shared.run_until_still()
    shared.told.clear()
    return shared


def readings(hands):
    return {each.name: each.value for each in hands.window.readings}


def label(hands):
    return hands.window.buttons[OPTIMISE].button.label.get_text()


@pytest.mark.parametrize("knob", KNOBS, ids=lambda knob: knob.name)
def test_each_slider_shows_what_the_bench_computes(hands, knob):
    first = hands.window.values
    hands.drag(knob.name, 0.5, 0.4, 0.3)
    values = hands.window.values
    wanted = knob.low + 0.3 * (knob.high - knob.low)
    assert values[knob.name] == pytest.approx(wanted, abs=(knob.high - knob.low) / 150)
    assert values == first | {knob.name: values[knob.name]}
    beside = hands.row(knob.name).slider.valtext.get_text()
    assert beside == with_unit(f"{values[knob.name]:.5g}", knob.unit)
    assert readings(hands)["slider's place"] == place(values)
    assert hands.told[-1] == ([place(values), values["rod"] / values["radius"]], "")


def test_what_is_painted_is_what_would_be_drawn(tmp_path):
    """With new limits, a message, a lit button and hidden ticks, and when a picture was saved."""
    hands = Hands(SliderCrank(), tmp_path)
    bench: Any = hands.bench
    for act in (
        lambda: hands.drag("crank", 0.8),
        lambda: hands.drag("rod", 0.95),
        lambda: hands.drag("rod", 0.0),
        lambda: hands.mouse("motion_notify", *on_button(hands.window, RESET), None),
        lambda: [ruling.set_visible(False) for ruling in bench.rulings],
        lambda: hands.press(PICTURE),
    ):
        before = hands.canvas.pixels()
        act()
        hands.drag("crank", 0.7 if hands.window.values["crank"] < 180 else 0.2)
        painted = hands.canvas.pixels()
        assert (painted != before).any()
        np.testing.assert_array_equal(painted, hands.redrawn())


def test_a_slider_paints_and_draws_nothing_anew(hands, monkeypatch):
    """Ticks are drawn only when limits change."""
    drawn, draw = [], Ruling.draw
    monkeypatch.setattr(
        Ruling, "draw", lambda self, renderer: (drawn.append(self), draw(self, renderer))
    )
    draws, blits = hands.canvas.draws, hands.canvas.blits
    hands.drag("crank", 0.3)
    assert (hands.canvas.draws, hands.canvas.blits, drawn) == (draws, blits + 1, [])
    hands.drag("rod", 0.95)
    assert (hands.canvas.draws, drawn) == (draws, hands.bench.rulings)


def test_of_moves_that_come_together_the_last_is_shown(hands):
    shows = hands.bench.shows
    hands.hold("crank", *np.linspace(0.1, 0.9, 30))
    assert hands.bench.shows == shows
    hands.run_until_still()
    assert hands.bench.shows == shows + 1
    assert readings(hands)["slider's place"] == place(hands.window.values)
    hands.mouse("button_release", *ASIDE)


def test_in_a_window_of_another_shape_circles_stay_round(tmp_path):
    hands = Hands(SliderCrank(), tmp_path)
    bench: Any = hands.bench
    resized: Any = ResizeEvent("resize_event", hands.canvas)
    for size in ((WIDTH / DPI, HEIGHT / DPI), (9.37, 6.11), (8, 9)):
        hands.canvas.figure.set_size_inches(*size)
        resized._process()
        hands.redrawn()
        scales = np.diff(bench.axes.transData.transform([(0, 0), (1, 1)]), axis=0)[0]
        assert scales[0] == pytest.approx(scales[1], rel=1e-9)
        for row in hands.window.rows:  # nothing of the last move is left
            row.slider.set_val(0.7 * row.knob.low + 0.3 * row.knob.high)
            hands.run_until_still()
            row.slider.set_val(0.2 * row.knob.low + 0.8 * row.knob.high)
            hands.run_until_still()
        np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


@pytest.mark.parametrize(
    ("words", "lines"),
    [
        ("inked " * 4 + "inked", ["inked inked inked inked inked"]),
        ("12°\n$μ$\x85–\u2029\x1cη\v  ω", ["12° $μ$ – η ω"]),
        ("inked " * 40, [30 * "inked " + "inked", 8 * "inked " + "inked"]),
        ("inked " * 400, [30 * "inked " + "inked", 29 * "inked " + "inked …"]),
    ],
)
def test_a_message_fills_a_line_or_two(hands, monkeypatch, words, lines):
    """Any line break is a space, and a last sign says that there are more."""
    before = {text.get_text() for text in hands.canvas.figure.findobj(QuickText)}
    monkeypatch.setattr(toy, "LOCKED", words)
    hands.drag("rod", 0.0)
    shown = [text.get_text() for text in hands.canvas.figure.findobj(QuickText)]
    assert [line for line in shown if line[:3] in ("ink", "12°") and line not in before] == lines
    hands.drag("rod", 0.9)
    assert not set(lines) & {text.get_text() for text in hands.canvas.figure.findobj(QuickText)}


def test_a_fault_is_said_and_reset_puts_all_sliders_back(hands):
    for knob, fraction in (("crank", 0.25), ("radius", 1.0), ("rod", 0.3), ("offset", 0.1)):
        hands.drag(knob, fraction)
    assert hands.told[-1][0][0] is None
    assert hands.window.message == LOCKED
    hands.press(RESET)
    assert hands.window.message == ""
    assert hands.window.values == {knob.name: knob.value for knob in KNOBS}
    assert readings(hands)["slider's place"] == place(hands.window.values)


def test_a_button_lights_up_under_the_mouse(hands):
    blits, button = hands.canvas.blits, hands.window.buttons[RESET].button
    before = button.ax.get_facecolor()
    hands.mouse("motion_notify", *on_button(hands.window, RESET), None)
    hands.run()
    assert button.ax.get_facecolor() != before
    hands.mouse("motion_notify", *ASIDE, None)
    hands.run()
    assert (button.ax.get_facecolor(), hands.canvas.blits) == (before, blits + 2)
    assert not hands.told


def test_pictures_are_numbered_and_never_replaced(tmp_path):
    folder = tmp_path / "new" / "pictures"
    hands = Hands(SliderCrank(), folder)
    assert not list(tmp_path.iterdir())
    hands.press(PICTURE)
    assert hands.window.message == f"Saved toy-1.png and toy-1.svg in {folder}."
    (folder / "toy-2.svg").write_text("mine")
    hands.drag("crank", 0.7)
    hands.press(PICTURE)
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["toy-1.png", "toy-1.svg", "toy-2.svg", "toy-3.png", "toy-3.svg"]
    assert (folder / "toy-2.svg").read_text() == "mine"
    first, second = (np.array(Image.open(folder / f"toy-{n}.png")) for n in (1, 3))
    assert first.shape == second.shape == (2 * HEIGHT, 2 * WIDTH, 4)
    assert (first != second).any()
    x, y = on_button(hands.window, RESET)  # which is not in the picture
    assert first[round(2 * (HEIGHT - y)), round(2 * x), :3].min() == 255
    assert ElementTree.parse(folder / "toy-3.svg").getroot().tag.endswith("svg")


def test_specs_share_a_number_and_read_back(hands):
    folder = hands.window._folder
    (folder / "raw-1.bin").write_bytes(b"mine")
    hands.drag("rod", 0.61)
    hands.press(SPEC)
    said = f"Saved crank-2.toml and raw-2.bin in {folder}: the slider-crank."
    assert hands.window.message == said
    read = tomllib.loads((folder / "crank-2.toml").read_text(encoding="utf-8"))
    assert read == hands.window.values
    assert (folder / "raw-2.bin").read_bytes() == b"\x00"
    assert (folder / "raw-1.bin").read_bytes() == b"mine"


def test_what_cannot_be_saved_is_said(tmp_path):
    hands = Hands(SliderCrank(), tmp_path / "new")
    hands.drag("radius", 1.0)
    hands.drag("crank", 0.25)
    hands.press(SPEC)
    assert hands.window.message.startswith("slider-crank: a locked one is not saved")
    (tmp_path / "new").touch()
    hands.press(PICTURE)
    assert "new: cannot be made (File exists); name another" in hands.window.message


def test_optimising_shows_each_iteration(hands):
    hands.press(OPTIMISE)
    assert label(hands) == STOP
    assert hands.window.optimising
    rods, blits = [], hands.canvas.blits
    for _ in range(3):  # after the first, which came with the button
        hands.run()
        rods.append(hands.window.values["rod"])
        assert readings(hands)["slider's place"] == place(hands.window.values)
    assert len(set(rods)) == 3
    assert hands.canvas.blits >= blits + 3
    assert hands.window.message == f"rod {rods[-1]:.2f} mm"
    hands.run_until_still()
    assert readings(hands)["slider's place"] == pytest.approx(ASKED, abs=0.02)
    assert (label(hands), hands.window.optimising) == (OPTIMISE, False)
    assert "rod" in hands.window.message


@pytest.mark.parametrize("name", [OPTIMISE, RESET, "crank"])
def test_optimising_can_be_stopped_and_taken_up_again(hands, name):
    hands.press(OPTIMISE)
    hands.run()
    if name == "crank":
        hands.drag(name, 0.9)
    else:
        hands.press(name)
    stopped = hands.window.values
    hands.run_until_still()
    assert hands.window.values == stopped
    assert (label(hands), hands.window.optimising) == (OPTIMISE, False)
    assert ("Stopped after" in hands.window.message) == (name == OPTIMISE)
    hands.press(RESET)
    hands.press(OPTIMISE)
    hands.run_until_still()
    assert readings(hands)["slider's place"] == pytest.approx(ASKED, abs=0.02)


@pytest.mark.parametrize(
    ("knobs", "words"),
    [
        ({"radius": 1.0, "crank": 0.25}, "optimise: it cannot start locked"),
        ({"offset": 1.0}, "This failed: ZeroDivisionError: on purpose"),
    ],
)
def test_an_optimisation_that_fails_says_why(hands, knobs, words):
    for name, fraction in knobs.items():
        hands.drag(name, fraction)
    hands.press(OPTIMISE)
    hands.run_until_still()
    assert hands.window.message.startswith(words)
    assert (label(hands), hands.window.optimising) == (OPTIMISE, False)


@pytest.mark.parametrize(
    ("method", "button"), [("show", None), ("specs", SPEC), ("optimise", OPTIMISE)]
)
def test_a_bench_that_fails_is_told_of_and_the_window_goes_on(hands, monkeypatch, method, button):
    def failing(values):
        raise ZeroDivisionError("on purpose")

    with monkeypatch.context() as during:
        during.setattr(hands.window._bench, method, failing)
        hands.drag("crank", 0.7)
        if button:
            hands.press(button)
        hands.run_until_still()
    assert hands.window.message == "This failed: ZeroDivisionError: on purpose"
    assert label(hands) == OPTIMISE
    hands.drag("crank", 0.2)
    assert hands.window.message == ""
    assert readings(hands)["slider's place"] == place(hands.window.values)


def test_a_picture_shows_where_the_sliders_are(hands, tmp_path, monkeypatch):
    saved = []

    def saving(*_):
        saved.append(readings(hands)["slider's place"])
        return [tmp_path / "toy.png"]

    monkeypatch.setattr("designopt.explore.window.save_picture", saving)
    hands.row("crank").slider.set_val(200.0)
    before = readings(hands)["slider's place"]  # nothing has been drawn yet
    hands.press(PICTURE)
    assert saved == [place(hands.window.values)]
    assert saved != [before]


def test_without_an_aim_there_is_no_button(tmp_path):
    bench = SliderCrank()
    bench.aim = ""
    assert list(Hands(bench, tmp_path).window.buttons) == [RESET, PICTURE, SPEC]


def test_round_steps():
    assert [round_step(span, 154) for span in (360.0, 70.0, 1.0, 154.0)] == [5.0, 0.5, 0.01, 1.0]
    for knob in KNOBS:
        found = stops(knob, round_step(knob.high - knob.low, 154))
        assert {knob.low, knob.high, knob.value} <= set(found)
        assert np.ptp(found) == knob.high - knob.low
        assert len(found) <= 154 + 3
        assert all(len(f"{value!r}") <= 5 for value in found.tolist())  # no 0.30000000000000004


def test_numbers_have_six_digits():
    values = (1.23456789, -0.5, 1e-9, None, float("nan"))
    assert [*map(number_text, values)] == ["1.23457", "-0.5", "1e-09", "–", "–"]
