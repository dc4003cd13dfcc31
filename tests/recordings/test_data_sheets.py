"""Data sheets of muscles and valves: what they say, what a card takes from them, and what it does not."""

import dataclasses
import tomllib
from collections.abc import Mapping
from importlib.resources import files

import jax.numpy as jnp
import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.components import FlowValve, McKibben
from jaxmuscle.components.gas import nozzle_flow
from jaxmuscle.components.mckibben import largest_contraction
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import declared_at, get
from jaxmuscle.recordings import Card, data_sheet
from jaxmuscle.recordings.data_sheets import (
    NOMINAL_PRESSURES,
    NORMAL_DENSITY,
    PARTS,
    all_sources,
    data_sheets,
    name_in_cards,
    sheet_quantities,
)
from jaxmuscle.samples import sample
from jaxmuscle.units import out_of_range

pytestmark = pytest.mark.usefixtures("package_rigs")

TABLE = tomllib.loads(files("jaxmuscle.recordings").joinpath("data_sheets.toml").read_text(encoding="utf-8"))
ALL = [(part, name) for part, sheets in data_sheets().items() for name in sheets]
MUSCLE, VALVE = "Festo DMSP-20", "Festo MPYE-5-1/8-LF-010-B"
OF_MUSCLE = ("initial_radius", "braid_angle", "end_factor")
OF_VALVE = ("valve_area", "valve_time_constant", "full_command")


def text_of(name: str, *left_out: str, parts: str = "") -> str:
    """The card of a sample without some of its quantities, with sections of parts at its end."""
    lines = sample(name).with_suffix(".toml").read_text(encoding="utf-8").splitlines()
    return "\n".join(line for line in lines if line.split(" ")[0] not in left_out) + "\n" + parts


def lift(*left_out: str, muscle: str = "", valve: str = "") -> str:
    """The card of the lift without some quantities, with types."""
    parts = f'[muscle]  # the black one\ntype = "{muscle}"\n' if muscle else ""
    return text_of("lift", *left_out, parts=parts + (f'[valve]\ntype = "{valve}"\n' if valve else ""))


def muscle_of(values: Mapping[str, float]) -> McKibben:
    """A muscle of these sizes [SI]."""
    return McKibben(**{name: jnp.asarray(value) for name, value in values.items()})


def told(text: str) -> str:
    """What is wrong with a card."""
    with pytest.raises(InputError) as caught:
        Card.from_toml(text)
    return str(caught.value)


@pytest.mark.parametrize(("part", "name"), ALL)
def test_every_number_has_a_source_and_can_be(part: str, name: str) -> None:
    sheet = data_sheet(part, name)
    model = {"muscle": McKibben, "valve": FlowValve}[part]
    assert sheet.quantities and (sheet.part, sheet.type) == (part, name)
    for field, quantity in sheet.quantities.items():
        assert quantity.sources and all(len(source) > 20 for source in quantity.sources)
        assert declared_at(model, field).metadata["unit"] == quantity.si
        assert quantity.derived == (quantity.std is not None)
        wrong = out_of_range(name_in_cards(part, field), sheet.values[field], quantity.unit, quantity.si)
        assert wrong is None, wrong
        if quantity.std is not None:
            assert 0 < quantity.std < 0.5 * quantity.value


def test_no_number_is_typed_in_without_a_source() -> None:
    for part in PARTS:
        for name, stated in TABLE[part].items():
            for entry in stated.values():
                assert entry["source"] and set(entry["source"]) <= set(TABLE["sources"]), name
    assert set(all_sources()) == set(TABLE["sources"].values())


@pytest.mark.parametrize("name", [name for name, stated in TABLE["muscle"].items() if "force" in stated])
def test_a_muscle_pulls_and_contracts_as_its_data_sheet_states(name: str) -> None:
    stated, sheet = TABLE["muscle"][name], data_sheet("muscle", name)
    muscle = muscle_of({"initial_length": 1.0, **sheet.values})
    pressure = 1e5 * stated["pressure"]["value"]
    force = float(muscle.force(jnp.zeros(()), jnp.asarray(pressure), muscle.end_factor))
    # Three digits of the angle are half a percent of the force.
    assert force == pytest.approx(stated["force"]["value"], rel=5e-3)
    assert float(largest_contraction(muscle)) == pytest.approx(stated["contraction"]["value"], rel=5e-3)
    assert 2000 * float(muscle.initial_radius) == pytest.approx(stated["inner_diameter"]["value"])


