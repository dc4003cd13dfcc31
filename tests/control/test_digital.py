"""A controller on a clock of its own: when it acts, what it sees, whose gains it has, what it refuses."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import fan
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.control import PID, Attached, DigitalController, FeedForward, closed_loop, feedback_on, margins
from jaxmuscle.effects import CommandDelay
from jaxmuscle.errors import InputError
from jaxmuscle.tuning.gains import gains_of
from jaxmuscle.tuning.tune import prepared

STEP, SAMPLES = 0.01, 40
TIMES = STEP * np.arange(SAMPLES)
WANTED = 150 + 20 * np.sin(5 * TIMES)
START = {"speed": 150.0}
GAINS = built(PID, 0.05, 0.1, 0.001)


def digital(controller: Any = GAINS, *numbers: float, **settings: Any) -> Any:
    """A digital controller, `numbers` after the controller."""
    return built(DigitalController, controller, *numbers, **settings)


def run(controller, wanted=WANTED, start=START):
    blown = fan()
    return closed_loop(blown, feedback_on(blown, controller), wanted, TIMES[: len(wanted)], start=start)


class Echo(eqx.Module):
    """Gives what is wanted, and keeps the time that it was told has passed."""

    of_one_number: ClassVar = True

    def start(self):
        return jnp.zeros(())

    def update(self, state, wanted, measured, step):
        return state + step, wanted


def given(controller, rows, step):
    """Outputs of a controller that echoes the number of the sample, and the time that it was told."""
    state, outputs = controller.start(), []
    for row in range(rows):
        state, output = controller.update(state, jnp.asarray(row + 1.0), jnp.zeros(()), step)
        outputs.append(float(output))
    return outputs, float(state.controller)


def test_at_every_sample_and_at_once_it_is_the_controller_within():
    plain, on_clock = run(GAINS), run(digital(GAINS, STEP))
    np.testing.assert_allclose(plain.commands, on_clock.commands, rtol=1e-14)


@pytest.mark.parametrize(
    ("numbers", "jitter", "outputs", "told"),
    [
        ((0.03,), False, [1, 1, 1, 4, 4, 4, 7, 7, 7, 10], 0.12),
        ((0.03, 0.01), False, [0, 1, 1, 1, 4, 4, 4, 7, 7, 7], 0.12),
        ((0.03, 0.03), False, [0, 0, 0, 1, 1, 1, 4, 4, 4, 7], 0.12),
        # Due at 0, 25, 50, 75 ms: with samples of 10 ms it acts at 0, 30, 50 and 80 ms.
        ((0.025,), True, [1, 1, 1, 4, 4, 6, 6, 6, 9, 9], 0.105),
        # 5 ms late, of which it has to wait for the next sample.
        ((0.025, 0.005), True, [0, 1, 1, 1, 4, 4, 6, 6, 6, 9], 0.105),
    ],
)
def test_instants_at_which_it_acts(numbers, jitter, outputs, told):
    found, passed = given(digital(Echo(), *numbers, jitter=jitter), 10, 0.01)
    assert found == outputs
    # The first period, and then the time that has really passed.
    assert passed == pytest.approx(told, rel=1e-12)


def test_many_samples_do_not_shift_its_instants():
    controller, step = digital(Echo(), 3e-3), 1e-3
    late = eqx.tree_at(lambda s: (s.sample, s.acted), controller.start(), (jnp.asarray(29_997),) * 2)
    outputs = []
    for row in range(7):
        late, output = controller.update(late, jnp.asarray(float(row)), jnp.zeros(()), step)
        outputs.append(float(output))
    assert outputs == [0, 0, 0, 3, 3, 3, 6]


def test_a_loop_by_hand():
    # Every third sample, one sample late: readings from the stepper, outputs from the PID alone.
    found = run(digital(GAINS, 0.03, 0.01))
    machine = jm.stepper(fan(), STEP)
    state, own, waiting, output, volts = machine.initial(START), GAINS.start(), 0.0, 0.0, []
    for row in range(SAMPLES):
        output = waiting
        if row % 3 == 0:
            seen = machine.readings(state)["speed"]
            after, waiting = GAINS.update(own, WANTED[row], seen, 0.03)
            own = GAINS.without_windup(own, after, waiting, jnp.asarray(-1.0), jnp.asarray(11.0))
        volts.append(float(np.clip(1.0 + output, 0.0, 12.0)))
        state, _ = machine.step(state, volts[-1])
    np.testing.assert_allclose(found.commands, volts, rtol=1e-9)


def test_both_converters_round_and_let_derivatives_pass():
    coarse = digital(built(PID, 2.0), STEP, 0.0, 0.5, 0.3)

    def output(measured):
        return coarse.update(coarse.start(), jnp.asarray(10.0), measured, jnp.asarray(STEP))[1]

    # 7.6 is seen as 7.5, and 5 is given as 5.1, which is 17 times 0.3.
    assert float(output(jnp.asarray(7.6))) == pytest.approx(5.1)
    assert float(jax.grad(output)(7.6)) == -2.0


def test_the_integral_within_waits_at_a_limit_between_its_instants_too():
    # Held at 12 V for 0.3 s by what is out of reach; the command leaves the limit within a period of its end.
    wanted = np.where(TIMES < 0.3, 1000.0, 140.0)
    volts = np.asarray(run(digital(built(PID, 0.05, 5.0), 0.03), wanted).commands)
    assert (volts[:30] == 12.0).all() and (volts[33:] < 12.0).all()


def test_its_gains_are_those_of_the_controller_within():
    gains = gains_of(digital(GAINS, 0.02), None, {"proportional": (0.01, 0.5)})
    assert list(gains.unknowns.names) == [f"controller.{name}" for name in PID.gains]
    other = gains.movable.at([0.2, 0.3, 0.4])
    assert float(other.controller.integral) == 0.3 and float(other.period) == 0.02


@pytest.mark.slow
def test_a_delay_of_a_scenario_is_one_of_the_machine():
    late = fan().with_effects(command_delay=built(CommandDelay, 0.005))

    def cost(machine, over, **settings):
        scenarios = jm.tuning.grid(WANTED, TIMES, over, start=START, **settings)
        own = prepared(machine, GAINS, scenarios, {"tracking": 1.0})
        return float(own.seen(own.unknowns.start, (0,)).cost[0])

    whole = [cost(late, {"command_delay.delay": [delay]}) for delay in (0.02, 0.025, 0.03)]
    assert whole[0] < whole[1] < whole[2]
    # Of a machine without a delay; beside its own; beside one that the scenario changes.
    found = [cost(fan(), {}, delay=0.02), cost(late, {}, delay=0.02)]
    found.append(cost(late, {"command_delay.delay": [0.01]}, delay=0.02))
    assert found == pytest.approx(whole, rel=1e-12)


def step_of(controller):
    return run(controller, WANTED[:5])


WRONG = {
    "period between samples": (lambda: step_of(digital(GAINS, 0.025)), r"whole multiple.*0.01 s; got 0.025"),
    "delay between samples": (lambda: step_of(digital(GAINS, 0.02, 0.005)), r"a delay that is a whole"),
    "shorter than the step": (lambda: step_of(digital(GAINS, 0.005)), r"at least the loop's step, 0.01 s"),
    "behind a feed-forward": (
        lambda: step_of(built(FeedForward, Echo(), digital(GAINS, 0.025))),
        "whole multiple",
    ),
    "late with jitter": (
        lambda: step_of(digital(GAINS, 0.025, 0.02, jitter=True)),
        "at most the period less the loop's step, 0.015 s",
    ),
    "in a tuning": (
        lambda: jm.tune(fan(), digital(GAINS, 0.025), jm.tuning.Scenario(WANTED, TIMES)),
        "whole multiple",
    ),
    "delay beyond the period": (lambda: digital(GAINS, 0.02, 0.03), "at most, 0.02 s; got 0.03 s"),
    "no period": (lambda: digital(GAINS, 0.0), "period .*above zero; got 0"),
    "no controller": (lambda: digital(3.0, 0.02), "methods start and update; got float"),
    "margins": (lambda: margins(fan(), digital(GAINS, 0.02), STEP), "does not act at every sample"),
    "negative delay": (
        lambda: jm.tune(fan(), GAINS, jm.tuning.Scenario(WANTED, TIMES, delay=-1.0)),
        r"scenarios\[0\]: delay: expected a time of zero or above \[s\]; got -1",
    ),
}


@pytest.mark.parametrize("why", WRONG)
def test_wrong_numbers_are_told(why):
    ask, told = WRONG[why]
    with pytest.raises(InputError, match=told):
        ask()


def test_an_attachment_keeps_its_wiring():
    blown = fan()
    attached = Attached(digital(GAINS, 0.02), "speed", *blown.actuation())
    found = closed_loop(blown, attached, WANTED, TIMES, start=START)
    np.testing.assert_allclose(found.commands, run(digital(GAINS, 0.02)).commands, rtol=1e-14)
