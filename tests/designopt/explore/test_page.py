"""The page in a real browser: pointer, keyboard, fingers, other tabs, other people's names."""

import io
import math
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from designopt.explore.explorer import number_text
from designopt.explore.server import MOST_TABS, _redirect_file
from designopt.export.drawing import Circle
from designopt.export.svg import path_data
from tests.designopt.explore.served import driven_browser, served
from tests.designopt.explore.slider_crank import MARKUP, SliderCrank, Step, draw, place

PATIENCE = 20_000
PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def browser():
    with driven_browser() as browser:
        yield browser


@pytest.fixture
def visit(browser, tmp_path):
    """Opens pages of one site; whatever they complain about fails the test."""
    faults, ends = [], []

    def open_tab(site, first=True, **options):
        context = browser.new_context(**options)
        ends.append(context.close)
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("console", lambda one: faults.append(one.text) if one.type == "error" else None)
        page.on("dialog", lambda one: (faults.append(one.message), one.dismiss()))
        page.goto(site.site.address)
        page.wait_for_selector(".panel svg")
        return page

    yield open_tab
    for end in ends:
        end()
    assert not faults


@pytest.fixture
def site(tmp_path):
    with served(SliderCrank(), tmp_path) as site:
        yield site


def wait(condition):
    """Until a condition holds."""
    end = time.monotonic() + PATIENCE / 1000
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)


def settled(page):
    wait(lambda: page.locator("#readouts th").first.inner_text() != "numbers")


def slider(page, name):
    return page.get_by_role("slider", name=name, exact=True)


def drag(page, start, *places):
    page.mouse.move(*start)
    page.mouse.down()
    for one in places:
        page.mouse.move(*one, steps=4)
    page.mouse.up()


def drag_slider(page, name, start, end):
    """Take a slider at a fraction of its track and let it go at another."""
    slider(page, name).scroll_into_view_if_needed()
    box = slider(page, name).bounding_box()
    y = box["y"] + box["height"] / 2
    drag(page, *((box["x"] + box["width"] * part, y) for part in (start, end)))


def center(page, selector, number=0):
    box = None
    while box is None:  # it may be drawn anew just now
        box = page.locator(selector).nth(number).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def paths(page):
    return page.eval_on_selector_all(
        ".view svg path", "found => found.map((one) => one.getAttribute('d'))"
    )


def shows(page, values):
    """The page has the picture and the numbers of these values."""
    wanted = [path_data(one) for one in draw(values, "slider").polylines]
    number = number_text(place(values))
    wait(lambda: paths(page) == wanted)
    wait(lambda: page.locator("#readouts .number").first.inner_text() == number)


def test_shapes_come_first_and_can_be_turned_while_numbers_are_computed(visit, tmp_path):
    class Slow(SliderCrank):
        compiled = threading.Event()

        def show(self, values):
            assert self.compiled.wait(60)
            return super().show(values)

    with served(Slow(), tmp_path) as site:
        try:
            page = visit(site)
            assert paths(page) == [path_data(one) for one in draw(site.values, "slider").polylines]
            assert page.locator("#readouts").inner_text().split() == ["numbers", "computing"]
            drag_slider(page, "crank", 0.11, 0.5)
            wait(lambda: site.values["crank"] > 170)
        finally:
            Slow.compiled.set()
        shows(page, site.values)


def test_a_slider_is_dragged_and_undone_and_redone_in_another_tab(visit, site):
    first, second = visit(site), visit(site)
    settled(first)
    before = site.values
    drag_slider(first, "radius", 0.3, 0.7)
    wait(lambda: abs(site.values["radius"] - 59) < 3)
    after = site.values
    for page in (first, second):
        shows(page, after)
        assert page.get_by_role("spinbutton", name="radius in mm", exact=True).input_value() == (
            f"{after['radius']:g}"
        )
    assert second.evaluate("performance.getEntriesByName('change to picture').length") == 0
    assert first.evaluate("performance.getEntriesByName('change to picture').length") > 0
    second.get_by_role("button", name="Undo").click()  # all of the drag at once
    wait(lambda: site.values == before)
    for page in (first, second):
        shows(page, before)
        assert page.get_by_role("button", name="Undo").is_disabled()
    first.keyboard.press("Control+y")
    wait(lambda: site.values == after)


