"""What closed loops take, and what they tell the user instead of running on."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

from jaxmuscle.control import (
    Attached,
    FuzzyPID,
    IntegralInversePID,
    JointModel,
    ProportionalForce,
    Reference,
    SlidingMode,
    closed_loop,
    feedback_on,
)
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace
from jaxmuscle.robot.tondu2000 import MEAN_PRESSURE, robot_joint

STEP = 2e-3
TIMES = np.arange(20) * STEP
REST = {"pressure": np.full(2, bench.AMBIENT + MEAN_PRESSURE)}
JOINT = robot_joint(0.64)
FUZZY = built(FuzzyPID, 0.5, 5.0, 1.5e5, 3e5)
SLIDING = built(SlidingMode, built(JointModel, 6.0, 60.0, 5e-4), 8.0)


def run_on_joint(reference, controller: eqx.Module = FUZZY, **how):
    loop = controller if isinstance(controller, Attached) else feedback_on(JOINT, controller)
    return closed_loop(JOINT, loop, reference, TIMES, start=REST, **how)


@pytest.mark.parametrize("kind", [list, tuple])
def test_a_list_of_numbers_is_an_array(kind):
    target = 0.3 * np.sin(5 * TIMES)
    found, same = run_on_joint(kind(target.tolist())), run_on_joint(target)
    np.testing.assert_array_equal(found.commands, same.commands)


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ([0.1] * 19, r"one row for each of 20 instants; got {\(19,\)}"),
        ([[0.1], [0.1, 0.2]], "expected a reference of numbers"),
        ("up", "expected a reference of numbers"),
        (np.where(np.arange(20) == 7, np.nan, 0.1), "finite numbers; got nan in row 7"),
        (Reference(jnp.zeros(20), jnp.full(20, jnp.inf), jnp.zeros(20)), "finite numbers; got inf in row 0"),
    ],
)
def test_wrong_references_are_told(reference, message):
    with pytest.raises(InputError, match=message):
        run_on_joint(reference)


def test_a_traced_reference_is_not_looked_at():
    last = jax.jit(lambda target: run_on_joint(target).commands[-1])
    assert bool(jnp.isfinite(last(jnp.full(20, 0.1))).all())
    assert bool(jnp.isnan(last(jnp.full(20, jnp.nan))).any())


def test_the_variable_structure_asks_for_a_reference_with_rates():
    with pytest.raises(InputError, match="expected a control.Reference .* got an array"):
        run_on_joint(np.zeros(20), SLIDING)
    still = Reference(*jnp.zeros((3, 20)))
    assert bool(jnp.isfinite(run_on_joint(still, SLIDING).commands).all())


def test_a_controller_of_another_rig_is_told():
    with pytest.raises(InputError, match="expected rig jet-pipe or jet-pipe-piston; got 'elbow'"):
        feedback_on(bench.model("elbow"), built(ProportionalForce))
    with pytest.raises(InputError, match="expected rig jet-pipe or jet-pipe-piston; got 'joint'"):
        feedback_on(JOINT, built(ProportionalForce))
    for controller in (FUZZY, SLIDING):
        with pytest.raises(InputError, match="expected rig joint or elbow; got 'jet-pipe'"):
            feedback_on(bench.model("jet-pipe"), controller)
    elsewhere = built(Attached, FUZZY, "force", [3e5, 3e5], [1.0, -1.0], 1e5, 6e5)
    with pytest.raises(InputError, match="readings pressure, angle; got 'force'"):
        run_on_joint(np.zeros(20), elsewhere)


@pytest.mark.parametrize(
    "begin", [0.5, FUZZY, SLIDING.start(0.1), jax.tree.map(jnp.atleast_1d, FUZZY.start())]
)
def test_a_begin_that_is_no_state_is_told(begin):
    with pytest.raises(InputError, match=r"begin to be a state of Attached, as its start\(\) gives"):
        run_on_joint(np.zeros(20), begin=begin)


def test_plain_numbers_of_an_attached_controller_are_arrays(monkeypatch):
    traces = []
    update = FuzzyPID.update
    monkeypatch.setattr(FuzzyPID, "update", lambda *all: traces.append(1) or update(*all))
    for rest in (3.0e5, 3.1e5, 3.2e5):
        loop = built(Attached, FUZZY, "angle", (rest, rest), (1, -1), 1e5, 6e5)
        found = run_on_joint(np.full(20, 0.1), loop)
        np.testing.assert_allclose(found.commands.sum(axis=1), 2 * rest, rtol=1e-12)
    assert 0 < len(traces) <= 2  # a scan may look at its body twice


def test_a_begin_at_the_first_error_takes_the_kick_away():
    # From rest at 0 towards 0.1 rad, constant: without a rate of the error there is none of the command.
    slow = replace(FUZZY, {"integral": 0.0, "smoothing": 0.0, "error_range": 3.0})
    loop, target = feedback_on(JOINT, slow), np.full(20, 0.1)
    kicked, calm = (
        run_on_joint(target, slow, begin=begin).commands[:, 0] for begin in (None, loop.start(0.1))
    )
    middle = bench.AMBIENT + MEAN_PRESSURE
    assert float(calm[0] - middle) == pytest.approx(1.5e5 * 0.1 / 3.0, rel=1e-9)
    assert float(kicked[0] - middle) == pytest.approx(1.5e5, rel=1e-9)  # a rate of 50 rad/s, beyond its range
    # The plain PID, as its docstring says.
    pid = built(IntegralInversePID, None, 2.0, 1e9, 0.3)
    _, command = pid.update(pid.start(), jnp.asarray(0.1), jnp.asarray(0.0), STEP)
    assert float(command) == pytest.approx(2.0 * 0.1 + 2.0 * 0.3 * 0.1 / STEP, rel=1e-6)


def test_rates_for_a_controller_of_one_number_are_told():
    with pytest.raises(InputError, match="FuzzyPID: expected a reference of one array; got"):
        run_on_joint(Reference(*jnp.zeros((3, 20))))
