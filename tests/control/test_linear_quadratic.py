"""Linear-quadratic controllers: gains by the Riccati recursion, stability, no error at rest, what is told."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import STEP, fan
from oracles import bench
from scipy.integrate import solve_ivp

import jaxmuscle as jm
from jaxmuscle.control import LinearQuadratic, closed_loop, feedback_on, linear_quadratic
from jaxmuscle.errors import InputError

TIMES = STEP * np.arange(300)
UPDATE = eqx.filter_jit(LinearQuadratic.update)
SIZES: dict[str, Any] = {"error": 2.0, "effort": 0.5, "noise": 0.1}
IDLE = {"speed": 111.8, "temperature": 293.15}
"""Near where the fan comes to rest by itself at 1 V."""


@pytest.fixture(scope="module")
def designed():
    return linear_quadratic(fan(), STEP, **SIZES, integral_time=0.2)


def test_the_model_from_sample_to_sample_is_that_of_the_fan(designed):
    # J ω' = k u - d ω² about ω0 = √(k u0/d), by an integrator of its own, per volt and per rad/s.
    inertia, torque, drag = 2e-4, 0.01, 8e-7
    rest = np.sqrt(torque * 1.0 / drag)
    after = [
        solve_ivp(
            lambda _, w, u=u: (torque * u - drag * w * abs(w)) / inertia, (0, STEP), [rest + d], rtol=1e-10
        ).y[0, -1]
        for u, d in ((1.0, 1e-3), (1.001, 0.0))
    ]
    place = int(np.argmax(np.asarray(designed.c)))
    assert float(designed.rest) == pytest.approx(rest, rel=1e-6)
    assert float(designed.a[place, place]) == pytest.approx((after[0] - rest) / 1e-3, rel=1e-5)
    assert float(designed.b[place]) == pytest.approx((after[1] - rest) / 1e-3, rel=1e-4)


def test_gains_are_those_of_the_riccati_recursion(designed):
    a, b, c = (np.asarray(x) for x in (designed.a, designed.b, designed.c))
    size = len(a)
    whole = np.block([[a, np.zeros((size, 1))], [STEP * c[None], np.ones((1, 1))]])
    push, cost = np.append(b, 0.0), np.diag(np.append(c, 0.0)) / 2.0**2
    cost[-1, -1] = 1 / (2.0 * 0.2) ** 2
    left, gains = np.eye(size + 1), push
    for _ in range(20_000):
        gains = push @ left @ whole / (push @ left @ push + 0.5**-2)
        left = cost + whole.T @ left @ (whole - np.outer(push, gains))
    np.testing.assert_allclose(np.append(designed.feedback, designed.integral), gains, rtol=1e-6, atol=1e-12)
    spread = np.eye(size)
    for _ in range(20_000):
        kept = spread - np.outer(spread @ c, c @ spread) / (c @ spread @ c + 0.1**2)
        spread = a @ kept @ a.T + 0.25 * np.outer(b, b)
    np.testing.assert_allclose(designed.observer, spread @ c / (c @ spread @ c + 0.01), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("drag", [8e-7, 6e-7])
def test_it_leaves_no_error_on_a_machine_that_is_not_its_model(designed, drag):
    blown, wanted = fan(drag=drag), np.where(TIMES < 0.5, 111.8, 125.0)
    found = closed_loop(blown, feedback_on(blown, designed), wanted, TIMES, start=IDLE)
    speed = np.asarray(found.readings["speed"])
    assert abs(speed[-1] - 125.0) < 0.05 and speed.max() < 132.0
    assert abs(speed[70] - 125.0) < 6.0


def test_without_an_integral_the_reference_is_met_on_the_model():
    controller = linear_quadratic(fan(), STEP, **SIZES)
    assert float(controller.integral) == 0.0
    wanted = np.full(300, 114.0)
    speed = closed_loop(fan(), feedback_on(fan(), controller), wanted, TIMES, start=IDLE).readings["speed"]
    assert float(speed[-1]) == pytest.approx(114.0, abs=0.05)


def test_a_ramp_is_followed_without_a_lag_and_the_first_sample_is_no_kick():
    lagging = linear_quadratic(fan(), STEP, **SIZES)
    following = linear_quadratic(fan(), STEP, **SIZES, ramps=True)
    a, b, c = (np.asarray(x) for x in (lagging.a, lagging.b, lagging.c))
    wanted = float(lagging.rest) + 0.4 * STEP * np.arange(150)
    left = {}
    for name, controller in (("lagging", lagging), ("following", following)):
        state, machine = controller.start(), np.zeros_like(b)
        errors, outputs = [], []
        for target in wanted:
            reading = controller.rest + c @ machine
            state, output = UPDATE(controller, state, jnp.asarray(target), reading, jnp.asarray(STEP))
            errors.append(target - float(reading))
            outputs.append(float(output))
            machine = a @ machine + b * outputs[-1]
        left[name] = errors[-1]
        assert outputs[0] == pytest.approx(0.0, abs=1e-9)
    assert left["lagging"] > 1e-3
    assert abs(left["following"]) < 1e-6 * left["lagging"]


def test_behind_a_limit_nothing_winds_up(designed):
    out_of_reach = np.where(TIMES < 2.0, 600.0, 150.0)
    found = closed_loop(fan(), feedback_on(fan(), designed), out_of_reach, TIMES, start=IDLE)
    volts, turned = np.asarray(found.commands), 200
    assert (volts[20:turned] == 12.0).all() and volts[turned + 1] < 12.0
    assert float(designed.start().integral) == 0.0 and bool(jnp.isfinite(found.readings["speed"]).all())


@pytest.mark.slow
def test_it_is_tuned_like_any_other(designed):
    practice = jm.tuning.grid(np.where(TIMES < 0.5, 111.8, 125.0), TIMES, {"drag": [6e-7, 8e-7]}, start=IDLE)
    tuned = jm.tune(fan(), designed, practice, {"tracking": 1.0, "variation": 20.0}, starts=1)
    assert tuned.after.cost < 0.95 * tuned.before.cost and "feedback[0]" in tuned.gains


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ({"error": 0.0}, "error: expected a number above zero"),
        ({"integral_time": -1.0}, "integral_time: expected a number above zero"),
        ({"noise": np.nan}, "noise: expected a number above zero"),
    ],
)
def test_wrong_sizes_are_told(how, told):
    with pytest.raises(InputError, match=told):
        linear_quadratic(fan(), STEP, **{**SIZES, **how})


def test_a_rig_without_a_channel_is_told():
    with pytest.raises(InputError, match="declares no control channel"):
        linear_quadratic(bench.unsteered(), STEP, **SIZES)
