"""What free parameters cannot take over of residuals."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.linalg import lstsq

from jaxmuscle.diagnosis import variable_projection
from jaxmuscle.diagnosis.variable_projection import basis_of, outside_span, weighted_residuals
from jaxmuscle.optimization.descents import BROKEN

SAMPLES = 50


@pytest.mark.parametrize("seed", range(3))
def test_what_is_left_is_what_least_squares_leaves(seed):
    generator = np.random.default_rng(seed)
    slopes, vector = generator.normal(size=(4, SAMPLES)), generator.normal(size=SAMPLES)
    solution = lstsq(slopes.T, vector)
    assert solution is not None
    np.testing.assert_allclose(
        outside_span(basis_of(slopes), vector), vector - slopes.T @ solution[0], atol=1e-12
    )


def test_nothing_is_taken_over_where_nothing_is_free():
    vector = np.arange(5.0)
    np.testing.assert_array_equal(outside_span(basis_of(np.zeros((0, 5))), vector), vector)


@pytest.fixture
def by_name(monkeypatch):
    """Residuals that are told by a name in the place of a model: a shift of 10, a wave of 1, one broken."""
    values = {
        "shifted": np.full(SAMPLES, 10.0),
        "wave": np.sin(np.arange(float(SAMPLES))),
        "broken": np.full(SAMPLES, np.nan),
    }
    monkeypatch.setattr(variable_projection, "evaluate", lambda model, problem: values[model])
    layout = SimpleNamespace(of=lambda model, problem: SimpleNamespace(join=lambda found: found))
    monkeypatch.setattr(variable_projection, "ResidualLayout", layout)
    return lambda name: weighted_residuals(cast(Any, name), cast(Any, None), np.zeros(1))


def test_a_constant_that_a_free_one_takes_over_leaves_less_than_a_wave_that_it_cannot(by_name):
    basis = basis_of(np.append(np.ones(SAMPLES), 0.1)[None, :])
    shifted, wave = (outside_span(basis, by_name(name)) for name in ("shifted", "wave"))
    assert shifted @ shifted < 3.0 < wave @ wave < 26.0


def test_what_is_not_a_number_counts_as_broken(by_name):
    assert list(by_name("broken")) == [BROKEN] * SAMPLES + [0.0]
