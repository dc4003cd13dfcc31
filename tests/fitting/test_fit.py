"""Levenberg-Marquardt through the simulation, on readings of the oracle with white noise."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.recorded import driven_card, driven_recording, smooth_motion

from jaxmuscle.fitting.case import case
from jaxmuscle.fitting.fit import minimise, sensitivities
from jaxmuscle.fitting.free import free
from jaxmuscle.fitting.vector import residual_vector
from jaxmuscle.parameters import get, replace

TRUE = {
    "muscle.initial_radius": bench.CARDS["driven"]["initial_radius"],
    "muscle.end_factor": bench.CARDS["driven"]["end_factor"],
    **{f"effects.thread_friction.{name}": value for name, value in bench.THREADS.items()},
}
PATHS = tuple(TRUE)
WIDTH = len(PATHS)
STARTS = {
    "above": {path: 1.3 * value for path, value in TRUE.items()},
    "below": {path: 0.7 * value for path, value in TRUE.items()},
    "mixed": {path: (1.3, 0.7)[i % 2] * value for i, (path, value) in enumerate(TRUE.items())},
}

TURNING = 1.5e-3
"""Velocity below which a sample is left out [m/s]."""


@pytest.fixture(scope="module")
def prepared():
    recording = driven_recording({"thread_friction": bench.THREADS}, driven_card(bench.THREADS), seed=4)
    # Where the motion turns, dry friction is what the last digit of the smoothed velocity makes of it.
    turning = np.abs(smooth_motion(20.0)[2]) < TURNING
    assert turning.mean() < 0.05
    return case(recording, 0.0, turning)


def fitted(prepared, start, *, chosen=PATHS, width=WIDTH, steps=60):
    """The machine fitted from `start` without priors, the minimum and the description of what was free."""
    model = replace(prepared.actuator, start)
    description = free(model, chosen, {}, {}, PATHS)
    index = np.array([PATHS.index(path) for path in chosen])
    minimum = minimise(model, prepared.training, description, index, width, steps)
    return description.apply(model, jnp.asarray(minimum.z)), minimum, description


def deviations(prepared, model, description):
    """Standard deviations of the parameters: (JᵀJ)⁻¹ at the minimum, in their own units."""
    here = free(model, PATHS, {}, {}, PATHS)
    _, scaled = sensitivities(model, prepared.training, here, np.arange(len(PATHS)), WIDTH)
    return np.sqrt(np.diag(np.linalg.inv(scaled @ scaled.T))) * np.asarray(here.scale)


@pytest.mark.parametrize("start", STARTS)
def test_recovers_the_parameters(prepared, start):
    model, minimum, description = fitted(prepared, STARTS[start])
    assert minimum.converged
    values = np.array([float(get(model, path)) for path in PATHS])
    true = np.array(list(TRUE.values()))
    std = deviations(prepared, model, description)
    assert (std < 0.15 * true).all(), "the data tell the parameters"
    np.testing.assert_array_less(np.abs(values - true), 4 * std)
    # Half the sum of squares of white noise, with five degrees of freedom less.
    samples = int(prepared.windows.mask.sum())
    assert minimum.cost == pytest.approx(0.5 * (samples - 5), abs=4 * np.sqrt(samples / 2))


def test_spare_tangents_change_nothing(prepared):
    exact, minimum, _ = fitted(prepared, STARTS["mixed"])
    wide, padded, _ = fitted(prepared, STARTS["mixed"], width=WIDTH + 4)
    assert padded.converged
    assert padded.cost == pytest.approx(minimum.cost, rel=1e-6)
    for path in PATHS:
        assert float(get(wide, path)) == pytest.approx(float(get(exact, path)), rel=1e-4)


def test_what_is_not_chosen_stays(prepared):
    start = {**TRUE, "muscle.end_factor": 1.1 * TRUE["muscle.end_factor"]}
    model, minimum, _ = fitted(prepared, start, chosen=("muscle.initial_radius",))
    for path in PATHS[1:]:
        assert float(get(model, path)) == float(get(replace(prepared.actuator, start), path))
    assert not minimum.z[1:].any()
    # A muscle that pulls less at the same contraction is made up for by a thicker one.
    assert float(get(model, PATHS[0])) > 1.01 * TRUE[PATHS[0]]


def test_step_limit(prepared):
    """The best point so far, and no claim to have converged."""
    _, begun, description = fitted(prepared, STARTS["above"], steps=1)
    model = replace(prepared.actuator, STARTS["above"])
    residual, _ = sensitivities(model, prepared.training, description, np.arange(len(PATHS)), WIDTH)
    start = 0.5 * float((residual**2).sum())
    assert not begun.converged
    assert begun.steps == 1
    assert begun.cost <= start * (1 + 1e-12)  # the same sum in another order
    assert fitted(prepared, STARTS["above"])[1].cost < 0.01 * start


def test_more_free_than_laid_out(prepared):
    with pytest.raises(ValueError, match="5 parameters are free, but the fit was laid out for 3"):
        fitted(prepared, STARTS["above"], width=3)


@pytest.mark.parametrize("width", [2, WIDTH, WIDTH + 3])
def test_sensitivities_are_finite_differences(prepared, width):
    """Whatever the number of tangents that are pushed at a time."""
    model = replace(prepared.actuator, STARTS["mixed"])
    description = free(model, PATHS, {}, {}, PATHS)
    value, slopes = sensitivities(model, prepared.training, description, np.arange(len(PATHS)), width)
    at = lambda z: np.asarray(residual_vector(model, prepared.training, description, z))  # noqa: E731
    np.testing.assert_allclose(value, at(jnp.zeros(len(PATHS))), rtol=1e-9, atol=1e-9)
    for direction, slope in zip(np.eye(len(PATHS)), slopes, strict=True):
        difference = (at(jnp.asarray(1e-5 * direction)) - at(jnp.asarray(-1e-5 * direction))) / 2e-5
        np.testing.assert_allclose(slope, difference, atol=1e-5 * np.abs(difference).max())