def test_a_slider_in_a_hand_is_not_led_back_by_another_tab(visit, site):
    first, second = visit(site), visit(site)
    box = slider(first, "crank").bounding_box()
    y = box["y"] + box["height"] / 2
    first.mouse.move(box["x"] + 0.2 * box["width"], y)
    first.mouse.down()
    first.mouse.move(box["x"] + 0.4 * box["width"], y)
    held = slider(first, "crank").input_value()
    wait(lambda: site.values["crank"] == pytest.approx(float(held), abs=1.0))
    second.get_by_role("spinbutton", name="crank in °").fill("300")
    second.keyboard.press("Enter")
    wait(lambda: site.values["crank"] == 300)
    second.wait_for_timeout(200)
    assert slider(first, "crank").input_value() == held
    first.mouse.up()
    wait(lambda: slider(first, "crank").input_value() == "300")


def test_a_handle_is_dragged_unless_what_it_moves_is_locked(visit, site):
    page = visit(site)
    settled(page)
    x, y = center(page, ".grip")
    drag(page, (x, y), (x + 4, y - 20))
    wait(lambda: math.hypot(*np.subtract(center(page, ".handle"), (x + 4, y - 20))) < 1.5)
    shows(page, site.values)
    moved = site.values
    assert (moved["radius"], moved["crank"]) != (31.37, 40.0)
    page.get_by_role("checkbox", name="Lock radius").check()
    wait(lambda: "radius" in site.model["locked"])
    assert slider(page, "radius").is_disabled()
    cursor = "one => getComputedStyle(one).cursor"  # empty of one that is just being drawn anew
    wait(lambda: page.locator(".grip").nth(0).evaluate(cursor) == "not-allowed")
    drag(page, center(page, ".grip"), (x - 40, y))
    assert page.locator("#tip").inner_text() == "tip stays where it is: radius is locked"
    assert site.values == moved
    drag(page, center(page, ".grip", 1), (x + 150, y))
    wait(lambda: site.values["rod"] != moved["rod"])
    page.get_by_role("button", name="Undo").click()
    page.get_by_role("button", name="Undo").click()  # the lock
    wait(lambda: not slider(page, "radius").is_disabled())


def test_a_finger_drags_a_handle_and_two_fingers_zoom(visit, site):
    page = visit(site, viewport=PHONE, has_touch=True, is_mobile=True)
    settled(page)
    device = page.context.new_cdp_session(page)

    def touch(kind, *places):
        points = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(places)]
        device.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    x, y = center(page, ".grip")
    touch("touchStart", (x, y))
    touch("touchMove", (x - 10, y - 20))
    touch("touchEnd")
    wait(lambda: site.values["radius"] != 31.37)
    assert page.evaluate("scrollY") == 0
    scale = (
        "Number(document.querySelector('.view g').getAttribute('transform').match(/[\\d.]+/)[0])"
    )
    before = page.evaluate(scale)
    touch("touchStart", (60, 150), (160, 150))
    touch("touchMove", (60, 150), (260, 150))
    touch("touchEnd")
    assert page.evaluate(scale) == pytest.approx(2 * before, rel=0.02)
    before, values = page.evaluate(scale), site.values
    x, y = center(page, ".grip")
    touch("touchStart", (x, y))
    touch("touchStart", (x, y), (x - 60, y))
    touch("touchMove", (x, y), (x - 120, y))
    touch("touchEnd")
    assert page.evaluate(scale) == pytest.approx(2 * before, rel=0.02)
    assert site.values == values


@pytest.mark.parametrize("width", [390, 320])
def test_a_phone_scrolls_downwards_only(visit, tmp_path, width):
    with served(SliderCrank("a name as long as " + "nothing" * 20), tmp_path) as site:
        page = visit(site, viewport={"width": width, "height": 844})
        settled(page)
        page.get_by_role("button", name="Bounds").click()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.evaluate("scrollTo(0, 700)")
        assert page.locator(".stage").first.bounding_box()["y"] >= 0  # the picture stays


