"""Errors of the sensor of a column: shown and corrected, on whole runs, in residuals, on cards."""

import dataclasses
import pickle
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.effects import BY_NAME, CATALOGUE, effect_named, reading_effects
from jaxmuscle.effects.readings import KINDS, Samples
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.residuals import moved, residuals
from jaxmuscle.parameters import get, parameters
from jaxmuscle.simulation.sensor_errors import shown_readings, true_track, without_sensor_errors

STEP, ROWS = 2e-3, 60
SIZES = {"sensor_gain": 0.02, "sensor_offset": 3e3, "sensor_drift": 1500.0, "clock_offset": 3.1e-3}
"""Of a pressure."""
NOISE = {"pressure": 300.0, "position": 5e-5}
TIME = np.arange(ROWS) * STEP
PRESSURE = bench.AMBIENT + 2e5 + 1e5 * np.sin(2 * np.pi * 6 * TIME)


def named(name) -> Any:
    """The class of an error that there is."""
    return effect_named(name)


def samples(rows=ROWS, begins=()):
    """Instants of a stretch, or of several."""
    edges = np.array([0, *begins, rows])
    stretch = np.searchsorted(edges, np.arange(rows), side="right") - 1
    first, last = jnp.asarray(edges[stretch]), jnp.asarray(edges[stretch + 1] - 1)
    return Samples(jnp.arange(rows) * STEP, first, last, jnp.asarray(bench.AMBIENT))


def error(kind, size, column="pressure"):
    return named(f"{kind}_{column}")(**{KINDS[kind].strength: size})


def shown_by_hand(kind, size, values, time, zero):
    """What the equations say, linear between samples."""
    return {
        "sensor_gain": values + size * (values - zero),
        "sensor_offset": values + size,
        "sensor_drift": values + size * time,
        "clock_offset": np.interp(time - size, time, values),
    }[kind]


@pytest.mark.parametrize("kind", KINDS)
def test_shown_is_what_the_equation_says_and_corrected_its_inverse(kind):
    effect, at = error(kind, SIZES[kind]), samples()
    shown = np.asarray(effect.shown(jnp.asarray(PRESSURE), at))
    by_hand = shown_by_hand(kind, SIZES[kind], PRESSURE, TIME, bench.AMBIENT)
    inner = slice(4, -4) if kind == "clock_offset" else slice(None)
    # A chord misses the sine by up to ω² h²/8 of its amplitude.
    near = 1e5 * (2 * np.pi * 6 * STEP) ** 2 / 8 if kind == "clock_offset" else 1e-6
    np.testing.assert_allclose(shown[inner], by_hand[inner], atol=near, rtol=1e-12)
    assert np.abs(shown - PRESSURE)[inner].max() > 50 * near
    back = np.asarray(effect.corrected(jnp.asarray(shown), at))
    np.testing.assert_allclose(back[inner], PRESSURE[inner], atol=near / 5, rtol=1e-13)


@pytest.mark.parametrize("delay", [-2.5, -1.0, -0.3, 0.4, 2.0, 3.7])
def test_a_cubic_between_samples_is_of_third_order_and_exact_for_parabolas(delay):
    parabola = 3.0 + 50 * TIME - 700 * TIME**2
    later = np.asarray(samples().later(jnp.asarray(parabola), jnp.asarray(delay * STEP)))
    at = TIME + delay * STEP
    np.testing.assert_allclose(later[5:-5], (3.0 + 50 * at - 700 * at**2)[5:-5], rtol=1e-12)


def test_a_straight_line_goes_on_beyond_the_ends_and_breaks_are_not_mixed():
    line = 5.0 + 40 * TIME
    for delay in (-7e-3, 9e-3):
        later = np.asarray(samples().later(jnp.asarray(line), jnp.asarray(delay)))
        np.testing.assert_allclose(later, 5.0 + 40 * (TIME + delay), rtol=1e-12)
    jump = np.where(np.arange(ROWS) < 25, line, 900.0 - line)
    later = np.asarray(samples(begins=(25,)).later(jnp.asarray(jump), jnp.asarray(-7e-3)))
    np.testing.assert_allclose(later[25:], 895.0 - 40 * (TIME - 7e-3)[25:], rtol=1e-12)
    np.testing.assert_allclose(later[:25], 5.0 + 40 * (TIME - 7e-3)[:25], rtol=1e-12)


