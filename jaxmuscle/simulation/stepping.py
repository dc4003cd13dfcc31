"""Steps from one sample to the next, of one length or of a length that follows from the estimated error.

Whatever the method, unilateral contacts act and play operators are brought up to date at the end of each
step, without error of their own. The command is held between samples, so each sample is a fresh start.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.simulation.command_switch import Switch
from jaxmuscle.simulation.solvers import order, step

Field = Callable[..., Callable[[Any, Any, Any], Any]]
"""Memories, whether the command has switched → the field (time, state, nothing) → rates under them."""
Finish = Callable[..., tuple[Any, Any]]
"""(state, memories, its time, step, whether the command has switched) → state and memories after contacts and
play operators have acted."""


class Plan(eqx.Module):
    """How to get from a sample to the next.

    Attributes:
        solver: a method.
        substeps: steps between two samples; under error control, the fewest.
        width: length of one of them [s].
        tolerance: of steps under error control; `None` for fixed ones.
        rates: state → whether it is the rate of another.
        remade: whether reverse mode computes fixed steps again rather than keep what each operation gave.
        switch: where fixed steps are laid by a switch of the command; there is one more of them.
    """

    solver: Any
    substeps: int | Array
    width: Array
    tolerance: Float[Array, ""] | None
    rates: Any
    remade: bool = eqx.field(static=True, default=True)
    switch: Switch | None = None

    @property
    def count(self) -> int | Array:
        """Number of fixed steps between two samples."""
        return self.substeps if self.switch is None else self.substeps + 1

    def step(self, number: int | Array) -> tuple[Array, Array, Any, Array | None]:
        """Begin and end of a fixed step [s], its method, whether the command has switched by then."""
        if self.switch is not None:
            return self.switch.step(jnp.asarray(number))
        begin = number * self.width
        return begin, begin + self.width, self.solver, None


def in_fixed_steps(plan: Plan, field: Field, finish: Finish, state: Any, memory: Any) -> tuple[Any, Any]:
    """From a sample to the next in steps of one length."""

    def substep(number: int | Array, carry: tuple[Any, Any]) -> tuple[Any, Any]:
        state, memory = carry
        begin, end, solver, switched = plan.step(number)
        if state:
            state, _ = step(solver, field(memory, switched), begin, end, state)
        return finish(state, memory, end, end - begin, switched)

    if plan.remade:
        substep = jax.checkpoint(substep, prevent_cse=False)
    if isinstance(plan.count, Array):
        return jax.lax.fori_loop(0, plan.count, substep, (state, memory))
    if plan.count == 1:
        return substep(jnp.zeros(()), (state, memory))
    numbers = jnp.arange(plan.count)
    return jax.lax.scan(lambda carry, number: (substep(number, carry), None), (state, memory), numbers)[0]


SMALLEST = 2.0**-14
"""Shortest controlled step, as a share of the sampling step; it is taken whatever its error."""
LEAST = 1e-3
"""Size below which the tolerance of a state becomes absolute [SI unit of the state]."""
SAFETY, SLOWEST, FASTEST = 0.9, 0.2, 4.0
"""Share of the step that the error would allow, and limits of the change from a step to the next."""


class Course(eqx.Module):
    """What error control carries along: the next step [s], and the largest value that each state has had."""

    step: Array
    largest: Any


def begin_course(longest: Array, state: Any) -> Course:
    """At the first sample of a run: the longest step, the state as it is."""
    return Course(longest, jax.tree.map(lambda leaf: jax.lax.stop_gradient(jnp.abs(leaf)), state))


def in_controlled_steps(
    plan: Plan, field: Field, finish: Finish, state: Any, memory: Any, course: Course
) -> tuple[Any, Any, Course]:
    r"""From a sample to the next in steps whose error stays below the tolerance.

    .. math:: \max_i \frac{|e_i|}{\mathrm{tol} \max(Y_i, 10^{-3})} ≤ 1

    e: embedded estimate of a step's error plus what a contact moved back, for all states that are not
    rates of another (an impact stops these at once, however short the step). Y_i: largest value that state
    i has had. The next step is that of the usual controller, 0.9 h (error)^(-1/order), between a fifth and
    four times the last (Hairer, Nørsett and Wanner, II.4). Step sizes are constants for derivatives.
    """
    assert plan.tolerance is not None
    solver, width, longest = plan.solver, plan.width * plan.substeps, plan.width
    tolerance = plan.tolerance
    power = -1 / order(solver, field(memory))

    def again(carry: Any) -> Array:
        return carry[0] < width

    def onward(carry: Any) -> Any:
        time, course, state, memory = carry
        left = width - time
        # What is left is divided evenly, so that no sliver remains for a last step.
        parts = jnp.ceil(left / course.step - 1e-6)
        size = left / parts
        end = jnp.where(parts <= 1, width, time + size)
        raw, estimate = step(solver, field(memory), time, end, state)
        after, new_memory = finish(raw, memory, end, size)
        largest = jax.tree.map(lambda a, b: jnp.maximum(a, jnp.abs(b)), course.largest, after)
        moved = jax.tree.map(lambda a, b, rate: jnp.where(rate, 0.0, a - b), after, raw, plan.rates)
        error = _ratio(estimate, moved, largest, tolerance)
        accept = (error <= 1) | (size <= SMALLEST * width)
        factor = jnp.clip(SAFETY * jnp.maximum(error, 1e-12) ** power, SLOWEST, FASTEST)
        kept = Course(course.step, jax.lax.stop_gradient(largest))
        # A step that was cut at the sample does not make the next one shorter.
        wish = jnp.where(
            accept & (size < course.step), jnp.maximum(course.step, size * factor), size * factor
        )
        following = jnp.clip(wish, SMALLEST * width, longest)
        choose = lambda new, old: jax.tree.map(lambda a, b: jnp.where(accept, a, b), new, old)  # noqa: E731
        time, kept, state, memory = choose((end, kept, after, new_memory), (time, course, state, memory))
        return time, Course(jax.lax.stop_gradient(following), kept.largest), state, memory

    begin = (jnp.zeros_like(width), course, state, memory)
    _, course, state, memory = jax.lax.while_loop(again, onward, begin)
    return state, memory, course


def _ratio(estimate: Any, moved: Any, largest: Any, tolerance: Array) -> Array:
    """Largest error over all states relative to what is allowed; infinite where it is not a number."""
    allowed = jax.tree.map(lambda size: tolerance * jnp.maximum(size, LEAST), largest)
    shares = jax.tree.map(lambda e, m, a: jnp.max((jnp.abs(e) + jnp.abs(m)) / a), estimate, moved, allowed)
    worst = jnp.max(jnp.stack(jax.tree.leaves(shares)))
    return jax.lax.stop_gradient(jnp.where(jnp.isfinite(worst), worst, jnp.inf))


def advance(
    plan: Plan, field: Field, finish: Finish, state: Any, memory: Any, course: Course | None
) -> tuple[Any, Any, Course | None]:
    """State, memories and step control at the next sample; without states only memories change."""
    if course is None or not state:
        return *in_fixed_steps(plan, field, finish, state, memory), course
    return in_controlled_steps(plan, field, finish, state, memory, course)
