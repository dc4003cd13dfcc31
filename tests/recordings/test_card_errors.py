"""Spoilt cards: the message says what was expected, what came and what to do."""

import tomllib

import pytest

from jaxmuscle.errors import InputError
from jaxmuscle.recordings import Card, read

SPOILT = {
    "unknown section": ("[noise]", "[noice]", ["unknown 'noice'", "'noise'"]),
    "unknown key before the sections": ("description =", "descripton =", ["'descripton'", "'description'"]),
    "description that is no text": ('description = "A', 'description = 3 # "A', ["description", "text", "3"]),
    "unknown rig": ('"isotonic"', '"isotonik"', ["unknown rig 'isotonik'", "'isotonic'"]),
    "no rig": ('rig = "isotonic"', "", ["rig", "isotonic, driven", "none is given"]),
    "rig that is no text": ('"isotonic"', "3", ["rig", "got 3"]),
    "unknown key of an entry": ("std = 1, unit", "sdt = 1, unit", ["valve_time_constant", "'sdt'", "'std'"]),
    "unknown quantity": (
        "mass = {",
        "mas = {",
        ["[known]: unknown 'mas'", "'mass'", "1 missing", 'mass = { value = …, unit = "kg" }'],
    ),
    "entry without a table": (
        '{ value = 8, unit = "kg" }',
        "8",
        ["mass", '{ value = …, unit = "kg" }', "got 8"],
    ),
    "no value": ("{ value = 8,", "{", ["mass", "number as value", "none is given"]),
    "value as text": ("value = 8,", 'value = "8",', ["mass", "finite number", "'8'"]),
    "value not finite": ("value = 8,", "value = nan,", ["mass", "finite number", "nan"]),
    "value beyond floats": ("value = 8,", f"value = 1{'0' * 400},", ["mass", "finite number"]),
    "value true": ("value = 8,", "value = true,", ["mass", "finite number", "True"]),
    "value negative": ("value = 8,", "value = -8,", ["mass", "above zero", "-8"]),
    "no unit": ('value = 8, unit = "kg"', "value = 8", ["mass", 'unit = "kg"', "none is given"]),
    "unit as number": ('unit = "kg"', "unit = 3", ["mass", 'unit = "kg"', "got unit = 3"]),
    "no such unit": ('unit = "kg"', 'unit = "kilo"', ["mass", "no unit 'kilo'"]),
    "wrong dimension": ('unit = "kg"', 'unit = "N"', ["mass", "a mass", '"kg"', "'N'", "a force"]),
    "degrees as radians": ('unit = "deg"', 'unit = "rad"', ["braid_angle", "full turn", '"deg"']),
    "uncertain without std": ("std = 0.2, ", "", ["[uncertain] valve_area", "std", "[known]"]),
    "std of zero": ("std = 0.2,", "std = 0,", ["valve_area", "standard deviation", "above zero", "std = 0"]),
    "std as text": ("std = 0.2,", 'std = "0.2",', ["valve_area", "std", "'0.2'"]),
    "twice": (
        "[uncertain]",
        '[uncertain]\nmass = { value = 8, std = 1, unit = "kg" }',
        ["mass", "[known]", "[uncertain]", "remove one"],
    ),
    "pressure without reference": (
        'value = 7, unit = "bar", reference = "gauge"',
        'value = 7, unit = "bar"',
        ["supply_pressure", 'reference = "gauge"', 'reference = "absolute"', "none is given"],
    ),
    "reference misspelt": (
        'value = 7, unit = "bar", reference = "gauge"',
        'value = 7, unit = "bar", reference = "guage"',
        ["supply_pressure", "'guage'"],
    ),
    "supply below ambient": (
        'value = 7, unit = "bar", reference = "gauge"',
        'value = 0.9, unit = "bar", reference = "absolute"',
        ["supply_pressure", "ambient", '"gauge"'],
    ),
    "reference of a mass": ('unit = "kg"', 'unit = "kg", reference = "gauge"', ["mass", "only pressures"]),
    "reference of the atmosphere": (
        'value = 101.325, unit = "kPa"',
        'value = 101.325, unit = "kPa", reference = "gauge"',
        ["ambient_pressure", "always absolute", "remove"],
    ),
    "column without a table": (
        '{ column = "x_mm", unit = "mm" }',
        '"x_mm"',
        ["[columns] position", '{ column = "…", unit = "mm" }', "'x_mm'"],
    ),
    "column without a name": (
        'column = "x_mm", ',
        "",
        ["[columns] position", "name of a column", "none is given"],
    ),
    "column taken twice": ('"x_mm"', '"p_bar"', ["[columns] position", "'p_bar'", "already", "pressure"]),
    "column with a wrong unit": (
        'column = "x_mm", unit = "mm"',
        'column = "x_mm", unit = "bar"',
        ["[columns] position", "a length", "a pressure"],
    ),
    "column of pressure without reference": (
        'column = "p_bar", unit = "bar", reference = "gauge"',
        'column = "p_bar", unit = "bar"',
        ["[columns] pressure", "gauge", "absolute"],
    ),
    "column misspelt": ("position = { col", "postion = { col", ["'postion'", "'position'", "1 missing"]),
    "noise of no column": ("position = { value", "angle = { value", ["[noise]", "unknown 'angle'"]),
    "noise of the command": ("position = { value", "command = { value", ["[noise]", "unknown 'command'"]),
    "noise of zero": ("value = 0.03,", "value = 0,", ["[noise] position", "above zero"]),
    "noise with a reference": (
        'value = 0.4, unit = "kPa"',
        'value = 0.4, unit = "kPa", reference = "gauge"',
        ["[noise] pressure", "unknown key 'reference'"],
    ),
    "noise in a wrong unit": (
        'value = 0.03, unit = "mm"',
        'value = 0.03, unit = "V"',
        ["[noise] position", "a length"],
    ),
    "horizon negative": (
        "horizon = { value = 1,",
        "horizon = { value = -1,",
        ["[fit] horizon", "above zero", "-1"],
    ),
    "horizon without unit": ('{ value = 1, unit = "s" }', "{ value = 1 }", ["[fit] horizon", "unit", '"ms"']),
    "state from something else": (
        "[fit]\n",
        '[fit]\nstate_from = "history"\n',
        ["[fit]: state_from", '"past"', '"both"', "'history'"],
    ),
    "unknown fit option": ("horizon = {", "horizont = {", ["[fit]", "'horizont'", "'horizon'"]),
    "unknown effect": (
        "[effects.thread_friction]",
        "[effects.thread_fricton]",
        ["[effects.thread_fricton]", "unknown effect", "'thread_friction'"],
    ),
    "effect that the rig cannot have": (
        "[effects.thread_friction]",
        "[effects.gravity]\n[effects.thread_friction]",
        ["[effects.gravity]", "'isotonic'", "angle"],
    ),
    "unknown parameter of an effect": (
        "static_coefficient",
        "static_coeficient",
        ["[effects.thread_friction]", "'static_coeficient'", "'static_coefficient'"],
    ),
    "effect parameter in a wrong unit": (
        'value = 0.100704, std = 0.04, unit = "m/s"',
        'value = 0.100704, std = 0.04, unit = "m"',
        ["[effects.thread_friction] velocity_constant", "a velocity", "a length"],
    ),
    "effect parameter not positive": ("value = 0.100704,", "value = 0,", ["velocity_constant", "above zero"]),
}


