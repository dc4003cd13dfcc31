"""What a valve makes of its command: dead band, play, offset and limited rate, alone and one on the other."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS, Held
from jaxmuscle.effects import BY_NAME, DeadBand, RateLimit, SpoolHysteresis, ValveHysteresis
from jaxmuscle.recordings.schema import quantities
from jaxmuscle.signals import Past, Signals

STEP = 2e-3


def band(command, width, neutral: Any = 0.0, moves: Any = 1.0):
    signals = Signals(command=jnp.asarray(command), neutral=neutral, moves_valve=moves)
    return command + built(DeadBand, width=width).value(signals)


def test_dead_band_passes_what_is_beyond_it():
    commands = np.array([-3.0, -0.5, -0.2, 0.0, 0.3, 0.5, 2.0])
    expected = np.sign(commands) * np.maximum(np.abs(commands) - 0.5, 0.0)
    np.testing.assert_allclose(band(commands, 0.5), expected, atol=1e-15)
    # A regulator's is about the pressure that it has reached; a commanded supply has none.
    np.testing.assert_allclose(band(np.array([3e5, 2.99e5]), 2e3, 2.98e5), [3e5 - 2e3, 2.98e5])
    np.testing.assert_array_equal(band(np.array([0.2, 5e5]), 0.5, 0.0, np.array([1.0, 0.0])), [0.0, 5e5])


@pytest.mark.parametrize(("command", "width"), [(0.7, 0.5), (0.3, 0.5), (-0.7, 0.5), (0.0, 0.5), (1.0, 0.0)])
def test_slopes_of_the_dead_band(command, width):
    def passed(both):
        return band(both[0], both[1])

    at, h = jnp.array([command, width]), 1e-7
    slope = jax.jit(jax.vmap(jax.grad(passed)))(at[None])[0]
    forward = [(passed(at + h * e) - passed(at)) / h for e in jnp.eye(2)]
    np.testing.assert_allclose(slope, forward, atol=1e-6)


def test_slopes_at_the_edge_and_at_nothing_are_those_of_one_side():
    edge = jax.grad(band, argnums=(0, 1))(jnp.asarray(0.5), jnp.asarray(0.5))
    np.testing.assert_array_equal(edge, [1.0, -1.0])
    # Of no width and no command: the slopes of a valve without a dead band.
    np.testing.assert_array_equal(jax.grad(band, argnums=(0, 1))(jnp.zeros(()), jnp.zeros(())), [1.0, 0.0])


@jax.jit
def followed(half_width, commands):
    """The command behind a play, sample by sample."""
    play = built(SpoolHysteresis, half_width=half_width)

    def onward(memory, command):
        here = Signals(command=command)
        return play.update(memory, here, jnp.asarray(STEP)), command + play.value(memory, here)

    return jax.lax.scan(onward, play.initial(Signals(command=commands[0])), commands)[1]


def test_play_of_a_spool_is_the_play_operator():
    commands = np.concatenate([[0.0, 0.0], np.random.default_rng(2).normal(0, 1, 60).repeat(2)])
    expected = [commands[0]]
    for command in commands[1:]:
        expected.append(max(command - 0.4, min(command + 0.4, expected[-1])))
    np.testing.assert_allclose(followed(jnp.asarray(0.4), jnp.asarray(commands)), expected, atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("half_width", [0.0, 0.4])
def test_slopes_of_the_play_at_rest_at_reversals_and_of_no_width(half_width):
    commands = jnp.asarray([0.3, 0.3, 1.5, 1.5, 0.1, -0.9, -0.9, 2.0])
    width, h = jnp.asarray(half_width), 1e-6
    slope = jax.jacfwd(followed)(width, commands)
    np.testing.assert_allclose(
        slope, (followed(width + h, commands) - followed(width, commands)) / h, atol=1e-8
    )
    np.testing.assert_allclose(jax.jacrev(followed)(width, commands), slope, atol=1e-15)
    # Over the commands: of no width all of each passes, from whatever came before.
    over = jax.jacfwd(followed, argnums=1)(width, commands)
    if half_width == 0:
        np.testing.assert_array_equal(over, np.eye(len(commands)))
    assert np.isfinite(over).all()


@pytest.mark.slow
def test_a_spool_keeps_to_its_rate_and_arrives():
    command = np.concatenate([np.zeros(5), np.full(120, 4.0)])
    machine = bench.model("isotonic", rate_limit={"inverse_rate": 1 / 40})
    run = bench.simulate(machine, bench.isotonic_track(command), 4, keep=("opening",))
    reached = np.asarray(run.states.state["opening"]) * float(machine.valve.full_command)
    rates, lag = np.diff(reached) / STEP, float(machine.valve.time_constant)
    assert 0.999 * 40 < rates.max() <= 40.0 and reached[-1] == pytest.approx(4.0, rel=1e-3)
    # 4 V at 40 V/s take 0.1 s; the spool comes behind by its lag.
    assert reached[5 + 40] == pytest.approx(40 * (40 * STEP - lag), rel=1e-3)


@pytest.mark.slow
def test_a_regulated_pressure_keeps_to_its_rate():
    rate, command = 1.5e6, np.full((400, 2), bench.AMBIENT + 4e5)
    command[:5] = bench.AMBIENT + 1e5
    track = bench.track(
        "joint", command, pressure=np.full(2, bench.AMBIENT + 1e5), angle=0.0, angular_velocity=0.0
    )
    free, limited = (
        np.asarray(bench.simulated(m, track, 4).readings["pressure"][:, 0])
        for m in (bench.model("joint"), bench.model("joint", rate_limit={"inverse_rate": 1 / rate}))
    )
    assert np.diff(free).max() / STEP > 3 * rate
    # A second-order lag of 0.85 overshoots by 0.6 %, its rate too.
    assert rate < np.diff(limited).max() / STEP < 1.01 * rate
    over = free.max() - command[-1, 0]
    assert limited[-1] == pytest.approx(command[-1, 0], rel=1e-4) and limited.max() - command[-1, 0] <= over


def limiter(inverse_rate, commands, step):
    """The mean that acts in each step, and what is reached at its end."""
    effect = built(RateLimit, inverse_rate=inverse_rate)
    memory, means = (jnp.asarray(0.5), jnp.asarray(step)), []
    for command in commands:
        signals = Signals(command=command)
        means.append(command + effect.value(memory, signals))
        memory = effect.update(memory, signals, jnp.asarray(step))
    return jnp.stack(means), memory[0]


@pytest.mark.slow
def test_the_mean_over_a_step_is_that_of_the_ramp():
    step, rate = 0.01, 60.0
    coarse, end = limiter(1 / rate, jnp.array([2.0, 2.0, 2.0, -1.0]), step)
    fine, same = limiter(1 / rate, jnp.repeat(jnp.array([2.0, 2.0, 2.0, -1.0]), 1000), step / 1000)
    np.testing.assert_allclose(coarse, fine.reshape(4, -1).mean(axis=1), atol=1e-9)
    assert float(end) == pytest.approx(float(same)) == pytest.approx(2.0 - 0.6)


def test_in_a_step_of_no_length_nothing_is_limited():
    means, _ = limiter(0.1, jnp.array([2.0]), 0.0)
    assert float(means[0]) == 2.0


@pytest.mark.slow
@pytest.mark.parametrize("inverse_rate", [0.0, 0.004, 1 / 60, 0.1])
def test_slopes_of_the_limited_rate(inverse_rate):
    step = 0.01

    def passed(both):
        means, end = limiter(both[0], both[1:], step)
        return jnp.append(means, end)

    at = jnp.array([inverse_rate, 2.0, 2.1, -1.0, 0.9])
    slopes, h = jax.jacfwd(passed)(at), 1e-7
    forward = np.stack([(passed(at + h * e) - passed(at)) / h for e in jnp.eye(5)], axis=1)
    np.testing.assert_allclose(slopes, forward, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(jax.jacrev(passed)(at), slopes, atol=1e-12)


def test_effects_of_the_command_act_one_on_the_other():
    # Offset and delay first, then the play, then the dead band.
    machine = bench.model(
        "isotonic",
        dead_band={"width": 0.5},
        valve_offset={"offset": 0.2},
        valve_hysteresis={"half_width": 0.1},
        command_delay={"delay": STEP},
    )
    table = jnp.asarray([0.0, 1.0, 3.0, -2.0])
    state = {"opening": jnp.zeros(()), "pressure": jnp.asarray(3e5), "effects": {}}
    state |= {"position": jnp.asarray(0.01), "velocity": jnp.zeros(())}
    past = Past(table, jnp.asarray(2), jnp.asarray(STEP), table[0])
    memory = {"valve_hysteresis": (jnp.asarray(0.2), jnp.zeros(()))}
    signals = machine.signals(state, Held(table[2], past, memory))
    assert float(signals.command) == pytest.approx(1.0 + 0.2 - 0.1 - 0.5)
    assert float(signals.found["valve_hysteresis"]) == pytest.approx(1.2)


def declared(rig, text):
    """A card of a rig that declares one effect."""
    needs = quantities(RIGS[rig])
    known = {
        name: {"value": float(value), "unit": needs[name].unit}
        | ({"reference": "absolute"} if needs[name].referenced else {})
        for name, value in bench.CARDS[rig].items()
    }
    columns = {"time": {"column": "time", "unit": "s"}}
    for name in (*RIGS[rig].commands, *(n for names in RIGS[rig].outputs.values() for n in names)):
        column = RIGS[rig].column(name)
        columns[name] = {"column": name, "unit": column.unit}
        columns[name] |= {"reference": "absolute"} if column.unit == "Pa" else {}
    return jm.Card.parse({"rig": rig, "columns": columns, "known": known, "effects": text})


def test_one_name_is_the_form_that_the_rig_has():
    spool = declared("isotonic", {"valve_hysteresis": {"half_width": {"value": 80, "unit": "mV"}}})
    pipe = declared("jet-pipe", {"valve_hysteresis": {"weight": {"value": 0.2, "unit": ""}}})
    assert BY_NAME["valve_hysteresis"] is ValveHysteresis
    play, tip = (jm.actuator(card).effects["valve_hysteresis"] for card in (spool, pipe))
    assert isinstance(play, SpoolHysteresis) and float(play.half_width) == pytest.approx(0.08)
    assert isinstance(tip, ValveHysteresis)
    assert jm.Card.from_toml(spool.to_toml()) == spool
    changed = spool.updated({}, {"valve_hysteresis": {"half_width": (0.1, 0.01)}})
    assert float(jm.actuator(changed).effects["valve_hysteresis"].half_width) == pytest.approx(0.1)  # pyright: ignore
    with pytest.raises(jm.InputError, match="weight"):
        declared("isotonic", {"valve_hysteresis": {"weight": {"value": 0.2, "unit": ""}}})
