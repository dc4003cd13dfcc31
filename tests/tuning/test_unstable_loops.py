"""Gains with which a linearised loop is unstable: beyond the limit of stability the sensitivity falls again,
and a descent that minds it must not end there.
"""

import dataclasses
from typing import Any

import numpy as np
import pytest
from actuators.fan import STEP, TRUE, fan
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.control import PID, feedback_on, margins
from jaxmuscle.control.stability_margins import is_stable, machine_response, spectral_radius
from jaxmuscle.effects import CommandDelay
from jaxmuscle.tuning.tune import prepared

REST = float(np.sqrt(TRUE["torque_constant"] / TRUE["drag"]))
MACHINE = fan().with_effects(command_delay=built(CommandDelay, 3 * STEP))
TIMES = STEP * np.arange(20)
UP = jm.tuning.Scenario(
    np.where(TIMES < 0.1, REST, REST + 15.0), TIMES, start={"speed": REST}, noise={"speed": 0.1}, name="up"
)
CALM, WILD = {"proportional": 0.3, "integral": 1.0}, {"proportional": 30.0, "integral": 1.0}
SIZES = {"tracking": 15.0, "sensitivity": 0.5}


def begun() -> PID:
    return built(PID, *CALM.values())


def test_the_spectral_radius_by_hand():
    # Without delay and integral the fan is ω' = (a - b k) ω; its outlet's temperature the loop does not see.
    model, _ = machine_response(fan(), STEP, feedback_on(fan(), begun()))
    for gain in (0.5, 300.0):
        pole = float(model.a[0, 0] - model.b[0] * model.c[0] * gain)
        largest = max(abs(pole), float(model.a[1, 1]))
        assert spectral_radius(model, built(PID, gain), STEP) == pytest.approx(largest, rel=1e-9)
        assert is_stable(model, built(PID, gain), STEP) == (gain < 1)


@pytest.mark.slow
def test_an_unstable_loop_costs_infinitely_much():
    evaluation = prepared(MACHINE, begun(), UP, SIZES)
    unknowns = evaluation.unknowns
    assert unknowns.names == tuple(CALM)
    calm, wild = (np.array(list(gains.values())) for gains in (CALM, WILD))
    for gains in (CALM, WILD):
        at = np.array(list(gains.values()))
        assert evaluation.unstable(at, [0])[0] != margins(MACHINE, built(PID, *at), STEP).stable
    assert not evaluation(unknowns.coordinates(wild)[None])[0].finite
    seen, runs = evaluation.seen(wild, [0]), evaluation.unbarred().seen(wild, [0])
    assert np.isinf(seen.terms["sensitivity"][0]) and np.isinf(evaluation.cost(seen))
    np.testing.assert_array_equal(seen.readings["speed"], runs.readings["speed"])
    # What the bar is for: the run alone, and the falling sensitivity, make the wild gains the better ones.
    assert evaluation.cost(runs) < 0.2 * evaluation.cost(evaluation.seen(calm, [0]))


def test_nobody_is_judged_by_a_margin_that_was_not_asked_for():
    evaluation = prepared(MACHINE, begun(), UP, {"tracking": 15.0})
    wild = np.array(list(WILD.values()))
    assert not evaluation.unstable(wild, [0]).any()


def tuned(starts: Any, **more: Any) -> jm.tuning.Tuning:
    return jm.tune(MACHINE, begun(), UP, SIZES, starts=starts, steps=6, **more)


@pytest.mark.slow
def test_a_tuning_ends_at_a_stable_loop_though_an_unstable_one_seems_cheaper():
    found = tuned([CALM, WILD])
    assert margins(MACHINE, found.controller, STEP).stable
    assert 0.3 < found.after.cost < found.before.cost
    assert any("At 1 of 2 starts the loop ran away or was unstable, linearised" in n for n in found.notes)


@pytest.mark.slow
def test_a_descent_from_an_unstable_loop_begins_at_smaller_gains():
    wild = built(PID, *WILD.values())
    found = jm.tune(MACHINE, wild, [UP], SIZES, held_out=[dataclasses.replace(UP, seed=1)], starts=1, steps=6)
    assert np.isinf(found.before.cost) and np.isinf(found.before.value("sensitivity"))
    assert margins(MACHINE, found.controller, STEP).stable and found.holds
    assert any("unstable at its start gains: linearised, in scenario up" in note for note in found.notes)
    assert "not finite" in str(found)


@pytest.mark.slow
def test_where_no_loop_is_stable_the_runs_judge_and_that_is_told():
    found = jm.tune(
        MACHINE, built(PID, 30.0, 1.0), UP, SIZES, starts=1, steps=3, bounds={"proportional": (20.0, 50.0)}
    )
    assert np.isfinite(found.after.cost) and not margins(MACHINE, found.controller, STEP).stable
    assert any("No gains were found with which the linearised loop is stable" in note for note in found.notes)
    assert any("unstable in scenario up" in note for note in found.notes)
