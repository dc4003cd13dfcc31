r"""Screening of candidates without a search: the part of an error that each may remove, from residuals alone.

An effect of some strength s and shape leaves residuals r; free parameters that then move by little take away
what of r lies in the span of their derivatives F = QR. So it leaves about

.. math:: \min_{s, shape} \tfrac12 |(I - Q Q^T)\,r(s, shape)|^2

(:mod:`~jaxmuscle.diagnosis.variable_projection`), found from the best of many trials by a few Gauss-Newton
steps over s and the shape. From the minimum the free parameters take a few steps with the same F (the chord
method), which gives a cost that is reached. All that takes residuals alone, not the derivatives of a model
with the effect: to compile those takes longer than all of it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import paths_of, shapes, strength_path, strengths
from jaxmuscle.diagnosis.evidence import gain
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.diagnosis.variable_projection import basis_of, outside_span, weighted_residuals
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.free_parameters import Unknowns, moved_machine
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameters import get, parameters, replace

CHORDS = 3
"""Steps of the free parameters beside an effect."""
TURNS = 3
"""Steps of an effect's own parameters from the best of its trials. Of a sprocket beside its centre all phases
that are tried may be far from its own: it seemed to remove less than a mismatch of muscles that imitates
it, which leaves 1.5 noise units (joint 122030 of `blind_recordings.drawn`)."""
DIFFERENCE = 1e-4
"""Step of a difference quotient, in coordinates (:class:`~jaxmuscle.estimation.free_parameters.Unknowns`)."""
SMALL, SHRINKING, SMALLEST = 0.1, 0.1, 1e-14
"""Root mean square change, in units of the noise, at which residuals are linear in a strength; factor by
which strengths fall until it is reached; the least that is tried (SI)."""

Vector = Float[np.ndarray, " n"]


def parts_removed(
    bench: Workbench,
    accepted: Sequence[str],
    effects: Sequence[type[AbstractEffect]],
    problem: Problem,
    present: SettledFit,
) -> list[float]:
    """Part of the excess error that each of `effects` may remove, about.

    Args:
        accepted: names of what the model has without them; `present`: its fit to `problem`.
    """
    free = _FreeParameters.of(bench, bench.dressed(present.model, accepted), accepted, problem, present)
    before = bench.losses(free.model, problem)

    def removed(effect: type[AbstractEffect]) -> float:
        dressed = bench.dressed(present.model, [*accepted, effect.name])
        best = min(_trials(dressed, effect, free), key=lambda trial: float((free.rest(trial) ** 2).sum()))
        own = bench.unknowns(best, paths_of(best, effect.name), [*accepted, effect.name])
        return gain(before, bench.losses(free.moved(_turned(best, own, free)), problem))

    return on_all_cores(removed, effects)


@dataclasses.dataclass(frozen=True)
class _FreeParameters:
    """Parameters that are free anyway, about a fitted model.

    Attributes:
        problem: with the weights of that model's fit.
        noise: root mean square of the residuals that noise leaves.
        paths, unknowns: the parameters.
        slopes: derivatives of the residual vector, which ends with the distances from the priors, by their
            coordinates; `basis`: of the span of these.
    """

    model: AbstractActuator
    problem: Problem
    noise: float
    paths: Sequence[str]
    unknowns: Unknowns
    slopes: Float[np.ndarray, "k n"]
    basis: Float[np.ndarray, "n k"]

    @classmethod
    def of(
        cls,
        bench: Workbench,
        model: AbstractActuator,
        accepted: Sequence[str],
        problem: Problem,
        present: SettledFit,
    ) -> _FreeParameters:
        weighed = bench.seen_by(model, problem).reweighted(present.factors)
        paths = bench.free_paths(model, accepted)
        unknowns = bench.unknowns(model, paths, accepted)
        _, by_value = bench.jacobian(model, weighed, paths, accepted)
        slopes = by_value * unknowns.slopes(unknowns.coordinates(unknowns.start))[:, None]
        noise = present.noise_in_residuals(problem)
        return cls(model, weighed, noise, paths, unknowns, slopes, basis_of(slopes))

    def residuals(self, model: AbstractActuator) -> Vector:
        """Weighted residuals, and the distances of the model's parameters from the priors."""
        far = self.unknowns.prior_residuals(self._coordinates(model))
        return weighted_residuals(model, self.problem, far)

    def rest(self, model: AbstractActuator) -> Vector:
        """Residuals that the free parameters cannot take over."""
        return outside_span(self.basis, self.residuals(model))

    def moved(self, model: AbstractActuator) -> AbstractActuator:
        """`model` where its cost is least along a few steps of the free parameters."""
        reached = []
        for _ in range(CHORDS + 1):
            residuals = self.residuals(model)
            reached.append((float((residuals**2).sum()), model))
            step, *_ = np.linalg.lstsq(self.slopes.T, -residuals, rcond=None)
            u = np.clip(self._coordinates(model) + step, self.unknowns.lower, self.unknowns.upper)
            model = moved_machine(model, self.unknowns, u, 0)
        return min(reached, key=lambda pair: pair[0])[1]

    def _coordinates(self, model: AbstractActuator) -> Vector:
        return self.unknowns.coordinates(np.array([float(get(model, path)) for path in self.paths]))


