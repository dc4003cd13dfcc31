"""A rig outside the package whose sensors show torque, flow, temperature and a difference of pressures."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxmuscle.actuators import AbstractActuator, Command, ControlChannel, Reading, StateVariable
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import COMMAND, LOAD, Signals

HEAT_CAPACITY = 1005.0
"""Of air [J/(kg K)]."""
DENSITY = 1.2
"""Of air [kg/m^3]."""


class Fan(AbstractActuator):
    """J ω' = k u - d ω², m' = c ω, C T' = P - cp m' (T - T0): a motor blows air over a heater."""

    rig: ClassVar = "tested-fan"
    units: ClassVar = {"load": "N m", "motion": "rad"}
    quantities: ClassVar = {
        "inertia": "inertia",
        "torque_constant": "torque_constant",
        "drag": "drag",
        "flow_constant": "flow_constant",
        "heater_power": "heater_power",
        "heater_capacity": "heater_capacity",
        "room_temperature": "room_temperature",
    }
    variables: ClassVar = (
        Command("volts", "V"),
        StateVariable("speed", "rad/s", ("speed",)),
        StateVariable("temperature", "K", ("outlet",), rest="room_temperature"),
        Reading("speed", signal="load"),
        Reading("temperature", given=("speed",), signal="heat"),
        Reading("torque", "N m", ("torque",), given=("speed",), signal="load"),
        Reading("flow", "kg/s", ("flow",), given=("speed",), signal="mass_flow"),
        Reading("intake", "m^3/s", ("intake",), given=("speed",), signal="mass_flow"),
        Reading("pressure_rise", "Pa", ("pressure_rise",), ("speed",), "velocity", difference=True),
        Reading("warming", "K", ("warming",), ("speed", "temperature"), "heat", difference=True),
    )
    channel: ClassVar = ControlChannel("speed", rest="idle_voltage", lowest=0.0, highest=12.0)
    available: ClassVar = frozenset({"command", "past", "velocity"})
    largest_step: ClassVar = 1e-2

    inertia: Scalar = parameter("kg m^2", "moment of inertia of rotor and fan", positive=True)
    torque_constant: Scalar = parameter("N m/V", "torque of the motor per voltage", positive=True)
    drag: Scalar = parameter("N m s^2/rad^2", "torque of the air per squared speed", positive=True)
    flow_constant: Scalar = parameter("kg/rad", "mass of air per angle", positive=True)
    heater_power: Scalar = parameter("W", "power of the heater", positive=True)
    heater_capacity: Scalar = parameter("J/K", "heat capacity of the heater", positive=True)
    room_temperature: Scalar = parameter("K", "temperature of the air that comes in", default=293.15)
    idle_voltage: Scalar = parameter("V", "voltage at which the controller does nothing", default=1.0)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured):
        return dict(measured)

    def resting_command(self, measured):
        return self.drag * measured["speed"] ** 2 / self.torque_constant

    def signals(self, state, held):
        speed = state["speed"]
        signals = Signals(past=held.past, velocity=speed, gas_temperature=state["temperature"])
        signals = self._with(signals, COMMAND, held.command, held.memory)
        torque = self.torque_constant * signals.command - self.drag * speed * jnp.abs(speed)
        signals = signals.having(mass_flow=self.flow_constant * speed)
        return self._with(signals, LOAD, torque, held.memory)

    def vector_field(self, state, held):
        signals = self.signals(state, held)
        carried = HEAT_CAPACITY * signals.mass_flow * (signals.gas_temperature - self.room_temperature)
        return {
            "speed": signals.load / self.inertia,
            "temperature": (self.heater_power - carried) / self.heater_capacity,
            "effects": {},
        }

    def readings(self, signals):
        return {
            "speed": signals.velocity,
            "temperature": signals.gas_temperature,
            "torque": signals.load,
            "flow": signals.mass_flow,
            "intake": signals.mass_flow / DENSITY,
            "pressure_rise": 0.02 * signals.velocity**2,
            "warming": signals.gas_temperature - self.room_temperature,
        }

    def constrained(self, state):
        return state


STEP = 0.01
TRUE = {
    "inertia": 2e-4,
    "torque_constant": 0.01,
    "drag": 8e-7,
    "flow_constant": 5e-5,
    "heater_power": 150.0,
    "heater_capacity": 12.0,
    "room_temperature": 293.15,
}


def fan(**values: Any) -> Fan:
    """The true fan, but for `values`."""
    made: Any = Fan
    return made(**{**TRUE, **values})


DAMPING = 1e-4
"""Of the bearing of the measured fan [N m s/rad]."""
IN_CARD = {
    "time": ("s", 1.0, 0.0),
    "volts": ("V", 1.0, 0.0),
    "speed": ("rpm", np.pi / 30, 0.0),
    "outlet": ("degC", 1.0, 273.15),
    "torque": ("N mm", 1e-3, 0.0),
    "flow": ("g/s", 1e-3, 0.0),
    "intake": ("L/min", 1e-3 / 60, 0.0),
    "pressure_rise": ("mbar", 100.0, 0.0),
    "warming": ("degC", 1.0, 0.0),
}
"""Column → unit in the card, its size in SI by hand, and its zero in SI."""
NOISE = {
    "speed": 0.05,
    "outlet": 0.02,
    "torque": 1e-5,
    "flow": 1e-6,
    "intake": 1e-6,
    "pressure_rise": 0.5,
    "warming": 0.02,
}
"""Standard deviations of the sensors [SI]."""


def measured(samples=500, damping=0.0, seed=0):
    """Columns of the true fan in SI by fine Euler steps in plain NumPy."""
    time = STEP * np.arange(samples)
    volts = 4.0 + 1.5 * np.sin(3 * time) + np.sign(np.sin(7 * time + 1))
    p, w, temperature, rows = TRUE, 100.0, 300.0, []
    for u in volts:
        torque = p["torque_constant"] * u - p["drag"] * w * abs(w) - damping * w
        flow, warm = p["flow_constant"] * w, temperature - p["room_temperature"]
        rows.append((w, temperature, torque, flow, flow / DENSITY, 0.02 * w**2, warm))
        for _ in range(100):
            torque = p["torque_constant"] * u - p["drag"] * w * abs(w) - damping * w
            carried = HEAT_CAPACITY * p["flow_constant"] * w * (temperature - p["room_temperature"])
            temperature += STEP / 100 * (p["heater_power"] - carried) / p["heater_capacity"]
            w += STEP / 100 * torque / p["inertia"]
    rng = np.random.default_rng(seed)
    values = np.array(rows).T + np.array([*NOISE.values()])[:, None] * rng.normal(size=(7, samples))
    return {"time": time, "volts": volts, **dict(zip(NOISE, values, strict=True))}


CARD = """rig = "tested-fan"
description = "A motor blows air over a heater."

