"""Cost of gains over scenarios, with its derivatives through the whole closed loop; what runs look like."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle._config import cores
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.feedback import Attached
from jaxmuscle.control.loop import ClosedLoop, closed_loop
from jaxmuscle.control.sliding_mode import Reference, target_of
from jaxmuscle.control.stability_margins import is_stable, loop_response, sensitivity
from jaxmuscle.estimation.free_parameters import Unknowns
from jaxmuscle.optimization.descents import Local
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameters import replace
from jaxmuscle.simulation.run import Derivatives
from jaxmuscle.tuning.cases import Case, Sensed, Stacked
from jaxmuscle.tuning.cost_terms import Objective
from jaxmuscle.tuning.gains import Movable

MOST_FORWARD = 60
"""Free gains up to which the derivatives of residuals are computed, one pass forward for each of them."""
WIDEST = 16
"""Scenarios in one program at most: with more, what a step touches no longer fits into a core's cache."""
MANY = 4
"""Scenarios in one program from which on derivatives are computed apart from the values: four of a joint take
0.65 of the time so, with six gains; with two of the robot a program is compiled in 26 s for 9 s, and is no
quicker."""

Vector = NDArray[np.float64]


class Rig(eqx.Module):
    """A machine, the controller that is tuned, what is made small, and the clock.

    Attributes:
        controller: of one reading where it is `attached` to the machine by it, else of the whole machine.
        widening: factor by which dry friction is smoothed more widely; `None` where it never is.
    """

    actuator: AbstractActuator
    controller: Movable
    attached: Attached | None
    objective: Objective
    widening: Array | None
    step: float = eqx.field(static=True)
    samples: int = eqx.field(static=True)

    def within(self, case: Case) -> Rig:
        """The same with the machine of a scenario, and with commands that rest where its own do."""
        if not case.changes:
            return self
        machine = replace(self.actuator, case.changes)
        if self.attached is None:
            return dataclasses.replace(self, actuator=machine)
        attached = self.attached.on(self.actuator, machine)
        objective = dataclasses.replace(self.objective, rest=attached.rest)
        return dataclasses.replace(self, actuator=machine, attached=attached, objective=objective)

    def run(self, gains: Array, case: Case, derivatives: Derivatives = "any") -> ClosedLoop:
        """One scenario under some gains (SI), on its machine; derivatives by the gains as they are taken."""
        controller = whole = self.controller.at(gains)
        if self.attached is not None:
            whole = eqx.tree_at(lambda loop: loop.controller, self.attached, controller)
        return closed_loop(
            self.actuator,
            Sensed(whole, case.resolution),
            case.told,
            np.arange(self.samples) * self.step,
            start=case.start,
            widening=self.widening,
            derivatives=derivatives,
        )

    def residuals(self, gains: Array, case: Case, derivatives: Derivatives = "any") -> Array:
        """What the cost of one scenario is made of, on its machine; derivatives as for :meth:`run`."""
        reference = case.told.reference
        loop = self.run(gains, case, derivatives)
        disturbed = self.disturbed(gains, case)
        return self.objective.residuals(self.actuator, loop, reference, case.counts, disturbed)

    def disturbed(self, gains: Array, case: Case) -> Array | None:
        """Largest sensitivity of the linearised loop, where the objective asks for it."""
        if case.linear is None:
            return None
        rates = isinstance(case.told.reference, Reference)
        own = self.controller.at(gains)
        return sensitivity(loop_response(own, case.linear.response, case.linear.rest, self.step, rates))


