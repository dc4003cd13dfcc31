"""Margins by hand, beside python-control, at the edge of stability, with delays; their slopes; as a term."""

from typing import Any, ClassVar

import control as python_control
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import STEP, TRUE, fan
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.control import PID, Attached, Reference, SlidingMode, feedback_on, joint_model, margins
from jaxmuscle.control.stability_margins import loop_response, machine_response, sensitivity
from jaxmuscle.effects import CommandDelay
from jaxmuscle.errors import InputError
from jaxmuscle.robot.tondu2000 import robot_joint

REST = np.sqrt(TRUE["torque_constant"] / TRUE["drag"])
DECAY = np.exp(-2 * TRUE["drag"] * REST / TRUE["inertia"] * STEP)
PUSH = TRUE["torque_constant"] / (2 * TRUE["drag"] * REST) * (1 - DECAY)
"""The fan about one volt, from sample to sample: ω' = DECAY ω + PUSH u."""


def test_a_proportional_loop_by_hand():
    # L = k b/(z - a): least far from -1 at z = -1, where |1 + L| = 1 - k b/(1 + a), and real there alone.
    gain = 0.5
    found = margins(fan(), built(PID, gain), STEP)
    assert found.stable and found.modulus == pytest.approx(1 - gain * PUSH / (1 + DECAY), rel=1e-4)
    assert found.sensitivity == pytest.approx(1 / found.modulus)
    z = np.exp(1j * np.linspace(1e-4, np.pi, 200_001))
    loop = gain * PUSH / (z - DECAY)
    at = int(np.argmin(np.abs(np.abs(loop) - 1)))
    assert found.phase == pytest.approx(np.pi - abs(np.angle(loop[at])), abs=0.03)


def test_beside_python_control():
    pid = built(PID, 0.2, 0.8, smoothing=0.0)
    z: Any = python_control.tf([1, 0], [1], STEP)
    loop = PUSH / (z - DECAY) * (0.2 + 0.8 * STEP * z / (z - 1)) / z**2
    gain, phase, stability, *_ = python_control.stability_margins(loop)
    delayed = fan().with_effects(command_delay=built(CommandDelay, 2 * STEP))
    found = margins(delayed, pid, STEP)
    assert found.stable
    assert found.gain == pytest.approx(gain, rel=0.03)
    assert np.rad2deg(found.phase) == pytest.approx(phase, abs=2.0)
    assert found.modulus == pytest.approx(stability, rel=1e-2)


def test_a_controller_that_is_attached_keeps_its_wiring():
    # Twice the volts per output are twice the gain; both rest at one volt.
    twice = built(Attached, built(PID, 0.2), "speed", 1.0, 2.0, 0.0, 12.0)
    assert margins(fan(), twice, STEP).modulus == pytest.approx(margins(fan(), built(PID, 0.4), STEP).modulus)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.4, 1.0, 2.0, 2.7])
def test_at_the_edge_of_stability_the_margin_is_gone(delay):
    machine = fan().with_effects(command_delay=built(CommandDelay, delay * STEP)) if delay else fan()
    one = margins(machine, built(PID, 0.1), STEP)
    edge = 0.1 * one.gain
    if not delay:
        assert edge == pytest.approx((1 + DECAY) / PUSH, rel=1e-9)
    below, above = (margins(machine, built(PID, share * edge), STEP) for share in (0.97, 1.03))
    assert below.stable and not above.stable and below.modulus < 0.05 < one.modulus


def test_a_part_of_a_sample_delays_by_a_part_of_it():
    slight = fan().with_effects(command_delay=built(CommandDelay, 0.01 * STEP))
    without, with_it = (margins(machine, built(PID, 2.5), STEP) for machine in (fan(), slight))
    assert with_it.stable and with_it.modulus == pytest.approx(without.modulus, rel=0.05)


@pytest.mark.slow
def test_slopes_are_those_of_finite_differences():
    model, response = machine_response(fan(), STEP, feedback_on(fan(), built(PID, 0.4)))

    @jax.jit
    def most(gains):
        pid = built(PID, gains[0], gains[1], gains[2])
        return sensitivity(loop_response(pid, jnp.asarray(response), model.rest, STEP))

    at, size = jnp.array([0.4, 2.0, 0.002]), 1e-6
    slopes = jax.jit(jax.grad(most))(at)
    for i in range(3):
        difference = (most(at.at[i].add(size)) - most(at.at[i].add(-size))) / (2 * size)
        assert float(slopes[i]) == pytest.approx(float(difference), rel=1e-4) and slopes[i] != 0


def test_a_joint_with_dry_friction_under_a_controller_of_rates():
    joint = robot_joint(0.64)
    sliding = built(SlidingMode, joint_model(joint), 8.0, least=2e4, boundary=0.5)
    found = margins(joint, sliding, 2e-3, rates=True)
    assert found.stable and 0.1 < found.modulus < 1
    with pytest.raises(InputError, match=r"control.Reference"):
        margins(joint, sliding, 2e-3)
    assert Reference is jm.control.Reference


@pytest.mark.slow
def test_a_tuning_keeps_its_distance_from_instability():
    times = STEP * np.arange(60)
    machine = fan().with_effects(command_delay=built(CommandDelay, 3 * STEP))
    up = jm.tuning.Scenario(np.where(times < 0.2, REST, REST + 15.0), times, start={"speed": REST})
    begin = built(PID, 0.3, 1.0)
    careful = jm.tune(machine, begin, up, {"tracking": 3.0, "sensitivity": 0.5}, starts=1, steps=8)
    for judged, controller in ((careful.before, begin), (careful.after, careful.controller)):
        there = margins(machine, controller, STEP).sensitivity
        assert judged.value("sensitivity") == pytest.approx(there, rel=1e-6)
    assert careful.after.value("sensitivity") < 0.8 * careful.before.value("sensitivity")
    assert "sensitivity" in str(careful)


class Whole(eqx.Module):
    """A controller of the whole machine."""

    of_all_readings: ClassVar = True
    gain: jax.Array

    def start(self):
        return None

    def update(self, state, wanted, readings, step):
        return None, self.gain * readings["speed"]


def test_a_controller_of_the_whole_machine_has_no_such_margin():
    scenario = jm.tuning.Scenario(np.full(20, REST), STEP * np.arange(20))
    with pytest.raises(InputError, match="controller of one reading"):
        jm.tune(fan(), Whole(jnp.ones(())), scenario, {"sensitivity": 1.0})