@pytest.mark.parametrize("way", ["shown", "corrected"])
@pytest.mark.parametrize("kind", KINDS)
def test_slopes_at_zero_and_off_it_are_central_differences(kind, way):
    """At zero strength, where nothing moves, at a reversal, side by side."""
    values = np.stack([PRESSURE, np.full(ROWS, 3e5), 2e5 - 1e5 * np.abs(TIME - TIME[30])])

    def outcome(strength, series):
        return getattr(error(kind, strength), way)(series, samples())

    slope = jax.vmap(jax.jacfwd(outcome), (None, 0))
    for strength in (0.0, 0.3 * SIZES[kind], -1.7 * SIZES[kind]):
        # Central differences at a sample, where the derivative is continuous, see its bend.
        h = 1e-5 * SIZES[kind]
        found = slope(jnp.asarray(strength), jnp.asarray(values))
        both = [np.asarray([outcome(jnp.asarray(strength + s * h), v) for v in values]) for s in (1, -1)]
        assert np.isfinite(found).all()
        difference = (both[0] - both[1]) / (2 * h)
        np.testing.assert_allclose(found, difference, rtol=2e-4, atol=2e-5 * np.abs(difference).max())
        reverse = jax.grad(lambda s: outcome(s, jnp.asarray(values[0])).sum())(jnp.asarray(strength))
        np.testing.assert_allclose(reverse, found[0].sum(), rtol=1e-9, atol=1e-9 * np.abs(found).max())


def test_there_is_one_class_for_a_kind_and_a_column():
    names = [effect.name for effect in reading_effects(bench.BLANKS["joint"])]
    columns = ("pressure_1", "pressure_2", "angle")
    assert names == [f"{kind}_{column}" for column in columns for kind in KINDS]
    for effect in reading_effects(bench.BLANKS["joint"]):
        assert effect is effect_named(effect.name) is pickle.loads(pickle.dumps(effect))
        assert effect.name == f"{effect.kind}_{effect.column}" and effect.name not in BY_NAME
        assert bench.BLANKS["joint"].offers(effect) and not bench.BLANKS["driven"].offers(effect)
    assert all(effect.kind == effect.name and effect.column is None for effect in CATALOGUE)
    assert effect_named("sensor_offset_") is None and effect_named("offset_pressure") is None


@pytest.mark.parametrize("rig", bench.BLANKS)
def test_units_are_those_of_the_column(rig):
    blank = bench.BLANKS[rig]
    effects = reading_effects(blank)
    entries = parameters(blank.with_effects(**{effect.name: effect() for effect in effects}))
    for effect in effects:
        entry = entries[f"effects.{effect.name}.{effect.strength}"]
        unit = blank.column(effect.column).unit
        assert entry.unit == {"sensor_gain": "", "sensor_offset": unit, "clock_offset": "s"}.get(
            effect.kind, f"{unit}/s"
        )
        assert entry.typical and entry.value == 0


def lifted(**errors):
    """A recording of a lifted mass, without noise, its columns changed by errors: name → size."""
    machine, command = bench.model("isotonic"), bench.isotonic_command()
    time = np.arange(len(command)) * STEP
    readings = jm.simulate(machine, command, time).readings
    columns = {"command": command} | {name: np.asarray(readings[name]) for name in NOISE}
    for name, size in errors.items():
        kind, column = named(name).kind, named(name).column
        zero = bench.AMBIENT if column == "pressure" else 0.0
        columns[column] = shown_by_hand(kind, size, columns[column], time, zero)
    return machine, jm.recording(machine, columns, STEP, noise=NOISE, horizon=0.3)


LIFTED = {
    "sensor_offset_pressure": 3e3,
    "sensor_gain_pressure": 0.03,
    "sensor_drift_pressure": 2e3,
    "clock_offset_pressure": 4e-3,
    "sensor_offset_position": 5e-4,
    "sensor_gain_position": 0.03,
    "sensor_drift_position": 5e-4,
    "clock_offset_position": -4e-3,
}


def carrying(machine, **errors):
    """The machine with errors of these sizes: name → size."""
    kinds = {name: named(name) for name in errors}
    return machine.with_effects(**{n: kinds[n](**{kinds[n].strength: size}) for n, size in errors.items()})


def with_all(machine, **errors):
    """With every error that there may be, most of them zero: one structure, compiled once."""
    none = dict.fromkeys((effect.name for effect in reading_effects(machine)), 0.0)
    return carrying(machine, **{**none, **errors})


weighted_residuals = eqx.filter_jit(residuals)


@pytest.fixture(scope="module")
def clean():
    """Root mean square of weighted residuals, link by link, of a recording without errors."""
    machine, recording = lifted()
    return sizes(machine, recording)


