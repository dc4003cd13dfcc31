"""`jm.sweep` against one `jm.simulate` a point, for grids and lists of points on every rig."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from sweeps.conftest import CLOCK, REDUCTIONS

import jaxmuscle as jm

MASSES, HERTZ = np.array([2.0, 8.0, 20.0]), np.array([3.0, 12.0])
PAIR = {"mass": MASSES, "command.frequency": HERTZ}


def expected(machine, mass, hertz):
    """The readings of one point, by a whole simulation of its own."""
    command = 1.0 + 2.0 * np.sin(2 * np.pi * hertz * CLOCK)
    return jm.simulate(jm.replace(machine, {"mass": mass}), command, CLOCK).readings


@pytest.fixture(scope="module")
def grid(machine, sine):
    return jm.sweep(machine, PAIR, command=sine, times=CLOCK)


def test_each_point_of_a_grid_is_a_simulation(machine, grid):
    assert dict(grid.sizes) == {"mass": 3, "command.frequency": 2, "time": 80}
    for mass in MASSES:
        for hertz in HERTZ:
            here = grid.sel({"mass": mass, "command.frequency": hertz})
            for name, values in expected(machine, mass, hertz).items():
                np.testing.assert_allclose(here[name], values, rtol=1e-9, atol=1e-12)
    assert not grid.failed.any()
    assert np.ptp(grid.position.values) > 0.01


def test_units_and_meanings(grid):
    assert {name: grid[name].attrs["units"] for name in grid.coords} == {
        "mass": "kg", "command.frequency": "Hz", "time": "s",
    }  # fmt: skip
    assert grid.pressure.attrs["units"] == "Pa"
    assert grid.position.attrs["units"] == "m"
    assert grid.mass.attrs["long_name"] == "mass that is lifted"
    assert json.loads(grid.attrs["parameters"])["mass"] == 8.0
    assert grid.attrs["rig"] == "isotonic"


def test_points_side_by_side(machine, sine, grid):
    points = [{"load.mass": m, "command.frequency": f} for m, f in [(2.0, 12.0), (20.0, 3.0)]]
    found = jm.sweep(machine, points, command=sine, times=CLOCK, outputs=["position"])
    assert dict(found.sizes) == {"point": 2, "time": 80}
    assert set(found.data_vars) == {"position", "failed"}
    for row, point in enumerate(points):
        np.testing.assert_array_equal(found["load.mass"][row], point["load.mass"])
        there = grid.sel({"mass": point["load.mass"], "command.frequency": point["command.frequency"]})
        np.testing.assert_allclose(found.position[row], there.position, rtol=1e-12, atol=1e-15)


def test_reductions_are_those_of_the_trajectories(machine, sine, grid):
    found = jm.sweep(machine, PAIR, command=sine, times=CLOCK, reductions=REDUCTIONS)
    assert "time" not in found.sizes
    for name in ("pressure", "position"):
        np.testing.assert_allclose(found[f"{name}_maximum"], grid[name].max("time"), rtol=1e-12)
        np.testing.assert_allclose(found[f"{name}_final"], grid[name].isel(time=-1), rtol=1e-12)
    assert found.pressure_maximum.attrs["units"] == "Pa"


def test_defaults_are_enough(machine):
    """The call that the contract shows."""
    found = jm.sweep(machine, over={"load.mass": [4.0, 8.0], "command.frequency": [1.0, 2.0]})
    assert found.position.dims == ("load.mass", "command.frequency", "time")
    assert float(found.time[-1]) == pytest.approx(1.998)
    assert found.position.max() > 0.01


def test_function_of_time_with_parameters(machine):
    def command(time, level, rise=0.05):
        return level * jnp.clip(time / rise, 0.0, 1.0)

    found = jm.sweep(machine, {"command.level": [1.0, 3.0]}, command=command, times=CLOCK)
    for level in (1.0, 3.0):
        alone = jm.simulate(machine, level * np.clip(CLOCK / 0.05, 0, 1), CLOCK).readings
        here = found.sel({"command.level": level})
        np.testing.assert_allclose(here.pressure, alone["pressure"], rtol=1e-9)


def test_functions_of_the_run(machine, sine):
    def work(run):
        return jnp.trapezoid(run.readings["pressure"], run.time) * jnp.array([1.0, 2.0])

    found = jm.sweep(
        machine, {"mass": MASSES}, command=sine, times=CLOCK,
        reductions={"work": (work, "Pa s"), "top": "maximum"},
    )  # fmt: skip
    assert found.work.dims == ("mass", "work.0") and found.work.attrs["units"] == "Pa s"
    alone = np.trapezoid(expected(machine, 8.0, 5.0)["pressure"], CLOCK)
    np.testing.assert_allclose(found.work.sel(mass=8.0), [alone, 2 * alone], rtol=1e-9)
    assert set(found.data_vars) == {"work", "pressure_top", "position_top", "failed"}


def test_a_table_and_a_start(machine):
    table, starts = np.full(80, 2.0), [2e5, 4e5]
    found = jm.sweep(machine, {"start.pressure": starts}, command=table, times=CLOCK, start={"pressure": 3e5})
    for begin in starts:
        alone = jm.simulate(machine, table, CLOCK, start={"pressure": begin}).readings
        here = found.sel({"start.pressure": begin})
        np.testing.assert_allclose(here.position, alone["position"], rtol=1e-9, atol=1e-12)
    assert found["start.pressure"].attrs["units"] == "Pa"


def test_a_recording_is_replayed():
    recording = jm.read(jm.sample("bench")).part(0, 200)
    machine = jm.actuator(recording.card)
    found = jm.sweep(machine, {"end_factor": [1.1, 1.3]}, command=recording)
    for factor in (1.1, 1.3):
        alone = jm.simulate(jm.replace(machine, {"muscle.end_factor": factor}), recording).readings
        np.testing.assert_allclose(found.force.sel(end_factor=factor), alone["force"], rtol=1e-9)
    assert found.force.attrs["units"] == "N"


@pytest.mark.slow
def test_two_muscles():
    machine = jm.actuator(jm.read(jm.sample("swing")).card)
    amplitude = np.array([[1e5, -1e5], [5e4, -5e4]])
    command = jm.commands.Step(level=np.zeros(2), before=2e5)
    found = jm.sweep(
        machine, {"command.level": 3e5 + amplitude, "inertia": [0.1, 0.2]},
        command=command, times=CLOCK, start={"pressure": 3e5},
    )  # fmt: skip
    assert found.pressure.dims == ("command.level", "inertia", "time", "muscle")
    assert found.angle.attrs["units"] == "rad"
    table = np.tile(3e5 + amplitude[1], (80, 1))
    alone = jm.simulate(
        jm.replace(machine, {"inertia": 0.2}), table, CLOCK, start={"pressure": np.full(2, 3e5)}
    ).readings
    np.testing.assert_allclose(found.angle[1, 1], alone["angle"], rtol=1e-9, atol=1e-14)
    np.testing.assert_array_equal(found["command.level.values"], 3e5 + amplitude)


def test_a_sweep_is_compiled_once(machine, sine, compiled):
    """Blocks and batches that are not full included; and a second sweep of the same kind not at all."""
    over = {"mass": np.linspace(1, 20, 17), "valve.area": np.linspace(1e-6, 2e-6, 13)}
    jm.sweep(machine, over, command=sine, times=CLOCK[:50], reductions=["rms"])
    assert len(compiled) == 1
    over = {"mass": np.linspace(2, 30, 13), "valve.area": np.linspace(1e-6, 2e-6, 17)}
    jm.sweep(machine, over, command=sine, times=CLOCK[:50], reductions=["rms"])
    assert len(compiled) == 1


@pytest.fixture
def compiled():
    """Every compilation by XLA from now on, in seconds."""
    seconds = []

    def listen(event, duration_secs, **_):
        if event == "/jax/core/compile/backend_compile_duration":
            seconds.append(duration_secs)

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield seconds
    jax.monitoring.unregister_event_duration_listener(listen)


def test_failed_points_are_told_and_marked(machine):
    def command(time, level):
        return jnp.where(level > 2, jnp.nan, level)

    over = {"mass": [5.0, 6.0], "command.level": [1.0, 2.0, 3.0]}
    with pytest.warns(UserWarning, match=r"2 of 6 points failed.*mass = 5.0, command.level = 3.0"):
        found = jm.sweep(machine, over, command=command, times=CLOCK, reductions=["final"])
    np.testing.assert_array_equal(found.failed, [[False, False, True]] * 2)
    assert np.isfinite(found.pressure_final[:, :2]).all() and np.isnan(found.pressure_final[:, 2]).all()


REFUSED = {
    "unknown path": ({"muscle.end_facto": [1.0]}, {}, "did you mean 'end_factor'"),
    "unknown quantity": ({"mas": [1.0]}, {}, "did you mean 'mass'"),
    "unknown command parameter": ({"command.freq": [1.0]}, {}, "did you mean 'command.frequency'"),
    "twice": ({"mass": [1.0], "load.mass": [1.0]}, {}, "'mass' and 'load.mass' are the same"),
    "nothing": ({}, {}, "nothing to sweep"),
    "no points": ([], {}, "nothing to sweep"),
    "names differ": ([{"mass": 1.0}, {"valve.area": 1.0}], {}, "point 1 differs in mass, valve.area"),
    "a number": ({"mass": 5.0}, {}, r"shape \(n\); got shape \(\)"),
    "empty": ({"mass": []}, {}, r"shape \(n\); got shape \(0,\)"),
    "no numbers": ({"mass": ["heavy"]}, {}, "mass: expected numbers in kg"),
    "not finite": ({"mass": [1.0, np.nan]}, {}, "mass: expected finite values; got nan"),
    "negative": ({"mass": [1.0, -2.0]}, {}, "mass: has to be above zero; got -2 kg"),
    "no mapping": ("mass", {}, "a mapping from names to values"),
    "times": ({"mass": [1.0]}, {"times": [0.0, 1.0, 1.5]}, "times: expected at least two uniform"),
    "reading": ({"mass": [1.0]}, {"outputs": ["presure"]}, "did you mean 'pressure'"),
    "no reading": ({"mass": [1.0]}, {"outputs": []}, "expected some of pressure, position; got none"),
    "reduction": ({"mass": [1.0]}, {"reductions": ["maximun"]}, "did you mean 'maximum'"),
    "no reduction": ({"mass": [1.0]}, {"reductions": []}, "at least one"),
    "same name": ({"mass": [1.0]}, {"reductions": ["rms", "rms"]}, "a name of its own"),
    "nameless": ({"mass": [1.0]}, {"reductions": [lambda run: run.time[0]]}, "under a name"),
    "wrong reading": (
        {"mass": [1.0]}, {"reductions": {"x": lambda run: run.readings["angle"]}}, "x cannot be computed"
    ),
    "table": ({"command.level": [1.0]}, {"command": CLOCK, "times": CLOCK}, "table, which has no parameters"),
    "short table": ({"mass": [1.0]}, {"command": CLOCK[1:], "times": CLOCK}, r"shape \(80,\).*got \(79,\)"),
    "start": ({"mass": [1.0]}, {"start": {"presure": 1e5}}, "start: unknown state.*'pressure'"),
    "no default": ({"mass": [1.0]}, {"command": lambda t, level: level}, "'level' has no value"),
    "two commands": ({"mass": [1.0]}, {"command": lambda t: jnp.ones(2)}, "expected a number at an instant"),
    "memory": ({"mass": [1.0]}, {"memory": 1000}, "one point takes .* MiB, the limit is"),
    "results": ({"mass": np.linspace(1, 2, 5000)}, {"memory": 2**20}, "give reductions=, or a store="),
}  # fmt: skip


@pytest.mark.parametrize("why", REFUSED)
def test_refused(machine, why):
    over, options, message = REFUSED[why]
    with pytest.raises(jm.InputError, match=message):
        jm.sweep(machine, over, **options)


def test_rigs_without_a_command_are_told():
    machine = jm.actuator(jm.read(jm.sample("bench")).card)
    with pytest.raises(jm.InputError, match=r"rig 'driven' has no command.*command=recording"):
        jm.sweep(machine, {"end_factor": [1.0]})


def test_commands_of_two_muscles_are_asked_for():
    machine = jm.actuator(jm.read(jm.sample("swing")).card)
    with pytest.raises(jm.InputError, match="has 2 commands; say what they are"):
        jm.sweep(machine, {"inertia": [1.0]})


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["elbow", "jet-pipe"])
def test_other_rigs(rig):
    machine = bench.model(rig)
    name, path = next(iter(machine.quantities.items()))
    values = float(jm.parameters.get(machine, path)) * np.array([0.9, 1.1])
    before, level = {"elbow": (1.5e5, 2e5), "jet-pipe": (0.0, 0.5)}[rig]
    command = jm.commands.Step(level=level, begin=0.01, before=before)
    clock = np.arange(20) * bench.STEPS[rig]
    found = jm.sweep(machine, {name: values}, command=command, times=clock)
    table = np.where(clock >= 0.01, level, before)
    alone = jm.simulate(jm.replace(machine, {path: values[1]}), table, clock).readings
    assert set(found.data_vars) == {*alone, "failed"}
    for reading, samples in alone.items():
        np.testing.assert_allclose(found[reading][1], samples, rtol=1e-9, atol=1e-12)
