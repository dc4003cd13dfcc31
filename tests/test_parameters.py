"""Parameters by name: table, units, replacement, and the messages for a wrong path."""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pint
import pytest
from oracles import bench

from jaxmuscle.actuators import RIGS
from jaxmuscle.effects import CATALOGUE, FURTHER
from jaxmuscle.parameters import describe, entries_of, get, parameter, parameters, replace
from jaxmuscle.signals import SLOTS

UNITS = pint.UnitRegistry()
FULL = {rig: bench.model(rig, [effect.name for effect in bench.offered(rig)]) for rig in RIGS}
EVERY = [(rig, entry) for rig, model in FULL.items() for entry in parameters(model).values()]
IDS = [f"{rig}:{entry.path}" for rig, entry in EVERY]

UNLOADED = ("driven", "jet-pipe", "elbow")
"""Rigs on whose load nothing acts but what the rig says."""


def load_of(rig):
    """Unit of the load: a torque where the rig turns."""
    turning = rig in ("joint", "scara", "elbow")
    return UNITS.parse_units("newton * meter" if turning else "newton")


class Part(eqx.Module):
    """A part with one parameter."""

    size: Any = parameter("m", "how large it is", positive=True)


class Whole(eqx.Module):
    """Parts under a name and in a table."""

    part: Part
    parts: dict[str, Part]
    load: Any = parameter("{load}/s", "how fast it grows", default=0.0, nonnegative=True, typical=2.0)
    note: str = "no parameter"

    units: ClassVar = {"load": "N m"}


def whole():
    return Whole(Part(1), {"left": Part(2.0)})


def test_walks_modules_and_tables_in_order():
    assert list(parameters(whole())) == ["part.size", "parts.left.size", "load"]


def test_entries_carry_what_was_declared():
    size, load = parameters(whole())["part.size"], parameters(whole())["load"]
    assert (size.unit, size.meaning, size.positive, size.nonnegative) == ("m", "how large it is", True, False)
    assert (load.unit, load.nonnegative, load.typical) == ("N m/s", True, 2.0)


def test_a_natural_size_may_depend_on_the_unit():
    path = "effects.dead_band.width"
    volts, pascals = (parameters(bench.model(rig, ["dead_band"]))[path] for rig in ("isotonic", "joint"))
    assert (volts.unit, volts.typical, pascals.unit, pascals.typical) == ("V", 0.1, "Pa", 2e3)

    class Other(eqx.Module):
        """A part whose unit is not in the table."""

        units: ClassVar = {"command": "K"}
        shift: Any = parameter("{command}", "how far", default=0.0, typical={"V": 1.0})

    assert parameters(Other())["shift"].typical is None


def test_values_are_double_precision_arrays():
    for entry in parameters(whole()).values():
        assert entry.value.dtype == jnp.float64 and entry.value.shape == ()


def test_describe_is_a_table_by_path():
    table = describe(whole())
    assert list(table.columns) == ["value", "SI unit", "path", "meaning"] and table.index.name == "name"
    assert table.loc["parts.left.size", "value"] == "2 m"
    assert table.loc["load", "SI unit"] == "N m/s"


def test_replace_leaves_the_original_alone():
    original = whole()
    changed = replace(original, {"parts.left.size": 7, "load": 0.5})
    assert float(get(changed, "parts.left.size")) == 7.0 and float(get(changed, "load")) == 0.5
    assert float(get(original, "parts.left.size")) == 2.0 and float(get(original, "load")) == 0.0
    assert get(changed, "parts.left.size").dtype == jnp.float64
    assert float(get(changed, "part.size")) == 1.0


def test_replace_of_nothing_changes_nothing():
    assert eqx.tree_equal(replace(whole(), {}), whole())


@pytest.mark.parametrize("path", ["part.sise", "parts.right.size", "load.part", "nothing"])
def test_wrong_path_is_named(path):
    with pytest.raises(KeyError, match=path):
        get(whole(), path)
    with pytest.raises(KeyError, match=path):
        replace(whole(), {path: 1.0})


@pytest.mark.parametrize(("rig", "entry"), EVERY, ids=IDS)
def test_every_parameter_has_a_unit_and_a_meaning(rig, entry):
    assert "{" not in entry.unit
    UNITS.parse_units(entry.unit)
    assert entry.meaning.strip() and "\n" not in entry.meaning
    assert np.ndim(entry.value) == 0
    assert not (entry.positive and float(entry.value) <= 0)


