"""Steps of one length."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.stepping.methods import step
from jaxmuscle.stepping.plan import Field, Finish, Plan


def in_fixed_steps(plan: Plan, field: Field, finish: Finish, state: Any, memory: Any) -> tuple[Any, Any]:
    """From a sample to the next in steps of one length."""

    # Reverse mode computes a step again rather than write down what every operation of it gave.
    @partial(jax.checkpoint, prevent_cse=False)
    def substep(begin: Array, carry: tuple[Any, Any]) -> tuple[Any, Any]:
        state, memory = carry
        end = begin + plan.width
        if state:
            state, _ = step(plan.solver, field(memory), begin, end, state)
        return finish(state, memory, end, plan.width)

    if isinstance(plan.substeps, Array):
        onward = lambda i, carry: substep(i * plan.width, carry)  # noqa: E731
        return jax.lax.fori_loop(0, plan.substeps, onward, (state, memory))
    if plan.substeps == 1:
        return substep(jnp.zeros(()), (state, memory))
    begins = jnp.arange(plan.substeps) * plan.width
    return jax.lax.scan(lambda carry, begin: (substep(begin, carry), None), (state, memory), begins)[0]
