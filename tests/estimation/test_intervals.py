"""Profile likelihoods: of nearly linear parameters, of undetermined ones, at bounds, out of time.

The interval of a value that ended at a bound: the likelihood ratio on the allowed side.

Priors that the data contradict, however narrow they are; in a linear model, and in a fit.
"""

import numpy as np
import pytest
from estimation.linear import ROWS, SLOPES, STD, line, parameters, unknowns
from estimation.made import TRUE, fitted, pulled
from scipy.signal import lfilter

from jaxmuscle.estimation.covariance import Minimum, covariance
from jaxmuscle.estimation.free_parameters import Prior
from jaxmuscle.estimation.intervals import with_conflicts, with_inner_ends
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.formatting import estimate


def test_profile_of_a_nearly_linear_parameter_is_its_interval(recording, result):
    found = fitted(recording, profiles=["end_factor"])
    (curve,) = found.profiles
    low, high = found.parameters["end_factor"].interval()
    assert (curve.lower, curve.upper) == pytest.approx((low, high), rel=1e-4)
    assert curve.deviance.min() == 0
    np.testing.assert_allclose(curve.deviance[[0, -1]], 9.0, rtol=0.1)


def test_profile_of_what_is_not_determined_is_open(recording):
    found = fitted(
        recording, "end_factor", "initial_length", profiles=["initial_length"], priors={"end_factor": None}
    )
    (curve,) = found.profiles
    assert curve.deviance.max() < 1.0
    assert (curve.lower, curve.upper) == (-np.inf, np.inf)


def test_a_profile_ends_at_a_bound(recording, result):
    """The bound is half a standard deviation above; the interval goes up to it and no farther."""
    bound = result.values["end_factor"] + 0.5 * result.std["end_factor"]
    found = fitted(recording, profiles=["end_factor"], bounds={"end_factor": (None, bound)})
    (curve,) = found.profiles
    assert curve.upper == bound == curve.values[-1]
    assert (np.diff(curve.values) > 0).all() and curve.missing == 0
    assert curve.lower == pytest.approx(result.parameters["end_factor"].interval()[0], rel=1e-4)
    np.testing.assert_array_equal(np.sign(curve.roots), [-1, -1, -1, 0, 1])
    figure = found.plot()
    drawn = next(a for a in figure.get_axes() if a.get_title(loc="left") == "end_factor")
    heights = np.asarray(drawn.lines[1].get_ydata())
    np.testing.assert_allclose(heights[[0, -1]], curve.deviance[[0, -1]], rtol=1e-9)


@pytest.mark.slow
def test_a_profile_without_time_or_steps_has_no_points():
    """One that is only on its way would look too steep."""
    for how in ({"budget": 0.0}, {"steps": 1}):
        found = fitted(pulled(off=1.4, threads=True), profiles=["end_factor"], **how)
        (curve,) = found.profiles
        assert curve.missing == 6 and list(curve.values) == pytest.approx([found.values["end_factor"]])
        assert (curve.lower, curve.upper) == (-np.inf, np.inf)
        assert any("The profile of end_factor lacks 6 of its points" in note for note in found.notes())
        found.plot()


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
    assert far == pytest.approx(12.0, rel=0.1) and f"({estimate(mean, std, '')})" in note
    assert free.values["end_factor"] == pytest.approx(TRUE["end_factor"], rel=1e-3)
