"""Simulations that go on: two halves are one whole, on every rig, with delays, memories and drifts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import STEPS, built

import jaxmuscle as jm
from jaxmuscle import effects
from jaxmuscle.effects.readings import reading_effect
from jaxmuscle.errors import InputError
from jaxmuscle.simulation import SimulationState

SAMPLES, CUT = 60, 30
"""Halves of one length: what is simulated anew shares the compilation of the first."""
DELAY = built(effects.CommandDelay, 0.0127)


def creeping():
    """A joint with a delay, a play in its regulators, creep, and a sensor whose zero drifts."""
    return bench.model("joint").with_effects(
        command_delay=DELAY,
        valve_hysteresis=built(effects.SpoolHysteresis, 5e3),
        creep=built(effects.Creep, 500.0, 0.5, 3.0),
        sensor_drift_angle=built(reading_effect("sensor_drift", "angle"), 0.05),
    )


MACHINES = {
    **{rig: lambda rig=rig: bench.model(rig) for rig in STEPS if rig != "driven"},
    "isotonic with a delay": lambda: bench.model("isotonic").with_effects(command_delay=DELAY),
    "joint with effects": creeping,
}


def clock(machine):
    return np.arange(SAMPLES) * STEPS[machine.rig]


def command(machine):
    """What moves each rig, one row a sample."""
    wave, many = np.sin(np.arange(SAMPLES) / 7), len(machine.commands)
    if machine.rig == "isotonic":
        return 4 * wave
    if machine.rig.startswith("jet-pipe"):
        return wave if many == 1 else np.stack([wave, np.full(SAMPLES, 6.5e5)], axis=-1)
    table = 3e5 + 6e4 * wave[:, None] * np.where(np.arange(many) % 2, -1.0, 1.0)
    return table if many > 1 else table[:, 0]


@pytest.mark.thorough
@pytest.mark.parametrize("which", MACHINES)
def test_two_halves_are_the_whole(which):
    machine = MACHINES[which]()
    given, times = command(machine), clock(machine)
    whole = jm.simulate(machine, given, times, states=True)
    first = jm.simulate(machine, given[:CUT], times[:CUT])
    second = jm.simulate(machine, given[CUT:], times[CUT:], start=first.final, states=True)
    for name, values in whole.readings.items():
        joined = np.concatenate([first.readings[name], second.readings[name]])
        # Machines differ in the order in which a compiler adds; nothing else may differ.
        np.testing.assert_allclose(joined, values, rtol=1e-13, atol=1e-13, err_msg=name)
    assert whole.states is not None and second.states is not None
    for name, values in whole.states.items():
        parts = zip(jax.tree.leaves(second.states[name]), jax.tree.leaves(values), strict=True)
        for here, there in parts:
            np.testing.assert_allclose(here, there[CUT:], rtol=1e-12, atol=1e-12, err_msg=name)
    for here, there in zip(jax.tree.leaves(second.final), jax.tree.leaves(whole.final), strict=True):
        np.testing.assert_allclose(here, there, rtol=1e-12, atol=1e-12)
    # It matters where the second half begins.
    anew = jm.simulate(machine, given[CUT:], times[CUT:])
    moved = [np.ptp(anew.readings[name] - second.readings[name]) for name in whole.readings]
    assert max(moved) > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["isotonic", "joint"])
def test_fixed_steps_go_on_to_the_last_bit(rig):
    machine = bench.model(rig)
    given, times = command(machine), clock(machine)
    whole = jm.simulate(machine, given, times, substeps=2).readings
    first = jm.simulate(machine, given[:CUT], times[:CUT], substeps=2)
    second = jm.simulate(machine, given[CUT:], times[CUT:], start=first.final, substeps=2)
    for name, values in whole.items():
        np.testing.assert_array_equal(np.concatenate([first.readings[name], second.readings[name]]), values)


@pytest.mark.slow
def test_controlled_steps_go_on_within_their_tolerance():
    machine = bench.model("isotonic")
    given, times = command(machine), clock(machine)
    whole = jm.simulate(machine, given, times, tolerance=1e-6).readings
    first = jm.simulate(machine, given[:CUT], times[:CUT], tolerance=1e-6)
    second = jm.simulate(machine, given[CUT:], times[CUT:], start=first.final, tolerance=1e-6)
    for name, values in whole.items():
        range_ = np.ptp(values)
        np.testing.assert_allclose(second.readings[name], values[CUT:], rtol=0, atol=1e-5 * range_)


@pytest.mark.slow
def test_a_recording_goes_on_and_a_third_part_too():
    recording = jm.read(jm.sample("lift"))
    machine = jm.actuator(recording.card).with_effects(command_delay=DELAY)
    whole = jm.simulate(machine, recording.part(0, 300)).readings
    state, parts = None, []
    for begin in (0, 100, 200):
        part = jm.simulate(machine, recording.part(begin, begin + 100), start=state)
        state = part.final
        assert isinstance(state, SimulationState)
        parts.append(part.readings["position"])
    np.testing.assert_allclose(np.concatenate(parts), whole["position"], rtol=1e-12, atol=1e-15)
    assert float(state.time) == pytest.approx(300 * recording.step, rel=1e-12)
    assert state.commands.shape == (300,)


def test_imposed_states_follow_the_recording_that_goes_on():
    recording = jm.read(jm.sample("bench"))
    machine = jm.actuator(recording.card).with_effects(creep=built(effects.Creep, 5000.0, 0.5, 3.0))
    whole = jm.simulate(machine, recording.part(0, 400)).readings["force"][200:]
    first = jm.simulate(machine, recording.part(0, 200))
    second = jm.simulate(machine, recording.part(200, 400), start=first.final)
    anew = jm.simulate(machine, recording.part(200, 400)).readings["force"]
    # Each part is smoothed by itself: they agree to about the noise of the sensor, 0.8 N. Creep that
    # began anew would be far off.
    assert float(np.abs(second.readings["force"] - whole).max()) < 2.0
    assert float(np.abs(anew - whole).max()) > 50.0
    assert float(second.final.time) == pytest.approx(400 * recording.step)


def test_hidden_states_of_a_recording_may_be_given_and_measured_ones_not():
    recording = jm.read(jm.sample("lift")).part(0, 60)
    machine = jm.actuator(recording.card)
    shut = jm.simulate(machine, recording).readings["pressure"]
    opened = jm.simulate(machine, recording, start={"opening": -0.8}).readings["pressure"]
    assert float(opened[3]) < float(shut[3]) - 500
    with pytest.raises(InputError, match="begins as it was measured; leave out position"):
        jm.simulate(machine, recording, start={"position": 0.02})


@pytest.mark.slow
def test_states_are_those_of_the_machine():
    machine = creeping()
    run = jm.simulate(machine, command(machine), clock(machine), states=True)
    assert run.states is not None
    assert set(run.states) == {
        "pressure", "pressure_rate", "angle", "angular_velocity", "creep", "valve_hysteresis",
    }  # fmt: skip
    assert run.states["pressure"].shape == (SAMPLES, 2)
    np.testing.assert_array_equal(run.states["pressure"], run.readings["pressure"])
    assert set(run.final.values) == set(run.states)
    assert jm.simulate(machine, command(machine), clock(machine)).states is None


@pytest.mark.slow
def test_a_slope_goes_through_both_halves():
    machine = bench.model("isotonic").with_effects(command_delay=DELAY)
    given, times = command(machine), clock(machine)

    def end(mass, delay):
        own = jm.replace(machine, {"mass": mass, "effects.command_delay.delay": delay})
        first = jm.simulate(own, given[:CUT], times[:CUT])
        return 1e3 * jm.simulate(own, given[CUT:], times[CUT:], start=first.final).readings["position"][-1]

    at = (jnp.asarray(4.0), jnp.asarray(0.0113))
    slopes = jax.jit(jax.grad(end, argnums=(0, 1)))(*at)
    value = jax.jit(end)
    for i, size in enumerate((1e-4, 1e-7)):
        up, down = (value(*(a + s * size * (j == i) for j, a in enumerate(at))) for s in (1, -1))
        assert float(slopes[i]) == pytest.approx(float(up - down) / (2 * size), rel=1e-5)
        assert abs(float(slopes[i])) > 1e-3


@pytest.mark.slow
def test_wrong_states_are_told():
    joint, lift = bench.model("joint"), bench.model("isotonic")
    state = jm.simulate(joint, command(joint), clock(joint)).final
    given, times = command(lift), clock(lift)
    with pytest.raises(InputError, match="expected a state of rig 'isotonic'; got one of rig 'joint'"):
        jm.simulate(lift, given, times, start=state)
    plain = jm.simulate(lift, given, times).final
    creeps = lift.with_effects(creep=built(effects.Creep, 500.0, 0.5, 3.0))
    with pytest.raises(InputError, match="with effects creep; got one with the states opening.*velocity"):
        jm.simulate(creeps, given, times, start=plain)
    jm.simulate(lift, given, 2 * times, start=plain)
    late = lift.with_effects(command_delay=DELAY)
    with pytest.raises(InputError, match="has a delay: expected a state that remembers"):
        jm.simulate(late, given, times, start=plain)
    # The commands that it remembers were given at another step.
    with pytest.raises(InputError, match="commands that were 0.002 s apart.*got 0.004 s"):
        jm.simulate(late, given, 2 * times, start=jm.simulate(late, given, times).final)
