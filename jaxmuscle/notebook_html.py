"""HTML that a notebook shows in place of a text: a header, tables, small curves, notes.

One mechanism for all results: a class fills a :class:`View` in its ``_repr_html_``. Texts are escaped;
colours are the notebook's own, so that light and dark are both right; nothing is loaded from elsewhere.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import equinox as eqx
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxmuscle.decimation import extremes
from jaxmuscle.formatting import parameter_words
from jaxmuscle.html_template import template
from jaxmuscle.parameters import parameters

WIDTH, HEIGHT, POINTS = 190, 26, 240
"""Size of a small curve [px], and points that it is drawn with."""


@dataclasses.dataclass(frozen=True)
class Table:
    """A table that can be folded: cells are texts or a :class:`Sparkline`."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[object]]
    open: bool = True


@dataclasses.dataclass(frozen=True)
class View:
    """What a notebook shows of an object.

    Attributes:
        kind, name: what it is and what it is called.
        facts: short texts beside these.
        badge, mood: a verdict, and whether it is "good", a "doubt" or (empty) a finding.
        lead, notes: sentences above and below the tables.
        tables: those without rows are left out.
    """

    kind: str
    name: str
    facts: Sequence[str] = ()
    badge: str = ""
    mood: str = ""
    lead: Sequence[str] = ()
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()

    def html(self) -> str:
        """As HTML that stands by itself."""
        return template("notebook.html.j2").render(view=self)


class Sparkline:
    """A small curve, or two over each other; in HTML an SVG in the colour of the text.

    Attributes:
        curves: values at equal steps; NaN is a gap. All share one vertical range.
    """

    def __init__(self, *curves: ArrayLike) -> None:
        """Take one or two series of values."""
        self.curves = tuple(np.asarray(values, dtype=float) for values in curves)

    def __html__(self) -> str:
        """The picture; empty where there is no number."""
        finite = np.concatenate([values[np.isfinite(values)] for values in self.curves])
        if not len(finite):
            return ""
        low, span = float(finite.min()), float(np.ptp(finite)) or 1.0
        lines = "".join(
            f'<polyline{" class=other" if number else ""} points="{points}"/>'
            for number, values in enumerate(self.curves)
            for points in _runs(values, low, span)
        )
        box = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
        return f'<svg {box} role="img" aria-label="curve">{lines}</svg>'


def _runs(values: NDArray[np.float64], low: float, span: float) -> Iterable[str]:
    """Points of each unbroken run of a curve."""
    rows = extremes(values, POINTS)
    x = rows * WIDTH / max(len(values) - 1, 1)
    y = HEIGHT - 1 - (HEIGHT - 2) * (values[rows] - low) / span
    for run in np.split(np.arange(len(rows)), np.flatnonzero(~np.isfinite(y))):
        kept = run[np.isfinite(y[run])]
        if len(kept) > 1:
            yield " ".join(f"{x[i]:.1f},{y[i]:.1f}" for i in kept)


def parameter_rows(model: eqx.Module) -> dict[str, tuple[str, str, str]]:
    """Path → name in words, value in a unit of the right size, and meaning of every parameter of a model."""
    return {
        path: (parameter_words(path), entry.printed, entry.meaning)
        for path, entry in parameters(model).items()
    }
