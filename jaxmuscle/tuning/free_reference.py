"""A loop whose reference is free: from values at knots to what it costs and how far limits are broken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.digital import check_clocks
from jaxmuscle.control.feedback import Attached
from jaxmuscle.control.loop import ClosedLoop
from jaxmuscle.control.sliding_mode import Reference, target_of
from jaxmuscle.errors import InputError
from jaxmuscle.tuning.cases import Case, stacked
from jaxmuscle.tuning.cost_terms import Objective, sensitivity, sizes_of
from jaxmuscle.tuning.evaluation import Rig
from jaxmuscle.tuning.gains import Movable
from jaxmuscle.tuning.run_limits import Fence, Limit, fence, limited
from jaxmuscle.tuning.scenarios import Scenario, with_delays

Vector = NDArray[np.float64]


class Planning(eqx.Module):
    """A loop whose reference is free: from values at knots to residuals and excesses, scenario by scenario.

    Attributes:
        splines: samples × knots, of the reference, its rate and its acceleration.
        rates: whether the controller follows a :class:`~jaxmuscle.control.Reference`.
    """

    rig: Rig
    cases: Case
    splines: tuple[Array, Array, Array]
    fences: dict[str, Fence]
    origin: Array
    span: Array
    rates: bool = eqx.field(static=True)

    def reference(self, x: Array) -> Any:
        """What the loop is told at coordinates x of the knots."""
        values = self.origin + self.span * x
        whole = tuple(spline @ values for spline in self.splines)
        return Reference(*whole) if self.rates else whole[0]

    def run(self, x: Array, case: Case) -> tuple[Rig, ClosedLoop]:
        """The rig and the run of one scenario."""
        own = self.rig.within(case)
        told = eqx.tree_at(lambda entry: entry.reference, case.told, self.reference(x))
        return own, own.run(jnp.zeros(0), eqx.tree_at(lambda c: c.told, case, told))

    def excess(self, loop: ClosedLoop) -> dict[str, Array]:
        """Limit → how far it is broken at every sample, below and above; less than zero within."""
        return {name: own.excess(limited(name, loop)) for name, own in self.fences.items()}

    def parts(self, x: Array) -> tuple[Array, Array]:
        """Residuals and excesses of all scenarios."""

        def of(case: Case) -> tuple[Array, Array]:
            own, loop = self.run(x, case)
            target = case.told.reference
            residuals = own.objective.residuals(own.actuator, loop, target, case.counts)
            over = [part.ravel() for part in self.excess(loop).values()]
            return residuals, jnp.concatenate(over) if over else jnp.zeros(0)

        residuals, over = jax.vmap(of)(self.cases)
        return residuals.ravel() / jnp.sqrt(len(residuals)), over.ravel()


def planning_of(
    actuator: AbstractActuator,
    attached: Attached,
    scenarios: Sequence[Scenario],
    where: Sequence[str],
    objective: Mapping[str, float],
    limits: Mapping[str, Limit] | None,
    knots: int,
    seconds: float | None,
    rates: bool,
) -> tuple[Planning, Vector]:
    """The loop whose reference is free, and the times of the knots."""
    actuator, delayed = with_delays(actuator, scenarios, where)
    together = stacked(actuator, delayed, attached.reading, where)
    check_clocks(attached, together.step)
    if not np.asarray(together.cases.counts).all():
        raise InputError("scenarios: expected scenarios of one length; shorten the longer ones")
    sizes = sizes_of(objective)
    if sensitivity.__name__ in sizes:
        raise InputError("objective: the sensitivity does not depend on the reference")
    times = together.step * np.arange(together.samples)
    places = _places(knots, seconds, float(times[-1]))
    spline = CubicSpline(places, np.eye(knots), bc_type="natural")
    held = times > places[-1]
    at = np.minimum(times, places[-1])
    splines = [np.where(held[:, None] & (order > 0), 0.0, spline(at, order)) for order in range(3)]
    goal = Objective({n: jnp.asarray(s) for n, s in sizes.items()}, None, attached.reading, attached.rest)
    movable = Movable(attached.controller, ())
    rig = Rig(actuator, movable, attached, goal, None, together.step, together.samples)
    targets = np.asarray(target_of(together.cases.told.reference))
    span = float(np.ptp(targets)) or float(np.abs(targets).max()) or 1.0
    fences = {
        name: fence(actuator, name, pair, together.samples, span)
        for name, pair in (limits or {}).items()
    }  # fmt: skip
    bare = jax.tree.map(jnp.asarray, splines)
    origin, scale = jnp.asarray(targets[0, 0]), jnp.asarray(span)
    return Planning(rig, together.cases, (bare[0], bare[1], bare[2]), fences, origin, scale, rates), places


def _places(knots: int, seconds: float | None, last: float) -> Vector:
    """Times of the knots."""
    if isinstance(knots, bool) or not isinstance(knots, int) or knots < 3:
        raise InputError(f"knots: expected a whole number from 3 on; got {knots!r}")
    end = last if seconds is None else seconds
    if not 0 < end <= last * (1 + 1e-9):
        raise InputError(
            f"seconds: expected a time above zero and up to the last sample, {last:g} s; got {end!r}"
        )
    return np.linspace(0.0, end, knots)
