"""Play operators: the properties that make a Prandtl-Ishlinskii model, and the loop of the muscle."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

from jaxmuscle.effects import LengthHysteresis
from jaxmuscle.effects.muscle import THRESHOLDS
from jaxmuscle.hysteresis.operators import play
from jaxmuscle.signals import Signals

MUSCLE = bench.model("driven").muscle
GAUGE = 3e5
FULL = float(np.pi * MUSCLE.initial_radius**2 * GAUGE)
EFFECT = built(LengthHysteresis, weight=0.2, asymmetry=0.15, density_width=0.05)


def situation(strain):
    return Signals(
        ambient_pressure=jnp.asarray(bench.AMBIENT),
        pressure=jnp.asarray(bench.AMBIENT + GAUGE),
        muscle=MUSCLE,
        contraction=jnp.asarray(strain) * MUSCLE.initial_length,
    )


@jax.jit
def follow(effect, memory, strains):
    """Memory and force along a path of contraction ratios."""

    def onward(memory, strain):
        memory = effect.update(memory, situation(strain), jnp.asarray(1e-3))
        return memory, effect.value(memory, situation(strain))

    return jax.lax.scan(onward, memory, strains)


def path(*corners, steps=40, spacing=1.0):
    """Straight lines between the corners, each corner once; `spacing` other than 1 changes the pace."""
    share = np.linspace(0, 1, steps + 1)[1:] ** spacing
    legs = [a + (b - a) * share for a, b in pairwise(corners)]
    return jnp.asarray(np.concatenate(legs))


def rest(strain):
    return EFFECT.initial(situation(strain))


def test_play_follows_its_input_at_a_distance():
    memory = play(jnp.zeros(1), jnp.asarray([0.5]), jnp.asarray([0.2]))
    assert float(memory[0]) == pytest.approx(0.3)
    assert float(play(memory, jnp.asarray([0.2]), jnp.asarray([0.2]))[0]) == float(memory[0])
    assert float(play(memory, jnp.asarray([-0.1]), jnp.asarray([0.2]))[0]) == pytest.approx(0.1)


@pytest.mark.parametrize("steps", [1, 2, 7, 400])
def test_is_exact_at_any_step_size(steps):
    corners = (0.05, 0.21, 0.11, 0.19, 0.02)
    coarse, force = follow(EFFECT, rest(0.05), path(*corners, steps=steps))
    fine, same = follow(EFFECT, rest(0.05), path(*corners, steps=97))
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=1e-15)
    assert float(force[-1]) == pytest.approx(float(same[-1]), rel=1e-12)


def test_is_independent_of_the_rate():
    corners = (0.05, 0.2, 0.1, 0.15)
    memory, force = follow(EFFECT, rest(0.05), path(*corners))
    eased, slow = follow(EFFECT, rest(0.05), path(*corners, spacing=3.0))
    np.testing.assert_allclose(eased, memory, rtol=0, atol=1e-15)
    assert float(slow[-1]) == pytest.approx(float(force[-1]), rel=1e-12)
    repeated = follow(EFFECT, rest(0.05), jnp.repeat(path(*corners), 5))[1]
    np.testing.assert_array_equal(force, repeated[4::5])


def test_returns_to_the_point_of_reversal():
    outer, force = follow(EFFECT, rest(0.0), path(0.0, 0.2))
    closed, loop = follow(EFFECT, outer, path(0.2, 0.13, 0.2))
    np.testing.assert_allclose(closed, outer, atol=1e-15)
    assert float(loop[-1]) == pytest.approx(float(force[-1]), rel=1e-12)
    assert float(np.ptp(loop)) > 0.05 * FULL


def test_a_larger_excursion_wipes_out_the_smaller_ones():
    plain, force = follow(EFFECT, rest(0.0), path(0.0, 0.2))
    after_loops, same = follow(EFFECT, rest(0.0), path(0.0, 0.12, 0.05, 0.11, 0.08, 0.1, 0.09, 0.2))
    np.testing.assert_allclose(after_loops, plain, atol=1e-15)
    assert float(same[-1]) == pytest.approx(float(force[-1]), rel=1e-12)


def test_minor_loops_between_the_same_ends_are_congruent():
    symmetric = built(LengthHysteresis, weight=0.2, density_width=0.05)

    def loop(extreme):
        """The loop 0.1 - 0.15 - 0.1 after an excursion to `extreme`; its first round still closes it."""
        memory, _ = follow(symmetric, rest(0.1), path(0.1, extreme, 0.1, 0.15, 0.1))
        return follow(symmetric, memory, path(0.1, 0.15, 0.1))[1]

    low, high = loop(0.0), loop(0.3)
    assert abs(float(low[0] - high[0])) > 0.01 * FULL
    np.testing.assert_allclose(low - low[0], high - high[0], atol=1e-12 * FULL)


@pytest.mark.parametrize("asymmetry", [0.0, 0.15])
def test_saturated_loop_is_as_wide_as_the_weight_says(asymmetry):
    effect = built(LengthHysteresis, weight=0.2, asymmetry=asymmetry, density_width=0.05)
    _, force = follow(effect, rest(0.0), path(0.0, 0.3, 0.0))
    shortening, lengthening = float(force[39]), float(force[-1])
    assert shortening == pytest.approx(-0.2 * FULL * (1 + asymmetry), rel=1e-12)
    assert lengthening == pytest.approx(0.2 * FULL * (1 - asymmetry), rel=1e-12)


def test_vanishes_at_rest_and_loses_energy_round_a_loop():
    assert float(EFFECT.value(rest(0.07), situation(0.07))) == 0
    strains = path(0.05, 0.2, 0.05, 0.2, 0.05)
    _, force = follow(EFFECT, rest(0.05), strains)
    one_round = slice(79, 160)
    work = np.trapezoid(force[one_round], strains[one_round])
    assert work < -0.01 * FULL


def test_slope_at_reversal_and_on_a_threshold_is_finite():
    def force(strain, memory_offset):
        memory = strain + memory_offset * THRESHOLDS
        return EFFECT.value(memory, situation(strain))

    for offset in (-1.0, 0.0, 1.0):
        assert np.isfinite(jax.grad(force, argnums=(0, 1))(jnp.asarray(0.1), jnp.asarray(offset))).all()


def test_slope_at_reversal_equals_one_sided_differences():
    turned, _ = follow(EFFECT, rest(0.0), path(0.0, 0.2))

    def force(strain):
        return EFFECT.value(turned, situation(strain))

    for strain in (0.2 - 1e-4, 0.2 + 1e-4):
        difference = (force(jnp.asarray(strain + 1e-7)) - force(jnp.asarray(strain - 1e-7))) / 2e-7
        assert float(jax.grad(force)(jnp.asarray(strain))) == pytest.approx(
            float(difference), rel=1e-6, abs=1e-6 * FULL
        )
    # Going on, all operators follow and the force stays; turning back, none does and it is steepest.
    ahead, back = (float(jax.grad(force)(jnp.asarray(0.2 + d))) for d in (1e-4, -1e-4))
    assert abs(ahead) < 1e-9 * FULL < abs(back)
    assert abs(back) >= abs(float(jax.grad(force)(jnp.asarray(0.2)))) >= abs(ahead)
