"""The analytic inverse, and the integral inverse of [W]."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built
from oracles.loops import CLASSICAL, EXPONENTIAL, MODIFIED, outputs
from oracles.relays import way

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis import (
    IntegralInverse,
    PrandtlIshlinskii,
    elbow_classical,
    elbow_modified,
    inverse,
    inverse_memory,
    inverted,
    respond,
)

SHIFTED = built(PrandtlIshlinskii, 0.7, [0.4, 0.2], [0.1, 0.5], -2.0)
RANDOM = np.cumsum(np.random.default_rng(3).normal(0, 0.3, 500))


def test_inverse_undoes_the_model():
    back = inverse(CLASSICAL)
    _, there = respond(CLASSICAL, RANDOM)
    _, again = respond(back, there, inverse_memory(CLASSICAL, CLASSICAL.rest()))
    np.testing.assert_allclose(again, RANDOM, rtol=0, atol=1e-10)


def test_model_undoes_the_inverse():
    back = inverse(CLASSICAL)
    start = inverse_memory(CLASSICAL, CLASSICAL.rest())
    _, inputs = respond(back, RANDOM, start)
    np.testing.assert_allclose(respond(CLASSICAL, inputs)[1], RANDOM, rtol=0, atol=1e-10)
    twice = inverse(back)
    for name in ("gain", "weights", "thresholds", "offset"):
        np.testing.assert_allclose(getattr(twice, name), getattr(CLASSICAL, name), rtol=0, atol=1e-12)


def test_inverse_starts_in_the_middle_of_a_history():
    memory, _ = outputs(CLASSICAL, 0.0, 1.2, -0.4, 0.3)
    _, there = outputs(CLASSICAL, 0.3, 0.9, -1.0, memory=memory)
    _, again = respond(inverse(CLASSICAL), there, inverse_memory(CLASSICAL, memory))
    np.testing.assert_allclose(again, way((0.3, 0.9, -1.0), 40), rtol=0, atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_inverse_of_random_models(seed):
    rng = np.random.default_rng(seed)
    model = built(PrandtlIshlinskii, 1.0, rng.uniform(-0.1, 0.6, 6), np.cumsum(rng.uniform(0.02, 0.4, 6)))
    _, there = respond(model, RANDOM)
    np.testing.assert_allclose(respond(inverse(model), there)[1], RANDOM, rtol=0, atol=1e-10)


def test_inverse_has_finite_slopes_as_finite_differences_have():
    def back(gain):
        model = built(PrandtlIshlinskii, gain, CLASSICAL.weights, CLASSICAL.thresholds)
        return respond(inverse(model), jnp.asarray(RANDOM[:60]))[1]

    slope = jax.jit(jax.jacfwd(back))(jnp.asarray(0.8))
    difference = (back(0.8 + 1e-6) - back(0.8 - 1e-6)) / 2e-6
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-7)


def test_refuses_what_cannot_be_inverted():
    with pytest.raises(InputError, match="an output that rises with the input"):
        inverse(elbow_classical().expanded())
    with pytest.raises(InputError, match="thresholds that increase"):
        inverse(built(PrandtlIshlinskii, 1.0, [0.1, 0.1], [0.5, 0.2]))


def test_integral_inverse_approaches_the_analytic_one():
    """Its error decays with rate K s and is what the target moves in 1/(K s) seconds."""
    step, targets = 1e-3, way((0.3, 1.5, -0.5, 0.8), 1000)
    _, exact = respond(inverse(CLASSICAL), targets, inverse_memory(CLASSICAL, CLASSICAL.rest()))

    def error(gain):
        found = inverted(built(IntegralInverse, CLASSICAL, gain), jnp.asarray(targets), step)
        return float(jnp.abs(found - exact).max())

    slow, fast = error(50.0), error(500.0)
    assert fast < 0.11 * slow
    # Targets move by 2 a second at most, against a slope of 0.8 at least: 2 / (500 · 0.8²) of input.
    assert fast < 2 / (500 * 0.8**2)


def test_integral_inverse_follows_the_modified_model_where_there_is_no_analytic_one():
    targets = jnp.asarray(np.repeat(np.linspace(-1.0, 2.0, 7)[[0, 3, 6, 2, 5, 1]], 400))
    inputs = inverted(built(IntegralInverse, MODIFIED, 100.0), targets, 1e-3)
    reached = respond(MODIFIED, inputs)[1]
    np.testing.assert_allclose(reached[399::400], targets[399::400], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "model", [CLASSICAL, EXPONENTIAL.expanded(), SHIFTED], ids=["c", "exponential", "-c"]
)
@pytest.mark.parametrize("first", [0.0, 0.03, 1.0, -2.0])
def test_inverse_is_right_from_rest(model, first):
    inputs = first + RANDOM
    _, there = respond(model, inputs)
    _, again = respond(inverse(model), there)
    np.testing.assert_allclose(again, inputs, rtol=0, atol=1e-10)
    # The other way round, and the inverse of the inverse is the model, unused.
    back = inverse(model)
    np.testing.assert_allclose(respond(model, respond(back, inputs)[1])[1], inputs, rtol=0, atol=1e-10)
    np.testing.assert_allclose(inverse(back).rest(), model.rest(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.rest(), inverse_memory(model, model.rest()), rtol=0, atol=1e-12)


@pytest.mark.parametrize("model", [elbow_modified(), MODIFIED, SHIFTED], ids=["Table 2", "modified", "-c"])
def test_integral_inverse_is_right_from_rest(model):
    # To outputs that the unused model reaches while its input rises.
    wanted = respond(model, np.linspace(0.0, 1.0, 5))[1]
    targets = jnp.repeat(wanted, 3000)
    steepest = float(jnp.abs(jnp.diff(respond(model, np.linspace(0, 1, 2001))[1])).max()) * 2000
    inputs = inverted(built(IntegralInverse, model, 0.5 / (1e-3 * steepest)), targets, 1e-3)
    np.testing.assert_allclose(respond(model, inputs)[1][2999::3000], wanted, rtol=0, atol=1e-6)
    np.testing.assert_allclose(inputs[2999::3000], np.linspace(0.0, 1.0, 5), rtol=0, atol=1e-5)


def test_inverse_from_rest_has_the_slopes_of_finite_differences_over_the_offset():
    def back(offset):
        model = built(PrandtlIshlinskii, 0.8, CLASSICAL.weights, CLASSICAL.thresholds, offset)
        return respond(inverse(model), jnp.asarray(RANDOM[:60]))[1]

    slope = jax.jit(jax.jacfwd(back))(jnp.asarray(0.3))
    difference = (back(0.3 + 1e-6) - back(0.3 - 1e-6)) / 2e-6
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-7)
