"""Controllers on the channel that a rig declares: a user's own rig under PID, and what is told."""

from typing import ClassVar

import jax
import numpy as np
import pytest
from actuators.fan import STEP, TRUE, Fan, fan
from oracles import bench
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.actuators import Actuation, ControlChannel
from jaxmuscle.control import FuzzyPID, IntegralInversePID, closed_loop, feedback_on
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace
from jaxmuscle.robot.tondu2000 import robot_joint

GAIN, INTEGRAL_TIME, IDLE = 0.1, 0.2, 1.0
TARGET = np.concatenate([np.full(100, 150.0), np.full(100, 210.0), np.full(100, 120.0)])
TIMES = STEP * np.arange(len(TARGET))
PID = built(IntegralInversePID, None, GAIN, INTEGRAL_TIME, 0.0)


def by_hand():
    """Speeds and voltages of the fan under a limited PI controller, in NumPy with fine Euler steps."""
    speed, integral, rows = 0.0, 0.0, []
    for wanted in TARGET:
        error = wanted - speed
        grown = integral + STEP * error
        asked = GAIN * (error + grown / INTEGRAL_TIME)
        outside = (asked > 12.0 - IDLE and grown > integral) or (asked < -IDLE and grown < integral)
        integral = integral if outside else grown
        volts = min(max(IDLE + asked, 0.0), 12.0)
        rows.append((speed, volts))
        for _ in range(400):
            torque = TRUE["torque_constant"] * volts - TRUE["drag"] * speed * abs(speed)
            speed += STEP / 400 * torque / TRUE["inertia"]
    return np.array(rows).T


def test_pid_on_a_rig_of_ones_own():
    blown = fan()
    found = closed_loop(blown, feedback_on(blown, PID), TARGET, TIMES, start={"speed": 0.0}, substeps=8)
    speed, volts = by_hand()
    np.testing.assert_allclose(found.readings["speed"], speed, atol=0.3)
    np.testing.assert_allclose(found.commands, volts, atol=0.05)
    assert (float(found.commands.min()), float(found.commands.max())) == (0.0, 12.0)
    assert abs(float(found.readings["speed"][199]) - 210.0) < 5.0


def test_a_rest_that_is_a_parameter_has_its_slope():
    def first(volts):
        blown = fan(idle_voltage=volts)
        return closed_loop(blown, feedback_on(blown, PID), np.full(3, 20.0), TIMES[:3]).commands[0]

    slope = jax.grad(first)(2.0)
    assert float(slope) == pytest.approx(float(first(2.5) - first(1.5)), rel=1e-9) == 1.0


def test_controllers_with_other_units_are_told():
    with pytest.raises(
        InputError, match="an angle into a pressure: expected rig joint or elbow.*rad/s into V"
    ):
        feedback_on(fan(), built(FuzzyPID, 0.5, 5.0, 1.5e5, 3e5))


def test_settings_are_those_of_the_rig():
    joint = robot_joint(0.64)
    with pytest.raises(
        InputError, match="'joint' has no setting 'mean_presure'; did you mean 'mean_pressure'"
    ):
        feedback_on(joint, PID, mean_presure=1e5)
    with pytest.raises(InputError, match="'elbow' has no setting 'mean_pressure'"):
        feedback_on(bench.model("elbow"), PID, mean_pressure=1e5)
    with pytest.raises(InputError, match="'unsteered' declares no control channel"):
        bench.unsteered().actuation()


def test_a_lift_is_steered_by_its_valve_both_ways():
    lift = bench.model("isotonic")
    rest, direction, lowest, highest = lift.actuation()
    assert (float(rest), float(direction)) == (0.0, 1.0)
    assert float(highest) == float(lift.valve.full_command) == -float(lowest) > 0
    slope = jax.grad(lambda full: replace(lift, {"valve.full_command": full}).actuation().lowest)(5.0)
    assert float(slope) == -1.0


def test_a_lift_follows_a_reference():
    """To 30 mm within 0.3 mm; down to 15 mm it is slower, as little pressure is left to drive the air."""
    lift, times = bench.model("isotonic", load_damping={"coefficient": 300.0}), np.arange(0, 6, 2e-3)
    wanted = np.where(times < 3, 0.03, 0.015)
    loop = feedback_on(lift, built(jm.control.PID, 20.0, 0.0, 0.0))
    done = closed_loop(lift, loop, wanted, times)
    position = np.asarray(done.readings["position"])
    assert np.abs(position - wanted)[(times > 2) & (times < 3)].max() < 3e-4
    assert np.abs(position - wanted)[times > 5].max() < 5e-3


def test_a_parameter_that_a_rig_has_not_is_told():
    lift = bench.model("isotonic")
    with pytest.raises(InputError, match="expected a number or the path of a parameter; got '-valv.area'"):
        ControlChannel("position", lowest="-valv.area").checked(
            "isotonic", lift.units, lift.outputs, 1, {"valve"}
        )


def test_what_a_joint_does_with_an_output():
    joint = robot_joint(0.64)
    rest, direction, lowest, highest = joint.actuation(mean_pressure=2e5)
    ambient = float(joint.ambient_pressure)
    np.testing.assert_array_equal(direction, [1.0, -1.0])
    for entries, gauge in ((rest, 2e5), (lowest, 0.0), (highest, 4e5)):
        np.testing.assert_array_equal(entries, [ambient + gauge] * 2)


def test_entries_for_each_command():
    channel = ControlChannel("angle", rest=("ambient_pressure", 2e5), direction=(1.0, -1.0))
    joint = robot_joint(0.64)
    found = channel.actuation(joint, 2)
    assert isinstance(found, Actuation)
    np.testing.assert_array_equal(found.rest, [float(joint.ambient_pressure), 2e5])
    np.testing.assert_array_equal(found.highest, [np.inf, np.inf])


@pytest.mark.parametrize(
    ("channel", "told"),
    [
        (ControlChannel("sped"), "channel: expected one of the readings speed, temperature.*got 'sped'"),
        (ControlChannel("speed", "volts"), "channel: expected an SI unit.*got 'volts'"),
        (ControlChannel("speed", rest="idle"), "expected a number or the path of a parameter; got 'idle'"),
        (ControlChannel("speed", direction=(1.0, -1.0)), "expected one entry, or 1"),
    ],
)
def test_a_channel_that_cannot_be_is_told_when_the_class_is_made(channel, told):
    with pytest.raises(InputError, match=told):
        type("Wrong", (Fan,), {"channel": channel, "__annotations__": {"channel": ClassVar}})
