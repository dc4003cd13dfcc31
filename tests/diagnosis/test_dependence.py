"""Tracing what is missing to the variables it depends on, without a guess at its cause."""

import numpy as np
import pytest

from jaxmuscle.diagnosis.dependence import dependence, missing_constant, variables
from jaxmuscle.diagnosis.discrepancy import MissingRate
from jaxmuscle.estimation.case import case
from jaxmuscle.recordings import read
from jaxmuscle.samples import sample

NOISE = 0.8


@pytest.fixture(scope="module")
def prepared():
    return case(read(sample("bench")), 0.3)


def lacking(prepared, values, spread=None):
    """A missing force with white noise on it."""
    rng = np.random.default_rng(6)
    deviation = np.full(len(values), NOISE) if spread is None else spread
    force = {"force": values + deviation * rng.normal(size=len(values))}
    return MissingRate(prepared.actuator.links[0], force, {"force": deviation}, "N")


def slopes_along(values, *free):
    """Slopes of a missing force by free parameters, none by default."""
    return {"force": np.stack([*free, np.zeros(len(values))], axis=1)}


def traced(prepared, values, spread=None, free=()):
    missing = lacking(prepared, values, spread)
    return dependence(missing, variables(prepared), prepared, slopes_along(values, *free))


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
    assert (found.variables, found.share) == ((), 0.0) and found.constant < 0.01


def test_what_a_free_parameter_is_bent_by_depends_on_nothing(prepared):
    """Too much friction in the model, to make up for a weight: what is missing seems to go with velocity."""
    sliding = np.tanh(variables(prepared)["velocity"] / 1e-3)
    found = traced(prepared, 5 * sliding)
    assert found.variables == ("velocity",) and found.share > 0.8 and found.constant < 0.1
    bent = traced(prepared, 5 * sliding, free=[40 * sliding])
    assert (bent.variables, bent.share) == ((), 0.0) and bent.constant < 0.1
    position = SHAPES["position"](variables(prepared)["position"])
    beside = traced(prepared, 5 * sliding + position, free=[40 * sliding])
    assert beside.variables == ("position",) and beside.share > 0.8


def test_a_constant_is_told_beside_free_parameters(prepared):
    velocity = variables(prepared)["velocity"]
    sliding = np.tanh(velocity / 1e-3)
    values, free = 3.0 - 5 * sliding, [sliding, 1e9 * np.exp(velocity)]
    found = traced(prepared, values, free=free)
    assert (found.variables, found.share) == ((), 0.0)
    # The other parameter is a constant itself, nearly.
    assert found.constant < 0.2 and traced(prepared, values, free=free[:1]).constant > 0.9
    level = missing_constant(lacking(prepared, values), prepared, slopes_along(values, sliding))
    assert level == pytest.approx(3.0, abs=4 * NOISE / np.sqrt(len(values)))


def test_the_constant_is_that_of_the_column_where_it_is_largest(prepared):
    draw = np.random.default_rng(2)
    noise, rows = {"first": 1.0, "second": 0.01}, len(prepared.recording)
    values = {name: std * (draw.normal(size=rows) + i + 1) for i, (name, std) in enumerate(noise.items())}
    spread = {name: np.full(rows, std) for name, std in noise.items()}
    missing = MissingRate(prepared.actuator.links[0], values, spread, "N")
    none = {name: np.zeros((rows, 0)) for name in noise}
    assert missing_constant(missing, prepared, none) == pytest.approx(0.02, abs=0.002)


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
