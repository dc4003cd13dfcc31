"""The robot of the tests: the published one, its card for the oracle, and runs of it."""

import jax.numpy as jnp
import numpy as np
from oracles import bench

from jaxmuscle.parameters import get, replace
from jaxmuscle.robot import robot

AMBIENT, STEP = bench.AMBIENT, 2e-3
PATHS = {
    "l1": "arm.first.length",
    "m1": "arm.first.mass",
    "c1": "arm.first.centre",
    "i1": "arm.first.inertia",
    "l2": "arm.second.length",
    "m2": "arm.second.mass",
    "c2": "arm.second.centre",
    "i2": "arm.second.inertia",
    "payload": "arm.payload",
    "gravity": "arm.gravity",
    "regulator_frequency": "regulator.frequency",
    "regulator_damping": "regulator.damping",
    "initial_length": "muscle.initial_length",
    "initial_radius": "muscle.initial_radius",
    "braid_angle": "muscle.braid_angle",
    "end_factor": "muscle.end_factor",
    "sprocket_radius": "sprocket_radius",
    "initial_contraction": "initial_contraction",
    "pane_stiffness": "pane.stiffness",
    "pane_damping": "pane.damping",
    "pane_normal": "pane.normal",
    "pane_distance": "pane.distance",
    "pane_width": "pane.width",
}
UNEQUAL = {"arm.first.length": 0.37, "arm.second.length": 0.43, "arm.payload": 0.7, "arm.gravity": 4.0}
"""Nothing equal, nothing zero: no term of the dynamics hides."""
PANE = {
    "pane.stiffness": 4e3,
    "pane.damping": 0.8,
    "pane.normal": 0.9,
    "pane.distance": 0.74,
    "pane.width": 1e-3,
}


def card(actuator):
    """The numbers of a robot, with the names of the oracle."""
    numbers = {name: float(get(actuator, path)) for name, path in PATHS.items()}
    threads = actuator.effects.get("thread_friction")
    names = ("static_coefficient", "kinetic_coefficient", "velocity_constant")
    friction = {name: float(getattr(threads, name)) for name in names} if threads else None
    return {**numbers, "effects": {"thread_friction": friction} if friction else {}}


def machine(changes=None, friction=True):
    """The published robot with some of its numbers changed."""
    return replace(robot(friction=friction), changes or {})


def held(first, then, angle, samples, velocity=(0.0, 0.0)):
    """A track whose pressures go from `first` to `then` (gauge) with the first sample."""
    command = np.tile(AMBIENT + np.asarray(then), (samples, 1))
    measured = {
        "pressure": np.tile(AMBIENT + np.asarray(first), (samples, 1)),
        "angle": np.tile(angle, (samples, 1)),
        "angular_velocity": np.tile(velocity, (samples, 1)),
    }
    arrays = {name: jnp.asarray(value) for name, value in measured.items()}
    return bench.Track(jnp.asarray(STEP), jnp.asarray(command), arrays)
