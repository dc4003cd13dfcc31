r"""Variable projection: what free parameters that are moved along cannot take over of residuals.

Residuals r of a model with an effect, and derivatives F of them by parameters that are free anyway, leave

.. math:: (I - Q Q^T)\,r,\quad F = Q R

(Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973, to first order). An effect is compared by that with others,
and not by what it leaves while these parameters are held.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.residual_layout import ResidualLayout
from jaxmuscle.estimation.residuals import evaluate
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import BROKEN

Vector = Float[np.ndarray, " n"]
Basis = Float[np.ndarray, "n k"]


def basis_of(slopes: Float[np.ndarray, "k n"]) -> Basis:
    """The orthonormal basis of what derivatives span, one of them in each row."""
    return np.linalg.qr(slopes.T)[0]


def outside_span(basis: Basis, vector: Vector) -> Vector:
    """The part of a vector that is orthogonal to a basis."""
    return vector - basis @ (basis.T @ vector)


def weighted_residuals(model: AbstractActuator, problem: Problem, far: Float[np.ndarray, " k"]) -> Vector:
    """Residuals of a model in one vector, which ends with distances `far` of parameters from priors."""
    values = ResidualLayout.of(model, problem).join(evaluate(model, problem))
    return np.concatenate([np.where(np.isfinite(values), values, BROKEN), far])
