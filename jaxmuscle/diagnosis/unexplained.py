"""What the final model leaves unexplained, and where it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from jaxmuscle.diagnosis.rates import MissingRate
from jaxmuscle.diagnosis.result import Error, Unexplained
from jaxmuscle.diagnosis.unknown import dependence, variables
from jaxmuscle.fitting.case import Case

SURPRISE = 3.0
"""Ratio of errors on unseen and on training data above which the training data did not tell all."""
UNEXPLAINED = 3.0
"""Root mean square weighted residual of a link (1 = noise) above which something is left unexplained."""


def unexplained(
    case: Case,
    missing: Sequence[MissingRate],
    squares: Mapping[str, float],
    after: Mapping[str, Mapping[str, Error]],
) -> tuple[Unexplained, ...]:
    """Links whose residual the final model leaves large, on the training data or only on unseen data."""
    left = []
    for rate in missing:
        rms = float(np.sqrt(squares[rate.link.output]))
        for column in case.actuator.outputs[rate.link.output]:
            seen, unseen = (after[part][column].in_noise for part in ("training", "held_out"))
            if unseen > SURPRISE * max(seen, 1.0):
                rms = max(rms, unseen)
        if rms > UNEXPLAINED:
            found = dependence(rate, variables(case), case)
            left.append(Unexplained(rate.link.signal, found.share, found.variables, rms))
    return tuple(left)