@pytest.mark.parametrize(("old", "new", "words"), SPOILT.values(), ids=SPOILT)
def test_spoilt_card(lift, old: str, new: str, words: list[str]) -> None:
    lift.write(old, new)
    complaint = lift.complaint()
    for word in ["lift.toml", *words]:
        assert word in complaint


def test_all_problems_are_told_at_once(lift) -> None:
    lift.write("mass = {", "mas = {")
    lift.write('unit = "deg"', 'unit = "dge"')
    lift.write("[noise]", "[noice]")
    complaint = lift.complaint()
    for word in ["4 problems", "'mas'", "mass = {", "'dge'", "'deg'", "'noice'"]:
        assert word in complaint


def test_all_missing_quantities_are_told_with_lines_to_copy(lift) -> None:
    text = lift.card.read_text(encoding="utf-8")
    kept = [line for line in text.splitlines() if not line.startswith(("mass", "supply", "valve_area"))]
    lift.card.write_text("\n".join(kept), encoding="utf-8")
    complaint = lift.complaint()
    assert "3 missing" in complaint
    for line in [
        'mass = { value = …, unit = "kg" }',
        'supply_pressure = { value = …, unit = "bar", reference = "gauge" }',
        'valve_area = { value = …, unit = "mm^2" }',
    ]:
        assert line in complaint


def test_no_columns_at_all(swing) -> None:
    mapping = tomllib.loads(swing.card.read_text(encoding="utf-8"))
    del mapping["columns"]
    with pytest.raises(InputError, match="6 missing") as caught:
        Card.parse(mapping)
    assert 'command_2 = { column = "…", unit = "bar", reference = "gauge" }' in str(caught.value)


@pytest.mark.parametrize("section", ["columns", "known", "uncertain", "effects", "noise", "fit"])
def test_a_section_that_is_none(lift, section: str) -> None:
    mapping = tomllib.loads(lift.card.read_text(encoding="utf-8"))
    mapping[section] = 3
    with pytest.raises(InputError, match=rf"expected a section \[{section}\]; got 3"):
        Card.parse(mapping)


def test_an_effect_that_is_no_section(lift) -> None:
    mapping = tomllib.loads(lift.card.read_text(encoding="utf-8"))
    mapping["effects"]["creep"] = True
    with pytest.raises(InputError, match=r"\[effects.creep\]: expected a section .* got True"):
        Card.parse(mapping)


def test_broken_toml_names_the_line(lift) -> None:
    lift.write("[known]", "[known")
    complaint = lift.complaint()
    assert "lift.toml" in complaint
    assert "line 10" in complaint


def test_card_in_another_encoding(lift) -> None:
    lift.card.write_bytes(lift.card.read_text(encoding="utf-8").replace("A flow", "Größe").encode("latin-1"))
    assert "UTF-8" in lift.complaint()


def test_missing_card(lift) -> None:
    lift.card.rename(lift.card.with_name("lift_card.toml"))
    complaint = lift.complaint()
    for word in ["lift.csv", "no card", "'lift.toml'", "'lift_card.toml'", "--card"]:
        assert word in complaint


def test_missing_named_card(lift) -> None:
    with pytest.raises(InputError, match="no card 'lfit.toml'.*did you mean 'lift.toml'"):
        read(lift.table, lift.card.with_name("lfit.toml"))


def test_a_card_that_is_a_folder(lift) -> None:
    with pytest.raises(InputError, match="is a folder; expected a card"):
        read(lift.table, lift.card.parent)


def test_a_card_in_no_folder(lift) -> None:
    with pytest.raises(InputError, match="there is no folder"):
        Card.read(lift.card.parent / "none" / "lift.toml")


def test_a_card_given_as_such_is_not_looked_for(lift, tmp_path) -> None:
    card = Card.read(lift.card)
    lift.card.unlink()
    assert read(lift.table, card).card is card
