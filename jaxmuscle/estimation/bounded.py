"""How far inside a value may lie that ended at a bound."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from jaxmuscle.estimation.fitted import Fitted
from jaxmuscle.estimation.minimum import Minimum
from jaxmuscle.estimation.profile import QUANTILE


def with_inner_ends(parameters: Mapping[str, Fitted], minimum: Minimum) -> dict[str, Fitted]:
    r"""The parameters, with the inner end of the interval of each that is at a bound.

    The likelihood ratio on the allowed side: inwards by t the deviance rises by :math:`(2 g t + h t^2)/e`,
    g the slope of the cost there, h its curvature with the others fitted anew (those at bounds of their own
    left there), e the excess of the variance over that of independent residuals. It is 3.84 where the
    interval ends. Intervals of 95 % hold a truth at the bound, or near it, at least as often as that
    (Self and Liang 1987, case 5).
    """
    found, unknowns, u, ends = dict(parameters), minimum.unknowns, minimum.u, minimum.ends
    for i in np.flatnonzero(ends):
        sure = minimum.covariance(minimum.held & (np.arange(len(u)) != i))
        scored = [
            line.slopes[i] @ (minimum.loss.weight(line.residual) * line.residual) for line in minimum.lines
        ]
        slope = float(sum(scored))
        slope += float(unknowns.prior_residuals(u)[i] * unknowns.prior_slopes[i])
        # Where the minimum would be without the bound: so far outside.
        outside = -ends[i] * slope * sure.assumed[i] ** 2
        inside = float(np.hypot(outside, QUANTILE * sure.std[i]) - outside)
        moved = u.copy()
        moved[i] = np.clip(u[i] - ends[i] * inside, unknowns.lower[i], unknowns.upper[i])
        name = unknowns.names[i]
        found[name] = dataclasses.replace(found[name], inner=float(unknowns.values(moved)[i]))
    return found
