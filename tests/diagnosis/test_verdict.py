"""The verdict, from what a diagnosis leaves, adds, and predicts of held-out data."""

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.diagnosis.diagnosis_data import Error, Estimate, FoundEffect
from jaxmuscle.diagnosis.last_fit import held_out_rows, largest_strength
from jaxmuscle.diagnosis.verdict import (
    EXPLAINED,
    FORM_OF_FRICTION,
    MISSING,
    beyond_machines,
    confirmed,
    doubted,
    far_off,
    missing_in_noise,
    share_left,
    strength_stds,
    surprise,
    verdict,
    violated_priors,
    within_form_of_friction,
)
from jaxmuscle.effects import BY_NAME, reading_effect
from jaxmuscle.effects.base import AbstractEffect, strengths_of
from jaxmuscle.effects.force_loss import ForceDrift
from jaxmuscle.effects.sensors import Backlash
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.free_parameters import Prior


def held_out(**in_noise: float) -> dict[str, dict[str, Error]]:
    return {"held_out": {name: Error(1.0, "m", 1.0, size) for name, size in in_noise.items()}}


def fit(*ratios: float, **parameters: tuple[float, str]) -> Any:
    noise = {"lift": {str(i): SimpleNamespace(ratio=ratio, assumed=2.0) for i, ratio in enumerate(ratios)}}
    entries = {n: SimpleNamespace(value=value, path=path) for n, (value, path) in parameters.items()}
    return SimpleNamespace(noise=noise, parameters=entries)


def friction(value: float, std: float) -> FoundEffect:
    return FoundEffect("load_friction", "load", "", "", {"force": Estimate(value, std, "N", "")}, 0.9, 1e-4)


@pytest.mark.parametrize(
    ("found", "left", "missing", "confirms", "imitates", "said"),
    [
        (False, False, 0.1, False, False, "complete"),
        (False, False, 2.3, False, False, "undecided"),
        (False, True, 9.0, False, False, "unexplained"),
        (True, False, 0.1, True, False, "effects found"),
        (True, True, 9.0, True, False, "effects found"),
        (True, False, 0.1, False, False, "not confirmed"),
        (True, True, 90.0, True, True, "unexplained"),
    ],
)
def test_every_case(
    found: bool, left: bool, missing: float, confirms: bool, imitates: bool, said: str
) -> None:
    case = {"found": found, "left": left, "missing": missing, "confirms": confirms, "imitates": imitates}
    assert verdict(**case) == said  # pyright: ignore[reportArgumentType]


def predicted(**in_noise: float) -> dict[str, Error]:
    return held_out(**in_noise)["held_out"]


def test_missing_is_what_a_residual_has_beyond_the_noise_of_the_worst_reading() -> None:
    noise, poor = {"0": 2.0, "1": 2.0}, predicted(**{"0": 90.0, "1": 90.0})
    squares = {"0": 400.0, "1": 400.0}
    assert missing_in_noise(fit(1.0, math.sqrt(2.0)), squares, noise, poor) == pytest.approx(1.0)
    assert missing_in_noise(fit(0.8, 0.9), squares, noise, poor) == 0.0
    # What the fit allowed for beside the sensor's noise is missing all the same.
    more = {"0": 0.4, "1": 2.0}
    assert missing_in_noise(fit(1.0, 0.5), squares, more, poor) == pytest.approx(math.sqrt(24.0))
    # Without a fit, from the weighted residuals as they are.
    assert missing_in_noise(None, {"0": 5.0, "1": 0.9}, {}, poor) == pytest.approx(2.0)


def test_what_predictions_from_the_command_alone_do_not_miss_is_not_missing() -> None:
    """The noise of a pressure that is imposed as measured moves a joint; its regulator's model has none."""
    noise = {"0": 2.0, "1": 2.0}
    assert missing_in_noise(fit(9.0, 2.0), {}, noise, predicted(**{"0": 1.0, "1": 5.0})) == pytest.approx(
        3**0.5
    )
    assert missing_in_noise(fit(math.nan, 1.0), {}, noise, predicted(**{"0": 3.0})) == pytest.approx(8**0.5)
    assert missing_in_noise(fit(3.0, 1.0), {}, noise, predicted(**{"0": math.nan})) == pytest.approx(8**0.5)


def test_predictions_that_are_far_off_are_missed_by_more_than_first_states() -> None:
    above, windows = {"0": 4.0, "1": 1.0}, {"0": np.array([35.0, 48.0]), "1": np.array([60.0])}
    typical = math.sqrt(36.0 * 49.0) - 1
    assert far_off(above, windows) == pytest.approx(math.sqrt(typical - 1))
    assert far_off({"0": 1.0, "1": 4.0}, windows) == pytest.approx(math.sqrt(59.0))
    # A residual that is the sensor's noise leaves nothing that a state may have hidden.
    assert far_off({"0": 1.2, "1": 1.2}, windows) == 0.0
    # One window that begins in the middle of a jerk is not typical.
    assert far_off({"0": 4.0}, {"0": np.array([*[1.0] * 20, 240.0])}) == 0.0
    assert far_off({"0": 4.0}, {"0": np.zeros(0)}) == 0.0


