"""Sprocket, tendon, wall, end stop, frictions, drift and Bouc-Wen loop against what they stand for."""

from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

from jaxmuscle.actuators import Held
from jaxmuscle.actuators.joint import SIDES
from jaxmuscle.effects import (
    BoucWen,
    EccentricSprocket,
    ElasticTendon,
    EndStop,
    ForceDrift,
    LoadFriction,
    PressureDependentFriction,
    Stribeck,
    WallThickness,
)
from jaxmuscle.effects.chain import chamber
from jaxmuscle.effects.transmission import arms, shortening, unwound
from jaxmuscle.hysteresis.operators import bouc_wen, dahl
from jaxmuscle.parameters import replace
from jaxmuscle.signals import Signals

MUSCLE = bench.model("driven").muscle
X = jnp.asarray([0.0, 0.02, 0.06])
OFF = {"eccentricity": 0.2, "phase": 0.6}
ECCENTRIC = built(EccentricSprocket, **OFF)
WRAPS = (0.0, 1.2, np.pi)


def pulled(gauge, muscle=MUSCLE, contraction=X, **more):
    return Signals(
        ambient_pressure=jnp.asarray(bench.AMBIENT),
        pressure=jnp.asarray(bench.AMBIENT + gauge),
        muscle=muscle,
        contraction=contraction,
        muscle_force=muscle.force(contraction, jnp.asarray(gauge), muscle.end_factor),
        **more,
    )


def test_wall_gives_the_work_of_the_inner_volume():
    muscle, t, gauge = replace(MUSCLE, {"end_factor": 1.0}), 8e-4, 3e5

    def volume(contraction):
        ratio = 1 - contraction / muscle.initial_length
        radius = muscle.initial_radius * muscle.swelling(ratio) - t
        return jnp.pi * radius**2 * muscle.initial_length * ratio

    signals = pulled(gauge, muscle)
    total = signals.muscle_force + built(WallThickness, thickness=t).value(signals)
    np.testing.assert_allclose(total, gauge * jax.vmap(jax.grad(volume))(X), rtol=1e-12)


def test_gas_fills_what_the_wall_leaves():
    t, wall = 8e-4, {"wall": built(WallThickness, thickness=8e-4)}

    def volume(contraction):
        ratio = 1 - contraction / MUSCLE.initial_length
        radius = MUSCLE.initial_radius * MUSCLE.swelling(ratio) - t
        return jnp.pi * radius**2 * MUSCLE.initial_length * ratio

    inner, slope = chamber(wall, MUSCLE, X)
    np.testing.assert_allclose(inner, volume(X), rtol=1e-12)
    np.testing.assert_allclose(slope, jax.vmap(jax.grad(volume))(X), rtol=1e-12)
    none, _ = chamber({"wall": built(WallThickness, thickness=0.0)}, MUSCLE, X)
    np.testing.assert_array_equal(none, MUSCLE.volume(X))


def test_tendon_and_muscle_pull_alike():
    compliance, gauge = 2e-5, 3e5
    signals = pulled(gauge)
    total = signals.muscle_force + built(ElasticTendon, compliance=compliance).value(signals)
    stretched = MUSCLE.force(X + compliance * total, jnp.asarray(gauge), MUSCLE.end_factor)
    np.testing.assert_allclose(total, stretched, rtol=1e-11)
    assert (total < signals.muscle_force).all() and (total > 0).all()


@pytest.mark.parametrize("gauge", [0.0, -2e4, 3e5])
def test_tendon_is_slack_where_the_muscle_does_not_pull(gauge):
    long = jnp.asarray([0.0, 0.09, 0.14])
    signals = pulled(gauge, contraction=long)
    added = built(ElasticTendon, compliance=2e-5).value(signals)
    assert not np.any(np.where(signals.muscle_force <= 0, added, 0.0))
    slopes = jax.vmap(
        jax.grad(
            lambda c, x, p: ElasticTendon(compliance=c).value(pulled(p, contraction=x)), argnums=(0, 1, 2)
        ),
        in_axes=(None, 0, None),
    )
    for compliance in (0.0, 2e-5):
        assert all(np.isfinite(s).all() for s in slopes(jnp.asarray(compliance), long, jnp.asarray(gauge)))