[columns]
{columns}

[known]
torque_constant = {{ value = 10, unit = "N mm/V" }}
flow_constant = {{ value = 0.05, unit = "g/rad" }}
room_temperature = {{ value = 20, unit = "degC" }}

[uncertain]
inertia = {{ value = 2.4e-4, std = 1e-4, unit = "kg m^2" }}
drag = {{ value = 1e-6, std = 5e-7, unit = "N m s^2/rad^2" }}
heater_power = {{ value = 140, std = 20, unit = "W" }}
heater_capacity = {{ value = 10, std = 4, unit = "J/K" }}

[noise]
{noise}

[fit]
horizon = {{ value = 0.5, unit = "s" }}
"""


def written(folder, columns):
    """CSV and card of a recording in the units of `IN_CARD`; the file of the CSV."""
    table = {name: (columns[name] - zero) / size for name, (_, size, zero) in IN_CARD.items()}
    file = folder / "fan.csv"
    rows = np.array(list(table.values())).T
    np.savetxt(
        file, rows, delimiter=",", header=",".join(f"c_{name}" for name in table), comments="", fmt="%.12g"
    )
    lines = [f'{name} = {{ column = "c_{name}", unit = "{unit}" }}' for name, (unit, *_) in IN_CARD.items()]
    noise = [
        f'{name} = {{ value = {std / IN_CARD[name][1]!r}, unit = "{IN_CARD[name][0]}" }}'
        for name, std in NOISE.items()
    ]
    card = CARD.format(columns="\n".join(lines), noise="\n".join(noise))
    file.with_suffix(".toml").write_text(card, encoding="utf-8")
    return file
