"""`jm.simulate`: the shipped recording replayed, a command of one's own, what is refused, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmuscle as jm

STEP = 0.002
CLOCK = np.arange(300) * STEP
COMMAND = np.where(CLOCK < 0.2, 4.0, np.where(CLOCK < 0.4, 0.0, -3.0))


@pytest.fixture(scope="module")
def lift():
    return jm.read(jm.sample("lift"))


@pytest.fixture(scope="module")
def machine(lift):
    return jm.actuator(lift.card)


def test_replay_begins_with_the_recording(lift, machine):
    begin = lift.part(0, 300)
    simulation = jm.simulate(machine, begin)
    np.testing.assert_array_equal(simulation.time, begin.time)
    assert set(simulation.readings) == {"pressure", "position"}
    for name, values in simulation.readings.items():
        assert values.shape == (300,)
        # The first sample, smoothed.
        assert float(values[0]) == pytest.approx(
            float(begin.columns[name][0]), rel=0, abs=4 * lift.card.noise[name]
        )
    assert np.ptp(simulation.readings["pressure"]) > 1e5
    error = np.asarray(simulation.readings["pressure"]) - begin.columns["pressure"]
    assert error.std() < 0.2 * begin.columns["pressure"].std()


def test_table(lift, machine):
    frame = jm.simulate(machine, lift.part(0, 300)).to_frame()
    assert frame.index.name == "time"
    assert set(frame.columns) == {"pressure", "position"}
    assert len(frame) == 300


def test_several_muscles_are_numbered():
    swing = jm.read(jm.sample("swing")).part(0, 50)
    simulation = jm.simulate(jm.actuator(swing.card), swing)
    assert simulation.readings["pressure"].shape == (50, 2)
    frame = simulation.to_frame()
    assert set(frame.columns) == {"pressure_1", "pressure_2", "angle"}
    np.testing.assert_array_equal(frame["pressure_2"], simulation.readings["pressure"][:, 1])


def test_imposed_states_follow_the_recording():
    bench = jm.read(jm.sample("bench")).part(0, 400)
    force = jm.simulate(jm.actuator(bench.card), bench).readings["force"]
    assert np.corrcoef(force, bench.columns["force"])[0, 1] > 0.95


def test_command_from_an_empty_muscle(machine):
    readings = jm.simulate(machine, COMMAND, CLOCK).readings
    pressure = np.asarray(readings["pressure"])
    assert pressure[0] == pytest.approx(float(machine.ambient_pressure))
    assert float(readings["position"][0]) == 0.0
    assert pressure[100] > pressure[0] + 5e4
    assert pressure[299] < pressure[199]


def test_command_from_a_given_start(machine):
    start = {"pressure": 3e5, "position": 0.02}
    readings = jm.simulate(machine, np.zeros(300), CLOCK, start=start).readings
    for name, value in start.items():
        assert float(readings[name][0]) == pytest.approx(value, rel=1e-12)


@pytest.mark.slow
def test_command_from_hidden_states(machine):
    """A creep that began before, whole and by its entries; a valve that is open."""
    numbers = {"stiffness": 500.0, "fast_time": 0.5, "slow_time": 3.0}
    creeping = machine.with_effects(creep=jm.effects.Creep(**{n: jnp.asarray(v) for n, v in numbers.items()}))
    still, begun = np.zeros(300), {"pressure": 3e5, "position": 0.05}
    rest = jm.simulate(creeping, still, CLOCK, start=begun).readings["position"]
    whole = jm.simulate(creeping, still, CLOCK, start={**begun, "creep": np.array([0.0, 0.2])}).readings[
        "position"
    ]
    entries = {**begun, "creep[0]": 0.0, "creep[1]": 0.2}
    entry = jm.simulate(creeping, still, CLOCK, start=entries).readings["position"]
    opened = jm.simulate(machine, still, CLOCK, start={**begun, "opening": 0.4}).readings["pressure"]
    np.testing.assert_array_equal(np.asarray(whole), np.asarray(entry))
    assert np.ptp(np.asarray(whole) - np.asarray(rest)) > 1e-3
    assert np.asarray(opened).max() > 3e5 + 1e3


REFUSED = {
    "no times": (COMMAND, None, {}, "needs the instants"),
    "other length": (COMMAND[:-1], CLOCK, {}, r"shape \(300,\); got \(299,\)"),
    "two columns": (np.stack([COMMAND, COMMAND], axis=1), CLOCK, {}, r"shape \(300,\); got \(300, 2\)"),
    "one instant": (COMMAND[:1], CLOCK[:1], {}, "at least two uniform"),
    "backwards": (COMMAND, CLOCK[::-1], {}, "at least two uniform"),
    "uneven": (COMMAND, CLOCK + 1e-3 * (CLOCK > 0.3), {}, "at least two uniform"),
    "unknown start": (COMMAND, CLOCK, {"angle": 0.1}, "unknown start.*angle.*opening"),
    "no such state": (COMMAND, CLOCK, {"opning": 0.1}, "unknown start.*opning.*opening"),
    "no such entry": (COMMAND, CLOCK, {"opening[0]": 0.1}, "unknown start.*opening.*opening"),
    "no such entry of a measured one": (COMMAND, CLOCK, {"pressure[1]": 1e5}, "unknown start.*position"),
    "another shape": (COMMAND, CLOCK, {"opening": [0.1, 0.2]}, r"start of opening: .* \(\); got \(2,\)"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_refused(machine, why):
    command, times, start, message = REFUSED[why]
    with pytest.raises(ValueError, match=message):
        jm.simulate(machine, command, times, start=start)


@pytest.mark.slow
def test_command_as_a_function_of_time(machine):
    """As a sweep takes it, with slopes by its parameters."""
    step = jm.commands.Step(level=3.0, begin=0.1)
    by_table = jm.simulate(machine, np.where(CLOCK >= 0.1, 3.0, 0.0), CLOCK).readings["pressure"]
    np.testing.assert_array_equal(jm.simulate(machine, step, CLOCK).readings["pressure"], by_table)

    def last(level):
        return jm.simulate(machine, lambda time: level * (time >= 0.1), CLOCK).readings["pressure"][100]

    slope = jax.jacfwd(last)(3.0)
    assert float(slope) > 0
    assert float(slope) == pytest.approx(float(last(3.0 + 1e-4) - last(3.0 - 1e-4)) / 2e-4, rel=1e-5)
    with pytest.raises(ValueError, match=r"expected a command of shape \(300,\); got \(300, 2\)"):
        jm.simulate(machine, lambda time: jnp.stack([time, time]), CLOCK)


def test_imposed_rig_takes_no_command():
    bench = jm.read(jm.sample("bench"))
    with pytest.raises(TypeError, match="driven.*imposed; give a recording"):
        jm.simulate(jm.actuator(bench.card), COMMAND, CLOCK)


@pytest.mark.parametrize("path", ["valve.area", "muscle.end_factor"])
def test_forward_derivative_is_the_central_difference(machine, path):
    value = jm.parameters.get(machine, path)

    def final(given):
        readings = jm.simulate(jm.replace(machine, {path: given}), COMMAND, CLOCK).readings
        return jnp.stack([readings["pressure"][90], readings["position"][90]])

    _, slope = jax.jvp(final, (value,), (jnp.ones_like(value),))
    width = 1e-5 * float(value)
    difference = (final(value + width) - final(value - width)) / (2 * width)
    np.testing.assert_allclose(slope, difference, rtol=1e-4)
    assert (np.abs(slope) > 0).all()
