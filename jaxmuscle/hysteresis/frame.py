"""Frame's rule for minor loops, from the major loop and the last reversals, and the mid-line beside it."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis.operators import AbstractHysteresis
from jaxmuscle.parameters import Scalar, parameter

DEPTH = 32
"""Reversals that are remembered; beyond them the oldest pair inside the major loop is forgotten."""

Points = Float[Array, "points 2"]
Table = Float[Array, " points"]


class Turns(eqx.Module):
    """Where the input stands, and the reversals (input, output) from the saturations on, the last at the end.

    The first two are the saturations at the high and the low end; the way goes from the last point towards
    the one before it.
    """

    points: Points
    count: Int[Array, ""]
    value: Scalar


class FrameRule(AbstractHysteresis):
    r"""Minor loops by Frame et al. (1982) as [H] 2.4 tells it.

    A way from the last reversal heads for the previous-to-last one, and beyond it as if that loop had not
    been. Its distance D from the half of the major loop with the same sense, taken along the input, changes
    linearly with the output y:

    .. math:: u = U(y) - D(y),\quad D(y) = D_{rev} + (D_{ptl} - D_{rev})\frac{y - y_{rev}}{y_{ptl} - y_{rev}}

    with U the input of the major loop at y. Starts from the low saturation; saturates outside the tables.
    """

    inputs: Table = parameter("{input}", "inputs of the major loop, increasing")
    rising: Table = parameter("{output}", "outputs of the major loop at the inputs, going up; increasing")
    falling: Table = parameter("{output}", "outputs of the major loop at the inputs, coming down; increasing")

    def __check_init__(self) -> None:
        """Raise `InputError` for tables that are no major loop."""
        tables = {name: getattr(self, name) for name in ("inputs", "rising", "falling")}
        if any(isinstance(table, jax.core.Tracer) for table in tables.values()):
            return
        shapes = {name: table.shape for name, table in tables.items()}
        if len(set(shapes.values())) > 1 or self.inputs.ndim != 1 or len(self.inputs) < 2:
            raise InputError(f"expected three tables of one length for the major loop; got {shapes}")
        for name, table in tables.items():
            steps = jnp.diff(table)
            if not bool((steps > 0).all() if name == "inputs" else (steps >= 0).all() & (steps > 0).any()):
                raise InputError(
                    f"{name} has to increase along the major loop; sort it by input, smooth its noise"
                )

    def rest(self) -> Turns:
        ends = jnp.stack([self.inputs, 0.5 * (self.rising + self.falling)], axis=-1)
        points = jnp.zeros((DEPTH, 2)).at[0].set(ends[-1]).at[1].set(ends[0])
        return self.update(Turns(points, jnp.asarray(2), self.inputs[0]), jnp.zeros(()))

    def update(self, memory: Turns, value: Scalar) -> Turns:
        value = jnp.clip(value, self.inputs[0], self.inputs[-1])
        going_up = memory.count % 2 == 0
        turned = jnp.where(going_up, value < memory.value, value > memory.value)
        point = jnp.stack([memory.value, self._on_the_way(memory, memory.value)])
        added = _pushed(memory, point)
        memory = jax.tree.map(lambda new, old: jnp.where(turned, new, old), added, memory)
        return _without_closed_loops(Turns(memory.points, memory.count, value))

    def output(self, memory: Turns, value: Scalar) -> Scalar:
        memory = self.update(memory, value)
        return self._on_the_way(memory, memory.value)

    def _on_the_way(self, memory: Turns, value: Scalar) -> Scalar:
        """Output at an input between the last reversal and the one before it."""
        going_up = memory.count % 2 == 0
        branch = jnp.where(going_up, self.rising, self.falling)
        last, before = memory.points[memory.count - 1], memory.points[memory.count - 2]
        here, there = (jnp.interp(p[1], branch, self.inputs) - p[0] for p in (last, before))
        span = before[1] - last[1]
        share = (branch - last[1]) / jnp.where(span == 0, 1.0, span)
        distance = here + (there - here) * jnp.clip(share, 0.0, 1.0)
        low, high = jnp.minimum(last[1], before[1]), jnp.maximum(last[1], before[1])
        return jnp.clip(jnp.interp(value, self.inputs - distance, branch), low, high)


def midline(rule: FrameRule, values: ArrayLike) -> Float[Array, " samples"]:
    """The middle of the major loop at each input, [H] 2.5: what is left when hysteresis is given up."""
    return jnp.interp(jnp.asarray(values), rule.inputs, 0.5 * (rule.rising + rule.falling))


def _pushed(memory: Turns, point: Float[Array, " 2"]) -> Turns:
    """With one reversal more; when there is no room the oldest pair after the saturations goes."""
    full = memory.count == DEPTH
    shifted = jnp.concatenate([memory.points[:2], memory.points[4:], jnp.zeros((2, 2))])
    points = jnp.where(full, shifted, memory.points)
    count = jnp.where(full, memory.count - 2, memory.count)
    return Turns(points.at[count].set(point), count + 1, memory.value)


def _without_closed_loops(memory: Turns) -> Turns:
    """Without the pairs of reversals that the input has passed: the loops that it has closed."""

    def closed(count: Array) -> Array:
        goal = memory.points[jnp.maximum(count - 2, 0), 0]
        passed = jnp.where(count % 2 == 0, memory.value >= goal, memory.value <= goal)
        return passed & (count > 3)

    count = jax.lax.while_loop(closed, lambda count: count - 2, memory.count)
    return Turns(memory.points, count, memory.value)