@pytest.mark.parametrize("wrap", WRAPS)
def test_arms_are_the_slopes_of_the_shortening(wrap):
    angle = jnp.linspace(-2.0, 2.0, 9)
    effects = {"eccentric_sprocket": eqx.tree_at(lambda e: e.wrap_angle, ECCENTRIC, jnp.asarray(wrap))}
    own = lambda a: shortening(effects, a, SIDES)  # noqa: E731
    slopes = jax.vmap(jax.jacfwd(own))(angle)
    np.testing.assert_allclose(slopes, jax.vmap(lambda a: arms(effects, a, SIDES))(angle), rtol=1e-12)
    assert not own(jnp.asarray(0.0)).any()
    for muscle, side in enumerate(SIDES):
        wound = side * jax.vmap(own)(angle)[:, muscle]
        np.testing.assert_allclose(unwound(effects, wound, muscle), angle, atol=1e-9)


@pytest.mark.parametrize(("wrap", "sense"), [(0.0, 1.0), (np.pi, -1.0)])
def test_chains_on_the_same_side_change_alike_on_opposite_sides_by_as_much_less(wrap, sense):
    effect = built(EccentricSprocket, eccentricity=0.1, phase=0.4, wrap_angle=wrap)
    angle = jnp.linspace(-1.0, 1.0, 5)
    np.testing.assert_allclose(effect.lever(angle, 1), sense * effect.lever(angle, 0), atol=1e-15)
    np.testing.assert_allclose(effect.lever(angle, 0), 0.1 * jnp.cos(angle - 0.4), atol=1e-15)


@pytest.mark.parametrize("wrap", WRAPS)
def test_eccentric_sprocket_loses_no_work(wrap):
    machine = bench.model("joint", eccentric_sprocket={**OFF, "wrap_angle": wrap})
    pressure = jnp.asarray(bench.AMBIENT + np.array([3e5, 2e5]))

    def signals(angle):
        state = {"pressure": pressure, "angle": angle, "angular_velocity": jnp.asarray(1.3)}
        return machine.signals({**state, "pressure_rate": jnp.zeros(2)}, Held(pressure, None, {}))

    for angle in jnp.linspace(-1.0, 1.0, 5):
        now = signals(angle)
        assert float(now.load * 1.3) == pytest.approx(float(now.muscle_force @ now.contraction_velocity))
        moved = jax.jvp(lambda a: signals(a).contraction, (angle,), (jnp.asarray(1.3),))[1]
        np.testing.assert_allclose(now.contraction_velocity, moved, rtol=1e-12)


@pytest.mark.parametrize("wrap", WRAPS)
def test_joint_with_an_eccentric_sprocket_ends_where_a_muscle_is_at_its_full_length(wrap):
    machine = bench.model("joint", eccentric_sprocket={**OFF, "wrap_angle": wrap})
    for angle in (-9.0, 9.0):
        state = {"angle": jnp.asarray(angle), "angular_velocity": jnp.zeros(())}
        state |= {"pressure": jnp.full(2, bench.AMBIENT), "pressure_rate": jnp.zeros(2)}
        ended = machine.constrained(state)
        contraction = machine.signals(ended, Held(state["pressure"], None, {})).contraction
        assert float(jnp.min(contraction)) == pytest.approx(0.0, abs=1e-9)


def test_stop_presses_outside_alone():
    position = jnp.asarray([-0.4, 0.0, 0.29, 0.31, 0.4])
    still = Signals(position=position, velocity=jnp.zeros(5))
    upper = built(EndStop, stiffness=50.0, position=0.3).value(still)
    np.testing.assert_allclose(upper, [0, 0, 0, -0.5, -5.0], atol=1e-12)
    lower = built(EndStop, stiffness=50.0, position=-0.3).value(still)
    np.testing.assert_allclose(lower, [5.0, 0, 0, 0, 0], atol=1e-12)
    damped = built(EndStop, stiffness=50.0, position=0.3, damping=2.0)
    force = damped.value(Signals(position=jnp.full(3, 0.4), velocity=jnp.asarray([0.2, 0.0, -1.0])))
    np.testing.assert_allclose(force, [-7.0, -5.0, 0.0], atol=1e-12)


def test_breakaway_is_larger_by_the_excess():
    friction = built(Stribeck, excess=0.5, velocity_constant=0.1)
    limit = [float(friction.limit(Signals(velocity=jnp.asarray(v)))) for v in (0.0, -0.1, 50.0)]
    assert limit == pytest.approx([0.5, 0.5 * np.exp(-1), 0.0])


