"""Few structures, and fits of any number of parameters."""

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import driven_card, driven_recording

from jaxmuscle.diagnosis.candidates import carries_state, missing
from jaxmuscle.diagnosis.workbench import SPARE, workbench
from jaxmuscle.effects import CATALOGUE
from jaxmuscle.fitting.case import case
from jaxmuscle.parameters import get, replace


@pytest.fixture(scope="module")
def prepared():
    return case(driven_recording({"pressure_dependent_ends": {"amplitude": 0.8}}, driven_card({})), 0.0)


@pytest.fixture(scope="module")
def tools(prepared):
    return workbench(prepared, missing(prepared.actuator, CATALOGUE))


def test_states_are_carried_only_where_they_are_wanted(tools):
    offered = {effect.name for effect in bench.offered("driven")}
    stateful = {effect.name for effect in CATALOGUE if carries_state(effect)} & offered
    assert stateful == {"creep", "force_sensor_lag", "length_hysteresis"}
    assert set(tools.model.effects) == offered - stateful
    creeping = tools.dressed(tools.model, ["creep", "bladder_stiffness"])
    assert set(creeping.effects) == {*tools.model.effects, "creep"}
    kept = tools.dressed(replace(creeping, {"effects.creep.stiffness": 7.0}), ["creep"])
    assert float(get(kept, "effects.creep.stiffness")) == 7.0
    assert set(tools.dressed(kept, []).effects) == set(tools.model.effects)


def test_order_names_every_path_that_may_move(tools):
    order = tools.order(tools.dressed(tools.model, ["creep"]))
    assert order[: len(tools.declared)] == list(tools.declared)
    assert "effects.creep.slow_time" in order
    assert "effects.creep.slow_time" not in tools.order(tools.model)
    assert len(set(order)) == len(order)


def test_a_fit_of_more_parameters_than_fits_are_laid_out_for(prepared, tools):
    names = ["thread_friction", "bladder_stiffness", "bladder_hoop_stiffness", "pressure_dependent_ends"]
    free = tools.free_paths(tools.dressed(tools.model, names), names)
    assert len(free) == tools.width + 1 == len(prepared.priors) + SPARE + 1
    before = tools.cost(tools.model, prepared.training)
    model, lane = tools.fit(tools.model, names, prepared.training, 15)
    assert np.isfinite(lane.cost)
    assert tools.cost(model, prepared.training) < 0.1 * before