@eqx.filter_jit
def _forward(rig: Rig, gains: Array, cases: Case) -> tuple[Array, Array, Array]:
    """Cost of each scenario, gradient and Gauss-Newton matrix by the gains; one forward pass for each."""
    derivatives = "linearised" if len(cases.counts) >= MANY else "any"

    def of(there: Array) -> Array:
        run = lambda case: rig.within(case).residuals(there, case, derivatives)  # noqa: E731
        return jax.vmap(run)(cases)

    def pushed(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(of, (gains,), (tangent,))

    # Scenarios are innermost: the axis along which a core computes several numbers at once.
    r, slopes = jax.vmap(pushed, out_axes=(None, 0))(jnp.eye(len(gains)))
    gradients, matrices = jnp.einsum("ksi,si->sk", slopes, r), jnp.einsum("ksi,lsi->skl", slopes, slopes)
    return jnp.sum(r**2, axis=1), 2 * gradients, 2 * matrices


@eqx.filter_jit
def _reverse(rig: Rig, gains: Array, cases: Case) -> tuple[Array, Array]:
    """Cost of each scenario and its gradient by the gains, by one pass back."""

    def of(case: Case) -> tuple[Array, Array]:
        own = rig.within(case)
        cost = lambda there: own.objective.cost(own.residuals(there, case))  # noqa: E731
        return jax.value_and_grad(cost)(gains)

    return jax.vmap(of)(cases)


class Seen(eqx.Module):
    """Runs of scenarios: cost and terms of each, readings and commands; with a leading axis of scenarios."""

    cost: Float[Array, " scenarios"]
    terms: dict[str, Float[Array, " scenarios"]]
    readings: dict[str, Array]
    commands: Array


@eqx.filter_jit
def _seen(rig: Rig, gains: Array, cases: Case) -> Seen:
    def of(case: Case) -> Seen:
        own, reference = rig.within(case), case.told.reference
        loop, target = own.run(gains, case), target_of(reference)
        disturbed, objective = own.disturbed(gains, case), own.objective
        cost = objective.cost(objective.residuals(own.actuator, loop, reference, case.counts, disturbed))
        terms = objective.values(loop, target, case.counts, disturbed)
        return Seen(cost, terms, loop.readings, loop.commands)

    return jax.vmap(of)(cases)


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """The cost of gains over scenarios as a minimiser asks for it.

    Over n scenarios the cost is :math:`(\\frac1n \\sum_i c_i^p)^{1/p}`, a mean at p = 1 and the worst case in
    the limit: a soft maximum that does not depend on the unit of the cost.

    Where the objective asks for the sensitivity, that of a loop which is unstable, linearised, is infinite,
    and so is the cost: a sensitivity grows without end towards the limit of stability, but beyond it
    :math:`1/|1 + L|` falls again, as it does not count how often L goes round the critical point.

    Attributes:
        rows: the scenarios of `stacked` that count.
        order: p.
        barred: whether an unstable loop costs infinitely much; where no gains are found with which it is
            stable its runs alone have to do.
    """

    rig: Rig
    unknowns: Unknowns
    stacked: Stacked
    rows: tuple[int, ...]
    order: float
    barred: bool = True

    @property
    def forward(self) -> bool:
        """Whether derivatives are those of residuals, by forward passes."""
        return self.rig.objective.squares and len(self.unknowns) <= MOST_FORWARD

    @property
    def width(self) -> int:
        """Scenarios in one program: all cores have some."""
        return int(min(-(-len(self.rows) // cores()), WIDEST))

    @property
    def programs(self) -> int:
        """Programs that a point takes, which run side by side."""
        return -(-len(self.rows) // self.width)

    def unbarred(self) -> Evaluation:
        """The same in which runs alone tell whether a loop is stable."""
        return dataclasses.replace(self, barred=False)

    def widened(self, factor: float) -> Evaluation:
        """The same with dry friction smoothed more widely."""
        rig = dataclasses.replace(self.rig, widening=jnp.asarray(factor, dtype=float))
        return dataclasses.replace(self, rig=rig)

    def unstable(self, values: Sequence[float] | Vector, rows: Sequence[int]) -> NDArray[np.bool_]:
        """In which scenarios the linearised loop is unstable under gains (SI); none where no margin is
        asked for.
        """
        rig, models = self.rig, self.stacked.models
        rates = isinstance(self.stacked.cases.told.reference, Reference)
        own = rig.controller.at(jnp.asarray(values))
        judged = [bool(models) and not is_stable(models[row], own, rig.step, rates) for row in rows]
        return np.array(judged, dtype=bool)

    def _barred(self, point: Vector) -> bool:
        """Whether a point costs infinitely much by its linearised loops, so that no run is needed."""
        return self.barred and bool(self.unstable(self.unknowns.values(point), self.rows).any())

    def __call__(self, points: Float[np.ndarray, "points k"]) -> list[Local]:
        """Cost, gradient and curvature at points in the coordinates of the unknowns."""
        blocks = list(self.stacked.blocks(self.rows, self.width))
        unknowns, program = self.unknowns, _forward if self.forward else _reverse

        def of(task: tuple[Vector, tuple[Case, int]]) -> list[NDArray]:
            point, (cases, own) = task
            found = program(self.rig, jnp.asarray(unknowns.values(point)), cases)
            return [np.asarray(part)[:own] for part in found]

        barred = [self._barred(point) for point in points]
        run = [point for point, no in zip(points, barred, strict=True) if not no]
        parts, found = iter(on_all_cores(of, list(itertools.product(run, blocks)))), []
        for point, no in zip(points, barred, strict=True):
            if no:
                found.append(_nowhere(len(unknowns)))
                continue
            own = list(itertools.islice(parts, len(blocks)))
            joined = [np.concatenate(group) for group in zip(*own, strict=True)]
            found.append(_together(joined, unknowns.slopes(point), self.order))
        return found

    def seen(self, values: Sequence[float] | Vector, rows: Sequence[int]) -> Seen:
        """Runs of any scenarios under gains (SI); what is infinite of an unstable loop is so."""
        blocks = list(self.stacked.blocks(rows, self.width))

        def of(block: tuple[Case, int]) -> Any:
            cases, own = block
            found = _seen(self.rig, jnp.asarray(values), cases)
            return jax.tree.map(lambda leaf: np.asarray(leaf)[:own], found)

        found = jax.tree.map(lambda *leaves: np.concatenate(leaves), *on_all_cores(of, blocks))
        unstable = self.unstable(values, rows)
        if not (self.barred and unstable.any()):
            return found
        most = sensitivity.__name__
        terms = {**found.terms, most: np.where(unstable, np.inf, found.terms[most])}
        cost = np.where(unstable, np.inf, found.cost)
        return dataclasses.replace(found, cost=cost, terms=terms)

    def cost(self, seen: Seen) -> float:
        """The cost that runs together have; infinite where one is not finite."""
        costs = np.asarray(seen.cost)
        if not np.isfinite(costs).all():
            return np.inf
        largest = _largest(costs)
        return largest * float(np.mean((costs / largest) ** self.order)) ** (1 / self.order)


def _largest(costs: Vector) -> float:
    """By which costs are divided before they are raised to a power: a number of any size stays one."""
    return max(float(costs.max()), 1e-300)


def _nowhere(size: int) -> Local:
    """Of a point to which no descent goes."""
    return Local(np.inf, np.full(size, np.nan), np.full((size, size), np.nan), 1)


def _together(parts: Sequence[NDArray], slopes: Vector, order: float) -> Local:
    """Cost of all scenarios with its derivatives by the coordinates, from those of each by the values.

    Args:
        parts: costs, gradients and, where there are any, Gauss-Newton matrices.
        slopes: of the values by the coordinates.
    """
    costs, gradients = parts[0], parts[1] * slopes
    if not (np.isfinite(costs).all() and np.isfinite(gradients).all()):
        return _nowhere(len(slopes))
    largest = _largest(costs)
    shares = (costs / largest) ** (order - 1)
    mean = float(np.mean((costs / largest) ** order)) or 1e-300
    cost = largest * mean ** (1 / order)
    weights = shares / len(costs) * mean ** (1 / order - 1)
    gradient = weights @ gradients
    if len(parts) < 3:
        # As much curvature as there is at least where a cost is a square that falls to zero.
        curvature = float(gradient @ gradient) / (2 * cost) if cost > 0 else 0.0
        return Local(cost, gradient, curvature * np.eye(len(slopes)), 0)
    matrix = np.einsum("i,ijk->jk", weights, parts[2]) * np.outer(slopes, slopes)
    if order > 1:
        among = weights / np.maximum(costs, 1e-12 * largest)
        spread = np.einsum("i,ij,ik->jk", among, gradients, gradients) - np.outer(gradient, gradient) / cost
        matrix = matrix + (order - 1) * spread
    return Local(cost, gradient, matrix, 0)
