"""A controller in the loop: at every sample it turns readings into the command until the next one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
from jaxtyping import Array

Readings = dict[str, Array]


class Feedback(eqx.Module):
    """A sampled controller as a run takes it.

    Attributes:
        start: its state at the first sample, any tree of arrays.
        update: (state, readings at a sample, number of the sample) → (state, command until the next).
    """

    start: Any
    update: Callable[[Any, Readings, Array], tuple[Any, Array]]
