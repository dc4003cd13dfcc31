"""Levenberg-Marquardt method whose Jacobian is brought up to date by secants from step to step.

Where residuals with their derivatives take many times as long as residuals alone (eight times for seven
parameters of an antagonistic joint), most steps get along with a Jacobian that agrees with the last step
(Broyden, Mathematics of Computation 19, 1965): the secant version of the method (Madsen, Nielsen and
Tingleff, "Methods for non-linear least squares problems", 2nd edition, 2004, section 3.5). Derivatives are
taken anew where a step has not brought what was expected of it, after :data:`MOST` secants, and where the
descent would end. On the fits of a diagnosis of such a joint that is a third fewer Jacobians for as many
residuals more.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from jaxmuscle.optimization.descents import BROKEN, STEPS, Lane, Limits, Local, Vector
from jaxmuscle.optimization.levenberg_marquardt import LEAST_FALL, begun, proceed, taken

MOST = 10
"""Secants after which derivatives are taken anew."""
AS_EXPECTED = 0.5, 2.0
"""Fall of the cost over what was expected between which a Jacobian is brought up to date by a secant."""

Residuals = Float[np.ndarray, " n"]
Slopes = Float[np.ndarray, "k n"]


@dataclasses.dataclass(frozen=True)
class Linearised:
    """Residuals at a point and their derivatives, and the secants since these were taken.

    Residuals that are not numbers are kept as such; their derivatives are zeros.
    """

    u: Vector
    residuals: Residuals
    slopes: Slopes
    secants: int = 0

    def at(self, u: Vector, residuals: Residuals, unit: Vector) -> Linearised:
        r"""The same at another point by Broyden's update, the least change in coordinates of `unit`:

        .. math:: J^+ = J + \frac{(r^+ - r - J s)\,(D^2 s)^T}{s^T D^2 s}
        """
        step = u - self.u
        weighted = unit**2 * step
        size = float(step @ weighted)
        missed = residuals - self.residuals - step @ self.slopes
        missed = np.where(np.isfinite(missed), missed, 0.0)
        slopes = self.slopes + (weighted / size)[:, None] * missed if size > 0 else self.slopes
        return Linearised(u, residuals, slopes, self.secants + 1)

    @property
    def local(self) -> Local:
        """Cost, gradient and Gauss-Newton matrix."""
        wrong = ~np.isfinite(self.residuals)
        values = np.where(wrong, 0.0, self.residuals)
        cost = 0.5 * float(values @ values) + 0.5 * BROKEN**2 * int(wrong.sum())
        return Local(cost, self.slopes @ values, self.slopes @ self.slopes.T, int(wrong.sum()))


def descend_by_secants(
    values: Callable[[Vector], Residuals],
    linearised: Callable[[Vector], tuple[Residuals, Slopes]],
    start: Vector,
    limits: Limits,
) -> Lane:
    """Descend from a start.

    Args:
        values: coordinates → residuals, those of the priors among them; NaN for what is not a number.
        linearised: coordinates → residuals and their derivatives, zeros where they are not numbers.
        limits: bounds and tolerances; `limits.lanes` and `limits.deadline` are not used.
    """

    def exact(u: Vector) -> Linearised:
        return Linearised(u, *linearised(u))

    def use(found: Linearised) -> Linearised:
        """Have the next trial made by these derivatives; they may be the first that tell of a coordinate."""
        assert lane.curvature is not None
        lane.local = found.local
        lane.curvature = np.where(lane.curvature > 0, lane.curvature, lane.local.matrix.diagonal())
        return found

    lane = Lane(start.copy(), np.zeros(start.shape, dtype=bool), start.copy(), trial=start.copy())
    here = exact(start)
    if not begun(lane, here.local, limits):
        return lane
    proceed(lane, limits)
    while True:
        if lane.trial is None:
            if not here.secants or lane.code == STEPS:
                return lane
            # No descent ends by derivatives that are only nearly right.
            here, lane.rejected = use(exact(lane.u)), 0
            proceed(lane, limits)
            continue
        assert lane.curvature is not None
        found = here.at(lane.trial, values(lane.trial), np.sqrt(lane.curvature))
        radius = lane.radius
        ratio = taken(lane, found.local)
        if ratio > LEAST_FALL:
            low, high = AS_EXPECTED
            good = found.secants <= MOST and low < ratio < high
            here = use(found if good else exact(lane.u))
        elif here.secants:
            here, lane.rejected, lane.radius = use(exact(lane.u)), 0, radius
        proceed(lane, limits)
