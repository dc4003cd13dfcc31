"""Controllers refuse numbers of the wrong sign, and only those.

The PID of [W], and what a model inside it adds.

The PID of [W] whose gains depend on the range.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built
from oracles.loops import MODIFIED

from jaxmuscle import control
from jaxmuscle.control import IntegralInversePID, ScheduledPID
from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis import IntegralInverse

ONE, PAIR = jnp.ones(()), jnp.ones(2)
GOOD = {
    control.DigitalController: (built(control.PID, 2e5), 0.01),
    control.FeedForward: (built(control.ModelInverse, [0.0, 1.0], [0.0, 1.0]),),
    control.FuzzyPID: (0.3, 2.0, 1e5, 1e5),
    control.IntegralInversePID: (None, 0.1, 0.5, 0.0),
    control.PID: (2e5, 1e5, 1e4),
    control.ProportionalForce: (),
    control.ScheduledPID: (None, np.array([45.0]), *(np.ones(2),) * 3),
    control.JointModel: (6.0, 60.0, 5e-4),
    control.SlidingMode: (built(control.JointModel, 6.0, 60.0, 5e-4), 8.0),
}
ELSEWHERE = {control.StaticCurve, control.ModelInverse, control.CommandKnots, control.ModelPredictive}
"""Tables, and what is tested beside its own errors."""
FIELDS = [
    (kind, field.name, "positive" if field.metadata["positive"] else "nonnegative")
    for kind in GOOD
    for field in dataclasses.fields(kind)
    if field.metadata.get("positive") or field.metadata.get("nonnegative")
]


def with_one(kind, name, value):
    names = [field.name for field in dataclasses.fields(kind)]
    given = dict(zip(names, GOOD[kind], strict=False))
    return kind(**{**given, name: value})


def shaped(kind, name, value):
    return np.full(np.shape(getattr(built(kind, *GOOD[kind]), name)), value)


def test_every_controller_is_here():
    controllers = {
        thing for thing in vars(control).values() if inspectable(thing) and hasattr(thing, "__check_init__")
    }
    assert controllers - ELSEWHERE == set(GOOD)


def inspectable(thing):
    return isinstance(thing, type) and issubclass(thing, eqx.Module)


@pytest.mark.parametrize(("kind", "name", "sign"), FIELDS, ids=[f"{k.__name__}.{n}" for k, n, _ in FIELDS])
def test_wrong_signs_are_refused(kind, name, sign):
    with pytest.raises(InputError, match=rf"{kind.__name__}: expected {name} .* got"):
        with_one(kind, name, shaped(kind, name, -1.0))
    with pytest.raises(InputError, match=name):
        with_one(kind, name, shaped(kind, name, np.nan))
    if sign == "positive":
        with pytest.raises(InputError, match="above zero"):
            with_one(kind, name, shaped(kind, name, 0.0))
    else:
        with_one(kind, name, shaped(kind, name, 0.0))


def test_gains_and_limits_are_among_what_is_checked():
    checked = {(kind.__name__, name) for kind, name, _ in FIELDS}
    assert {("SlidingMode", "limit"), ("ProportionalForce", "gain"), ("IntegralInversePID", "proportional"),
            ("ScheduledPID", "proportional"), ("FuzzyPID", "limit")} <= checked  # fmt: skip


def test_traced_numbers_pass():
    bandwidth = jax.jit(lambda gain: control.ProportionalForce(gain).bandwidth(ONE, ONE))
    assert float(bandwidth(-0.5)) == 0.5


def controlled(controller, plant, reference, step):
    """Outputs of a plant of hysteresis alone; a command acts from one sample to the next."""

    def onward(carry, target):
        memory, command, state = carry
        memory = plant.update(memory, command)
        measured = plant.output(memory, command)
        state, command = controller.update(state, target, measured, step)
        return (memory, command, state), measured

    start = (plant.rest(), jnp.zeros(()), controller.start())
    return jax.lax.scan(onward, start, reference)[1]


def test_compensator_makes_a_pid_better():
    step = 0.01
    reference = 0.8 * jnp.sin(2 * jnp.pi * 0.5 * jnp.arange(600) * step)

    def error(model):
        ahead = None if model is None else built(IntegralInverse, model, 60.0)
        pid = built(IntegralInversePID, ahead, 0.1, 0.05, 0.0)
        return float(jnp.sqrt(jnp.mean((controlled(pid, MODIFIED, reference, step) - reference)[200:] ** 2)))

    assert error(MODIFIED) < 0.5 * error(None)


def test_pid_is_its_equation():
    pid = built(IntegralInversePID, None, 2.0, 0.5, 0.3)
    state, first = pid.update(pid.start(1.0), jnp.asarray(1.0), jnp.asarray(0.6), 0.1)
    assert float(first) == pytest.approx(1.0 + 2 * (0.4 + 0.1 * 0.4 / 0.5 + 0.3 * 0.4 / 0.1))
    _, second = pid.update(state, jnp.asarray(1.0), jnp.asarray(0.9), 0.1)
    assert float(second) == pytest.approx(1.0 + 2 * (0.1 + 0.1 * 0.5 / 0.5 + 0.3 * (0.1 - 0.4) / 0.1))


STEP = 0.05
TWO = built(
    ScheduledPID, None, np.array([45.0]), np.array([0.02, 0.05]), np.array([0.5, 0.8]), np.array([0.0, 0.1])
)
TARGETS = 15 + 37.5 * (np.sin(np.pi * np.arange(1000) * STEP / 25 + np.pi / 2) + 1)
"""[W]: y_d = 15 + 37.5 (sin(πt/25 + π/2) + 1), from 15 to 90 degrees."""


def commands(controller):
    def sample(state, at):
        return controller.update(state, at[0], at[1], STEP)

    measured = jnp.asarray(0.9 * TARGETS)
    return np.asarray(jax.lax.scan(sample, controller.start(), (jnp.asarray(TARGETS), measured))[1])


def test_one_range_is_the_pid():
    one = built(ScheduledPID, None, np.zeros(0), np.array([0.02]), np.array([0.5]), np.array([0.1]))
    np.testing.assert_array_equal(commands(one), commands(built(IntegralInversePID, None, 0.02, 0.5, 0.1)))


def test_gains_are_those_of_the_range():
    integral = STEP * np.cumsum(0.1 * TARGETS)
    rate = np.diff(0.1 * TARGETS, prepend=0.0) / STEP
    low, high = (
        k * (0.1 * TARGETS + integral / ti + td * rate) for k, ti, td in ((0.02, 0.5, 0), (0.05, 0.8, 0.1))
    )
    np.testing.assert_allclose(commands(TWO), np.where(TARGETS < 45, low, high), rtol=1e-9)


@pytest.mark.parametrize(
    ("edges", "gains", "said"), [([45.0], 3, "n - 1 edges"), ([45.0, 30.0], 3, "edges that increase")]
)
def test_refused(edges, gains, said):
    with pytest.raises(InputError, match=said):
        built(ScheduledPID, None, np.array(edges), *(np.ones(gains) for _ in range(3)))
