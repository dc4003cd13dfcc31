"""Forward-mode derivatives of whole runs against finite differences, over all parameters and scenes."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

from jaxmuscle.parameters import parameters, replace

SAMPLES, SUBSTEPS = 50, 3
GENERIC = {
    "chamber_leak": {"area": 1.5e-7},
    "command_delay": {"delay": 0.0046},
    "load_damping": {"coefficient": 0.4},
    "load_friction": {"force": 0.4},
    "thread_friction": bench.THREADS,
    "bladder_stiffness": {"stiffness": 200.0, "threshold_pressure": 1e4},
    "bladder_hoop_stiffness": {"wall_stiffness": 5.0},
    "pressure_dependent_ends": {"amplitude": 1.0},
    "creep": {"stiffness": 60.0, "fast_time": 0.05, "slow_time": 0.4},
    "viscoelastic_creep": {"stiffness": 30.0, "fast_time": 0.06, "slow_time": 0.3},
    "length_hysteresis": bench.LOOP,
    "gravity": {"torque": 0.8, "hanging_angle": 0.7},
    "muscle_mismatch": {"ratio": -0.08},
    "force_sensor_lag": {"time_constant": 0.03},
    "presliding": {"distance": 2e-3},
    "stribeck": {"excess": 0.2, "velocity_constant": 0.07},
    "pressure_dependent_friction": {"coefficient": 1e-7},
    "wall_thickness": {"thickness": 3e-4},
    "force_drift": {"share": 0.05, "time_constant": 3.0},
    "end_stop": {"stiffness": 0.5, "position": 0.0303, "damping": 0.3},
    "eccentric_sprocket": {"eccentricity": 0.03, "phase": 0.4, "wrap_angle": 1.1},
    "elastic_tendon": {"compliance": 2e-6},
    "bouc_wen": {"amplitude": 2.0, "distance": 4.1e-3},
    "valve_offset": {"offset": 0.11},
    "valve_hysteresis": {"half_width": 0.07},
    "dead_band": {"width": 0.29},
    "rate_limit": {"inverse_rate": 1 / 143},
    "supply_droop": {"resistance": 1.3e7},
    "line_lag": {"time_constant": 0.0123},
    "dead_volume": {"volume": 1.1e-5},
    "gas_heating": {"share": 0.37, "thermal_time": 0.21},
    "pressure_sensor_lag": {"time_constant": 0.0073},
    "force_sensor_nonlinearity": {"cubic": 1.3e-7},
    "backlash": {"half_width": 1.7e-4},
}
"""Values under which no effect sits on a kink of its own."""
REGULATED = {
    "valve_offset": {"offset": 1.9e3},
    "valve_hysteresis": {"half_width": 3.1e3},
    "dead_band": {"width": 2.3e3},
    "rate_limit": {"inverse_rate": 1 / 1.7e6},
}
"""The same where commands are pressures."""
SCALES = {
    "area": 1e-7,
    "delay": 1e-3,
    "force": 1.0,
    "threshold_pressure": 1e4,
    "stiffness": 100.0,
    "inverse_rate": 1e-6,
    "resistance": 1e6,
    "volume": 1e-6,
    "time_constant": 1e-2,
    "thickness": 1e-3,
    "compliance": 1e-5,
    "coefficient": 1e-5,
    "distance": 1e-3,
    "cubic": 1e-7,
    "backlash.half_width": 1e-4,
}
"""Size of a parameter that is zero, by its effect's and its own name or by this alone; 0.1 for the others."""
IN_PASCALS = {"offset": 1e3, "width": 1e3, "half_width": 1e3}
"""The same where commands are pressures."""
RANGES = {"pressure": 5e5, "position": 0.05, "angle": 1.0, "force": 500.0}


def lift(pressure, command, position=0.0, velocity=0.0):
    return bench.track(
        "isotonic",
        np.full(SAMPLES, command),
        pressure=bench.AMBIENT + pressure,
        position=position,
        velocity=velocity,
    )


def swing(first, second, angle=0.0, velocity=0.0, change=0.0):
    gauge = bench.AMBIENT + np.array([first, second])
    command = gauge + change * np.array([1.0, -1.0]) * np.linspace(0, 1, SAMPLES)[:, None]
    return bench.track("joint", command, pressure=gauge, angle=angle, angular_velocity=velocity)


def pull(position, velocity):
    t = np.arange(SAMPLES) * bench.STEPS["driven"]
    pressure = bench.AMBIENT + 2.5e5 + 1e5 * np.sin(5 * t)
    return bench.driven_track(pressure, position(t), velocity(t))


SCENES = {
    "isotonic": {
        "on the plate": lift(5e4, 0.0),
        "lifting off": lift(8e4, 2.0),
        "falling back": lift(2e4, -5.0, position=0.004, velocity=-0.2),
        "stuck in the air": lift(1.5e5, 0.0, position=0.03),
        "reversing": lift(1.5e5, 0.0, position=0.03, velocity=0.16),
    },
    "joint": {
        "stuck": swing(2.5e5, 2.5e5, angle=0.01),
        "breaking away": swing(2.5e5, 2.5e5, change=2e5),
        "reversing": swing(1.5e5, 3.5e5, angle=0.2, velocity=2.1),
        "slack": swing(3e5, 2e5, angle=2.3, velocity=0.5),
    },
    "driven": {
        "at rest": pull(lambda t: 0.03 + 0 * t, lambda t: 0 * t),
        "reversing": pull(lambda t: 0.03 + 0.01 * np.sin(9 * t), lambda t: 0.09 * np.cos(9 * t)),
        "beyond zero force": pull(lambda t: 0.06 + 0.19 * t, lambda t: 0.19 + 0 * t),
    },
}


