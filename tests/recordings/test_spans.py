"""Spans of a recording's clock, from text."""

import dataclasses

import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.errors import InputError
from jaxmuscle.recordings.spans import fraction, rows_within


@pytest.fixture(scope="module")
def recording():
    whole = jm.read(jm.sample("lift")).part(0, 1000)
    return dataclasses.replace(whole, time=whole.time - whole.time[0] + 10.0)


def test_rows_within_spans(recording):
    step = recording.step
    rows = rows_within(recording, ["10.1:10.2", f"{10 + 999 * step}:"], "--ignore")
    expected = (recording.time >= 10.1) & (recording.time <= 10.2)
    expected[-1] = True
    np.testing.assert_array_equal(rows, expected)
    assert rows_within(recording, [":10.2"], "--ignore")[0]
    assert rows_within(recording, [":"], "--ignore").all()


@pytest.mark.parametrize(
    ("span", "told"),
    [
        ("3", "FROM:TO"), ("a:b", "FROM:TO"), ("1:2:3", "FROM:TO"), ("10.3:10.2", "ends after it begins"),
        ("1:2", "runs from 10 s to"), ("nan:10.2", "ends after"),
    ],
)  # fmt: skip
def test_spans_that_are_none(recording, span, told):
    with pytest.raises(InputError, match=told):
        rows_within(recording, [span], "--ignore")


def test_fractions():
    assert fraction("0.25") == 0.25
    for text in ("0", "1", "x", "nan", "-0.1"):
        with pytest.raises(InputError, match="between 0 and 1"):
            fraction(text)


MASKS = [np.zeros(1000, bool), np.ones(1000, bool), np.ones(999, bool), np.linspace(0, 1, 1000)]


@pytest.mark.parametrize("held_out", [0.0, 1.0, -0.5, 3, np.nan, "0.3", *MASKS])
def test_what_cannot_be_held_out(recording, held_out):
    with pytest.raises(InputError, match="held_out: expected a fraction between 0 and 1"):
        jm.diagnose(recording, held_out=held_out)
