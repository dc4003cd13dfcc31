"""Initial states as parameters: recordings that begin in the middle of a motion."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from estimation.made import DAMPING, changed, pulled, within
from oracles import bench
from oracles.driven import driven
from oracles.isotonic import isotonic
from oracles.recorded import NOISE, smooth_motion

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.estimation.dataset import station
from jaxmuscle.estimation.parameter_layout import layout
from jaxmuscle.estimation.request import Asked
from jaxmuscle.estimation.residuals import chain_predictions, values_and_slopes

FIRST, LENGTH = 180, 260
"""First sample and number of samples of a part in which the valve is half open from the start."""
SLOW_VALVE = {**bench.CARDS["isotonic"], "valve_time_constant": 0.08}
STIFFNESS, FAST, SLOW = 500.0, 0.5, 3.0
BEGIN = (0.02, 0.005)
"""States of a creep that began long before the recording."""


@pytest.fixture(scope="module")
def part():
    """The lifting bench with a slow valve, from the oracle; recorded only from the middle of a charge on."""
    command = bench.isotonic_command()[FIRST - 150 : FIRST + LENGTH]
    pressure, position, _ = isotonic(SLOW_VALVE, DAMPING, command, bench.STEPS["isotonic"], bench.AMBIENT, 4)
    rng, rows = np.random.default_rng(0), slice(150, None)
    columns = {
        "command": command[rows],
        "pressure": pressure[rows] + 200 * rng.normal(size=LENGTH),
        "position": position[rows] + 1e-5 * rng.normal(size=LENGTH),
    }
    machine = jm.replace(bench.model("isotonic", **DAMPING), {"valve.time_constant": 0.08})
    noise = {"pressure": 200.0, "position": 1e-5}
    return machine, jm.recording(machine, columns, bench.STEPS["isotonic"], noise=noise, name="part")


def opening_at(row, command, tau=0.08, step=bench.STEPS["isotonic"]):
    """Of a first-order valve from rest, exactly."""
    opening = 0.0
    for u in command[:row]:
        opening += (u / 5.0 - opening) * (1 - np.exp(-step / tau))
    return opening


@pytest.mark.slow
def test_a_valve_that_is_open_already(part):
    """Taken to be shut, it has another area, of which little is known; as a parameter, both are found."""
    machine, recording = part
    rest = jm.fit(machine, recording, ["valve_area"])
    fit = jm.fit(machine, recording, ["valve_area", "start.opening"], bounds={"start.opening": (-1, 1)})
    assert abs(rest.values["valve_area"] / 2e-6 - 1) > 0.05
    assert rest.std["valve_area"] > 5 * fit.std["valve_area"]
    assert within(fit, "valve_area", 2e-6)
    true = opening_at(150, bench.isotonic_command()[FIRST - 150 :])
    assert abs(true) > 0.1
    assert within(fit, "start.opening", true) and fit.std["start.opening"] < 0.05
    assert fit.cost < 0.2 * rest.cost


def crept(seed=0, name="crept"):
    """A pulled muscle, never slack, with creep that began before the recording; exact in plain NumPy."""
    pressure, position, velocity = smooth_motion(8.0)
    pressure = pressure + 1e5
    strain = position / 0.3
    force = driven(bench.CARDS["driven"], {}, pressure, position, velocity)
    for begin, tau in zip(BEGIN, (FAST, SLOW), strict=True):
        z = begin
        for row, (now, then) in enumerate(zip(strain, [*strain[1:], strain[-1]], strict=True)):
            force[row] -= STIFFNESS / 2 * z
            slope, fade = (then - now) / 0.01, np.exp(-0.01 / tau)
            z = then - tau * slope + (z - now + tau * slope) * fade
    assert force.min() > 0
    noise = NOISE * np.random.default_rng(seed).normal(size=len(force))
    return changed(pulled(seed, name=name), pressure=pressure, force=force + noise)


@pytest.fixture(scope="module")
def creeping():
    creep = jm.effects.Creep(stiffness=STIFFNESS, fast_time=FAST, slow_time=SLOW)  # pyright: ignore
    recording = crept()
    return jm.actuator(recording.card).with_effects(creep=creep), recording


@pytest.mark.slow
def test_creep_that_is_not_at_rest(creeping, tmp_path):
    machine, recording = creeping
    free = ["creep.stiffness", "end_factor"]
    rest = jm.fit(machine, recording, free, priors={"end_factor": None})
    fit = jm.fit(machine, recording, [*free, "start.creep"], priors={"end_factor": None})
    assert abs(rest.values["effects.creep.stiffness"] / STIFFNESS - 1) > 0.1
    assert within(fit, "effects.creep.stiffness", STIFFNESS)
    for i, true in enumerate(BEGIN):
        assert within(fit, f"start.creep[{i}]", true) and fit.std[f"start.creep[{i}]"] < 0.01
    loaded = jm.FitResult.load(fit.save(tmp_path / "fit.json"))
    assert loaded.parameters == fit.parameters and loaded.settings["free"] == fit.settings["free"]
    assert "start.creep[0]" in fit.to_card().description
    again = loaded.refit(recording)
    assert again.cost == pytest.approx(fit.cost, rel=1e-4)


@pytest.mark.slow
def test_each_recording_has_its_own(creeping):
    machine, recording = creeping
    other = dataclasses.replace(crept(1), name="other")
    fit = jm.fit(
        machine,
        [recording, other],
        ["creep.stiffness"],
        shared=["start.creep[1]"],
        per_recording=["start.creep[0]"],
        priors={"start.creep[0]": (0.0, 0.1)},
        bounds={"start.creep[0]": (-0.05, 0.05)},
    )
    names = ("effects.creep.stiffness", "start.creep[1]", "start.creep[0][crept]", "start.creep[0][other]")
    assert set(fit.parameters) == set(names)
    own = fit.parameters["start.creep[0][other]"]
    assert (own.prior, own.lower, own.recording) == ((0.0, 0.1), -0.05, "other")
    assert own.start == 0.0 and abs(own.value - BEGIN[0]) < 4 * own.std


@pytest.mark.slow
def test_slopes_by_initial_states_are_differences(part):
    """A hidden state, a measured one and its rate: nothing is as measured at the first sample."""
    machine, recording = part
    place = station(machine, recording, "part", None, {})
    paths = ("start.opening", "start.pressure", "start.velocity")
    at, steps = jnp.array([[0.3, 2.5e5, 0.1]]), (1e-6, 1.0, 1e-6)
    _, slopes = values_and_slopes(at, place.actuator, place.problem, paths)
    for i, h in enumerate(steps):
        there, back = (
            values_and_slopes(at + s * h * np.eye(3)[i], place.actuator, place.problem, paths)[0]
            for s in (1, -1)
        )
        difference = np.asarray(there - back)[0] / (2 * h)
        np.testing.assert_allclose(slopes[0, i], difference, rtol=1e-4, atol=1e-5 * np.abs(difference).max())
        assert np.abs(difference).max() > 0


def test_each_recording_has_its_own_unless_it_is_shared(creeping):
    """Recordings begin each in its own way: one value for two of them has to be asked for."""
    machine, recording = creeping
    pair, names = [recording, crept(1)], ["one", "two"]
    asked = Asked(["end_factor", "start.creep"], shared=["start.creep[1]"])
    found = {e.name: e for e in layout(machine, pair, names, asked).entries}
    own = ("start.creep[0][one]", "start.creep[0][two]")
    assert set(found) == {"end_factor", *own, "start.creep[1]"}
    assert [found[name].recordings for name in (*own, "start.creep[1]")] == [(0,), (1,), (0, 1)]


@pytest.mark.slow
def test_a_fitted_state_is_taken_by_a_simulation(part):
    """Under the command of the recording it goes on as the window that was fitted does."""
    machine, recording = part
    place = station(machine, recording, "part", None, {})
    states = {"opening": 0.3, "pressure": 2.5e5, "position": 0.01, "velocity": 0.0}
    problem = place.problem
    begin = {name: jnp.asarray(value) for name, value in states.items()}
    chain = chain_predictions(place.actuator, dataclasses.replace(problem, begin=begin))
    command, clock = recording.columns["command"][:20], recording.time[:20]
    run = jm.simulate(machine, command, clock, start=states, substeps=problem.substeps)
    for name, values in run.readings.items():
        np.testing.assert_allclose(values, chain[name][0, :20], rtol=1e-9)
    shut = jm.simulate(machine, command, clock, start={**states, "opening": 0.0})
    assert abs(float(shut.readings["pressure"][19] - run.readings["pressure"][19])) > 1e3


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("start.opning", "unknown parameter 'start.opning'; did you mean 'start.opening'"),
        ("start.opening[0]", "unknown parameter 'start.opening.0.'; did you mean 'start.opening'"),
        ("start.effects", "unknown parameter 'start.effects'"),
    ],
)
def test_states_that_there_are_not(part, name, told):
    machine, recording = part
    with pytest.raises(InputError, match=told):
        jm.fit(machine, recording, ["mass", name])


def test_what_the_bench_imposes_has_no_beginning():
    recording = pulled()
    with pytest.raises(InputError, match="unknown parameter 'start.pressure'"):
        layout(jm.actuator(recording.card), [recording], ["a"], Asked(["start.pressure"]))


def test_units_and_values_where_nothing_is_fitted(part):
    machine, recording = part
    names = ["start.opening", "start.pressure", "start.position", "start.velocity"]
    bounds = {"start.opening": (0.1, None)}
    found = {e.name: e for e in layout(machine, [recording], ["part"], Asked(names, bounds=bounds)).entries}
    assert [found[name].place.unit for name in names] == ["", "Pa", "m", "m/s"]
    assert found["start.pressure"].start == recording.columns["pressure"][0]
    begins = ["rest", "its first reading", "its first reading", "zero"]
    assert [found[n].place.meaning.split("a fit begins at ")[1] for n in names] == begins
    # Rest would be 0.
    assert found["start.opening"].start == 0.1


def test_a_first_reading_next_to_zero_is_no_scale():
    """A position of 2 µm at first: the state is looked for, and judged, within a hundredth of the range."""
    machine = bench.model("isotonic")
    columns = {"command": np.zeros(100), "pressure": np.linspace(1e5, 3e5, 100)}
    columns |= {"position": np.linspace(2e-6, 0.05, 100)}
    recording = jm.recording(machine, columns, 2e-3)
    (entry,) = layout(machine, [recording], ["lift"], Asked(["start.position"])).entries
    assert entry.start == 2e-6 and entry.scale == pytest.approx(5e-4, rel=1e-3)
