"""Which effects are tried, and where their fits begin.

Few structures, and fits of any number of parameters.
"""

import dataclasses

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import driven_card, driven_recording

from jaxmuscle import effects
from jaxmuscle.diagnosis.candidate_models import CandidateModels
from jaxmuscle.diagnosis.candidates import (
    SEEN,
    carries_state,
    is_dry_friction,
    linear_strength,
    loaded,
    missing,
    paths_of,
    shapes,
    strengths,
)
from jaxmuscle.diagnosis.card_constants import CardConstant, card_constants
from jaxmuscle.diagnosis.evidence import Evidence
from jaxmuscle.diagnosis.ranking import Candidate, simplest_first
from jaxmuscle.diagnosis.workbench import SPARE, workbench
from jaxmuscle.effects import BY_NAME, CATALOGUE
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import get, replace


def problem(seed, free=3, samples=80):
    rng = np.random.default_rng(seed)
    return rng.normal(size=samples), rng.normal(size=(free, samples)), rng.normal(size=samples)


def cost(residual, slopes):
    """Solution and sum of squares of the best linear step along `slopes`."""
    step = np.linalg.lstsq(slopes.T, -residual, rcond=None)[0]
    return step, float(((residual + step @ slopes) ** 2).sum())


@pytest.mark.parametrize("seed", range(4))
def test_linear_strength_is_least_squares(seed):
    residual, free, direction = problem(seed)
    strength, gain = linear_strength(residual, free, direction)
    _, without = cost(residual, free)
    step, whole = cost(residual, np.vstack([free, direction]))
    assert strength == pytest.approx(step[-1], rel=1e-9)
    assert gain == pytest.approx(1 - whole / without, rel=1e-9)


def test_linear_strength_of_what_made_the_residual():
    _, free, direction = problem(9)
    strength, gain = linear_strength(0.3 * free[0] - 2.5 * direction, free, direction)
    assert strength == pytest.approx(2.5)
    assert gain == pytest.approx(1.0)


def test_direction_that_the_free_parameters_have_already():
    residual, free, _ = problem(2)
    assert linear_strength(residual, free, 0.7 * free[0] - free[2]) == (0.0, 0.0)
    assert linear_strength(residual, free, np.zeros_like(residual)) == (0.0, 0.0)


def test_missing_are_offered_and_not_declared():
    model = bench.model("driven", thread_friction=bench.THREADS)
    names = {effect.name for effect in missing(model, CATALOGUE)}
    assert names == {effect.name for effect in bench.sought("driven")} - {"thread_friction"}
    assert "bladder_stiffness" in names
    assert not names & {"chamber_leak", "command_delay", "load_friction"}
    assert missing(model, [BY_NAME["chamber_leak"], BY_NAME["creep"]]) == [BY_NAME["creep"]]


def test_dry_friction_and_its_bristles_are_told_from_other_candidates():
    friction = {"thread_friction", "load_friction", "stribeck", "pressure_dependent_friction", "presliding"}
    assert {name for name, effect in BY_NAME.items() if is_dry_friction(effect)} == friction
    mass = CardConstant("mass", "mass", 8.0, None, 1.0, 100.0, "mass that is lifted")
    assert not is_dry_friction(mass)


def test_loaded_carries_all_at_zero_strength():
    model = bench.model("isotonic", load_friction={"force": 7.0})
    candidates = missing(model, CATALOGUE)
    carrying = loaded(model, candidates)
    assert set(carrying.effects) == {"load_friction", *(effect.name for effect in candidates)}
    assert float(get(carrying, "effects.load_friction.force")) == 7.0
    for effect in candidates:
        assert float(get(carrying, f"effects.{effect.name}.{effect.strength}")) == 0.0
        assert all(path.startswith(f"effects.{effect.name}.") for path in paths_of(carrying, effect.name))


