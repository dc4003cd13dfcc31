"""The force controllers of [H] on a valve with one pole, and the published bandwidth."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built

from jaxmuscle.control import ProportionalForce, StaticCurve
from jaxmuscle.errors import InputError

CURRENTS = np.linspace(-0.3, 0.3, 61)
CURVE = built(StaticCurve, CURRENTS, 50 + 50 * np.tanh(4 * CURRENTS))
PLAIN, AHEAD = built(ProportionalForce), built(ProportionalForce, curve=CURVE)


def settled(controller, wanted, pole=15.0, step=2e-3):
    def sample(force, _):
        steady = 50 + 50 * jnp.tanh(4 * controller.current(wanted, force))
        return steady + (force - steady) * jnp.exp(-pole * step), None

    return float(jax.lax.scan(sample, jnp.asarray(50.0), None, length=2000)[0])


def test_linear_theory_gives_what_is_published():
    # [H]: a = 2.3 Hz and k = 550 N/A at 45 N; 55 Hz.
    assert float(PLAIN.bandwidth(2.3, 550.0)) == pytest.approx(55, rel=0.1)


@pytest.mark.parametrize("wanted", [30.0, 45.0, 70.0])
def test_feedforward_takes_away_the_error_at_rest(wanted):
    assert abs(settled(PLAIN, wanted) - wanted) > 0.3
    assert settled(AHEAD, wanted) == pytest.approx(wanted, abs=0.02)  # chords of the curve's table


def test_closed_loop_has_the_bandwidth_of_linear_theory():
    pole, gain = 2 * np.pi * 2.3, 200.0
    slope = jax.jacfwd(lambda force: pole * (gain * PLAIN.current(0.0, force) - force))(0.0)
    assert -float(slope) == pytest.approx(float(PLAIN.bandwidth(pole, gain)), rel=1e-12)


def test_current_is_limited_and_its_slopes_are_those_of_the_parts():
    assert float(PLAIN.current(100.0, 0.0)) == 0.4
    assert float(PLAIN.current(-100.0, 0.0)) == -0.4
    over_wanted, over_measured = jax.grad(AHEAD.current, argnums=(0, 1))(52.0, 51.0)
    size = 1e-5
    difference = (AHEAD.current(52 + size, 51.0) - AHEAD.current(52 - size, 51.0)) / (2 * size)
    assert float(over_wanted) == pytest.approx(float(difference), rel=1e-6)
    assert float(over_measured) == pytest.approx(-0.044)


@pytest.mark.parametrize(
    ("currents", "forces", "said"),
    [
        ([0.0, 0.1], [1.0], "as many currents as forces"),
        ([0.0, 0.1, 0.2], [1.0, 3.0, 3.0], "forces that increase"),
        ([0.0, 0.0], [1.0, 3.0], "currents that increase"),
    ],
)
def test_refused(currents, forces, said):
    with pytest.raises(InputError, match=said):
        built(StaticCurve, np.array(currents), np.array(forces))
