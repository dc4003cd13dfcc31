"""What makes hysteresis: memory of reversals, wiping out, congruency, independence of the rate."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.loops import CLASSICAL, EXPONENTIAL, MODELS, MODIFIED, frame_rule, outputs
from oracles.plays import TABLE_2, classical, modified
from oracles.relays import MATERIALS, way

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis import (
    dahl,
    dahl_between_limits,
    elbow_modified,
    enveloped_play,
    play,
    respond,
    stop,
)

EVERY = {**MODELS, "frame": frame_rule()}
each = pytest.mark.parametrize("model", EVERY.values(), ids=EVERY)
plays = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
CORNERS = (0.0, 1.2, -0.7, 0.9, -0.2, 0.4, 0.1, 1.3)


def test_classical_equals_its_equations():
    values = way(CORNERS, 17)
    expected = 0.3 + np.array(
        classical(values, 0.8, CLASSICAL.weights.tolist(), CLASSICAL.thresholds.tolist())
    )
    np.testing.assert_allclose(respond(CLASSICAL, values)[1], expected, rtol=0, atol=1e-13)


def test_exponential_density_equals_its_equation():
    radii = [0.1 * i for i in range(1, 11)]
    expected = classical(way(CORNERS, 17), 0.4, [2 * np.exp(-3 * r) for r in radii], radii)
    np.testing.assert_allclose(respond(EXPONENTIAL, way(CORNERS, 17))[1], expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("top", [0.6, 3.0, 6.0])
def test_table_2_equals_its_equations(top):
    values = top * np.abs(way(CORNERS, 17)) / 1.3
    np.testing.assert_allclose(
        respond(elbow_modified(7), values)[1], modified(values, TABLE_2, 7), rtol=1e-12
    )


def test_stop_is_what_the_play_leaves():
    memory, radii = jnp.array([0.1, -0.3]), np.array([0.2, 0.4])
    for value in (-1.0, 0.0, 0.25, 1.0):
        left = stop(memory, jnp.asarray(value), radii)
        np.testing.assert_allclose(left + play(memory, jnp.asarray(value), radii), value, atol=1e-15)
        assert (np.abs(left) <= radii + 1e-15).all()


def test_play_between_equal_envelopes_is_the_play():
    memory, radii = jnp.array([0.1, -0.3]), np.array([0.2, 0.4])
    for value in jnp.array([-1.0, 0.0, 0.25, 1.0]):
        np.testing.assert_array_equal(enveloped_play(memory, value, value, radii), play(memory, value, radii))


def test_dahl_is_exact_at_any_step_size_and_saturates():
    whole = float(dahl(jnp.asarray(-0.4), jnp.asarray(0.3), jnp.asarray(0.2)))
    z = jnp.asarray(-0.4)
    for move in np.diff(np.concatenate([[0.0], np.sort(np.random.default_rng(0).uniform(0, 0.3, 9)), [0.3]])):
        z = dahl(z, jnp.asarray(move), jnp.asarray(0.2))
    assert float(z) == pytest.approx(whole, rel=1e-14)
    assert whole == pytest.approx(1 - 1.4 * np.exp(-1.5), rel=1e-14)
    assert float(dahl(z, jnp.asarray(-9.0), jnp.asarray(0.2))) == pytest.approx(-1.0, abs=1e-14)
    assert float(dahl(z, jnp.asarray(0.0), jnp.asarray(0.2))) == float(z)


@pytest.mark.parametrize(("move", "before", "after"), [(0.1, 1.0, 1.6), (-0.1, 1.6, 1.0), (-0.3, 1.0, 2.0)])
def test_bristles_lag_behind_a_limit_that_changes(move, before, after):
    """Against the equation in 20 000 straight moves of constant limits; two halves are nearer by four."""

    def through(parts):
        b, limits = jnp.asarray(-0.4), np.linspace(before, after, parts + 1)
        for one, other in pairwise(limits):
            b = dahl_between_limits(b, move / parts, 0.2, one, other)
        return float(b)

    limits = np.linspace(before, after, 20001)
    exact, way = -0.4, abs(move) / 20000
    for c in np.sign(move) * (limits[1:] + limits[:-1]) / 2:
        exact = c + (exact - c) * np.exp(-way / (abs(c) * 0.2))
    off = [abs(through(parts) - exact) for parts in (1, 2, 4)]
    assert off[0] < 0.02 and off[1] < 0.35 * off[0] and off[2] < 0.35 * off[1]


def test_bristles_under_an_even_limit_are_dahls():
    for move in (-0.3, 0.0, 1e-9, 0.3):
        even = dahl_between_limits(0.5, move, 0.2, 1.5, 1.5)
        assert float(even) == pytest.approx(1.5 * float(dahl(0.5 / 1.5, move, 1.5 * 0.2)), rel=1e-14)


@each
@pytest.mark.parametrize("samples", [1, 3, 200])
def test_is_exact_at_any_step_size(model, samples):
    _, coarse = outputs(model, *CORNERS, samples=samples)
    _, fine = outputs(model, *CORNERS, samples=40)
    np.testing.assert_allclose(coarse[::samples], fine[::40], rtol=0, atol=1e-13)


@each
def test_is_independent_of_the_rate(model):
    eased, there = way(CORNERS, 40), outputs(model, *CORNERS, samples=40)[1]
    _, repeated = respond(model, np.repeat(eased, 3))
    np.testing.assert_allclose(repeated[2::3], there, rtol=0, atol=1e-13)
    _, paced = outputs(model, *CORNERS, samples=40, spacing=3.0)
    np.testing.assert_allclose(paced[::40], there[::40], rtol=0, atol=1e-13)


@each
def test_returns_to_the_point_of_reversal(model):
    memory, before = outputs(model, 0.0, 1.2, -0.7)
    _, loop = outputs(model, -0.7, 0.3, -0.7, memory=memory)
    assert loop[-1] == pytest.approx(before[-1], abs=1e-13)
    assert np.ptp(loop) > 0.1
    onward, through = outputs(model, -0.7, -1.0, memory=memory)
    _, after_loop = outputs(model, -0.7, 0.3, -0.7, -1.0, memory=memory)
    np.testing.assert_allclose(after_loop[-40:], through[-40:], rtol=0, atol=1e-13)
    assert jax.tree.structure(onward) == jax.tree.structure(memory)


@each
def test_a_larger_excursion_wipes_out_the_smaller_ones(model):
    _, plain = outputs(model, -1.0, 1.2)
    _, after_loops = outputs(model, -1.0, 0.9, -0.5, 0.7, 0.1, 0.4, 0.2, 1.2)
    assert after_loops[-1] == pytest.approx(plain[-1], abs=1e-13)


def minor(model, extreme, low, high):
    """The closed loop low - high - low after an excursion to `extreme`."""
    memory, _ = outputs(model, 0.0, extreme, low, high, low)
    return outputs(model, low, high, low, memory=memory)[1]


@plays
def test_loops_between_the_same_inputs_are_congruent(model):
    """Of the modified model too: its operators are relays summed up, as those of the classical one are."""
    below, above = minor(model, -1.4, 0.1, 0.5), minor(model, 1.4, 0.1, 0.5)
    assert abs(below[0] - above[0]) > 0.05
    np.testing.assert_allclose(below - below[0], above - above[0], rtol=0, atol=1e-13)


def test_loops_of_a_relay_sum_are_congruent():
    relays = next(iter(MATERIALS.values()))()
    loops = [relays.outputs(way((-1.6, 1.6, e, 0.1, 0.2, 0.1, 0.2, 0.1), 20))[-40:] for e in (-1.0, 1.0)]
    assert abs(loops[0][0] - loops[1][0]) > 0.03
    np.testing.assert_allclose(loops[0] - loops[0][0], loops[1] - loops[1][0], rtol=0, atol=1e-12)


def test_loops_of_frame_are_not_congruent():
    below, above = minor(EVERY["frame"], -1.4, 0.1, 0.5), minor(EVERY["frame"], 1.4, 0.1, 0.5)
    assert np.abs(below - below[0] - above + above[0]).max() > 0.01


@pytest.mark.parametrize(("model", "alike"), [(CLASSICAL, True), (EXPONENTIAL, True), (MODIFIED, False)])
def test_loops_of_the_same_width_are_alike_everywhere_only_in_the_classical_model(model, alike):
    here, there = minor(model, -1.4, -1.2, -0.2), minor(model, -1.4, 0.2, 1.2)
    difference = np.abs(here - here[0] - there + there[0]).max()
    assert difference < 1e-13 if alike else difference > 0.05


def test_classical_loop_is_symmetric_and_modified_is_not():
    def asymmetry(model):
        _, loop = outputs(model, 0.0, 1.3, -1.3, 1.3, -1.3)
        up, down = loop[-80:-40], loop[-40:]
        middle = 0.5 * (up[-1] + down[-1])
        return np.abs((up - middle) + (down - middle)).max() / np.ptp(loop)

    assert asymmetry(CLASSICAL) < 1e-13
    assert asymmetry(MODIFIED) > 0.05


def test_several_inputs_at_a_time_need_vmap():
    values = jnp.stack([jnp.asarray(way(CORNERS, 5)), -jnp.asarray(way(CORNERS, 5))])
    with pytest.raises(InputError, match=r"a series of inputs, shape \(samples,\); got shape \(2, 36\)"):
        respond(CLASSICAL, values)
    both = jax.vmap(lambda v: respond(CLASSICAL, v)[1])(values)
    np.testing.assert_allclose(both[0] - 0.3, -(both[1] - 0.3), rtol=0, atol=1e-13)
