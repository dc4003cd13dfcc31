"""How to get from a sample to the next: the method, its steps, and what is done in and after each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

Field = Callable[[Any], Callable[[Any, Any, Any], Any]]
"""Memories → the vector field (time, state, nothing) → rates under them."""
Finish = Callable[[Any, Any, Array, Array], tuple[Any, Any]]
"""(state, memories, its time, step) → state and memories after contacts and play operators have acted."""


class Plan(eqx.Module):
    """How to get from a sample to the next.

    Attributes:
        solver: a method.
        substeps: steps between two samples; under error control, the fewest.
        width: length of one of them [s].
        tolerance: of steps under error control; `None` for fixed ones.
        rates: state → whether it is the rate of another.
    """

    solver: Any
    substeps: int | Array
    width: Array
    tolerance: Float[Array, ""] | None
    rates: Any
