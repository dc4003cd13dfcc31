"""Report of a diagnosis: one self-contained page, with the versions of what made it."""

from __future__ import annotations

import dataclasses
import datetime
import platform
from importlib.metadata import version
from typing import Any

import numpy as np

import jaxmuscle
from jaxmuscle import formatting
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.diagnosis.trace_figure import trace_caption, trace_figure
from jaxmuscle.effects.base import LOG_TIME, LOOP
from jaxmuscle.figure_style import styled, svg_uri
from jaxmuscle.html_template import template
from jaxmuscle.report import tables
from jaxmuscle.report.doubts import doubts
from jaxmuscle.report.figures import (
    correlation_figure,
    ranking_figure,
    reveal_figure,
    strongest_correlation,
    titles,
)
from jaxmuscle.report.live_traces import live_traces
from jaxmuscle.report.sentence import indistinguishable, sentence, telling_column

PACKAGES = ("jax", "diffrax", "optimistix")


def versions() -> dict[str, str]:
    """Versions of everything that can change a result."""
    packages = {package: version(package) for package in PACKAGES}
    return {"jaxmuscle": jaxmuscle.__version__, **packages, "python": platform.python_version()}


STRONG = 0.9
"""Correlation beyond which two parameters are called hard to tell apart."""


@dataclasses.dataclass(frozen=True)
class Picture:
    """A figure of the page: the picture itself as an address, and one line that says what to see."""

    source: str
    caption: str


def page(diagnosis: Diagnosis) -> str:
    """The report as one HTML page that needs nothing else: no address outside itself, no network.

    Traces are charts that zoom (uPlot, inlined) where scripts run, still pictures elsewhere and on paper.
    """
    return template("page.html.j2", "jaxmuscle.report").render(**_content(diagnosis))


def _content(diagnosis: Diagnosis) -> dict[str, Any]:
    pair = strongest_correlation(diagnosis)
    first = telling_column(diagnosis)
    columns = sorted(diagnosis.traces.measured, key=lambda column: column != first)
    with styled():
        pictures = {
            "traces": _traces(diagnosis, columns),
            "reveal": _reveal(diagnosis),
            "searches": [_search(diagnosis, index) for index in range(len(diagnosis.rounds))],
            "correlations": _correlations(diagnosis) if pair and abs(pair[2]) > STRONG else None,
        }
    return {
        "d": diagnosis,
        "live": live_traces(diagnosis, columns),
        "recording": diagnosis.recording,
        "sentence": sentence(diagnosis),
        "doubts": doubts(diagnosis),
        "errors": tables.errors(diagnosis),
        "effects": tables.effects(diagnosis),
        "parameters": tables.fitted(diagnosis),
        "differing": tables.differing,
        "unexplained": tables.unexplained(diagnosis),
        "rivals": formatting.listed(rivals) if (rivals := indistinguishable(diagnosis)) else "",
        "untried": any(not other.judged for other in diagnosis.alternatives),
        "correlation": tables.correlation(pair, STRONG),
        "versions": versions(),
        "settings": {name: _setting(value) for name, value in diagnosis.settings.items()},
        "held_out_last": bool(np.all(np.diff(diagnosis.traces.held_out.astype(int)) >= 0)),
        "today": datetime.date.today().isoformat(),
        **pictures,
    }


def _setting(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _traces(diagnosis: Diagnosis, columns: list[str]) -> list[Picture]:
    return [Picture(svg_uri(trace_figure(diagnosis, c)), trace_caption(diagnosis, c)) for c in columns]


LINE = "Line: median of bins with equally many samples."
LINES = {
    LOOP: "Lines: medians while it rises and while it falls; between them lies the loop.",
    LOG_TIME: "Every hold begins at zero and is drawn in one direction, over logarithmic time. Line: median.",
}
"""How what is missing is drawn → what its lines are."""


def _reveal(diagnosis: Diagnosis) -> Picture | None:
    reveal = diagnosis.reveal
    if reveal is None:
        return None
    signal, variable = formatting.words(reveal.signal), formatting.words(reveal.variable)
    seen = f"What the model lacks in {signal}, against {variable}"
    if reveal.effect:
        seen += f": the final model {' and '.join(titles(reveal.effect))}"
    caption = f"{seen}. A model that lacks nothing lies on zero. {LINES.get(reveal.view, LINE)}"
    return Picture(svg_uri(reveal_figure(reveal)), caption)


def _search(diagnosis: Diagnosis, index: int) -> dict[str, Any]:
    """One search: its ranking in numbers, and drawn where there is something to see."""
    search, title = diagnosis.rounds[index], f"Search {index + 1}"
    rows = tables.ranking(search)
    if search.added is None:
        judged = rows and rows[0]["gain"]  # those that are tried on unseen windows come first
        best = f"; the best was {rows[0]['name']} ({rows[0]['gain']}, {rows[0]['p']})" if judged else ""
        many = f"none of {len(rows)} candidates helped"
        none = "the only candidate did not help" if len(rows) == 1 else many
        outcome = f"{none} enough to be added{best}"
    else:
        outcome = f"{formatting.words(search.added)} was added"
    if search.beside:
        others = formatting.listed([formatting.words(name) for name in search.beside])
        told = "explains most" if search.added else "is not needed any more"
        outcome = f"once more beside {others}: {formatting.words(rows[0]['name'])} {told}"
    if search.added is None and index > 0:
        return {"title": title, "rows": rows, "picture": None, "outcome": f"{title}: {outcome}."}
    seen = "part of the excess error on windows left out of each fit that a candidate removes"
    picture = Picture(svg_uri(ranking_figure(search)), f"{title}: {seen}; {outcome}.")
    return {"title": title, "rows": rows, "picture": picture, "outcome": ""}


def _correlations(diagnosis: Diagnosis) -> Picture:
    return Picture(
        svg_uri(correlation_figure(diagnosis.correlations)), "Correlations between the fitted parameters."
    )
