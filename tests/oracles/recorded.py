"""Recordings whose readings come from the oracles, with a card as an experimenter would write it."""

import numpy as np
from numpy.typing import ArrayLike
from oracles import bench
from oracles.driven import driven

from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.units import Series

NOISE = 0.8
"""Of the force sensor [N]."""
STEP = 0.01
STDS = {"initial_radius": 1e-4, "end_factor": 0.05}
THREAD_STDS = {"static_coefficient": 0.004, "kinetic_coefficient": 0.02, "velocity_constant": 0.04}


def driven_card(threads, **values):
    """A card that gives `values` in place of the true ones; `threads`: what it says of thread friction."""
    given = {**bench.CARDS["driven"], **values}
    units = {"initial_length": "m", "initial_radius": "m", "braid_angle": "rad", "end_factor": ""}

    def section(names):
        stds = {name: {"std": STDS[name]} if name in STDS else {} for name in names}
        return {name: {"value": float(given[name]), "unit": units[name], **stds[name]} for name in names}

    column = {"pressure": ("Pa", {"reference": "absolute"}), "position": ("m", {}), "force": ("N", {})}
    columns = {name: {"column": name, "unit": unit, **extra} for name, (unit, extra) in column.items()}
    friction = {
        name: {"value": value, "std": THREAD_STDS[name], "unit": "m/s" if "velocity" in name else ""}
        for name, value in threads.items()
    }
    return Card.parse(
        {
            "rig": "driven",
            "columns": {"time": {"column": "time", "unit": "s"}, **columns},
            "known": section(["initial_length", "braid_angle"]),
            "uncertain": section(["initial_radius", "end_factor"]),
            "noise": {"force": {"value": NOISE, "unit": "N"}},
            "effects": {"thread_friction": friction} if threads else {},
        }
    )


def smooth_motion(seconds, step=STEP):
    """Pressure, contraction and velocity of sums of sines: 0.3 to 4 bar gauge, up to 0.2 m/s."""
    t = np.arange(round(seconds / step)) * step
    pressure = bench.AMBIENT + 2.15e5 + 1.85e5 * np.sin(2 * np.pi * 0.23 * t)
    slow, fast = 2 * np.pi * 0.61, 2 * np.pi * 1.7
    contraction = 0.031 + 0.017 * np.sin(slow * t) + 0.011 * np.sin(fast * t + 1.0)
    velocity = 0.017 * slow * np.cos(slow * t) + 0.011 * fast * np.cos(fast * t + 1.0)
    return pressure, contraction, velocity


def clock(samples, step) -> Series:
    """Sampling instants from zero on."""
    return np.arange(samples, dtype=np.float64) * float(step)


def driven_recording(effects, card, *, seconds=20.0, seed=0, extra: ArrayLike = 0.0):
    """The oracle's force under `effects` and white noise, the imposed motion without any.

    `extra` [N], a number or a series, is added to the force.
    """
    motion = smooth_motion(seconds)
    noise = NOISE * np.random.default_rng(seed).normal(size=len(motion[0]))
    force = driven(bench.CARDS["driven"], effects, *motion) + noise + np.asarray(extra)
    columns = {"pressure": motion[0], "position": motion[1], "force": force}
    return Recording("oracle", None, None, card, clock(len(force), STEP), STEP, columns)


UNITS = {
    "initial_length": "m",
    "initial_radius": "m",
    "braid_angle": "rad",
    "valve_area": "m^2",
    "valve_time_constant": "s",
    "full_command": "V",
    "gas_temperature": "K",
    "mass": "kg",
    "ambient_pressure": "Pa",
    "end_factor": "",
    "polytropic_exponent": "",
}


def isotonic_card():
    """The card of the oracle's values, all of them known."""
    absolute = {"unit": "Pa", "reference": "absolute"}
    given = bench.CARDS["isotonic"]
    units = {"time": {"unit": "s"}, "command": {"unit": "V"}, "pressure": absolute, "position": {"unit": "m"}}
    return Card.parse(
        {
            "rig": "isotonic",
            "columns": {name: {"column": name, **unit} for name, unit in units.items()},
            "known": {
                name: {
                    "value": float(value),
                    **(absolute if name == "supply_pressure" else {"unit": UNITS[name]}),
                }
                for name, value in given.items()
            },
            "uncertain": {},
            "noise": {},
        }
    )
