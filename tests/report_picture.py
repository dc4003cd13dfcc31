"""Draw the beginning of a report, as a browser shows it, into the documentation.

``python tests/report_picture.py jaxmuscle-lift/report.html`` writes ``docs/report.png`` after ``jaxmuscle
diagnose``.
"""

import sys
from pathlib import Path

from code_blocks import ROOT
from PIL import Image
from report.chromium import opened

WINDOW = {"width": 1000, "height": 1240}
"""Down to what reveals the effect [px]."""
COLOURS = 96


def draw_report(report: Path, picture: Path) -> None:
    """Draw `report` in light colours into `picture`."""
    with opened(report.resolve(), viewport=WINDOW, color_scheme="light") as shown:
        shown.wait_for_timeout(500)
        shown.screenshot(path=picture)
    with Image.open(picture) as drawn:
        drawn.convert("RGB").quantize(COLOURS).save(picture, optimize=True)


if __name__ == "__main__":
    draw_report(Path(sys.argv[1]), ROOT / "docs" / "report.png")
