"""Jacobian in forward mode by structural sparsity: slopes by the inputs on which outputs can depend."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import jaxpr_as_fun
from jax.interpreters.partial_eval import dce_jaxpr
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

Leaves = list[Array]
Tangents = list[Array | None]
"""A leaf's derivatives by those values that act on it, in their order (leading axis); `None`: it has none."""


class Traced:
    """A function of several numbers and a few arrays, traced once.

    Attributes:
        acting: whether an output can depend on a number, as far as the operations tell: what is computed from
            it and then not used does not count, what happens to be zero does.
        passing: whether an output can depend on an array.
        shapes: of the outputs.
    """

    acting: Bool[np.ndarray, "outputs values"]
    passing: Bool[np.ndarray, "outputs given"]

    def __init__(
        self,
        function: Callable[[Leaves, Leaves], Leaves],
        values: Float[Array, " values"],
        given: Sequence[Array | jax.ShapeDtypeStruct],
    ) -> None:
        """Trace `function` (numbers, arrays) → arrays; of the arrays only the shapes matter."""
        numbers = [jax.ShapeDtypeStruct((), values.dtype)] * len(values)
        closed = jax.make_jaxpr(function)(numbers, list(given))
        results: Any = closed.out_avals
        self.shapes = [jax.ShapeDtypeStruct(each.shape, each.dtype) for each in results]
        outputs = range(len(closed.jaxpr.outvars))
        used = [dce_jaxpr(closed.jaxpr, [i == k for i in outputs])[1] for k in outputs]
        table = np.array(used, dtype=bool).reshape(len(outputs), len(numbers) + len(given))
        self.acting, self.passing = table[:, : len(numbers)], table[:, len(numbers) :]
        self._call = jaxpr_as_fun(closed)

    def __call__(self, values: Float[Array, " values"], given: Leaves) -> Leaves:
        """The function itself."""
        return list(self._call(*values, *given))

    def reached(self, by_given: Sequence[Bool[np.ndarray, " values"]]) -> Bool[np.ndarray, "outputs values"]:
        """Whether an output depends on a number, itself or by way of the arrays that `by_given` tells of."""
        through = [(row[:, None] & np.array(by_given)).any(axis=0) for row in self.passing if len(by_given)]
        return self.acting | np.array(through) if through else self.acting


def slopes_of(
    traced: Traced,
    values: Float[Array, " values"],
    given: Leaves,
    tangents: Sequence[Array | None],
    by_given: Sequence[Bool[np.ndarray, " values"]],
) -> tuple[Leaves, Tangents, list[Bool[np.ndarray, " values"]]]:
    """Outputs, their derivatives by the numbers that act on any of them, and which act on each.

    All derivatives go through one evaluation in forward mode, with a tangent for every acting number.

    Args:
        tangents: derivatives of the arrays, a row for each number that acts on any of them.
        by_given: the numbers that act on each array.
    """
    reached = traced.reached(by_given)
    columns = np.flatnonzero(reached.any(axis=0))
    if not len(columns):
        found = traced(values, given)
        return found, [None] * len(found), list(reached)
    rows = np.flatnonzero(np.array(by_given).any(axis=0)) if len(by_given) else np.zeros(0, dtype=int)
    moving = [k for k, slope in enumerate(tangents) if slope is not None and traced.passing[:, k].any()]
    along = [_spread(tangents[k], rows, columns) for k in moving]

    def run(values: Array, some: Leaves) -> Leaves:
        whole = list(given)
        for k, leaf in zip(moving, some, strict=True):
            whole[k] = leaf
        return traced(values, whole)

    def pushed(direction: Array, some: Leaves) -> Any:
        return jax.jvp(run, (values, [given[k] for k in moving]), (direction, some))

    found, slopes = jax.vmap(pushed, out_axes=(None, 0))(jnp.eye(len(values))[columns], along)
    acted = [bool(row.any()) for row in reached]
    return found, [slope if act else None for slope, act in zip(slopes, acted, strict=True)], list(reached)


def _spread(slope: Any, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    """Derivatives by the numbers `rows` as derivatives by the numbers `columns`; zero by the others."""
    place = {int(row): i for i, row in enumerate(rows)}
    index = np.array([place.get(int(column), len(rows)) for column in columns])
    return jnp.concatenate([slope, jnp.zeros_like(slope[:1])])[index]
