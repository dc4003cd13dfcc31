"""Traces of a report as data for charts that zoom: all samples up to a limit, beyond it the extremes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.decimation import extremes
from jaxmuscle.diagnosis.diagnosis_data import Series, Traces
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.diagnosis.shown_column import shown_column
from jaxmuscle.diagnosis.trace_figure import broken, models_of, telling_rows
from jaxmuscle.formatting import capital, words

MOST = 6000
"""Samples of a recording up to which all of them are shown."""
EACH = 2000
"""Extremes that are kept of each curve of a longer one, samples of its most telling stretch, and windows
whose ends are kept."""
STEPS, IN_NOISE = 50_000, 20
"""A value is kept to this part of the range of its curve, or of the sensor's noise if that is less."""


def live_traces(diagnosis: Diagnosis, columns: list[str]) -> dict[str, Any]:
    """What the charts of a page show, as plain data: a clock, what was held out, and each column.

    All samples of up to :data:`MOST`; of more, in each of `EACH` / 2 equal stretches the smallest and the
    largest of the measured values and of each model's error, the first sample of a gap, the ends of windows,
    and all of the stretch that is looked at more closely.
    """
    traces = diagnosis.traces
    rows = len(traces.time)
    return {
        "begin": float(traces.time[0]),
        "step": float(traces.time[-1] - traces.time[0]) / max(rows - 1, 1),
        "held_out": _stretches(traces.held_out),
        "columns": [_column(diagnosis, column) for column in columns],
    }


def _column(diagnosis: Diagnosis, column: str) -> dict[str, Any]:
    """One column in the unit of its card."""
    traces, shown = diagnosis.traces, shown_column(diagnosis, column)
    models = models_of(diagnosis, column)
    closer = telling_rows(diagnosis, column)
    kept = kept_rows(traces, column, [predicted for _, _, predicted in models], closer)
    noise = diagnosis.noise[column] / shown.size
    measured = shown.values(traces.measured[column])
    curves = [("measured", measured)]
    curves += [(label, shown.values(broken(predicted, traces))) for label, _, predicted in models]
    return {
        "name": capital(words(column)),
        "unit": shown.unit,
        "band": 2 * noise,
        "closer": [int(closer[0]), int(closer[-1])],
        "rows": None if len(kept) == len(traces.time) else kept.tolist(),
        "samples": len(traces.time),
        "curves": [{"label": label, **_counts(values[kept], noise)} for label, values in curves],
    }


def kept_rows(traces: Traces, column: str, predicted: list[Series], closer: NDArray) -> NDArray[np.int64]:
    """Rows that are shown; the rule is that of :func:`live_traces`."""
    measured = traces.measured[column]
    if len(measured) <= MOST:
        return np.arange(len(measured))
    curves = [measured, *(values - measured for values in predicted)]
    ends = traces.windows[traces.windows > 0]
    parts = [extremes(values, EACH) for values in curves]
    parts += [ends - 1, ends] if len(ends) <= EACH else []
    parts += [closer] if len(closer) <= EACH else []
    return np.unique(np.concatenate(parts))


def _counts(values: Series, noise: float) -> dict[str, Any]:
    """Values as an offset and whole numbers of a step, `None` where there is none."""
    finite = values[np.isfinite(values)]
    low, span = (float(finite.min()), float(np.ptp(finite))) if len(finite) else (0.0, 0.0)
    step = min(step for step in (span / STEPS, noise / IN_NOISE, 1.0) if step > 0)
    counts = np.round((values - low) / step)
    return {"offset": low, "scale": step, "counts": [int(n) if np.isfinite(n) else None for n in counts]}


def _stretches(chosen: NDArray[np.bool_]) -> list[list[int]]:
    """First and last row of each stretch that is chosen."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int)))
    return [[int(first), int(last) - 1] for first, last in edges.reshape(-1, 2)]
