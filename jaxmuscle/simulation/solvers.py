"""Explicit, stabilised and exponential Runge-Kutta methods for diffrax, by name, and one step of a method.

This is the door to diffrax: no other module imports it.

Dry friction that is smoothed over millimetres per second makes an otherwise tame machine stiff along the
negative real axis. The second-order Runge-Kutta-Chebyshev method of Sommeijer, Shampine and Verwer
(J. Comput. Appl. Math. 88, 1998) with four stages is stable for step·rate up to 9.8, against 2 for the two
stages of Heun's method. Its stages are a loop over their coefficients, in which the vector field stands once:
what is compiled is half as large (diagnoses of lifted masses spend 30 to 40 % less on it), and sweeps and
derivatives run 10 to 20 % faster than with the stages written out.

diffrax keeps the stages of its own methods in an array and loops over them, which refuses forward mode and,
in a batch of short runs, takes five times as long as the arithmetic. These methods carry what the next stage
needs and no more. The coefficients of those with a name there are diffrax's; their stages are written out.

A lightly damped resonance binds an explicit method to steps far shorter than anything that is sampled, and
Chebyshev's lie along the wrong axis. Where the fast part is linear with constant coefficients,
y' = A y + N(t, y), the second-order method ETD2RK of Cox and Matthews (J. Comput. Phys. 176, 2002,
equations 20 to 22) needs the exponential of A once a run and two evaluations a step.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from diffrax import RESULTS
from equinox.internal import ω
from jax.flatten_util import ravel_pytree
from jaxtyping import Array
from numpy.polynomial import Chebyshev

from jaxmuscle._linalg import Propagator, propagator
from jaxmuscle.actuators.actuator import AbstractActuator, State

STAGES = 4
DAMPING = 2 / 13


class Stage(NamedTuple):
    r"""Stage j at t_0 + f h: D_j = a D_{j-1} + b D_{j-2} + h (c F_{j-1} + d F_0), with D_j = Y_j - Y_0.

    The paper's recurrence is in Y_j; in the increments rounding is that of the last addition alone.
    """

    last: float
    before: float
    rate: float
    first_rate: float
    node: float


def stages_of(count: int) -> list[Stage]:
    """Coefficients of the method with `count` ≥ 2 stages: equations (2.5)-(2.9) of the paper."""
    w0 = 1 + DAMPING / count**2
    basis = [Chebyshev.basis(j) for j in range(count + 1)]
    value = np.array([p(w0) for p in basis])
    slope = np.array([p.deriv()(w0) for p in basis])
    curve = np.array([p.deriv(2)(w0) for p in basis])
    w1 = slope[count] / curve[count]
    b = np.empty(count + 1)
    b[2:] = curve[2:] / slope[2:] ** 2
    b[:2] = b[2]
    a = 1 - b * value
    found = [Stage(0.0, 0.0, float(b[1] * w1), 0.0, float(b[1] * w1))]
    nodes = [0.0, found[0].node]
    for j in range(2, count + 1):
        mu, nu, rate = 2 * b[j] * w0 / b[j - 1], -b[j] / b[j - 2], 2 * b[j] * w1 / b[j - 1]
        first = -a[j - 1] * rate
        nodes.append(mu * nodes[j - 1] + nu * nodes[j - 2] + rate + first)
        found.append(Stage(*map(float, (mu, nu, rate, first, nodes[j]))))
    return found


class OneStepMethod(diffrax.AbstractSolver):
    """A method that carries nothing from step to step; between steps its solution is a straight line."""

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar[Callable[..., Any]] = diffrax.LocalLinearInterpolation

    def init(self, terms, t0, t1, y0, args) -> None:
        """Nothing is carried from step to step."""

    def func(self, terms, t0, y0, args) -> Any:
        """The vector field."""
        return terms.vf(t0, y0, args)


class ChebyshevRungeKutta(OneStepMethod):
    """Second order; with four stages stable on the negative real axis up to step·rate = 9.8."""

    stages: int = eqx.field(static=True, default=STAGES)

    def order(self, terms: object) -> int:
        """Order of the method."""
        return 2

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step from `t0` to `t1`."""
        del solver_state, made_jump
        width = t1 - t0
        stages = stages_of(self.stages)
        # Each stage takes the rate where the one before it ended; the first one, that at the begin.
        nodes = jnp.asarray([0.0, *(stage.node for stage in stages[:-1])])

        def onward(carry: Any, known: tuple[Stage, Array, Array]) -> tuple[Any, None]:
            before, last, first = carry
            stage, node, begins = known
            rate = terms.vf(t0 + node * width, (y0**ω + last**ω).ω, args)
            first = jax.tree.map(lambda old, new: jnp.where(begins, new, old), first, rate)
            slope = stage.rate * rate**ω + stage.first_rate * first**ω
            after = (stage.last * last**ω + stage.before * before**ω + width * slope).ω
            return (last, after, first), None

        still = (0.0 * y0**ω).ω
        table = jax.tree.map(lambda *coefficient: jnp.asarray(coefficient), *stages)
        known = (table, nodes, jnp.arange(self.stages) == 0)
        (_, last, _), _ = jax.lax.scan(onward, (still, still, still), known)
        y1 = (y0**ω + last**ω).ω
        return y1, None, {"y0": y0, "y1": y1}, None, RESULTS.successful


class RungeKutta(OneStepMethod):
    r"""One step: :math:`k_i = f(t + c_i h, y + h \sum_j a_{ij} k_j),\ y_1 = y + h \sum_i b_i k_i`.

    The error is :math:`h \sum_i (b_i - \hat b_i) k_i` with the weights of the embedded method.

    Attributes:
        name: of a diffrax method: "Heun", "Bosh3", "Dopri5".
    """

    name: str = eqx.field(static=True)

    def order(self, terms: object) -> int:
        """Order of the method."""
        return getattr(diffrax, self.name)().order(terms)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step from `t0` to `t1`, with the estimate of its error."""
        del solver_state, made_jump
        table = getattr(diffrax, self.name).tableau
        width = t1 - t0
        rates = [terms.vf(t0, y0, args)]
        for row, node in zip(table.a_lower, table.c, strict=True):
            at = (y0**ω + width * _sum(row, rates)).ω
            rates.append(terms.vf(t0 + float(node) * width, at, args))
        y1 = (y0**ω + width * _sum(table.b_sol, rates)).ω
        error = (width * _sum(table.b_error, rates)).ω
        return y1, error, {"y0": y0, "y1": y1}, None, RESULTS.successful


def _sum(weights: Any, rates: list[Any]) -> Any:
    """Weighted sum of trees, without the terms of weight zero."""
    pairs = zip(weights, rates, strict=True)
    return sum(float(weight) * rate**ω for weight, rate in pairs if weight != 0)


class ExponentialHeun(OneStepMethod):
    """ETD2RK over steps of the width for which its propagator was made; Heun's method where A is zero."""

    propagator: Propagator

    def order(self, terms: object) -> int:
        """Order of the method."""
        return 2

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step from `t0` to `t1`."""
        del solver_state, made_jump
        p = self.propagator
        begin, unpack = ravel_pytree(y0)
        field = lambda time, y: ravel_pytree(terms.vf(time, unpack(y), args))[0]  # noqa: E731
        before = field(t0, begin) - p.matrix @ begin
        first = p.whole @ begin + p.first @ before
        after = field(t1, first) - p.matrix @ first
        y1 = unpack(first + p.second @ (after - before))
        return y1, None, {"y0": y0, "y1": y1}, None, RESULTS.successful


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
