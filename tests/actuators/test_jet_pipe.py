"""Rig `jet-pipe` against its oracle, closed-form areas and finite differences."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.jetpipe import jet_pipe, leak, ports

from jaxmuscle.parameters import parameters, replace

CASES = {
    "bare": {},
    "command_delay": {"command_delay": {"delay": 0.006}},
    "chamber_leak": {"chamber_leak": {"area": 2e-8}},
    "valve_hysteresis": {"valve_hysteresis": {"weight": 0.5, "width": 0.25}},
    "current_saturation": {"current_saturation": {"inverse_limit": 1 / 0.14}},
}
CARRIED = tuple(name for name in CASES if name != "bare")
COMMAND = bench.jet_pipe_command()
CARD = bench.CARDS["jet-pipe"]


def track(command):
    return bench.track("jet-pipe", command)


@cache
def reference(name):
    """The oracle's current and force; it takes the saturation by its limit."""
    effects = dict(CASES[name])
    if "current_saturation" in effects:
        effects["current_saturation"] = {"limit": 1 / effects["current_saturation"]["inverse_limit"]}
    current, force = jet_pipe(CARD, effects, COMMAND[:300], bench.STEPS["jet-pipe"], substeps=20)
    assert np.ptp(force) > 50 and (force == CARD["residual_force"]).any()
    return current, force


@pytest.mark.parametrize("name", CASES)
def test_equals_oracle(name):
    current, force = reference(name)
    actuator = bench.model("jet-pipe", CARRIED, **CASES[name])
    readings = bench.simulated(actuator, track(COMMAND[:300]), 32).readings
    # The oracle's steps of 0.1 ms against 0.05 ms move its force by 1e-6 of the range, the model by 3e-5.
    assert bench.deviation(readings["current"], current) < 1e-3
    assert bench.deviation(readings["force"], force) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.0005, 0.0025, 0.00637])
def test_a_delay_between_samples_switches_the_current_where_it_does(delay):
    """The current settles within a sample: it follows the late command, not the mean over the interval."""
    effects = {"command_delay": {"delay": delay}}
    current, force = jet_pipe(CARD, effects, COMMAND[:300], bench.STEPS["jet-pipe"], substeps=160)
    actuator = bench.model("jet-pipe", CARRIED, **effects)
    readings = bench.simulated(actuator, track(COMMAND[:300]), 2).readings
    # With the mean over the interval the current is off by a fifth of its range at 2.5 ms.
    assert bench.deviation(readings["current"], current) < 5e-3
    assert bench.deviation(readings["force"], force) < 5e-3


@pytest.fixture(scope="module", params=[None, 1e-3], ids=["without lag", "with a lag"])
def by_delay(request):
    """Readings as a function of the delay, and their slopes, compiled for all delays."""
    lagging = {} if request.param is None else {"force_sensor_lag": {"time_constant": request.param}}

    def readings(late):
        actuator = bench.model("jet-pipe", CARRIED, command_delay={"delay": late}, **lagging)
        out = bench.simulate(actuator, track(COMMAND[:60]), 2).readings
        return jnp.stack([out["current"] / 0.4, out["force"] / 50.0])

    return jax.jit(readings), jax.jit(jax.vmap(jax.jacfwd(readings)))


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [0.0, 0.0005, 0.0025, 0.004, 0.00637])
def test_slopes_by_a_delay_are_those_of_one_side(by_delay, delay):
    readings, slopes = by_delay
    at, h = jnp.asarray(delay), 1e-8
    slope = slopes(at[None])[0]
    difference = (readings(at + h) - readings(at)) / h
    np.testing.assert_allclose(slope, difference, rtol=1e-3, atol=1e-3 * float(jnp.abs(slope).max()))


@pytest.mark.slow
def test_every_effect_at_no_strength_changes_nothing_and_has_its_slope():
    """A dead time of no length makes steps of no length, over which memories are brought up to date too."""
    offered = bench.offered("jet-pipe")
    carried = bench.model("jet-pipe", [effect.name for effect in offered])

    def readings(strengths):
        values = {f"effects.{e.name}.{e.strength}": s for e, s in zip(offered, strengths, strict=True)}
        return bench.simulate(replace(carried, values), track(COMMAND[:60]), 2).readings

    strengths = jnp.zeros(len(offered))
    bare = bench.simulated(bench.model("jet-pipe"), track(COMMAND[:60]), 2).readings
    slopes = jax.jit(jax.jacfwd(readings))(strengths)
    for output, values in jax.jit(readings)(strengths).items():
        np.testing.assert_allclose(values, bare[output], rtol=1e-9, atol=1e-12)
        assert bool(jnp.isfinite(slopes[output]).all())


