"""How far each prior is from what all else says of its parameter."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.covariance import covariance
from jaxmuscle.estimation.fitted import Fitted
from jaxmuscle.estimation.losses import Loss
from jaxmuscle.estimation.series import Series
from jaxmuscle.estimation.unknowns import Unknowns

Vector = NDArray[np.float64]

CONTRADICTED = 4.0
"""Distance of a prior from the data, in standard deviations of their difference, that contradicts."""
HEARD, NEAR = 4e-4, 0.2
"""Part of a prior's variance that the data take away below which a value this near to the prior's mean, in
its standard deviations, is not judged: a fit ends within a twentieth of one from the minimum."""


def with_conflicts(
    parameters: Mapping[str, Fitted],
    lines: Sequence[Series],
    unknowns: Unknowns,
    loss: Loss,
    u: Vector,
    ends: NDArray[np.int64],
    scores: Float[NDArray, "sources k"] | None = None,
) -> dict[str, Fitted]:
    r"""The parameters, with the conflict of each prior that is contradicted.

    A value that moved from its prior's mean by d is :math:`d / \sqrt{s^2 - p^2}` standard deviations off, s
    that of the prior, p that of the fit (Evans and Moshonov 2006; Presanis et al. 2013): however narrow the
    prior is. Where that is much, the fit without this prior is looked at, one linear step away, with the
    residuals that it has: those beside a contradicted prior go together and would hide the conflict.

    Args:
        u: coordinates of the values; `ends`: those at a bound are not 0, and fixed.
        lines, scores: as of :func:`jaxmuscle.estimation.covariance.covariance`.
    """
    found, free = dict(parameters), np.flatnonzero(ends == 0)
    away, sharpness = unknowns.prior_residuals(u), unknowns.prior_slopes
    matrix, gradient = np.diag(sharpness**2), away * sharpness
    for line in lines:
        weighted = line.slopes * loss.weight(line.residual)
        matrix, gradient = matrix + weighted @ line.slopes.T, gradient + weighted @ line.residual
    inner = np.ix_(free, free)
    known = np.diag(np.linalg.pinv(matrix[inner], hermitian=True))
    for i, variance in zip(free, known, strict=True):
        heard = 1 - sharpness[i] ** 2 * variance
        unsure = heard < HEARD and abs(away[i]) < NEAR
        if sharpness[i] == 0 or unsure or abs(away[i]) <= CONTRADICTED * np.sqrt(max(heard, 0.0)):
            continue
        own = np.arange(len(u)) == i
        rest, step = matrix - np.diag(own * sharpness**2), np.zeros(len(u))
        step[free] = -np.linalg.pinv(rest[inner], hermitian=True) @ (gradient - own * away * sharpness)[free]
        moved = [dataclasses.replace(x, residual=x.residual + step @ x.slopes * x.counts) for x in lines]
        entries = [
            dataclasses.replace(e, prior=None) if o else e for e, o in zip(unknowns.entries, own, strict=True)
        ]
        alone = covariance(moved, Unknowns(entries), loss, ends != 0, scores).std[i]
        far = abs(away[i] + sharpness[i] * step[i]) / np.hypot(1.0, sharpness[i] * alone)
        if far > CONTRADICTED:
            name = unknowns.names[i]
            found[name] = dataclasses.replace(found[name], conflict=float(far))
    return found