def test_strengths_reach_from_what_is_just_seen_to_the_whole_misfit():
    rng = np.random.default_rng(3)
    slope, residual = rng.normal(size=400), 20.0 * rng.normal(size=400)
    slope[100:], residual[100:] = 0.0, 0.0  # samples that do not count
    found = strengths(slope, residual, nonnegative=True)
    changes = [strength * np.sqrt(np.mean(slope[:100] ** 2)) for strength in found]
    assert changes == sorted(changes)
    assert changes[0] == pytest.approx(SEEN)
    assert changes[-1] == pytest.approx(3 * np.sqrt(np.mean(residual[:100] ** 2)))
    assert strengths(slope, residual, nonnegative=False) == [*found, *(-s for s in found)]
    # A model that fits to the noise: up to three times the noise.
    quiet = strengths(slope, residual / 100, nonnegative=True)
    assert quiet[-1] / quiet[0] == pytest.approx(3 / SEEN)


@pytest.mark.parametrize("slope", [0.0, np.nan, np.inf])
def test_an_effect_that_changes_nothing_has_no_strengths_to_try(slope):
    assert strengths(np.full(50, slope), np.ones(50), nonnegative=False) == []


@pytest.mark.parametrize("name", ["thread_friction", "gravity", "command_delay", "creep"])
def test_shapes_are_those_of_the_effect(name):
    effect = BY_NAME[name]
    expected = [{f"effects.{name}.{key}": value for key, value in s.items()} for s in effect.starts]
    assert list(shapes(effect)) == expected


def test_effects_with_a_state_of_their_own():
    names = {effect.name for effect in CATALOGUE if carries_state(effect)}
    assert names == {"length_hysteresis", "creep", "force_sensor_lag", "valve_hysteresis"}


@pytest.fixture(scope="module")
def prepared():
    return case(driven_recording({"pressure_dependent_ends": {"amplitude": 0.8}}, driven_card({})), 0.0)


@pytest.fixture(scope="module")
def tools(prepared):
    return workbench(prepared, missing(prepared.actuator, CATALOGUE))


def test_states_are_carried_only_where_they_are_wanted(tools):
    offered = {effect.name for effect in bench.sought("driven")}
    stateful = {effect.name for effect in CATALOGUE if carries_state(effect)} & offered
    assert stateful == {"creep", "force_sensor_lag", "length_hysteresis"}
    assert not tools.model.effects
    still = tools.dressed(tools.model, [])
    assert set(still.effects) == offered - stateful
    assert {*tools.dressed(tools.model, ["bladder_stiffness"]).effects} == {*still.effects}
    creeping = tools.dressed(still, ["bladder_stiffness", "creep"])
    # One structure for all candidates with a state: those that are not wanted are at zero strength.
    assert set(creeping.effects) == offered
    strong = replace(creeping, {"effects.creep.stiffness": 7.0, "effects.length_hysteresis.weight": 0.1})
    kept = tools.dressed(strong, ["creep"])
    assert float(get(kept, "effects.creep.stiffness")) == 7.0
    assert float(get(kept, "effects.length_hysteresis.weight")) == 0.0
    # What was found stays; beside it only those that are tried together with the last one.
    further = tools.dressed(kept, ["creep", "bladder_stiffness"])
    assert set(further.effects) == {*still.effects, "creep"}
    assert float(get(further, "effects.creep.stiffness")) == 7.0
    assert set(tools.dressed(kept, []).effects) == set(still.effects)


