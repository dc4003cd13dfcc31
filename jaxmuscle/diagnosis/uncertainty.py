"""How sure the fitted values are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.result import Estimate
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.fitting.problem import Problem
from jaxmuscle.parameters import get, parameters


def estimates(
    bench: Workbench,
    model: AbstractActuator,
    effects: Sequence[str],
    problem: Problem,
    folds: Sequence[AbstractActuator] = (),
) -> tuple[dict[str, Estimate], pd.DataFrame]:
    """Values, standard deviations and correlations of all fitted parameters, by path.

    For each parameter the largest of three standard deviations is given: that of Gauss and Newton,
    (JᵀJ)⁻¹, for independent residuals; the sandwich (JᵀJ)⁻¹ (Σ g gᵀ) (JᵀJ)⁻¹ with g the gradient of one
    window, which allows for any correlation within a window (Liang and Zeger 1986); and the
    delete-a-group jackknife over `folds`, models of the same effects each fitted without a part of the data
    (Kott, J. Official Statistics 17, 2001), which allows for what the model lacks.
    """
    paths = bench.free_paths(model, effects)
    residual, slopes = bench.jacobian(model, problem, paths, effects)
    scale = np.linalg.norm(slopes, axis=1)
    scale = np.where(scale > 0, scale, 1.0)
    sizes = [problem.targets[link.output].size for link in model.links]
    covariance = _covariance(residual, slopes / scale[:, None], len(problem.rows), sizes)
    covariance = covariance / np.outer(scale, scale)
    own = np.sqrt(np.diag(covariance))
    std = np.maximum(own, _jackknife(paths, folds))
    entries = parameters(model)
    values = {
        path: Estimate(float(get(model, path)), float(s), entries[path].unit, entries[path].meaning)
        for path, s in zip(paths, std, strict=True)
    }
    safe = np.where(own > 0, own, 1.0)
    return values, pd.DataFrame(covariance / np.outer(safe, safe), index=paths, columns=paths)


def _jackknife(paths: Sequence[str], folds: Sequence[AbstractActuator]) -> Float[np.ndarray, " k"]:
    if len(folds) < 2:
        return np.zeros(len(paths))
    table = np.array([[float(get(model, path)) for path in paths] for model in folds])
    return np.sqrt((len(folds) - 1) * table.var(axis=0))


def _covariance(
    residual: Float[np.ndarray, " n"], slopes: Float[np.ndarray, "k n"], windows: int, sizes: Sequence[int]
) -> Float[np.ndarray, "k k"]:
    """`sizes`: residuals of each output in the order of the residual vector, window after window in each."""
    bread = np.linalg.pinv(slopes @ slopes.T, hermitian=True)
    gradients, begin = np.zeros((windows, len(slopes))), 0
    for size in sizes:
        block = slice(begin, begin + size)
        products = (slopes[:, block] * residual[block]).reshape(len(slopes), windows, -1)
        gradients += products.sum(-1).T
        begin += size
    correction = windows / max(windows - 1, 1)
    sandwich = correction * bread @ (gradients.T @ gradients) @ bread
    ratio = np.sqrt(np.maximum(np.diag(sandwich) / np.maximum(np.diag(bread), 1e-300), 1.0))
    return bread * np.outer(ratio, ratio)
