"""The arguments of a fit as plain data, with which the same can be asked for again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxmuscle.estimation.arguments import Masks, NoiseLike
from jaxmuscle.estimation.asked import Asked, PriorLike
from jaxmuscle.estimation.loss import Loss
from jaxmuscle.estimation.missing import Mask
from jaxmuscle.fitting.prior import Prior


def as_settings(asked: Asked, rule: Loss, noise: NoiseLike, masks: Masks) -> dict[str, Any]:
    """What :func:`jaxmuscle.fit` was asked for by these names, where it began and for how long apart."""
    each: Any = masks if isinstance(masks, list | tuple) or masks is None else [masks]
    return {
        "free": None if asked.free is None else list(asked.free),
        "priors": {name: _pair(prior) for name, prior in asked.priors.items()},
        "bounds": {name: tuple(pair) for name, pair in asked.bounds.items()},
        "masks": None if each is None else [_listed(mask) for mask in each],
        "loss": rule,
        "noise": {c: float(level) for c, level in noise.items()} if isinstance(noise, Mapping) else noise,
        "shared": list(asked.shared),
        "per_recording": list(asked.per_recording),
        "profiles": list(asked.profiles),
        "continuation": list(asked.continuation),
    }


def _pair(prior: PriorLike) -> tuple[float, float] | None:
    if isinstance(prior, Prior):
        return prior.mean, prior.std
    return None if prior is None else (prior[0], prior[1])


def _listed(mask: Mask | None) -> dict[str, list] | list | None:
    """A mask as lists of booleans."""
    if isinstance(mask, Mapping):
        return {column: np.asarray(rows).tolist() for column, rows in mask.items()}
    return None if mask is None else np.asarray(mask).tolist()
