"""A drive that is not in the package, written by its user in a page: how far off is it on an unseen run?

EMPS (Janot, Gautier and Brunot 2019, nonlinearbenchmark.org): a motor moves a carriage on a ball screw
against dry friction. Measured in closed loop are the motor's voltage and the position, 1 kHz, 24.84 s; here
the measured voltage alone drives the model, from the first sample to the last, without a correction. Fitted
is the estimation run only; counted is the run with pulses, which no fit has seen (the force pulses are not
given to the model). The published parameters are those of the makers' inverse model, by least squares; they
are also simulated here, as some of their published error is that of Euler steps of 1 ms, and the lower of
the two errors is the goal. The error of the estimation run is shown: it is what the fit made small.

    python benchmarks/real_emps.py [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from measured_rows import drive_run
from published_rows import Row, counts
from scipy.io import loadmat

import jaxmuscle as jm
from jaxmuscle.actuators import AbstractActuator, Held, Link, register
from jaxmuscle.actuators.actuator import State
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.effects.chain import state_rates
from jaxmuscle.effects.slip import friction_limit, slip_of_mass
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import COMMAND, LOAD, Signals


@register
class Drive(AbstractActuator):
    """A mass that a motor pushes: m x'' = g u - o - what the effects on the load take."""

    rig: ClassVar = "drive"
    units: ClassVar = {"command": "V", "load": "N", "motion": "m"}
    quantities: ClassVar = {"mass": "mass", "gain": "gain", "offset": "offset"}
    commands: ClassVar = ("command",)
    measured: ClassVar = {"position": ("position",)}
    derivatives: ClassVar = {"velocity": "position"}
    imposed: ClassVar = ()
    outputs: ClassVar = {"position": ("position",)}
    links: ClassVar = (Link("position", (), "load"),)
    available: ClassVar = frozenset({"command", "past", "position", "velocity"})
    largest_step: ClassVar = 1e-3

    mass: Scalar = parameter("kg", "everything that moves, as seen by the carriage", positive=True)
    gain: Scalar = parameter("N/V", "force of the motor per voltage", positive=True)
    offset: Scalar = parameter("N", "constant force against the motion", default=0.0, typical=5.0)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return dict(measured)

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return jnp.zeros(())

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = Signals(past=held.past, position=state["position"], velocity=state["velocity"])
        signals = self._with(signals, COMMAND, held.command, states)
        signals = self._with(signals, LOAD, self.gain * signals.command - self.offset, states)
        limit = friction_limit(self.effects, LOAD, signals)
        slip = slip_of_mass(signals.load, self.mass * signals.velocity, limit, held.widening)
        return signals.having(load=signals.load - limit * slip)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        rates = state_rates(self.effects, state.get("effects", {}), signals)
        return {"position": state["velocity"], "velocity": signals.load / self.mass, "effects": rates}

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"position": signals.position}

    def constrained(self, state: State) -> State:
        return state


ESTIMATION = "estimation run, fitted"
PUBLISHED = {"mass": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}
RUNS = {"PULSES, unseen": ("DATA_EMPS_PULSES", 9.32), ESTIMATION: ("DATA_EMPS", 6.81)}
"""File and error [mm] of the published parameters in Euler steps of 1 ms."""
FREE = ["mass", "offset", "load_friction.force", "load_damping.coefficient"]


def folder() -> Path | None:
    """Where the data are: the folder named by JAXMUSCLE_DATA, or ../shared/real beside the project."""
    places = [os.environ.get("JAXMUSCLE_DATA"), Path(__file__).parents[2] / "shared" / "real"]
    found = [Path(place) / "emps" for place in places if place and (Path(place) / "emps").is_dir()]
    return found[0] if found else None


def drive(gain: float) -> Drive:
    friction = jm.effects.LoadFriction(force=PUBLISHED["coulomb"])  # pyright: ignore[reportArgumentType]
    damping = jm.effects.LoadDamping(coefficient=PUBLISHED["viscous"])  # pyright: ignore[reportArgumentType]
    bare = Drive(mass=PUBLISHED["mass"], gain=gain, offset=PUBLISHED["offset"])  # pyright: ignore
    return bare.with_effects(load_friction=friction, load_damping=damping)


def recorded(machine: Drive, raw: dict, name: str) -> jm.Recording:
    columns = {"command": raw["vir"].ravel(), "position": raw["qm"].ravel()}
    return jm.recording(machine, columns, 1e-3, name=name)


def error(machine: AbstractActuator, run: jm.Recording) -> float:
    """Root mean square error of the whole run, simulated from its first sample [mm]."""
    predicted = np.asarray(jm.simulate(machine, run).readings["position"])
    return 1e3 * float(np.sqrt(np.mean((predicted - run.columns["position"]) ** 2)))


def text(entry: Row) -> str:
    """A row as text."""
    mark, kind = "ok" if entry["ok"] else "NO", f" ({entry['aside']})" if "aside" in entry else ""
    from_to = f"{entry['published_parameters_here']:.2f} -> {entry['ours']:.2f} mm"
    return (f"{mark} {entry['figure']}{kind}: {from_to} from published to fitted parameters, both in this "
            f"simulator; published {entry['published']:.2f} mm in Euler steps")  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments, root, begin = parser.parse_args(), folder(), time.perf_counter()
    if root is None:
        print("the measured data are not here: name their folder in JAXMUSCLE_DATA", file=sys.stderr)
        return 2
    raw = {name: loadmat(root / f"{file}.mat") for name, (file, _) in RUNS.items()}
    declared = drive(float(raw[ESTIMATION]["gtau"].item()))
    runs = {name: recorded(declared, content, name) for name, content in raw.items()}
    # Millimetres are what the model can be blamed for; the encoder's noise is far below.
    fit = jm.fit(declared, runs[ESTIMATION], FREE, noise={"position": 1e-3}, steps=100)
    rows = [
        drive_run(
            name, published=published, theirs=error(declared, runs[name]),
            ours=error(fit.actuator, runs[name]), fitted=name == ESTIMATION,
        )
        for name, (_, published) in RUNS.items()
    ]  # fmt: skip
    print(*map(text, rows), "", sep="\n")
    print(fit.table()[["value", "std", "unit"]], *fit.notes(), sep="\n")
    if arguments.json:
        machine = platform.processor() or platform.machine()
        print(json.dumps({"benchmark": "real_emps", "rows": rows, **counts(rows),
                          "parameters": {n: [p.value, p.std, p.unit] for n, p in fit.parameters.items()},
                          "machine": machine, "seconds": time.perf_counter() - begin}))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
