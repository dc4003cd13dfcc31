"""Parts that scenes are drawn of: blocks, walls, arrows, texts, valves."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import FancyArrow, Rectangle

from jaxmuscle.figure_style import AFTER, INK, MUTED

METAL, GROUND, HOSE, CELL = "#9aa3af", "#4b5563", "#6f8fb8", "#c9a24a"


def box(axes: Axes, x: float, y: float, wide: float, high: float, colour: str, **look: Any) -> None:
    """A block with its lower left corner at a place."""
    axes.add_patch(Rectangle((x, y), wide, high, **{"facecolor": colour, "edgecolor": "none", **look}))


def wall(axes: Axes, begin: tuple[float, float], end: tuple[float, float], depth: float) -> None:
    """A wall along a line, to the side on which `depth` lies."""
    (x, y), (u, v) = begin, end
    wide, high = (u - x, depth) if y == v else (depth, v - y)
    box(axes, x, y, wide, high, GROUND, zorder=1)


def text(axes: Axes, x: float, y: float, words: str, **look: Any) -> None:
    """A small text at a place."""
    axes.text(x, y, words, **{"ha": "center", "va": "center", "fontsize": 8.5, "zorder": 7, **look})


def note(axes: Axes, words: str) -> None:
    """What has to be known of a picture, in its lower left corner."""
    text(axes, 0.02, 0.02, words, transform=axes.transAxes, ha="left", color=MUTED, fontsize=7.5)


def arrow(axes: Axes, x: float, y: float, length: float, width: float) -> None:
    """An arrow to the right."""
    if length > 0:
        head_length = min(2 * width, length)
        head: dict[str, Any] = {"head_width": 1.1 * head_length, "head_length": head_length}
        body: dict[str, Any] = {"width": width, "length_includes_head": True, "color": AFTER, "zorder": 6}
        axes.add_patch(FancyArrow(x, y, length, 0.0, **body, **head))


def regulator(axes: Axes, x: float, y: float, half: float, level: float) -> None:
    """A pressure regulator about a place: the bar is the pressure that is commanded."""
    box(axes, x - half, y - half, 2 * half, 2 * half, "white", edgecolor=INK, zorder=3)
    box(axes, x - half, y - half, 2 * half, 2 * half * min(max(level, 0.0), 1.0), AFTER, zorder=4)


def valve(axes: Axes, x: float, y: float, size: float, opening: float) -> None:
    """A valve with its hose: the bar is the command, to the right filling and to the left venting."""
    axes.plot([0.0, 0.0, x], [y, y + size / 2, y + size / 2], color=HOSE, linewidth=3, zorder=1.5)
    two_way_bar(axes, x, y, 1.6 * size, size, opening, AFTER if opening > 0 else HOSE)


def two_way_bar(
    axes: Axes, x: float, y: float, wide: float, high: float, part: float, colour: str = AFTER
) -> None:
    """A box at a place (its lower left corner), in it a bar from its middle: to the right, from -1 to 1."""
    box(axes, x, y, wide, high, "white", edgecolor=INK, zorder=3)
    middle = x + 0.5 * wide
    box(axes, middle, y + 0.2 * high, 0.5 * wide * min(max(part, -1.0), 1.0), 0.6 * high, colour, zorder=4)
    axes.plot([middle, middle], [y, y + high], color=INK, linewidth=0.8, zorder=5)
