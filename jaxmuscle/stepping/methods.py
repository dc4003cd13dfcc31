"""The door to diffrax: methods by name, and one step of a method."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator, State
from jaxmuscle.chebyshev import ChebyshevRungeKutta
from jaxmuscle.exponential import ExponentialHeun
from jaxmuscle.propagator import propagator
from jaxmuscle.runge_kutta import RungeKutta

METHODS: dict[str, Callable[[], Any]] = {
    "chebyshev": ChebyshevRungeKutta,
    "heun": partial(RungeKutta, "Heun"),
    "bogacki-shampine": partial(RungeKutta, "Bosh3"),
    "dormand-prince": partial(RungeKutta, "Dopri5"),
}
"""Methods by name: second order and stabilised, second, third and fifth order."""
CONTROLLED = ("bogacki-shampine", "dormand-prince")
"""Methods that estimate their own error, the first of them the one that is taken unless another is named."""


def method_for(actuator: AbstractActuator, state: State, free: Any, width: Array, name: str | None) -> Any:
    """The method of a name; without one the stabilised method, or for a fast linear part the exponential one.

    Args:
        free: the part of `state` that is integrated.
        width: step [s], for which the exponential method is made.
    """
    if name is not None:
        return METHODS[name]()
    if not actuator.linear_part(state):
        return ChebyshevRungeKutta()
    packed, unpack = ravel_pytree(free)
    still = jax.tree.map(jnp.zeros_like, state)

    def linear(packed: Array) -> Array:
        own = unpack(packed)
        rates = actuator.linear_part({**still, **own})
        return ravel_pytree({name: rates.get(name, still[name]) for name in own})[0]

    return ExponentialHeun(propagator(jax.jacfwd(linear)(jnp.zeros_like(packed)), width))


def step(solver: Any, field: Callable[..., Any], begin: Array, end: Array, state: Any) -> tuple[Any, Any]:
    """One step of a method: the state at `end`, and the error as the method estimates it (or `None`)."""
    term = diffrax.ODETerm(field)
    kept = solver.init(term, begin, end, state, None)
    after, error, *_ = solver.step(term, begin, end, state, None, kept, made_jump=False)
    return after, error


def order(solver: Any, field: Callable[..., Any]) -> Any:
    """Order of a method, by which its error falls with the step."""
    return solver.order(diffrax.ODETerm(field))