def _trials(
    model: AbstractActuator, effect: type[AbstractEffect], free: _FreeParameters
) -> Iterator[AbstractActuator]:
    """`model`, and with strengths of an effect over the whole range, and its shapes."""
    yield model
    path = strength_path(effect)
    for shape in shapes(effect):
        shaped = replace(model, shape)
        if path in shape:
            yield shaped
            continue
        at = lambda strength, shaped=shaped: replace(shaped, {path: strength})  # noqa: E731
        none, nonnegative = free.residuals(shaped), parameters(model)[path].nonnegative
        slope = _slope(lambda strength, at=at: free.residuals(at(strength)), none, free.noise)
        linear = _projected(outside_span(free.basis, none), outside_span(free.basis, slope))
        several = strengths(slope, none, nonnegative, free.noise)
        for strength in [abs(linear) if nonnegative else linear, *several]:
            yield at(strength)


def _turned(model: AbstractActuator, own: Unknowns, free: _FreeParameters) -> AbstractActuator:
    """`model` after a few Gauss-Newton steps of the effect's `own` parameters, as long as less is left."""
    at = lambda u: moved_machine(model, own, u, 0)  # noqa: E731
    u, least = own.coordinates(own.start), free.rest(model)
    for _ in range(TURNS if len(own) > 1 else 0):
        far = np.where(u + DIFFERENCE > own.upper, -DIFFERENCE, DIFFERENCE)
        slopes = [(free.rest(at(u + step)) - least) / step.sum() for step in np.diag(far)]
        step, *_ = np.linalg.lstsq(np.stack(slopes, axis=1), -least, rcond=None)
        further = np.clip(u + np.clip(step, -own.reach, own.reach), own.lower, own.upper)
        rest = free.rest(at(further))
        if not rest @ rest < least @ least:
            break
        u, least = further, rest
    return at(u)


def _slope(left: Callable[[float], Vector], none: Vector, noise: float) -> Vector:
    """Derivative of the residuals with respect to a strength whose size nothing is known of."""
    strength, counting = SHRINKING, max(np.count_nonzero(none), 1)
    change = left(strength) - none
    while np.sqrt((change**2).sum() / counting) > SMALL * noise and strength > SMALLEST:
        strength *= SHRINKING
        change = left(strength) - none
    return change / strength


def _projected(residual: Vector, direction: Vector) -> float:
    """Strength of the linear step along `direction` that leaves least of `residual`."""
    norm = float(direction @ direction)
    return -float(direction @ residual) / norm if norm > 0 else 0.0
