"""Recordings from the oracles for the tests of a fit, and short ways to fit them."""

import dataclasses

import numpy as np
from oracles import bench
from oracles.isotonic import isotonic
from oracles.recorded import clock, driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.recording import Recording

TRUE = {"initial_radius": bench.CARDS["driven"]["initial_radius"], "end_factor": 1.303}
DAMPING = {"load_damping": {"coefficient": 150.0}}
LIFT_TRUE = {"valve_area": 2e-6, "end_factor": 1.303}


def pulled(seed=0, *, seconds=8.0, off=1.0, threads=False, extra=0.0, name="pull"):
    """A bench-driven muscle; the card gives the true values times `off`."""
    effects = {"thread_friction": bench.THREADS} if threads else {}
    card = driven_card(bench.THREADS if threads else {}, **{key: off * value for key, value in TRUE.items()})
    recording = driven_recording(effects, card, seconds=seconds, seed=seed, extra=extra)
    return dataclasses.replace(recording, name=name)


def changed(recording, **columns):
    """A copy with other columns."""
    return dataclasses.replace(recording, columns={**recording.columns, **columns})


def lift_card(mass, **uncertain):
    """A card of the lifting bench; `uncertain`: value and std of what is not known."""
    given = bench.CARDS["isotonic"]
    units = {"full_command": "V", "initial_length": "m", "initial_radius": "m", "braid_angle": "rad"}
    units |= {"valve_time_constant": "s", "gas_temperature": "K", "polytropic_exponent": ""}
    known = {name: {"value": float(given[name]), "unit": unit} for name, unit in units.items()}
    known["mass"] = {"value": mass, "unit": "kg"}
    known["supply_pressure"] = {"value": 6e5, "unit": "Pa", "reference": "gauge"}
    unit_of = {"valve_area": "m^2", "end_factor": ""}
    column = {"command": ("V", {}), "position": ("m", {}), "pressure": ("Pa", {"reference": "absolute"})}
    return Card.parse(
        {
            "rig": "isotonic",
            "columns": {
                "time": {"column": "time", "unit": "s"},
                **{name: {"column": name, "unit": unit, **more} for name, (unit, more) in column.items()},
            },
            "known": known,
            "uncertain": {
                name: {"value": value, "std": std, "unit": unit_of[name]}
                for name, (value, std) in uncertain.items()
            },
            "noise": {"pressure": {"value": 400, "unit": "Pa"}, "position": {"value": 3e-5, "unit": "m"}},
            "effects": {"load_damping": {"coefficient": {"value": 150.0, "unit": "N s/m"}}},
            "fit": {"horizon": {"value": 0.5, "unit": "s"}},
        }
    )


def lifted(mass, *, offset=0.0, seed=0, samples=850, off=1.0):
    """The oracle's lifting bench with a mass and an offset of the position's sensor."""
    card = lift_card(mass, valve_area=(off * 2e-6, 4e-7), end_factor=(1.303 * (2 - off), 0.1))
    command = bench.isotonic_command()[:samples]
    truth = {**bench.CARDS["isotonic"], "mass": mass}
    pressure, position, _ = isotonic(truth, DAMPING, command, bench.STEPS["isotonic"], bench.AMBIENT, 4)
    rng = np.random.default_rng(seed)
    columns = {
        "command": command,
        "pressure": pressure + 400 * rng.normal(size=samples),
        "position": position + offset + 3e-5 * rng.normal(size=samples),
    }
    step = bench.STEPS["isotonic"]
    return Recording(f"lift-{mass:g}kg", None, None, card, clock(samples, step), step, columns)


def fitted(recordings, *free, **how):
    """Fit the machine of the first recording's card."""
    first = recordings if isinstance(recordings, Recording) else recordings[0]
    return jm.fit(jm.actuator(first.card), recordings, list(free) or None, **how)


def within(result, name, true, most=4.0):
    """Whether a fitted value is within so many of its standard deviations of the truth."""
    value = result.parameters[name]
    return abs(value.value - true) <= most * value.std
