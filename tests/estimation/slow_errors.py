"""Recordings of a joint and a lift whose sensors have errors that last."""

import numpy as np
from oracles import bench

import jaxmuscle as jm

NOISE = {"pressure": 400.0, "pressure_1": 400.0, "pressure_2": 400.0, "angle": 4e-4, "position": 3e-5}
SLOW = 0.3
"""Seconds over which the errors of readings go together."""
JOINT = {"load_damping": {"coefficient": 0.05}}
MACHINES = {"joint": bench.model("joint", **JOINT), "isotonic": bench.model("isotonic")}
COMMANDS = {"joint": bench.joint_command(), "isotonic": bench.isotonic_command()}
TRACKS = {"joint": bench.joint_track, "isotonic": bench.isotonic_track}


def errors(rng, rows, step):
    """As much of an error that lasts as of one that does not, each of the size of the noise."""
    stays, kicks = np.exp(-step / SLOW), rng.normal(size=rows)
    slow = [kicks[0]]
    for kick in kicks[1:]:
        slow.append(stays * slow[-1] + np.sqrt(1 - stays**2) * kick)
    return np.array(slow) + rng.normal(size=rows)


def recorded(rig, seed=0, command=None):
    """Readings with slow errors, and what they would be without any."""
    machine, step = MACHINES[rig], bench.STEPS[rig]
    command = COMMANDS[rig] if command is None else command
    readings = bench.simulated(machine, TRACKS[rig](command), 4).readings
    true = {}
    for output, names in machine.outputs.items():
        table = np.asarray(readings[output]).reshape(len(command), -1)
        true |= {name: table[:, i] for i, name in enumerate(names)}
    rng = np.random.default_rng(seed)
    columns = {name: values + NOISE[name] * errors(rng, len(values), step) for name, values in true.items()}
    table = np.asarray(command).reshape(len(command), -1)
    columns |= {name: table[:, i] for i, name in enumerate(machine.commands)}
    noise = {name: NOISE[name] for name in true}
    return jm.recording(machine, columns, step, noise=noise, horizon=0.4, name=rig), true