@pytest.mark.parametrize(
    ("gauge", "velocity", "expected"),
    [
        (3e5, 0.0, 3.0),
        ([3e5, -1e4], 0.2, 3.0),
        ([1e5, 2e5, 3e5, 4e5], [0.0, 0.1], [3.0, 7.0]),
    ],
)
def test_seals_feel_the_pressures_of_their_own_joint(gauge, velocity, expected):
    signals = Signals(
        ambient_pressure=jnp.asarray(bench.AMBIENT),
        pressure=bench.AMBIENT + jnp.asarray(gauge),
        velocity=jnp.asarray(velocity),
    )
    limit = built(PressureDependentFriction, coefficient=1e-5).limit(signals)
    assert limit.shape == signals.velocity.shape == built(LoadFriction, force=1.0).limit(signals).shape
    np.testing.assert_allclose(limit, expected, rtol=1e-12)


def test_force_decays_from_the_first_row_on():
    effect = built(ForceDrift, share=0.2, time_constant=30.0)
    for time, left in ((0.0, 1.0), (30.0, 1 - 0.2 * (1 - np.exp(-1))), (1e6, 0.8)):
        signals = pulled(3e5, time=jnp.asarray(time))
        np.testing.assert_allclose(
            signals.muscle_force + effect.value(signals), left * signals.muscle_force, rtol=1e-12
        )


def test_drift_goes_by_the_time_of_the_recording():
    motion = tuple(np.full(200, each) for each in (bench.AMBIENT + 3e5, 0.03, 0.0))
    models = bench.model("driven", force_drift={"share": 0.3, "time_constant": 0.7}), bench.model("driven")
    force, bare = (
        np.asarray(bench.simulated(m, bench.driven_track(*motion), 1).readings["force"]) for m in models
    )
    time = bench.STEPS["driven"] * np.arange(200)
    np.testing.assert_allclose(force / bare, 1 - 0.3 * (1 - np.exp(-time / 0.7)), rtol=1e-12)


def followed(corners, pieces, z=0.3):
    for a, b in pairwise(corners):
        for _ in range(pieces):
            z = bouc_wen(z, (b - a) / pieces, 2e-3)
    return float(z)


def test_bouc_wen_is_exact_at_any_step_size():
    corners = (0.0, 0.004, 0.001, 0.0025, -0.006)
    assert followed(corners, 1) == pytest.approx(followed(corners, 37), rel=1e-12)
    # Its differential equation, in 20 000 steps of Euler's method.
    z, d = 0.3, 2e-3
    for a, b in pairwise(corners):
        step = (b - a) / 20000
        for _ in range(20000):
            z += step / d * (1 - 0.5 * abs(z) * (1 + np.sign(z * step)))
    assert followed(corners, 1) == pytest.approx(z, abs=1e-4)


def test_bouc_wen_loads_like_dahl_and_unloads_like_a_spring():
    assert float(bouc_wen(0.3, 1e-3, 2e-3)) == pytest.approx(float(dahl(0.3, 1e-3, 2e-3)))
    assert float(bouc_wen(0.9, -1e-3, 2e-3)) == pytest.approx(0.9 - 0.5)
    assert float(bouc_wen(0.9, 0.0, 2e-3)) == 0.9


@pytest.mark.parametrize("z", [-0.7, 0.0, 0.7])
@pytest.mark.parametrize("move", [-4e-3, -1e-4, 1e-4, 4e-3])
def test_slopes_of_bouc_wen_equal_differences(z, move):
    slope = jax.vmap(jax.grad(bouc_wen, argnums=(0, 1, 2)))(*(jnp.array([v]) for v in (z, move, 2e-3)))
    for i, (which, size) in enumerate(((0, 1.0), (1, 1e-3), (2, 1e-3))):
        ends = []
        for sign in (-1, 1):
            values = [z, move, 2e-3]
            values[which] += sign * 1e-6 * size
            ends.append(float(bouc_wen(*values)))
        difference = (ends[1] - ends[0]) / (2e-6 * size)
        # At a state of zero the way to it and the way from it have slopes of their own.
        if not (z == 0 and which == 0):
            assert float(slope[i][0]) == pytest.approx(difference, rel=1e-6, abs=1e-6 / size)


def test_bouc_wen_at_a_standstill_has_finite_slopes():
    effect = built(BoucWen, amplitude=5.0, distance=2e-3)
    memory = effect.initial(pulled(3e5))

    def total(contraction):
        return effect.value(memory, pulled(3e5, contraction=contraction)).sum()

    assert not np.any(effect.value(memory, pulled(3e5)))
    assert np.isfinite(jax.grad(total)(X)).all()