def test_optimise_holds_locks_and_stops(visit, site):
    page = visit(site)
    settled(page)
    page.get_by_role("checkbox", name="Lock rod length").check()
    page.get_by_role("button", name="Optimise").click()
    page.get_by_text("active: rod within 45° of the guide").wait_for()
    assert site.values["radius"] == pytest.approx(70 * math.sin(math.pi / 4))
    assert site.values["rod"] == 70
    page.locator("#requirements .met", has_text="✓ met").wait_for()
    page.get_by_text(f"Now: {number_text(2 * site.values['radius'])} mm").wait_for()
    page.get_by_role("button", name="Undo").click()  # all steps at once
    wait(lambda: site.values["radius"] == 31.37)


def test_stopping_and_dragging_end_an_optimisation(visit, site, monkeypatch):
    page = visit(site)
    settled(page)

    def endless(design, values, *_):
        while True:
            time.sleep(0.02)
            yield Step(dict(values), "on and on", False)

    monkeypatch.setattr(sys.modules["designopt.optimize.design_search"], "search", endless)
    page.get_by_role("button", name="Optimise").click()
    page.get_by_role("button", name="Stop").click()
    page.get_by_text("stopped; undo leads back").wait_for()
    page.get_by_role("button", name="Optimise").click()
    page.get_by_role("button", name="Stop").wait_for()
    x, y = center(page, ".grip")
    drag(page, (x, y), (x + 5, y - 30))
    page.get_by_text("stopped, for the design was changed").wait_for()
    wait(lambda: site.values["radius"] != 31.37)


def press_until(page, key, selector):
    """Press a key until an element has the focus, which is then to be seen."""
    for _ in range(60):
        page.keyboard.press(key)
        if page.evaluate("selector => document.activeElement.matches(selector)", selector):
            style = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
            assert style != "none"
            return
    raise AssertionError(f"{key} never reaches {selector}")


def test_the_keyboard_alone_turns_optimises_and_saves(visit, site, tmp_path):
    page = visit(site)
    settled(page)
    press_until(page, "Tab", ".stage")
    page.keyboard.press("+")
    press_until(page, "Tab", "[type=range]")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    wait(lambda: site.values["crank"] > 48)
    press_until(page, "Tab", "[aria-label='Lock rod length']")
    page.keyboard.press("Space")
    press_until(page, "Tab", "#optimise")
    page.keyboard.press("Enter")
    page.get_by_text("active: rod within").wait_for()
    press_until(page, "Tab", "#saving button")
    page.keyboard.press("Enter")
    page.get_by_text("saved crank-1.toml and raw-1.bin in").wait_for()
    assert f"radius = {site.values['radius']!r}" in (tmp_path / "crank-1.toml").read_text()
    announced = page.locator("#announcer")
    wait(lambda: announced.inner_text().endswith("done"))
    assert announced.inner_text() == f"slider's place {number_text(place(site.values))} mm; " + (
        f"rod to crank {number_text(70 / site.values['radius'])}; done"
    )


def test_announcements_wait_for_rest(visit, site):
    page = visit(site)
    settled(page)
    page.wait_for_timeout(1200)
    page.evaluate(
        """() => {
          window.count = 0;
          new MutationObserver(() => { window.count += 1; })
            .observe(document.getElementById('announcer'), {childList: true});
        }"""
    )
    drag_slider(page, "crank", 0.2, 0.8)
    assert page.evaluate("count") == 0
    page.wait_for_timeout(1300)
    assert page.evaluate("count") == 1


