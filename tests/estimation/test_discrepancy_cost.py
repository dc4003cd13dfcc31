"""The cost of what a model leaves, and the weights that belong to it."""

import numpy as np
import pytest

from jaxmuscle.estimation.weights import Discrepancy


@pytest.mark.parametrize("square", [0.3, 0.999, 1.001, 4.0, 1e4])
def test_weights_are_those_of_the_costs_slope(square):
    """D cost / d r² is N/2 times the squared factor: a fit by these weights is at a minimum of the cost."""
    readings, time, step = 500, 12.0, 1e-6 * square
    ends = [Discrepancy(readings, square + side * step, time).cost for side in (-1, 1)]
    slope = (ends[1] - ends[0]) / (2 * step)
    assert slope == pytest.approx(0.5 * readings * Discrepancy(readings, square, time).factor ** 2, rel=1e-4)


def test_white_noise_of_the_sensor_is_no_discrepancy():
    rng = np.random.default_rng(2)
    found = Discrepancy.of(rng.normal(size=4000), np.ones(4000, dtype=bool))
    assert found.factor == pytest.approx(1.0, abs=0.05)


def test_a_lasting_deviation_counts_as_few_readings():
    """10 noise units that last 100 samples each: the sum of all squares is worth their number at most."""
    rng = np.random.default_rng(3)
    steps = 10 * np.repeat(rng.normal(size=40), 100) + rng.normal(size=4000)
    found = Discrepancy.of(steps, np.ones(4000, dtype=bool))
    assert 30 < found.time < 200
    assert found.square * found.factor**2 * found.readings < 4000 / 30


def test_a_recording_without_readings_that_count_costs_nothing():
    found = Discrepancy.of(np.ones(100), np.zeros(100, dtype=bool))
    assert (found.readings, found.factor, found.cost) == (0, 1.0, 0.0)


def test_a_drift_leaves_one_independent_reading_at_least():
    walk = np.cumsum(np.random.default_rng(4).normal(size=3000))
    assert Discrepancy.of(walk, np.ones(3000, dtype=bool)).time <= 3000
