"""Fits of a search through the simulation, on readings of the oracle with white noise."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import driven_card, driven_recording, smooth_motion

from jaxmuscle import effects
from jaxmuscle.diagnosis.card_constants import card_constants
from jaxmuscle.diagnosis.settled_fit import SETTLED
from jaxmuscle.diagnosis.workbench import Workbench, workbench
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.checkpoint import NOTHING_KEPT, Checkpoint
from jaxmuscle.estimation.free_parameters import Prior
from jaxmuscle.estimation.residuals import evaluate, values_and_chosen_slopes
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
FAINT = {path: Prior(value, 1e3 * value) for path, value in TRUE.items()}
"""Priors that say nothing: the fit is that of the data."""

TURNING = 1.5e-3
"""Velocity below which a sample is left out [m/s]."""


@pytest.fixture(scope="module")
def prepared():
    recording = driven_recording({"thread_friction": bench.THREADS}, driven_card(bench.THREADS), seed=4)
    # Where the motion turns, dry friction is what the last digit of the smoothed velocity makes of it.
    turning = np.abs(smooth_motion(20.0)[2]) < TURNING
    assert turning.mean() < 0.05
    return case(recording, 0.0, turning)


def tools(prepared, width=WIDTH, declared=PATHS):

    priors = {path: FAINT[path] for path in declared}
    own = workbench(dataclasses.replace(prepared, priors=priors), ())
    return dataclasses.replace(own, width=width)


def fitted(prepared, start, steps=60, **how):
    bench_ = tools(prepared, **how)
    return bench_.fit(replace(prepared.actuator, start), [], prepared.training, steps)


@pytest.mark.parametrize("start", STARTS)
def test_recovers_the_parameters(prepared, start):
    model, lane = fitted(prepared, STARTS[start])
    assert lane.code in SETTLED
    values = np.array([float(get(model, path)) for path in PATHS])
    true = np.array(list(TRUE.values()))
    own = tools(prepared)
    _, slopes = own.jacobian(model, prepared.training, PATHS, [])
    std = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    assert (std < 0.15 * true).all(), "the data tell the parameters"
    np.testing.assert_array_less(np.abs(values - true), 4 * std)
    # Half the sum of squares of white noise, with five degrees of freedom less.
    samples = int(prepared.windows.mask.sum())
    assert lane.cost == pytest.approx(0.5 * (samples - 5), abs=4 * np.sqrt(samples / 2))


@pytest.mark.slow
@pytest.mark.parametrize("width", [2, len(PATHS) + 4])
def test_tangents_of_a_program_change_nothing(prepared, width):
    exact, lane = fitted(prepared, STARTS["mixed"])
    wide, padded = fitted(prepared, STARTS["mixed"], width=width)
    assert padded.code in SETTLED
    assert padded.cost == pytest.approx(lane.cost, rel=1e-9)
    for path in PATHS:
        assert float(get(wide, path)) == pytest.approx(float(get(exact, path)), rel=1e-6)


def test_what_is_not_free_stays(prepared):
    start = {**TRUE, "muscle.end_factor": 1.1 * TRUE["muscle.end_factor"]}
    model, _ = fitted(prepared, start, declared=("muscle.initial_radius",))
    for path in PATHS[1:]:
        assert float(get(model, path)) == float(get(replace(prepared.actuator, start), path))
    # A muscle that pulls less at the same contraction is made up for by a thicker one.
    assert float(get(model, PATHS[0])) > 1.01 * TRUE[PATHS[0]]


def test_step_limit(prepared):
    """The best point so far, and no claim to have converged."""
    _, lane = fitted(prepared, STARTS["above"], steps=1)
    start = tools(prepared).cost(replace(prepared.actuator, STARTS["above"]), prepared.training)
    assert lane.code not in SETTLED
    assert lane.steps == 1
    assert lane.cost <= start + 1e-3  # the faint priors add next to nothing
    assert fitted(prepared, STARTS["above"])[1].cost < 0.01 * start


@pytest.mark.parametrize("width", [2, len(PATHS), len(PATHS) + 3])
def test_slopes_are_finite_differences(prepared, width):
    """Whatever the number of tangents that are pushed at a time."""
    model = replace(prepared.actuator, STARTS["mixed"])
    value, slopes = tools(prepared, width=width).jacobian(model, prepared.training, PATHS, [])

    def at(path, factor):
        moved = replace(model, {path: factor * float(get(model, path))})
        found = evaluate(moved, prepared.training)
        return np.concatenate([np.asarray(found[link.output]).ravel() for link in model.links])

    data = value[: -len(PATHS)]
    np.testing.assert_allclose(data, at(PATHS[0], 1.0), rtol=1e-9, atol=1e-9)
    for path, slope in zip(PATHS, slopes[:, : data.size], strict=True):
        difference = (at(path, 1 + 1e-5) - at(path, 1 - 1e-5)) / (2e-5 * float(get(model, path)))
        np.testing.assert_allclose(slope, difference, atol=1e-5 * np.abs(difference).max())


def test_one_program_for_every_choice(prepared):
    """Fits of two of the parameters and of one of them run in the program of all."""

    def programs():
        return values_and_chosen_slopes.plain._cached._cache_size()  # pyright: ignore[reportFunctionMemberAccess]

    own = tools(prepared)
    own.jacobian(prepared.actuator, prepared.training, PATHS, [])
    before = programs()
    own.jacobian(prepared.actuator, prepared.training, PATHS[:2], [])
    own.jacobian(prepared.actuator, prepared.training, PATHS[3:4], [])
    assert programs() == before > 0


@pytest.mark.slow
def test_what_one_bench_has_fitted_serves_another_with_other_candidates(prepared):
    """Also a bench that seeks constants: candidates that are not in a model change nothing in it."""
    ends, memory = effects.PressureDependentEnds, Checkpoint(None)
    one = workbench(prepared, [ends], checkpoint=memory)
    more = [effects.BladderStiffness, ends, effects.Creep]
    other = workbench(prepared, more, constants=card_constants(prepared), checkpoint=memory)
    fits = [each.settled(each.model, [ends.name], prepared.training, 3) for each in (one, other, one, other)]
    assert memory.recalled == 3
    for fit in fits[1:]:
        assert [float(get(fit.model, p)) for p in one.free_paths(one.model, [ends.name])] == [
            float(get(fits[0].model, p)) for p in one.free_paths(one.model, [ends.name])
        ]
    assert set(fits[1].model.effects) - set(fits[0].model.effects) == {"bladder_stiffness"}
    # Other windows, other steps or other effects are another fit.
    other.settled(other.model, [], prepared.training, 3)
    other.settled(other.model, [ends.name], prepared.training, 4)
    assert memory.recalled == 3
    spread = [memory.remember("spread", prepared.training, lambda i=i: i) for i in range(3)]
    assert spread == [0, 0, 0]
    assert NOTHING_KEPT.remember("spread", prepared.training, lambda: 5) == 5
    assert NOTHING_KEPT.remember("spread", prepared.training, lambda: 6) == 6


@pytest.mark.parametrize(
    ("weighs_little", "left", "best"), [(True, 1.0, "noise"), (True, 4.5, "own"), (False, 1.0, "own")]
)
def test_a_fit_by_the_noise_of_sensors_counts_where_what_is_left_weighs_little(weighs_little, left, best):
    squares = {"own": 5.0, "noise": left}
    fit: Any = lambda name: SimpleNamespace(model=name, weighs_little=weighs_little, left={}, far=0.0)  # noqa: E731
    tools_: Any = SimpleNamespace(
        settled=lambda *of_model: fit("own"),
        by_sensor_noise=lambda *of_model: fit("noise"),
        losses=lambda model, problem: np.log1p(np.full((1, 40), squares[model])),
    )
    tools_.removes_plenty = lambda *models: Workbench.removes_plenty(tools_, *models)
    anything: Any = None
    assert Workbench.best_fit(tools_, [anything], [], anything, 1).model == best


def test_own_weights_carry_a_fit_by_the_noise_of_sensors_on_unless_they_spoil_it():
    squares = {"moved": 1.0, "better": 0.9, "spoilt": 5.0}
    for carried_on, best in (("better", "better"), ("spoilt", "moved")):
        tools_: Any = SimpleNamespace(
            fit=lambda *of_model: ("moved", SimpleNamespace(cost=1.0, code="converged")),
            settled=lambda *of_model, carried_on=carried_on: SimpleNamespace(model=carried_on),
            discrepancies=lambda *of_model: {},
            _far_from_priors=lambda *of_model: 0.5,
            removes_plenty=lambda present, model, problem: squares[model] < 0.5 * squares[present],
        )
        anything: Any = None
        assert Workbench.by_sensor_noise(tools_, anything, [], anything, 1).model == best
