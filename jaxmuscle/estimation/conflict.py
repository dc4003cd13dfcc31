"""How far each prior is from what all else says of its parameter."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.fitted import Fitted
from jaxmuscle.estimation.minimum import Minimum
from jaxmuscle.estimation.unknowns import Unknowns

Vector = NDArray[np.float64]

CONTRADICTED = 4.0
"""Distance of a prior from the data, in standard deviations of their difference, that contradicts."""
HEARD, NEAR = 4e-4, 0.2
"""Part of a prior's variance that the data take away below which a value this near to the prior's mean, in
its standard deviations, is not judged: a fit ends within a twentieth of one from the minimum."""


def with_conflicts(parameters: Mapping[str, Fitted], minimum: Minimum) -> dict[str, Fitted]:
    r"""The parameters, with the conflict of each prior that is contradicted.

    A value that moved from its prior's mean by d is :math:`d / \sqrt{s^2 - p^2}` standard deviations off, s
    that of the prior, p that of the fit (Evans and Moshonov 2006; Presanis et al. 2013): however narrow the
    prior is. Where that is much, the fit without this prior is looked at, one linear step away, with the
    residuals that it has: those beside a contradicted prior go together and would hide the conflict.
    """
    found, unknowns, u = dict(parameters), minimum.unknowns, minimum.u
    free = np.flatnonzero(~minimum.held)
    away, sharpness = unknowns.prior_residuals(u), unknowns.prior_slopes
    matrix, gradient = np.diag(sharpness**2), away * sharpness
    for line in minimum.lines:
        weighted = minimum.loss.weighted(line.slopes, line.residual)
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
        alone = _without_prior(minimum, int(i), step).covariance().std[i]
        far = abs(away[i] + sharpness[i] * step[i]) / np.hypot(1.0, sharpness[i] * alone)
        if far > CONTRADICTED:
            name = unknowns.names[i]
            found[name] = dataclasses.replace(found[name], conflict=float(far))
    return found


def _without_prior(minimum: Minimum, i: int, step: Vector) -> Minimum:
    """A linear step away, and without the prior of the i-th unknown."""
    lines = [dataclasses.replace(x, residual=x.residual + step @ x.slopes * x.counts) for x in minimum.lines]
    entries = list(minimum.unknowns.entries)
    entries[i] = dataclasses.replace(entries[i], prior=None)
    return dataclasses.replace(minimum, lines=lines, unknowns=Unknowns(entries))
