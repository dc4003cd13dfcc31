"""`jm.stepper`: equal to a whole simulation and to a closed loop, compiled once, differentiable, mapped."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import STEPS, built

import jaxmuscle as jm
from jaxmuscle import effects
from jaxmuscle.control import PID, closed_loop, feedback_on
from jaxmuscle.errors import InputError
from jaxmuscle.simulation import stepper as stepper_module
from jaxmuscle.simulation.run import run

STEP = 2e-3
DELAY = built(effects.CommandDelay, 0.0127)
LIFT = bench.model("isotonic")
JOINT = bench.model("joint").with_effects(
    command_delay=DELAY, valve_hysteresis=built(effects.SpoolHysteresis, 5e3)
)


def driven_by(machine, commands, start=None):
    """States and readings before each command, and the last state."""
    state, states, readings = machine.initial(start), [], []
    for command in commands:
        states.append(state)
        readings.append(machine.readings(state))
        state, _ = machine.step(state, command)
    return states, readings, state


def waves(samples, commands=1):
    wave = np.sin(np.arange(samples) / 7)
    return 4 * wave if commands == 1 else 3e5 + 6e4 * wave[:, None] * np.array([1.0, -1.0])


@pytest.mark.slow
@pytest.mark.parametrize("machine", [LIFT, JOINT], ids=["isotonic", "joint"])
def test_steps_are_those_of_a_simulation(machine):
    commands, times = waves(60, len(machine.commands)), np.arange(60) * STEP
    whole = jm.simulate(machine, commands, times)
    states, readings, last = driven_by(jm.stepper(machine, STEP), commands)
    for name, values in whole.readings.items():
        np.testing.assert_allclose([r[name] for r in readings], values, rtol=1e-13, atol=1e-13)
    for name, value in whole.final.values.items():
        np.testing.assert_allclose(last.values[name], value, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose([float(state.time) for state in states], times, rtol=1e-12)
    # Each may take up what the other has left.
    after = jm.simulate(machine, commands, times, start=last).readings
    again = jm.simulate(machine, commands, times, start=whole.final).readings
    for name, values in again.items():
        np.testing.assert_allclose(after[name], values, rtol=1e-12, atol=1e-12)
    _, shown = jm.stepper(machine, STEP).step(whole.final, commands[0])
    np.testing.assert_allclose(shown["pressure"], again["pressure"][1], rtol=1e-12)


def test_a_state_of_another_step_goes_on_at_the_own_one():
    """What a simulation at a fine step has left is taken 2 ms further, not one of its own steps."""
    fine = jm.simulate(LIFT, waves(40), np.arange(40) * 0.5e-3).final
    after, _ = jm.stepper(LIFT, STEP).step(fine, 3.0)
    again = jm.simulate(LIFT, np.full(2, 3.0), np.arange(2) * STEP, start=fine, states=True)
    assert float(after.time) == pytest.approx(0.02 + STEP)
    assert again.states is not None
    for name, values in again.states.items():
        np.testing.assert_allclose(after.values[name], values[1], rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_a_loop_of_ones_own_is_the_closed_loop():
    """A PID by hand, on the joint with a delay and a play, beside the package's own loop."""
    joint = jm.robot.robot_joint(0.64).with_effects(command_delay=DELAY)
    begin, times = {"pressure": np.full(2, 351e3)}, np.arange(100) * STEP
    pid = built(PID, 2e5, 3e5, 1e4)
    loop = feedback_on(joint, pid)
    wanted = 0.2 * np.sin(5 * times)
    whole = closed_loop(joint, loop, wanted, times, start=begin)
    machine = jm.stepper(joint, STEP)
    state, inner = machine.initial(begin), loop.start()
    readings, step = machine.readings(state), jnp.asarray(STEP)
    for i, angle in enumerate(wanted):
        assert float(readings["angle"]) == pytest.approx(float(whole.readings["angle"][i]), abs=1e-12)
        inner, command = loop.update(inner, jnp.asarray(angle), readings, step)
        np.testing.assert_allclose(command, whole.commands[i], rtol=1e-9)
        state, readings = machine.step(state, command)


