"""Fits of recordings whose truth is known: recovery, coverage, offsets, bounds, several at once."""

import dataclasses

import numpy as np
import pytest
from estimation.made import LIFT_TRUE, TRUE, changed, fitted, lifted, pulled, within
from oracles import bench
from oracles.recorded import NOISE
from scipy.stats import binom, chi2

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.parameters import get

THREADS = {f"effects.thread_friction.{name}": value for name, value in bench.THREADS.items()}


def test_card_says_what_is_free(result):
    assert set(result.parameters) == {"initial_radius", "end_factor"}
    assert result.parameters["end_factor"].prior == (TRUE["end_factor"], 0.05)
    assert result.converged
    assert len(result.starts) == 1


@pytest.mark.parametrize("off", [0.5, 0.75, 1.5])
def test_recovers_from_bad_starts(off):
    """Fifty percent off in the geometry, and everything in between."""
    result = fitted(pulled(off=off), priors={"initial_radius": None, "end_factor": None})
    assert result.converged
    assert all(within(result, name, true) for name, true in TRUE.items())
    assert all(result.std[name] < 0.01 * true for name, true in TRUE.items())


@pytest.mark.slow
def test_every_start_reaches_the_minimum_and_the_noise():
    shaken = pulled(threads=True)
    result = fitted(shaken, starts=6, seed=3)
    assert [start.reached for start in result.starts] == [True] * 6
    for name, true in {**TRUE, **THREADS}.items():
        assert within(result, name, true), name
    ends = np.array([list(start.end.values()) for start in result.starts])
    np.testing.assert_allclose(ends / ends[0], 1.0, atol=5e-3)
    assert result.cost == pytest.approx(0.5 * result.samples, rel=0.15)
    assert np.ptp([start.start["end_factor"] for start in result.starts]) > 0.05


def test_intervals_cover_the_truth():
    """95 % of them; and the estimates lie about the truth as their covariance says, no nearer, no farther."""
    covered, squares = [], 0.0
    for seed in range(12):
        found = fitted(pulled(seed), priors={"initial_radius": None, "end_factor": None})
        off = np.array([found.values[name] - true for name, true in TRUE.items()])
        squares += off @ np.linalg.solve(found.covariance.loc[list(TRUE), list(TRUE)].to_numpy(), off)
        for name, true in TRUE.items():
            low, high = found.parameters[name].interval()
            covered.append(low <= true <= high)
    assert len(covered) == 24
    assert sum(covered) >= binom.ppf(0.05, 24, 0.95) == 21
    low, high = chi2.interval(0.95, 24)
    assert low < squares < high


def test_offset_of_an_imposed_sensor(recording):
    """The position's sensor shows 2 mm too much: every length that the muscle sees is 2 mm off."""
    shifted = changed(recording, position=recording.columns["position"] + 2e-3)
    result = fitted(shifted, "offset.position", "end_factor", priors={"end_factor": None})
    assert within(result, "offset.position", 2e-3)
    assert result.std["offset.position"] < 2e-4
    assert within(result, "end_factor", TRUE["end_factor"])
    assert result.parameters["offset.position"].unit == "m"


@pytest.mark.slow
def test_two_recordings_with_an_offset_each():
    """Different lengths in time; each load cell has its own zero."""
    short = pulled(1, seconds=6.0, extra=7.0, name="short")
    long = pulled(2, seconds=8.0, extra=-12.0, name="long")
    result = fitted([short, long], per_recording=["offset.force"], starts=2)
    assert set(result.parameters) == {*TRUE, "offset.force[short]", "offset.force[long]"}
    assert within(result, "offset.force[short]", 7.0) and within(result, "offset.force[long]", -12.0)
    assert result.parameters["offset.force[long]"].recording == "long"
    assert all(within(result, name, true) for name, true in TRUE.items())
    assert result.samples == len(short) + len(long)
    predicted = result.predictions["short"]
    assert np.std((predicted["force predicted"] - predicted["force"]).to_numpy()) < 1.2 * NOISE
    # Both together know more than either alone.
    alone = fitted(long, *TRUE, "offset.force")
    assert result.std["end_factor"] < alone.std["end_factor"]


