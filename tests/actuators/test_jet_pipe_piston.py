"""Rig `jet-pipe-piston` against its oracle, against the held piston, and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.piston import piston

from jaxmuscle.analysis import equilibrium, equilibrium_at, linearise
from jaxmuscle.parameters import parameters, replace

RIG, SAMPLES, SUBSTEPS = "jet-pipe-piston", 120, 64
SHORT = {"stopper_position": 0.032, "initial_pressure": 2e5}
"""A travel of 6 mm."""
SMOOTH = {"coulomb_friction": 0.0, "stiction": 0.0}
KEPT = ("position", "pressure", "temperature")


def command(samples=SAMPLES):
    """Out to the stopper against it and back, the supply sagging [V; Pa, absolute]."""
    t = np.arange(samples) * bench.STEPS[RIG]
    volts = np.select([t < 0.1, t < 0.14], [2.0, 1.0], -1.5)
    return np.stack([volts, bench.AMBIENT + np.interp(t, [0.05, 0.15], [5.5e5, 4.5e5])], axis=1)


def machine(**card):
    quantities = type(bench.BLANKS[RIG]).quantities
    return replace(bench.model(RIG), {quantities[name]: value for name, value in {**SHORT, **card}.items()})


def simulated(actuator):
    run = bench.simulated(actuator, bench.track(RIG, command()), SUBSTEPS, KEPT)
    states = run.states.state
    return [
        run.readings["current"], run.readings["force"], states["position"], states["pressure"][:, 0],
        states["temperature"][:, 0],
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("card", "tolerance"),
    [
        ({**SMOOTH, "viscous_friction": 2.0}, 2e-3),
        ({**SMOOTH, "wall_conductance": 0.0}, 2e-3),
        ({**SMOOTH, "polytropic_exponent": 1.05, "wall_conductance": 0.3}, 2e-3),
        # The oracle's dry friction is sharp: an impact comes some microseconds earlier or later.
        ({}, 3e-2),
    ],
    ids=["viscous", "adiabatic", "almost isothermal", "dry friction"],
)
def test_equals_oracle(card, tolerance):
    theirs = piston({**bench.CARDS[RIG], **SHORT, **card}, command(), bench.STEPS[RIG], 20)
    assert theirs[2].max() > 6e-3 and theirs[2][-1] < 5.5e-3 and np.ptp(theirs[4]) > (0.5 if card else 5)
    for ours, reference in zip(simulated(machine(**card)), theirs, strict=True):
        assert bench.deviation(ours, reference) < tolerance


def test_the_longest_step_is_short_enough():
    fine = simulated(machine())[1]
    coarse = bench.simulated(machine(), bench.track(RIG, command()), 8).readings["force"]
    assert bench.STEPS[RIG] / 8 <= machine().largest_step
    assert np.sqrt(np.mean((fine - coarse) ** 2)) < 0.01 * np.ptp(fine)


@pytest.mark.slow
def test_on_a_stiff_stopper_it_is_the_held_piston():
    # With n = 1 the gas keeps its temperature, as [H] takes it; what is left is dead volume and give.
    held = replace(bench.model("jet-pipe"), {"polytropic_exponent": 1.0, "residual_force": 0.0})
    free = replace(
        bench.model(RIG),
        {"gas.polytropic_exponent": 1.0, "dead_length": 1e-5,
         "piston.spring_rate": 0.0, "piston.coulomb_force": 0.0, "piston.stiction_force": 0.0},
    )  # fmt: skip
    at = equilibrium_at(held, "force", 45.0, command=1.0)
    beside = equilibrium(free, jnp.array([at.command, bench.CARDS["jet-pipe"]["supply_pressure"]]))
    assert at.converged and beside.converged
    np.testing.assert_allclose(beside.readings, at.readings, rtol=1e-6)
    # The stopper gives way a little: the held piston is put where the free one stands, and there they are
    # compared with a stopper that would give no more.
    stands = beside.state[beside.situation.names.index("position")]
    there = replace(held, {"stopper_position": stands + free.cylinder.stopper_length})
    one, other = linearise(there, at), linearise(replace(free, {"piston.stop_stiffness": 1e9}), beside)
    # The free one has poles of its temperatures and of the piston besides.
    for pole in np.asarray(one.poles()):
        assert np.abs(np.asarray(other.poles()) - pole).min() < 0.002 * abs(pole)
    np.testing.assert_allclose(other.gain("force", "command"), one.gain("force"), rtol=1e-3)


@pytest.mark.slow
def test_supply_pressure_is_an_input():
    free = machine(**SMOOTH)
    begin = jnp.array([1.0, bench.AMBIENT + 5e5])
    points = [
        equilibrium_at(free, "force", 40.0, command=begin.at[1].add(d), adjusted="command")
        for d in (-1e3, 1e3)
    ]
    assert all(point.converged for point in points)
    model = linearise(free, equilibrium_at(free, "force", 40.0, command=begin, adjusted="command"))
    assert model.inputs == ("command", "supply_pressure")
    # More supply makes up for less command at the same force.
    trade = (points[1].command[0] - points[0].command[0]) / 2e3
    ratio = model.gain("force", "supply_pressure") / model.gain("force", "command")
    np.testing.assert_allclose(trade, -ratio, rtol=1e-3)


SIZES = {"offset": 1e-3, "receiver_offset": 1e-4}


@pytest.mark.slow
def test_derivatives_equal_differences():
    actuator = machine()
    paths = list(parameters(actuator))
    values = np.array([float(entry.value) for entry in parameters(actuator).values()])
    size = np.array([abs(v) or SIZES[p.split(".")[-1]] for p, v in zip(paths, values, strict=True)])
    whole = bench.track(RIG, command())

    def readings(z):
        changed = replace(actuator, dict(zip(paths, values + z * size, strict=True)))
        out = bench.simulate(changed, whole, 8).readings
        return jnp.stack([out["current"] / 0.2, out["force"] / 50.0])

    h = 1e-6
    derivative = jax.jit(jax.jacfwd(readings))(jnp.zeros(len(paths)))
    both = jax.jit(jax.vmap(readings))
    difference = np.moveaxis(
        np.asarray(both(h * jnp.eye(len(paths))) - both(-h * jnp.eye(len(paths)))), 0, -1
    )
    difference = difference / (2 * h)
    assert np.isfinite(derivative).all()
    scale = np.abs(difference).max(axis=(0, 1))
    wrong = np.abs(derivative - difference).max(axis=(0, 1)) > 1e-4 * scale + 1e-7
    assert not wrong.any(), [
        f"{p}: {s:.1e}" for p, s in zip(np.array(paths)[wrong], scale[wrong], strict=True)
    ]