@pytest.mark.parametrize(("value", "std", "sure"), [(14.0, 0.2, True), (-3.0, 1.0, True), (0.3, 0.2, False)])
def test_an_effect_within_two_standard_deviations_of_none_is_doubted(
    value: float, std: float, sure: bool
) -> None:
    reasons = doubted([friction(value, std)], {"load_friction": ("force",)})
    assert bool(reasons) is not sure


def test_a_strength_is_judged_with_the_shapes_of_its_own_effect_held() -> None:
    """Size and time constant of a decay whose end is not seen are known together only."""
    paths = ["force_drift.share", "force_drift.time_constant", "creep.slow_time", "load_friction.force"]
    own = fit(**{f"effects.{path}": (1.0, f"effects.{path}") for path in paths})
    own.parameters["mass"] = SimpleNamespace(value=1.0, path="mass")
    held: dict[str, list[str]] = {}
    own.std_given = lambda name, others: held.update({name: list(others)}) or 0.1
    assert strength_stds(own, "force_drift", ("share",)) == {"effects.force_drift.share": 0.1}
    assert held == {"effects.force_drift.share": ["effects.force_drift.time_constant"]}
    assert strength_stds(own, "load_friction", ("force", "other")) == {"effects.load_friction.force": 0.1}
    assert strength_stds(own, "constant:mass", ("mass",)) == {}


def test_an_effect_that_ends_at_none_is_doubted_though_its_std_is_zero() -> None:
    assert doubted([friction(0.0, 0.0)], {"load_friction": ("force",)})


@pytest.mark.parametrize(("taken_up", "sure"), [((4e4, 500.0), True), ((300.0, 500.0), False)])
def test_an_effect_without_its_strength_is_there_where_a_further_one_is(
    taken_up: tuple[float, float], sure: bool
) -> None:
    """A bladder may take up pressure and not resist contraction."""
    own = {"stiffness": Estimate(0.0, 0.0, "N", ""), "threshold_pressure": Estimate(*taken_up, "Pa", "")}
    bladder = FoundEffect("bladder_stiffness", "muscle_force", "", "", own, 0.9, 1e-4)
    reasons = doubted([bladder], {"bladder_stiffness": strengths_of(BY_NAME["bladder_stiffness"])})
    assert bool(reasons) is not sure


@pytest.mark.parametrize(("largest", "refused"), [(None, False), (15.0, False), (13.0, True)])
def test_a_strength_beyond_what_real_machines_have_is_told(largest: float | None, refused: bool) -> None:
    for value in (14.0, -14.0):
        found = [friction(value, 0.2)]
        reasons = beyond_machines(found, {"load_friction": ("force",)}, {"load_friction": largest})
        assert bool(reasons) is refused
        told = f"its strength, {value:.0f} N, is beyond what real machines have, 13 N"
        assert not refused or reasons["load_friction"] == told
    # One that does not differ from none may be of any size: that is why it is none.
    assert not beyond_machines([friction(14.0, 8.0)], {"load_friction": ("force",)}, {"load_friction": 1.0})


@pytest.mark.parametrize(
    ("share", "time_constant", "refused"),
    [(1.0, 5.0, True), (-1.5, 100.0, True), (0.4, 5.0, False), (1.0, 1000.0, False)],
)
def test_half_of_the_force_is_lost_within_a_recording_at_most(
    share: float, time_constant: float, refused: bool
) -> None:
    """Of a decay far slower than the recording only share over time is told, and its share may be any."""
    drift = ForceDrift(share=share, time_constant=time_constant)  # pyright: ignore[reportArgumentType]
    values = {"share": Estimate(share, 1e-3, "", ""), "time_constant": Estimate(time_constant, 1.0, "s", "")}
    found = FoundEffect("force_drift", "muscle_force", "", "", values, 0.9, 1e-4)
    most = {"force_drift": drift.largest_on(100.0, {})}
    assert bool(beyond_machines([found], {"force_drift": ("share",)}, most)) is refused


@pytest.fixture(scope="module")
def lift():
    return case(jm.read(jm.sample("lift")).part(0, 3000), 0.3)


def largest(prepared: Any, **effect: AbstractEffect) -> float | None:
    (name,) = effect
    return largest_strength(prepared, prepared.actuator.with_effects(**effect), name)


def test_a_play_is_narrower_than_half_the_range_of_its_reading(lift: Any) -> None:
    """Of what is not held out: that has no say."""
    seen = ~held_out_rows(lift)
    assert 0 < seen.sum() < len(seen)
    position = lift.recording.columns["position"][seen]
    way = max(position.max(), 0.0) - min(position.min(), 0.0)
    assert largest(lift, backlash=Backlash(half_width=1e-3)) == pytest.approx(way / 4)  # pyright: ignore[reportArgumentType]
    assert largest_strength(lift, lift.actuator, "constant:mass") is None


