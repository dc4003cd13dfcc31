"""Priors that the data contradict, however narrow they are; in a linear model, and in a fit."""

import numpy as np
import pytest
from estimation.linear import ROWS, SLOPES, STD, line, parameters, unknowns
from estimation.made import TRUE, fitted, pulled
from scipy.signal import lfilter

from jaxmuscle.estimation.conflict import with_conflicts
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.minimum import Minimum
from jaxmuscle.fitting.prior import Prior


def conflict(narrow, off, noise=None):
    """Of a prior so many times as wide as what the data know, so many standard deviations off."""
    readings = np.random.default_rng(2).normal(size=ROWS) if noise is None else noise
    alone = np.linalg.lstsq(SLOPES.T, readings, rcond=None)[0]
    std = narrow * STD[0]
    prior = Prior(alone[0] + off * np.hypot(STD[0], std), std)
    information = SLOPES @ SLOPES.T + np.diag([std**-2, 0.0])
    right = SLOPES @ readings + np.array([prior.mean / std**2, 0.0])
    u = np.linalg.solve(information, right).astype(np.float64)
    told = parameters(u, prior=(prior.mean, std))
    ends = np.zeros(2, dtype=int)
    found = with_conflicts(told, Minimum(u, [line(u, readings)], unknowns(prior), Squares(), ends))
    assert found["trend"] == told["trend"]
    return found["level"].conflict


@pytest.mark.parametrize("narrow", [3.0, 1.0, 0.3, 0.1, 0.03])
def test_the_distance_of_the_prior_from_the_data(narrow):
    """Though a prior that is narrow draws the value to itself, and its residuals go together."""
    assert conflict(narrow, 20.0) == pytest.approx(20.0, rel=0.2)
    assert conflict(narrow, 7.0) == pytest.approx(7.0, rel=0.2)
    assert conflict(narrow, 3.0) == 0


def test_a_prior_that_leaves_hardly_anything_to_the_data_is_judged_by_much():
    """What the data draw the value away by has to be more than where a fit may end."""
    assert conflict(0.01, 10.0) == 0
    assert conflict(0.01, 60.0) == pytest.approx(60.0, rel=0.2)


def test_noise_that_goes_together_is_no_conflict():
    """By white noise the prior would be 7 standard deviations off."""
    white = np.random.default_rng(4).normal(size=ROWS + 300)
    coloured = np.asarray(lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], white))[300:]
    assert conflict(0.3, 7.0, coloured) == 0


def test_a_narrow_prior_that_is_wrong_is_named():
    recording = pulled()
    free = fitted(recording, priors={"initial_radius": None, "end_factor": None})
    std = 0.1 * free.std["end_factor"]
    told = {}
    for off in (1.0, 12.0):
        mean = free.values["end_factor"] + off * np.hypot(std, free.std["end_factor"])
        found = fitted(recording, priors={"initial_radius": None, "end_factor": (mean, std)})
        assert abs(found.values["end_factor"] - mean) < 2 * std
        told[off] = [note for note in found.notes() if "away from its prior" in note]
    assert not told[1.0]
    (note,) = told[12.0]
    far = float(note.removeprefix("By the data end_factor is ").split()[0])
    assert far == pytest.approx(12.0, rel=0.1) and f"({mean:g} ± {std:g})" in note
    assert free.values["end_factor"] == pytest.approx(TRUE["end_factor"], rel=1e-3)
