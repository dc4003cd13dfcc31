"""Partial residuals: against what an effect is shown, and that it is seen there."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from oracles import bench
from oracles.driven import driven
from oracles.recorded import NOISE, STEP, clock, driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.diagnosis.card_constants import card_constants
from jaxmuscle.diagnosis.diagnosis_data import Pattern, Unexplained
from jaxmuscle.diagnosis.discrepancy import missing_rates
from jaxmuscle.diagnosis.partial_residual import holds, reveal
from jaxmuscle.effects import (
    CATALOGUE,
    FURTHER,
    Creep,
    DeadBand,
    ForceDrift,
    LengthHysteresis,
    PressureDependentEnds,
)
from jaxmuscle.effects.base import COMMANDED, LOG_TIME, LOOP, TIME, VARIABLE
from jaxmuscle.estimation.case import case
from jaxmuscle.figure_style import styled
from jaxmuscle.parameters import replace
from jaxmuscle.report.figures import directions, reveal_figure, titles
from jaxmuscle.report.page import LINES

CREEP = {"stiffness": 300.0, "fast_time": 0.4, "slow_time": 3.0}
LOOPED = {"weight": 0.4, "asymmetry": 0.0, "density_width": 0.1}


def shown(recording, effect, **values):
    """What is shown of an effect, of a model that has it."""
    prepared = case(recording, 0.3)
    model = prepared.actuator.with_effects(**{effect.name: effect(**values)})
    found = reveal(prepared, model, effect, missing_rates(prepared, model))
    assert found is not None
    return found


def stepped():
    """A test machine that stretches a muscle in steps of 6 s, each of 0.1 s, at constant pressure."""
    places = np.repeat([0.02, 0.035, 0.015, 0.04, 0.025, 0.03], round(6 / STEP))
    ramp = np.ones(10) / 10
    position = np.convolve(np.pad(places, (10, 10), mode="edge"), ramp, mode="same")[10:-10]
    pressure = np.full(len(position), bench.AMBIENT + 3e5)
    velocity = np.gradient(position, STEP)
    force = driven(bench.CARDS["driven"], {"creep": CREEP}, pressure, position, velocity)
    noise = NOISE * np.random.default_rng(2).normal(size=len(force))
    columns = {"pressure": pressure, "position": position, "force": force + noise}
    return jm.Recording("steps", None, None, driven_card({}), clock(len(force), STEP), STEP, columns)


@pytest.fixture(scope="module")
def crept():
    return shown(stepped(), Creep, **CREEP)


def test_creep_is_shown_over_the_time_since_the_last_move(crept):
    assert (crept.view, crept.variable, crept.variable_unit) == (LOG_TIME, "time since the last move", "s")
    held = np.isfinite(crept.x)
    assert 0.8 < held.mean() < 1.0, "but for the moves themselves"
    assert crept.x[held].min() == pytest.approx(STEP) and 5 < crept.x[held].max() < 6
    late, early = crept.x > 4, crept.x < 0.2
    assert np.median(crept.before[late]) > 5 * NOISE and abs(np.median(crept.before[early])) < NOISE
    assert abs(np.median(crept.after[late])) < NOISE, "with the creep nothing goes on"


def test_holds_are_where_nothing_moves():
    found = holds(case(stepped(), 0.3))
    assert len(found) == 6 and all(5 < len(rows) * STEP <= 6 for rows in found)
    assert holds(case(driven_recording({}, driven_card({})), 0.3)) == []


def test_where_nothing_is_held_creep_is_shown_against_a_variable():
    found = shown(driven_recording({"creep": CREEP}, driven_card({})), Creep, **CREEP)
    assert found.view == VARIABLE and found.variable in ("position", "pressure", "velocity")


def test_a_hysteresis_is_a_loop_that_closes_with_it():
    recording = driven_recording({"length_hysteresis": LOOPED}, driven_card({}))
    found = shown(recording, LengthHysteresis, **LOOPED)
    assert (found.view, found.variable) == (LOOP, "position"), "not against a velocity"
    ways, middle = directions(found.x), np.abs(found.x - np.median(found.x)) < 5e-3
    gaps = [
        np.median(y[middle & (ways == -1)]) - np.median(y[middle & (ways == 1)])
        for y in (found.before, found.after)
    ]
    assert gaps[0] > 5 * NOISE and abs(gaps[1]) < 0.5 * NOISE


@pytest.mark.slow
def test_a_dead_band_is_shown_against_the_command():
    machine, step = bench.model("isotonic"), bench.STEPS["isotonic"]
    command = bench.isotonic_command()
    dead_band: Any = DeadBand
    readings = jm.simulate(
        machine.with_effects(dead_band=dead_band(width=0.6)), command, np.arange(len(command)) * step
    ).readings
    columns = {"command": command, **{name: np.asarray(values) for name, values in readings.items()}}
    noise = {"pressure": 300.0, "position": 5e-5}
    found = shown(jm.recording(machine, columns, step, noise=noise), DeadBand, width=0.6)
    assert (found.view, found.variable, found.variable_unit) == (COMMANDED, "command", "V")
    np.testing.assert_array_equal(found.x, command)
    assert np.nanstd(found.after) < 0.5 * np.nanstd(found.before)


def test_a_drift_is_shown_over_time():
    recording = driven_recording({}, driven_card({}))
    found = shown(recording, ForceDrift)
    assert found.view == TIME and (found.x == recording.time).all()


def test_without_an_effect_a_pattern_says_how_what_is_left_is_shown():
    prepared = case(driven_recording({}, driven_card({})), 0.3)
    missing = missing_rates(prepared, prepared.actuator)

    def by(kind, variable, at, unit):
        left = Unexplained("muscle_force", 0.1, ("pressure",), 9.0, Pattern(kind, variable, at, unit, 0.9))
        found = reveal(prepared, prepared.actuator, None, missing, [left])
        assert found is not None and found.effect is None
        return found

    tone = by("tone", "time", 6.7, "Hz")
    assert (tone.variable, tone.variable_unit, tone.view) == ("time within a period", "s", VARIABLE)
    assert 0 <= tone.x.min() < tone.x.max() < 1 / 6.7
    ripple = by("ripple", "position", 0.01, "m")
    assert (ripple.variable, ripple.variable_unit, ripple.view) == ("position", "m", VARIABLE)
    constant = by("constant", "time", -3.0, "N")
    for found in (by("jump", "time", 9.0, "s"), by("drift", "time", None, "s"), constant):
        assert (found.variable, found.variable_unit, found.view) == ("time", "s", TIME)


def test_what_an_effect_does_not_say_is_a_variable_and_so_is_a_constant():
    recording = driven_recording({}, driven_card({}))
    assert shown(recording, PressureDependentEnds, amplitude=0.8).view == VARIABLE
    prepared = case(recording, 0.3)
    (angle,) = (each for each in card_constants(prepared) if each.quantity == "braid_angle")
    model = replace(prepared.actuator, {angle.path: 1.1 * angle.declared})
    found = reveal(prepared, model, angle, missing_rates(prepared, model))
    assert found is not None and (found.view, found.effect) == (VARIABLE, "constant:braid_angle")
    assert np.std(found.before) < np.std(found.after), "the card is right here"


def test_every_effect_names_a_view_that_there_is():
    assert {effect.view for effect in (*CATALOGUE, *FURTHER)} == {VARIABLE, LOOP, COMMANDED, LOG_TIME, TIME}


@pytest.mark.parametrize("view", [VARIABLE, LOOP, COMMANDED, LOG_TIME, TIME])
def test_every_view_is_drawn(crept, view):
    with styled():
        # Time only rises: a loop needs something that falls, too.
        x = 0.03 + 0.01 * np.sin(np.arange(len(crept.x)) / 200) if view == LOOP else crept.x
        drawing = reveal_figure(dataclasses.replace(crept, x=x, view=view))
    left, right = drawing.axes
    assert left.get_xscale() == ("log" if view == LOG_TIME else "linear")
    assert "creep" in left.get_title(loc="left") and "creep" in right.get_title(loc="left")
    lines = [
        line for line in left.lines if line.get_linestyle() == "-" and np.shape(line.get_xydata())[0] > 2
    ]
    assert len(lines) == (2 if view == LOOP else 1)
    assert (view in LINES) is (view in (LOOP, LOG_TIME))


def test_what_is_left_out_is_said():
    assert titles("creep") == ("without creep", "with creep")
    assert titles("constant:braid_angle") == ("braid angle of the card", "braid angle as found")


def test_directions():
    x = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50), np.zeros(30)])
    ways = directions(x)
    assert (ways[8:42] == 1).all() and (ways[58:92] == -1).all() and (ways[106:] == 0).all()