@pytest.mark.slow
def test_compiled_once_over_a_thousand_steps_and_other_parameters(monkeypatch):
    traces = []

    def counted(*arguments, **settings):
        traces.append(1)
        return run(*arguments, **settings)

    monkeypatch.setattr(stepper_module, "run", counted)
    machine = jm.stepper(JOINT, STEP, history=0.3)
    state = machine.initial({"pressure": 3e5})
    for command in waves(1000, 2):
        state, _ = machine.step(state, command)
    assert float(state.time) == pytest.approx(2.0)
    heavy = jm.replace(JOINT, {"inertia": 0.07, "effects.command_delay.delay": 0.02})
    other = jm.stepper(heavy, STEP, history=0.3)
    moved, _ = other.step(other.initial(), [3e5, 2e5])
    other.step(moved, np.array([3e5, 2e5]))
    # Not even another step makes it compile anew.
    slower = jm.stepper(JOINT, 1.9e-3, history=machine.given * 1.9e-3 - 1.9e-3)
    slower.step(slower.initial(), [3e5, 2e5])
    assert len(traces) == 1


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["isotonic", "joint"])
def test_gradient_through_fifty_steps_equals_finite_differences(rig):
    machine = bench.model(rig).with_effects(command_delay=DELAY)
    commands = jnp.asarray(waves(50, len(machine.commands)))
    path, reading = ("mass", "position") if rig == "isotonic" else ("inertia", "angle")

    def end(share, scale, begin):
        value = jm.parameters.get(machine, path)
        stepper = jm.stepper(jm.replace(machine, {path: share * value}), STEP)
        state = stepper.initial({"pressure": begin * 2.5e5})

        def onward(state, command):
            return stepper.step(state, scale * command)

        _, readings = jax.lax.scan(onward, state, commands)
        return 1e3 * jnp.sum(readings[reading] ** 2)

    at = (jnp.asarray(0.5 if rig == "isotonic" else 1.0), jnp.asarray(1.0), jnp.asarray(1.3))
    value = jax.jit(end)
    slopes = jax.jit(jax.grad(end, argnums=(0, 1, 2)))(*at)
    _, forward = jax.jvp(end, at, (jnp.ones(()),) * 3)
    assert float(forward) == pytest.approx(sum(map(float, slopes)), rel=1e-9)
    for i, slope in enumerate(slopes):
        size = 1e-5
        up, down = (value(*(a + s * size * (i == j) for j, a in enumerate(at))) for s in (1, -1))
        assert float(slope) == pytest.approx(float(up - down) / (2 * size), rel=1e-5)
        assert abs(float(slope)) > 1e-6


@pytest.mark.slow
def test_steppers_and_states_side_by_side():
    masses = jnp.array([3.0, 6.0, 12.0])

    def moved(mass, command):
        machine = jm.stepper(jm.replace(LIFT, {"mass": mass}), STEP)
        state, readings = machine.step(machine.initial({"pressure": 4e5}), command)
        return machine.step(state, command)[1] | readings

    together = jax.jit(jax.vmap(moved, in_axes=(0, None)))(masses, 3.0)
    for i, mass in enumerate(masses):
        for name, value in moved(mass, 3.0).items():
            assert float(together[name][i]) == pytest.approx(float(value), rel=1e-12)
    machine = jm.stepper(LIFT, STEP)
    begin = [machine.initial({"pressure": p}) for p in (2e5, 4e5)]
    states = jax.tree.map(lambda *leaves: jnp.stack(leaves), *begin)
    after, readings = jax.vmap(machine.step)(states, jnp.array([1.0, -1.0]))
    assert readings["pressure"].shape == (2,) and after.values["opening"].shape == (2,)
    np.testing.assert_allclose(
        readings["pressure"][1], machine.step(begin[1], -1.0)[1]["pressure"], rtol=1e-12
    )


def test_names_and_units():
    machine = jm.stepper(JOINT, STEP)
    assert machine.commands == ("command_1", "command_2")
    assert machine.units == {"pressure": "Pa", "angle": "rad", "command_1": "Pa", "command_2": "Pa"}
    assert set(machine.readings(machine.initial())) == {"pressure", "angle"}
    assert jm.stepper(LIFT, STEP).units == {"pressure": "Pa", "position": "m", "command": "V"}


def test_a_long_time_step_is_divided():
    steps = {
        rig: jm.stepper(bench.model(rig), 10 * STEPS[rig]).steps.substeps for rig in ("isotonic", "elbow")
    }
    for rig, substeps in steps.items():
        assert 10 * STEPS[rig] / substeps <= bench.model(rig).largest_step * (1 + 1e-9)
    fine = jm.stepper(LIFT, 0.02, substeps=20)
    coarse = jm.stepper(LIFT, 0.02)
    both = [
        m.step(m.initial({"pressure": 4e5, "position": 0.03}), 2.0)[1]["position"] for m in (fine, coarse)
    ]
    assert float(both[0]) == pytest.approx(float(both[1]), abs=1e-5)