def sizes(machine, recording):
    found = weighted_residuals(machine, case(recording, 0.0).problem)
    return {name: float(np.sqrt((np.asarray(values) ** 2).mean())) for name, values in found.items()}


@pytest.mark.parametrize("name", LIFTED)
def test_a_declared_error_leaves_nothing_in_any_link(name, clean):
    """A pressure is a reading of one link and an input of the other; both see the true one."""
    machine, recording = lifted(**{name: LIFTED[name]})
    without = sizes(machine, recording)
    declared = sizes(with_all(machine, **{name: LIFTED[name]}), recording)
    assert sum(without.values()) > 2 * sum(clean.values())
    for link, left in declared.items():
        assert left < clean[link] + 0.15 * without[link] + 0.1, (link, clean, declared, without)


@pytest.mark.slow
def test_nothing_changes_at_zero_strength_to_the_last_bit():
    machine, recording = lifted()
    problem, loaded = case(recording, 0.0).problem, with_all(machine)
    track = true_track(loaded, problem.track)
    for name, values in problem.track.measured.items():
        np.testing.assert_array_equal(track.measured[name], values)
    readings = {name: jnp.asarray(recording.columns[name]) for name in machine.outputs}
    shown = shown_readings(loaded, readings, track, 0)
    for name, values in readings.items():
        np.testing.assert_array_equal(shown[name], values)
    bare = weighted_residuals(machine, problem)
    for name, values in weighted_residuals(loaded, problem).items():
        # A compiler may contract a product and a sum differently: the last few bits.
        np.testing.assert_allclose(values, bare[name], rtol=1e-9, atol=1e-9)


