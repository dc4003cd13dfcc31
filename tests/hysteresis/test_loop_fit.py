"""Identification of loops: what is put in comes out again, also under noise; what is refused."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built
from oracles.loops import CLASSICAL, GENERALIZED, MODIFIED
from oracles.plays import TABLE_2, modified
from oracles.relays import lopsided, way

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis import ExponentialPrandtlIshlinskii, elbow_modified, respond
from jaxmuscle.hysteresis.loop_fit import best_fit, fit_loop, largest_relative_error
from jaxmuscle.parameters import get, parameters, replace

CORNERS = (0.0, 1.3, -1.3, 1.3, -0.6, 0.8, -0.1, 0.5)
INPUTS = way(CORNERS, 25)


def test_error_is_relative_to_the_range():
    assert largest_relative_error([1.0, 2.0, 3.5], [1.0, 2.0, 3.0]) == pytest.approx(0.25)


def test_classical_model_is_found_again():
    measured = respond(CLASSICAL, INPUTS)[1]
    start = replace(CLASSICAL, {"gain": 1.5, "weights": [0.2, 0.2, 0.2, 0.2], "offset": 0.0})
    found = fit_loop(start, INPUTS, measured, held=("thresholds",))
    assert found.converged and found.rmse < 1e-8
    np.testing.assert_allclose(found.model.weights, CLASSICAL.weights, rtol=1e-6)
    np.testing.assert_array_equal(found.model.thresholds, CLASSICAL.thresholds)


def test_thresholds_are_found_too():
    measured = respond(CLASSICAL, INPUTS)[1]
    start = replace(CLASSICAL, {"thresholds": [0.06, 0.18, 0.5, 0.65], "offset": 0.0})
    found = fit_loop(start, INPUTS, measured, held=("weights", "gain"))
    assert found.rmse < 1e-6
    np.testing.assert_allclose(found.model.thresholds, CLASSICAL.thresholds, atol=1e-4)


@pytest.mark.parametrize("model", [MODIFIED, GENERALIZED], ids=["modified", "generalized"])
def test_envelopes_are_found_again_under_noise(model):
    rng = np.random.default_rng(1)
    noise = 0.01 * rng.normal(size=len(INPUTS))
    free = (
        "rising.height",
        "rising.slope",
        "rising.shift",
        "falling.height",
        "falling.slope",
        "falling.shift",
    )
    wrong = replace(model, {path: 1.15 * get(model, path) for path in free})
    held = [path for path in parameters(model) if path not in free]
    found = fit_loop(wrong, INPUTS, respond(model, INPUTS)[1] + noise, held=held)
    assert found.rmse < 0.011
    for path in free:
        assert float(get(found.model, path)) == pytest.approx(float(get(model, path)), abs=0.03), path


@pytest.mark.slow
def test_table_2_is_refitted_to_the_noise_where_the_classical_model_fails():
    inputs = way((0.0, 6.0, 0.0, 6.0, 0.0), 40)
    truth = np.array(modified(inputs, TABLE_2, 10))
    measured = truth + 0.1 * np.random.default_rng(0).normal(size=len(truth))
    late = slice(40, None)
    wrong = replace(elbow_modified(), {"density": 14.0, "rising.height": 6.0, "falling.level": -0.5})
    held = ("decay", "spacing", "rising.shift", "falling.shift", "falling.slope", "rising.slope")
    refit = fit_loop(wrong, inputs, measured, judged=late, held=held)
    symmetric = built(ExponentialPrandtlIshlinskii, 5.0, 10.0, 0.5, 0.3, -40.0)
    classical = fit_loop(symmetric, inputs, measured, judged=late)
    assert refit.rmse < 0.11
    assert largest_relative_error(classical.outputs[late], measured[late]) > 0.2


def test_the_best_of_several_starts_is_returned():
    inputs = way((-1.6, 1.6, -1.6, 0.5, -0.4, 1.6), 30)
    measured = lopsided().outputs(inputs)
    free = ["weights", "offset", "gain"]
    held = [path for path in parameters(GENERALIZED) if path not in free]
    far = replace(GENERALIZED, {"rising.slope": 5.0, "falling.slope": 0.1})
    each = [fit_loop(start, inputs, measured, held=held).rmse for start in (far, GENERALIZED)]
    both = fit_loop([far, GENERALIZED], inputs, measured, held=held).rmse
    assert both == pytest.approx(min(each), rel=1e-9) and max(each) > 1.1 * both


def test_positive_parameters_stay_positive():
    model, held = (
        built(ExponentialPrandtlIshlinskii, 0.4, 2.0, 3.0, 0.1),
        ("gain", "density", "decay", "offset"),
    )
    found = best_fit([model], lambda m, one: jnp.atleast_1d(m.spacing + one), 1.0, held)
    assert 0 < float(found.model.spacing) < 1e-2


def test_refuses_what_cannot_be_fitted():
    with pytest.raises(InputError, match=r"two series of one length; got shapes \(3,\) and \(2,\)"):
        fit_loop(CLASSICAL, [0.0, 1.0, 2.0], [0.0, 1.0])
    with pytest.raises(InputError, match="have to be finite"):
        fit_loop(CLASSICAL, [0.0, np.nan], [0.0, 1.0])
    with pytest.raises(InputError, match=r"no parameters \['weight'\] to hold"):
        fit_loop(CLASSICAL, [0.0, 1.0], [0.0, 1.0], held=("weight",))
    with pytest.raises(InputError, match="nothing to fit"):
        fit_loop(CLASSICAL, [0.0, 1.0], [0.0, 1.0], held=tuple(parameters(CLASSICAL)))
