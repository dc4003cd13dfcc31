"""Lag of the pressure, bent load cell, backlash: readings by hand, at rest, at reversals, in links."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built
from oracles.plays import behind_play

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.effects import FURTHER, Backlash, ForceSensorLag, ForceSensorNonlinearity, PressureSensorLag
from jaxmuscle.effects.readings import Samples
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.residuals import residuals
from jaxmuscle.signals import Signals
from jaxmuscle.simulation.sensor_errors import true_track

STEP = bench.STEPS["isotonic"]
COMMAND = bench.isotonic_command()
weighted_residuals = eqx.filter_jit(residuals)
CLOCK = np.arange(len(COMMAND)) * STEP


def lifted(**effects):
    machine = bench.model("isotonic", **effects)
    return machine, jm.simulate(machine, COMMAND, CLOCK).readings


@pytest.fixture(scope="module")
def true():
    return {name: np.asarray(values) for name, values in lifted()[1].items()}


def test_a_lagging_pressure_in_the_chain(true):
    """The lag's own equation, exact for straight lines between samples, at half the samples' step."""
    tau, shown = 0.02, [true["pressure"][0]]
    for before, here in zip(true["pressure"][:-1], true["pressure"][1:], strict=True):
        slope = (here - before) / STEP
        error = (shown[-1] - before + tau * slope) * np.exp(-STEP / tau) - tau * slope
        shown.append(here + error)
    found = lifted(pressure_sensor_lag={"time_constant": tau})[1]
    np.testing.assert_allclose(found["pressure"], shown, atol=2e-3 * np.ptp(true["pressure"]))
    assert np.abs(shown - true["pressure"]).max() > 0.1 * np.ptp(true["pressure"])
    np.testing.assert_array_equal(found["position"], true["position"])


@pytest.mark.slow
def test_the_position_is_predicted_from_the_pressure_before_its_sensor_lagged(true):
    effect = {"pressure_sensor_lag": {"time_constant": 0.02}}
    machine, readings = lifted(**effect)
    columns = {"command": COMMAND, **{name: np.asarray(values) for name, values in readings.items()}}
    noise = {"pressure": 300.0, "position": 5e-5}
    recording = jm.recording(machine, columns, STEP, noise=noise, horizon=0.3)
    problem = case(recording, 0.0).problem
    corrected = np.asarray(true_track(machine, problem.track).measured["pressure"])
    off = np.abs(corrected - true["pressure"])[5:-5]
    assert off.mean() < 0.06 * np.abs(columns["pressure"] - true["pressure"])[5:-5].mean()
    left = {
        name: float(np.sqrt(np.mean(np.square(weighted_residuals(model, problem)["position"]))))
        for name, model in {"declared": machine, "ignored": bench.model("isotonic")}.items()
    }
    assert left["declared"] < 0.2 * left["ignored"]


def test_backlash_is_a_play_operator(true):
    half = 1e-3
    expected = behind_play(true["position"], half, true["position"][0])
    found = lifted(backlash={"half_width": half})[1]
    # Reversals between samples: within a step of the motion there.
    np.testing.assert_allclose(found["position"], expected, atol=2e-5)
    assert np.ptp(found["position"] - true["position"]) > 1.9 * half
    # Two programs may contract a product and a sum differently: the last bits.
    np.testing.assert_allclose(found["pressure"], true["pressure"], rtol=1e-13)


@pytest.mark.parametrize("width", [0.0, 2e-4])
def test_slope_of_a_backlash_on_the_way_at_rest_and_at_reversals(width):
    path = jnp.asarray([0.0, 2e-3, 5e-3, 5e-3, 5e-3, 4e-3, 1e-3, 1e-3, 3e-3])

    @jax.jit
    def shown(half_width):
        effect = built(Backlash, half_width=half_width)

        def onward(memory, position):
            signals = Signals(position_reading=position)
            memory = effect.update(memory, signals, jnp.asarray(STEP))
            return memory, position + effect.value(memory, signals)

        return jax.lax.scan(onward, effect.initial(Signals(position_reading=path[0])), path)[1]

    slope = jax.vmap(jax.jacfwd(shown))(jnp.full(2, width))[0]
    np.testing.assert_allclose(slope, (shown(width + 1e-6) - shown(width)) / 1e-6, atol=1e-6)
    np.testing.assert_array_equal(slope[1:], [-1, -1, -1, -1, 1, 1, 1, -1])
    np.testing.assert_array_equal(jax.grad(lambda b: shown(b).sum())(width), slope.sum())
    np.testing.assert_array_equal(shown(0.0), path)


def backlash_samples(begins=()):
    """Instants of a path of 60 samples, in one stretch or several."""
    edges = np.array([0, *begins, 60])
    stretch = np.searchsorted(edges, np.arange(60), side="right") - 1
    return Samples(jnp.arange(60) * STEP, jnp.asarray(edges[stretch]), jnp.asarray(edges[stretch + 1] - 1))


ROUND = 5e-3 * np.sin(2 * np.pi * np.arange(60) / 40)
"""Up, down and up again, from 0 [m]."""


def behind(half, path):
    """What the sensor shows of a path, the load in the middle of the gap at first."""
    return jnp.asarray(behind_play(np.asarray(path), half, path[0]))


def test_the_load_is_at_the_side_of_the_gap_that_last_pushed():
    half = 1e-3
    effect, shown = built(Backlash, half_width=half), behind(half, ROUND)
    found = np.asarray(effect.corrected(shown, backlash_samples()))
    # Not while the sensor rests and the load crosses the gap, nor in the fifth of it after that.
    pushed = np.abs(np.diff(shown, prepend=shown[0])) > 0
    settled = pushed & (np.abs(found - shown) > 0.999 * half)
    np.testing.assert_allclose(found[settled], ROUND[settled], atol=1e-9)
    assert settled.sum() > 0.75 * pushed.sum() > 20
    assert {*np.sign(found - shown)[settled]} == {-1.0, 1.0}


def test_where_a_stretch_begins_the_load_is_in_the_middle_of_the_gap():
    half, begin = 1e-3, 20
    effect, shown = built(Backlash, half_width=half), behind(half, ROUND)
    found = np.asarray(effect.corrected(shown, backlash_samples((begin,))))
    whole = np.asarray(effect.corrected(shown, backlash_samples()))
    np.testing.assert_array_equal(found[:begin], whole[:begin])
    assert found[begin] == shown[begin]
    np.testing.assert_allclose(whole[begin], shown[begin] - half, atol=1e-15)
    np.testing.assert_array_equal(found[begin + 2 :], whole[begin + 2 :])


def test_noise_does_not_move_the_load_across_the_gap():
    half, rng = 1e-3, np.random.default_rng(3)
    path = np.where(np.arange(60) < 10, ROUND, ROUND[10])
    shown = behind(half, path) + 1e-5 * rng.normal(size=60)
    found = built(Backlash, half_width=half).corrected(shown, backlash_samples())
    np.testing.assert_allclose(found[10:], shown[10:] + half, atol=0.25 * half)


@pytest.mark.parametrize("half", [0.0, 1e-9, 2e-4, 1e-3])
def test_slopes_of_a_position_freed_of_backlash(half):
    """By the half width and by what was shown, against finite differences, under vmap; at rest, too."""
    shown, at = behind(1e-3, jnp.concatenate([ROUND[:45], jnp.full(15, ROUND[44])])), backlash_samples()

    @jax.jit
    def freed(half, shown):
        return built(Backlash, half_width=half).corrected(shown, at)

    by_width, by_shown = jax.vmap(jax.jacfwd(freed, argnums=(0, 1)), (0, None))(jnp.full(2, half), shown)
    here, tiny = freed(half, shown), 1e-9
    np.testing.assert_allclose(by_width[1], (freed(half + tiny, shown) - here) / tiny, atol=2e-4)
    # Back from the side that pushed: at rest the slope the other way is none.
    way = jnp.interp(jnp.arange(60.0), jnp.asarray([0.0, 25, 40, 59]), jnp.asarray([25.0, 0, 15, 0]))
    change = (freed(half, shown + tiny * way) - here) / tiny
    np.testing.assert_allclose(by_shown[0] @ way, change, atol=2e-4)
    assert half > 0 or bool(jnp.all(here == shown))


def test_the_velocity_of_the_load_is_the_sensors(true):
    machine = bench.model("isotonic", backlash={"half_width": 1e-3}, sensor_gain_position={"gain": 0.03})
    columns = {name: np.asarray(values) for name, values in true.items()}
    noise = {"pressure": 300.0, "position": 5e-5}
    recording = jm.recording(machine, {"command": COMMAND, **columns}, STEP, noise=noise, horizon=0.3)
    track = case(recording, 0.0).problem.track
    freed = true_track(machine, track).measured
    np.testing.assert_allclose(freed["velocity"], track.measured["velocity"] / 1.03, rtol=1e-12, atol=1e-15)
    moved = np.asarray(freed["position"] - track.measured["position"] / 1.03)
    assert 0.99e-3 < np.abs(moved).max() <= 1e-3 + 1e-12
    np.testing.assert_array_equal(freed["pressure"], track.measured["pressure"])


@pytest.mark.slow
def test_a_window_begins_with_the_load_at_its_side_of_the_gap():
    """Residuals of the right machine, on windows that begin anywhere, with and without the backlash."""
    half = 1e-3
    readings = lifted(backlash={"half_width": half})[1]
    noise, rng = {"pressure": 300.0, "position": 5e-5}, np.random.default_rng(4)
    columns = {n: np.asarray(readings[n]) + noise[n] * rng.normal(size=len(CLOCK)) for n in noise}
    machine = bench.model("isotonic", backlash={"half_width": half})
    recording = jm.recording(machine, {"command": COMMAND, **columns}, STEP, noise=noise, horizon=0.3)
    problem = case(recording, 0.0).problem

    def left(model):
        return float(np.mean(np.square(weighted_residuals(model, problem)["position"])))

    assert left(machine) < 0.1 * left(bench.model("isotonic"))


def test_a_bent_load_cell():
    machine = bench.model("driven", force_sensor_nonlinearity={"cubic": 2e-8})
    track = bench.driven_track(*bench.driven_motion())
    force = np.asarray(bench.simulate(bench.model("driven"), track, 1).readings["force"])
    found = bench.simulate(machine, track, 1).readings["force"]
    np.testing.assert_allclose(found, force + 2e-8 * force**3, rtol=1e-12)
    assert np.abs(found - force).max() > 1.0
    slope = jax.vmap(jax.grad(lambda c, f: built(ForceSensorNonlinearity, cubic=c).value(Signals(force=f))))
    at = jnp.asarray([0.0, 250.0, -40.0])
    np.testing.assert_allclose(slope(jnp.zeros(3), at), at**3, rtol=1e-12)


def test_rigs_offer_them_by_their_readings():
    offering = {e.name: {name for name, rig in RIGS.items() if rig.offers(e)} for e in FURTHER}
    moving = {"isotonic", "joint", "elbow", "scara"}
    assert offering["pressure_sensor_lag"] == offering["backlash"] == moving
    assert offering["force_sensor_nonlinearity"] == {"driven", "jet-pipe", "jet-pipe-piston"}


@pytest.mark.parametrize("rig", ["joint", "elbow"])
def test_on_other_rigs_they_act_on_every_pressure_and_on_the_motion(rig):
    command = getattr(bench, f"{rig}_command")()[:120]
    clock = np.arange(120) * bench.STEPS[rig]
    plain = jm.simulate(bench.model(rig), command, clock).readings
    bent = {"pressure_sensor_lag": {"time_constant": 0.03}, "backlash": {"half_width": 0.01}}
    found = jm.simulate(bench.model(rig, **bent), command, clock).readings
    moved = np.ptp(np.asarray(found["pressure"] - plain["pressure"]), axis=0)
    assert np.all(moved > 0.02 * np.ptp(np.asarray(plain["pressure"]), axis=0))
    assert 0.0 < np.abs(np.asarray(found["angle"] - plain["angle"])).max() <= 0.01 + 1e-12


@pytest.mark.slow
def test_one_time_constant_is_found_from_both_links(true):
    readings = lifted(pressure_sensor_lag={"time_constant": 0.012})[1]
    noise, rng = {"pressure": 300.0, "position": 5e-5}, np.random.default_rng(4)
    columns = {n: np.asarray(readings[n]) + noise[n] * rng.normal(size=len(CLOCK)) for n in noise}
    machine = bench.model("isotonic", pressure_sensor_lag={"time_constant": 0.005})
    recording = jm.recording(machine, {"command": COMMAND, **columns}, STEP, noise=noise, horizon=0.3)
    found = jm.fit(machine, recording, ["pressure_sensor_lag.time_constant"])
    (entry,) = found.parameters.values()
    assert PressureSensorLag.name in entry.path
    assert entry.value == pytest.approx(0.012, rel=0.05)


@pytest.mark.parametrize("tau", [0.0, 1e-4, 1e-3, 0.3])
@pytest.mark.parametrize("step", [0.0, 1e-7, 1e-6, 2e-6, 1e-3])
def test_a_lag_over_a_step_of_any_length_is_that_of_a_ramp(tau, step):
    """Reading 3.0 of a force that rises from 5.0 by 40 a second, and its slopes by step and time constant."""

    def shown(step, tau):
        lag = ForceSensorLag(time_constant=tau)
        error, value = lag.update(
            (jnp.asarray(-2.0), jnp.asarray(5.0)), Signals(force=5.0 + 40.0 * step), step
        )
        return error + value

    at = jnp.asarray(step), jnp.asarray(tau)
    if tau > 0:
        fading = np.exp(-step / tau)
        expected = 5.0 + 40.0 * step - 40.0 * tau * (1 - fading) - 2.0 * fading
        by_step = 40.0 * (1 - fading) + 2.0 * fading / tau
    elif step > 0:  # The reading follows at once.
        expected, by_step = 5.0 + 40.0 * step, 40.0
    else:
        return
    np.testing.assert_allclose(shown(*at), expected, rtol=1e-12)
    np.testing.assert_allclose(jax.jacfwd(shown)(*at), by_step, rtol=1e-7)
    assert bool(jnp.isfinite(jax.jacfwd(shown, argnums=1)(*at)))


def test_a_step_of_no_length_has_no_slope_that_is_no_number():
    def error(tau):
        memory = jnp.asarray(0.0), jnp.asarray(5.0)
        return ForceSensorLag(time_constant=tau).update(memory, Signals(force=memory[1]), jnp.zeros(()))[0]

    assert float(error(0.0)) == 0.0 and float(jax.jacfwd(error)(0.0)) == 0.0