@pytest.mark.slow
def test_two_loads_share_a_muscle_and_a_valve():
    """Each recording's card says its own mass; an offset of the starts by a fifth is no matter."""
    light, heavy = lifted(8.0, off=0.8), lifted(14.0, seed=1, samples=700, off=0.8)
    result = fitted([light, heavy])
    assert [float(get(machine, "mass")) for machine in result.actuators] == [8.0, 14.0]
    for name, true in LIFT_TRUE.items():
        assert within(result, name, true), name
        assert result.std[name] < 0.01 * true
    assert result.converged


@pytest.mark.slow
def test_a_mass_of_its_own_for_each_recording():
    light, heavy = lifted(8.0), lifted(14.0, seed=1)
    result = fitted([light, heavy], "end_factor", per_recording=["mass"], priors={"mass": (11.0, 6.0)})
    assert within(result, "mass[lift-8kg]", 8.0) and within(result, "mass[lift-14kg]", 14.0)
    assert float(get(result.actuators[1], "mass")) == result.values["mass[lift-14kg]"]


def test_without_influence_is_named_and_not_fatal(recording):
    idle = jm.actuator(recording.card).with_effects(thread_friction=jm.effects.ThreadFriction())
    path = "effects.thread_friction.velocity_constant"
    result = jm.fit(idle, recording, ["end_factor", path])
    assert result.idle == (path,)
    assert result.values[path] == 0.15
    assert any("velocity_constant has no influence" in note for note in result.notes())
    assert within(result, "end_factor", TRUE["end_factor"])
    assert f"{path} has no influence on the data; it stayed where it was." in result.notes()
    prior = jm.fit(idle, recording, ["end_factor", path], priors={path: (0.3, 0.01)})
    assert prior.values[path] == pytest.approx(0.3, rel=1e-6)
    assert f"{path} has no influence on the data; it is what its prior says." in prior.notes()


def test_a_ratio_that_alone_is_determined(recording):
    """The force depends on k x / l0."""
    result = fitted(recording, "end_factor", "initial_length", priors={"end_factor": None})
    assert [each.words for each in result.undetermined] == [
        "only end_factor / initial_length is determined, not end_factor and initial_length one by one"
    ]
    ratio = result.values["end_factor"] / result.values["initial_length"]
    assert ratio == pytest.approx(TRUE["end_factor"] / 0.3, rel=2e-3)


def test_a_bound_holds_and_is_named():
    thin = pulled(off=0.97)
    result = fitted(thin, bounds={"initial_radius": (None, 6.9e-3)})
    assert result.values["initial_radius"] == 6.9e-3
    assert result.parameters["initial_radius"].at_bound == "upper"
    assert result.std["initial_radius"] == 0
    low, high = result.parameters["initial_radius"].interval()
    assert low < high == 6.9e-3
    assert "initial_radius ended at its upper bound." in result.notes()
    # What is free makes up for it: less end factor pulls more.
    assert result.values["end_factor"] < TRUE["end_factor"]
    assert list(result.correlations.index) == ["end_factor"]


def test_the_interval_of_a_value_at_a_bound(recording, result):
    """One standard deviation beyond the bound all that remains is hypot(1, 1.96) - 1 of them inside it."""
    bound = result.values["end_factor"] - result.std["end_factor"]
    start = jm.replace(jm.actuator(recording.card), {"muscle.end_factor": 0.999 * bound})
    none = {"initial_radius": None, "end_factor": None}
    found = jm.fit(start, recording, bounds={"end_factor": (None, bound)}, priors=none)
    low, high = found.parameters["end_factor"].interval()
    assert high == bound and found.table().loc["end_factor", "low"] == low
    assert (bound - low) / result.std["end_factor"] == pytest.approx(np.hypot(1, 1.96) - 1, rel=0.1)
    assert "at its upper bound)  1.30" in repr(found)


