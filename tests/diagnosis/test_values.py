"""The values that a diagnosis reports: those of a fit, and by how much fits to parts of the data disagree."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from oracles import bench
from oracles.recorded import clock, driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.diagnosis.last_fit import FIT_STEPS, estimates
from jaxmuscle.diagnosis.settled_fit import SETTLED
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.effects import LoadFriction
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import get
from jaxmuscle.report.report_files import write
from jaxmuscle.robot import robot

SMALL = 0.1
"""Distance of two values, in standard deviations, that no reader would take notice of."""


def refitted(diagnosis, recording, **how):
    """Distance of each value of the report from that of a fit of its model, in the report's deviations."""
    masks = diagnosis.traces.held_out
    fit = jm.fit(diagnosis.model, recording, masks=masks, noise="discrepancy", **how)
    assert fit.code in SETTLED
    reported = diagnosis.parameters
    return {name: (v - reported[name].value) / reported[name].std for name, v in fit.values.items()}


@pytest.mark.slow
@pytest.mark.parametrize(("sample", "effects"), [("lift", [LoadFriction]), ("bench", [])])
def test_fit_of_the_found_model_gives_the_reported_values(sample, effects):
    """Of the lift with an effect that was found; of the others as declared, which is quicker."""
    recording = jm.read(jm.sample(sample))
    diagnosis = jm.diagnose(recording, catalogue=effects, constants=False)
    assert [e.name for e in diagnosis.effects] == [e.name for e in effects]
    names = list(diagnosis.parameters)
    for free in (names, None):
        off = refitted(diagnosis, recording, free=free)
        assert max(map(abs, off.values())) < SMALL, off
    assert diagnosis.fit is not None
    assert set(diagnosis.fit.values) == set(names)
    for name, entry in diagnosis.parameters.items():
        assert entry.value == diagnosis.fit.values[name]
        assert entry.std >= diagnosis.fit.std[name] > 0


def _recorded(rig, command, free, noise):
    """What the rig's model gives under `command`, with noise, and a card that is not sure of `free`."""
    machine = robot(0.5) if rig == "scara" else bench.model(rig)
    times = clock(len(command), bench.STEPS.get(rig, 4e-3))
    frame = jm.simulate(machine, command, times).to_frame()
    rng, columns = np.random.default_rng(3), {}
    for name in frame:
        level = noise[str(name).split("_")[0]]
        columns[str(name)] = np.asarray(frame[name]) + level * rng.normal(size=len(times))
    levels = {name: noise[name.split("_")[0]] for name in columns}
    table = pd.DataFrame(np.asarray(command).reshape(len(times), -1), columns=list(machine.commands))
    columns |= {name: np.asarray(table[name]) for name in machine.commands}
    found = jm.recording(machine, columns, float(times[1]), noise=levels)
    values = {name: float(get(machine, name)) for name in free}
    off = {name: (1.05 * value, 0.2 * abs(value)) for name, value in values.items()}
    return dataclasses.replace(found, card=found.card.updated(off, {}))


def _waves():
    times = np.arange(500) * 4e-3
    waves = [1e5 * np.sin(2 * np.pi * f * times + p) for f, p in ((0.8, 0.0), (1.1, 1.0))]
    return bench.AMBIENT + 2.5e5 + np.stack([waves[0], -waves[0], waves[1], -waves[1]], axis=1)


OTHERS = {
    "elbow": (bench.elbow_command, ("regulator_frequency", "density"), {"pressure": 400.0, "angle": 3e-3}),
    "scara": (_waves, ("payload",), {"pressure": 400.0, "angle": 4e-4}),
}


@pytest.mark.thorough
@pytest.mark.parametrize("rig", OTHERS)
def test_other_rigs_keep_the_promise(rig):
    """With nothing to choose from: the declared model alone, on a recording of each rig."""
    command, free, noise = OTHERS[rig]
    recording = _recorded(rig, command(), free, noise)
    diagnosis = jm.diagnose(recording, catalogue=(), constants=False)
    off = refitted(diagnosis, recording)
    assert set(off) == set(diagnosis.parameters) == set(free)
    assert max(map(abs, off.values())) < SMALL, off


@pytest.mark.slow
def test_priors_do_not_hold_constants_against_an_error_as_long_as_the_recording():
    """A jet pipe that lacks nothing, two of its constants two standard deviations from the card's values."""
    recorded = _recorded("jet-pipe", bench.jet_pipe_command(), (), {"current": 5e-4, "force": 0.2})
    given = bench.CARDS["jet-pipe"]
    stds = {"pipe_compliance": 4e-5, "receiver_offset": 1e-5}
    off = {name: (given[name] + 2 * std, std) for name, std in stds.items()}
    ready = case(dataclasses.replace(recorded, card=recorded.card.updated(off, {})), 0.3)
    own, problem = workbench(ready, ()), ready.training.in_parts(4)
    held = own.settled(own.model, [], problem, FIT_STEPS)
    assert held.independent_readings == 1
    assert own.mean_squares(held.model, problem)["force"] > 100
    found = own.first_fit(problem, FIT_STEPS)
    assert max(own.mean_squares(found.model, problem).values()) < 1.1
    assert own.farthest_from_card(found.model) < 2.5


@pytest.mark.slow
def test_a_card_that_is_sure_of_everything_is_diagnosed_and_reported(tmp_path):
    recording = driven_recording({}, driven_card({}), seconds=8.0)
    sure = {name: (quantity.value, None) for name, quantity in recording.card.uncertain.items()}
    known = dataclasses.replace(recording, card=recording.card.updated(sure, {}))
    diagnosis = jm.diagnose(known, catalogue=())
    assert (diagnosis.verdict, diagnosis.fit, diagnosis.parameters) == ("complete", None, {})
    assert {path.name for path in write(diagnosis, tmp_path)} == {"result.json", "card.toml", "report.html"}


def test_fits_that_disagree_widen_the_deviations():
    """Delete-a-group jackknife: (G-1)/G times the sum of squared deviations from the mean of G fits."""
    machine, paths = bench.model("driven"), ("muscle.initial_radius", "muscle.end_factor")
    entries: dict[str, Any] = {path: SimpleNamespace(value=7e-3, std=1e-5, path=path) for path in paths}
    for entry in entries.values():
        entry.unit, entry.meaning = "m", ""
    radii = np.array([6.8e-3, 7.1e-3, 7.2e-3])
    folds = [jm.replace(machine, {paths[0]: radius}) for radius in radii]
    final: Any = SimpleNamespace(parameters=entries)
    wide, alone = estimates(final, folds), estimates(final, ())
    assert wide[paths[0]].std == pytest.approx(np.sqrt(2 / 3 * ((radii - radii.mean()) ** 2).sum()))
    assert wide[paths[1]].std == alone[paths[1]].std == alone[paths[0]].std == 1e-5
    assert wide[paths[0]].value == alone[paths[0]].value == 7e-3
