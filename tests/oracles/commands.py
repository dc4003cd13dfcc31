"""What acts of a command, substep by substep: late, of limited rate, off centre, dead near 0."""

import numpy as np
from oracles.plays import behind_play


def acting(effects, command, before, step, substeps):
    """The command in each substep, as a list; before its first sample it was `before`.

    In this order: dead time; a largest rate (per second, as its inverse); a play of the spool; an offset; a
    dead band of `width` to either side of 0.
    """
    command = np.asarray(command, dtype=float)
    delay = effects.get("command_delay", {}).get("delay", 0.0)
    told = _late(np.asarray(before, dtype=float), command, delay / step, substeps)
    if slow := effects.get("rate_limit", {}).get("inverse_rate", 0.0):
        told = limited(told, before, step / substeps / slow)
    if half := effects.get("valve_hysteresis", {}).get("half_width", 0.0):
        told = behind_play(told, half, before)
    told = told + effects.get("valve_offset", {}).get("offset", 0.0)
    width = effects.get("dead_band", {}).get("width", 0.0)
    told = told - np.clip(told, -width, width) if width else told
    return told.tolist()


def _late(before, command, lag, substeps):
    """The mean over each substep of the command of `lag` samples ago, which switches once in it at most."""
    begin = np.arange(len(command) * substeps) / substeps - lag
    end = begin + 1 / substeps
    past = (end - np.maximum(begin, np.floor(end))) * substeps
    past = past.reshape(-1, *[1] * (command.ndim - 1))

    def held(time):
        first = (time < 0).reshape(past.shape)
        return np.where(first, before, command[np.clip(np.floor(time), 0, len(command) - 1).astype(int)])

    return (1 - past) * held(begin) + past * held(end)


def limited(told, before, most):
    """The mean over each substep of what follows `told` by at most `most` a substep."""
    at, means = np.broadcast_to(np.asarray(before, dtype=float), told.shape[1:]), np.empty_like(told)
    for i, aim in enumerate(told):
        after = at + np.clip(aim - at, -most, most)
        at, means[i] = after, (at + after) / 2
    return means
