"""The sample clock: zero-order hold, imposed states, windows that equal the whole run."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

from jaxmuscle.simulation import Track, observe, predict, run, start_at_rest

COMMANDS = {"isotonic": bench.isotonic_command()[:200], "joint": bench.joint_command()[45:245]}
TRACKS = {"isotonic": bench.isotonic_track, "joint": bench.joint_track}
DECLARED = {
    "thread_friction": bench.THREADS,
    "length_hysteresis": bench.LOOP,
    "creep": {"stiffness": 50.0},
    "load_damping": {"coefficient": 0.1},
}


def machine(rig):
    return bench.model(rig, **DECLARED), TRACKS[rig](COMMANDS[rig])


@eqx.filter_jit
def simulated_keeping(actuator, track, imposed, substeps, keep=()):
    start = start_at_rest(actuator, track)
    samples = track.command.shape[0]
    return run(
        actuator, track, start, jnp.asarray(0), samples=samples, imposed=imposed, substeps=substeps, keep=keep
    )


@eqx.filter_jit
def windows(actuator, track, rows):
    """Predictions over 60 samples from each row, nothing imposed, two steps a sample."""
    hidden = observe(actuator, track, track.command.shape[0])
    return predict(actuator, track, rows, samples=60, imposed=(), substeps=2, hidden=hidden)


@pytest.mark.slow
@pytest.mark.parametrize("rig", TRACKS)
def test_window_at_the_first_sample_is_the_run_from_rest(rig):
    actuator, track = machine(rig)
    whole = bench.simulated(actuator, track, 2).readings
    window = windows(actuator, track, jnp.array([0, 40, 80]))
    for name, reading in whole.items():
        np.testing.assert_allclose(window[name][0], reading[:60], rtol=1e-10, atol=1e-12)
        assert np.ptp(window[name][0]) > 1e-3


@pytest.mark.parametrize("rig", TRACKS)
def test_window_further_on_continues_its_own_run(rig):
    """On a track that is a run of the model itself, a window reproduces the run from any row."""
    actuator, track = machine(rig)
    states = (*actuator.measured, *actuator.derivatives)
    kept = simulated_keeping(actuator, track, (), 2, keep=states)
    own = bench.track(rig, track.command, **kept.states.state)
    rows = jnp.array([30, 75, 130])
    window = windows(actuator, own, rows)
    for name, reading in kept.readings.items():
        for lane, row in enumerate(rows):
            # The observer's openings, memories and creep see the states linear between samples.
            expected = np.asarray(reading[row : row + 60])
            assert np.abs(window[name][lane] - expected).max() < 1e-4 * np.ptp(reading)


@pytest.mark.parametrize("rig", TRACKS)
def test_windows_of_a_batch_do_not_see_each_other(rig):
    actuator, track = machine(rig)
    together = windows(actuator, track, jnp.array([3, 50, 140]))
    otherwise = windows(actuator, track, jnp.array([0, 3, 3]))
    for name in together:
        np.testing.assert_allclose(together[name][0], otherwise[name][1], rtol=1e-12, atol=1e-12)


def test_last_row_is_held_beyond_the_end_of_the_track():
    actuator, track = machine("joint")
    beyond = windows(actuator, track, jnp.array([0, 100, 190]))
    assert all(np.isfinite(reading).all() for reading in beyond.values())
    np.testing.assert_allclose(beyond["pressure"][2, -1], COMMANDS["joint"][-1], rtol=2e-3)


@pytest.mark.parametrize("rig", TRACKS)
def test_imposed_states_follow_the_track(rig):
    actuator, track = machine(rig)
    wave = np.sin(np.arange(200) / 9.0)
    shape = np.ones(2) if rig == "joint" else 1.0
    pressure = bench.AMBIENT + 2e5 + 1e5 * np.multiply.outer(wave, shape)
    other = bench.track(rig, track.command, **{**track.measured, "pressure": pressure})
    readings = simulated_keeping(actuator, other, ("pressure",), 2).readings
    np.testing.assert_array_equal(readings["pressure"], pressure)
    position = "angle" if rig == "joint" else "position"
    assert not np.allclose(
        readings[position], bench.simulated(actuator, track, 2).readings[position], atol=1e-4
    )


def test_imposed_states_are_linear_between_samples():
    """The mass under an imposed pressure whose ramp is sampled coarsely or finely moves alike."""
    actuator = bench.model("isotonic")
    ramp = np.linspace(2.5e5, 5e5, 61)
    fine = bench.track("isotonic", np.zeros(61), pressure=ramp, position=0.0, velocity=0.0)
    coarse = bench.track("isotonic", np.zeros(21), pressure=ramp[::3], position=0.0, velocity=0.0)
    coarse = eqx.tree_at(lambda track: track.step, coarse, 3 * fine.step)
    moved = simulated_keeping(actuator, fine, ("pressure",), 1).readings["position"][::3]
    same = simulated_keeping(actuator, coarse, ("pressure",), 3).readings["position"]
    np.testing.assert_allclose(same, moved, rtol=1e-9)
    assert float(same[-1]) > 0.02


def test_hold_changes_exactly_at_the_sample():
    command = np.zeros(60)
    command[20:40], command[40:] = 3.0, -2.0
    kept = simulated_keeping(
        bench.model("isotonic"), bench.isotonic_track(command), (), 16, keep=("opening",)
    )
    opening = np.asarray(kept.states.state["opening"])
    assert not opening[:21].any() and opening[21] > 0
    assert opening[41] < opening[40]
    time, tau = np.arange(60) * 2e-3, bench.CARDS["isotonic"]["valve_time_constant"]
    charged = np.where(time > 0.04, 0.6 * (1 - np.exp(-(time - 0.04) / tau)), 0.0)
    expected = np.where(time > 0.08, -0.4 + (charged[40] + 0.4) * np.exp(-(time - 0.08) / tau), charged)
    np.testing.assert_allclose(opening, expected, atol=1e-5)


@pytest.mark.parametrize("rig", TRACKS)
def test_halving_the_steps_changes_little(rig):
    actuator, track = machine(rig)
    coarse, fine = (bench.simulated(actuator, track, substeps).readings for substeps in (2, 4))
    for name in coarse:
        assert bench.deviation(coarse[name], np.asarray(fine[name])) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("rig", TRACKS)
def test_stretches_are_runs_of_their_own(rig):
    actuator, track = machine(rig)
    bench_data = track.command, track.measured
    first, second = (jax.tree.map(lambda v, k=k: v[k : k + 120], bench_data) for k in (0, 60))
    joined = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), first, second)
    whole = bench.simulated(
        actuator, Track(track.step, joined[0], joined[1], jnp.arange(240) == 120), 1
    ).readings
    for begin, part in ((0, first), (120, second)):
        alone = bench.simulated(actuator, Track(track.step, *part), 1).readings
        for name, reading in alone.items():
            np.testing.assert_allclose(whole[name][begin : begin + 120], reading, rtol=1e-10, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("rig", TRACKS)
def test_start_is_the_measured_state_with_everything_else_at_rest(rig):
    actuator, track = machine(rig)
    start = start_at_rest(actuator, track, 7)
    for name, values in track.measured.items():
        np.testing.assert_array_equal(start.state[name], values[7])
    resting = set(start.state) - set(track.measured) - {"effects"}
    assert all(not np.any(start.state[name]) for name in resting)
    assert set(start.memory) == {"length_hysteresis"} and set(start.state["effects"]) == {"creep"}


def test_forward_mode_goes_through_a_jitted_run():
    actuator, track = machine("joint")
    _, slope = jax.jvp(
        lambda inertia: bench.simulated(
            eqx.tree_at(lambda m: m.inertia, actuator, inertia), track, 1
        ).readings["angle"],
        (actuator.inertia,),
        (jnp.ones(()),),
    )
    assert np.isfinite(slope).all() and np.any(slope)
