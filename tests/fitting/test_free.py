"""Coordinates of a fit: starts, bounds, what is left alone, distances from priors."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

from jaxmuscle.fitting.free import LINEAR, LOGARITHMIC, SOFT, Free, Prior, free
from jaxmuscle.parameters import get, parameters

ORDER = [
    "muscle.end_factor",
    "effects.load_friction.force",
    "effects.bladder_stiffness.stiffness",
    "valve.area",
]
FAR = jnp.array([-1e6, -700.0, -50.0, -3.0, -0.1, 0.1, 3.0, 50.0, 700.0, 1e6])


def alike(kind, start, scale, size):
    """`size` parameters of one kind."""
    ones = jnp.ones(size)
    paths = tuple(f"p{i}" for i in range(size))
    return Free(paths, start * ones, scale * ones, kind * jnp.ones(size, int), start * ones, jnp.inf * ones)


@pytest.fixture(scope="module")
def model():
    return bench.model("isotonic", load_friction={"force": 12.0}, bladder_stiffness={"stiffness": -40.0})


@pytest.mark.parametrize("scale", [1e-3, 0.5, 40.0])
@pytest.mark.parametrize(
    ("kind", "start"), [(LINEAR, -0.7), (LINEAR, 0.0), (LOGARITHMIC, 2e-6), (SOFT, 0.4), (SOFT, 12.0)]
)
def test_zero_is_the_start(kind, start, scale):
    values = alike(kind, start, scale, 1).values(jnp.zeros(1))
    np.testing.assert_allclose(values, start, rtol=1e-12, atol=0)


def test_nonnegative_start_at_zero_is_a_hundredth_of_the_scale():
    """Not zero itself, where the transform is flat: a fit could hardly leave it."""
    values = alike(SOFT, 0.0, 3.0, 1).values(jnp.zeros(1))
    assert 0 < values[0] < 0.011 * 3.0


def test_linear_takes_any_value():
    values = alike(LINEAR, 2.0, 0.5, 3).values(jnp.array([-10.0, 1.0, 4.0]))
    np.testing.assert_allclose(values, [-3.0, 2.5, 4.0], rtol=1e-14)


@pytest.mark.parametrize("start", [2e-6, 1.3])
def test_positive_stays_positive(start):
    values = alike(LOGARITHMIC, start, 0.3 * start, len(FAR)).values(FAR)
    assert np.isfinite(values).all()
    assert (values > 0).all()
    assert (np.diff(values) >= 0).all()
    assert values[0] < 1e-6 * start
    assert values[-1] > 1e6 * start


@pytest.mark.parametrize("start", [0.0, 0.5, 20.0])
def test_nonnegative_stays_nonnegative(start):
    values = alike(SOFT, start, 2.0, len(FAR)).values(FAR)
    assert np.isfinite(values).all()
    assert (values >= 0).all()
    assert (np.diff(values) >= 0).all()
    assert values[0] < 1e-3
    # Far from the bound the transform is the identity in units of the scale.
    assert values[-1] == pytest.approx(start + 2.0 * float(FAR[-1]), rel=1e-4)


@pytest.mark.parametrize(("kind", "start"), [(LINEAR, 1.3), (LOGARITHMIC, 1.3), (SOFT, 20.0)])
def test_unit_of_the_coordinate_is_the_scale(kind, start):
    description = alike(kind, start, 0.01, 1)
    slope = (description.values(jnp.full(1, 1e-4)) - description.values(jnp.full(1, -1e-4))) / 2e-4
    np.testing.assert_allclose(slope, 0.01, rtol=1e-3)


def test_kinds_come_from_the_parameters(model):
    entries = parameters(model)
    assert entries["effects.load_friction.force"].nonnegative
    assert entries["valve.area"].positive
    description = free(model, ORDER, {}, {}, ORDER)
    expected = {ORDER[1]: SOFT, ORDER[2]: LINEAR, ORDER[3]: LOGARITHMIC}
    kinds = dict(zip(description.paths, map(int, description.kind), strict=True))
    assert {path: kinds[path] for path in expected} == expected


def test_apply_moves_the_chosen_and_no_others(model):
    chosen = ["valve.area", "effects.bladder_stiffness.stiffness"]
    description = free(model, chosen, {}, {}, ORDER)
    z = jnp.array([0.0, 0.0, 2.0, -1.0])
    moved = description.apply(model, z)
    for path in ORDER:
        before, after = float(get(model, path)), float(get(moved, path))
        assert (after != before) == (path in chosen), path
    # A tenth of the value is the scale of a parameter without a prior.
    assert float(get(moved, chosen[1])) == pytest.approx(-40.0 + 2 * 4.0)
    assert float(get(moved, chosen[0])) == pytest.approx(2e-6 * np.exp(-0.1))


def test_scale_is_that_of_the_prior_then_the_given_one(model):
    description = free(model, ORDER, {ORDER[0]: Prior(1.2, 0.05)}, {ORDER[1]: 6.0}, ORDER)
    np.testing.assert_allclose(description.scale, [0.05, 6.0, 4.0, 2e-7], rtol=1e-12)


def test_distance_from_a_linear_prior(model):
    prior = {ORDER[2]: Prior(-50.0, 4.0)}
    description = free(model, ORDER[2:3], prior, {}, ORDER)
    distance = description.prior_residuals(jnp.zeros(4))
    np.testing.assert_allclose(distance, [0, 0, (-40.0 + 50.0) / 4.0, 0], rtol=1e-12)


def test_distance_from_a_positive_prior_is_logarithmic(model):
    prior = {ORDER[3]: Prior(1.6e-6, 4e-7)}
    description = free(model, ORDER[3:], prior, {}, ORDER)
    z = jnp.array([0, 0, 0, 1.5])
    area = 2e-6 * np.exp(4e-7 / 2e-6 * 1.5)
    np.testing.assert_allclose(
        description.prior_residuals(z)[3], 1.6e-6 * np.log(area / 1.6e-6) / 4e-7, rtol=1e-12
    )


def test_prior_of_a_parameter_that_is_not_chosen_does_not_count(model):
    description = free(model, ORDER[:1], {ORDER[3]: Prior(1e-6, 1e-9)}, {}, ORDER)
    np.testing.assert_array_equal(description.prior_residuals(jnp.zeros(4)), np.zeros(4))