def test_a_sensor_drifts_by_a_fifth_of_what_it_shows_at_most(lift: Any) -> None:
    """A pressure that is held nearly constant may drift by as much as one that moves."""
    of_pressure = reading_effect("sensor_drift", "pressure")(rate=1.0)  # pyright: ignore[reportCallIssue]
    seen = ~held_out_rows(lift)
    duration = seen.sum() * lift.recording.step
    shown = lift.recording.columns["pressure"][seen].max() - 101325.0
    most = 0.2 * shown / duration
    assert largest(lift, sensor_drift_pressure=of_pressure) == pytest.approx(most)
    flat = dataclasses.replace(lift.filled, columns={**lift.filled.columns, "pressure": np.full(3000, 4e5)})
    held = dataclasses.replace(lift, filled=flat)
    most = 0.2 * (4e5 - 101325.0) / duration
    assert largest(held, sensor_drift_pressure=of_pressure) == pytest.approx(most)


def test_errors_of_any_sensor_and_delays_have_a_largest_size() -> None:
    assert reading_effect("clock_offset", "position").largest == 1.0
    assert BY_NAME["command_delay"].largest == 1.0
    assert BY_NAME["load_friction"].largest is None  # by the size of the machine


def test_held_out_errors_confirm_by_their_mean_and_not_below_the_noise() -> None:
    assert confirmed(held_out(position=9.0, pressure=1.1), held_out(position=1.2, pressure=1.2))
    assert not confirmed(held_out(position=2.0, pressure=1.5), held_out(position=2.1, pressure=1.5))
    assert not confirmed(held_out(force=0.99), held_out(force=0.9))


def test_held_out_data_that_err_more_are_a_surprise() -> None:
    def errors(seen: float, unseen: float) -> dict[str, dict[str, Error]]:
        return {"training": held_out(angle=seen)["held_out"], **held_out(angle=unseen)}

    assert surprise(errors(3.0, 8.6)) == pytest.approx(math.sqrt(8.6**2 - 9))
    assert surprise(errors(0.5, 3.0)) == pytest.approx(math.sqrt(8.0))
    assert surprise(errors(3.4, 3.7)) == surprise(errors(0.5, 1.9)) == 0.0


def test_share_that_is_left_is_that_of_the_typical_residual():
    flat = np.ones(10)
    assert share_left({"angle": 170.0**2 * flat}, {"angle": 117.0**2 * flat}) == pytest.approx(
        117 / 170, rel=1e-3
    )
    before = {"angle": 400.0**2 * flat, "pressure": 1.1 * flat}
    assert share_left(before, {"angle": 3.0**2 * flat, "pressure": flat}) < EXPLAINED
    assert share_left({"angle": 16.0 * flat}, {"angle": 0.9 * flat}) == 0.0
    assert share_left({"angle": 16.0 * flat}, {"angle": 16.0 * flat}) == 1.0
    assert share_left({"angle": 16.0 * flat}, {"angle": 25.0 * flat}) > 1.0
    assert share_left({"angle": 1.2 * flat}, {"angle": 1.1 * flat}) == 0.0


def test_noise_of_another_reading_is_no_share_that_is_left():
    """Coloured pressures of a joint, as much again as their sensors' noise, stay what they were."""
    angle, pressure = np.full(20, 16.0**2), np.full(20, 2.4)
    before = {"angle": angle, "pressure_1": pressure}
    assert share_left(before, {"angle": angle / 64, "pressure_1": pressure}) == pytest.approx(0.11, abs=0.02)
    worse = {"angle": angle / 64, "pressure_1": np.full(20, (MISSING + 1) ** 2)}
    assert share_left(before, worse) > 1


def test_one_bad_window_says_nothing_of_the_share():
    before, after = np.full(20, 200.0**2), np.full(20, 5.0**2)
    after[3] = 1e6
    assert share_left({"angle": before}, {"angle": after}) < 0.1
    assert math.sqrt(after.mean() / before.mean()) > 1


def test_a_value_far_from_the_card_is_named_with_its_distance() -> None:
    priors = {"muscle.end_factor": Prior(1.3, 0.05), "valve.area": Prior(1e-6, 1e-7)}
    final = fit(1.0, end_factor=(1.1, "muscle.end_factor"), valve_area=(1.1e-6, "valve.area"))
    assert violated_priors(final, priors) == {"end_factor": pytest.approx(4.0)}
    assert violated_priors(None, priors) == {}


@pytest.mark.parametrize(("size", "share", "within"), [(20, 0.9, True), (20, 1.1, False), (1e3, 0.9, False)])
def test_a_law_of_friction_may_leave_a_few_hundredths_that_are_little(
    size: float, share: float, within: bool
) -> None:
    """Of friction of `size` noise units; of a large one they are more than is said to be missing at all."""
    left = share * FORM_OF_FRICTION * size
    assert within_form_of_friction(1 + left**2, 1 + size**2) == within
    assert not within_form_of_friction(1 + size**2, 1 + size**2)
