"""Repetitions that learn: factors by hand on linear plants, plants that the model is not, what is told."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import STEP, TRUE, fan
from oracles.bench import built

from jaxmuscle.control import (
    ProportionalLearning,
    channel_model,
    contraction,
    inverse_learning,
    learn,
    repeated,
)
from jaxmuscle.control.iterative_learning import lifted
from jaxmuscle.effects import CommandDelay
from jaxmuscle.errors import InputError

SAMPLES = 120
TIMES = STEP * np.arange(SAMPLES)
REST = np.sqrt(TRUE["torque_constant"] / TRUE["drag"])
WANTED = REST + 10.0 * (1 - np.cos(4 * TIMES))
MODEL = channel_model(fan(), STEP)
GAIN = 0.5 / float(MODEL.impulse(1)[0])
PATIENT = built(ProportionalLearning, 1 / MODEL.gain)
QUICK = inverse_learning(MODEL, SAMPLES, error=1.0, effort=0.5)


def linear(output):
    """The linear model, sample by sample."""
    x, readings = np.zeros(len(MODEL.b)), []
    for u in np.asarray(output):
        readings.append(MODEL.rest + MODEL.c @ x)
        x = MODEL.a @ x + MODEL.b * u
    return np.array(readings)


def blown(output):
    """A fan with friction in its bearing, of which no model knows, by fine Euler steps in plain NumPy."""
    p, w, readings = TRUE, REST, []
    for volts in 1.0 + np.asarray(output):
        readings.append(w)
        for _ in range(20):
            torque = p["torque_constant"] * volts - p["drag"] * w * abs(w) - 2e-5 * w
            w += STEP / 20 * torque / p["inertia"]
    return np.array(readings)


def test_the_lifted_model_is_the_model():
    output = np.random.default_rng(0).normal(size=SAMPLES)
    np.testing.assert_allclose(lifted(MODEL, SAMPLES) @ output + MODEL.rest, linear(output), rtol=1e-12)


def test_the_model_of_a_fan_by_hand():
    # J dω' = k du - 2 d ω0 dω, held over a step.
    decay = np.exp(-2 * TRUE["drag"] * REST / TRUE["inertia"] * STEP)
    gain = TRUE["torque_constant"] / (2 * TRUE["drag"] * REST)
    np.testing.assert_allclose(MODEL.impulse(5), gain * (1 - decay) * decay ** np.arange(5), rtol=1e-6)
    assert MODEL.gain == pytest.approx(gain, rel=1e-6)


def test_an_error_shrinks_as_the_laws_say_it_does():
    for law in (PATIENT, QUICK):
        factor = contraction(law, MODEL, SAMPLES)
        found = np.asarray(learn(linear, WANTED, law, repetitions=6).errors)
        assert factor < 1 and (found[1:] <= factor * found[:-1] * (1 + 1e-9)).all()


def test_a_p_type_law_learns_sample_after_sample():
    # After j repetitions with γ h = 1 the first j samples after the first one are right: deadbeat.
    found = learn(linear, WANTED, built(ProportionalLearning, 2 * GAIN), repetitions=5)
    left = np.abs(np.asarray(found.readings) - WANTED)
    for number in range(5):
        assert left[number][: number + 1].max() < 1e-9
    assert left[3][5] > 1e-4


def test_a_law_that_converges_may_pass_through_large_errors():
    # |1 - γ h| is a half, and the errors grow all the same at first, as the largest singular value says.
    law = built(ProportionalLearning, GAIN)
    errors = learn(linear, WANTED, law, repetitions=4).errors
    assert contraction(law, MODEL, SAMPLES) > 1 and errors[3] > 10 * errors[0]


def test_the_quadratic_law_is_the_least_of_its_cost():
    error = WANTED - linear(np.zeros(SAMPLES))
    g, change = lifted(MODEL, SAMPLES), np.asarray(QUICK.change(jnp.asarray(error)))
    slope = g.T @ (g @ change - error) / 1.0**2 + change / 0.5**2
    assert np.abs(slope).max() < 1e-9 * np.abs(g.T @ error).max()


@pytest.mark.parametrize(("law", "left"), [(PATIENT, 0.2), (QUICK, 0.01)])
def test_a_plant_that_the_model_is_not_is_learned(law, left):
    found = learn(blown, WANTED, law, repetitions=12)
    assert found.errors[-1] < left * found.errors[0]
    np.testing.assert_allclose(blown(found.output), found.readings[np.argmin(found.errors)])


def test_the_machine_itself_is_learned_within_limits():
    plant = repeated(fan(), TIMES, start={"speed": REST})
    found = learn(plant, WANTED, QUICK, repetitions=6, limits=(-1.0, 3.0))
    assert found.errors[-1] < 0.02 * found.errors[0]
    tight = learn(plant, WANTED, QUICK, repetitions=4, limits=(-0.1, 0.4))
    assert tight.outputs.max() == 0.4 and tight.errors[-1] > 10 * found.errors[-1]


@pytest.mark.parametrize("late", [2.0, 1.3])
def test_a_delay_of_the_command_is_in_the_model(late):
    machine = fan().with_effects(command_delay=built(CommandDelay, late * STEP))
    model = channel_model(machine, STEP)
    assert not model.impulse(int(late)).any() and model.gain == pytest.approx(MODEL.gain, rel=1e-9)
    law = inverse_learning(model, SAMPLES, error=1.0, effort=5.0)
    plant = repeated(machine, TIMES, start={"speed": REST})
    # A small output, about which the machine is nearly linear, as the model has it.
    output = 0.01 * np.sin(np.arange(SAMPLES))
    expected = model.rest + lifted(model, SAMPLES) @ output
    np.testing.assert_allclose(np.asarray(plant(jnp.asarray(output))), expected, atol=1e-3)
    found = np.asarray(learn(plant, WANTED, law, repetitions=15).errors)
    assert found[-1] < 0.03 * found[0]


def test_what_is_smoothed_does_not_learn_noise():
    random = np.random.default_rng(0)

    def noisy(output):
        return linear(output) + 0.5 * random.normal(size=SAMPLES)

    rough, smooth = (
        learn(noisy, WANTED, built(ProportionalLearning, GAIN), repetitions=10, smoothing=s).outputs[-1]
        for s in (0.0, 2.0)
    )
    assert np.diff(smooth).std() < 0.3 * np.diff(rough).std()


@pytest.mark.slow
def test_slopes_through_repetitions_are_those_of_finite_differences():
    plant = repeated(fan(), TIMES[:40], start={"speed": REST})

    @jax.jit
    def last(gain):
        law = built(ProportionalLearning, GAIN * gain)
        return learn(plant, WANTED[:40], law, repetitions=3, smoothing=0.5).errors[-1]

    at, size = jnp.asarray(0.8), 1e-5
    difference = (last(at + size) - last(at - size)) / (2 * size)
    for mode in (jax.grad, jax.jacfwd):
        assert float(jax.jit(mode(last))(at)) == pytest.approx(float(difference), rel=1e-6)


class Short:
    """A law that forgets a sample."""

    def change(self, error):
        return error[1:]


LAW = built(ProportionalLearning, GAIN)
BAD = {
    "short": (lambda: learn(lambda u: u[1:], WANTED, LAW), r"repetition 1: readings.*shape \(120,\)"),
    "lost": (lambda: learn(lambda u: u * np.nan, WANTED, LAW), "finite numbers; got nan in row 0"),
    "law": (lambda: learn(linear, WANTED, Short()), "change of the law: expected shape"),
    "none": (lambda: learn(linear, WANTED, LAW, repetitions=0), "at least one repetition"),
    "smoothing": (lambda: learn(linear, WANTED, LAW, smoothing=-1.0), "smoothing of 0 samples or more"),
    "reference": (lambda: learn(linear, 3.0, LAW), "reference of at least two samples"),
    "first": (lambda: learn(linear, WANTED, LAW, first=np.zeros(3)), "first: expected one number, or 120"),
    "effort": (lambda: inverse_learning(MODEL, 9, error=1.0, effort=0.0), "effort: expected a number"),
    "samples": (lambda: inverse_learning(MODEL, 1, error=1.0, effort=1.0), "at least two; got 1"),
    "step": (lambda: channel_model(fan(), 0.0), "step: expected a time above zero"),
}


@pytest.mark.parametrize("why", BAD)
def test_wrong_input_is_told(why):
    make, told = BAD[why]
    with pytest.raises(InputError, match=told):
        make()


def test_a_plant_that_runs_away_later_is_told_with_its_repetition():
    calls = []

    def plant(output):
        calls.append(1)
        return linear(output) if len(calls) < 3 else np.full(SAMPLES, np.inf)

    with pytest.raises(InputError, match="repetition 3: readings"):
        learn(plant, WANTED, LAW)