def test_a_track_of_numpy_arrays_with_breaks_is_corrected_as_one_of_jax_arrays():
    """Tracks of several runs in one, outside of compiled programs."""
    machine, recording = lifted(clock_offset_position=4e-3)
    broken = dataclasses.replace(recording, breaks=(len(recording) // 3,))
    track = case(broken, 0.0).problem.track
    plain = dataclasses.replace(track, begins=np.asarray(track.begins))
    loaded = carrying(machine, clock_offset_position=4e-3)
    one, other = (true_track(loaded, each).measured["position"] for each in (track, plain))
    np.testing.assert_array_equal(one, other)
    assert np.abs(np.asarray(one) - np.asarray(track.measured["position"])).max() > 1e-5


def test_without_errors_nothing_is_computed():
    machine, recording = lifted()
    problem = case(recording, 0.0).problem
    assert true_track(machine, problem.track) is problem.track
    readings = {name: jnp.asarray(recording.columns[name]) for name in machine.outputs}
    assert shown_readings(machine, readings, problem.track, 0) is readings
    assert without_sensor_errors(machine) is machine


def test_rates_are_those_of_the_corrected_states():
    machine, recording = lifted()
    track = case(recording, 0.0).problem.track
    x, v = (np.asarray(track.measured[name]) for name in ("position", "velocity"))
    for name, expected in {
        "sensor_gain_position": v / 1.03,
        "sensor_drift_position": v - 5e-4,
        "sensor_offset_position": v,
    }.items():
        found = true_track(carrying(machine, **{name: LIFTED[name]}), track).measured
        np.testing.assert_allclose(found["velocity"], expected, rtol=1e-12, atol=1e-15)
        assert np.abs(np.asarray(found["position"]) - x).max() > 1e-5
    late = true_track(carrying(machine, clock_offset_position=4e-3), track).measured
    np.testing.assert_allclose(late["velocity"][:-2], v[2:], rtol=1e-12)


@pytest.mark.slow
def test_the_offset_that_a_fit_moves_is_the_same_thing():
    machine, recording = lifted(sensor_offset_pressure=3e3)
    problem = case(recording, 0.0).problem
    by_path, freed = moved(machine, problem, ["offset.pressure"], [jnp.asarray(3e3)])
    track = problem.track.measured
    np.testing.assert_array_equal(freed.track.measured["pressure"], track["pressure"] - 3e3)
    np.testing.assert_array_equal(freed.track.measured["position"], track["position"])
    declared = carrying(machine, sensor_offset_pressure=3e3)
    found, expected = weighted_residuals(by_path, freed), weighted_residuals(declared, problem)
    for link, values in expected.items():
        np.testing.assert_array_equal(found[link], values)
    assert list(machine.effects) == []


def test_a_simulation_shows_what_its_sensors_show():
    machine, command = bench.model("isotonic"), bench.isotonic_command()[:200]
    time = np.arange(200) * STEP
    true = jm.simulate(machine, command, time).readings
    for name, size in LIFTED.items():
        shown = jm.simulate(with_all(machine, **{name: size}), command, time).readings
        column, kind = named(name).column, named(name).kind
        zero = bench.AMBIENT if column == "pressure" else 0.0
        by_hand = shown_by_hand(kind, size, np.asarray(true[column]), time, zero)
        near = 2e-3 * np.ptp(true[column]) if kind == "clock_offset" else 0.0
        inner = slice(4, -4)
        np.testing.assert_allclose(shown[column][inner], by_hand[inner], rtol=1e-12, atol=near)
        other = next(c for c in NOISE if c != column)
        np.testing.assert_array_equal(shown[other], true[other])


@pytest.mark.slow
def test_a_run_of_a_recording_begins_at_the_true_state():
    """A test machine imposes pressure and position as they were shown; the force is that of the true ones."""
    machine, motion = bench.model("driven"), bench.driven_motion()
    force = bench.simulate(machine, bench.driven_track(*motion), 1).readings["force"]
    columns = {"pressure": motion[0] + 5e3, "position": motion[1], "force": np.asarray(force)}
    recording = jm.recording(machine, columns, bench.STEPS["driven"])
    ours = jm.simulate(carrying(machine, sensor_offset_pressure=5e3), recording).readings["force"]
    wrong = jm.simulate(machine, recording).readings["force"]
    assert np.abs(ours - force)[5:-5].mean() < 0.1 * np.abs(wrong - force)[5:-5].mean()


class Proportional(eqx.Module):
    """Pressures in proportion to the angle that it is shown."""

    def start(self):
        return jnp.zeros(())

    def update(self, state, wanted, readings, step):
        return state, bench.AMBIENT + 2.5e5 + 1e5 * (wanted - readings["angle"]) * jnp.array([1.0, -1.0])


@pytest.mark.slow
def test_a_controller_sees_what_the_sensors_show():
    """Offset and drift, but not that the instants of a column are written down late."""
    machine, clock = bench.model("joint"), np.arange(150) * STEP
    errors = {"sensor_offset_angle": 0.05, "sensor_drift_angle": 0.3}
    found = jm.control.closed_loop(carrying(machine, **errors), Proportional(), np.full(150, 0.3), clock)
    by_hand = bench.AMBIENT + 2.5e5 + 1e5 * np.multiply.outer(0.3 - found.readings["angle"], [1.0, -1.0])
    np.testing.assert_allclose(found.commands, by_hand, rtol=1e-12)
    plain = jm.control.closed_loop(machine, Proportional(), np.full(150, 0.3), clock)
    late = carrying(machine, clock_offset_angle=2 * STEP)
    late = jm.control.closed_loop(late, Proportional(), np.full(150, 0.3), clock)
    assert np.abs(np.asarray(found.commands - plain.commands)).max() > 4e3
    np.testing.assert_array_equal(late.commands, plain.commands)
    np.testing.assert_allclose(late.readings["angle"][2:], plain.readings["angle"][:-2], rtol=1e-12)


def test_cards_and_files_know_them(tmp_path):
    text = jm.sample("bench").with_suffix(".toml").read_text(encoding="utf-8")
    text += '\n[effects.sensor_offset_pressure]\noffset = { value = 2, std = 1, unit = "kPa" }\n'
    (tmp_path / "bench.toml").write_text(text, encoding="utf-8")
    card = jm.Card.read(tmp_path / "bench.toml")
    machine = jm.actuator(card)
    assert machine.effects["sensor_offset_pressure"] == error("sensor_offset", 2e3)
    assert jm.Card.from_toml(card.to_toml()) == card
    later = card.updated(effects={"sensor_drift_force": {"rate": (0.1, 0.02)}})
    again = jm.Card.from_toml(later.to_toml())
    assert float(get(jm.actuator(again), "effects.sensor_drift_force.rate")) == pytest.approx(0.1)
    assert again.effects["sensor_drift_force"]["rate"].unit == "N/s"
    for wrong, told in {
        "sensor_offset_presure": "no signal column presure",
        "sensor_ofset_pressure": "did you mean 'sensor_offset_pressure'",
    }.items():
        bad = text.replace("effects.sensor_offset_pressure", f"effects.{wrong}")
        with pytest.raises(InputError, match=told):
            jm.Card.from_toml(bad)
