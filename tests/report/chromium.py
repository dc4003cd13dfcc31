"""A page in a real browser; tests skip where there is none."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


@contextmanager
def opened(file: Path, **context: Any) -> Iterator[Any]:
    """The page of a file, in a window of its own; it fails on any error of a script or request beyond it."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next((found for name in NAMES if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no Chromium here: none of {', '.join(NAMES)} is on the path")
    faults: list[str] = []

    def asked(request: Any) -> None:
        if not request.url.startswith(("data:", file.as_uri())):
            faults.append(f"request for {request.url}")

    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=program, args=["--no-sandbox"])
        try:
            page = browser.new_context(**context).new_page()
            page.on("pageerror", lambda error: faults.append(str(error)))
            page.on("console", lambda told: faults.append(told.text) if told.type == "error" else None)
            page.on("request", asked)
            page.goto(file.as_uri())
            yield page
        finally:
            browser.close()
    assert faults == []


def read_until(page: Any, script: str, holds: Callable[[Any], bool], *, seconds: float = 20.0) -> Any:
    """The value of a script in the page, as soon as it holds; the last one read where it never does.

    Not Playwright's `wait_for_function`: older versions evaluate text in the page, which its policy forbids.
    """
    value = page.evaluate(script)
    for _ in range(int(seconds / 0.05)):
        if holds(value):
            break
        page.wait_for_timeout(50)
        value = page.evaluate(script)
    return value
