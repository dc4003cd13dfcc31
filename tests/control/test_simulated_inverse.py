"""The inverse of a model by a controller that runs it: what it gives, and what it is worth ahead of a PID."""

import numpy as np
import pytest
from actuators.fan import fan
from oracles import bench
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.control import PID, FeedForward, ProportionalForce, closed_loop, feedback_on, simulated_inverse
from jaxmuscle.errors import InputError

STEP = 0.01
TIMES = STEP * np.arange(60)
WANTED = 150 + 20 * np.sin(5 * TIMES)
START = {"speed": 150.0}
TIGHT, LOOSE = built(PID, 0.3, 3.0), built(PID, 0.02, 0.02)


def run(machine, controller):
    return closed_loop(machine, feedback_on(machine, controller), WANTED, TIMES, start=START)


def left(machine, controller):
    return float(np.sqrt(np.mean((np.asarray(run(machine, controller).readings["speed"]) - WANTED) ** 2)))


def test_what_it_gives_is_what_a_controller_gives_on_the_model():
    blown = fan()
    inverse = simulated_inverse(blown, STEP, TIGHT, start=START)
    ahead = run(blown, built(FeedForward, inverse))
    np.testing.assert_allclose(ahead.commands, run(blown, TIGHT).commands, rtol=1e-12)


def test_a_loose_feedback_follows_as_closely_as_the_one_on_the_model():
    inverse = simulated_inverse(fan(), STEP, TIGHT, start=START)
    both = built(FeedForward, inverse, LOOSE)
    assert left(fan(), both) == pytest.approx(left(fan(), TIGHT), rel=0.05)
    assert left(fan(), both) < 0.2 * left(fan(), LOOSE)
    # On a fan with a third more drag less of it is true; the feedback takes the rest.
    other = fan(drag=1.07e-6)
    assert left(fan(), both) < left(other, both) < 0.3 * left(other, LOOSE)


def test_gains_of_inverse_and_feedback_are_tuned():
    both = built(FeedForward, simulated_inverse(fan(), STEP, TIGHT, start=START), LOOSE)
    names = [f"{part}.{name}" for part in ("inverse.controller", "feedback") for name in PID.gains]
    assert both.gains == ("share", *names)


@pytest.mark.slow
def test_a_machine_that_integrates_its_command_has_such_an_inverse():
    lift, times = bench.model("isotonic", load_damping={"coefficient": 300.0}), 2e-3 * np.arange(1500)
    wanted = 0.01 * (1 - np.cos(np.pi * np.minimum(times, 1.0))) + 0.004 * np.sin(4 * times) * (times > 1)
    tight, loose = built(PID, 60.0), built(PID, 10.0)
    both = built(FeedForward, simulated_inverse(lift, 2e-3, tight), loose)
    errors = []
    for controller in (loose, both):
        found = closed_loop(lift, feedback_on(lift, controller), wanted, times)
        errors.append(np.sqrt(np.mean((np.asarray(found.readings["position"]) - wanted)[500:] ** 2)))
    assert errors[1] < 0.7 * errors[0]


WRONG = {
    "no controller": (lambda: simulated_inverse(fan(), STEP, 3.0), "methods start and update; got float"),
    "of another rig": (
        lambda: simulated_inverse(bench.model("joint"), STEP, built(ProportionalForce, 0.01)),
        "ProportionalForce turns a force into a current",
    ),
    "no channel": (lambda: simulated_inverse(jm.robot.robot(), STEP, TIGHT), "declares no control channel"),
    "no step": (lambda: simulated_inverse(fan(), 0.0, TIGHT), "time_step: expected a time above zero"),
}


@pytest.mark.parametrize("why", WRONG)
def test_wrong_input_is_told(why):
    ask, told = WRONG[why]
    with pytest.raises(InputError, match=told):
        ask()
