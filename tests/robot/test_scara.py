"""The robot as a machine like any other: its parameters, its effects, its door for simulations.

The pane pushes, never pulls, and only where it is touched.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built
from oracles.robot_bench import AMBIENT, machine

from jaxmuscle import describe, simulate
from jaxmuscle.actuators import Held
from jaxmuscle.actuators.sensing import sensing
from jaxmuscle.components.cylinder import positive_part
from jaxmuscle.effects import CATALOGUE, FURTHER
from jaxmuscle.effects.chain import initial_states
from jaxmuscle.parameters import get
from jaxmuscle.robot import Pane, Scara
from jaxmuscle.robot.scara import PULLS
from jaxmuscle.signals import Past

OFFERED = [effect for effect in (*CATALOGUE, *FURTHER) if Scara.offers(effect)]
STATE = {
    "pressure": AMBIENT + jnp.array([3e5, 2e5, 1.5e5, 3.2e5]),
    "pressure_rate": jnp.array([1e5, -2e5, 3e5, 0.0]),
    "angle": jnp.array([0.3, -0.8]),
    "angular_velocity": jnp.array([0.7, -1.3]),
}


def field(actuator):
    """Rates of all states at a moving state, effects at rest."""
    held = Held(STATE["pressure"], None, {})
    before = sensing(actuator, machine().signals({**STATE, "effects": {}}, held))
    states, memory = initial_states(actuator.effects, before)
    command = STATE["pressure"]
    past = Past(jnp.stack([command] * 2), jnp.asarray(0), jnp.asarray(2e-3), command)
    held = Held(STATE["pressure"], past, memory, time=jnp.asarray(7.0))
    return actuator.vector_field({**STATE, "effects": states}, held)


def test_every_parameter_has_a_unit_and_a_meaning():
    table = describe(machine())
    assert (table["meaning"].str.len() > 10).all()
    assert not table.isna().to_numpy().any()
    assert table.loc["second_mass", "SI unit"] == "kg"
    assert dict(table["path"].loc[list(Scara.quantities)]) == Scara.quantities


@pytest.mark.slow
def test_muscles_turn_their_joints():
    # More pressure in the first muscle of a joint turns it forward, in the second backward, and no other.
    actuator = machine(friction=False)

    def load(pressure):
        return actuator.signals({**STATE, "pressure": pressure, "effects": {}}, Held(pressure, None, {})).load

    np.testing.assert_array_equal(np.sign(jax.jacfwd(load)(STATE["pressure"])), PULLS)


@pytest.mark.slow
@pytest.mark.parametrize("effect", OFFERED, ids=lambda effect: effect.name)
def test_effect_of_no_strength_changes_nothing(effect):
    bare = machine(friction=False)
    carried = bare.with_effects(**{effect.name: effect()})
    assert float(get(carried, f"effects.{effect.name}.{effect.strength}")) == 0
    rates, expected = field(carried), field(bare)
    for name in STATE:
        np.testing.assert_array_equal(rates[name], expected[name])


def test_effects_that_need_a_pair_or_one_angle_are_not_offered():
    names = {effect.name for effect in OFFERED}
    assert {"thread_friction", "length_hysteresis", "creep", "load_damping"} <= names
    assert not {"muscle_mismatch", "gravity"} & names


@pytest.mark.slow
def test_effects_with_states_run():
    actuator = machine().with_effects(
        creep=bench.BY_NAME["creep"](stiffness=60.0),  # pyright: ignore
        length_hysteresis=bench.BY_NAME["length_hysteresis"](**bench.LOOP),  # pyright: ignore
    )
    times = np.arange(200) * 2e-3
    gauge = 2.5e5 + 1e5 * np.sin(6 * times)[:, None] * [1.0, -1.0, -1.0, 1.0]
    angles = [
        np.asarray(
            simulate(m, AMBIENT + gauge, times, start={"pressure": AMBIENT + gauge[0]}).readings["angle"]
        )
        for m in (actuator, machine())
    ]
    assert np.isfinite(angles[0]).all()
    assert np.abs(angles[0] - angles[1]).max() > 1e-3


@pytest.mark.slow
def test_simulation_has_a_column_for_every_sensor():
    times = np.arange(20) * 2e-3
    start = {"pressure": np.full(4, AMBIENT + 2.5e5), "angle": [0.1, 0.2]}
    frame = simulate(machine(), np.full((20, 4), AMBIENT + 2.5e5), times, start=start).to_frame()
    assert sorted(frame) == ["angle_1", "angle_2", *(f"pressure_{i}" for i in (1, 2, 3, 4))]
    np.testing.assert_allclose(frame[["angle_1", "angle_2"]], [[0.1, 0.2]] * 20, atol=1e-12)


@pytest.mark.slow
def test_symmetric_pressures_hold_the_middle():
    rates = machine(friction=False).vector_field(
        {
            **STATE,
            "pressure": jnp.full(4, AMBIENT + 2e5),
            "angle": jnp.zeros(2),
            "angular_velocity": jnp.zeros(2),
        },
        Held(jnp.full(4, AMBIENT + 2e5), None, {}),
    )
    np.testing.assert_allclose(rates["angular_velocity"], 0, atol=1e-12)


PANE = built(Pane, stiffness=5e3, damping=3.0, normal=0.6, distance=0.5, width=1e-4)
NORMAL = np.array([np.cos(0.6), np.sin(0.6)])


def pressing(depth, speed, pane=PANE):
    return pane.pressing(jnp.asarray((0.5 + depth) * NORMAL), jnp.asarray(speed * NORMAL))


def test_is_a_linear_spring_at_rest():
    assert float(pressing(0.002, 0.0)) == pytest.approx(10.0)


def test_is_exactly_nothing_off_the_pane():
    assert float(pressing(-1.001e-4, 5.0)) == 0


@pytest.mark.parametrize("speed", [-5.0, -0.33, 0.0, 5.0])
@pytest.mark.parametrize("depth", [-1.0, -1e-4, 0.0, 5e-5, 0.01])
def test_never_pulls(depth, speed):
    assert float(pressing(depth, speed)) >= 0
    force = PANE.force(jnp.asarray((0.5 + depth) * NORMAL), jnp.asarray(speed * NORMAL))
    assert float(force @ NORMAL) <= 0
    assert float(force @ np.array([-NORMAL[1], NORMAL[0]])) == pytest.approx(0, abs=1e-12)


def test_takes_energy_from_a_bounce():
    # A mass of 1 kg that hits the pane at 0.5 m/s comes back slower; without damping as fast.
    def bounce(damping):
        pane = built(Pane, stiffness=5e3, damping=damping, normal=0.6, distance=0.5, width=1e-4)
        depth, speed, h = -1e-3, 0.5, 1e-5
        force = jax.jit(lambda depth, speed: pressing(depth, speed, pane))
        for _ in range(6000):
            speed -= 0.5 * h * float(force(depth, speed))
            depth += h * speed
            speed -= 0.5 * h * float(force(depth, speed))
            if depth < -1e-3:
                break
        return speed

    assert bounce(0.0) == pytest.approx(-0.5, rel=1e-3)
    assert -0.35 < bounce(3.0) < -0.1


def test_slopes_are_continuous_and_right():
    for depth in (-1e-4, 0.0, 1e-4, 3e-3):
        slope = jax.grad(pressing)(depth, -0.2)
        difference = (pressing(depth + 1e-9, -0.2) - pressing(depth - 1e-9, -0.2)) / 2e-9
        assert float(slope) == pytest.approx(float(difference), abs=0.05)
    leaves, tree = jax.tree.flatten(PANE)
    for depth, speed in [(-1.0, 0.0), (0.0, 0.0), (1e-4, -1 / 3)]:
        slopes = jax.grad(lambda x, d=depth, v=speed: pressing(d, v, jax.tree.unflatten(tree, x)))(leaves)
        assert np.isfinite(slopes).all()


def test_positive_part_joins_its_branches():
    x = jnp.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    np.testing.assert_allclose(positive_part(x, 0.1), [0, 0, 0.025, 0.1, 0.2], atol=1e-16)
    np.testing.assert_allclose(
        jax.vmap(jax.grad(lambda v: positive_part(v, 0.1)))(x), [0, 0, 0.5, 1, 1], atol=1e-12
    )