def test_a_muscle_without_a_stated_force_contracts_as_stated() -> None:
    sheet = data_sheet("muscle", "Shadow Air Muscle")
    assert set(sheet.quantities) == {"braid_angle", "end_factor"}
    muscle = muscle_of({"initial_length": 1.0, "initial_radius": 0.01, **sheet.values})
    assert float(largest_contraction(muscle)) == pytest.approx(0.4, rel=5e-3)


@pytest.mark.parametrize("name", TABLE["valve"])
def test_a_valve_passes_its_nominal_flow(name: str) -> None:
    stated, values = TABLE["valve"][name], data_sheet("valve", name).values
    flow = nozzle_flow(*(jnp.asarray(x) for x in (values["area"], *NOMINAL_PRESSURES, 293.15)))
    litres = 60e3 * float(flow) / NORMAL_DENSITY
    assert litres == pytest.approx(stated["nominal_flow"]["value"], rel=5e-3)
    assert 2 * values["full_command"] == stated["command_range"]["value"]
    if "critical_frequency" in stated:
        passed = 1 / np.hypot(1, 2 * np.pi * stated["critical_frequency"]["value"] * values["time_constant"])
        assert 20 * np.log10(passed) == pytest.approx(-3.01, abs=0.03)


def test_what_the_card_leaves_out_comes_from_the_data_sheets() -> None:
    card = Card.from_toml(lift(*OF_MUSCLE, *OF_VALVE, muscle=MUSCLE, valve=VALVE))
    assert card.parts == {"muscle": MUSCLE, "valve": VALVE}
    assert card.known["initial_radius"].value == pytest.approx(0.01)
    assert card.known["full_command"].value == 5
    angle, area = card.uncertain["braid_angle"], card.uncertain["valve_area"]
    assert (angle.value, angle.std) == pytest.approx((np.radians(25.3), np.radians(2)))
    assert (area.value, area.std) == pytest.approx((5.83e-6, 1.2e-6))
    assert card.uncertain["valve_time_constant"].value == pytest.approx(1.59e-3)
    assert card.sheet_quantities == {*OF_MUSCLE, *OF_VALVE}


def test_what_the_card_gives_goes_before() -> None:
    own = Card.from_toml(lift())
    card = Card.from_toml(lift("end_factor", muscle=MUSCLE, valve=VALVE))
    for name in (set(own.quantities) - {"end_factor"}) & set(card.quantities):
        assert card.quantities[name] == own.quantities[name]
    assert set(card.quantities) == set(own.quantities)
    assert card.sheet_quantities == {"end_factor", "full_command"}  # 5 V is what both say.


def test_the_written_card_leaves_to_the_data_sheet_what_is_its() -> None:
    text = lift(*OF_MUSCLE, muscle=MUSCLE)
    card = Card.from_toml(text)
    assert card.to_toml() == text
    bare = dataclasses.replace(card, text=None)
    written = bare.to_toml()
    assert f'[muscle]\ntype = "{MUSCLE}"\n' in written
    assert not any(name in written for name in OF_MUSCLE)
    assert Card.from_toml(written) == card


@pytest.mark.parametrize("std", [1e-3, None])
def test_a_fitted_value_of_the_data_sheet_stands_in_the_card(std: float | None) -> None:
    card = Card.from_toml(lift(*OF_MUSCLE, muscle=MUSCLE))
    for one in (card, dataclasses.replace(card, text=None)):
        changed = one.updated({"braid_angle": (0.44, std)})
        written = changed.to_toml()
        assert Card.from_toml(written) == changed
        assert "braid_angle" in written and "end_factor" not in written and MUSCLE in written
    assert "# the black one" in card.updated({"braid_angle": (0.44, std)}).to_toml()


