"""Names of parameters and paths there and back, one rule for cards, fits, sweeps and reports."""

import equinox as eqx
import jax.numpy as jnp
import pytest
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.estimation.fittable_parameters import fittable
from jaxmuscle.parameter_names import (
    card_name,
    column_of_offset,
    effect_path,
    of_effect,
    of_machine,
    resolve,
    split_effect,
)
from jaxmuscle.parameters import expanded, get, known_names, parameter, parameters
from jaxmuscle.recordings import Card
from jaxmuscle.samples import sample
from jaxmuscle.sweeps.operating_points import swept
from jaxmuscle.sweeps.scenario import bench_of

FULL = {rig: bench.model(rig, [effect.name for effect in bench.offered(rig)]) for rig in RIGS}


class Weighted(eqx.Module):
    """A machine with an array."""

    weights: jnp.ndarray = parameter("N", "of each operator", nonnegative=True)


@pytest.mark.parametrize("rig", RIGS)
def test_every_parameter_is_found_by_each_of_its_names(rig):
    machine = FULL[rig]
    known = known_names(machine)
    for path, declared in parameters(machine).items():
        found = resolve(known, path, "free")
        assert found == resolve(known, found.name, "free")
        assert found.path == path and found.value == float(declared.value)
        assert found.name == card_name(machine.quantities, path)
        assert (found.unit, found.meaning, found.positive) == (
            declared.unit,
            declared.meaning,
            declared.positive,
        )
    for name, path in machine.quantities.items():
        assert known[name].path == path and known[name].name == name


@pytest.mark.parametrize("rig", RIGS)
def test_paths_of_effects_are_taken_apart_and_put_together(rig):
    machine = FULL[rig]
    effects = {path for path in parameters(machine) if split_effect(path)[0] is not None}
    assert {split_effect(path)[0] for path in effects} == set(machine.effects)
    for path in effects:
        effect, name = split_effect(path)
        assert effect is not None
        assert effect_path(effect, name) == path
        assert of_effect(effect, {path: 1.0, "effects.other.force": 2.0, "mass": 3.0}) == {name: 1.0}
        assert known_names(machine)[f"{effect}.{name}"].path == path
    assert split_effect("muscle.end_factor") == (None, "muscle.end_factor")


def test_an_array_and_its_entries():
    machine = Weighted(jnp.array([1.0, 2.0, 3.0]))
    known = known_names(machine)
    whole, last = resolve(known, "weights", "free"), resolve(known, "weights[2]", "free")
    assert whole.shape == (3,) and last.shape == () and last.value == 3.0 == float(get(machine, last.path))
    assert [entry.path for entry in expanded(known, whole)] == ["weights[0]", "weights[1]", "weights[2]"]
    assert expanded(known, last) == [last] and last.nonnegative and last.unit == "N"


def test_what_is_beside_the_machine():
    known = fittable(FULL["isotonic"], {})
    assert column_of_offset(known["offset.position"].path) == "position"
    assert column_of_offset("mass") is None
    assert [of_machine(name) for name in ("offset.position", "start.opening", "mass")] == [False, False, True]


def test_a_wrong_name_is_told_with_the_nearest_one():
    known = fittable(FULL["isotonic"], {})
    with pytest.raises(
        jm.InputError, match="priors: unknown parameter 'endfactor'; did you mean 'end_factor'"
    ):
        resolve(known, "endfactor", "priors")


@pytest.mark.parametrize("name", ["mass", "muscle.end_factor", "end_factor", "creep.stiffness", "load.mass"])
def test_a_sweep_knows_what_a_fit_knows(name):
    machine = FULL["isotonic"]
    found = swept(bench_of(machine, {}, jm.commands.Sine(), None, {}), name)
    known = resolve(known_names(machine), name, "fit")
    assert found.path == f"actuator.{known.path}" and found.name == known.name and found.unit == known.unit


def test_entries_of_a_card_go_by_the_names_of_results():
    card = Card.read(sample("lift").with_suffix(".toml"))
    known = known_names(jm.actuator(card))
    assert {known[name].name for name in card.entries} == set(card.entries)
    path = "effects.thread_friction.kinetic_coefficient"
    assert card.entries[path] == card.effects["thread_friction"]["kinetic_coefficient"]
