"""How far inside a value may lie that ended at a bound."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.covariance import covariance
from jaxmuscle.estimation.fitted import Fitted
from jaxmuscle.estimation.losses import Loss
from jaxmuscle.estimation.profile import QUANTILE
from jaxmuscle.estimation.series import Series
from jaxmuscle.estimation.unknowns import Unknowns

Vector = NDArray[np.float64]


def with_inner_ends(
    parameters: Mapping[str, Fitted],
    lines: Sequence[Series],
    unknowns: Unknowns,
    loss: Loss,
    u: Vector,
    ends: NDArray[np.int64],
    scores: Float[NDArray, "sources k"] | None = None,
) -> dict[str, Fitted]:
    r"""The parameters, with the inner end of the interval of each that is at a bound.

    The likelihood ratio on the allowed side: inwards by t the deviance rises by :math:`(2 g t + h t^2)/e`,
    g the slope of the cost there, h its curvature with the others fitted anew (those at bounds of their own
    left there), e the excess of the variance over that of independent residuals. It is 3.84 where the
    interval ends. Intervals of 95 % hold a truth at the bound, or near it, at least as often as that
    (Self and Liang 1987, case 5).

    Args:
        u: coordinates of the values; `ends`: -1 for those at a lower bound, 1 at an upper one, else 0.
        lines, scores: as of :func:`jaxmuscle.estimation.covariance.covariance`.
    """
    found = dict(parameters)
    for i in np.flatnonzero(ends):
        others = ends != 0
        others[i] = False
        sure = covariance(lines, unknowns, loss, others, scores)
        slope = sum(float(line.slopes[i] @ (loss.weight(line.residual) * line.residual)) for line in lines)
        slope += float(unknowns.prior_residuals(u)[i] * unknowns.prior_slopes[i])
        # Where the minimum would be without the bound: so far outside.
        outside = -ends[i] * slope * sure.assumed[i] ** 2
        inside = float(np.hypot(outside, QUANTILE * sure.std[i]) - outside)
        moved = u.copy()
        moved[i] = np.clip(u[i] - ends[i] * inside, unknowns.lower[i], unknowns.upper[i])
        name = unknowns.names[i]
        found[name] = dataclasses.replace(found[name], inner=float(unknowns.values(moved)[i]))
    return found
