"""How much a candidate has to explain to be carried on."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxmuscle.diagnosis.candidate_search import HOPE, LEAST, PLENTY, _needed

WINDOWS, SAMPLES, PERIOD, MISSED = 4, 100, 25, 5.0
EXCESS = WINDOWS * SAMPLES * (MISSED**2 - 1) / 2
"""Half of the squared residuals beyond noise, of an error of five noise units everywhere."""


def needed(factor: float) -> float:
    """Of a model whose weights, for what it leaves, were multiplied by a factor."""
    shape = (WINDOWS, SAMPLES)
    weights = {"force": np.ones(shape)}
    problem: Any = SimpleNamespace(
        rows=np.zeros(WINDOWS), samples=SAMPLES, period=float(PERIOD), weights=weights
    )
    bench: Any = SimpleNamespace(residuals=lambda model, problem: {"force": np.full(shape, MISSED)})
    present: Any = SimpleNamespace(model=None, factors={"force": np.array([factor])})
    return _needed(bench, present, problem)


def test_a_part_of_what_is_missing_is_enough_where_that_is_worth_many_readings():
    assert needed(1.0) == pytest.approx(HOPE * EXCESS) and HOPE * EXCESS > LEAST


def test_no_less_than_a_likelihood_ratio_that_says_something():
    assert needed((50.0 / EXCESS) ** 0.5) == pytest.approx(LEAST)


def test_an_error_as_long_as_the_recording_leaves_candidates_hope():
    """All of it costs 1.6: less than the least fall, which no candidate could have reached."""
    assert needed((1.6 / EXCESS) ** 0.5) == pytest.approx(PLENTY * 1.6)
