"""Windows whose derivatives do not hold are told from windows that know much."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from estimation.test_covariance import unknowns

from jaxmuscle.estimation.covariance import covariance
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.nonsmooth import without_rough
from jaxmuscle.estimation.residual_analysis import Series
from jaxmuscle.estimation.residual_layout import ResidualLayout

WINDOWS, LENGTH, ODD = 40, 30, 17
TRUE = np.array([0.3, -0.2])
WAVES = np.stack([np.ones(LENGTH), np.sin(np.arange(LENGTH))])
NOISE = np.random.default_rng(0).normal(size=(WINDOWS, LENGTH))


def residuals(u, odd):
    """Of all windows, and their derivatives: linear in two parameters, but for one window as `odd` says."""
    away, slopes = u - TRUE, np.tile(WAVES, (WINDOWS, 1, 1))
    values = NOISE + away @ WAVES
    extra, steep = odd(away)
    values[ODD] += extra
    slopes[ODD] += np.asarray(steep)[:, None]
    return values.ravel(), slopes.transpose(1, 0, 2).reshape(2, -1)


def fold(away):
    """A prediction that hardly moves, with derivatives as of one that runs away."""
    return 0.01 * np.sin(1e9 * away.sum()), 1e7 * np.cos(1e9 * away.sum()) * np.ones(2)


def sharp(away):
    """A window that knows the first parameter a thousand times better than all others, truly."""
    return 3e4 * away[0], (3e4, 0.0)


def sharp_and_bent(away):
    """So it does, within a curve."""
    return 3e4 * np.expm1(away[0]), (3e4 * np.exp(away[0]), 0.0)


def sharp_on_a_fold(away):
    """It does, and the more so than it claims to know the second parameter: of that it knows nothing."""
    return 3e9 * away[0] + 0.01 * np.sin(1e9 * away[1]), (3e9, 1e7 * np.cos(1e9 * away[1]))


def fold_and_sharp(away):
    """It does, but claims to know the second parameter still better."""
    return 3e4 * away[0] + 0.01 * np.sin(1e9 * away[1]), (3e4, 1e7 * np.cos(1e9 * away[1]))


def saturating(away):
    """A window that knows the first parameter well and, from there on, as much of any value that is off."""
    return 50 * np.tanh(1000 * away[0]), (5e4 / np.cosh(1000 * away[0]) ** 2, 0.0)


class Clock:
    """Of a recording at 10 Hz."""

    time = 0.1 * np.arange(WINDOWS * LENGTH)

    def __len__(self):
        return len(self.time)


def objective(odd):
    """As much of an objective as is looked at."""

    def at(number, points):
        found = [residuals(u, odd) for u in points]
        return np.stack([r for r, _ in found]), np.stack([slopes for _, slopes in found])

    problem = SimpleNamespace(rows=LENGTH * np.arange(WINDOWS))
    station = SimpleNamespace(
        label="run",
        problem=problem,
        period=LENGTH,
        recording=Clock(),
        layout=ResidualLayout({"y": ("y",)}, np.arange(WINDOWS * LENGTH).reshape(WINDOWS, LENGTH)),
    )
    made: Any = SimpleNamespace(unknowns=unknowns(count=2), stations=[station], residuals=at)
    return made


def judged(odd):
    """Standard deviations at the truth, and the windows that were left out of them."""
    r, slopes = residuals(TRUE, odd)
    every = np.ones(len(r), bool)
    line = Series(0, "y", "y", every, r, slopes, np.repeat(np.arange(WINDOWS), LENGTH))
    lines, rough = without_rough(objective(odd), TRUE, [line])
    return covariance(lines, unknowns(count=2), Squares(), np.zeros(2, bool)), rough, covariance(
        [line], unknowns(count=2), Squares(), np.zeros(2, bool)
    )  # fmt: skip


def test_a_window_on_a_fold_is_left_out_and_named():
    found, (rough, other), untreated = judged(fold)
    plain, none, _ = judged(lambda away: (0.0, (0.0, 0.0)))
    assert none == ()
    # One window of forty less.
    np.testing.assert_allclose(found.independent, plain.independent * np.sqrt(40 / 39), rtol=0.05)
    assert (rough.recording, rough.begin, rough.end) == ("run", 51.0, pytest.approx(53.9))
    assert rough.promised > 1e4 and rough.found < 10
    assert {rough.parameter, other.parameter} == {"p0", "p1"} and other.begin == rough.begin
    # What it was before: the direction that the window claims to know has drowned the other.
    assert np.isinf(untreated.std).all()


@pytest.mark.parametrize("odd", [sharp_on_a_fold, fold_and_sharp])
def test_a_fold_in_one_parameter_leaves_what_is_known_of_another(odd):
    found, (rough,), _ = judged(odd)
    plain, _, _ = judged(lambda away: (0.0, (0.0, 0.0)))
    assert (rough.parameter, rough.begin) == ("p1", 51.0)
    steep = odd(np.zeros(2))[1][0]
    assert found.independent[0] == pytest.approx(1 / (steep * np.sqrt(LENGTH)), rel=0.1)
    assert found.independent[1] == pytest.approx(plain.independent[1] * np.sqrt(40 / 39), rel=0.05)
    assert np.isfinite(found.std).all()


def slanting_fold(away):
    """A fold that is steep in the first parameter, and in the second less than what the others know."""
    phase = 1e9 * (away[0] + 1e-6 * away[1])
    return 0.01 * np.sin(phase), (1e7 * np.cos(phase), 10 * np.cos(phase))


def test_a_window_that_failed_in_one_parameter_is_tested_in_all():
    found, rough, _ = judged(slanting_fold)
    plain, _, _ = judged(lambda away: (0.0, (0.0, 0.0)))
    assert [each.parameter for each in rough] == ["p0", "p1"]
    np.testing.assert_allclose(found.independent, plain.independent * np.sqrt(40 / 39), rtol=0.05)


@pytest.mark.parametrize("odd", [sharp, sharp_and_bent, saturating])
def test_a_window_that_knows_much_stays(odd):
    found, rough, _ = judged(odd)
    assert rough == ()
    assert found.independent[0] < 1e-5


def test_what_the_others_do_not_know_stays():
    """A parameter that shows in one window alone: nothing is there to compare with."""

    def alone(away):
        return 50 * away[1], (0.0, 50.0)

    line = Series(0, "y", "y", np.ones(60, bool), np.zeros(60),
                  np.stack([np.ones(60), np.where(np.arange(60) < 30, 50.0, 0.0)]),
                  np.repeat([0, 1], 30))  # fmt: skip
    lines, rough = without_rough(objective(alone), TRUE, [line])
    assert rough == () and lines[0].slopes[1].any()