def test_a_failing_design_is_saved_only_as_such(visit, site, tmp_path):
    page = visit(site)
    settled(page)
    number = page.get_by_role("spinbutton", name="radius in mm", exact=True)
    number.fill("60")
    number.press("Enter")
    row = page.locator("#requirements tr")
    row.filter(has_text="✗ not met").wait_for()
    assert row.inner_text().split("\t")[1:3] == ["58.9973 °", "−14 °"]
    page.get_by_role("button", name="Save files").click()
    page.get_by_text("not saved, for it fails 1 of 1 requirements").wait_for()
    assert not list(tmp_path.iterdir())
    page.get_by_role("checkbox", name="although it fails").check()
    page.get_by_role("button", name="Save files").click()
    page.get_by_text("saved crank-1-failing.toml").wait_for()
    lines = (tmp_path / "crank-1-failing.toml").read_text().splitlines()
    assert lines[0].startswith("# This design fails")
    assert lines[1] == "# rod within 45° of the guide (missed by 13.9973 °)"
    assert "radius = 60.0" in lines


def test_bounds_presets_and_numbers(visit, site):
    page = visit(site)
    settled(page)
    page.get_by_role("button", name="Bounds").click()
    page.get_by_role("spinbutton", name="highest radius in mm").fill("50")
    page.keyboard.press("Enter")
    page.get_by_role("spinbutton", name="radius in mm", exact=True).fill("77")
    page.keyboard.press("Enter")
    page.get_by_text("radius stays within 10 and 50 mm").wait_for()
    wait(lambda: site.values["radius"] == 50)
    assert slider(page, "radius").get_attribute("max") == "50"
    page.get_by_role("textbox", name="Name for these values").fill(MARKUP)
    page.keyboard.press("Enter")
    page.get_by_role("combobox", name="Preset").select_option("as designed")
    page.get_by_role("button", name="Apply").click()
    wait(lambda: site.values["radius"] == 31.37)
    page.get_by_role("combobox", name="Preset").select_option(MARKUP)
    page.get_by_role("button", name="Apply").click()
    wait(lambda: site.values["radius"] == 50)


def test_a_field_that_is_left_as_it_was_shows_values_again(visit, site):
    page = visit(site)
    settled(page)
    drag_slider(page, "radius", 0.3, 0.6)
    wait(lambda: site.values["radius"] > 50)
    number = page.get_by_role("spinbutton", name="radius in mm", exact=True)
    number.focus()
    number.press("End")
    number.press("1")
    number.press("Backspace")
    number.press("Tab")
    page.get_by_role("button", name="Undo").click()
    wait(lambda: number.input_value() == "31.37")


def test_a_part_that_changes_its_layer_or_kind_is_drawn_so(visit, tmp_path):
    class Changing(SliderCrank):
        """Where the crank is beyond 90°, its last line is drawn as the rim, and as a circle."""

        def view(self, values):
            view = super().view(values)
            if values["crank"] <= 90.0:
                return view
            lines, circles = view.drawing.polylines, view.drawing.circles
            circle = Circle("rim", "", (0.0, 0.0), 3.0)
            drawing = view.drawing._replace(polylines=lines[:-1], circles=[circle, *circles])
            return replace(view, drawing=drawing)

    counts = """() => [...document.querySelectorAll('.view svg > g:first-child > g')].map((one) =>
        ["path", "circle"].map((kind) => one.querySelectorAll(kind).length))"""
    with served(Changing(), tmp_path) as site:
        page = visit(site)
        settled(page)
        assert page.evaluate(counts) == [[1, 0], [1, 1], [1, 1], [1, 0]]
        drag_slider(page, "crank", 0.1, 0.5)
        wait(lambda: page.evaluate(counts) == [[1, 1], [1, 1], [1, 1], [0, 0]])