def test_rarer_effects_are_carried_apart_from_the_usual_ones():
    joint = bench.model("joint")
    catalogue = *CATALOGUE, *effects.EXTENSION, *effects.reading_effects(type(joint))
    tools = CandidateModels(joint, tuple(missing(joint, catalogue)), (), {}, (), (), ())
    rarer = {effect.name for effect in tools.candidates if effect not in CATALOGUE}
    stateful = {effect.name for effect in tools.candidates if carries_state(effect)} & rarer
    assert {"backlash", "rate_limit"} <= stateful and {"end_stop", "sensor_gain_angle"} <= rarer - stateful
    still = tools.dressed(joint, ["end_stop"])
    assert set(still.effects) == rarer - stateful
    assert set(tools.dressed(still, ["creep", "backlash"]).effects) == {"creep", *stateful}
    assert set(tools.dressed(still, ["creep", "end_stop"]).effects) == {"creep", *still.effects}
    # One candidate of each group has its program compiled; in turns, so that cores compile different ones.
    programs = [frozenset(tools.dressed(joint, [e.name]).effects) for e in tools.one_of_each()]
    assert len(programs) == len(set(programs)) == 4
    turns = [effect for effect in tools.in_turns(tools.candidates) if not isinstance(effect, CardConstant)]
    assert set(turns) == set(tools.candidates) and len(turns) == len(tools.candidates)
    assert len({frozenset(tools.together(effect)) for effect in turns[:4]}) == 4
    assert carries_state(turns[0])


def test_order_names_every_path_that_may_move(tools):
    order = tools.order(tools.dressed(tools.model, ["creep"]), ["creep"])
    assert order[: len(tools.declared)] == list(tools.declared)
    assert "effects.creep.slow_time" in order
    assert "effects.creep.slow_time" not in tools.order(tools.dressed(tools.model, []), [])
    assert len(set(order)) == len(order)


@pytest.mark.slow
def test_a_fit_of_more_parameters_than_fits_are_laid_out_for(prepared, tools):
    names = ["thread_friction", "bladder_stiffness", "bladder_hoop_stiffness", "pressure_dependent_ends"]
    free = tools.free_paths(tools.dressed(tools.model, names), names)
    assert len(free) == tools.width + 1 == len(prepared.priors) + SPARE + 1
    _, slopes = tools.jacobian(tools.model, prepared.training, free, names)
    wide = dataclasses.replace(tools, width=len(free))
    np.testing.assert_allclose(slopes, wide.jacobian(tools.model, prepared.training, free, names)[1])
    before = tools.cost(tools.model, prepared.training)
    model, lane = tools.fit(tools.model, names, prepared.training, 15)
    assert np.isfinite(lane.cost)
    assert tools.cost(model, prepared.training) < 0.1 * before


def test_of_candidates_that_are_as_good_the_simplest_comes_first():
    lift = bench.model("isotonic", ("creep", "load_friction", "bladder_stiffness"))

    def ranked(*gains, p_values=(0.0, 0.0, 0.0)):
        each = (effects.Creep, effects.BladderStiffness, effects.LoadFriction)
        return [
            Candidate((e,), Evidence(gain, p, 1 - gain), np.full((1, 40), 1.5), lift, ())
            for e, gain, p in zip(each, gains, p_values, strict=True)
        ]

    def names(candidates, **left):
        return [each.name for each in simplest_first(candidates, 0, lambda c: left.get(c.name, 1.0), 1)]

    creep, bladder, friction = "creep", "bladder_stiffness", "load_friction"
    assert names(ranked(0.992, 0.99, 0.9)) == [bladder, creep, friction]
    assert names(ranked(0.992, 0.991, 0.99)) == [friction, creep, bladder]
    assert names(ranked(0.992, 0.991, 0.99, p_values=(1e-4, 1e-4, 0.02))) == [bladder, creep, friction]
    assert names(ranked(0.992, 0.991, 0.99, p_values=(1e-4, 0.02, 0.02))) == [creep, bladder, friction]
    assert names(ranked(0.5, 0.6, 0.4)) == [creep, bladder, friction]
    assert names(ranked(0.992, 0.97, 0.96)) == [creep, bladder, friction]
    assert names([]) == []
    # As good over the parts of windows, but not where predictions go on.
    assert names(ranked(0.992, 0.991, 0.99), load_friction=13.6) == [bladder, creep, friction]
    assert names(ranked(0.992, 0.991, 0.99), load_friction=13.6, creep=12.0) == [friction, creep, bladder]
    assert names(ranked(0.992, 0.991, 0.99), load_friction=1.9, creep=0.6) == [friction, creep, bladder]
    # As good by the gain, but unseen windows tell them apart: over nearly all of them the best one is better.
    better, simple, last = ranked(0.999, 0.991, 0.9)
    worse = dataclasses.replace(simple, losses=np.full((1, 40), 1.7))
    assert names([better, worse, last]) == [creep, bladder, friction]
    as_often = dataclasses.replace(simple, losses=np.where(np.arange(40) % 2, 1.7, 1.3)[None])
    assert names([better, as_often, last]) == [bladder, creep, friction]


