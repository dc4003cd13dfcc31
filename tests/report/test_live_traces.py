"""Data of the charts: the values of the traces, whole or with every extreme and gap."""

import dataclasses
import json

import numpy as np
import pytest
from report.fake import diagnosis

from jaxmuscle.report.live_traces import EACH, MOST, kept_rows, live_traces


def unpacked(curve: dict) -> np.ndarray:
    """Values of a curve as the page's script reads them."""
    counts = [np.nan if count is None else count for count in curve["counts"]]
    return curve["offset"] + curve["scale"] * np.array(counts)


def test_values_are_those_of_the_traces_in_the_unit_of_the_card() -> None:
    outcome = diagnosis("effects found")
    told = json.loads(json.dumps(live_traces(outcome, ["position", "pressure"]), allow_nan=False))
    traces, (position, pressure) = outcome.traces, told["columns"]
    rows = len(traces.time)
    assert position["rows"] is None and position["samples"] == rows <= MOST
    np.testing.assert_allclose(told["begin"] + told["step"] * np.arange(rows), traces.time, atol=1e-9)
    assert [curve["label"] for curve in position["curves"]] == ["measured", "before", "after"]
    noise = 1e3 * outcome.noise["position"]
    measured, _, after = map(unpacked, position["curves"])
    np.testing.assert_allclose(measured, 1e3 * traces.measured["position"], atol=noise / 20)
    ends = traces.windows[1:] - 1
    assert np.isnan(after[ends]).all() and np.isnan(after).sum() == len(ends)
    shown = np.isfinite(after)
    np.testing.assert_allclose(after[shown], 1e3 * traces.after["position"][shown], atol=noise / 20)
    # On the card pressures are gauge, in bar.
    ambient = outcome.recording.card.ambient_pressure
    gauge = (traces.measured["pressure"] - ambient) / 1e5
    np.testing.assert_allclose(unpacked(pressure["curves"][0]), gauge, atol=1e-4)
    assert position["band"] == pytest.approx(2 * noise)
    first, last = told["held_out"][0]
    assert not traces.held_out[first - 1] and traces.held_out[first:].all() and last == rows - 1


def test_a_long_recording_keeps_extremes_gaps_and_the_closer_look() -> None:
    outcome, rows = diagnosis("effects found"), 400_000
    rng = np.random.default_rng(2)
    measured, error = np.sin(np.arange(rows) / 3000), 1e-3 * rng.standard_normal(rows)
    measured[123_456], error[77_777], measured[200_000:200_010] = 9.0, -4.0, np.nan
    traces = dataclasses.replace(
        outcome.traces,
        time=np.arange(rows) / 500,
        measured={"position": measured},
        before={"position": measured + error},
        after={"position": measured},
        windows=np.arange(0, rows, 1000),
        held_out=np.arange(rows) > 300_000,
    )
    closer = np.arange(310_000, 311_000)
    kept = kept_rows(traces, "position", [traces.before["position"], traces.after["position"]], closer)
    assert {123_456, 77_777, 200_000, 0, rows - 1, 999, 1000, *closer.tolist()} <= set(kept.tolist())
    assert len(kept) < 5 * EACH
    long = dataclasses.replace(outcome, traces=traces, noise={"position": 1e-3})
    (column,) = live_traces(long, ["position"])["columns"]
    assert len(column["curves"][0]["counts"]) == len(column["rows"]) < 5 * EACH
    assert len(json.dumps(column)) < 500_000


def test_a_curve_that_rests_and_one_without_values_are_told() -> None:
    outcome = diagnosis("complete")
    rows = len(outcome.traces.time)
    resting = dataclasses.replace(
        outcome.traces,
        measured={"position": np.full(rows, 0.02)},
        before={"position": np.full(rows, np.nan)},
        after={"position": np.full(rows, np.nan)},
    )
    (column,) = live_traces(dataclasses.replace(outcome, traces=resting), ["position"])["columns"]
    measured, predicted = map(unpacked, column["curves"])
    np.testing.assert_allclose(measured, 20.0)
    assert np.isnan(predicted).all()