def refused(change, message):
    with pytest.raises(InputError, match=message):
        change()


def test_wrong_questions_are_told():
    refused(lambda: jm.stepper(bench.model("driven"), STEP), "'driven' has no command that a step could hold")
    wrong: Any
    for wrong in (0, -1e-3, np.nan, np.inf, True, "fast"):
        refused(lambda wrong=wrong: jm.stepper(LIFT, wrong), "time_step: expected a time above zero")
        refused(lambda wrong=wrong: jm.stepper(LIFT, STEP, history=wrong), "history: expected a time above")
    refused(lambda: jm.stepper(LIFT, 0.05, substeps=3), "steps of 0.002 s at most: expected at least 25 in a")
    refused(lambda: jm.stepper(LIFT, 300.0), "bears steps of 0.002 s at most, 100000 of them in a time step")
    refused(lambda: jm.stepper(LIFT, STEP, method="euler"), "method: unknown 'euler'")


def test_wrong_states_are_told():
    machine, joint = jm.stepper(LIFT, STEP), jm.stepper(JOINT, STEP)
    refused(lambda: machine.initial({"angle": 0.1}), "start: unknown start.*angle.*opening")
    refused(
        lambda: machine.initial({"pressure": np.nan}), "start: expected finite numbers for pressure; got nan"
    )
    refused(
        lambda: machine.initial({"opening": np.array([0.1, 0.2])}),
        r"start: start of opening: .* \(\); got \(2,\)",
    )
    refused(lambda: machine.step(joint.initial(), 1.0), "state of rig 'isotonic'; got one of rig 'joint'")
    refused(lambda: machine.readings(joint.initial()), "state of rig 'isotonic'; got one of rig 'joint'")
    other: Any = {"pressure": 1e5}
    refused(lambda: machine.step(other, 1.0), "expected a state of a simulation.*got dict")
    plain = jm.stepper(bench.model("joint"), STEP).initial()
    refused(
        lambda: joint.step(plain, [3e5, 3e5]), "with effects command_delay, valve_hysteresis; got one with"
    )
    late = jm.stepper(LIFT.with_effects(command_delay=DELAY), STEP)
    refused(lambda: late.step(machine.initial(), 1.0), "has a delay: expected a state that remembers")
    slow = jm.stepper(LIFT.with_effects(command_delay=DELAY), 2 * STEP)
    refused(lambda: slow.step(late.initial(), 1.0), "commands that were 0.002 s apart.*got 0.004 s")


def test_wrong_commands_are_told():
    machine, joint = jm.stepper(LIFT, STEP), jm.stepper(JOINT, STEP)
    state = machine.initial()
    refused(
        lambda: machine.step(state, [1.0, 2.0]), r"command: expected command, shape \(\); got shape \(2,\)"
    )
    refused(
        lambda: joint.step(joint.initial(), 3e5), r"expected command_1 and command_2, shape \(2,\); got shape"
    )
    refused(lambda: machine.step(state, np.nan), "command: expected finite numbers; got nan")
    refused(lambda: joint.step(joint.initial(), [3e5, np.inf]), "expected finite numbers")


def test_a_machine_that_runs_away_is_told():
    # A supply of no pressure at all makes the flow no number.
    broken = jm.stepper(jm.replace(LIFT, {"gas_temperature": -1.0}), STEP)
    refused(
        lambda: driven_by(broken, np.full(50, 5.0)),
        r"ran away: .*pressure.* no number at 0.\d+ s; give smaller commands or more substeps than 1$",
    )


@pytest.mark.slow
def test_a_delay_beyond_what_is_remembered_is_told():
    late = LIFT.with_effects(command_delay=built(effects.CommandDelay, 0.05))
    short = jm.stepper(late, STEP, history=0.02)
    refused(lambda: driven_by(short, np.full(50, 5.0)), r"longer than the 0.022 s of commands.*history=")
    # What it has forgotten is the command of rest, so nothing is lost.
    driven_by(short, np.zeros(50))
    driven_by(jm.stepper(late, STEP, history=0.05), np.full(50, 5.0))
