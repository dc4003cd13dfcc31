"""Standard deviations of fitted values, against the oracle's sensitivities and against what scatters."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxmuscle.diagnosis.uncertainty import estimates
from numpy.typing import ArrayLike
from oracles import bench
from oracles.driven import driven
from oracles.recorded import NOISE, STDS, driven_card, driven_recording, smooth_motion

from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.fitting.case import case
from jaxmuscle.fitting.residuals import residuals
from jaxmuscle.parameters import get, replace
from jaxmuscle.recordings import read
from jaxmuscle.samples import sample

PATHS = ["muscle.initial_radius", "muscle.end_factor"]
TRUE = {name: bench.CARDS["driven"][name] for name in STDS}


def estimated(extra: ArrayLike = 0.0, seed=0, fit=False):
    """Estimates by path and their correlations, at the truth or where a fit ends."""
    prepared = case(driven_recording({}, driven_card({}), seed=seed, extra=extra), 0.0)
    tools = workbench(prepared.actuator, prepared.priors, ())
    model = tools.fit(tools.model, [], prepared.training, 30)[0] if fit else tools.model
    return estimates(tools, model, [], prepared.training)


@pytest.fixture(scope="module")
def covariance():
    """Of the parameters, from central differences of the oracle's force and the card's priors."""
    motion, slopes = smooth_motion(20.0), []
    for name, value in TRUE.items():
        forces = [driven({**bench.CARDS["driven"], name: value * f}, {}, *motion) for f in (1.0001, 0.9999)]
        slopes.append((forces[0] - forces[1]) / (2e-4 * value) / NOISE)
    information = np.array(slopes) @ np.array(slopes).T + np.diag([1 / std**2 for std in STDS.values()])
    return np.linalg.inv(information)


def test_white_noise(covariance):
    """Gauss and Newton's covariance; the sandwich, estimated from 40 windows, may only widen it."""
    values, correlations = estimated()
    std = np.sqrt(np.diag(covariance))
    ratio = [values[path].std / expected for path, expected in zip(PATHS, std, strict=True)]
    assert min(ratio) > 0.999
    assert max(ratio) < 1.5
    assert correlations.loc[PATHS[0], PATHS[1]] == pytest.approx(covariance[0, 1] / std.prod(), abs=0.01)
    np.testing.assert_allclose(np.diag(correlations), 1.0, rtol=1e-9)
    assert [values[path].unit for path in PATHS] == ["m", ""]


def test_deviations_are_those_of_repeated_recordings():
    fits = [estimated(seed=seed, fit=True)[0] for seed in range(12)]
    for path, true in zip(PATHS, TRUE.values(), strict=True):
        z = np.array([(fit[path].value - true) / fit[path].std for fit in fits])
        assert np.abs(z).max() < 4
        assert 0.4 < z.std() < 1.6


def test_errors_that_last_a_window_widen_it(covariance):
    """Forty windows of half a second, each off by a constant: as if there were far fewer samples."""
    offsets = np.repeat(np.random.default_rng(2).normal(size=40), 50)
    lasting, brief = offsets * 3 * NOISE, np.random.default_rng(2).permutation(offsets) * 3 * NOISE
    std = np.sqrt(np.diag(covariance))
    for path, expected in zip(PATHS, std, strict=True):
        assert estimated(lasting)[0][path].std > 8 * expected
        assert estimated(brief)[0][path].std < 6 * expected


def test_links_of_different_width():
    """Two pressures and one angle: every residual counts in the window that it belongs to."""
    prepared = case(read(sample("swing")).part(0, 2500), 0.0)
    tools = workbench(prepared.actuator, prepared.priors, ())
    training, paths = prepared.training, list(prepared.priors)
    start = jnp.array([get(tools.model, path) for path in paths])
    spread = jnp.array([prepared.priors[path].std for path in paths])

    def by_window(values):
        found = residuals(replace(tools.model, dict(zip(paths, values, strict=True))), training)
        return jnp.concatenate([r.reshape(len(training.rows), -1) for r in found.values()], axis=1)

    value, slopes = by_window(start), jax.jit(jax.jacfwd(by_window))(start)
    gradients = np.einsum("ws,wsk->wk", value, slopes)
    # The machine is at the card's values, where its priors have nothing to add to the gradient.
    bread = np.linalg.inv(np.einsum("wsk,wsl->kl", slopes, slopes) + np.diag(np.asarray(spread) ** -2.0))
    windows = len(gradients)
    sandwich = windows / (windows - 1) * bread @ gradients.T @ gradients @ bread
    expected = np.sqrt(np.maximum(np.diag(bread), np.diag(sandwich)))
    values, _ = estimates(tools, tools.model, [], training)
    assert (np.diag(sandwich) > 4 * np.diag(bread)).any()
    np.testing.assert_allclose([values[path].std for path in paths], expected, rtol=1e-4)


def test_fits_that_disagree_widen_the_deviations():
    """Delete-a-group jackknife: (G-1)/G times the sum of squared deviations from the mean of G fits."""
    prepared = case(driven_recording({}, driven_card({})), 0.0)
    tools = workbench(prepared.actuator, prepared.priors, ())
    narrow, _ = estimates(tools, tools.model, [], prepared.training)
    radii = np.array([6.8e-3, 7.1e-3, 7.2e-3])
    folds = [replace(tools.model, {PATHS[0]: radius}) for radius in radii]
    wide, _ = estimates(tools, tools.model, [], prepared.training, folds)
    assert wide[PATHS[0]].std == pytest.approx(np.sqrt(2 / 3 * ((radii - radii.mean()) ** 2).sum()))
    assert wide[PATHS[1]].std == narrow[PATHS[1]].std
