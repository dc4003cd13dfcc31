"""The report in Chromium: zoom by drag, keys, buttons, fingers; cursor, paper, dark, narrow, no scripts."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_buttons_do_the_same(report: Path) -> None:
    with opened(report, **DESK) as shown:
        whole = shown.get_by_role("button", name="whole recording").first
        assert whole.is_disabled()
        shown.get_by_role("button", name="the stretch of unseen data").first.click()
        low, high = shown.evaluate(RANGE)
        assert 0.7 * WHOLE[1] < low < high <= WHOLE[1]
        whole.click()
        assert shown.evaluate(RANGE) == pytest.approx(WHOLE)


@contextmanager
def on_a_phone(file: Path) -> Iterator[tuple[Any, "Fingers"]]:
    """The page under fingers on its first chart."""
    with opened(file, viewport={"width": 400, "height": 800}, has_touch=True, is_mobile=True) as shown:
        area = shown.locator(".u-over").first
        area.scroll_into_view_if_needed()
        yield shown, Fingers(shown, area.bounding_box())


class Fingers:
    """Fingers on a chart; places are parts of its width, heights are pixels below its top."""

    def __init__(self, shown: Any, box: dict[str, float]) -> None:
        self.shown, self.box = shown, box
        self.session = shown.context.new_cdp_session(shown)

    def send(self, kind: str, *places: tuple[float, float]) -> None:
        """A touch event of the browser's own kind."""
        points = [
            {"x": self.box["x"] + x * self.box["width"], "y": self.box["y"] + y, "id": i}
            for i, (x, y) in enumerate(places)
        ]
        self.session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        self.shown.wait_for_timeout(20)

    def move(self, begin: list[tuple[float, float]], end: list[tuple[float, float]], steps: int = 8) -> None:
        """Put fingers down, move them in a straight line and lift them."""
        for count in range(1, len(begin) + 1):
            self.send("touchStart", *begin[:count])
        for step in range(1, steps + 1):
            part = step / steps
            self.send("touchMove", *(
                (x + part * (u - x), y + part * (v - y)) for (x, y), (u, v) in zip(begin, end, strict=True)
            ))  # fmt: skip
        self.send("touchEnd")


@pytest.mark.slow
def test_two_fingers_zoom_all_charts_and_one_moves_them(report: Path) -> None:
    with on_a_phone(report) as (shown, fingers):
        at, height = shown.evaluate("() => scrollY"), 100
        fingers.move([(0.4, height), (0.6, height)], [(0.2, height), (0.8, height)])
        # What was under the fingers is still under them: a third of the time, about its middle.
        zoomed = shown.evaluate(RANGE)
        assert zoomed == pytest.approx([WHOLE[1] / 3, 2 * WHOLE[1] / 3], rel=0.02)
        assert shown.evaluate(SCALES) == [pytest.approx(zoomed)] * 4
        fingers.move([(0.7, height)], [(0.3, height)])
        moved = shown.evaluate(RANGE)
        assert moved == pytest.approx([x + 0.4 * WHOLE[1] / 3 for x in zoomed], rel=0.02)
        assert shown.evaluate(SCALES) == [pytest.approx(moved)] * 4
        # Fingers that lie above each other zoom too, and the page stays where it is.
        fingers.move([(0.5, 80), (0.5, 140)], [(0.5, 95), (0.5, 125)])
        low, high = shown.evaluate(RANGE)
        assert high - low == pytest.approx(2 * WHOLE[1] / 3, rel=0.02)
        # No further out than the whole.
        fingers.move([(0.3, height), (0.7, height)], [(0.49, height), (0.51, height)])
        assert shown.evaluate(RANGE) == pytest.approx(WHOLE)
        assert shown.evaluate("() => [scrollY, visualViewport.scale]") == [at, 1]


@pytest.mark.slow
def test_a_finger_up_or_down_a_chart_scrolls_the_page(report: Path) -> None:
    with on_a_phone(report) as (shown, fingers):
        fingers.move([(0.4, 100), (0.6, 100)], [(0.3, 100), (0.7, 100)])
        zoomed, at = shown.evaluate(RANGE), shown.evaluate("() => scrollY")
        fingers.move([(0.5, 180)], [(0.52, 40)])
        scrolled = read_until(shown, "() => scrollY", lambda now: now > at + 100)
        assert scrolled > at + 100
        assert shown.evaluate(RANGE) == zoomed


@pytest.mark.slow
def test_a_double_tap_shows_all_and_a_tap_reads_values(report: Path) -> None:
    with on_a_phone(report) as (shown, fingers):
        fingers.move([(0.4, 100), (0.6, 100)], [(0.2, 100), (0.8, 100)])
        zoomed = shown.evaluate(RANGE)
        assert zoomed != pytest.approx(WHOLE)
        x, y = fingers.box["x"] + 0.5 * fingers.box["width"], fingers.box["y"] + 100
        shown.touchscreen.tap(x, y)
        under_finger = "() => window.jaxmuscle.plots().map(p => p.data[0][p.cursor.idx] ?? -1)"
        middle = pytest.approx([sum(zoomed) / 2] * 4, abs=0.05)
        assert read_until(shown, under_finger, lambda now: now == middle) == middle
        shown.wait_for_timeout(500)
        assert shown.evaluate(RANGE) == zoomed
        shown.touchscreen.tap(x, y)
        shown.touchscreen.tap(x, y)
        assert read_until(shown, RANGE, lambda now: now == pytest.approx(WHOLE)) == pytest.approx(WHOLE)


def test_a_phone_needs_no_sideways_scrolling(report: Path) -> None:
    with opened(report, viewport={"width": 400, "height": 900}, color_scheme="light") as shown:
        assert shown.evaluate("() => document.documentElement.scrollWidth") <= 400
        assert all(box <= 400 for box in shown.evaluate("() => window.jaxmuscle.plots().map(p => p.width)"))
        # A parameter is a block of lines, so that its value stands on the screen.
        ends = (
            "() => [...document.querySelectorAll('.parameters td')].map(d => d.getBoundingClientRect().right)"
        )
        assert all(end <= 400 for end in shown.evaluate(ends))
        label = (
            "() => getComputedStyle(document.querySelector('.parameters td.n + td.n'), '::before').content"
        )
        assert shown.evaluate(label) == '"fitted"'


@pytest.mark.slow
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
