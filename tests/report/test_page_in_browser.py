"""The report in Chromium: zoom by drag, keys and buttons, one cursor, paper, dark, narrow, no scripts."""

from pathlib import Path

import numpy as np
import pytest
from report.chromium import opened, read_until
from report.fake import diagnosis

from jaxmuscle.report.page import page

DESK = {"viewport": {"width": 1000, "height": 1400}, "color_scheme": "light"}
RANGE = "() => window.jaxmuscle.range()"
SCALES = "() => window.jaxmuscle.plots().map(p => [p.scales.x.min, p.scales.x.max])"
WHOLE = (0.0, 11.998)
"""Clock of the sample [s]."""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of an outcome with an effect."""
    file = tmp_path_factory.mktemp("page") / "report.html"
    file.write_text(page(diagnosis("effects found")), encoding="utf-8")
    return file


def test_drag_zooms_all_charts_and_double_click_shows_all(report: Path) -> None:
    with opened(report, **DESK) as shown:
        assert shown.evaluate(RANGE) == pytest.approx(WHOLE)
        assert len(shown.evaluate(SCALES)) == 4
        area = shown.locator(".u-over").first
        area.scroll_into_view_if_needed()
        box = area.bounding_box()
        shown.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 40)
        shown.mouse.down()
        shown.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60, steps=5)
        shown.mouse.up()
        zoomed = read_until(shown, RANGE, lambda now: now != pytest.approx(WHOLE))
        assert zoomed == pytest.approx([0.25 * WHOLE[1], 0.5 * WHOLE[1]], abs=0.05)
        assert all(scale == pytest.approx(zoomed) for scale in shown.evaluate(SCALES))
        area.dblclick()
        assert read_until(shown, RANGE, lambda now: now == pytest.approx(WHOLE)) == pytest.approx(WHOLE)


def test_charts_share_a_cursor_that_reads_values(report: Path) -> None:
    with opened(report, **DESK) as shown:
        area = shown.locator(".u-over").first
        area.scroll_into_view_if_needed()
        box = area.bounding_box()
        shown.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 40)
        middle = pytest.approx([0.5 * WHOLE[1]] * 4, abs=0.05)
        under_cursor = "() => window.jaxmuscle.plots().map(p => p.data[0][p.cursor.idx] ?? NaN)"
        times = read_until(shown, under_cursor, lambda now: now == middle)
        assert times == middle
        column = diagnosis("effects found").traces
        row = int(np.argmin(np.abs(column.time - times[0])))
        measured = float(shown.locator(".u-legend .u-series").nth(1).locator(".u-value").inner_text())
        assert measured == pytest.approx(1e3 * column.measured["position"][row], abs=2e-3)


def test_keys_move_zoom_and_reset(report: Path) -> None:
    with opened(report, **DESK) as shown:
        shown.locator(".live").first.focus()
        shown.keyboard.press("+")
        half = shown.evaluate(RANGE)
        assert half == pytest.approx([WHOLE[1] / 4, 3 * WHOLE[1] / 4])
        shown.keyboard.press("ArrowRight")
        assert shown.evaluate(RANGE) == pytest.approx([x + 0.2 * WHOLE[1] / 2 for x in half])
        for _ in range(20):
            shown.keyboard.press("ArrowLeft")
        assert shown.evaluate(RANGE) == pytest.approx([0.0, WHOLE[1] / 2])
        shown.keyboard.press("Escape")
        assert shown.evaluate(RANGE) == pytest.approx(WHOLE)
        for _ in range(30):
            shown.keyboard.press("+")
        low, high = shown.evaluate(RANGE)
        assert high - low == pytest.approx(8 * 0.002)


def test_buttons_do_the_same(report: Path) -> None:
    with opened(report, **DESK) as shown:
        whole = shown.get_by_role("button", name="whole recording").first
        assert whole.is_disabled()
        shown.get_by_role("button", name="the stretch of unseen data").first.click()
        low, high = shown.evaluate(RANGE)
        assert 0.7 * WHOLE[1] < low < high <= WHOLE[1]
        whole.click()
        assert shown.evaluate(RANGE) == pytest.approx(WHOLE)


def test_a_phone_needs_no_sideways_scrolling(report: Path) -> None:
    with opened(report, viewport={"width": 400, "height": 900}, color_scheme="light") as shown:
        assert shown.evaluate("() => document.documentElement.scrollWidth") <= 400
        assert all(box <= 400 for box in shown.evaluate("() => window.jaxmuscle.plots().map(p => p.width)"))


def test_on_paper_there_are_the_still_pictures_in_light(report: Path) -> None:
    with opened(report, **{**DESK, "color_scheme": "dark"}) as shown:
        paper = "() => getComputedStyle(document.body).backgroundColor"
        assert shown.evaluate(paper) != "rgb(255, 255, 255)"
        assert not shown.locator(".trace img").first.is_visible()
        shown.emulate_media(media="print")
        assert shown.locator(".trace img").first.is_visible()
        assert not shown.locator(".live").first.is_visible()
        assert shown.evaluate(paper) == "rgb(255, 255, 255)"


def test_charts_follow_a_change_to_dark(report: Path) -> None:
    with opened(report, **DESK) as shown:
        ink = "() => window.jaxmuscle.plots()[0].series[1]._stroke"
        light = shown.evaluate(ink)
        shown.emulate_media(color_scheme="dark")
        dark = read_until(shown, ink, lambda now: now != light)
        assert light == "#22272e" and dark == "#e4e7eb"
        assert len(shown.evaluate(SCALES)) == 4


def test_without_scripts_the_still_pictures_stand_there(report: Path) -> None:
    with opened(report, **DESK, java_script_enabled=False) as shown:
        assert shown.locator(".trace img").first.is_visible()
        assert not shown.locator(".live").first.is_visible()
