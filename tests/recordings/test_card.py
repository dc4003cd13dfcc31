"""Good cards: numbers, round trips, machines built from them."""

import dataclasses
import tomllib

import numpy as np
import pytest

from jaxmuscle.actuators import RIGS, Isotonic, Joint
from jaxmuscle.effects import LoadDamping
from jaxmuscle.parameters import get, parameters
from jaxmuscle.recordings import Card, actuator_from_card, schema
from jaxmuscle.samples import NAMES, sample
from jaxmuscle.units import STANDARD_ATMOSPHERE


def card(name: str) -> Card:
    return Card.read(sample(name).with_suffix(".toml"))


def reread(written: Card) -> Card:
    return Card.parse(tomllib.loads(written.to_toml()))


def test_values_are_si_and_absolute() -> None:
    lift = card("lift")
    assert lift.known["supply_pressure"].value == 700000 + 101325
    assert lift.known["ambient_pressure"].value == lift.ambient_pressure == 101325
    assert lift.known["gas_temperature"].value == 293.15
    assert lift.known["braid_angle"].value == pytest.approx(22 * np.pi / 180, rel=1e-15)
    assert lift.uncertain["valve_area"].value == pytest.approx(1.16709e-6, rel=1e-15)
    assert lift.uncertain["valve_area"].std == pytest.approx(0.2e-6, rel=1e-15)
    assert lift.uncertain["valve_time_constant"].std == pytest.approx(1e-3, rel=1e-15)
    assert lift.effects["thread_friction"]["velocity_constant"].std == 0.04
    assert lift.noise == {"pressure": pytest.approx(400.0), "position": pytest.approx(3e-5)}
    assert lift.horizon == 1.0
    assert card("bench").horizon is None
    assert card("swing").uncertain["regulator_frequency"].value == 14.5265


@pytest.mark.parametrize("name", NAMES)
def test_a_written_card_reads_back_equal(name: str) -> None:
    assert reread(card(name)) == card(name)


def test_the_written_card_keeps_the_units_and_numbers_of_the_user() -> None:
    text = card("lift").to_toml()
    assert 'supply_pressure = { value = 7, unit = "bar", reference = "gauge" }' in text
    assert 'gas_temperature = { value = 20, unit = "degC" }' in text
    assert 'valve_area = { value = 1.16709, std = 0.2, unit = "mm^2" }' in text
    assert 'position = { value = 0.03, unit = "mm" }' in text


def test_texts_with_quotes_and_backslashes_survive() -> None:
    mapping = tomllib.loads(sample("bench").with_suffix(".toml").read_text(encoding="utf-8"))
    mapping["description"] = 'a "muscle" in C:\\data\n\twith α0 = 22° \x7f'
    assert reread(Card.parse(mapping)).description == mapping["description"]


def test_the_ambient_pressure_of_the_card_is_the_zero_of_its_gauge_pressures() -> None:
    mapping = tomllib.loads(sample("lift").with_suffix(".toml").read_text(encoding="utf-8"))
    mapping["known"]["ambient_pressure"] = {"value": 800, "unit": "hPa"}
    assert Card.parse(mapping).known["supply_pressure"].value == 700000 + 80000


def test_a_known_quantity_with_a_std_is_uncertain() -> None:
    mapping = tomllib.loads(sample("lift").with_suffix(".toml").read_text(encoding="utf-8"))
    mapping["known"]["gas_temperature"]["std"] = 2
    parsed = Card.parse(mapping)
    assert "gas_temperature" not in parsed.known
    assert parsed.uncertain["gas_temperature"].value == 293.15
    assert parsed.uncertain["gas_temperature"].std == 2.0
    assert reread(parsed) == parsed


def test_updated_replaces_moves_and_adds() -> None:
    lift = card("lift")
    changed = lift.updated(
        values={
            "valve_area": (1.3e-6, 1e-8),
            "end_factor": (1.25, None),
            "supply_pressure": (790000.0, 500.0),
        },
        effects={
            "load_friction": {"force": (16.2, 0.4)},
            "thread_friction": {"static_coefficient": (0.02, 1e-3)},
        },
    )
    assert changed.uncertain["valve_area"].unit == "mm^2"
    assert (changed.uncertain["valve_area"].value, changed.uncertain["valve_area"].std) == (1.3e-6, 1e-8)
    assert changed.known["end_factor"].value == 1.25
    assert "end_factor" not in changed.uncertain
    assert "supply_pressure" not in changed.known
    assert changed.effects["load_friction"]["force"].value == 16.2
    friction = changed.effects["thread_friction"]
    assert friction["static_coefficient"].value == 0.02
    assert friction["kinetic_coefficient"] == lift.effects["thread_friction"]["kinetic_coefficient"]
    assert reread(changed) == changed
    assert lift == card("lift")


COMMENTED = """\
# Lifter on the second bench, muscle no. 7.
rig = "isotonic"     # flow valve

[columns]
time = { column = "t_s", unit = "s" }
position = { column = "x_mm", unit = "mm" }   # laser, 10 um
pressure = { column = "p_bar", unit = "bar", reference = "gauge" }
command = { column = "valve_V", unit = "V" }

# From the catalogue.
[known]
mass = {value=8.0, unit="kg"}   # on the scales
supply_pressure = { value = 7, unit = "bar", reference = "gauge" }
full_command = { value = 5, unit = "V" }
braid_angle = { value = 22, unit = "deg" }
initial_length = { value = 0.30, unit = "m", std = 1e-3 }   # tape
initial_radius.value = 7
initial_radius.unit = "mm"

[uncertain]  # to be found
# the valve's sheet says 0.9
valve_area = { unit = "mm^2", value = 1.16709, std = 0.2 }  # of the opening
valve_time_constant = { value = 7.27888, std = 1, unit = "ms" }
end_factor = { value = 1.31563, std = 0.05 }  # by eye

[fit]
horizon = { value = 1000, unit = "ms" }
"""


