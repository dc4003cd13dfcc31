"""Numbers as people write them.

Names of the code in plain words.
"""

import math

import pytest

from jaxmuscle import formatting
from jaxmuscle.formatting import listed, meaning


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (16.213, 0.38, "16.2 ± 0.4"),
        (16.213, 0.12, "16.21 ± 0.12"),
        (16.213, 0.096, "16.21 ± 0.10"),
        (0.0893, 0.0011, "0.0893 ± 0.0011"),
        (-2.345, 0.03, "-2.35 ± 0.03"),
        (1234.5, 30.0, "1230 ± 30"),
        (1234.5, 260.0, "1200 ± 300"),
        (0.001, 5.0, "0 ± 5"),
        (1.6e-7, 2e-9, "(1.60 ± 0.02)·10⁻⁷"),
        (1.29, math.nan, "1.290"),
        (1.29, 0.0, "1.290"),
        (1.29, math.inf, "1.290"),
    ],
)
def test_value_and_deviation_end_at_the_same_digit(value: float, std: float, text: str) -> None:
    assert formatting.uncertain(value, std) == text


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (1.1712e-6, 3.1e-9, "m^2", "1.171 ± 0.003 mm²"),
        (0.0246, 0.0003, "s", "24.6 ± 0.3 ms"),
        (2.4, 0.1, "s", "2.40 ± 0.10 s"),
        (37857.0, 900.0, "Pa", "37.9 ± 0.9 kPa"),
        (2.5e5, 1e3, "Pa", "2.500 ± 0.010 bar"),
        (math.radians(22), math.radians(0.3), "rad", "(22.0 ± 0.3)°"),
        (16.21, 0.38, "N", "16.2 ± 0.4 N"),
        (0.4, 0.02, "N m s/rad", "0.40 ± 0.02 N·m·s/rad"),
        (0.11, 0.003, "kg m^2", "0.110 ± 0.003 kg·m²"),
        (0.0, 0.003, "m", "0 ± 3 mm"),
    ],
)
def test_estimate_has_a_unit_of_the_right_size(value: float, std: float, unit: str, text: str) -> None:
    assert formatting.estimate(value, std, unit) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (3.0649, "3.1"),
        (0.0589, "0.059"),
        (104.2, "104"),
        (9.96, "10"),
        (0, "0"),
        (2.5e7, "2.5·10⁷"),
        (-0.0021, "-0.0021"),
    ],
)
def test_two_digits_are_enough_for_an_error(value: float, text: str) -> None:
    assert formatting.rounded(value) == text


@pytest.mark.parametrize(
    ("unit", "text"),
    [("mm^2", "mm²"), ("deg", "°"), ("degC", "°C"), ("m/s^2", "m/s²"), ("um", "µm"), ("", "")],
)
def test_unit_is_printed_as_in_a_paper(unit: str, text: str) -> None:
    assert formatting.pretty(unit) == text


@pytest.mark.parametrize(
    ("p", "text"),
    [
        (0.4, "p = 0.4"),
        (0.0031, "p = 0.0031"),
        (3e-7, "p < 10⁻⁶"),
        (0.0, "p < 10⁻³⁰⁰"),
        (math.nan, "p unknown"),
    ],
)
def test_probability(p: float, text: str) -> None:
    assert formatting.probability(p) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.93, "93"), (-0.1, "-10"), (0.9966, "99.7"), (0.99996, "99.99"), (1.0, "100"), (0.0, "0")],
)
def test_percent_reaches_a_hundred_only_for_all_of_it(share: float, text: str) -> None:
    assert formatting.percent(share) == text + "\N{NO-BREAK SPACE}%"


def test_columns_of_a_table_are_aligned() -> None:
    text = formatting.aligned(("name", "value"), [("mass", "8 kg"), ("end_factor", "1.3")])
    assert text.split("\n") == ["name        value", "mass        8 kg", "end_factor  1.3"]
    assert formatting.aligned(("name", "value"), []) == "name  value"


@pytest.mark.parametrize(
    ("docstring", "text"),
    [
        (r"Viscous damping: :math:`ΔF = -d\,v`; v in m/s." + "\n\nMore.", "Viscous damping."),
        ("The command acts `delay` seconds late.", "The command acts delay seconds late."),
        ("\n    Begins on the second line.\n    Goes on.", "Begins on the second line."),
        (None, ""),
    ],
)
def test_meaning_is_the_first_line_without_markup(docstring: str | None, text: str) -> None:
    assert meaning(docstring) == text


@pytest.mark.parametrize(
    ("items", "text"),
    [
        (["a"], "a"),
        (["a", "b"], "a and b"),
        (["a", "b", "c", "d"], "a, b, c and d"),
        (["a", "b", "c", "d", "e"], "a, b, c and 2 others"),
    ],
)
def test_long_lists_are_counted(items: list[str], text: str) -> None:
    assert listed(items) == text