def test_what_refines_friction_waits_until_a_friction_is_found_that_leaves_much(prepared):
    kinds = [effects.ThreadFriction, effects.Creep]
    tools = workbench(prepared, kinds, refinements=[effects.Presliding])

    def names(accepted, much_is_left):
        return [effect.name for effect in tools.sought(accepted, much_is_left)]

    assert names([], True) == ["thread_friction", "creep"]
    assert names(["creep"], True) == ["thread_friction"]
    assert names(["thread_friction"], True) == ["creep", "presliding"]
    assert names(["thread_friction", "presliding"], True) == ["creep"]
    # Every guide has a little of it.
    assert names(["thread_friction"], False) == ["creep"]
    # It is carried where it is sought or was added, so that no other search becomes dearer.
    assert set(tools.dressed(tools.model, ["creep"]).effects) == {"thread_friction", "creep"}
    bristly = tools.dressed(tools.model, ["thread_friction", "presliding"])
    assert set(bristly.effects) == {"thread_friction", "presliding"}
    assert set(tools.dressed(bristly, ["thread_friction"]).effects) == {"thread_friction"}


def test_what_refines_friction_is_a_rival_beside_a_declared_or_found_one(prepared):
    tools = workbench(prepared, [effects.ThreadFriction, effects.Creep], refinements=[effects.Presliding])
    assert tools.refining([]) == tools.refining(["creep"]) == []
    assert tools.refining(["thread_friction"]) == [effects.Presliding]
    assert tools.refining(["thread_friction", "presliding"]) == []
    rough = prepared.actuator.with_effects(thread_friction=effects.ThreadFriction())
    declared = dataclasses.replace(tools, model=rough)
    assert declared.refining([]) == declared.refining(["creep"]) == [effects.Presliding]
    assert declared.sought([], True) == tools.sought([], True)


def test_what_refines_a_declared_friction_is_sought_beside_what_was_found(prepared):
    """The ends of a rough joint's muscles left 4.7 noise units, with bristles 1.0 (blind joint 110218)."""
    kinds = [effects.BladderStiffness, effects.Creep]
    tools = workbench(prepared, kinds, refinements=[effects.Presliding])
    rough = dataclasses.replace(
        tools, model=prepared.actuator.with_effects(thread_friction=effects.ThreadFriction())
    )
    assert rough.sought(["bladder_stiffness"], True) == [effects.Creep, effects.Presliding]
    assert rough.sought(["bladder_stiffness"], False) == [effects.Creep]
    assert tools.sought(["bladder_stiffness"], True) == [effects.Creep]


def test_constants_alone_are_tried_in_a_small_structure(prepared):
    constants = card_constants(prepared)
    tools = workbench(prepared, [effects.ThreadFriction, effects.Creep], constants=constants)
    first = [constants[0].name]
    small = tools.dressed(tools.model, first)
    paths = dict.fromkeys([*tools.declared, *(constant.path for constant in constants)])
    assert not small.effects and tools.order(small, first) == list(paths)
    assert set(tools.dressed(small, []).effects) == {"thread_friction"}
    assert set(tools.dressed(small, [*first, "creep"]).effects) == {"thread_friction", "creep"}
    assert set(tools.dressed(small, ["creep", *first]).effects) == {"creep"}
    # Where none was found, programs are those of a search without constants.
    assert tools.order(small, []) == [*tools.declared]
    assert constants[0].path in tools.order(small, ["creep", *first])