def test_failed_starts_are_set_aside(recording):
    """A braid angle of nearly 180 degrees has no muscle; neither has one of no number."""
    starts = [{"end_factor": 1.2}, {"end_factor": 1e200}, {"end_factor": 1.4}]
    result = fitted(recording, "end_factor", starts=starts, priors={"end_factor": None})
    assert [start.code for start in result.starts] == ["converged", "failed", "converged"]
    assert result.failed == {"no finite prediction at its start": 1}
    assert within(result, "end_factor", TRUE["end_factor"])
    assert any("1 starts failed" in note for note in result.notes())


def test_all_starts_failed(recording):
    starts = [{"end_factor": 1e200}, {"end_factor": 1e180}]
    with pytest.raises(InputError, match="all 2 starts failed: 2 × no finite prediction at its start"):
        fitted(recording, "end_factor", starts=starts, priors={"end_factor": None})


def test_out_of_time_gives_the_best_so_far():
    result = fitted(pulled(off=1.4), budget=1e-3)
    assert result.code == "budget"
    assert not result.converged
    assert "ran out of time" in result.notes()[0]
    assert np.isfinite(result.cost)


def test_out_of_steps():
    result = fitted(pulled(off=1.4), steps=1)
    assert result.code == "steps"
    assert result.starts[0].steps == 1


def test_progress_tells_the_cost_of_every_iteration(recording):
    lines: list[str] = []
    result = fitted(recording, progress=lines.append)
    costs = [line for line in lines if "cost" in line]
    assert len(costs) == result.iterations
    assert f"cost {result.cost:.6g}" in costs[-1]


def test_a_prior_in_the_wrong_unit_is_named(recording):
    """Millimetres for metres; the data outweigh it, and a reader has to know."""
    how = {"priors": {"initial_radius": (7.0, 0.1), "end_factor": None}}
    found = fitted(recording, "initial_radius", "end_factor", **how)
    assert found.values["initial_radius"] == pytest.approx(7e-3, rel=1e-2)
    (note,) = (n for n in found.notes() if "away from its prior" in n)
    assert (
        "By the data initial_radius is" in note
        and "(7.00 ± 0.10 m): the prior, its unit or the model is wrong" in note
    )
    calm = fitted(recording)
    assert not any("away from its prior" in n for n in calm.notes())


def test_correlations_and_covariance(result):
    table = result.correlations
    np.testing.assert_allclose(np.diag(table), 1.0)
    covariance = result.covariance
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), list(result.std.values()), rtol=1e-12)
    assert np.linalg.eigvalsh(table.to_numpy()).min() > 0


def test_std_with_others_held_is_that_of_the_inverse_covariance(result):
    names = list(result.covariance.index)
    precision = np.linalg.inv(result.covariance.to_numpy())
    for i, name in enumerate(names):
        assert result.std_given(name, names) == pytest.approx(precision[i, i] ** -0.5, rel=1e-6)
        assert result.std_given(name, []) == result.std_given(name, [name, "none"]) == result.std[name]
    first, second = names[:2]
    r = result.correlations.loc[first, second]
    assert result.std_given(first, [second]) == pytest.approx(result.std[first] * (1 - r**2) ** 0.5, rel=1e-6)


def test_what_is_at_a_bound_counts_as_held(result):
    first, second, *_ = names = list(result.correlations.index)
    table = result.correlations.copy()
    table.loc[second, :] = table.loc[:, second] = np.nan
    bound = dataclasses.replace(result, correlations=table)
    others = [name for name in names if name != second]
    assert bound.std_given(first, names) == result.std_given(first, others)
    assert bound.std_given(second, names) == result.std[second]


def test_residuals_of_the_true_model_are_white_and_independent(result):
    assert {t.against for t in result.tests} == {"itself", "pressure", "position"}
    assert all(t.passed for t in result.tests)


def test_a_lacking_model_is_told():
    """Thread friction that the card does not declare."""
    recording = pulled(threads=True)
    bare = jm.actuator(recording.card).without_effects("thread_friction")
    result = jm.fit(bare, recording, ["end_factor", "initial_radius"])
    assert not any(t.passed for t in result.tests if t.against == "itself")
    assert any("the model lacks something" in note for note in result.notes())
    fitted_std = result.parameters["end_factor"]
    assert fitted_std.coloured > 1.5 * fitted_std.independent
