"""A user's own rig with torque, flow and temperature: read, simulated, fitted, diagnosed, swept and drawn."""

import tomllib

import equinox as eqx
import numpy as np
import pytest
from actuators.fan import DAMPING, NOISE, STEP, TRUE, Fan, fan, measured, written

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS, register
from jaxmuscle.analysis import equilibrium
from jaxmuscle.effects import CommandDelay, LoadDamping
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.fittable_parameters import fittable, start_places
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.schema import build
from jaxmuscle.report.report_files import write


@pytest.fixture(scope="module", autouse=True)
def _registered():
    register(Fan)
    yield
    del RIGS[Fan.rig]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """The fan's recording, from a table and a card."""
    return jm.read(written(tmp_path_factory.mktemp("fan"), measured()))


def test_is_read_in_si(recording):
    columns = measured()
    for name in NOISE:
        np.testing.assert_allclose(recording.columns[name], columns[name], rtol=1e-9, err_msg=name)
        assert recording.card.noise[name] == pytest.approx(NOISE[name], rel=1e-12)
    assert all(spec.reference is None for spec in recording.card.columns.values())
    again = Card.parse(tomllib.loads(recording.card.to_toml()))
    assert again == recording.card


def test_wrong_units_of_own_columns_are_told(tmp_path):
    file = written(tmp_path, measured())
    card = file.with_suffix(".toml")
    text = card.read_text(encoding="utf-8")
    wrong = text.replace('"c_torque", unit = "N mm"', '"c_torque", unit = "N"')
    wrong = wrong.replace('"c_flow", unit = "g/s"', '"c_flow", unit = "L/min"')
    wrong = wrong.replace(
        '"c_pressure_rise", unit = "mbar"', '"c_pressure_rise", unit = "mbar", reference = "gauge"'
    )
    card.write_text(wrong, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        jm.read(file)
    for words in (
        "a torque",
        "a force",
        "a mass flow",
        "a volume flow",
        "takes no reference, it is a difference",
    ):
        assert words in str(caught.value)


def test_a_parameter_that_no_card_can_give_is_named(recording, monkeypatch):
    quantities = {name: path for name, path in Fan.quantities.items() if path != "inertia"}
    monkeypatch.setattr(Fan, "quantities", quantities)
    entries = {name: each for name, each in recording.card.entries.items() if name in quantities}
    values = {quantities[name]: each.value for name, each in entries.items()}
    with pytest.raises(InputError, match="Fan: expected a value of inertia.*{'inertia': 'inertia'}"):
        build(Fan, values, {})


def test_rests_where_it_is_declared_to(recording):
    """Not at ambient pressure for a name with "pressure" in it, nor at 0 K."""
    still = jm.simulate(fan(heater_power=1e-9), np.zeros(5), STEP * np.arange(5)).readings
    np.testing.assert_allclose(still["temperature"], 293.15)
    np.testing.assert_array_equal(still["pressure_rise"], 0.0)
    point = equilibrium(fan(), 4.0)
    assert bool(point.converged)
    speed, warm = float(point.readings[0]), float(point.readings[-1])
    assert speed == pytest.approx((0.01 * 4 / 8e-7) ** 0.5, rel=1e-9)
    assert warm == pytest.approx(150 / (1005 * 5e-5 * speed), rel=1e-9)


def test_is_simulated_as_measured(recording):
    """Against Euler steps a hundred times finer, within the noise of the sensors."""
    found = jm.simulate(fan(), recording).readings
    for output, (column,) in Fan.outputs.items():
        off = np.asarray(found[output]) - recording.columns[column]
        assert np.sqrt(np.mean(off**2)) < 1.5 * NOISE[column], column


@pytest.mark.slow
def test_is_fitted_and_told_in_units(recording, tmp_path):
    fit = jm.fit(jm.actuator(recording.card), recording)
    for name in ("inertia", "drag", "heater_power", "heater_capacity"):
        entry = fit.parameters[name]
        assert abs(entry.value - TRUE[name]) < 4 * entry.std < 0.2 * TRUE[name], name
    units = {column: noise.unit for column, noise in fit.noise["fan"].items()}
    assert units == {name: Fan.columns[name].unit for name in NOISE}
    labels = [axes.get_ylabel() for axes in fit.plot().axes]
    for told in ("outlet [K]", "torque [N·m]", "flow [g/s]", "intake [l/min]", "speed [rad/s]"):
        assert any(label.startswith(told) for label in labels), (told, labels)
    assert eqx.tree_equal(jm.FitResult.load(fit.save(tmp_path / "fit.json")).actuator, fit.actuator)
    named = {**start_places(fan(), recording), **fittable(fan(), {})}
    found = {name: named[name].unit for name in ("start.temperature", "start.speed", "offset.torque")}
    assert found == {"start.temperature": "K", "start.speed": "rad/s", "offset.torque": "N m"}


@pytest.mark.slow
def test_is_diagnosed_and_reported(tmp_path):
    """The bearing of the measured fan is damped; the declared one is not."""
    recording = jm.read(written(tmp_path, measured(900, damping=DAMPING)))
    found = jm.diagnose(recording, catalogue=(LoadDamping, CommandDelay))
    assert [effect.name for effect in found.effects] == ["load_damping"]
    strength = found.effects[0].parameters["coefficient"]
    assert strength.unit == "N m s/rad"
    assert abs(strength.value - DAMPING) < 4 * strength.std
    assert {name: found.units[name] for name in NOISE} == {name: Fan.columns[name].unit for name in NOISE}
    write(found, tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    for unit in ("°C", "rpm", "N·mm", "g/s", "L/min", "mbar"):
        assert unit in page


def test_is_swept():
    over = {"drag": [8e-7, 9e-7], "start.temperature": [293.15, 300.0]}
    swept = jm.sweep(
        fan(), over, command=jm.commands.Step(), start={"temperature": 293.15}, reductions=["final", "span"]
    )
    assert swept["torque_final"].attrs["units"] == "N m"
    assert swept["start.temperature"].attrs["units"] == "K"
    assert not any("reference" in variable.attrs for variable in swept.data_vars.values())
