"""The variable-structure controller of [T] on the joint that it was made for, and on one that differs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

from jaxmuscle.control import JointModel, Reference, SlidingMode, joint_model, model_inverse
from jaxmuscle.effects import Gravity
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.robot.tondu2000 import robot_joint

STEP, SLOPE = 2e-3, 8.0
JOINT = built(JointModel, 6.0, 60.0, 5e-4)
EQUIVALENT = built(SlidingMode, JOINT, SLOPE)
SWITCHING = built(SlidingMode, JOINT, SLOPE, 0.02, 4e4, 4e3, 3e3, 1e5)


def sine(t):
    return Reference(jnp.sin(t), jnp.cos(t), -jnp.sin(t))


def followed(controller, joint, wanted, load=0.0, seconds=6.0, start=0.0):
    """Errors at the samples: the joint solved exactly between them under a held command."""
    a = jnp.array([[0.0, 1.0], [-joint.stiffness, -joint.damping]])
    whole = jax.scipy.linalg.expm(STEP * jnp.block([[a, jnp.eye(2)], [jnp.zeros((2, 4))]]))
    across, driven = whole[:2, :2], whole[:2, 2:]

    def sample(carry, t):
        state, x = carry
        state, command = controller.update(state, wanted(t), x[0], STEP)
        pushed = jnp.array([0.0, 1.0]) * (joint.gain * command + load)
        return (state, across @ x + driven @ pushed), state.error

    begin = jnp.array([start, 1.0]) if start == 0 else jnp.array([start, 0.0])
    return np.asarray(
        jax.lax.scan(sample, (controller.start(), begin), STEP * jnp.arange(int(seconds / STEP)))[1]
    )


def test_equation_29_keeps_the_error_on_its_line():
    # On the identified joint, e = θ_d - θ obeys ë + C ė = 0, whatever the motion.
    rng = np.random.default_rng(0)
    angle, velocity, *wanted = rng.normal(size=5)
    wanted = Reference(*map(jnp.asarray, wanted))
    error, rate = wanted.angle - angle, wanted.velocity - velocity
    command = EQUIVALENT.equivalent(wanted, error, rate)
    acceleration = JOINT.gain * command - JOINT.damping * velocity - JOINT.stiffness * angle
    np.testing.assert_allclose(wanted.acceleration - acceleration, -SLOPE * rate, rtol=1e-12)


def test_switching_is_that_of_harashima_on_the_line_of_equation_26():
    controller = built(SlidingMode, JOINT, SLOPE, 0.02, 4e4, 4e3, 3e3)
    error, rate, second = 0.003, -0.02, 0.4
    line = rate + SLOPE * error + 0.02 * second
    assert 0 < line < 0.1
    expected = (4e4 * error + 4e3 * abs(rate) + 3e3) * line / 0.1
    found = controller.switching(*map(jnp.asarray, (error, rate, second)))
    assert float(found) == pytest.approx(expected, rel=1e-12)
    opposite = controller.switching(*map(jnp.asarray, (-error, -rate, -second)))
    assert float(opposite) == pytest.approx(-expected, rel=1e-12)


def test_follows_a_sine_on_the_joint_that_was_identified():
    errors = followed(EQUIVALENT, JOINT, sine)
    assert np.abs(errors[1500:]).max() < np.deg2rad(0.5)


def test_switching_bears_a_load_that_was_not_identified():
    # [T] adds 50 % of inertia per half kilogram: all coefficients fall; a constant load pulls.
    heavier = built(JointModel, *(v / 1.5 for v in (6.0, 60.0, 5e-4)))
    plain, switched = (followed(c, heavier, sine, load=-3.0) for c in (EQUIVALENT, SWITCHING))
    late = slice(1500, None)
    assert np.abs(switched[late]).max() < 0.25 * np.abs(plain[late]).max()


def test_integrator_takes_away_what_stays():
    still = lambda t: Reference(jnp.asarray(0.5), jnp.zeros(()), jnp.zeros(()))  # noqa: E731
    errors = followed(SWITCHING, JOINT, still, load=-5.0, seconds=12.0, start=0.45)
    without = followed(
        replace(SWITCHING, {"integral_gain": 0.0}), JOINT, still, load=-5.0, seconds=12.0, start=0.45
    )
    assert abs(errors[-1]) < 1e-3 < abs(without[-1])


def test_limits():
    far = SWITCHING.switching(jnp.asarray(100.0), jnp.zeros(()), jnp.zeros(()))
    assert float(far) == pytest.approx(1e5)
    state = SWITCHING.start()
    for _ in range(3):
        state, _ = SWITCHING.update(state, sine(0.0), jnp.asarray(-0.1), 100.0)
    assert float(state.integral) == pytest.approx(0.8e5)
    state, _ = SWITCHING.update(state, sine(0.0), jnp.asarray(-0.2), 1e-3)
    assert float(state.integral) == pytest.approx(0.8e5)  # beyond 10° it stands still


def test_gradient_over_every_number_equals_finite_differences():
    paths = [
        path for path in parameters(SWITCHING) if path not in ("limit", "integral_limit", "integral_band")
    ]

    def cost(values):
        errors = followed_traced(replace(SWITCHING, dict(zip(paths, values, strict=True))))
        return 1e6 * jnp.sum(errors**2)

    def followed_traced(controller):
        def sample(carry, t):
            state, x = carry
            state, command = controller.update(state, sine(t), x[0], STEP)
            rate = 4e-4 * command - 50.0 * x[0] - 5.0 * x[1] - 2.0
            return (state, x + STEP * jnp.array([x[1], rate])), state.error

        begin = (controller.start(), jnp.array([0.02, 1.0]))
        return jax.lax.scan(sample, begin, STEP * jnp.arange(300))[1]

    values = jnp.array([float(parameters(SWITCHING)[path].value) for path in paths])
    slope = jax.jit(jax.grad(cost))(values)
    cost = jax.jit(cost)
    for i, value in enumerate(values):
        size = 1e-4 * value
        difference = (cost(values.at[i].add(size)) - cost(values.at[i].add(-size))) / (2 * size)
        np.testing.assert_allclose(
            slope[i], difference, rtol=1e-4, atol=1e-6 * float(jnp.abs(slope[i]) + 1e-3)
        )


@pytest.mark.slow
def test_the_joint_of_a_linearised_machine():
    joint, mean = robot_joint(0.64), 2.5e5

    def force(pressure):
        middle = joint.initial_contraction * joint.muscle.initial_length
        return float(joint.muscle.force(middle, pressure, joint.muscle.end_factor))

    found = joint_model(joint, mean_pressure=mean)
    per_pressure = 2 * float(joint.sprocket_radius) * (force(mean + 1) - force(mean)) / 0.64
    assert float(found.gain) == pytest.approx(per_pressure, rel=1e-6)
    # Dry friction is left out, and the joint has no other damping.
    assert float(found.damping) == pytest.approx(0.0, abs=1e-9)
    table = model_inverse(joint, (-2e3, 2e3), points=5, mean_pressure=mean)
    slope = float((table.readings[3] - table.readings[1]) / (table.outputs[3] - table.outputs[1]))
    assert float(found.gain / found.stiffness) == pytest.approx(slope, rel=1e-3)


def test_a_joint_that_falls_over_is_told():
    upright = robot_joint(0.64).with_effects(gravity=built(Gravity, -20.0))
    with pytest.raises(InputError, match="its stiffness is -28"):
        joint_model(upright)


@pytest.mark.slow
def test_a_rig_without_an_angle_is_told():
    with pytest.raises(InputError, match="expected a rig with the states angle and angular_velocity"):
        joint_model(bench.model("jet-pipe"))