def test_a_value_that_the_card_gives_as_its_data_sheet_does_may_change() -> None:
    text = lift("initial_radius", muscle=MUSCLE).replace(
        "[known]\n", '[known]\ninitial_radius = { value = 10, unit = "mm" }\n'
    )
    card = Card.from_toml(text)
    assert card.to_toml() == text
    changed = card.updated({"initial_radius": (0.0101, 1e-4)})
    assert Card.from_toml(changed.to_toml()) == changed


@pytest.mark.parametrize("rig", ["joint", "driven", "scara"])
def test_equal_muscles_of_other_rigs(rig: str) -> None:
    assert set(sheet_quantities(RIGS[rig], "muscle", MUSCLE)) == set(OF_MUSCLE)


def test_a_joint_of_two_muscles_of_one_type() -> None:
    card = Card.from_toml(text_of("swing", *OF_MUSCLE, parts=f'[muscle]\ntype = "{MUSCLE}"\n'))
    joint = jm.actuator(card)
    assert float(get(joint, "muscle.braid_angle")) == pytest.approx(np.radians(25.3))


def test_a_recording_of_a_bought_muscle() -> None:
    card = Card.from_toml(lift(*OF_MUSCLE, muscle=MUSCLE))
    recording = jm.read(sample("lift"), card=card)
    values = data_sheet("muscle", MUSCLE).values
    machine = jm.actuator(recording.card)
    assert {name: float(get(machine, f"muscle.{name}")) for name in OF_MUSCLE} == pytest.approx(values)
    plain = jm.read(sample("lift"))
    assert all(np.array_equal(recording.columns[name], plain.columns[name]) for name in plain.columns)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (lift(muscle="Festo DMSP-2"), ("[muscle] type", "unknown type 'Festo DMSP-2'", "did you mean")),
        (lift(valve="spool"), ("[valve] type", "expected one of Festo MPYE-5-M5-010-B, ")),
        (lift(muscle=VALVE), ("[muscle] type", "unknown type", "Shadow Air Muscle")),
        (lift() + "[muscle]\ntype = 20\n", ("expected the name of a type", "got 20")),
        (lift() + "[muscle]\nlength = 20\n", ("unknown 'length'", "expected the name of a type", "got None")),
        ('muscle = "Festo DMSP-20"\n' + lift(), ("expected a section [muscle]",)),
        (lift() + '[muscle]\ntype = "?"\n', ("[muscle] type", "still to be filled in")),
        (
            text_of("swing", parts=f'[valve]\ntype = "{VALVE}"\n'),
            ("rig 'joint' has no valve of this kind", "valve.area", "remove [valve]"),
        ),
    ],
)
def test_what_is_wrong_is_told(text: str, expected: tuple[str, ...]) -> None:
    message = told(text)
    assert all(part in message for part in expected), message


def test_what_a_type_lacks_is_still_missing() -> None:
    message = told(lift(*OF_MUSCLE, muscle="Shadow Air Muscle"))
    assert "1 missing" in message and "initial_radius = { value = …" in message
    assert "braid_angle" not in message and "end_factor" not in message


def test_arrays_take_standard_deviations_of_a_type() -> None:
    plain = jm.read(sample("lift"))
    machine = jm.actuator(plain.card)
    given = {"columns": plain.columns, "step": plain.step}
    taken = jm.recording(machine, **given, muscle=MUSCLE, valve=VALVE, uncertain={"end_factor": 0.1})
    spread = {name: quantity.std for name, quantity in taken.card.uncertain.items()}
    assert spread == pytest.approx(
        {"braid_angle": np.radians(2), "end_factor": 0.1, "valve_area": 1.2e-6, "valve_time_constant": 6.4e-4}
    )
    assert taken.card.uncertain["braid_angle"].value == pytest.approx(np.radians(22))
    assert Card.from_toml(taken.card.to_toml()) == taken.card
    with pytest.raises(InputError, match="muscle: unknown type 'DMSP'"):
        jm.recording(machine, **given, muscle="DMSP")
