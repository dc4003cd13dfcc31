"""Recordings whose sign, unit or column must be wrong, and benches at the edge that are sound."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest

import jaxmuscle as jm
from jaxmuscle.components import McKibben
from jaxmuscle.components.mckibben import isotonic_contraction, largest_contraction
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import read
from jaxmuscle.recordings.muscle_limits import BEYOND, MuscleLimits
from jaxmuscle.recordings.plausibility import check_machine

SAMPLES = ("lift", "bench", "swing")


def spoilt(desk, *changes: tuple[str, str], table=None) -> str:
    """The complaint about a recording whose card, and table, are changed."""
    for old, new in changes:
        text = desk.card.read_text(encoding="utf-8")
        assert old in text
        desk.card.write_text(text.replace(old, new), encoding="utf-8")
    if table:
        desk.change(table)
    return desk.complaint()


def test_everything_that_was_made_by_a_sound_bench_is_read(shared) -> None:
    files = [*(shared / "recordings").rglob("*.csv"), *map(jm.sample, SAMPLES)]
    assert len(files) >= 23
    assert all(len(read(file)) >= 200 for file in files)


@pytest.mark.usefixtures("sized_muscles")
def test_the_cards_of_the_benchmarks_are_read(pytestconfig) -> None:
    files = list((pytestconfig.rootpath / "benchmarks" / "cards").glob("*.toml"))
    assert files and all(jm.Card.read(file) for file in files)


@pytest.mark.parametrize("name", ["lift", "bench"])
def test_a_reversed_position(request, name: str) -> None:
    desk = request.getfixturevalue(name)
    complaint = spoilt(desk, table=lambda t: t.assign(x_mm=-t.x_mm))
    for word in [
        f"{name}.csv",
        "'x_mm' (position)",
        "mm of contraction in row",
        "cannot be",
        "opposite sign",
    ]:
        assert word in complaint
    assert "shortening being positive" in complaint


def test_a_position_from_another_zero(lift) -> None:
    complaint = spoilt(lift, table=lambda t: t.assign(x_mm=t.x_mm - 30))
    assert "-30.04 mm of contraction in row 3" in complaint and "is it of another zero" in complaint


def test_a_reversed_force(bench) -> None:
    complaint = spoilt(bench, table=lambda t: t.assign(F_N=-t.F_N))
    assert (
        "'F_N' (force)" in complaint and "tension as positive" in complaint and "opposite sign" in complaint
    )


def swap(first: str, second: str) -> tuple[tuple[str, str], ...]:
    """Changes of a card that swap two columns."""
    return (first, '"Q"'), (second, first), ('"Q"', second)


@pytest.mark.parametrize(
    ("name", "columns", "words"),
    [
        ("lift", ('"x_mm"', '"p_bar"'), ["'x_mm' (pressure)", "above the supply pressure"]),
        ("bench", ('"x_mm"', '"p_kPa"'), ["499.2 mm of contraction", "160.4 mm", "or another column?"]),
        ("bench", ('"x_mm"', '"F_N"'), ["'F_N' (position)", "1179 mm", "or another column?"]),
        ("swing", ('"theta_deg"', '"p1_bar"'), ["'theta_deg' (pressure_1)", "below vacuum"]),
    ],
)
def test_swapped_columns(request, name: str, columns, words: list[str]) -> None:
    complaint = spoilt(request.getfixturevalue(name), *swap(*columns))
    for word in words:
        assert word in complaint


UNITS = {
    "lift: position in m": ("lift", 'x_mm", unit = "mm"', 'x_mm", unit = "m"', "(position)", 'unit = "mm"'),
    "lift: position in cm": ("lift", 'x_mm", unit = "mm"', 'x_mm", unit = "cm"', "(position)", 'unit = "mm"'),
    "lift: position in um": (
        "lift",
        'x_mm", unit = "mm"',
        'x_mm", unit = "um"',
        "shortens by",
        'unit = "mm"',
    ),
    "bench: position in m": ("bench", 'x_mm", unit = "mm"', 'x_mm", unit = "m"', "(position)", 'unit = "mm"'),
    "lift: pressure in kPa": (
        "lift",
        'p_bar", unit = "bar"',
        'p_bar", unit = "kPa"',
        "pulls 9.66 N at that, and lifted 8 kg",
        'unit = "bar"',
    ),
    "lift: pressure in psi": (
        "lift",
        'p_bar", unit = "bar"',
        'p_bar", unit = "psi"',
        "lifted",
        'unit = "bar"',
    ),
    "lift: pressure in mbar": (
        "lift",
        'p_bar", unit = "bar"',
        'p_bar", unit = "mbar"',
        "lifted",
        'unit = "bar"',
    ),
    "lift: pressure in MPa": (
        "lift",
        'p_bar", unit = "bar"',
        'p_bar", unit = "MPa"',
        "supply",
        'unit = "bar"',
    ),
    "lift: supply in kPa": (
        "lift",
        'value = 7, unit = "bar"',
        'value = 7, unit = "kPa"',
        "above the supply",
        'unit = "bar" of supply_pressure',
    ),
    "lift: supply in MPa": (
        "lift",
        'value = 7, unit = "bar"',
        'value = 7, unit = "MPa"',
        "[known] supply_pressure: 7 MPa is not plausible",
        'unit = "bar"',
    ),
    "lift: mass in g": (
        "lift",
        'value = 8, unit = "kg"',
        'value = 8000, unit = "kg"',
        "lifted 8000 kg",
        'unit = "g" of mass',
    ),
    "lift: radius in m": (
        "lift",
        'value = 7, unit = "mm"',
        'value = 7, unit = "m"',
        "7 m is not",
        'unit = "mm"',
    ),
    "lift: length in m": ("lift", '300, unit = "mm"', '300, unit = "m"', "300 m is not", 'unit = "mm"'),
    "lift: length in cm": ("lift", '300, unit = "mm"', '30, unit = "mm"', "69.21 mm", 'unit = "cm"'),
    "lift: angle in rad": ("lift", '22, unit = "deg"', '22, unit = "rad"', "full turn", 'unit = "deg"'),
    "lift: angle in deg": ("lift", '22, unit = "deg"', '0.384, unit = "deg"', "2 to 54.7", 'unit = "rad"'),
    "lift: temperature in K": (
        "lift",
        '20, unit = "degC"',
        '20, unit = "K"',
        "200 to 500 K",
        'unit = "degC"',
    ),
    "lift: ambient in bar": ("lift", '101.325, unit = "kPa"', '101.325, unit = "bar"', "0.1 to 10", "kPa"),
    "lift: command in mV": ("lift", 'valve_V", unit = "V"', 'valve_V", unit = "mV"', "5000 mV", 'unit = "V"'),
    "lift: full command": (
        "lift",
        '5, unit = "V"',
        '5000, unit = "V"',
        "5000 V",
        'unit = "mV" of full_command',
    ),
    "lift: time in ms": ("lift", 't_s", unit = "s"', 't_s", unit = "ms"', "time constant", 'unit = "s"'),
    "bench: pressure in bar": ("bench", 'p_kPa", unit = "kPa"', 'p_kPa", unit = "bar"', "499.2 bar", '"kPa"'),
    "bench: force in kN": ("bench", 'F_N", unit = "N"', 'F_N", unit = "kN"', "ideal muscle", 'unit = "N"'),
    "bench: force in mN": ("bench", 'F_N", unit = "N"', 'F_N", unit = "mN"', "ideal muscle", 'unit = "N"'),
    "bench: radius in cm": (
        "bench",
        '0.1, unit = "mm"',
        '0.1, unit = "cm"',
        "ideal muscle",
        'unit = "mm" of initial_radius',
    ),
    "swing: angle in rad": ("swing", 'g", unit = "deg"', 'g", unit = "rad"', "43.13 rad", 'unit = "deg"'),
    "swing: all in kPa": ("swing", 'unit = "bar"', 'unit = "kPa"', "no pneumatic muscle", 'unit = "bar"'),
    "swing: one in kPa": ("swing", 'p1_bar", unit = "bar"', 'p1_bar", unit = "kPa"', "'cmd1_bar'", '"bar"'),
    "swing: command in kPa": ("swing", 'd2_bar", unit = "bar"', 'd2_bar", unit = "kPa"', "'p2_bar'", '"bar"'),
    "swing: contraction in %": ("swing", "{ value = 0.1, u", "{ value = 10, u", "-0.1 to 0.5", '"percent"'),
    "swing: radius in cm": (
        "swing",
        '15, unit = "mm"',
        '15, unit = "cm"',
        "43.13 deg",
        'unit = "mm" of sprocket',
    ),
}


@pytest.mark.parametrize("case", UNITS)
def test_another_unit_is_told_with_the_one_that_fits(request, case: str) -> None:
    name, old, new, *words = UNITS[case]
    complaint = spoilt(request.getfixturevalue(name), (old, new))
    for word in words:
        assert word in complaint


def test_milliseconds_as_seconds(lift) -> None:
    complaint = spoilt(lift, table=lambda t: t.assign(t_s=1e3 * t.t_s))
    assert "steps of 2 s" in complaint and 'unit = "ms"' in complaint


def in_memory(name: str, **changes) -> jm.Recording:
    """A sample as arrays, with other columns."""
    made = read(jm.sample(name))
    return jm.recording(jm.actuator(made.card), {**made.columns, **changes}, made.step, name=name)


def test_arrays_are_held_to_the_same() -> None:
    position = read(jm.sample("lift")).columns["position"]
    with pytest.raises(InputError, match="recording 'lift': column 'position' .*sample 5985 .*opposite sign"):
        in_memory("lift", position=-position)
    gaps = position.copy()
    gaps[100:130] = np.nan
    assert np.isnan(in_memory("lift", position=gaps).columns["position"]).sum() == 30


def sound(desk, *changes: tuple[str, str], table=None) -> None:
    """Read a recording that is odd, but not impossible."""
    for old, new in changes:
        desk.card.write_text(desk.card.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    if table:
        desk.change(table)
    assert len(read(desk.table)) >= 200


def test_a_sensor_that_is_off_by_a_little(lift) -> None:
    sound(lift, table=lambda t: t.assign(x_mm=t.x_mm - 5))


def test_a_mass_that_is_never_lifted(lift) -> None:
    """Little pressure under a great load: nothing contradicts that."""
    still = np.random.default_rng(0).normal(0, 0.03, 6000)
    heavy = ('value = 8, unit = "kg"', 'value = 800, unit = "kg"')
    sound(lift, heavy, table=lambda t: t.assign(x_mm=still))


def test_little_pressure_that_suffices(lift) -> None:
    """A fifteenth of the supply carries a light load."""
    light = ('value = 8, unit = "kg"', 'value = 0.5, unit = "kg"')
    sound(lift, light, table=lambda t: t.assign(p_bar=t.p_bar / 12))


def test_a_valve_that_is_opened_by_a_twentieth(lift) -> None:
    sound(lift, table=lambda t: t.assign(valve_V=t.valve_V / 20))


def test_a_stretched_muscle(bench) -> None:
    """The braid gives way to a pull until its threads are straight."""
    sound(bench, table=lambda t: t.assign(x_mm=t.x_mm - 15))


@pytest.mark.parametrize("drift", [0.0, 1.5])
def test_a_passive_muscle(bench, drift: float) -> None:
    """The force is that of rubber; what the pressure gauge shows is its own drift."""

    def passive(table: pd.DataFrame) -> pd.DataFrame:
        noise = np.random.default_rng(0).normal(0, 0.05, len(table))
        slow = drift * table.x_mm / table.x_mm.max()
        return table.assign(p_kPa=slow + noise, F_N=200 - 4 * table.x_mm)

    sound(bench, table=passive)


def test_a_regulator_that_is_not_asked(swing) -> None:
    """One muscle is vented all the time, and its gauge shows an offset."""
    noise = np.random.default_rng(0).normal(0.01, 0.002, 6000)
    sound(swing, table=lambda t: t.assign(cmd1_bar=0.0, p1_bar=noise))


def test_a_rig_of_ones_own_with_other_columns_is_left_alone() -> None:
    made = read(jm.sample("lift"))
    reversed_columns = {**made.columns, "position": -made.columns["position"]}
    check_machine("own", jm.actuators.AbstractActuator, made.card, reversed_columns, made.step)


@pytest.mark.parametrize("angle", [18.0, 30.0])
def test_limits_are_those_of_the_muscle(angle: float) -> None:
    sizes = 0.3, 0.007, math.radians(angle), 1.3
    limits, muscle = MuscleLimits(*sizes), McKibben(*sizes)  # pyright: ignore
    x, pressure = np.linspace(0, 0.05, 7), np.linspace(1e5, 6e5, 7)
    np.testing.assert_allclose(limits.force(x, pressure), muscle.force(x, pressure, 1.3), rtol=1e-12)  # pyright: ignore
    hangs = isotonic_contraction(muscle, 80.0, 4e5)  # pyright: ignore
    assert limits.carrying_contraction(80.0, 4e5) == pytest.approx(float(hangs), rel=1e-12)
    assert limits.carrying_contraction(8e4, 4e5) == limits.carrying_contraction(80.0, -1.0) == 0.0
    bare = dataclasses.replace(limits, end_factor=1.0)
    free = largest_contraction(McKibben(*sizes[:3], 1.0))  # pyright: ignore
    assert bare.largest_contraction == pytest.approx(BEYOND * float(free), rel=1e-12)
    assert math.cos(sizes[2]) * (1 + limits.largest_extension / 0.3 - 0.02) == pytest.approx(1.0, rel=1e-12)
