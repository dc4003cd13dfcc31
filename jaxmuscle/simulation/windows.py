"""Many short predictions along one track, and the observer that tells with which states they begin."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.simulation.run import run
from jaxmuscle.simulation.track import Restarts, Start, Track, start_at_rest


def observe(
    actuator: AbstractActuator, track: Track, samples: int, substeps: int = 1, start: Start | None = None
) -> Start:
    """The states that are not measured, carried along the whole track by the measured ones.

    Every measured state is imposed; openings, hysteresis, creep and lags run on from `start`, else
    from rest at the first sample. Returns them at every sample (leading axis `samples`).
    """
    imposed = (*actuator.measured, *actuator.derivatives)
    start = start_at_rest(actuator, track) if start is None else start
    hidden = tuple(name for name in start.state if name not in imposed)
    row = jnp.asarray(0)
    return run(
        actuator, track, start, row, samples=samples, imposed=imposed, substeps=substeps, keep=hidden
    ).states


def predict(
    actuator: AbstractActuator,
    track: Track,
    rows: Int[Array, " windows"],
    *,
    samples: int,
    imposed: tuple[str, ...],
    substeps: int,
    hidden: Start,
    period: Int[Array, ""] | None = None,
) -> dict[str, Array]:
    """Readings of windows of `samples` samples, each started at its row from the measured state.

    The states that are not measured start from `hidden`, as :func:`observe` gives them; all start anew
    every `period` samples, if one is given. Returns readings with leading axes (windows, samples).
    """
    restarts = Restarts(jnp.asarray(samples if period is None else period), hidden)

    def window(row: Array) -> dict[str, Array]:
        return run(
            actuator,
            track,
            restarts.at(row, track),
            row,
            samples=samples,
            imposed=imposed,
            substeps=substeps,
            restarts=None if period is None else restarts,
        ).readings

    return jax.vmap(window)(rows)
