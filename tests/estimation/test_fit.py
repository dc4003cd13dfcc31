"""Fits of recordings whose truth is known: recovery, coverage, gaps, outliers, offsets, several at once."""

import numpy as np
import pytest
from estimation.made import LIFT_TRUE, TRUE, changed, fitted, lifted, pulled, within
from oracles import bench
from oracles.recorded import NOISE

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.parameters import get

THREADS = {f"effects.thread_friction.{name}": value for name, value in bench.THREADS.items()}


@pytest.fixture(scope="module")
def recording():
    return pulled()


@pytest.fixture(scope="module")
def result(recording):
    return fitted(recording)


def test_noise_on_what_the_bench_imposes(recording):
    """Smoothed inputs that were cut at their peaks had put the radius 30 standard errors off."""
    off = []
    for seed in range(12):
        rng = np.random.default_rng([seed, 4])
        drawn = {"position": 3e-5 * rng.normal(size=800), "pressure": 400 * rng.normal(size=800)}
        noisy = {name: recording.columns[name] + each for name, each in drawn.items()}
        found = fitted(changed(pulled(seed), **noisy))
        off.append([(found.values[name] - true) / found.std[name] for name, true in TRUE.items()])
    assert (np.abs(np.mean(off, axis=0)) < 3 / np.sqrt(len(off))).all()
    assert np.mean(np.abs(off) < 1.96) > 0.85


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
    """95 % of them: of 24, fewer than 19 happen once in a thousand times."""
    covered = []
    for seed in range(12):
        found = fitted(pulled(seed), priors={"initial_radius": None, "end_factor": None})
        for name, true in TRUE.items():
            low, high = found.parameters[name].interval()
            covered.append(low <= true <= high)
    assert len(covered) == 24
    assert sum(covered) >= 19


def test_missing_samples_do_not_count(recording, result):
    rng = np.random.default_rng(5)
    gone = rng.random(len(recording)) < 0.3
    gone[200:320] = True
    force = np.where(gone, np.nan, recording.columns["force"])
    found = fitted(changed(recording, force=force))
    assert found.samples == int((~gone).sum())
    assert all(within(found, name, true) for name, true in TRUE.items())
    assert found.std["end_factor"] > result.std["end_factor"]
    table = found.predictions["pull"]
    np.testing.assert_array_equal(np.isnan(table["force fitted"]), gone)


def test_a_mask_is_as_good_as_missing(recording):
    bad = np.zeros(len(recording), bool)
    bad[100:260] = True
    broken = np.where(bad, 900.0, recording.columns["force"])
    masked = fitted(changed(recording, force=broken), masks={"force": bad})
    missing = fitted(changed(recording, force=np.where(bad, np.nan, broken)))
    assert masked.values == missing.values
    assert masked.samples == len(recording) - 160


@pytest.mark.parametrize("loss", ["huber", "student"])
def test_outliers_do_not_pull_a_robust_fit(recording, loss):
    rng = np.random.default_rng(8)
    wild = rng.random(len(recording)) < 0.06
    force = recording.columns["force"] + wild * rng.uniform(60, 120, len(recording))
    spoilt = changed(recording, force=force)
    robust, plain = fitted(spoilt, loss=loss), fitted(spoilt)
    for name, true in TRUE.items():
        assert within(robust, name, true), name
        assert abs(robust.values[name] - true) < 0.3 * abs(plain.values[name] - true)


def test_noise_can_be_estimated(recording):
    """Of the card's noise only the shape is used; the answer does not depend on what it says."""
    loud = fitted(recording, noise={"force": 20 * NOISE}, priors={"initial_radius": None, "end_factor": None})
    assert loud.noise["pull"]["force"].assumed == pytest.approx(20 * NOISE, rel=1e-3)
    found = fitted(recording, noise="estimated")
    assert found.noise["pull"]["force"].assumed == pytest.approx(NOISE, rel=0.1)
    assert found.cost == pytest.approx(0.5 * found.samples, rel=0.02)
    # Standard deviations come from the residuals, whatever the noise is said to be.
    assert loud.std["end_factor"] == pytest.approx(found.std["end_factor"], rel=0.05)


@pytest.mark.parametrize("loss", ["huber", "student"])
def test_robust_noise_is_right_for_normal_noise(recording, loss):
    """What the residuals are by squares; tails that count for less are allowed for."""
    given = fitted(recording, loss=loss)
    plain = fitted(recording).noise["pull"]["force"].residual
    assert given.noise["pull"]["force"].ratio == pytest.approx(plain / NOISE, rel=0.03)
    found = fitted(recording, loss=loss, noise="estimated")
    assert found.noise["pull"]["force"].assumed == pytest.approx(plain, rel=0.03)


def test_each_recording_has_its_own_noise():
    """A quiet bench and a loud one: the quiet one decides, as it should."""
    quiet, loud = pulled(1, name="quiet"), pulled(2, name="loud")
    rough = 12 * np.random.default_rng(0).normal(size=len(loud))
    loud = changed(loud, force=loud.columns["force"] + rough)
    free = {"priors": {"initial_radius": None, "end_factor": None}}
    both, alone = (fitted(r, noise="estimated", **free) for r in ([quiet, loud], quiet))
    assert both.noise["quiet"]["force"].assumed == pytest.approx(NOISE, rel=0.1)
    assert both.noise["loud"]["force"].assumed == pytest.approx(12, rel=0.1)
    assert both.std["end_factor"] < 1.05 * alone.std["end_factor"]
    assert all(within(both, name, true) for name, true in TRUE.items())


