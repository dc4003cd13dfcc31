"""What a rig declares: the class variables that follow, and what is told when a class is made."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import TRUE, fan
from estimation.own_rig import Drive, drive
from oracles import bench

from jaxmuscle.actuators import RIGS, AbstractActuator, Command, Isotonic, Link, Reading, StateVariable
from jaxmuscle.actuators.variables import rate_unit
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace
from jaxmuscle.recordings import schema
from jaxmuscle.simulation.track import commanded_track
from jaxmuscle.units import to_si

WRONG: Any = "angle"
"""Neither a tuple of columns nor a check."""
ANGLE = StateVariable("angle", "rad", ("angle",), rate="angular_velocity")


def declared(*variables, **more):
    """A class with these variables and a field for the pressure of the atmosphere."""
    names = {"ambient_pressure": eqx.AbstractVar[float], **dict.fromkeys(more, ClassVar)}
    return type("Own", (AbstractActuator,), {"variables": variables, "__annotations__": names, **more})


def test_class_variables_follow():
    rig = declared(
        Command("command_1", "Pa"),
        Command("command_2", "Pa"),
        StateVariable("tank", "Pa", ("tank_1", "tank_2"), rest="ambient_pressure", imposed=True),
        ANGLE,
        StateVariable("wound", ""),
        Reading("angle", given=("tank",), signal="load"),
        Reading("torque", "N m", ("torque",), given=("angle", "angular_velocity")),
        units={"load": "N m", "motion": "rad"},
    )
    assert rig.units == {"command": "Pa", "load": "N m", "motion": "rad"}
    assert rig.commands == ("command_1", "command_2")
    assert rig.measured == {"tank": ("tank_1", "tank_2"), "angle": ("angle",)}
    assert rig.derivatives == {"angular_velocity": "angle"}
    assert rig.imposed == ("tank",)
    assert rig.outputs == {"angle": ("angle",), "torque": ("torque",)}
    assert rig.links == (
        Link("angle", ("tank",), "load"),
        Link("torque", ("angle", "angular_velocity"), "torque"),
    )
    assert {name: state.unit for name, state in rig.states.items()} == {
        "tank": "Pa",
        "angle": "rad",
        "wound": "",
        "angular_velocity": "rad/s",
    }
    needs = schema.columns(rig)
    assert list(needs) == ["time", "command_1", "command_2", "tank_1", "tank_2", "angle", "torque"]
    assert [name for name, need in needs.items() if need.referenced] == list(needs)[1:5]


def test_what_is_imposed_takes_its_rate_along():
    rig = declared(
        StateVariable("length", "m", ("length",), rate="velocity", imposed=True),
        StateVariable("tank", "Pa", ("tank",), imposed=True),
        Reading("force", "N", ("force",), given=("length", "velocity", "tank")),
    )
    assert rig.imposed == ("length", "tank", "velocity") and rig.commands == () and rig.units == {}


@pytest.mark.parametrize(
    ("variables", "told"),
    [
        (("command",), "variables: expected each a Command, StateVariable or Reading; got 'command'"),
        ((ANGLE, ANGLE), "two variables of kind StateVariable are named 'angle'"),
        ((Command("a command", "V"),), "letters, digits and underscores; got 'a command'"),
        ((Command("command", "mV"),), "column 'command': expected an SI unit without prefix.*got 'mV'"),
        ((StateVariable("torque", "Nm", ("torque",)),), "expected an SI unit .*'N m'.*got 'Nm'"),
        ((StateVariable("angle", "rad", WRONG),), "a tuple of names, such as .*got 'angle'"),
        ((StateVariable("angle", "rad", rate="speed"),), "differentiated to 'speed'; expected the columns"),
        ((StateVariable("angle", "rad", imposed=True),), "is imposed; expected the columns"),
        ((StateVariable("angle", "rad", rest=1.0),), "hidden: the method rest says where it begins"),
        ((StateVariable("tank", "Pa", ("p",), rest="ambient"),), "rests at 'ambient': expected a number or"),
        ((ANGLE, StateVariable("angular_velocity", "rad/s")), "declared as a rate and as a state"),
        ((Reading("force", "N"),), "reading 'force': no measured state has that name"),
        (
            (ANGLE, Reading("angle", "m")),
            "angle in 'm', but the state of that name is .* angle in 'rad'",
        ),
        ((ANGLE, Reading("angle", given=("speed",))), "is given 'speed'; expected .*of angular_velocity"),
        ((ANGLE, Reading("turn", "m", ("angle",))), "column 'angle' is declared twice"),
        ((Command("time", "s"),), "column 'time': expected letters, digits and underscores, and not time"),
        ((StateVariable("x", "m", ("x",), check=WRONG),), "expected check of valve command.*got 'angle'"),
        ((StateVariable("x", "rad", ("x",), check="lift"),), "check 'lift' is for a column in m"),
        ((StateVariable("x", "m", ("x", "y"), check="lift"),), "is for one column; x has it"),
        (
            (StateVariable("x", "m", ("x",), imposed=True), Reading("x")),
            "reading 'x': the bench imposes that state",
        ),
    ],
)
def test_contradictions_are_told_when_the_class_is_made(variables, told):
    with pytest.raises(InputError, match=f"Own: .*{told}|{told}"):
        declared(*variables)


def test_both_forms_in_one_class_are_told():
    with pytest.raises(InputError, match="Lifted: outputs follow from variables; change these"):

        class Lifted(Isotonic):
            outputs: ClassVar = {"position": ("position",)}


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_every_state_of_a_rig_is_declared(rig):
    model = bench.model(rig.rig)
    track = commanded_track(model, jnp.zeros((2, len(rig.commands))), jnp.asarray(1e-3), {})
    assert set(model.rest(track.at(jnp.asarray(0)))) == set(rig.states)
    for column in rig.columns.values():
        assert to_si(1.0, column.unit, column.unit) == 1.0


def test_a_run_begins_where_the_rig_says_not_where_a_name_says():
    blown = fan()
    assert float(blown.at_rest("temperature")) == TRUE["room_temperature"]
    assert float(blown.at_rest("speed")) == 0.0
    other = replace(blown, {"room_temperature": 300.0})
    track = commanded_track(other, jnp.zeros(2), jnp.asarray(0.1), {})
    np.testing.assert_array_equal(track.measured["temperature"], [300.0, 300.0])
    np.testing.assert_array_equal(bench.model("joint").at_rest("pressure"), [bench.AMBIENT] * 2)
    np.testing.assert_array_equal(bench.model("scara").at_rest("angular_velocity"), [0.0, 0.0])


def test_the_older_form_is_still_read():
    assert {name: column.unit for name, column in Drive.columns.items()} == {"command": "V", "position": "m"}
    assert {name: state.unit for name, state in Drive.states.items()} == {"position": "m", "velocity": "m/s"}
    assert float(drive().at_rest("velocity")) == 0.0

    class Filled(Drive):
        measured: ClassVar = {"pressure": ("pressure_1", "pressure_2"), "position": ("position",)}
        ambient_pressure: float = 1e5

    assert Filled.states["pressure"].rest == "ambient_pressure" and Filled.columns["pressure_2"].unit == "Pa"


@pytest.mark.parametrize(
    ("unit", "rate"),
    [("m", "m/s"), ("m/s", "m/s^2"), ("", "1/s"), ("1/s", "1/s^2"), ("N m", "N m/s"), ("kg/s^2", "kg/s^2/s")],
)
def test_units_of_rates(unit, rate):
    assert rate_unit(unit) == rate
    assert to_si(2.0, f"({unit or 'dimensionless'})/ms", rate) == pytest.approx(2000.0)
