"""Pages of reports in Chromium without a network: nothing is loaded, and what is clicked works."""

import os
from pathlib import Path

import numpy as np
import pytest
from support.chromium import needs_chromium
from support.moving_runs import MOVING
from support.report_runs import write_run
from support.small_scene import SMALL_SCENE

from gsfw.commands.main import main
from gsfw.reports.drawing import DrawingRule
from gsfw.reports.encoding import webp
from gsfw.reports.error_image import ErrorImage
from gsfw.reports.pictures import Pictures, store_pictures
from gsfw.reports.run_report import Opened, write_run_report

pytestmark = [pytest.mark.slow, needs_chromium]

PAGE = "report.html"

SCREENSHOTS = os.environ.get("GSFW_SCREENSHOTS")
"""Folder that keeps the screenshots; without it they are only compared."""


@pytest.fixture
def show(browser, tmp_path):
    """Opens a page without a network, at a size and in a colour scheme."""
    pages = []

    def opened(path: Path, size=(1280, 900), scheme="light"):
        page = browser.open(size=size)
        page.offline()
        page.prefer(scheme)
        page.open(path.resolve().as_uri())
        pages.append(page)
        return page

    yield opened
    for page in pages:
        page.close()


def keep(page, name):
    return page.screenshot(Path(SCREENSHOTS) / f"{name}.png" if SCREENSHOTS else None)


def is_alone(page, path):
    """True if the page has asked for nothing but itself, and nothing went wrong in it."""
    return page.requests() == [path.resolve().as_uri()] and page.errors() == []


@pytest.fixture(scope="module")
def moving_run(trained):
    return trained("method=spacetime", *MOVING, "steps=20", "report=true")


@pytest.fixture(scope="module")
def comparison(trained, finished_run, tmp_path_factory):
    other = trained("method=3dgs", *SMALL_SCENE, "steps=10")
    out = tmp_path_factory.mktemp("reports") / "both.html"
    assert main(["report", str(finished_run), str(other), f"out={out}"]) == 0
    return out


@pytest.mark.parametrize("width", [1280, 390])
def test_a_report_fits_every_width_and_loads_nothing(finished_run, moving_run, show, width):
    for run in (finished_run, moving_run):
        page = show(run / PAGE, (width, 900))
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        images = "[...document.images].filter((image) => image.src)"
        assert page.evaluate(f"{images}.length") >= 8
        page.evaluate(f"{images}.forEach((image) => {{ image.loading = 'eager'; }})")
        assert page.wait_for(f"{images}.every((image) => image.naturalWidth > 0)")
        assert is_alone(page, run / PAGE)


def test_a_report_is_dark_where_the_reader_prefers_it(finished_run, show):
    light, dark = (keep(show(finished_run / PAGE, scheme=s), s) for s in ("light", "dark"))
    assert light[:40].mean() > 230
    assert dark[:40].mean() < 40


def test_a_click_on_a_view_shows_it_large_and_the_arrows_go_through_its_images(finished_run, show):
    page = show(finished_run / PAGE)
    page.click(".views img")
    assert page.evaluate("document.querySelector('dialog').open")
    large = "document.querySelector('dialog img')"
    assert page.evaluate(f"{large}.alt").endswith(": ground truth")
    page.press("ArrowRight", 39)
    assert page.evaluate(f"{large}.alt").endswith(": render")
    page.click_text("error")
    assert page.evaluate(f"{large}.alt").endswith(": error")
    keep(page, "large")
    page.press("Escape", 27)
    assert page.wait_for("document.querySelector('dialog').open === false || null") is not None
    assert is_alone(page, finished_run / PAGE)


def test_a_chart_tells_its_values_under_the_pointer(finished_run, show):
    page = show(finished_run / PAGE)
    page.move(*page.middle("svg[data-chart]"))
    tip = "document.querySelector('.tip')"
    assert page.evaluate(f"{tip}.style.display") == "block"
    assert "training image" in page.evaluate(f"{tip}.textContent")
    page.move(5, 5)
    assert page.evaluate(f"{tip}.style.display") == "none"


def test_the_worst_view_is_the_first_one_on_the_screen(finished_run, show):
    page = show(finished_run / PAGE)
    names = page.evaluate("[...document.querySelectorAll('.views .name')].map(n => n.innerText)")
    psnrs = page.evaluate(
        "[...document.querySelectorAll('.views tbody tr')].map(r => +r.cells[1].innerText)"
    )
    assert len(names) == 2
    assert psnrs == sorted(psnrs)


def test_the_slider_of_a_comparison_moves_the_border_and_menus_choose_runs(comparison, show):
    page = show(comparison)
    keep(page, "comparison")
    border = "getComputedStyle(document.querySelector('.slide')).getPropertyValue('--at')"
    assert page.evaluate(border) == "50%"
    x, y = page.middle(".slide")
    before = page.screenshot()
    page.drag((x, y), (x + 60, y))
    assert float(page.evaluate(border).rstrip("%")) > 55
    assert (page.screenshot() != before).any()
    page.evaluate(
        "(() => { const menu = document.querySelector('select[data-side=right]');"
        " menu.value = '2'; menu.dispatchEvent(new Event('change')); })()"
    )
    assert page.evaluate("document.querySelector('.side.r').textContent") == "ground truth"
    shown = "document.querySelector('.slide img.right').dataset.run"
    assert page.evaluate(shown) == "2"
    assert is_alone(page, comparison)


@pytest.mark.parametrize("width", [1280, 390])
def test_a_comparison_fits_every_width(comparison, show, width):
    page = show(comparison, (width, 900))
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    broken = (
        "[...document.querySelectorAll('.compared td:first-child')]"
        ".filter(cell => cell.clientHeight > 100).length"
    )
    assert page.evaluate(broken) == 0, "names of figures are broken within words"


def test_a_single_upright_picture_fills_its_place(tmp_path, show):
    image = webp(np.zeros((160, 90, 3), np.uint8), 36_000)
    folder = write_run(tmp_path / "run", {"a": 20.0})
    pictures = Pictures(100, "eval", "absolute", (), still=image, still_name="a")
    store_pictures(folder, pictures)
    path = write_run_report(folder, Opened(None), DrawingRule(9, 0, ErrorImage(is_flip=False)))
    width = "document.querySelector('.hero img').clientWidth"
    assert show(path).evaluate(width) == pytest.approx(430 * 90 / 160, abs=2)


def test_a_script_in_a_name_does_not_run(tmp_path, show):
    name = "</td><script>document.title='stolen'</script><img src=x onerror=\"document.title='s'\">"
    folder = write_run(tmp_path / "run", {name: 20.0})
    rule = DrawingRule(9, 0, ErrorImage(is_flip=False))
    path = write_run_report(folder, Opened(None), rule)
    page = show(path)
    assert page.evaluate("document.title") == "made: 3dgs"
    assert name in page.text()
    assert is_alone(page, path)