@pytest.mark.parametrize("rig", RIGS)
def test_units_depend_on_the_rig(rig):
    entries = parameters(FULL[rig])
    path = "effects.load_friction.force"
    assert (path in entries) == (rig not in UNLOADED)
    if path in entries:
        assert UNITS.parse_units(entries[path].unit) == load_of(rig)


@pytest.mark.parametrize("rig", RIGS)
def test_what_effects_add_has_the_unit_of_the_signal(rig):
    units = {
        "command": UNITS.parse_units(RIGS[rig].units.get("command", "")),
        "tip_force": UNITS.newton,
        "tip_position": UNITS.meter,
        "supply_pressure": UNITS.pascal,
        "mass_flow": UNITS.kilogram / UNITS.second,
        "volume": UNITS.meter**3,
        "pressure_rate": UNITS.pascal / UNITS.second,
        "muscle_force": UNITS.newton,
        "load": load_of(rig),
        "force_reading": UNITS.newton,
        "pressure_reading": UNITS.pascal,
        "position_reading": UNITS.parse_units(RIGS[rig].units["motion"]),
    }
    slots = {effect.slot for effect in bench.offered(rig)}
    assert {slot.name for slot in SLOTS} == set(units) and slots <= set(SLOTS) and slots
    for slot in slots:
        assert UNITS.parse_units(slot.unit.format(**RIGS[rig].units)) == units[slot.name]


@pytest.mark.parametrize("rig", RIGS)
def test_quantities_of_a_card_are_the_parameters_of_the_machine(rig):
    assert set(RIGS[rig].quantities.values()) == set(parameters(bench.model(rig)))


@pytest.mark.parametrize("effect", (*CATALOGUE, *FURTHER), ids=lambda effect: effect.__name__)
def test_effects_say_what_they_are(effect):
    own = [field.name for field in dataclasses.fields(effect)]
    assert effect.strength in own
    assert effect.slot in SLOTS
    assert effect.source.strip() and effect.__doc__.strip()
    assert effect.name == effect.name.lower() and " " not in effect.name
    for start in effect.starts:
        assert set(start) <= set(own)
    assert any(rig.offers(effect) for rig in RIGS.values())


@pytest.mark.parametrize("rig", RIGS)
def test_names_of_effects_are_unique_on_a_rig(rig):
    names = [effect.name for effect in bench.offered(rig)]
    assert len(set(names)) == len(names)
    assert [RIGS[rig].effect_named(name) for name in names] == bench.offered(rig)


@pytest.mark.parametrize("rig", RIGS)
def test_with_and_without_effects(rig):
    bare = bench.model(rig)
    name = bench.offered(rig)[0].name
    carrying = bare.with_effects(**{name: bare.effect_named(name)(**{})})
    assert list(carrying.effects) == [name] and not bare.effects
    assert eqx.tree_equal(carrying.without_effects(name), bare)


class Weighted(eqx.Module):
    """A model with an array."""

    weights: jax.Array = parameter("N", "a table")


def test_entries_of_an_array_are_read_and_replaced():
    model = Weighted(np.arange(6.0).reshape(2, 3))  # pyright: ignore[reportArgumentType]
    assert entries_of("weights", model.weights)[-1] == "weights[1,2]"
    assert float(get(model, "weights[1,0]")) == 3.0
    changed = replace(model, {"weights[1,0]": 30.0, "weights[0,2]": -2.0})
    np.testing.assert_array_equal(changed.weights, [[0, 1, -2], [30, 4, 5]])
    # A whole array and one of its entries: the entry counts.
    both = replace(model, {"weights[0,0]": 9.0, "weights": np.ones((2, 3))})
    np.testing.assert_array_equal(both.weights, [[9, 1, 1], [1, 1, 1]])
    slope = jax.jacfwd(lambda x: replace(model, {"weights[0,1]": x}).weights.sum())(2.0)
    assert float(slope) == 1.0
    for wrong in ("weights[2,0]", "weights[1]"):
        with pytest.raises(KeyError, match=r"weights has shape \(2, 3\)"):
            get(model, wrong)
