"""A column that is read late begins windows with later readings: that is a head start, and no evidence."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from oracles import bench
from scipy.signal import butter, filtfilt

import jaxmuscle as jm
from jaxmuscle.diagnosis.evidence import blocks
from jaxmuscle.diagnosis.head_start import head_start, residuals_begun_later, sought_delays
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.effects import reading_effect
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import replace
from jaxmuscle.simulation.track import with_earlier_commands

STEP = bench.STEPS["joint"]
NOISE = {"pressure_1": 300.0, "pressure_2": 300.0, "angle": 1e-3}
LATE: Any = reading_effect("clock_offset", "angle")


def turned(repeats, *, inertia=0.04, late=0.0, shaken=0.0, noise=1.0):
    """A recording of a joint that was turned `repeats` times, and its machine.

    `late`: time by which its angle is read late; `shaken`: by how many noise units the frame of its sensor
    shakes, up to 3 Hz; `noise`: part of the noise of its sensors that there is.
    """
    machine = replace(bench.model("joint"), {"inertia": inertia})
    command = np.tile(bench.joint_command(), (repeats, 1))
    time, rng = np.arange(len(command)) * STEP, np.random.default_rng(1)
    readings = jm.simulate(machine, command, time).readings
    pressure, angle = np.asarray(readings["pressure"]), np.asarray(readings["angle"])
    slow: Any = butter(2, 3.0 * 2 * STEP)
    frame = filtfilt(slow[0], slow[1], rng.normal(size=len(time)))
    angle = np.interp(time - late, time, angle + shaken * NOISE["angle"] * frame / frame.std())
    columns = {"pressure_1": pressure[:, 0], "pressure_2": pressure[:, 1], "angle": angle}
    noisy = {name: noise * size * rng.normal(size=len(time)) for name, size in NOISE.items()}
    columns = {name: values + noisy[name] for name, values in columns.items()}
    columns |= {name: command[:, i] for i, name in enumerate(machine.commands)}
    return machine, jm.recording(machine, columns, STEP, noise=NOISE, horizon=0.1)


def ready(*args, **kwargs):
    """A workbench, its problem, and its machine with the angle read late by a time, or without."""
    machine, recording = turned(*args, **kwargs)
    prepared = case(recording, 0.3)
    made = workbench(prepared, [LATE])
    return made, prepared.training, lambda delay: machine.with_effects(clock_offset_angle=LATE(delay=delay))


def test_commands_come_earlier_and_none_crosses_a_break():
    _, recording = turned(1)
    broken = dataclasses.replace(recording, breaks=(300,))
    track = case(broken, 0.0).problem.track
    found = np.asarray(with_earlier_commands(track, 2.5 * STEP).command)
    command = np.asarray(track.command)
    between = 0.5 * (command[2:-3] + command[3:-2])
    whole = np.r_[0:297, 300 : len(found) - 5]
    np.testing.assert_allclose(found[whole], between[whole], rtol=1e-12)
    for end in (300, len(command)):
        np.testing.assert_array_equal(found[end - 2 : end], command[[end - 1, end - 1]])
    np.testing.assert_array_equal(with_earlier_commands(track, 0.0).command, command)


@pytest.mark.slow
def test_only_a_candidate_that_is_read_late_has_one():
    made, problem, late = ready(1, shaken=30.0)
    block = blocks(len(problem.rows), problem.samples, int(problem.period))
    judged = np.arange(len(problem.rows))
    assert sought_delays(made, late(5e-3)) == {"angle": 5e-3}
    for delay in (0.0, -5e-3):
        assert sought_delays(made, late(delay)) == {}
        assert not head_start(made, late(delay), problem, block, judged).any()
    declared = late(5e-3).with_effects(other=reading_effect("clock_offset", "pressure_1")(**{"delay": 1e-3}))
    assert sought_delays(made, declared) == {"angle": 5e-3}
    losses = head_start(made, late(2e-2), problem, block, judged)
    assert losses.shape == (2, len(judged)) and losses.min() == 0.0
    outputs = list(made.residuals(late(0.0), problem))
    assert np.mean(losses[outputs.index("angle")]) > 0.3
    assert np.all(losses[outputs.index("pressure")] == 0.0)


@pytest.mark.slow
def test_everything_read_later_leaves_what_nothing_read_later_does():
    """Of a right model, without noise; but for the straight line back from where windows begin. Between
    samples, for a command that steps, too.
    """
    made, problem, late = ready(2, noise=1e-3)

    def left(values):
        return np.sqrt((values[:, 2:] ** 2).mean())

    plain = made.residuals(late(0.0), problem)
    later = residuals_begun_later(made, late(0.0), problem, {"angle": 2 * STEP})
    np.testing.assert_array_equal(later["pressure"], plain["pressure"])
    assert left(later["angle"]) < 1.1 * left(plain["angle"]) < 0.05
    assert left(made.residuals(late(2 * STEP), problem)["angle"]) > 5.0, "the angle alone"
    between = residuals_begun_later(made, late(0.0), problem, {"angle": 2.5 * STEP})
    assert left(between["angle"]) < 0.2 * left(made.residuals(late(2.5 * STEP), problem)["angle"])


@pytest.mark.slow
def test_everything_read_later_leaves_less_of_what_a_model_lacks():
    """With nothing explained."""
    made, problem, late = ready(2, inertia=0.8, shaken=30.0)
    one, other = (
        residuals_begun_later(made, late(0.0), problem, ahead)["angle"] for ahead in ({}, {"angle": 2e-2})
    )
    assert 0.1 < (other**2).mean() / (one**2).mean() < 0.7


@pytest.mark.thorough
def test_a_frame_that_shakes_is_no_clock_offset():
    """It was found as one of 45.4 ± 0.7 ms, in windows of 100 ms."""
    _, recording = turned(8, inertia=0.8, shaken=30.0)
    found = jm.diagnose(recording, catalogue=[LATE], constants=False)
    assert found.verdict == "unexplained" and not found.effects
    ((entry,),) = (each.ranking for each in found.rounds)
    assert entry.judged and entry.gain < 0.05


@pytest.mark.thorough
@pytest.mark.parametrize("late", [6e-3, -6e-3])
def test_an_angle_that_is_read_late_or_early_is_found_in_windows_of_a_tenth_of_a_second(late):
    _, recording = turned(3, late=late)
    found = jm.diagnose(recording, catalogue=[LATE], constants=False)
    assert found.verdict == "effects found" and [e.name for e in found.effects] == ["clock_offset_angle"]
    delay = found.effects[0].parameters["delay"]
    assert abs(delay.value - late) < 2 * delay.std and delay.std < 3e-4