def test_offset_of_an_imposed_sensor(recording):
    """The position's sensor shows 2 mm too much: every length that the muscle sees is 2 mm off."""
    shifted = changed(recording, position=recording.columns["position"] + 2e-3)
    result = fitted(shifted, "offset.position", "end_factor", priors={"end_factor": None})
    assert within(result, "offset.position", 2e-3)
    assert result.std["offset.position"] < 2e-4
    assert within(result, "end_factor", TRUE["end_factor"])
    assert result.parameters["offset.position"].unit == "m"


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


def test_profile_of_a_nearly_linear_parameter_is_its_interval(recording, result):
    found = fitted(recording, profiles=["end_factor"])
    (curve,) = found.profiles
    low, high = found.parameters["end_factor"].interval()
    assert (curve.lower, curve.upper) == pytest.approx((low, high), rel=1e-4)
    assert curve.deviance.min() == 0
    np.testing.assert_allclose(curve.deviance[[0, -1]], 9.0, rtol=0.1)


def test_profile_of_what_is_not_determined_is_open(recording):
    found = fitted(
        recording, "end_factor", "initial_length", profiles=["initial_length"], priors={"end_factor": None}
    )
    (curve,) = found.profiles
    assert curve.deviance.max() < 1.0
    assert (curve.lower, curve.upper) == (-np.inf, np.inf)


def test_a_profile_ends_at_a_bound(recording, result):
    """The bound is half a standard deviation above; the interval goes up to it and no farther."""
    bound = result.values["end_factor"] + 0.5 * result.std["end_factor"]
    found = fitted(recording, profiles=["end_factor"], bounds={"end_factor": (None, bound)})
    (curve,) = found.profiles
    assert curve.upper == bound == curve.values[-1]
    assert (np.diff(curve.values) > 0).all() and curve.missing == 0
    assert curve.lower == pytest.approx(result.parameters["end_factor"].interval()[0], rel=1e-4)
    np.testing.assert_array_equal(np.sign(curve.roots), [-1, -1, -1, 0, 1])
    figure = found.plot()
    drawn = next(a for a in figure.get_axes() if a.get_title(loc="left") == "end_factor")
    heights = np.asarray(drawn.lines[1].get_ydata())
    np.testing.assert_allclose(heights[[0, -1]], curve.deviance[[0, -1]], rtol=1e-9)


def test_a_profile_without_time_or_steps_has_no_points():
    """One that is only on its way would look too steep."""
    for how in ({"budget": 0.0}, {"steps": 1}):
        found = fitted(pulled(off=1.4, threads=True), profiles=["end_factor"], **how)
        (curve,) = found.profiles
        assert curve.missing == 6 and list(curve.values) == pytest.approx([found.values["end_factor"]])
        assert (curve.lower, curve.upper) == (-np.inf, np.inf)
        assert any("The profile of end_factor lacks 6 of its points" in note for note in found.notes())
        found.plot()


def test_a_prior_in_the_wrong_unit_is_named(recording):
    """Millimetres for metres; the data outweigh it, and a reader has to know."""
    how = {"priors": {"initial_radius": (7.0, 0.1), "end_factor": None}}
    found = fitted(recording, "initial_radius", "end_factor", **how)
    assert found.values["initial_radius"] == pytest.approx(7e-3, rel=1e-2)
    (note,) = (n for n in found.notes() if "away from its prior" in n)
    assert (
        "By the data initial_radius is" in note
        and "(7 ± 0.1 m): the prior, its unit or the model is wrong" in note
    )
    calm = fitted(recording)
    assert not any("away from its prior" in n for n in calm.notes())


def test_correlations_and_covariance(result):
    table = result.correlations
    np.testing.assert_allclose(np.diag(table), 1.0)
    covariance = result.covariance
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), list(result.std.values()), rtol=1e-12)
    assert np.linalg.eigvalsh(table.to_numpy()).min() > 0


def test_readings_lie_in_the_band(recording, result):
    """95 % of them, on the data that were fitted and on another draw of the noise."""
    other = pulled(seed=9)
    table = result.predictions["pull"]
    for force in (recording.columns["force"], other.columns["force"]):
        off = np.abs(force - table["force fitted"]) / table["force std"]
        assert 0.93 < (off < 1.96).mean() < 0.985
    # Where the parameters are uncertain too, the band is wider than the sensor's noise.
    assert table["force std"].min() > NOISE and table["force std"].max() < 1.2 * NOISE


@pytest.mark.parametrize("loss", ["squares", "student"])
def test_outliers_do_not_widen_the_band(recording, loss):
    """Four readings in a hundred are wild: 95 % lie in the band still, and it is not as wide as the wild."""
    rng = np.random.default_rng(4)
    wild = rng.random(len(recording)) < 0.04
    spoilt = changed(recording, force=recording.columns["force"] + wild * rng.normal(size=len(wild)) * 80)
    found = fitted(spoilt, loss=loss)
    table = found.predictions["pull"]
    off = np.abs(table["force"] - table["force fitted"]) / table["force std"]
    assert 0.93 < (off < 1.96).mean() < 0.975
    if loss == "student":
        assert float(table["force std"].to_numpy().max()) < 2 * NOISE
        # Of the size of the residuals the sensor's noise is what counts, and the model lacks nothing.
        noise = found.noise["pull"]["force"]
        assert noise.ratio < 1.3 < noise.residual / NOISE
        assert not any("the model may lack something" in note for note in found.notes())


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
