"""Controllers of a robot's joints side by side, and a tip that follows a line."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.control import PID, FuzzyPID, ProportionalForce, Reference, closed_loop, independent_joints
from jaxmuscle.errors import InputError
from jaxmuscle.robot import Pane, joints_along, line, pressure_commands, robot, robot_joint, tip
from jaxmuscle.tuning.gains import gain_unit, gains_of
from jaxmuscle.tuning.tip_error import tip_error
from jaxmuscle.tuning.tune import prepared

ROBOT, STEP = robot(), 4e-3
PAIR = [built(PID, 1e6, 2e6, 1e5), built(PID, 3e5, 5e5, 2e4)]
LOOP = independent_joints(ROBOT, PAIR)
P0 = bench.AMBIENT + 2.5e5


def test_each_joint_has_its_own_pair_of_muscles():
    wanted, seen = jnp.array([0.1, -0.2]), {"angle": jnp.array([0.05, 0.1])}
    state, commands = LOOP.update(LOOP.start(), wanted, seen, jnp.asarray(STEP))
    outputs = []
    for controller, here, there in zip(PAIR, wanted, seen["angle"], strict=True):
        outputs.append(float(controller.update(controller.start(), here, there, STEP)[1]))
    first, second = np.clip(outputs, -2.5e5, 2.5e5)
    np.testing.assert_allclose(commands, [P0 + first, P0 - first, P0 + second, P0 - second], rtol=1e-12)
    # Both outputs are beyond their limits, so neither error is integrated further.
    assert abs(outputs[0]) > 2.5e5 and abs(outputs[1]) > 2.5e5
    assert [float(own.integral) for own in state] == [0.0, 0.0]


def test_a_reference_with_rates_goes_to_those_who_follow_them():
    values = jnp.array([0.01, 0.0]), jnp.array([1.0, 2.0]), jnp.zeros(2)
    of_values, of_rates = (
        LOOP.update(LOOP.start(), wanted, {"angle": jnp.zeros(2)}, jnp.asarray(STEP))[1]
        for wanted in (values[0], Reference(*values))
    )
    np.testing.assert_array_equal(of_values, of_rates)


def test_gains_of_all_joints_have_names_units_and_signs():
    both = independent_joints(ROBOT, [PAIR[0], built(FuzzyPID, 0.3, 3.0, 1e5, 1e5)])
    entries = gains_of(both, None, None).unknowns.entries
    named = {entry.name: entry for entry in entries}
    assert list(named)[:4] == [*(f"joints[0].{name}" for name in PID.gains), "joints[1].error_range"]
    assert all(entry.place.positive for entry in entries)
    unit = gain_unit(ROBOT, named["joints[0].derivative"].place.unit, both)
    assert unit == "Pa s/rad"


@pytest.mark.thorough
def test_slopes_of_the_tips_error_go_through_contact_with_a_pane():
    leaning = dataclasses.replace(ROBOT, pane=built(Pane, stiffness=2e3, damping=1.0, distance=0.6))
    way = line([0.58, -0.05], [0.62, 0.05], 0.4, 2.0)
    times = 2e-3 * np.arange(200)
    joints = joints_along(ROBOT.arm, way.at(times), 1)
    start = {"angle": joints.position[0], "pressure": pressure_commands(ROBOT, joints)[0]}
    scenario = jm.tuning.Scenario(Reference(*joints), times, start=start)
    evaluation = prepared(leaning, LOOP, scenario, tip_error(ROBOT.arm, 2e-3, 3e6))
    values = evaluation.unknowns.start
    at = evaluation.unknowns.coordinates(values)
    runs = [evaluation.seen(values, evaluation.rows)]
    runs.append(prepared(ROBOT, LOOP, scenario, tip_error(ROBOT.arm, 2e-3, 3e6)).seen(values, (0,)))
    depth = [np.asarray(tip(ROBOT.arm, run.readings["angle"][0]))[:, 0].max() - 0.6 for run in runs]
    assert 1e-3 < depth[0] < 0.7 * depth[1]  # It leans on the pane, which holds it back.
    slopes, step = evaluation(at[None])[0].gradient, 1e-5
    rounding = 1e-5 * float(np.linalg.norm(slopes))
    for direction in np.random.default_rng(3).standard_normal((6, len(at))):
        ends = [evaluation(np.stack([at + side * step * direction]))[0].cost for side in (1, -1)]
        central = (ends[0] - ends[1]) / (2 * step)
        assert slopes @ direction == pytest.approx(central, rel=1e-4, abs=rounding)


@pytest.mark.thorough
def test_a_tip_follows_a_line_and_its_error_has_its_slopes():
    way = line([0.7, 0.3], [0.5, 0.4], 0.5, 2.0)
    times = np.arange(0, 0.4, STEP)
    joints = joints_along(ROBOT.arm, way.at(times), 1)
    start = {"angle": joints.position[0], "pressure": pressure_commands(ROBOT, joints)[0]}
    reference = Reference(*joints)
    scenarios = jm.tuning.grid(reference, times, {"payload": [0.0, 1.0]}, start=start)
    evaluation = prepared(ROBOT, LOOP, scenarios, tip_error(ROBOT.arm, 2e-3, 3e6))
    at = evaluation.unknowns.coordinates(evaluation.unknowns.start)
    found = evaluation(at[None])[0]
    run = closed_loop(ROBOT, LOOP, reference, times, start=start)
    off = np.asarray(tip(ROBOT.arm, run.readings["angle"]) - way.at(times).position)
    rate = np.diff(np.asarray(run.commands), axis=0) / STEP
    by_hand = (off**2).sum(1).mean() / 2e-3**2 + (rate**2).mean() / 3e6**2
    assert evaluation.seen(evaluation.unknowns.start, (0, 1)).cost[0] == pytest.approx(by_hand, rel=1e-9)
    direction = np.random.default_rng(0).standard_normal(len(at))
    up, down = evaluation(np.stack([at + 1e-5 * direction, at - 1e-5 * direction]))
    size = np.linalg.norm(found.gradient)
    assert found.gradient @ direction == pytest.approx((up.cost - down.cost) / 2e-5, abs=1e-5 * float(size))


WRONG = {
    "another rig": (lambda: independent_joints(robot_joint(0.6), PAIR), "expected rig 'scara'; got 'joint'"),  # pyright: ignore[reportArgumentType]
    "one controller": (lambda: independent_joints(ROBOT, PAIR[:1]), "expected 2 controllers.*got 1"),
    "no controller": (lambda: independent_joints(ROBOT, [*PAIR[:1], 3.0]), "start and update; got float"),
    "of a force": (
        lambda: independent_joints(ROBOT, [*PAIR[:1], built(ProportionalForce, 0.01)]),
        "controllers of an angle; got ProportionalForce",
    ),
    "setting": (lambda: independent_joints(ROBOT, PAIR, mean=1e5), "no setting 'mean'.*mean_pressure"),
    "reference": (
        lambda: closed_loop(ROBOT, LOOP, np.zeros(3), STEP * np.arange(3)),
        r"a reference with 2 values at each sample; got shape \(\)",
    ),
    "size": (lambda: tip_error(ROBOT.arm, 0.0), "error: expected a size above zero"),
}


@pytest.mark.parametrize("why", WRONG)
def test_wrong_input_is_told(why):
    ask, told = WRONG[why]
    with pytest.raises(InputError, match=told):
        ask()


def test_a_robot_without_its_joints_controllers_is_told_of_them():
    with pytest.raises(InputError, match="independent_joints"):
        jm.control.feedback_on(ROBOT, PAIR[0])
