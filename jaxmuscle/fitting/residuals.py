"""Weighted residuals of a machine on a recording: each link of the chain, each window, each sample."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.fitting.predictions import link_predictions
from jaxmuscle.fitting.problem import Problem, Residuals

BROKEN = 1e4
"""Residual that stands for a prediction that is not a number: large, but no end to the fit."""


def residuals(actuator: AbstractActuator, problem: Problem) -> Residuals:
    """Weighted residuals (predicted - measured) of all links."""
    predicted = link_predictions(actuator, problem)
    return {out: weighted(predicted[out], problem, out) for out in predicted}


def weighted(predicted: Array, problem: Problem, output: str) -> Array:
    """Weighted residual of one output; what is not a number counts as :data:`BROKEN`."""
    residual = (predicted - problem.targets[output]) * problem.weights[output]
    return jnp.where(jnp.isfinite(residual), jnp.clip(residual, -BROKEN, BROKEN), BROKEN)


evaluate = eqx.filter_jit(residuals)
"""Weighted residuals, compiled once for each structure of a model."""
