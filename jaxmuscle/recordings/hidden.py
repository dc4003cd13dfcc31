"""Hidden states with which a run is to begin, checked."""

from __future__ import annotations

from collections.abc import Mapping

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.parameters import entries_of, split_index
from jaxmuscle.simulation import Track, start_at_rest


def is_measured(actuator: AbstractActuator, name: str) -> bool:
    """Whether a state, or an entry of one (``pressure[1]``), is measured or the rate of a measured one."""
    return split_index(name)[0] in {*actuator.measured, *actuator.derivatives}


def hidden_start(
    actuator: AbstractActuator, track: Track, given: Mapping[str, ArrayLike]
) -> dict[str, Array]:
    """The values `given` to states that are not measured, as arrays of the shapes of these states.

    Raises:
        ValueError: no such state, no such entry of it, or a value of another shape.
    """
    if not given:
        return {}
    rest = jax.eval_shape(lambda actuator, track: start_at_rest(actuator, track), actuator, track)
    states = {**rest.state, **rest.state["effects"], **rest.memory}
    # A lag's or a play operator's state is one array; that of an effect with several has no name for each.
    shapes = {name: v.shape for name, v in states.items() if isinstance(v, jax.ShapeDtypeStruct)}
    known = {path: () for name, shape in shapes.items() for path in entries_of(name, jnp.empty(shape))}
    known |= shapes
    if unknown := set(given) - set(known):
        raise ValueError(f"unknown start {sorted(unknown)}; expected some of {sorted(shapes)}")
    values = {name: jnp.asarray(value, dtype=float) for name, value in given.items()}
    for name, value in values.items():
        if value.shape not in ((), known[name]):
            raise ValueError(f"start of {name}: expected the shape {known[name]}; got {value.shape}")
    return {name: jnp.broadcast_to(value, known[name]) for name, value in values.items()}
