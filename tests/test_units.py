"""Units against numbers worked out by hand."""

import numpy as np
import pytest

from jaxmuscle.errors import InputError
from jaxmuscle.units import from_si, scale, to_si


@pytest.mark.parametrize(
    ("value", "unit", "si", "expected"),
    [
        (7.0, "bar", "Pa", 700000.0),
        (227.11, "kPa", "Pa", 227110.0),
        (100.0, "psi", "Pa", 689475.7293168361),  # 0.45359237 kg · 9.80665 m/s² / (0.0254 m)²
        (300.0, "mm", "m", 0.3),
        (1.5, "mm^2", "m^2", 1.5e-6),
        (180.0, "deg", "rad", np.pi),
        (7.5, "ms", "s", 0.0075),
        (20.0, "degC", "K", 293.15),
        (68.0, "degF", "K", 293.15),
        (14.5, "Hz", "Hz", 14.5),
        (1.2, "kHz", "Hz", 1200.0),
        (60.0, "rpm", "rad/s", 2 * np.pi),
        (2.0, "Nm", "N m", 2.0),
        (5.0, "%", "", 0.05),
    ],
)
def test_conversion_and_its_inverse(value: float, unit: str, si: str, expected: float) -> None:
    assert to_si(value, unit, si) == pytest.approx(expected, rel=1e-14)
    assert from_si(expected, unit, si) == pytest.approx(value, rel=1e-12)


def test_differences_of_temperatures_have_no_offset() -> None:
    assert scale("degC", "K") == 1.0
    assert scale("degF", "K") == pytest.approx(5 / 9, rel=1e-14)
    assert scale("bar", "Pa") == 1e5
    np.testing.assert_allclose(to_si(np.array([5.0, -1.0]), "degC", "K", difference=True), [5.0, -1.0])
    assert to_si(9.0, "degF", "K", difference=True) == pytest.approx(5.0, rel=1e-14)


def test_arrays_stay_arrays_of_float64() -> None:
    values = to_si(np.array([1.0, 2.0]), "mm", "m")
    assert values.dtype == np.float64
    np.testing.assert_allclose(values, [0.001, 0.002], rtol=1e-15)


@pytest.mark.parametrize(
    ("unit", "si", "words"),
    [
        ("mm", "Pa", ["a pressure", '"bar"', "'mm'", "a length"]),
        ("KPa", "Pa", ["no unit 'KPa'", "did you mean 'kPa'"]),
        ("barg", "Pa", ["no unit 'barg'", 'unit = "bar", reference = "gauge"']),
        ("bar(a)", "Pa", ['unit = "bar", reference = "absolute"']),
        ("psig", "Pa", ['unit = "psi", reference = "gauge"']),
        ("rad/s", "Hz", ["a frequency", "an angular velocity"]),
        ("rpm", "Hz", ["a frequency", "an angular velocity"]),
        ("", "rad", ["an angle", '"deg"', "a plain number"]),
        ("deg", "", ["a plain number", "an angle"]),
        ("N m s", "N m s/rad", ["a damping", '"N m s/rad"']),
        ("furlong/", "m", ["no unit 'furlong/'"]),
        ("(", "m", ["no unit '('"]),
        ("m/0", "m", ["no unit 'm/0'"]),
        ("5 mm", "m", ["no unit '5 mm'"]),
        ("m^x", "m", ["no unit 'm^x'"]),
    ],
)
def test_wrong_units_are_named_with_what_to_write(unit: str, si: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        to_si(1.0, unit, si)
    for word in words:
        assert word in str(caught.value)
