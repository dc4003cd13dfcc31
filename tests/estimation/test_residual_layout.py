"""Places of residuals in one vector, against the vector of the estimator and the rows of the recording."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.residual_layout import ResidualLayout
from jaxmuscle.estimation.residuals import evaluate, residual_vector


@pytest.fixture(scope="module")
def swing():
    """Two pressures and an angle, in windows of which the last is cut short."""
    return case(jm.read(jm.sample("swing")).part(0, 700), 0.0)


@pytest.mark.slow
def test_parts_are_those_of_the_residual_vector(swing):
    layout = ResidualLayout.of(swing.actuator, swing.training)
    vector = np.asarray(residual_vector(jnp.zeros(0), swing.actuator, swing.training, ()))
    by_output, found = evaluate(swing.actuator, swing.training), layout.split(vector)
    assert list(found) == [link.output for link in swing.actuator.links]
    for output, values in found.items():
        assert values.shape == (*layout.rows.shape, len(layout.columns[output]))
        np.testing.assert_allclose(values, layout.table(output, by_output[output]), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(layout.join(found), vector)


def test_leading_axes_are_kept(swing):
    layout = ResidualLayout.of(swing.actuator, swing.training)
    size = sum(layout.size(output) for output in layout.columns)
    table = np.random.default_rng(0).normal(size=(3, 2, size))
    for output, values in layout.split(table).items():
        np.testing.assert_array_equal(values[2, 1], layout.split(table[2, 1])[output])


def test_rows_are_those_of_the_targets(swing):
    """Every target is the reading of its row; behind the end the last reading stands, and does not count."""
    layout, training = ResidualLayout.of(swing.actuator, swing.training), swing.training
    for output, names in layout.columns.items():
        targets = layout.table(output, training.targets[output])
        for i, name in enumerate(names):
            np.testing.assert_array_equal(targets[..., i], swing.recording.columns[name][layout.rows])
    behind = swing.windows.rows[:, None] + np.arange(training.samples) >= len(swing.recording)
    assert behind.any()
    for output in layout.columns:
        assert not layout.table(output, training.weights[output])[behind].any()
