"""Derivatives of whole responses over every parameter against finite differences, singly and under vmap."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.loops import MODELS, frame_rule
from oracles.relays import way

from jaxmuscle.hysteresis import dahl, dahl_between_limits, play, respond
from jaxmuscle.parameters import parameters, replace

WAYS = {
    "at rest": np.zeros(24),
    "rising": way((0.0, 1.3137), 23),
    "reversing": way((0.0, 1.2239, -0.7171, 0.9313, -0.2017, 1.3137), 11),
    "dwelling": np.repeat(way((0.0, 1.1173, -0.6119), 8), 3),
}
LANES = {name: np.resize(np.concatenate([w, np.full(60, w[-1])]), 56) for name, w in WAYS.items()}
INPUTS = jnp.asarray(np.stack(list(LANES.values())))
ENDS = [f"{half}[{i}]" for half in ("rising", "falling") for i in (0, 11)]
"""Outputs at the ends of a major loop, which both halves share: one cannot move by itself."""
ALL = {**MODELS, "frame": frame_rule(12)}


def packed(model):
    """A vector of all numbers of a model, and the way back."""
    entries = {path: np.asarray(p.value, float) for path, p in parameters(model).items()}
    sizes = np.cumsum([v.size for v in entries.values()])[:-1]

    def unpacked(vector):
        parts = jnp.split(vector, sizes)
        return replace(
            model, {k: p.reshape(v.shape) for (k, v), p in zip(entries.items(), parts, strict=True)}
        )

    names = [f"{k}[{i}]" for k, v in entries.items() for i in range(v.size)]
    return np.concatenate([v.ravel() for v in entries.values()]), unpacked, names


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_over_every_parameter(name):
    vector, unpacked, names = packed(ALL[name])
    answer = jax.jit(lambda vector, values: respond(unpacked(vector), values)[1])
    lanes = jax.jit(jax.vmap(answer, in_axes=(None, 0)))
    slopes = jax.jit(jax.vmap(jax.jacfwd(answer), in_axes=(None, 0)))(vector, INPUTS)
    h = 1e-6
    steps = h * np.eye(len(vector))
    difference = np.stack(
        [(lanes(vector + s, INPUTS) - lanes(vector - s, INPUTS)) / (2 * h) for s in steps], -1
    )
    # What is of order one is good to 1e-15, its difference to 1e-9 beside the curvature.
    inner = ~np.isin(names, ENDS)
    wrong = np.argwhere((np.abs(slopes - difference) > 3e-8 + 1e-6 * np.abs(difference)) & inner)
    assert not len(wrong), [(list(LANES)[i], j, names[k]) for i, j, k in wrong[:9]]
    if name == "frame":
        return  # not compiled once more for a single lane
    single = jax.jit(jax.jacfwd(answer))(vector, INPUTS[2])
    np.testing.assert_allclose(single, slopes[2], rtol=1e-12, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["classical", "modified"])
def test_backward_mode_is_forward_mode(name):
    vector, unpacked, _ = packed(MODELS[name])

    def total(vector):
        return (respond(unpacked(vector), INPUTS[2])[1] ** 2).sum()

    np.testing.assert_allclose(jax.grad(total)(vector), jax.jacfwd(total)(vector), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", ["classical", "modified"])
def test_over_the_input(name):
    model, values = MODELS[name], INPUTS[2][:40] + 1e-3 * jnp.arange(40)
    slopes = jax.jacfwd(lambda v: respond(model, v)[1])(values)
    h = 1e-7
    up, down = (jax.vmap(lambda v: respond(model, v)[1])(values + s * h * jnp.eye(40)) for s in (1, -1))
    np.testing.assert_allclose(slopes, ((up - down) / (2 * h)).T, rtol=1e-6, atol=1e-6)
    assert (np.triu(slopes, 1) == 0).all()


@pytest.mark.parametrize("memory", [-0.2, 0.0, 0.2])
def test_on_a_kink_the_slope_lies_between_the_two_sides(memory):
    slope = float(jax.grad(lambda v: play(jnp.asarray([memory]), v, np.array([0.2]))[0])(jnp.asarray(0.0)))
    assert 0 <= slope <= 1


@pytest.mark.slow
def test_dahl_at_a_standstill_and_beyond():
    z = jnp.asarray(0.3)
    for move in (-0.1, 0.1):
        d = float(jax.grad(lambda m: dahl(z, m, jnp.asarray(0.2)))(jnp.asarray(move)))
        difference = (dahl(z, move + 1e-6, jnp.asarray(0.2)) - dahl(z, move - 1e-6, jnp.asarray(0.2))) / 2e-6
        assert d == pytest.approx(float(difference), rel=1e-6)
    still = jax.vmap(jax.grad(lambda m, d: dahl(z, m, d), argnums=(0, 1)), in_axes=(0, None))
    assert np.isfinite(np.array(still(jnp.zeros(3), jnp.asarray(0.2)))).all()


@pytest.mark.slow
def test_bristles_under_a_changing_limit_have_slopes_at_a_standstill_and_beyond():
    def bend(values):
        return dahl_between_limits(*values)

    for move in (-0.1, 0.1):
        at, h = jnp.array([0.3, move, 0.2, 1.0, 1.7]), 1e-6
        differences = [(bend(at + h * d) - bend(at - h * d)) / (2 * h) for d in jnp.eye(5)]
        np.testing.assert_allclose(jax.jacfwd(bend)(at), differences, rtol=1e-6)
    still = jnp.array([[0.3, 0.0, 0.2, 1.0, 1.7], [0.3, 0.0, 1e-12, 1.0, 1.0]])
    assert np.isfinite(np.asarray(jax.vmap(jax.grad(bend))(still))).all()


@pytest.mark.parametrize("move", [1e-16, 1e-10, 1.9e-4, 2.1e-4])
def test_bristles_have_the_right_slope_over_a_way_however_short(move):
    """To first order (s c - b)/d, with the mean c; 2e-4 lies between series and quotient."""
    slope = float(jax.grad(lambda way: dahl_between_limits(0.3, way, 0.2, 0.9, 1.1))(move))
    assert slope == pytest.approx((1.0 - 0.3) / 0.2, rel=2e-3)
    parts = jax.jacfwd(dahl_between_limits, argnums=1), jax.jacrev(dahl_between_limits, argnums=1)
    forward, backward = (float(each(0.3, move, 0.2, 0.9, 1.1)) for each in parts)
    assert forward == pytest.approx(backward, rel=1e-12)
