"""The report in a real browser: contents, folded sections, paper, and a narrow screen."""

from dataclasses import replace

import pytest

from designopt import Metric, StabilityRow, Study, Target
from designopt.io.spec import SpecFile
from designopt.study.runner import run
from tests.designopt.explore.served import driven_browser
from tests.designopt.plugin import SquareSpec
from tests.designopt.test_report import everything


@pytest.fixture(scope="module")
def browser():
    with driven_browser() as found:
        yield found


def designed(spec, context):
    """The results of a design that passes its checks, or of one that fails one."""
    found = everything(spec, context)
    checks = [Metric("residual", 1e-9, "", "a residual", None, Target("<=", 1e-6), is_check=True)]
    rows = [StabilityRow("stiff", "float64", 9, 1, int(spec.side), 1e-16, 2e-16, 3e-9, 0)]
    files = [SpecFile("a.toml", "A file", "x = 1\n")]
    metrics = [*found.metrics, *checks]
    return replace(found, metrics=metrics, specs=files, precision=None, stability=rows)


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """The address of a report by the number of failures of its checks."""
    study = Study("designed", "A design", SquareSpec, designed)

    def written(failures: int) -> str:
        out = tmp_path_factory.mktemp("page") / "out"
        run(study, SquareSpec(side=failures), seed=0, dtype="float64", out=out, force=False)
        return (out / "report.html").as_uri()

    return written


@pytest.fixture(scope="module")
def good(address):
    return address(0)


@pytest.fixture
def page(browser):
    page = browser.new_page(viewport={"width": 1440, "height": 800})
    yield page
    page.close()


def test_contents_lead_to_every_section_and_unfold_it(page, good):
    page.goto(good)
    links = page.locator("nav[aria-label=Contents] a")
    assert links.all_inner_texts() == [
        *("Findings", "Numbers", "Figures", "A drawing", "Files", "Tables", "t", "symbols"),
        *(
            "Self-checks and run times",
            "Checks",
            "Stability",
            "What was left out",
            "How it was run",
        ),
    ]
    for number in range(links.count()):
        links.nth(number).click()
        target = page.locator(page.evaluate("location.hash"))
        assert target.is_visible()
        assert target.evaluate("place => place.getBoundingClientRect().top < innerHeight")


def test_checks_of_a_design_are_apart_and_folded_unless_one_fails(page, good, address):
    page.goto(good)
    assert "a residual" not in page.locator("#metrics").inner_text()
    assert "a good one" in page.locator("#metrics").inner_text()
    assert not page.locator("#checks").is_visible()
    page.get_by_text("Self-checks and run times").last.click()
    assert "a residual" in page.locator("#check-numbers").inner_text()
    page.goto(address(1))
    assert page.locator("#checks").is_visible()


def test_a_section_is_folded_by_the_keyboard(page, good):
    page.goto(good)
    page.locator("summary", has_text="Numbers").focus()
    page.keyboard.press("Enter")
    assert not page.locator("#metrics").is_visible()


def test_paper_has_folded_sections_too_and_no_contents(page, good):
    page.goto(good)
    page.emulate_media(media="print")
    height = "place => place.getBoundingClientRect().height"
    assert page.locator("#checks").evaluate(height) > 100
    assert page.locator("#run").evaluate(height) > 100
    assert not page.locator("nav").is_visible()


@pytest.mark.parametrize("width", [390, 1000, 1440])
def test_no_width_needs_scrolling_to_the_side(page, good, width):
    page.set_viewport_size({"width": width, "height": 800})
    page.goto(good)
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_axe_finds_nothing(page, good):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    page.goto(good)
    for name in ("Self-checks and run times", "How it was run"):
        page.get_by_text(name).last.click()
    found = axe.Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