@cache
def machine(rig):
    """The rig with every offered effect, its scenes stacked, its readings and their derivatives."""
    carried = [effect.name for effect in bench.offered(rig)]
    values = {**GENERIC, **REGULATED} if rig == "joint" else GENERIC
    declared = {name: values.get(name, {}) for name in carried}
    actuator = bench.model(rig, **declared)
    scenes = jax.tree.map(lambda *leaves: jnp.stack(leaves), *SCENES[rig].values())
    paths = list(parameters(actuator))

    def readings(values, bench_track):
        changed = replace(actuator, dict(zip(paths, values, strict=True)))
        out = bench.simulate(changed, bench_track, SUBSTEPS).readings
        return jnp.concatenate([jnp.ravel(out[name]) / RANGES[name] for name in out])

    def over_scenes(function):
        # What takes time here is compiling, and every program runs only some hundred times.
        quickly = {"xla_backend_optimization_level": 0}
        return jax.jit(jax.vmap(function, in_axes=(None, 0)), compiler_options=quickly)

    return actuator, paths, scenes, over_scenes(readings), over_scenes(jax.jacfwd(readings))


def sizes(rig, paths, values):
    scales = {**SCALES, **IN_PASCALS} if rig == "joint" else SCALES

    def size(path):
        effect, name = ["", *path.split(".")][-2:]
        return scales.get(f"{effect}.{name}", scales.get(name, 0.1))

    return np.array([abs(v) if v else size(path) for path, v in zip(paths, values, strict=True)])


def assert_close(derivative, difference, tolerance, floor, paths, scenes):
    """Every parameter in every scene, relative to the largest derivative in that scene."""
    assert np.isfinite(derivative).all()
    error, scale = np.abs(derivative - difference).max(axis=1), np.abs(difference).max(axis=1)
    allowed = np.asarray(tolerance)[:, None] * scale + floor
    wrong = [
        f"{scenes[i]}: {paths[j]} {error[i, j]:.2e} of {scale[i, j]:.2e}"
        for i, j in np.argwhere(error > allowed)
    ]
    assert not wrong, wrong


@pytest.mark.thorough
@pytest.mark.parametrize("rig", SCENES)
def test_derivative_over_every_parameter(rig):
    actuator, paths, scenes, readings, jacobian = machine(rig)
    values = np.array([float(entry.value) for entry in parameters(actuator).values()])
    steps = np.diag(1e-5 * sizes(rig, paths, values))

    def central(step):
        return (readings(values + step, scenes) - readings(values - step, scenes)) / 2e-5

    # Of fourth order (Richardson): what sticks on bristles bends within a step.
    difference = [(8 * central(s / 2) - central(s)) / 3 for s in steps]
    derivative = jacobian(values, scenes) * sizes(rig, paths, values)
    # Readings are of order one and good to 1e-15, so that the difference is good to 1e-10 beside its own
    # curvature, of the order of the squared step.
    tolerance = [2e-6] * len(SCENES[rig])
    assert_close(derivative, np.stack(difference, axis=-1), tolerance, 1e-9, paths, list(SCENES[rig]))


@pytest.mark.slow
@pytest.mark.parametrize("rig", SCENES)
def test_derivative_over_strengths_at_zero(rig):
    _, paths, scenes, readings, jacobian = machine(rig)
    carried = bench.model(rig, [effect.name for effect in bench.offered(rig)])
    values = np.array([float(entry.value) for entry in parameters(carried).values()])
    absent = np.flatnonzero(values == 0)
    size = sizes(rig, paths, values)[absent]
    base, h = readings(values, scenes), 1e-5
    # One-sided, second order: a strength starts at zero.
    steps = h * size[:, None] * np.eye(len(values))[absent]
    difference = [
        (4 * readings(values + s / 2, scenes) - readings(values + s, scenes) - 3 * base) / h for s in steps
    ]
    derivative = jacobian(values, scenes)[..., absent] * size
    # While a joint breaks away, dry friction holds it until the torque exceeds the limit: the difference then
    # approaches the derivative only with the root of the step.
    tolerance = [2e-2 if scene == "breaking away" else 1e-5 for scene in SCENES[rig]]
    names = [paths[i] for i in absent]
    assert {f"effects.{e.name}.{e.strength}" for e in bench.offered(rig)} <= set(names)
    assert_close(derivative, np.stack(difference, axis=-1), tolerance, 1e-8, names, list(SCENES[rig]))


@pytest.mark.slow
def test_scenes_are_what_they_say():
    def moved(rig, scene):
        name = {"isotonic": "position", "joint": "angle"}[rig]
        # On bristles what is stuck still gives way a little, and a play keeps its place in the play.
        actuator = machine(rig)[0].without_effects("presliding", "backlash")
        return np.asarray(bench.simulated(actuator, SCENES[rig][scene], SUBSTEPS).readings[name])

    assert not moved("isotonic", "on the plate").any()
    assert moved("isotonic", "lifting off")[0] == 0 < moved("isotonic", "lifting off")[-1]
    assert moved("isotonic", "falling back")[0] > 0 == moved("isotonic", "falling back")[-1]
    assert np.ptp(moved("isotonic", "stuck in the air")) < 1e-5
    assert np.ptp(moved("joint", "stuck")) < 1e-6
    assert moved("joint", "slack").min() > 2.0
    for rig in ("isotonic", "joint"):
        way = np.diff(moved(rig, "reversing"))
        assert way.max() > 0 > way.min()