def test_hovering_names_a_part_and_its_numbers(visit, site):
    page = visit(site)
    settled(page)
    tip, slide = center(page, ".handle"), center(page, ".handle", 1)
    page.mouse.move(*np.mean([tip, slide], axis=0))
    assert page.locator("#tip").inner_text() == "coupler\nturns about μ₁\n70 mm long"
    page.get_by_role("button", name="Store").press("Escape")
    assert page.locator("#tip").is_hidden()
    page.get_by_text("Parts and their numbers").click()
    parts = page.locator(".view .parts dl")
    wait(lambda: "radius 31.37 mm" in parts.inner_text())
    page.get_by_text("Its values").click()
    values = page.locator(".chart .parts dl")
    wait(lambda: "crank (°)\nnow 40" in values.inner_text())
    now = "document.querySelector('.chart .now').getAttribute('d')"
    before, entry = page.evaluate(now), page.get_by_label("crank in °", exact=True)
    entry.fill("200")
    entry.press("Enter")
    wait(lambda: page.evaluate(now) != before)
    wait(lambda: "crank (°)\nnow 200" in values.inner_text())
    drag_slider(page, "crank", 0.2, 0.3)
    crank = page.get_by_role("spinbutton", name="crank in °", exact=True)
    wait(lambda: f"now {float(crank.input_value()):.4g}" in values.inner_text())


def test_zoom_by_wheel_buttons_and_keys_and_fit(visit, site):
    page = visit(site)
    settled(page)
    transform = "document.querySelector('.view g').getAttribute('transform')"
    fitted = page.evaluate(transform)
    x, y = center(page, ".handle")
    page.mouse.move(x, y)
    page.mouse.wheel(0, -300)
    wait(lambda: page.evaluate(transform) != fitted)
    assert (
        math.hypot(*np.subtract(center(page, ".handle"), (x, y))) < 1.5
    )  # it stays there, but for whole pixels of pointers
    page.get_by_role("button", name="Fit slider").click()
    wait(lambda: page.evaluate(transform) == fitted)
    for undo, key in (("-", "+"), ("ArrowLeft", "ArrowRight")):
        page.locator(".stage").first.press(key)
        assert page.evaluate(transform) != fitted
        page.locator(".stage").first.press(undo)
    page.locator(".stage").first.press("0")
    assert page.evaluate(transform) == fitted
    for _ in range(40):
        page.mouse.wheel(0, 1000)
    wait(lambda: page.evaluate(transform).startswith("matrix(0.001 0 0 0.001 "))


def pixels(data):
    return np.array(Image.open(io.BytesIO(data)).convert("RGB"), float)


@pytest.mark.parametrize("turns", [1, 2100])
@pytest.mark.parametrize("panel", ["slider", "motion"])
def test_saved_pictures_are_what_is_seen(visit, tmp_path, browser, panel, turns):
    """Zoomed, with Greek letters and subscripts; of many shapes, which are drawn on a canvas."""
    with served(SliderCrank(turns=turns), tmp_path) as site:
        high = {"width": 1280, "height": 1400}  # nothing lies over another panel
        page = visit(site, device_scale_factor=2, color_scheme="dark", viewport=high)
        settled(page)
        if panel == "slider":
            page.get_by_role("button", name="Zoom in on slider").click()
            assert page.locator(".view canvas").count() == (turns > 1)
        page.mouse.move(1, 1)
        seen = pixels(page.locator(f".panel[aria-label={panel}] .stage").screenshot())
        saved = {}
        for kind in ("SVG", "PNG"):
            with page.expect_download() as download:
                page.get_by_role("button", name=f"Download {panel} as {kind}").click()
            assert download.value.suggested_filename == f"slider-crank-{panel}.{kind.lower()}"
            saved[kind] = Path(download.value.path()).read_bytes()
        other = browser.new_page(device_scale_factor=2)
        other.set_content(f"<style>*{{margin:0}}</style>{saved['SVG'].decode()}")
        svg = pixels(other.locator("svg").screenshot())
        other.close()
        for picture in (pixels(saved["PNG"]), svg):
            assert (
                abs(np.array(picture.shape) - seen.shape).max() <= 2
            )  # a part of a pixel of the page
            rows, columns = np.minimum(picture.shape, seen.shape)[:2]
            apart = np.abs(picture[:rows, :columns] - seen[:rows, :columns]).max(axis=2)
            assert np.mean(apart > 60) < 0.004  # but for the smoothing of edges
            assert np.ptp(picture) > 100
        if panel == "slider":
            text = saved["SVG"].decode()
            assert "μ₁" in text
            assert text.count("<path") == turns + 3