def test_a_card_read_and_written_is_the_text_that_was_read() -> None:
    assert Card.from_toml(COMMENTED).to_toml() == COMMENTED
    for name in NAMES:
        assert card(name).to_toml() == sample(name).with_suffix(".toml").read_text(encoding="utf-8")


def test_comments_and_layout_stay_and_values_are_replaced_in_their_units() -> None:
    changed = Card.from_toml(COMMENTED).updated(
        values={
            "valve_area": (1.3e-6, 1e-8),
            "end_factor": (1.25, None),
            "initial_length": (0.302, 2e-4),
            "initial_radius": (7.25e-3, 1e-5),
            "mass": (8.25, None),
            "gas_temperature": (300.0, None),
        },
        effects={"load_friction": {"force": (16.2, 0.4)}},
    )
    replaced = {
        'rig = "isotonic"     # flow valve\n': 'rig = "isotonic"     # flow valve\n'
        'description = "Fitted beside it, not part of this card: offset.pressure = 300 Pa."\n',
        "value=8.0": "value=8.25",
        "value = 0.30, ": "value = 0.302, ",
        "std = 1e-3": "std = 0.0002",
        "initial_radius.value = 7\n": "initial_radius.value = 7.25\ninitial_radius.std = 0.01\n",
        'initial_radius.unit = "mm"\n': 'initial_radius.unit = "mm"\n'
        "end_factor = { value = 1.25  }  # by eye\n"
        'gas_temperature = { value = 300, unit = "K" }\n',
        "end_factor = { value = 1.31563, std = 0.05 }  # by eye\n": "",
        "value = 1.16709, std = 0.2": "value = 1.3, std = 0.01",
    }
    expected = COMMENTED + '\n[effects.load_friction]\nforce = { value = 16.2, std = 0.4, unit = "N" }\n'
    for old, new in replaced.items():
        assert expected.count(old) == 1
        expected = expected.replace(old, new)
    assert changed.telling(["offset.pressure = 300 Pa"]).to_toml() == expected
    assert reread(changed) == changed


def test_sections_that_go_and_come_are_gone_and_there() -> None:
    lift = card("lift")
    without = dataclasses.replace(lift, effects={}, horizon=None)
    assert reread(without) == without and without != lift
    for card_ in (lift, without):
        past = dataclasses.replace(card_, state_from="past")
        assert reread(past) == past and past != card_
    empty = dataclasses.replace(lift, effects={**lift.effects, "creep": {}})
    assert reread(empty) == empty and "creep" in reread(empty).effects


def test_updated_adds_quantities_that_the_card_left_to_their_defaults() -> None:
    changed = card("bench").updated(values={"ambient_pressure": (99000.0, 200.0)})
    assert changed.uncertain["ambient_pressure"].unit == "Pa"
    assert reread(changed) == changed


@pytest.mark.parametrize("estimate", [(np.nan, 1.0), (1.3, 0.0), (1.3, -1.0), (1.3, np.inf)])
def test_updated_refuses_what_could_not_be_read_back(estimate: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="end_factor"):
        card("lift").updated(values={"end_factor": estimate})


def test_updated_refuses_unknown_names() -> None:
    with pytest.raises(ValueError, match="did you mean 'end_factor'"):
        card("lift").updated(values={"endfactor": (1.3, 0.1)})


@pytest.mark.parametrize("name", NAMES)
def test_every_quantity_of_a_card_arrives_in_the_machine(name: str) -> None:
    given = card(name)
    actuator = actuator_from_card(given)
    for quantity, entry in given.quantities.items():
        assert float(get(actuator, actuator.quantities[quantity])) == entry.value
    for effect, values in given.effects.items():
        for parameter, entry in values.items():
            assert float(get(actuator, f"effects.{effect}.{parameter}")) == entry.value


def test_what_a_card_leaves_out_has_the_default_of_the_rig() -> None:
    mapping = tomllib.loads(sample("lift").with_suffix(".toml").read_text(encoding="utf-8"))
    for name in ("ambient_pressure", "gas_temperature", "polytropic_exponent"):
        del mapping["known"][name]
    actuator = actuator_from_card(Card.parse(mapping))
    assert isinstance(actuator, Isotonic)
    assert float(actuator.gas_temperature) == 293.15
    assert float(actuator.valve.supply_pressure) == 700000 + STANDARD_ATMOSPHERE


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_rigs_and_cards_agree_on_units_and_on_the_atmosphere(rig: schema.Rig) -> None:
    needs = schema.quantities(rig)
    values = {rig.quantities[name]: 1.0 for name, need in needs.items() if need.required}
    actuator = schema.build(rig, values, {})
    for name, need in needs.items():
        assert parameters(actuator)[rig.quantities[name]].unit == need.unit
    assert float(get(actuator, rig.quantities[schema.AMBIENT])) == STANDARD_ATMOSPHERE


def test_units_of_effects_follow_the_rig() -> None:
    assert schema.effect_parameters(LoadDamping, Isotonic)["coefficient"].unit == "N s/m"
    assert schema.effect_parameters(LoadDamping, Joint)["coefficient"].unit == "N m s/rad"
