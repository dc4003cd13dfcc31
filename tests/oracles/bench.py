"""One card, one command and one package model for each rig, shared by the comparisons with the oracles."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxmuscle.actuators import RIGS, Driven, Elbow, Isotonic, JetPipeActuator, JetPipePiston, Joint
from jaxmuscle.components import (
    ChamberGas,
    CurrentDriver,
    Cylinder,
    FlowValve,
    JetPipe,
    McKibben,
    Piston,
    PressureRegulator,
    Receiver,
)
from jaxmuscle.effects import BY_NAME as BY_NAME
from jaxmuscle.effects import CATALOGUE, FURTHER
from jaxmuscle.hysteresis import Envelope, ModifiedPrandtlIshlinskii
from jaxmuscle.parameters import get, replace
from jaxmuscle.robot import robot
from jaxmuscle.simulation import Track, run, start_at_rest

AMBIENT = 101325.0
STEPS = {
    "isotonic": 2e-3,
    "joint": 2e-3,
    "driven": 1e-2,
    "elbow": 1e-2,
    "jet-pipe": 2e-3,
    "jet-pipe-piston": 2e-3,
    "scara": 2e-3,
}
MUSCLE = {
    "initial_length": 0.3,
    "initial_radius": 0.007,
    "braid_angle": np.deg2rad(20),
    "end_factor": 1.303,
    "ambient_pressure": AMBIENT,
}
CARDS = {
    "isotonic": {
        **MUSCLE,
        "valve_area": 2e-6,
        "valve_time_constant": 7e-3,
        "full_command": 5.0,
        "supply_pressure": AMBIENT + 6e5,
        "gas_temperature": 293.15,
        "polytropic_exponent": 1.2,
        "mass": 12.0,
    },
    "driven": MUSCLE,
    "joint": {
        **MUSCLE,
        "regulator_frequency": 12.0,
        "regulator_damping": 0.85,
        "sprocket_radius": 0.015,
        "initial_contraction": 0.2,
        "inertia": 0.04,
    },
    "elbow": {
        "ambient_pressure": AMBIENT,
        "regulator_frequency": 6.0,
        "regulator_damping": 0.9,
        "rising_height": 3.0,
        "rising_slope": 5e-6,
        "rising_shift": -1.6,
        "rising_level": 2.76,
        "falling_height": 2.8,
        "falling_slope": 5.5e-6,
        "falling_shift": -1.2,
        "falling_level": 2.33,
        "density": 0.065,
        "decay": 1.5,
        "spacing": 0.1,
        "linear": 1e-7,
        "cubic": 1e-19,
    },
    "jet-pipe": {
        "ambient_pressure": AMBIENT,
        "gas_temperature": 293.15,
        "supply_pressure": AMBIENT + 5.516e5,
        "stopper_position": 0.048,
        "current_gain": 0.1,
        "residual_force": 3.0,
        "polytropic_exponent": 1.4,
        "pipe_compliance": 0.8e-3,
        "pipe_saturation_force": 0.9,
        "receiver_offset": 0.099e-3,
        "discharge_coefficient": 0.696,
        "initial_pressure": 3e5,
    },
}

CARDS["jet-pipe-piston"] = {
    **{name: value for name, value in CARDS["jet-pipe"].items() if name != "residual_force"},
    "wall_conductance": 0.02,
    "viscous_friction": 3.0,
    "coulomb_friction": 0.8,
    "stiction": 1.5,
}


def built(kind, *values, **named):
    """A component, machine or effect from plain numbers: its converters make the arrays of its fields."""
    return kind(*values, **named)


BLANKS = {
    "isotonic": built(Isotonic, built(FlowValve, 1, 1, 1, 1), built(McKibben, 1, 1, 1, 1), 1),
    "driven": built(Driven, built(McKibben, 1, 1, 1, 1)),
    "joint": built(Joint, built(PressureRegulator, 1, 1), built(McKibben, 1, 1, 1, 1), 1, 1, 0),
    "elbow": built(
        Elbow,
        built(PressureRegulator, 1, 1),
        built(ModifiedPrandtlIshlinskii, built(Envelope, 1, 1), built(Envelope, 1, 1), 1, 1, 1),
    ),
}
BLANKS["jet-pipe"] = built(
    JetPipeActuator,
    built(CurrentDriver, 1),
    built(JetPipe, 1, 1, 0),
    built(Receiver, 1, 1),
    built(Cylinder),
    1,
)
BLANKS["jet-pipe-piston"] = built(
    JetPipePiston,
    built(CurrentDriver, 1),
    built(JetPipe, 1, 1, 0),
    built(Receiver, 1, 1),
    built(Cylinder),
    built(Piston),
    built(ChamberGas),
    1,
)
BLANKS["scara"] = robot(friction=False)
CARDS["scara"] = {name: float(get(BLANKS["scara"], path)) for name, path in RIGS["scara"].quantities.items()}
THREADS = {"static_coefficient": 0.015, "kinetic_coefficient": 0.105, "velocity_constant": 0.15}
BLADDER = {"stiffness": 900.0, "threshold_pressure": 3.8e4}
WALL = {"wall_stiffness": 15.0}
LOOP = {"weight": 0.13, "asymmetry": -0.1, "density_width": 0.1}
ENDS = {"amplitude": 3.0}


def model(rig, carried=(), **declared):
    """The rig with the values of its card, with effects `carried` at zero strength and those `declared`."""
    quantities = RIGS[rig].quantities
    bare = replace(BLANKS[rig], {quantities[name]: value for name, value in CARDS[rig].items()})
    values = {name: declared.get(name, {}) for name in (*carried, *declared)}
    return bare.with_effects(**{name: bare.effect_named(name)(**value) for name, value in values.items()})


class Unsteered(Isotonic):
    """A lift that declares no control channel."""

    rig = "unsteered"
    channel = None


def unsteered():
    """The lift of its card, without a control channel."""
    lift = model("isotonic")
    return Unsteered(**{field.name: getattr(lift, field.name) for field in dataclasses.fields(lift)})


def offered(rig):
    """The effects that a rig offers, whether a diagnosis seeks them by itself or not."""
    return [effect for effect in (*CATALOGUE, *FURTHER) if BLANKS[rig].offers(effect)]


def sought(rig):
    """The effects of the catalogue that a diagnosis seeks, of those that a rig offers."""
    return [effect for effect in CATALOGUE if BLANKS[rig].offers(effect)]


def isotonic_command():
    """Charge, hold, shake, empty until the mass is back on the plate, hold, lift again [V]; 1.7 s."""
    t = np.arange(850) * STEPS["isotonic"]
    shake = 2.5 * np.sin(2 * np.pi * 5 * (t - 0.3))
    return np.select([t < 0.15, t < 0.3, t < 0.7, t < 1.15, t < 1.25], [2.5, 0.0, shake, -5.0, 0.0], 3.5)


def joint_command():
    """Co-contraction, a step, sines and a step back, turning both ways [Pa, absolute]; 1.6 s, two muscles."""
    t = np.arange(800) * STEPS["joint"]
    sweep = 2e5 * np.sin(2 * np.pi * 2.5 * (t - 0.5))
    difference = np.select([t < 0.1, t < 0.5, t < 1.1], [0.0, 1.2e5, sweep], -1e5)
    return AMBIENT + 2.5e5 + np.stack([difference, -difference], axis=1)


def elbow_command():
    """Up, part of the way down, up, small loops, down [Pa, absolute]; 3 s."""
    t = np.arange(300) * STEPS["elbow"]
    corners = [0.0, 0.7, 1.1, 1.5, 1.7, 1.9, 2.1, 2.7, 3.0], [0, 5.6, 2.1, 4.3, 3.3, 3.9, 2.9, 0.4, 0.4]
    return AMBIENT + 1e5 * np.interp(t, *corners)


def jet_pipe_command():
    """Pull, let go, pull hard, sines about the middle of the range, push, small loops [V]; 1.2 s."""
    t = np.arange(600) * STEPS["jet-pipe"]
    sines = 0.9 + 0.8 * np.sin(2 * np.pi * 9 * (t - 0.5))
    loops = 0.6 + 0.25 * np.sin(2 * np.pi * 20 * (t - 0.9))
    return np.select([t < 0.2, t < 0.3, t < 0.5, t < 0.8, t < 0.9], [1.3, 0.3, 2.2, sines, -0.8], loops)


def piston_command():
    """The jet-pipe's command with a supply that sags and recovers [V; Pa, absolute]; 1.2 s."""
    t = np.arange(600) * STEPS["jet-pipe-piston"]
    supply = AMBIENT + np.interp(t, [0.0, 0.4, 0.7, 1.0], [5.5e5, 5.5e5, 4.2e5, 5.5e5])
    return np.stack([jet_pipe_command(), supply], axis=1)


