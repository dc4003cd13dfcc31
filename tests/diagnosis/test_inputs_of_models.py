"""Each model of a diagnosis is looked at with the inputs of links that it predicts, where that is asked."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from estimation.slow_errors import MACHINES, recorded

from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.predicted_inputs import with_predicted_inputs
from jaxmuscle.estimation.residuals import evaluate
from jaxmuscle.parameters import replace

RIGHT = MACHINES["joint"]
QUICKER = replace(RIGHT, {"regulator.frequency": 12.1})
WRONG = replace(RIGHT, {"regulator.frequency": 3.0})


@pytest.fixture(scope="module")
def benches():
    """With inputs as measured, and as predicted."""
    prepared = case(recorded("joint")[0], 0.3, None, RIGHT)
    as_measured = workbench(prepared, ())
    return as_measured, dataclasses.replace(as_measured, predicting=True)


@pytest.mark.slow
@pytest.mark.parametrize("model", [RIGHT, QUICKER])
def test_a_model_has_its_own_inputs(benches, model):
    as_measured, predicting = benches
    training = as_measured.case.training
    parts = training.in_parts(4)
    # Whatever inputs a problem comes with, of another model too.
    for problem in (parts, predicting.seen_by(QUICKER, parts)):
        own = predicting.residuals(model, problem)["angle"]
        expected = evaluate(model, with_predicted_inputs(model, training).in_parts(4))["angle"]
        np.testing.assert_allclose(own, expected, rtol=1e-9, atol=1e-9)
    measured = as_measured.residuals(model, parts)["angle"]
    np.testing.assert_array_equal(measured, evaluate(model, parts)["angle"])


def test_the_right_model_leaves_less_with_its_own(benches):
    training = benches[0].case.training
    before, after = (bench.mean_squares(RIGHT, training)["angle"] for bench in benches)
    assert after < 0.5 * before


def test_a_model_that_is_wrong_about_them_has_them_as_measured(benches):
    as_measured, predicting = benches
    parts = as_measured.case.training.in_parts(4)
    seen = predicting.seen_by(WRONG, predicting.seen_by(RIGHT, parts))
    for state, values in as_measured.case.problem.track.measured.items():
        np.testing.assert_array_equal(seen.track.measured[state], values)


def test_fits_of_the_two_are_kept_apart(benches):
    """One fitted with other inputs is another fit."""
    keys = []

    def recall(kind, inputs, *rest):
        keys.append(inputs[0][-1])
        return [None]

    checkpoint: Any = SimpleNamespace(recall=recall)
    for bench in benches:
        own = dataclasses.replace(bench, checkpoint=checkpoint)
        own.kept("settled", own.model, [], (), lambda: pytest.fail("not computed"))
    assert [predicting for predicting, _ in keys] == [False, True]
