"""What a command makes a machine do: its track, from a start of one's own."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.parameters import entries_of, split_index
from jaxmuscle.simulation import Track


def sampling_step(times: ArrayLike) -> float:
    """The step of uniform sampling instants [s]; `ValueError` when they are not at least two and uniform."""
    steps = np.diff(np.asarray(times, dtype=float))
    if steps.ndim != 1 or len(steps) < 1 or steps.min() <= 0 or np.ptp(steps) > 0.01 * steps.mean():
        raise ValueError("expected at least two uniform, increasing instants")
    return float(steps.mean())


def commanded_track(
    actuator: AbstractActuator, command: Array, step: Array, start: Mapping[str, ArrayLike]
) -> Track:
    """The track of a command of shape (samples, *muscles) from `start`, else from what the rig rests at.

    The step, the command, the start and the actuator may be traced. `ValueError` for an unknown start.
    """
    states = {name: actuator.at_rest(name) for name in (*actuator.measured, *actuator.derivatives)}
    known = {path for name, value in states.items() for path in (name, *entries_of(name, value))}
    if unknown := set(start) - known:
        raise ValueError(f"unknown start {sorted(unknown)}; expected some of {sorted(states)}")
    for path, value in start.items():
        name, index = split_index(path)
        whole = jnp.asarray(value, dtype=float)
        states[name] = whole if index is None else states[name].at[index].set(whole)
    samples = command.shape[0]
    measured = {name: jnp.broadcast_to(value, (samples, *value.shape)) for name, value in states.items()}
    return Track(step, command, measured)
