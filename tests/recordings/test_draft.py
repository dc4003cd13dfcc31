"""Drafted cards: what is open is marked, and once it is filled in the card reads the recording."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmuscle.actuators import RIGS
from jaxmuscle.errors import InputError, nearest_or_own
from jaxmuscle.recordings import Card, read, schema
from jaxmuscle.recordings.data_sheets import sheet_quantities
from jaxmuscle.recordings.draft import answered, draft_card
from jaxmuscle.recordings.read import table_in_file
from jaxmuscle.recordings.readers.frames import table_of_frame
from jaxmuscle.recordings.schema import OPEN, written_quantity
from jaxmuscle.recordings.survey import survey
from jaxmuscle.recordings.typical import TYPICAL, default_in_card, typical
from jaxmuscle.samples import NAMES, sample
from jaxmuscle.units import to_si

pytestmark = pytest.mark.usefixtures("package_rigs")


def draft_of(name: str, *settings: str):
    table, _ = table_in_file(sample(name))
    return draft_card(table, RIGS[Card.read(sample(name).with_suffix(".toml")).rig], settings)


def as_settings(card: Card) -> list[str]:
    """The quantities of a card as a user gives them."""
    needs, found = schema.quantities(RIGS[card.rig]), []
    for name, quantity in card.quantities.items():
        entry = written_quantity(quantity, needs[name], card.ambient_pressure)
        std = f"+-{entry['std']!r}" if "std" in entry else ""
        found.append(f"{name}={entry['value']!r}{std}:{entry['unit']}:{entry.get('reference', '')}")
    return found


@pytest.mark.parametrize("name", NAMES)
def test_filled_in_by_settings_it_is_the_card(name: str) -> None:
    whole = Card.read(sample(name).with_suffix(".toml"))
    draft = draft_of(name, *as_settings(whole))
    assert draft.open == []
    card = Card.from_toml(draft.to_toml(f"{name}.csv"))
    assert (card.rig, card.columns) == (whole.rig, whole.columns)
    assert (card.known, card.uncertain) == (whole.known, whole.uncertain)
    recording = read(sample(name), card)
    for column, values in read(sample(name)).columns.items():
        np.testing.assert_array_equal(recording.columns[column], values)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_open_is_all_that_is_wrong(name: str) -> None:
    draft = draft_of(name)
    required = [n for n, need in schema.quantities(draft.rig).items() if need.required]
    assert draft.open == required
    text = draft.to_toml(f"{name}.csv")
    assert text.count("FILL IN: ") == len(required) + 1  # And once in the words above.
    with pytest.raises(InputError, match=f"{len(required)} problems") as caught:
        Card.from_toml(text)
    assert str(caught.value).count("still to be filled in") == len(required)
    for each in required:
        line = next(line for line in text.splitlines() if line.startswith(f"{each} = "))
        assert OPEN in line and "FILL IN" in line


def test_a_card_is_written_for_every_rig() -> None:
    """Also where no column is found, everything stands in it and nothing but that is wrong."""
    table, _ = table_in_file(sample("lift"))
    for rig in RIGS.values():
        text = draft_card(table, rig).to_toml("lift.csv")
        mapping = tomllib.loads(text)
        assert {*mapping["columns"]} == {*schema.columns(rig)}
        with pytest.raises(InputError) as caught:
            Card.from_toml(text)
        faults = str(caught.value).splitlines()[1:]
        assert all("to be filled in" in fault for fault in faults), faults


def test_lines_that_are_commented_out_read_as_they_stand() -> None:
    """Taken in, the defaults change nothing."""
    whole = Card.read(sample("lift").with_suffix(".toml"))
    settings = [s for s in as_settings(whole) if not s.startswith(("ambient", "gas", "polytropic"))]
    text = draft_of("lift", *settings).to_toml("lift.csv")
    for name in ("ambient_pressure", "gas_temperature", "polytropic_exponent"):
        assert f"# {name} = {{" in text
        text = text.replace(f"# {name} = ", f"{name} = ")
    card = Card.from_toml(text)
    for name in ("ambient_pressure", "gas_temperature", "polytropic_exponent"):
        assert card.known[name].value == pytest.approx(schema.default(RIGS["isotonic"], name), rel=1e-9)


def test_settings_name_columns_too() -> None:
    draft = draft_of("lift", "pressure=x_mm:bar:absolute", "position=p_bar:mm")
    guess = draft.columns["pressure"]
    assert (guess.column, guess.unit, guess.reference, guess.sure) == ("x_mm", "bar", "absolute", True)
    kept = draft_of("swing", "angle=theta_deg").columns["angle"]
    assert (kept.unit, kept.sure) == ("deg", True)


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("mass", "expected NAME=VALUE"),
        ("mas=8", "has no 'mas'; did you mean 'mass'?"),
        ("mass=heavy", "expected a number; got 'heavy'"),
        ("mass=8:mm", "expected a mass"),
        ("mass=-8", "has to be above zero"),
        ("end_factor=1.3+-0", "a standard deviation has to be above zero"),
        ("supply_pressure=7:bar", "a pressure is gauge or absolute"),
        ("supply_pressure=7:bar:relative", 'expected reference = "gauge"'),
        ("pressure=p_bra", "column 'p_bra' is not in the table; did you mean 'p_bar'?"),
        ("pressure=p_bar:mm:gauge", "expected a pressure"),
    ],
)
def test_settings_that_cannot_be(setting: str, told: str) -> None:
    with pytest.raises(InputError, match="--set: ") as caught:
        draft_of("lift", setting)
    assert told in str(caught.value)


def test_a_column_of_texts_is_no_signal() -> None:
    data = pd.read_csv(sample("lift")).assign(remark="fine")
    with pytest.raises(InputError, match="column 'remark' holds no numbers"):
        draft_card(table_of_frame("DataFrame", data), RIGS["isotonic"], ["position=remark:mm"])


def test_all_wrong_settings_are_told() -> None:
    with pytest.raises(InputError, match="--set: 2 problems"):
        draft_of("lift", "mas=8", "braid_angle=22:kg")


def test_an_answer_fills_in_a_quantity() -> None:
    draft = answered(draft_of("lift"), "mass", "8000:g")
    assert "mass" not in draft.open and 'mass = { value = 8000, unit = "g" }' in draft.to_toml("lift.csv")


def test_what_the_table_tells_stands_beside_the_question() -> None:
    text = draft_of("lift").to_toml("lift.csv")
    assert "command that opens the valve fully, such as 5 V (sample lift); the table goes to 5 V" in text
    assert "the table goes to 5.577 bar" in text


def test_every_quantity_that_a_card_has_to_give_has_a_typical_value() -> None:
    """Of the right kind, in the range in which cards are believed; and none is of a quantity that is not."""
    known = set()
    for rig in RIGS.values():
        for name, need in schema.quantities(rig).items():
            usual = typical(name, need)
            if default_in_card(rig, name) is None:
                assert usual is not None, (rig.rig, name)
                reference = {"reference": "gauge"} if need.referenced else {}
                entry = {"value": usual.value, "unit": usual.unit, **reference}
                assert schema.read_quantity(entry, need, 101325.0).value != 0
            known.add(name)
    assert {*TYPICAL} <= known


def test_typical_values_are_those_of_the_samples() -> None:
    """Within the standard deviation where one is given, else within a tenth."""
    for name in ("lift", "swing"):
        card = Card.read(sample(name).with_suffix(".toml"))
        needs = schema.quantities(RIGS[card.rig])
        for quantity, usual in TYPICAL.items():
            if usual.source == f"sample {name}" and quantity != "supply_pressure":
                value = to_si(usual.value, usual.unit, needs[quantity].unit)
                spread = (
                    0.1 * value if usual.std is None else to_si(usual.std, usual.unit, needs[quantity].unit)
                )
                assert card.quantities[quantity].value == pytest.approx(value, abs=spread), quantity


def test_an_unknown_effect_may_be_the_users_own(lift) -> None:
    text = lift.card.read_text()
    lift.card.write_text(text.replace("thread_friction", "thred_friction"))
    told = "\n".join(survey(lift.card).faults)
    assert "did you mean 'thread_friction'? Is it your own? Then jaxmuscle.effects.register it" in told
    assert nearest_or_own("x", ["other"], "this") == "; expected one of other. Is it your own? Then this it"


def test_a_sound_card_has_no_faults(lift) -> None:
    found = survey(lift.card)
    assert found.faults == () and found.card == Card.read(lift.card)
    assert found.sampling is not None
    assert (found.sampling.samples, found.sampling.irregular) == (6000, 0)
    assert found.sampling.step == pytest.approx(0.002)
    pressure = next(each for each in found.ranges if each.quantity == "pressure")
    assert (pressure.low, pressure.high, pressure.unit, pressure.empty) == (0.2027, 5.57674, "bar", 0)


def test_all_faults_of_card_and_table_are_told_at_once(lift) -> None:
    lift.write('value = 8, unit = "kg"', 'value = -8, unit = "kg"')
    lift.write('column = "p_bar"', 'column = "p_bra"')
    lift.write("initial_length = { value = 300", "initial_length = { value = 30000000")
    found = survey(lift.card)
    told = "\n".join(found.faults)
    assert found.card is None and "2 problems" in told
    assert "'p_bra' (pressure): is not in the table; did you mean 'p_bar'?" in told


def test_checks_of_the_table_do_not_hide_one_another(lift) -> None:
    """A gap, a constant column and a horizon that is too long."""
    lift.change(lambda table: table.drop(index=range(1000, 1003)).assign(x_mm=1.0))
    lift.write("horizon = { value = 1,", "horizon = { value = 100,")
    found = survey(lift.card)
    told = "\n".join(found.faults)
    for words in ("irregular sampling", "constant, 0.001 m", "[fit] horizon"):
        assert words in told
    assert found.sampling is not None and found.sampling.irregular == 1
    assert "irregular" not in "\n".join(survey(lift.card, resample=True).faults)


def test_missing_numbers_are_counted(lift) -> None:
    lift.line(17, "0.03,5,,0.1")
    found = survey(lift.card)
    assert next(each for each in found.ranges if each.quantity == "pressure").empty == 1
    assert "row 17" in found.faults[0]


def test_a_card_without_its_table_or_with_two(lift, tmp_path: Path) -> None:
    text = lift.table.read_text()
    lift.table.rename(tmp_path / "other.csv")
    assert "expected its table lift beside it; there is none" in survey(lift.card).faults[0]
    assert survey(lift.card, tmp_path / "other.csv").faults == ()
    (tmp_path / "lift.csv").write_text(text)
    (tmp_path / "lift.txt").write_text(text)
    assert "there are several: lift.csv, lift.txt. Name it: --recording" in survey(lift.card).faults[0]


@pytest.mark.parametrize(
    "text", ["", "rig = ", "\xff", "rig = 'isotonic'\ncolumns = 3", "[columns]\ntime = 1"]
)
def test_a_card_that_is_none(lift, text: str) -> None:
    lift.card.write_bytes(text.encode("latin-1"))
    found = survey(lift.card)
    assert found.card is None and len(found.faults) == 1


def test_a_bought_part_is_named_and_its_quantities_are_not_open() -> None:
    bought = ("muscle=Festo DMSP-10", "valve=Festo MPYE-5-1/8-HF-010-B")
    draft = draft_of("lift", *bought, "braid_angle=24+-1:deg")
    sheet = sheet_quantities(draft.rig, "muscle", "Festo DMSP-10")
    assert {"initial_radius", "end_factor", "full_command", "valve_area"} == set(draft.taken)
    assert draft.open == ["valve_time_constant", "supply_pressure", "initial_length", "mass"]
    settings = (
        "valve_time_constant=2:ms",
        "supply_pressure=7:bar:gauge",
        "initial_length=300:mm",
        "mass=8:kg",
    )
    text = draft_of("lift", *bought, "braid_angle=24+-1:deg", *settings).to_toml("lift.csv")
    card = Card.from_toml(text)
    assert card.parts == {"muscle": "Festo DMSP-10", "valve": "Festo MPYE-5-1/8-HF-010-B"}
    assert card.quantities["end_factor"] == sheet["end_factor"]
    assert card.uncertain["braid_angle"].value == pytest.approx(np.radians(24))
    assert '# end_factor = { value = 1.49, std = 0.5, unit = "" }' in text
    assert read(sample("lift"), card).card == card


def test_a_draft_says_how_to_name_a_bought_part_where_the_rig_has_one() -> None:
    lift, swing = draft_of("lift").to_toml("lift.csv"), draft_of("swing").to_toml("swing.csv")
    assert "# [muscle]" in lift and "# [valve]" in lift
    assert "# [muscle]" in swing and "# [valve]" not in swing


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("muscle=Festo DMSP-21", "did you mean 'Festo DMSP-20'"),
        ("muscl=Festo DMSP-20", "did you mean 'muscle'"),
    ],
)
def test_a_part_that_is_not_known(setting: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        draft_of("lift", setting)
