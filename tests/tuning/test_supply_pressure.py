"""Scenarios of other supply pressures: on every rig that has a supply, by each of its names."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import AMBIENT, built

import jaxmuscle as jm
from jaxmuscle.control import PID, Attached, closed_loop, feedback_on
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace
from jaxmuscle.tuning import Scenario, grid
from jaxmuscle.tuning.tune import prepared

LOW, HIGH = AMBIENT + 3e5, AMBIENT + 6.5e5
STEP = 2e-3
CASES = {
    "isotonic": ("valve.supply_pressure", built(PID, 20.0, 5.0), 0.03),
    "jet-pipe": ("receiver.supply_pressure", built(PID, 2e-4, 5e-3), 20.0),
    "jet-pipe-piston": ("receiver.supply_pressure", built(PID, 2e-4, 5e-3), 20.0),
}
"""Rig → path of its supply pressure, a controller, a reference that asks much of the supply."""
SIZES = {"tracking": 1.0, "effort": 1.0}


def scenarios(rig):
    path, _, wanted = CASES[rig]
    times, held = STEP * np.arange(50), np.full(50, wanted)
    of = [{"supply_pressure": LOW}, {path: LOW}, {"supply_pressure": HIGH}, {}]
    return [Scenario(held, times, changes=changes) for changes in of], held, times


@pytest.mark.thorough
@pytest.mark.parametrize("rig", CASES)
def test_a_scenario_has_the_supply_that_it_names(rig):
    machine, (path, controller, _) = bench.model(rig), CASES[rig]
    several, held, times = scenarios(rig)
    evaluation = prepared(machine, controller, several, SIZES)
    seen = evaluation.seen(evaluation.unknowns.start, range(4))
    reading = machine.declared_channel().reading
    found = np.asarray(seen.readings[reading])
    own = float(bench.CARDS[rig]["supply_pressure"])
    for row, supply in enumerate((LOW, LOW, HIGH, own)):
        other = replace(machine, {path: supply})
        alone = closed_loop(other, feedback_on(other, controller), held, times)
        np.testing.assert_allclose(found[row], alone.readings[reading], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(seen.commands[row], alone.commands, rtol=1e-9, atol=1e-12)
    assert found[2][-1] > 1.02 * found[0][-1]  # a stronger supply gets farther in the same time


@pytest.mark.slow
def test_a_supply_that_is_a_command_costs_no_effort():
    """Commands that the controller does not move count from where they rest, whatever the supply."""
    several, _, _ = scenarios("jet-pipe-piston")
    evaluation = prepared(bench.model("jet-pipe-piston"), built(PID, 1e-9), several, SIZES)
    seen = evaluation.seen(evaluation.unknowns.start, range(4))
    assert np.asarray(seen.terms["effort"]).max() < 1e-6 < LOW


@pytest.mark.slow
def test_an_attachment_of_ones_own_keeps_its_supply_where_no_scenario_names_another():
    machine, (_, controller, _) = bench.model("jet-pipe-piston"), CASES["jet-pipe-piston"]
    loop = feedback_on(machine, controller)
    own = Attached(controller, "force", loop.rest.at[1].set(5e5), loop.direction, loop.lowest, loop.highest)
    several, _, _ = scenarios("jet-pipe-piston")
    evaluation = prepared(machine, own, several, SIZES)
    supplies = np.asarray(evaluation.seen(evaluation.unknowns.start, range(4)).commands)[:, :, 1]
    np.testing.assert_array_equal(supplies, np.broadcast_to([[LOW], [LOW], [HIGH], [5e5]], (4, 50)))


@pytest.mark.slow
def test_slopes_over_supplies_are_those_of_finite_differences():
    machine, (_, controller, wanted) = bench.model("isotonic"), CASES["isotonic"]
    times = STEP * np.arange(60)
    several = grid(wanted * np.minimum(times / 0.05, 1.0), times, {"supply_pressure": [LOW, HIGH]})
    evaluation = prepared(machine, controller, several, {"tracking": 1e-3})
    at = evaluation.unknowns.coordinates(evaluation.unknowns.start)
    slope, size = evaluation(at[None])[0].gradient, 1e-5
    assert np.linalg.norm(slope) > 0
    for i, unit in enumerate(np.eye(len(at))):
        up, down = evaluation(np.stack([at + size * unit, at - size * unit]))
        assert slope[i] == pytest.approx((up.cost - down.cost) / (2 * size), rel=1e-5)


@pytest.mark.slow
def test_the_sensitivity_is_that_of_the_machine_with_its_supply():
    _, controller, wanted = CASES["jet-pipe-piston"]
    # Dry friction would hold the piston anywhere.
    slides = {"piston.coulomb_force": 0.0, "piston.stiction_force": 0.0}
    machine, times = replace(bench.model("jet-pipe-piston"), slides), STEP * np.arange(20)
    several = grid(np.full(20, wanted), times, {"supply_pressure": [LOW, HIGH]})
    evaluation = prepared(machine, controller, several, {"tracking": 1.0, "sensitivity": 2.0})
    found = evaluation.seen(evaluation.unknowns.start, range(2)).terms["sensitivity"]
    for most, supply in zip(found, (LOW, HIGH), strict=True):
        other = replace(machine, {"supply_pressure": supply})
        assert most == pytest.approx(jm.control.margins(other, controller, STEP).sensitivity, rel=1e-6)


@pytest.mark.parametrize(
    ("rig", "changes", "told"),
    [
        ("isotonic", {"suply_pressure": LOW}, "unknown parameter 'suply_pressure'; did you mean 'supply_pr"),
        ("isotonic", {"supply_pressure": -LOW}, r"changes\['supply_pressure'\]: expected a value above zero"),
        ("joint", {"supply_pressure": LOW}, r"scenarios\[0\]: changes: unknown parameter 'supply_pressure'"),
    ],
)
def test_a_wrong_supply_is_told(rig, changes, told):
    own = Scenario(jnp.zeros(5), STEP * np.arange(5), changes=changes)
    with pytest.raises(InputError, match=told):
        jm.tune(bench.model(rig), built(PID, 1.0), own)