def test_many_shapes_on_a_canvas_are_hovered_and_move(visit, tmp_path):
    with served(SliderCrank(turns=2100), tmp_path) as site:
        page = visit(site)
        settled(page)
        before = page.locator(".view .stage").screenshot()
        tip, slide = center(page, ".handle"), center(page, ".handle", 1)
        page.mouse.move(*np.mean([tip, slide], axis=0))
        assert page.locator("#tip").inner_text().startswith("coupler\n")
        drag_slider(page, "crank", 0.1, 0.6)
        shown = "performance.getEntriesByName('change to picture').length"
        wait(lambda: page.evaluate(shown) > 0)
        assert page.locator(".view .stage").screenshot() != before


def test_markup_in_names_is_text(visit, tmp_path):
    explorer = SliderCrank(MARKUP)
    explorer.design.title = MARKUP
    with served(explorer, tmp_path) as site:
        page = visit(site)
        settled(page)
        assert page.locator("h1").inner_text() == MARKUP
        assert page.locator(".view text", has_text=MARKUP).count() == 1
        page.get_by_text("Parts and their numbers").click()
        page.mouse.move(*center(page, ".handle", 1))
        assert page.locator("img").count() == 0


def test_the_redirect_file_leads_in_and_the_address_loses_the_token(visit, site, browser):
    with _redirect_file(site.site.address) as file:
        assert file.stat().st_mode & 0o777 == 0o600
        assert file.parent.stat().st_mode & 0o777 == 0o700
        page = browser.new_page()
        page.goto(file.as_uri())
        page.wait_for_selector(".panel svg")
        assert page.url == site.site.address.partition("?")[0]
        [cookie] = page.context.cookies()
        assert cookie["name"] == site.site.cookie
        assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
        assert page.evaluate("document.cookie + document.referrer") == ""
        page.close()
    assert not file.exists()


def test_a_ninth_tab_and_a_bad_message_are_told_why(visit, site):
    pages = [visit(site)]
    for _ in range(MOST_TABS - 1):
        pages.append(pages[0].context.new_page())
        pages[-1].goto(site.site.address.partition("?")[0])
        pages[-1].wait_for_selector(".panel svg")
    ninth = pages[0].context.new_page()
    ninth.goto(site.site.address)
    ninth.get_by_text(f"{MOST_TABS} tabs are open already; close one").wait_for()
    ninth.close()
    pages[0].evaluate(
        """() => {
          const socket = new WebSocket(`ws://${location.host}/ws`);
          window.refused = new Promise((tell) => {
            socket.onclose = (event) => tell(event.code);
          });
        }"""
    )
    assert pages[0].evaluate("refused") == 4008
    pages[1].close()
    wait(lambda: len(site.site.tabs) == MOST_TABS - 1)


def test_a_fault_of_a_design_is_shown_and_the_page_goes_on(visit, site, capfd):
    page = visit(site)
    settled(page)
    number = page.get_by_role("spinbutton", name="offset in mm", exact=True)
    number.fill("19")
    number.press("Enter")
    page.get_by_text("this failed: ZeroDivisionError: on purpose").wait_for()
    assert "ZeroDivisionError" in capfd.readouterr().err
    number.fill("3")
    number.press("Enter")
    shows(page, {**site.values, "offset": 3.0})


@pytest.mark.parametrize("options", [{"color_scheme": "dark"}, {"viewport": PHONE}])
def test_axe_finds_nothing(visit, site, options):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    page = visit(site, **options)
    settled(page)
    page.get_by_role("button", name="Bounds").click()
    page.get_by_text("Parts and their numbers").click()
    page.get_by_text("Its values").click()
    page.get_by_role("checkbox", name="Lock radius").check()
    page.get_by_role("spinbutton", name="rod length in mm", exact=True).fill("35")
    page.keyboard.press("Enter")
    page.locator("#requirements").get_by_text("✗ not met").wait_for()
    page.get_by_role("button", name="Save files").click()
    page.get_by_text("not saved").wait_for()
    page.wait_for_timeout(300)  # until colours have changed
    found = axe.Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