@pytest.mark.slow
def test_the_longest_step_is_well_below_the_noise():
    actuator = bench.model("jet-pipe")
    fine = bench.simulated(actuator, track(COMMAND), 32).readings["force"]
    coarse = bench.simulated(actuator, track(COMMAND), 2).readings["force"]
    assert bench.STEPS["jet-pipe"] / 2 <= actuator.largest_step
    assert np.sqrt(np.mean((fine - coarse) ** 2)) < 0.1 * 0.15


def test_areas_and_leak_are_those_of_the_oracle():
    actuator = bench.model("jet-pipe")
    for x in np.linspace(-1.2e-3, 1.2e-3, 25):
        supply, outlet = ports(x)
        np.testing.assert_allclose(actuator.receiver.supply_areas(x), supply, atol=1e-13)
        np.testing.assert_allclose(actuator.receiver.return_areas(x), outlet, atol=1e-13)
    for pair in ((6e5, 2e5), (2e5, 6e5), (3e5, 3.3e5)):
        np.testing.assert_allclose(
            actuator.cylinder.leak(jnp.array(pair), 293.15), leak(*pair, 293.15), rtol=1e-12
        )


def test_full_jet_force():
    # A tip held right over port 1: 102 N at 551.6 kPa gauge by the source's equations, evaluated by hand.
    actuator = replace(
        bench.model("jet-pipe"), {"pipe.receiver_offset": bench.model("jet-pipe").receiver.port_diameter}
    )
    force = bench.simulated(actuator, track(np.zeros(400)), 2).readings["force"]
    assert force[-1] == pytest.approx(102.0, abs=0.5)


SCENES = {
    "at rest": np.zeros(40),
    "full stroke": np.full(40, 3.9),
    "reversing": 1.0 + np.sin(np.arange(40) / 3),
    "slack": np.full(40, -2.0),
    "small loops": 1.3 + 0.2 * np.cos(np.arange(40) / 2),
}
GENERIC = {
    "command_delay": {"delay": 0.0046},
    "current_saturation": {"inverse_limit": 1 / 0.15},
    "valve_hysteresis": {"weight": 0.4, "width": 0.21},
    "chamber_leak": {"area": 1.5e-8},
    "force_sensor_lag": {"time_constant": 0.013},
    "dead_band": {"width": 0.061},
    "line_lag": {"time_constant": 0.0083},
    "dead_volume": {"volume": 2.1e-6},
    "gas_heating": {"share": 0.37, "thermal_time": 0.21},
    "force_sensor_nonlinearity": {"cubic": 1.3e-6},
}
SCALES = {"offset": 1e-3, "receiver_offset": 1e-4}


@pytest.mark.slow
def test_derivatives_equal_differences_in_every_scene():
    actuator = bench.model("jet-pipe", **GENERIC)
    assert set(GENERIC) == {effect.name for effect in bench.offered("jet-pipe")}
    paths = list(parameters(actuator))
    values = np.array([float(entry.value) for entry in parameters(actuator).values()])
    size = np.array([abs(v) or SCALES[p.split(".")[-1]] for p, v in zip(paths, values, strict=True)])
    scenes = jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(track, SCENES.values()))

    def readings(z, scene):
        changed = replace(actuator, dict(zip(paths, values + z * size, strict=True)))
        out = bench.simulate(changed, scene, 2).readings
        return jnp.stack([out["current"] / 0.4, out["force"] / 50.0])

    zero, h = jnp.zeros(len(paths)), 1e-6
    derivative = jax.jit(jax.vmap(jax.jacfwd(readings), in_axes=(None, 0)))(zero, scenes)
    both = jax.jit(jax.vmap(jax.vmap(readings, in_axes=(0, None)), in_axes=(None, 0)))
    up, down = both(h * jnp.eye(len(paths)), scenes), both(-h * jnp.eye(len(paths)), scenes)
    difference = np.moveaxis(np.asarray(up - down) / (2 * h), 1, -1)
    assert np.isfinite(derivative).all()
    scale = np.abs(difference).max(axis=(1, 2))[:, None, None, :]
    # Small steps: with larger ones a play is caught or let go between the two sides of a difference.
    excess = np.abs(derivative - difference) - 1e-5 * scale - 1e-7
    wrong = [
        f"{list(SCENES)[s]}: {paths[p]} {excess[s, ..., p].max():.1e} of {scale[s, 0, 0, p]:.1e}"
        for s, p in np.argwhere(excess.max(axis=(1, 2)) > 0)
    ]
    assert not wrong, wrong
