"""What acts of a command, substep by substep: late, of limited rate, off centre, dead near 0."""

import numpy as np


def acting(effects, command, before, step, substeps, full=1.0):
    """The command in each substep, as a list; before its first sample it was `before`.

    In this order: dead time; a rate that is limited (per second); an offset, as a share of the `full`
    command; a dead band, within `width` to either side of 0.
    """
    command = np.asarray(command, dtype=float)
    delay = effects.get("command_delay", {}).get("delay", 0.0)
    # The middle of a substep lies on the right side of every switch of the command.
    late = (np.arange(len(command) * substeps) + 0.5) / substeps - delay / step
    rows = np.maximum(late, 0.0).astype(int)
    told = np.where((late >= 0).reshape(-1, *[1] * (command.ndim - 1)), command[rows], before)
    if limit := effects.get("rate_limit", {}).get("rate", 0.0):
        told = limited(told, before, limit * step / substeps)
    told = told + effects.get("valve_offset", {}).get("offset", 0.0) * full
    width = effects.get("dead_band", {}).get("width", 0.0)
    told = told - np.clip(told, -width, width) if width else told
    return told.tolist()


def limited(told, before, most):
    """The mean over each substep of what follows `told` by at most `most` a substep."""
    at, means = np.broadcast_to(np.asarray(before, dtype=float), told.shape[1:]), np.empty_like(told)
    for i, aim in enumerate(told):
        after = at + np.clip(aim - at, -most, most)
        at, means[i] = after, (at + after) / 2
    return means
