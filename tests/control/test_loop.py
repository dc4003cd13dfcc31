"""Machines in closed loop: equal to open loop where the controller is constant, delays, derivatives, vmap."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

from jaxmuscle import control, simulate
from jaxmuscle.control import (
    FuzzyPID,
    IntegralInversePID,
    ProportionalForce,
    closed_loop,
    feedback_on,
)
from jaxmuscle.control import loop as loop_module
from jaxmuscle.effects import CommandDelay
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace
from jaxmuscle.robot.tondu2000 import MEAN_PRESSURE, robot_joint

STEP = 2e-3
REST = {"pressure": np.full(2, bench.AMBIENT + MEAN_PRESSURE)}
JOINT = robot_joint(0.64)
SMOOTH = robot_joint(0.64, friction=False)
FUZZY = built(FuzzyPID, 0.5, 5.0, 1.5e5, 3e5)


class Played(eqx.Module):
    """Gives the commands that it is told to, whatever it sees."""

    def start(self):
        return jnp.asarray(0)

    def update(self, state, wanted, readings, step):
        return state + 1, wanted


def clock(samples):
    return np.arange(samples) * STEP


def waves(samples):
    return bench.AMBIENT + MEAN_PRESSURE + 8e4 * np.sin(clock(samples) * 9)[:, None] * [1.0, -1.0]


@pytest.mark.slow
@pytest.mark.parametrize("delay", [None, 0.0031])
@pytest.mark.parametrize("substeps", [1, 2])
def test_a_controller_that_plays_a_command_is_open_loop(delay, substeps):
    machine = JOINT if delay is None else JOINT.with_effects(command_delay=built(CommandDelay, delay))
    commands = waves(150)
    closed = closed_loop(machine, Played(), commands, clock(150), start=REST, substeps=substeps)
    opened = simulate(machine, commands, clock(150), start=REST, substeps=substeps)
    np.testing.assert_array_equal(closed.commands, commands)
    for name, values in opened.readings.items():
        np.testing.assert_allclose(closed.readings[name], values, rtol=1e-12, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["elbow", "jet-pipe"])
def test_rigs_with_one_command(rig):
    samples, machine = 60, bench.model(rig)
    rest = {"pressure": np.asarray(2e5)} if rig == "elbow" else {}
    commands = 2e5 + 5e4 * np.sin(clock(samples) * 30) if rig == "elbow" else np.full(samples, 1.2)
    closed = closed_loop(machine, Played(), commands, clock(samples), start=rest)
    opened = simulate(machine, commands, clock(samples), start=rest)
    for name, values in opened.readings.items():
        np.testing.assert_allclose(closed.readings[name], values, rtol=1e-12)


@pytest.mark.slow
def test_a_delay_sees_the_commands_that_were_given():
    # In open loop the same machine under the recorded commands gives the same motion, and not without delay.
    delayed = JOINT.with_effects(command_delay=built(CommandDelay, 0.0157))
    target = np.full(200, 0.4)
    closed = closed_loop(delayed, feedback_on(JOINT, FUZZY), target, clock(200), start=REST)
    assert float(np.ptp(np.asarray(closed.commands), axis=0).max()) > 5e4
    again = simulate(delayed, closed.commands, clock(200), start=REST).readings["angle"]
    without = simulate(JOINT, closed.commands, clock(200), start=REST).readings["angle"]
    np.testing.assert_allclose(closed.readings["angle"], again, rtol=0, atol=1e-12)
    assert float(jnp.abs(without - again).max()) > 1e-3


TARGET = 0.3 * np.sin(5 * clock(60))


def tracking(gain, delay=None, machine=SMOOTH):
    if delay is not None:
        machine = machine.with_effects(command_delay=CommandDelay(delay))
    controlled = feedback_on(machine, replace(FUZZY, {"proportional": gain}))
    found = closed_loop(machine, controlled, TARGET, clock(60), start=REST)
    return 1e3 * jnp.mean((found.readings["angle"] - TARGET) ** 2)


@pytest.mark.slow
def test_gradient_of_a_tracking_cost_equals_finite_differences():
    # Over a gain, and over a delay: what the delayed loop does depends on the commands that it has given.
    cost = jax.jit(lambda both: tracking(1e5 * both[0], 1e-3 * both[1]))
    at, size = jnp.array([1.5, 5.1]), 1e-5
    slope = jax.jit(jax.grad(cost))(at)
    for i in range(2):
        difference = (cost(at.at[i].add(size)) - cost(at.at[i].add(-size))) / (2 * size)
        assert float(slope[i]) == pytest.approx(float(difference), rel=1e-6)
        assert float(slope[i]) != 0.0
    _, along = jax.jvp(cost, (at,), (jnp.array([1.0, 1.0]),))
    assert float(along) == pytest.approx(float(slope.sum()), rel=1e-9)


@pytest.mark.slow
def test_gains_side_by_side_with_dry_friction():
    gains = jnp.array([0.5e5, 1.5e5, 2.5e5])
    cost = lambda gain: tracking(gain, machine=JOINT)  # noqa: E731
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(cost)))(gains)
    np.testing.assert_allclose(values, [float(cost(gain)) for gain in gains], rtol=1e-9)
    assert bool(jnp.isfinite(slopes).all()) and bool((slopes != 0).all())


def test_is_compiled_once_for_all_gains(monkeypatch):
    traces = []

    class Counting(Played):
        factor: jax.Array

        def update(self, state, wanted, readings, step):
            traces.append(1)
            return state, self.factor * wanted

    for factor in (1.0, 1.01, 0.99):
        closed_loop(JOINT, Counting(jnp.asarray(factor)), waves(20), clock(20), start=REST)
    first = len(traces)
    closed_loop(JOINT, Counting(jnp.asarray(1.1)), waves(20), clock(20), start=REST)
    assert len(traces) == first and first <= 2  # a scan may look at its body twice


def test_proportional_force_feedback_holds_a_force():
    # At 0.1 A per volt; a proportional controller leaves an error.
    machine = bench.model("jet-pipe")
    wanted = np.full(500, 45.0)
    found = closed_loop(machine, feedback_on(machine, built(ProportionalForce)), wanted, clock(500))
    force = np.asarray(found.readings["force"])
    np.testing.assert_allclose(0.1 * found.commands, np.clip(0.044 * (45 - force), -0.4, 0.4), rtol=1e-9)
    assert 35 < force[-1] < 45


def test_pid_on_the_elbow_arrives():
    machine = bench.model("elbow")
    pid = built(IntegralInversePID, None, 2e5, 0.1, 0.0)
    start = {"pressure": np.asarray(bench.AMBIENT + 1e5)}
    found = closed_loop(
        machine, feedback_on(machine, pid), np.full(700, 0.9), clock(700), begin=pid.start(1e5), start=start
    )
    assert float(found.readings["angle"][-1]) == pytest.approx(0.9, abs=2e-3)


def test_commands_stay_within_what_the_converters_give():
    strong = built(FuzzyPID, 0.01, 5.0, 9e5, 0.0, 9e5)
    found = closed_loop(JOINT, feedback_on(JOINT, strong), np.full(50, 1.0), clock(50), start=REST)
    assert float(found.commands.min()) == bench.AMBIENT
    assert float(found.commands.max()) == bench.AMBIENT + 2 * MEAN_PRESSURE


def test_wrong_questions_are_told():
    with pytest.raises(InputError, match="one row for each of 20 instants"):
        closed_loop(JOINT, Played(), waves(19), clock(20), start=REST)
    with pytest.raises(InputError, match="has no command"):
        closed_loop(bench.model("driven"), Played(), waves(20), clock(20))
    with pytest.raises(InputError, match=r"command of shape \(2,\)"):
        closed_loop(JOINT, Played(), np.zeros(20), clock(20), start=REST)
    with pytest.raises(InputError, match="control.Attached"):
        feedback_on(bench.unsteered(), FUZZY)
    assert control.closed_loop is loop_module.closed_loop


def test_a_list_of_rows_is_an_array():
    played = closed_loop(JOINT, Played(), waves(20).tolist(), clock(20), start=REST)
    np.testing.assert_array_equal(played.commands, waves(20))
