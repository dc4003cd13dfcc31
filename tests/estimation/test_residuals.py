"""Residuals of many sets of parameters at once, and their derivatives against differences."""

import jax.numpy as jnp
import numpy as np
import pytest
from estimation.made import TRUE, pulled

import jaxmuscle as jm
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.dataset import aligned, station
from jaxmuscle.estimation.losses import LOSSES
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.parameter_layout import layout
from jaxmuscle.estimation.request import Asked
from jaxmuscle.estimation.residuals import residuals, values_and_slopes
from jaxmuscle.parameters import replace

PATHS = (
    "muscle.end_factor",
    "offset.force",
    "effects.thread_friction.kinetic_coefficient",
    "offset.position",
)
AT = np.array([[1.3, 2.0, 0.1, 1e-4], [1.2, -5.0, 0.05, -2e-3], [1.45, 0.0, 0.12, 0.0]])
STEPS = (1e-6, 1e-3, 1e-6, 1e-8)


@pytest.fixture(scope="module")
def place():
    recording = pulled(threads=True, seconds=4.0)
    return station(jm.actuator(recording.card), recording, "pull", None, {})


@pytest.mark.slow
def test_all_lanes_are_what_each_is_alone(place):
    values, slopes = values_and_slopes(jnp.asarray(AT), place.actuator, place.problem, PATHS)
    assert values.shape == (3, place.samples) and slopes.shape == (3, 4, place.samples)
    # Without offsets they are the residuals of a diagnosis whose states are smoothed twice.
    moved = replace(place.actuator, {PATHS[0]: 1.45, PATHS[2]: 0.12})
    expected = residuals(moved, case(place.recording, 0.0, twice=True).problem)["force"]
    np.testing.assert_allclose(
        values[2], np.asarray(expected)[np.asarray(place.problem.weights["force"]) > 0]
    )


def test_slopes_are_differences(place):
    """Central differences; the offset of the position moves the strain, and with it the friction."""
    _, slopes = values_and_slopes(jnp.asarray(AT), place.actuator, place.problem, PATHS)
    for i, h in enumerate(STEPS):
        there, back = (
            values_and_slopes(jnp.asarray(AT + s * h * np.eye(4)[i]), place.actuator, place.problem, PATHS)[0]
            for s in (1, -1)
        )
        difference = np.asarray(there - back) / (2 * h)
        np.testing.assert_allclose(slopes[:, i], difference, rtol=2e-5, atol=1e-6 * np.abs(difference).max())


@pytest.mark.parametrize("loss", LOSSES)
def test_gradient_of_the_objective(loss):
    """Two recordings of different lengths in one shape, a parameter of each, priors, robust losses."""
    pair = [pulled(1, seconds=4.0, name="a"), pulled(2, seconds=3.0, name="b")]
    actuator = jm.actuator(pair[0].card)
    unknowns = layout(actuator, pair, ["a", "b"], Asked(per_recording=["offset.force"]))
    stations = aligned([station(actuator, r, r.name, None, {}) for r in pair])
    shapes = {s.problem.targets["force"].shape for s in stations}
    assert len(shapes) == 1 and sum(s.samples for s in stations) == 700
    objective = Objective(stations, unknowns, LOSSES[loss])
    u = unknowns.coordinates(np.array([1.002 * TRUE["initial_radius"], 1.29, 1.0, -1.5]))
    (here, _) = objective.at(np.stack([u, u]))
    h = 1e-6
    for i in range(4):
        there, back = (at.cost for at in objective.at(np.stack([u + h * np.eye(4)[i], u - h * np.eye(4)[i]])))
        assert here.gradient[i] == pytest.approx((there - back) / (2 * h), rel=1e-4)
    assert np.linalg.eigvalsh(here.matrix).min() > 0


def test_shapes_too_unlike_are_left_alone():
    pair = [pulled(1, seconds=4.0), pulled(2, seconds=40.0)]
    actuator = jm.actuator(pair[0].card)
    stations = aligned([station(actuator, r, r.name, None, {}) for r in pair])
    assert [s.problem.track.command.shape[0] for s in stations] == [400, 4000]


def test_what_is_not_a_number_is_counted(place):
    objective = Objective(
        [place],
        layout(
            place.actuator, [place.recording], ["pull"], Asked(["end_factor"], priors={"end_factor": None})
        ),
        LOSSES["squares"],
    )
    (local,) = objective.at(np.array([[460.0]]))
    assert local.broken == place.samples
    assert np.isfinite(local.cost) and not local.gradient.any()
