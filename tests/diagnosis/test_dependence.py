"""Tracing what is missing to the variables it depends on, without a guess at its cause."""

import numpy as np
import pytest

from jaxmuscle.diagnosis.dependence import dependence, variables
from jaxmuscle.diagnosis.discrepancy import MissingRate
from jaxmuscle.estimation.case import case
from jaxmuscle.recordings import read
from jaxmuscle.samples import sample

NOISE = 0.8


@pytest.fixture(scope="module")
def prepared():
    return case(read(sample("bench")), 0.3)


def traced(prepared, values, spread=None):
    """Dependence of a missing force with white noise on it."""
    rng = np.random.default_rng(6)
    deviation = np.full(len(values), NOISE) if spread is None else spread
    force = {"force": values + deviation * rng.normal(size=len(values))}
    missing = MissingRate(prepared.actuator.links[0], force, {"force": deviation}, "N")
    return dependence(missing, variables(prepared), prepared)


def unit(values):
    return (values - values.min()) / np.ptp(values)


SHAPES = {
    "position": lambda x: 27 * unit(x) ** 3 - 12 * unit(x),
    "pressure": lambda p: 8 * np.exp(-3 * unit(p)),
    "velocity": lambda v: 5 * np.sign(v),
}


@pytest.mark.parametrize("name", SHAPES)
def test_one_variable(prepared, name):
    found = traced(prepared, SHAPES[name](variables(prepared)[name]))
    assert found.variables == (name,)
    assert found.share > 0.8


def test_product_of_two(prepared):
    named = variables(prepared)
    found = traced(prepared, 12 * unit(named["pressure"]) * np.sign(named["velocity"]))
    assert set(found.variables) == {"pressure", "velocity"}
    assert found.share > 0.8


def test_white_noise_depends_on_nothing(prepared):
    found = traced(prepared, np.zeros(len(prepared.recording)))
    assert (found.variables, found.share) == ((), 0.0)


def test_samples_that_say_nothing_have_no_say(prepared):
    """A third of the samples with a hundred times the noise, known to be so."""
    position = variables(prepared)["position"]
    spread = np.where(np.arange(len(position)) % 3 == 0, 100 * NOISE, NOISE)
    found = traced(prepared, SHAPES["position"](position), spread)
    assert found.variables == ("position",)
    assert found.share > 0.5


def test_held_out_rows_have_no_say(prepared):
    values = SHAPES["position"](variables(prepared)["position"])
    spoilt = values.copy()
    spoilt[round(0.7 * len(values)) :] = 1e6
    assert traced(prepared, spoilt) == traced(prepared, values)


def test_variables_by_name(prepared):
    named = variables(prepared)
    assert set(named) == {"pressure", "position", "velocity"}
    np.testing.assert_array_equal(named["velocity"], prepared.observed.track.measured["velocity"])
    swing = variables(case(read(sample("swing")).part(0, 2000), 0.3))
    assert set(swing) == {"pressure_1", "pressure_2", "angle", "angular_velocity"}
    assert not np.array_equal(swing["pressure_1"], swing["pressure_2"])