def driven_motion():
    """Pressure, contraction and velocity of a test machine: triangles with a dwell, pressure waving; 2 s."""
    t = np.arange(200) * STEPS["driven"]
    velocity = np.select([t < 0.6, t < 0.8, t < 1.2, t < 1.5], [0.1, 0.0, -0.08, 0.05], -0.06)
    contraction = np.concatenate([[0.005], 0.005 + np.cumsum(velocity[:-1]) * STEPS["driven"]])
    return AMBIENT + 2.5e5 + 1.5e5 * np.sin(2 * np.pi * 0.7 * t), contraction, velocity


def track(rig, command, **measured):
    """A `Track` from arrays; what has no axis of samples stays as it is throughout."""
    command = jnp.asarray(command, dtype=float)

    def spread(value):
        value = jnp.asarray(value, dtype=float)
        constant = value.ndim == 0 or len(value) != len(command)
        return jnp.broadcast_to(value, (len(command), *value.shape)) if constant else value

    return Track(jnp.asarray(STEPS[rig]), command, {name: spread(value) for name, value in measured.items()})


def isotonic_track(command):
    """The mass on its plate, the muscle empty."""
    return track("isotonic", command, pressure=AMBIENT, position=0.0, velocity=0.0)


def joint_track(command):
    """The joint at angle 0, the pressures as first commanded."""
    return track("joint", command, pressure=np.asarray(command[0]), angle=0.0, angular_velocity=0.0)


def elbow_track(command):
    """The muscles at the pressure first commanded."""
    return track("elbow", command, pressure=np.asarray(command[0]))


def driven_track(pressure, contraction, velocity):
    """An imposed motion."""
    zeros = np.zeros(len(pressure))
    return track("driven", zeros, pressure=pressure, contraction=contraction, velocity=velocity)


def simulate(actuator, bench, substeps, keep=()):
    """The whole track from rest at its first sample: a `Run`."""
    return run(
        actuator,
        bench,
        start_at_rest(actuator, bench),
        jnp.asarray(0),
        samples=bench.command.shape[0],
        imposed=type(actuator).imposed,
        substeps=substeps,
        keep=keep,
    )


simulated = eqx.filter_jit(simulate)
"""`simulate`, compiled once for each structure of the model."""


def deviation(values, reference):
    """Largest deviation relative to the range of the reference."""
    return float(np.abs(np.asarray(values) - reference).max() / np.ptp(reference))
