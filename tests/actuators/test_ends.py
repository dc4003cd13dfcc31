"""The joint ends where a muscle is at its full length; slack muscles and empty bladders do not push."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.joint import joint

from jaxmuscle import simulate
from jaxmuscle.actuators import Held
from jaxmuscle.actuators.isotonic import STANDARD_GRAVITY
from jaxmuscle.analysis import equilibrium, linearise
from jaxmuscle.components.antagonist import joint_range
from jaxmuscle.effects.slip import STICKING_TIME
from jaxmuscle.parameters import replace
from jaxmuscle.robot import robot_joint

MEAN = bench.AMBIENT + 2.5e5
EVEN = {"pressure": np.full(2, MEAN)}
SHORT = {**bench.CARDS["joint"], "initial_contraction": 0.07}
DAMPED = {"load_damping": {"coefficient": 0.1}}


def turned(actuator, difference, samples=800, **start):
    """Angles under pressures P0 ± `difference`, from rest at P0."""
    command = np.tile([MEAN + difference, MEAN - difference], (samples, 1))
    start = {"pressure": [MEAN, MEAN], **start}
    return np.asarray(simulate(actuator, command, np.arange(samples) * 2e-3, start=start).readings["angle"])


@pytest.mark.parametrize("difference", [2e5, 2.5e5, -8e5])
def test_joint_ends_where_a_muscle_is_at_its_full_length(difference):
    angle = turned(robot_joint(0.64), difference)
    largest = 0.1 * 0.31 / 0.015
    assert np.isfinite(angle).all() and np.abs(angle).max() <= largest * (1 + 1e-12)
    np.testing.assert_allclose(angle[-100:], np.sign(difference) * largest, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("contraction", [0.2, 0.3, 0.4, 0.45])
def test_a_joint_of_any_range_stays_finite(contraction):
    # The shortened muscle is past its zero force at 0.30, folded up beyond kε = 1 at 2ε0 = 0.8.
    def last(value):
        actuator = replace(robot_joint(0.64), {"initial_contraction": value})
        command = jnp.tile(MEAN + jnp.array([2.4e5, -2.4e5]), (900, 1))
        measured = {
            "pressure": command * 0 + MEAN,
            "angle": jnp.zeros(900),
            "angular_velocity": jnp.zeros(900),
        }
        track = bench.Track(jnp.asarray(2e-3), command, measured)
        return bench.simulate(actuator, track, 1).readings["angle"].sum()

    angle, slope = jax.jit(jax.value_and_grad(last))(contraction)
    assert np.isfinite(angle) and np.isfinite(slope)


@pytest.mark.slow
def test_joint_with_an_end_equals_the_oracle():
    command = bench.joint_command()
    *_, angle, velocity = joint(SHORT, DAMPED, command, bench.STEPS["joint"], command[0], 0.0, 40)
    end = 0.07 * 0.3 / 0.015
    assert (np.abs(angle) == end).sum() > 20 and (np.abs(angle) < end).sum() > 200
    assert (angle == end).any() and (angle == -end).any() and np.abs(velocity).max() > 5
    actuator = replace(bench.model("joint", **DAMPED), {"initial_contraction": 0.07})
    track = bench.joint_track(command)
    # An arrival is seen at the end of a step; what is left shrinks with it (and the oracle's, 40 a sample).
    coarse, fine = (
        bench.deviation(bench.simulated(actuator, track, n).readings["angle"], angle) for n in (1, 32)
    )
    assert fine < 1e-3 and coarse < 2e-2


def test_start_beyond_the_end_is_at_the_end():
    angle = turned(robot_joint(0.64), 2e5, 5, angle=5.0)
    assert np.isfinite(angle).all() and angle[0] == angle.max()
    np.testing.assert_allclose(angle[0], 0.1 * 0.31 / 0.015, rtol=1e-12)


SCENES = {
    "at the end": (2.2e5, 2.2e5, 2.0, 3.0),
    "just inside": (1.6e5, 1.6e5, 2.0, 0.0),
    "arriving": (1.8e5, 1.8e5, 1.5, 8.0),
    "leaving": (2.2e5, -1e5, 2.0, 1.0),
}
PATHS = ("muscle.initial_length", "sprocket_radius", "initial_contraction", "muscle.end_factor", "inertia")


def over_scenes():
    rows = np.array(list(SCENES.values()))
    gauge = np.stack([MEAN + rows[:, :2], MEAN - rows[:, :2]], axis=-1)
    command = np.repeat(gauge[:, :1], 60, axis=1)
    command[:, 15:] = gauge[:, 1:]
    measured = {"pressure": command, "angle": rows[:, 2:3] + np.zeros((4, 60))}
    measured["angular_velocity"] = rows[:, 3:] + np.zeros((4, 60))
    return bench.Track(*jax.tree.map(jnp.asarray, (np.full(4, 2e-3), command, measured)))


@pytest.mark.slow
def test_slopes_at_the_end_equal_finite_differences():
    actuator = robot_joint(0.2, friction=False)
    values = np.array([0.31, 0.015, 0.1, 1.25, 0.2])

    def angles(values, track):
        changed = replace(actuator, dict(zip(PATHS, values, strict=True)))
        return bench.simulate(changed, track, 1).readings["angle"]

    tracks = over_scenes()
    run = jax.jit(jax.vmap(angles, (None, 0)))
    slopes = jax.jit(jax.vmap(jax.jacfwd(angles), (None, 0)))(values, tracks)
    weights = np.random.default_rng(0).normal(size=60)
    back = jax.jit(jax.vmap(jax.grad(lambda v, t: weights @ angles(v, t)), (None, 0)))(values, tracks)
    found, end = run(values, tracks), float(joint_range(actuator.muscle, *map(jnp.asarray, (0.015, 0.1))))
    at = np.abs(np.asarray(found) - end) < 1e-12
    assert at[0, 20:].all() and not at[1].any() and at[2].any() and not at[2, :5].any()
    assert at[3].any() and not at[3, -1]
    for j, h in enumerate(1e-7 * values):
        step = np.eye(5)[j] * h
        difference = (run(values + step, tracks) - run(values - step, tracks)) / (2 * h)
        np.testing.assert_allclose(slopes[..., j], difference, rtol=2e-5, atol=2e-5)
    np.testing.assert_allclose(back, np.einsum("t,stj->sj", weights, slopes), rtol=1e-8, atol=1e-8)


@pytest.mark.slow
def test_rests_at_its_end_and_moves_with_it_alone():
    actuator = bench.model("joint", load_damping={"coefficient": 0.4})
    actuator = replace(actuator, {"initial_contraction": 0.09})
    command = np.array([MEAN + 2.4e5, MEAN - 2.4e5])

    def angle(contraction):
        changed = replace(actuator, {"initial_contraction": contraction})
        return equilibrium(changed, command, start=EVEN).readings[2]

    point = equilibrium(actuator, command, start=EVEN)
    assert point.converged
    np.testing.assert_allclose(point.readings[2], 0.09 * 0.3 / 0.015, rtol=1e-9)
    np.testing.assert_allclose(jax.grad(angle)(0.09), 0.3 / 0.015, rtol=1e-9)
    model = linearise(actuator, point)
    assert float(model.gain("angle", "command_1")) == 0
    np.testing.assert_allclose(np.asarray(model.poles())[-2:], -1 / STICKING_TIME, rtol=1e-9)


@cache
def slack():
    """Rig `isotonic` with its mass above where the muscle pulls, and its state."""
    state = {
        "opening": 0.0,
        "pressure": bench.AMBIENT + 2e5,
        "position": 0.12,
        "velocity": 0.0,
        "effects": {},
    }
    return bench.model("isotonic"), {k: jnp.asarray(v) if k != "effects" else v for k, v in state.items()}


@pytest.mark.slow
def test_slack_muscle_lets_the_mass_fall_freely():
    actuator, state = slack()
    held = Held(jnp.zeros(()), None, {})
    assert float(actuator.muscle.force(0.12, 2e5, actuator.muscle.end_factor)) < -50
    np.testing.assert_allclose(actuator.vector_field(state, held)["velocity"], -STANDARD_GRAVITY, rtol=1e-14)
    slope = jax.grad(lambda p: actuator.vector_field({**state, "pressure": p}, held)["velocity"])
    assert float(slope(state["pressure"])) == 0
    # Friction of threads that are pulled apart holds, that of threads that are pushed together does not.
    rubbing = actuator.with_effects(thread_friction=bench.BY_NAME["thread_friction"](**bench.THREADS))  # pyright: ignore
    up = rubbing.vector_field({**state, "velocity": jnp.asarray(0.5)}, held)["velocity"]
    np.testing.assert_allclose(up, -STANDARD_GRAVITY, rtol=1e-14)


@pytest.mark.parametrize("effects", [{}, {"thread_friction": bench.THREADS}])
def test_reading_of_a_slack_muscle_is_zero(effects):
    actuator = bench.model("driven", **effects)

    def reading(pressure, contraction, velocity=0.1):
        state = {"pressure": pressure, "contraction": contraction, "velocity": velocity, "effects": {}}
        return actuator.signals(jax.tree.map(jnp.asarray, state), Held(jnp.zeros(()), None, {})).force_reading

    assert float(reading(bench.AMBIENT + 2e5, 0.1)) == 0 == float(reading(bench.AMBIENT - 2e4, 0.02))
    slopes = jax.grad(reading, argnums=(0, 1))
    assert slopes(bench.AMBIENT + 2e5, 0.1) == (0, 0)
    # An empty muscle is on the point of pulling: the slope towards pressure is that of a muscle that pulls.
    empty = slopes(bench.AMBIENT, 0.02, 0.0)[0]
    ahead = (reading(bench.AMBIENT + 10.0, 0.02, 0.0) - reading(bench.AMBIENT, 0.02, 0.0)) / 10
    np.testing.assert_allclose(empty, ahead, rtol=1e-9)
    assert float(empty) > 0


def test_pressure_below_the_bladders_threshold_gives_no_force():
    actuator = bench.model("driven", bladder_stiffness={"threshold_pressure": 3.8e4})

    def force(gauge, threshold=3.8e4):
        changed = replace(actuator, {"effects.bladder_stiffness.threshold_pressure": threshold})
        state = {"pressure": bench.AMBIENT + gauge, "contraction": 0.02, "velocity": 0.0, "effects": {}}
        return changed.signals(jax.tree.map(jnp.asarray, state), Held(jnp.zeros(()), None, {})).muscle_force

    muscle = actuator.muscle
    law = lambda gauge: muscle.force(jnp.asarray(0.02), gauge, muscle.end_factor)  # noqa: E731
    for gauge in (1e3, 2e4, 3.7e4):
        assert abs(float(force(gauge))) < 1e-12
        assert jax.grad(force, (0, 1))(gauge, 3.8e4) == (0, 0)
    np.testing.assert_allclose(force(9e4), law(5.2e4), rtol=1e-12)
    for gauge in (-3e4, 0.0, 1e5):
        # Without a threshold nothing is taken up, at any pressure, to the last bit.
        assert float(force(gauge, 0.0)) == float(law(gauge))
        h = 1.0
        difference = (force(gauge, h) - force(gauge, 0.0)) / h
        np.testing.assert_allclose(jax.grad(force, 1)(gauge, 0.0), difference, rtol=1e-6, atol=1e-12)
