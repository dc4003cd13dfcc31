"""One look for figures, curves that keep their extremes, and a figure's way into a page."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jaxmuscle.decimation import extremes

INK, MUTED, BEFORE, AFTER, SHADE = "#22272e", "#6b7280", "#a9b0ba", "#d9531e", "#f1f3f6"
"""Measured and text; captions; the declared model; the final model (the one accent); held-out data."""
WIDTH = 9.2
"""Width of a figure over the whole page [in]."""

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.labelsize": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#c3c8d0",
    "axes.labelcolor": INK,
    "axes.axisbelow": True,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "axes.grid": True,
    "grid.color": "#e8ebef",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.solid_capstyle": "round",
    "path.simplify_threshold": 0.3,
    "svg.hashsalt": "jaxmuscle",
}


@contextmanager
def styled() -> Iterator[None]:
    """Inside, figures have the look of the report."""
    with mpl.rc_context(STYLE):
        yield


class NotebookFigure(Figure):
    """A figure that a notebook shows, whether or not pyplot has been loaded there, which teaches it to."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png", dpi=self.dpi)
        return picture.getvalue()


def figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure [in] whose axes keep out of each other's way."""
    return NotebookFigure(figsize=(width, height), layout="constrained")


def svg_uri(drawing: Figure) -> str:
    """The figure as an address that holds the picture itself (SVG)."""
    buffer = io.BytesIO()
    drawing.savefig(buffer, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def curve(
    axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], most: int = 1600, **looks: object
) -> None:
    """A line through the samples, thinned to about `most` of them."""
    rows = extremes(y, most)
    axes.plot(x[rows], y[rows], **looks)  # pyright: ignore[reportArgumentType]
