"""Optimal references: what a loop should be told to follow, within limits of readings and commands."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

from jaxmuscle._config import require_double_precision
from jaxmuscle._memory_areas import make_room_for_programs
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.feedback import Attached, feedback_on
from jaxmuscle.control.loop import ClosedLoop
from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.errors import InputError
from jaxmuscle.formatting import quantity
from jaxmuscle.optimization.augmented_lagrangian import (
    Bounded,
    ConstrainedMinimum,
    constrained_least_squares,
)
from jaxmuscle.optimization.least_squares import with_jacobian
from jaxmuscle.tuning.cases import Case
from jaxmuscle.tuning.cost_terms import units
from jaxmuscle.tuning.free_reference import Planning, planning_of
from jaxmuscle.tuning.run_limits import Limit
from jaxmuscle.tuning.scenarios import Scenario

TOLERANCE = 1e-2
"""Excess that counts as none, in units of that which costs one: 1e-4 of the range between limits."""

Vector = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class OptimalReference:
    """A reference that costs least within limits.

    Attributes:
        times: sampling instants [s]; reference: what to tell the loop at each, an array or a
            :class:`~jaxmuscle.control.Reference`.
        knots: times of the knots [s]; values: the reference there (SI).
        runs: one for each scenario.
        before, after: value of every term in each scenario (SI), under the first reference and under this
            one; cost_before, cost: of the objective alone, over the scenarios.
        excess: limit → by how much it is exceeded at most (SI), zero where it is kept.
        multipliers: limit → fall of the cost per unit (SI) by which it were wider, scenario by scenario,
            below and above, sample by sample; zero where it is not reached.
        kept: whether all limits are kept; converged: whether it is a minimum as well.
        evaluations: of the loop with its derivatives.
    """

    times: Float[np.ndarray, " samples"]
    reference: Any
    knots: Float[np.ndarray, " knots"]
    values: Float[np.ndarray, " knots"]
    runs: Sequence[ClosedLoop]
    before: Mapping[str, Float[np.ndarray, " scenarios"]]
    after: Mapping[str, Float[np.ndarray, " scenarios"]]
    cost_before: float
    cost: float
    excess: Mapping[str, float]
    multipliers: Mapping[str, Float[np.ndarray, "scenarios 2 samples ..."]]
    units: Mapping[str, str]
    kept: bool
    converged: bool
    evaluations: int

    def __str__(self) -> str:
        """Costs, terms and limits in readable units."""
        end = "a minimum" if self.converged else "no minimum was reached"
        lines = [
            f"Cost {self.cost_before:.3g} to {self.cost:.3g} with {len(self.knots)} knots ({end}; "
            f"{self.evaluations} evaluations with derivatives)."
        ]
        for name, values in self.after.items():
            pair = (quantity(float(np.max(v)), self.units[name]) for v in (self.before[name], values))
            lines.append(f"{name}: {' to '.join(pair)}")
        for name, over in self.excess.items():
            reached = bool((np.asarray(self.multipliers[name]) > 0).any())
            said = "kept, reached" if reached else "kept, not reached"
            lines.append(f"limit of {name}: {said if self.kept else f'exceeded by {over:.3g} (SI)'}")
        return "\n".join(lines)


def optimal_reference(
    actuator: AbstractActuator,
    controller: Any,
    scenarios: Scenario | Sequence[Scenario],
    objective: Mapping[str, float],
    *,
    limits: Mapping[str, Limit] | None = None,
    knots: int = 12,
    seconds: float | None = None,
    first: ArrayLike | None = None,
    rates: bool = False,
    tolerance: float = TOLERANCE,
    rounds: int = 20,
    steps: int = 60,
) -> OptimalReference:
    r"""Find the reference under which a loop costs least, within limits of what it reads and commands.

    .. math:: \min_w \sum_i (v_i/s_i)^2 \quad\text{where}\quad \underline{y}_k \le y_k \le \overline{y}_k

    The controller stays as it is; free are the values w of the reference at knots, between which it is a
    natural cubic spline (a straight line is one), and after the last of which it stays. Derivatives go
    through the whole closed loop, one pass forward for each knot; limits are kept by an augmented Lagrangian
    (:func:`~jaxmuscle.optimization.augmented_lagrangian.constrained_least_squares`). The command as what is
    free is :func:`~jaxmuscle.control.command_knots`.

    Args:
        controller: of one reading, or an :class:`~jaxmuscle.control.Attached`.
        scenarios: their `reference` is the target that the terms compare the reading with, not what the loop
            is told; of several, the one reference serves all.
        objective: term → its size that costs one (SI), as for :func:`jaxmuscle.tune`, without the
            sensitivity: ``{"arrival": …, "effort": …}`` for least effort, ``{"settling": …}`` for least time.
        limits: reading, "command", or "rate " and one of these → (lowest, highest) in SI, each a number, one
            value for each sample (infinite where there is none) or `None`. A reading that has to be somewhere
            at the end has limits there alone. A rate is that from a sample to the next.
        knots, seconds: how many, equally far apart from the first sample on, and over which time; to the last
            sample when `None`.
        first: values at the knots to begin with; the target there when `None`. What friction holds
            throughout has no slopes.
        rates: whether the controller follows a :class:`~jaxmuscle.control.Reference`.
        tolerance: excess that counts as none, in hundredths of the range between the limits (of the limit's
            size where there is one only).
        rounds, steps: of the multipliers, and of Levenberg-Marquardt in each.

    Raises:
        InputError: a rig without a channel, wrong scenarios, terms or limits, fewer than three knots,
            values to begin with at which the loop runs away.
    """
    require_double_precision("optimal_reference")
    make_room_for_programs()
    given = [scenarios] if isinstance(scenarios, Scenario) else list(scenarios)
    if not given or not all(isinstance(each, Scenario) for each in given):
        raise InputError("scenarios: expected at least one jaxmuscle.tuning.Scenario")
    attached = controller if isinstance(controller, Attached) else feedback_on(actuator, controller)
    where = [f"scenarios[{i}]" for i in range(len(given))]
    planning, places = planning_of(actuator, attached, given, where, objective, limits, knots, seconds, rates)
    target = np.asarray(target_of(planning.cases.told.reference))[0]
    times = planning.rig.step * np.arange(planning.rig.samples)
    begin = np.interp(places, times, target) if first is None else _first(first, knots)
    start = (begin - np.asarray(planning.origin)) / float(planning.span)
    evaluate = with_jacobian(_both, planning)
    count = jax.eval_shape(planning.parts, jnp.zeros(knots))[0].shape[0]

    def function(x: Vector) -> Bounded:
        values, slopes = evaluate(x)
        return Bounded(values[:count], slopes[:count], values[count:], slopes[count:])

    before = function(start).residuals
    if not np.isfinite(before).all():
        raise InputError(
            "the loop runs away at the values to begin with; give first= others, or smaller gains"
        )
    found = constrained_least_squares(function, start, tolerance=tolerance, rounds=rounds, steps=steps)
    return _concluded(planning, places, start, found, float(before @ before))


def _both(x: Array, planning: Planning) -> Array:
    return jnp.concatenate(planning.parts(x))


def _first(first: ArrayLike, knots: int) -> Vector:
    values = np.asarray(first, dtype=float)
    if values.shape not in ((), (knots,)) or not np.isfinite(values).all():
        raise InputError(f"first: expected one finite number, or {knots}; got shape {values.shape}")
    return np.broadcast_to(values, (knots,))


@eqx.filter_jit
def _seen(planning: Planning, x: Array) -> tuple[ClosedLoop, dict[str, Array], dict[str, Array]]:
    """Runs, terms and excesses of all scenarios."""

    def of(case: Case) -> tuple[ClosedLoop, dict[str, Array], dict[str, Array]]:
        own, loop = planning.run(x, case)
        return loop, own.objective.values(loop, case.told.reference, case.counts, None), planning.excess(loop)

    return jax.vmap(of)(planning.cases)


def _concluded(
    planning: Planning, places: Vector, start: Vector, found: ConstrainedMinimum, before: float
) -> OptimalReference:
    rig, x = planning.rig, jnp.asarray(found.x)
    loops, terms, over = _seen(planning, x)
    many = len(planning.cases.counts)
    of_scenarios = found.multipliers.reshape(many, -1)
    multipliers, excess, begin = {}, {}, 0
    for name, each in over.items():
        shape, size = each.shape[1:], float(planning.fences[name].size)
        end = begin + int(np.prod(shape))
        # The cost is twice half the sum of squares, and its mean over the scenarios.
        multipliers[name] = 2 * of_scenarios[:, begin:end].reshape(many, *shape) / size
        excess[name] = max(float(np.asarray(each).max()), 0.0) * size
        begin = end
    reference = jax.tree.map(np.asarray, planning.reference(x))
    tell = lambda tree: {name: np.asarray(value) for name, value in tree.items()}  # noqa: E731
    return OptimalReference(
        times=rig.step * np.arange(rig.samples),
        reference=reference,
        knots=places,
        values=float(planning.origin) + float(planning.span) * found.x,
        runs=[jax.tree.map(lambda leaf, i=i: np.asarray(leaf)[i], loops) for i in range(many)],
        before=tell(_seen(planning, jnp.asarray(start))[1]),
        after=tell(terms),
        cost_before=before,
        cost=2 * found.cost,
        excess=excess,
        multipliers=multipliers,
        units=units(rig.actuator, rig.objective.reading, margin=False),
        kept=found.kept,
        converged=found.converged,
        evaluations=found.evaluations,
    )
