"""The interval of a value that ended at a bound: the likelihood ratio on the allowed side."""

import numpy as np
import pytest
from estimation.linear import ROWS, SLOPES, STD, line, parameters, unknowns

from jaxmuscle.estimation.bounded import with_inner_ends
from jaxmuscle.estimation.covariance import covariance
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.minimum import Minimum


def trend_beside(level, readings):
    """Both at a given level, the trend fitted."""
    rest = readings - level * SLOPES[0]
    return np.array([level, rest @ SLOPES[1] / (SLOPES[1] @ SLOPES[1])])


def interval(readings, lower=-np.inf, upper=np.inf):
    """Of the level, as a fit within these bounds has it, and the residuals there."""
    u = np.linalg.lstsq(SLOPES.T, readings, rcond=None)[0]
    end = -1 if u[0] < lower else 1 if u[0] > upper else 0
    u = trend_beside(lower if end < 0 else upper, readings) if end else u
    inner, given = unknowns(lower=lower, upper=upper), line(u, readings)
    minimum = Minimum(u, [given], inner, Squares(), np.array([end, 0]))
    told = parameters(u, lower=lower, upper=upper, std=float(minimum.covariance().std[0]))
    found = with_inner_ends(told, minimum)
    assert (found["level"].inner is None) == (end == 0) and found["trend"] == told["trend"]
    return found["level"].interval(), given


@pytest.mark.parametrize("true", [0.0, 0.5, 1.2, 2.5])
def test_coverage_beside_a_bound(true):
    """Of the truth so many standard deviations inside, over 100 draws; 91 hits are few."""
    hits = []
    for seed in range(100):
        readings = true * STD[0] * SLOPES[0] + np.random.default_rng(seed).normal(size=ROWS)
        low, high = interval(readings, lower=0.0)[0]
        hits.append(low <= true * STD[0] <= high)
    assert np.mean(hits) >= 0.91


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("outside", [0.0, 1.0, 6.0])
def test_the_deviance_at_the_inner_end(side, outside):
    """By how much the cost rises with the trend fitted anew, for noise as large as the residuals say."""
    readings = np.random.default_rng(3).normal(size=ROWS)
    readings -= SLOPES.T @ np.linalg.lstsq(SLOPES.T, readings, rcond=None)[0]
    readings = readings + side * outside * STD[0] * SLOPES[0]
    bound = -1e-6 * side
    ends, given = interval(readings, **{"upper" if side > 0 else "lower": bound})
    inner = ends[0] if side > 0 else ends[1]
    there = trend_beside(inner, readings) @ SLOPES - readings
    sure = covariance([given], unknowns(), Squares(), np.zeros(2, bool))
    excess = (sure.std[0] / sure.assumed[0]) ** 2
    assert (there @ there - given.residual @ given.residual) / excess == pytest.approx(3.8415, rel=1e-3)
    assert ends[1 if side > 0 else 0] == bound


def test_it_ends_at_the_other_bound():
    readings = np.random.default_rng(3).normal(size=ROWS) - 2 * STD[0] * SLOPES[0]
    assert interval(readings, lower=0.0, upper=1e-3 * STD[0])[0] == (0.0, 1e-3 * STD[0])
