"""Scans laid out for forward mode have values and derivatives of the plain scan, also in a machine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

from jaxmuscle.diagnosis.candidates import loaded, missing
from jaxmuscle.effects import CATALOGUE
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.residuals import Stepping, residual_vector
from jaxmuscle.parameters import get, parameters
from jaxmuscle.simulation.forward_mode import depending_on, linearised_scan

INPUTS = jnp.linspace(-1.0, 2.0, 7)
AT = jnp.array([0.7, -1.3, np.inf])


def swung(scan, values, start=0.4):
    """A nonlinear carry with a count, inputs, a number that is infinite, and outputs."""

    def step(carry, x):
        count, y = carry
        y = jnp.sin(values[0] * y) + values[1] * x * jnp.sqrt(1 + y * y)
        y = jnp.minimum(y, values[2])
        return (count + 1, y), (y * y, count)

    (count, y), (squares, counts) = scan(step, (jnp.asarray(0), jnp.asarray(start)), INPUTS)
    return y, squares, count, counts


def smooth(scan):
    return lambda values: jnp.concatenate([jnp.ravel(part) for part in swung(scan, values)[:2]])


def test_values_are_those_of_the_scan():
    for found, expected in zip(swung(linearised_scan, AT), swung(jax.lax.scan, AT), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
@pytest.mark.parametrize("compiled", [False, True])
def test_derivatives_are_those_of_the_scan(mode, compiled):
    found = mode(smooth(linearised_scan))
    slopes = (jax.jit(found) if compiled else found)(AT)
    np.testing.assert_allclose(slopes, jax.jacfwd(smooth(jax.lax.scan))(AT), rtol=1e-12, atol=1e-15)


def test_many_starts_and_second_derivatives():
    starts = jnp.linspace(-1.0, 1.0, 5)

    def ends(scan):
        return lambda values: jax.vmap(lambda s: swung(scan, values, s)[0])(starts)

    for derivative in (jax.jacfwd, lambda f: jax.jacfwd(jax.jacfwd(f))):
        slopes, expected = (derivative(ends(scan))(AT) for scan in (linearised_scan, jax.lax.scan))
        assert np.abs(np.asarray(expected)).max() > 0.1
        np.testing.assert_allclose(slopes, expected, rtol=1e-11, atol=1e-13)


def test_inputs_that_move_and_nothing_from_outside():
    def total(inputs, scan):
        return scan(lambda carry, x: (carry * x + x, None), 1.0, inputs)[0]

    found, expected = (jax.grad(total)(INPUTS, scan) for scan in (linearised_scan, jax.lax.scan))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_carry_that_depends_on_numbers_in_name_only():
    begin = {"count": jnp.asarray(2), "level": jnp.asarray(0.5)}
    values = {"a": jnp.asarray(np.inf), "b": jnp.asarray(np.nan), "table": jnp.ones(3), "c": 2.0}
    assert depending_on(values, begin) == begin
    assert depending_on({"table": jnp.ones(3)}, begin) is begin

    def end(scale):
        carry = depending_on({"scale": scale}, jnp.asarray(0.5))
        return jax.lax.scan(lambda y, x: (y + scale * x, None), carry, INPUTS)[0]

    np.testing.assert_allclose(jax.grad(end)(3.0), INPUTS.sum(), rtol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("derivatives", ["forward", "linearised"])
def test_jacobian_of_a_machine_with_every_effect(derivatives):
    """Residuals of the links and of the observer, with memories, creep and lags, by every parameter."""
    effects = {"pressure_dependent_ends": {"amplitude": 0.8}}
    prepared = case(driven_recording(effects, driven_card({})), 0.0)
    machine = loaded(prepared.actuator, missing(prepared.actuator, CATALOGUE))
    paths = tuple(parameters(machine))
    theta = jnp.array([float(get(machine, path)) for path in paths])
    # Strengths are zero: at others every effect acts.
    theta = theta + jnp.where(theta == 0, 0.02, 0.0)

    def jacobian(derivatives):
        stepping = Stepping(derivatives=derivatives)
        function = lambda t: residual_vector(t, machine, prepared.training, paths, stepping)  # noqa: E731
        return jax.jit(lambda t: (function(t), jax.jacfwd(function)(t)))(theta)

    (values, slopes), (expected, exact) = jacobian(derivatives), jacobian("any")
    np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-9)
    size = np.abs(np.asarray(exact)).max(axis=0)
    assert (size > 0).sum() > 10
    np.testing.assert_allclose(
        slopes / np.where(size > 0, size, 1), exact / np.where(size > 0, size, 1), atol=1e-9
    )
